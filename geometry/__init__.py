"""Where things are: meshes, surfaces, contact search and projection."""
