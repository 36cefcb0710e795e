"""Meshes with named bodies and surfaces, and their partition over ranks."""
