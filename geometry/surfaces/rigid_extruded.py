"""Rigid shapes of the plane drawn out straight in space: cylinders, dies of constant section."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tribox.geometry.surfaces.rigid import Feet, Outline, Places, RigidShape, unit
from tribox.geometry.surfaces.rigid_circle import Circle
from tribox.geometry.surfaces.rigid_plane import directions_across

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facets import Bools, Floats, Ints


class Extruded(RigidShape):
    """Y(ξ, η) = O + s_1(ξ) e_1 + s_2(ξ) e_2 − η L e_3, with s a shape in the plane; without end."""

    def __init__(self, section: RigidShape, origin: Floats, first: Floats, axis: Floats) -> None:
        """Take the place.

        Args:
            section: the shape in the plane.
            origin: (3,), m: O, where the section has its origin.
            first: (3,) e_1, the section's first direction; its part along the axis is left out.
            axis: (3,) e_3, of any length; e_2 = e_3 × e_1.

        Raises:
            ValueError: directions that are none, or parallel.
        """
        self.section, self.origin = section, np.array(origin, dtype=np.float64)
        axis = unit(axis, "an axis")
        first = np.asarray(first, dtype=np.float64)
        first = unit(first - (first @ axis) * axis, "the first direction of a section")
        self._frame = np.stack([first, np.cross(axis, first), axis])
        middle = section.control_points.mean(axis=0)
        size, self.least_radius = section.size, section.least_radius
        centre = self.origin + middle @ self._frame[:2]
        super().__init__(len(section.stencil), centre, size, self._bounds(section.extent))

    def _bounds(self, section: Floats) -> Floats:
        """Extent (2, i) from that of the section (2, 2), infinite along the axis."""
        low = np.append(section[0], -np.inf)
        high = np.append(section[1], np.inf)
        extent = np.tile(self.origin, (2, 1))
        for across, least, largest in zip(self._frame, low, high, strict=True):  # three directions
            present = np.abs(across) > 1e-15
            ends = np.sort(np.outer([least, largest], across[present]), axis=0)
            extent[:, present] += ends
        return extent

    def closest(self, points: Floats, frozen_facets: Ints | None) -> Feet:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidShape`."""
        here = (points - self.origin) @ self._frame.T
        feet = self.section.closest(here[:, :2], frozen_facets)
        xi = np.stack([feet.xi[:, 0], -here[:, 2] / self.size], axis=1)
        out = Feet(feet.facet, xi, on_surface=feet.on_surface)
        if feet.outward is not None:
            out.outward = feet.outward @ self._frame[:2]
            out.along = np.zeros_like(xi)
            out.along[~np.isnan(feet.outward[:, 0]), 1] = 1.0
        return out

    def at(self, facet: Ints, xi: Floats) -> Places:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`."""
        flat = self.section.at(facet, xi[:, :1])
        across, axis = self._frame[:2], self._frame[2]
        tangents = np.empty((len(xi), 2, 3))
        tangents[:, 0] = flat.tangents[:, 0] @ across
        tangents[:, 1] = -self.size * axis
        along = -self.size * xi[:, 1:] * axis
        out = Places(self.origin + flat.place @ across + along, tangents)
        if flat.curvature is not None:
            out.curvature = np.zeros((len(xi), 2, 2, 3))
            out.curvature[:, 0, 0] = flat.curvature[:, 0, 0] @ across
        return out

    def excess(self, facet: Ints, xi: Floats) -> Floats:
        """See :class:`~tribox.geometry.surfaces.target.Target`."""
        return self.section.excess(facet, xi[:, :1])

    def cut_off(self, facet: Ints, xi: Floats) -> Bools:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`."""
        return self.section.cut_off(facet, xi[:, :1])

    def outline(self, box: Floats, count: int = 64) -> Outline:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`."""
        corners = np.stack(np.meshgrid(*np.transpose(box)), axis=-1).reshape(-1, 3)
        here = (corners - self.origin) @ self._frame.T
        low, high = here.min(axis=0), here.max(axis=0)
        line = self.section.outline(np.stack([low[:2], high[:2]]), count)
        flat = self.origin + line.points @ self._frame[:2]
        ends = flat[None] + np.array([low[2], high[2]])[:, None, None] * self._frame[2]
        near, far = line.cells.T, line.cells.T + len(flat)
        cells = [np.stack([far[0], far[1], near[1]], axis=1)]
        cells += [np.stack([far[0], near[1], near[0]], axis=1)]
        return Outline(ends.reshape(-1, 3), np.concatenate(cells).astype(np.int32))


class Cylinder(Extruded):
    """A round cylinder without end, solid or hollow."""

    def __init__(self, point: Floats, axis: Floats, radius: float, hollow: bool = False) -> None:
        """Take the place.

        Args:
            point: (3,), m, on the axis, near where the cylinder is touched.
            axis: (3,), of any length.
            radius: m.
            hollow: whether the material is outside of the cylinder, which is touched from inside.

        Raises:
            ValueError: a radius that is not positive, or an axis without direction.
        """
        along = unit(axis, "an axis")
        circle = Circle(np.zeros(2), radius, hollow)
        super().__init__(circle, point, directions_across(along)[0], along)
