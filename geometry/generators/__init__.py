"""Built-in geometries, meshed by gmsh."""
