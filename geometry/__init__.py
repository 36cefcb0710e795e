"""Geometry: meshes, surfaces, contact search and projection."""

if __name__ == "geometry":  # beside tribox.geometry it would hold everything a second time
    raise ImportError("geometry is imported as tribox.geometry: put src on the path")
