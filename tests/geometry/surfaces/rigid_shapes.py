"""Rigid shapes that the tests share, places around them, and motions."""

import numpy as np

from geometry.surfaces.rigid_circle import Circle
from geometry.surfaces.rigid_motion import RigidMotion
from geometry.surfaces.rigid_plane import Plane

SMOOTH = {
    "line": lambda: Plane(np.array([0.2, 0.1]), np.array([-0.3, 1.0]), 0.5),
    "plane": lambda: Plane(np.array([0.2, 0.1, -0.3]), np.array([-0.3, 0.2, 1.0]), 0.5),
    "circle": lambda: Circle(np.array([0.2, 0.1]), 0.8),
    "hollow circle": lambda: Circle(np.array([0.2, 0.1]), 0.8, hollow=True),
}


def moved(shape, theta=0.0, shift=0.0):
    """Control points of a shape that is turned about some centre and shifted along all axes."""
    axis = None if shape.dim == 2 else np.array([0.2, -1.0, 0.7])
    motion = RigidMotion(np.full(shape.dim, 0.4), shape.control_points, 1.3, axis)
    return motion.control_points(shift * np.arange(1.0, shape.dim + 1.0), theta)


def around(shape, count=40, spread=1.5, seed=0):
    """Points (q, i) about the middle of a shape, undeformed."""
    rng = np.random.default_rng(seed)
    return shape.control_points.mean(axis=0) + rng.uniform(-spread, spread, (count, shape.dim))
