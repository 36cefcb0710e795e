"""C sources and how they are compiled and loaded."""
