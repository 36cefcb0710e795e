"""A rigid plane, in the plane a straight line, without end."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tribox.geometry.surfaces.rigid import Feet, Outline, Places, RigidShape, unit

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facets import Floats, Ints


class Plane(RigidShape):
    """Y(ξ) = P + ξ^α L e_α."""

    def __init__(self, point: Floats, normal: Floats, size: float = 1.0) -> None:
        """Take the place.

        Args:
            point: (i,), m: P, on the plane, near where it is touched.
            normal: (i,) out of the tool, of any length.
            size: m: L, of the order of what touches it.

        Raises:
            ValueError: a normal without direction, or no size.
        """
        self.point, self.normal = np.array(point, dtype=np.float64), unit(normal, "a normal")
        dim = len(self.point)
        extent = np.tile(np.array([[-np.inf], [np.inf]]), (1, dim))
        across = np.abs(np.abs(self.normal) - 1.0) <= 1e-15
        extent[:, across] = self.point[across]
        super().__init__(1, self.point, size, extent)
        self._tangents = self.size * directions_across(self.normal)

    def closest(self, points: Floats, frozen_facets: Ints | None) -> Feet:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidShape`."""
        xi: Floats = ((points - self.point) @ self._tangents.T / self.size**2).astype(np.float64)
        return Feet(np.zeros(len(points), dtype=np.int32), xi)

    def at(self, facet: Ints, xi: Floats) -> Places:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`."""
        tangents = np.tile(self._tangents, (len(xi), 1, 1))
        return Places(self.point + xi @ self._tangents, tangents)

    def outline(self, box: Floats, count: int = 64) -> Outline:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`; across the box."""
        middle = (0.5 * (box[0] + box[1]) - self.point) @ self._tangents.T / self.size**2
        half = 0.5 * float(np.linalg.norm(box[1] - box[0])) / self.size
        signs = np.array([[-1.0], [1.0]])
        cells = np.array([[0, 1]], dtype=np.int32)
        if len(self.point) == 3:
            signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
            cells = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
        corners = self.at(cells[:0, 0], middle + half * signs)
        return Outline(corners.place, cells)


def directions_across(normal: Floats) -> Floats:
    """Unit directions (α, i) across a unit normal (i,), which they give as τ turned or τ_1 × τ_2.

    In the plane the normal turned right.
    """
    if len(normal) == 2:
        return np.array([[normal[1], -normal[0]]])
    axis = np.zeros(3)
    axis[np.argmin(np.abs(normal))] = 1.0
    first = np.cross(axis, normal)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])
