"""Rigid shapes that the tests share, places around them, and motions."""

import numpy as np

from tribox.geometry.surfaces.rigid import RigidMotion
from tribox.geometry.surfaces.rigid_polyline import Polyline
from tribox.geometry.surfaces.rigid_shapes import Circle, Cylinder, Extruded, Plane, Sphere

# A step down, an inner corner and a flank, from left to right: the free side is above.
STEP = np.array([[-1.0, 0.5], [0.1, 0.5], [0.3, -0.4], [0.9, -0.5], [1.2, 0.3]])
TRIANGLE = np.array([[-0.7, -0.5], [0.1, 0.8], [0.9, -0.6]])


def die():
    """A polyline with fillets that goes on at both ends."""
    return Polyline(STEP, [0.3, 0.2, 0.25], continued=(True, True))


SMOOTH = {
    "line": lambda: Plane(np.array([0.2, 0.1]), np.array([-0.3, 1.0]), 0.5),
    "plane": lambda: Plane(np.array([0.2, 0.1, -0.3]), np.array([-0.3, 0.2, 1.0]), 0.5),
    "circle": lambda: Circle(np.array([0.2, 0.1]), 0.8),
    "hollow circle": lambda: Circle(np.array([0.2, 0.1]), 0.8, hollow=True),
    "sphere": lambda: Sphere(np.array([0.2, 0.1, -0.3]), 0.8),
    "hollow sphere": lambda: Sphere(np.array([0.2, 0.1, -0.3]), 0.8, hollow=True),
    "cylinder": lambda: Cylinder(np.array([0.2, 0.1, -0.3]), np.array([1.0, -0.4, 0.3]), 0.8),
    "hollow cylinder": lambda: Cylinder(np.zeros(3), np.array([0.0, 0.0, 2.0]), 0.8, hollow=True),
    "die": die,
    "closed": lambda: Polyline(TRIANGLE, 0.2, closed=True),
    "closed inside": lambda: Polyline(TRIANGLE, 0.2, closed=True, inside=np.array([5.0, 0.0])),
    "long die": lambda: Extruded(die(), np.array([0.1, 0.2, 0.0]), np.ones(3), np.eye(3)[2]),
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
