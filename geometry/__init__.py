"""Geometry: meshes, surfaces, contact search and projection."""
