"""C sources of searches on surfaces, and how all C sources are compiled and loaded."""
