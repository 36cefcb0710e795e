"""Solid bodies: kinematics, materials, internal forces, masses and loads."""
