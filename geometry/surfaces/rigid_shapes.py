"""Rigid shapes of closed form: plane, circle, sphere, and those of the plane drawn out in space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tribox.geometry.surfaces.rigid import Feet, Outline, Places, RigidShape, unit

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facets import Bools, Floats, Ints

# -- A rigid plane, in the plane a straight line, without end --------------------------------------

WIDE = 4.0  # times the box, that the line is drawn: bodies spread under it


class Plane(RigidShape):
    """Y(ξ) = P + ξ^α L e_α."""

    def __init__(self, point: Floats, normal: Floats, size: float = 1.0) -> None:
        """Take P (i,), m, near where it is touched, and the normal (i,) out of the tool.

        ``size``: m, L, of what touches it; ValueError if it, or the direction, is none.
        """
        self.point, self.normal = np.array(point, dtype=np.float64), unit(normal, "a normal")
        extent = np.tile(np.array([[-np.inf], [np.inf]]), (1, len(self.point)))
        # Only a plane across an axis is bounded, in that axis.
        across = np.abs(np.abs(self.normal) - 1.0) <= 1e-15
        extent[:, across] = self.point[across]
        super().__init__(1, self.point, size, extent)
        self._tangents = self.size * directions_across(self.normal)

    def closest(self, points: Floats, frozen_facets: Ints | None) -> Feet:
        # Tangents of length L: x·τ/L² is ξ.
        xi: Floats = ((points - self.point) @ self._tangents.T / self.size**2).astype(np.float64)
        return Feet(np.zeros(len(points), dtype=np.int32), xi)

    def at(self, facet: Ints, xi: Floats) -> Places:
        tangents = np.tile(self._tangents, (len(xi), 1, 1))
        return Places(self.point + xi @ self._tangents, tangents)

    def outline(self, box: Floats, count: int = 64) -> Outline:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`; across the box."""
        middle = (0.5 * (box[0] + box[1]) - self.point) @ self._tangents.T / self.size**2
        half = 0.5 * float(np.linalg.norm(box[1] - box[0])) / self.size
        half *= 1.0 if len(self.point) == 3 else WIDE
        signs = np.array([[-1.0], [1.0]])
        cells = np.array([[0, 1]], dtype=np.int32)
        if len(self.point) == 3:
            signs = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
            cells = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
        return Outline(self.at(cells[:0, 0], middle + half * signs).place, cells)


def directions_across(normal: Floats) -> Floats:
    """Unit directions (α, i) across a unit normal (i,), which they give as τ turned or τ_1 × τ_2.

    In the plane the normal turned right.
    """
    if len(normal) == 2:
        return np.array([[normal[1], -normal[0]]])
    axis = np.zeros(3)
    # The axis farthest from the normal: their product is never near 0.
    axis[np.argmin(np.abs(normal))] = 1.0
    first = np.cross(axis, normal)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


# -- A rigid circle in the plane, solid or hollow --------------------------------------------------

QUARTERS = 4
_ARC = 2.0 * np.pi / QUARTERS
FLAT = 1e-4  # of the diagonal of the box, that the chords of an outline lie off the arc at most


class Circle(RigidShape):
    """Y(ξ) = C + R (cos φ, sin φ) in four quarters, with φ = ∓(k + ξ) π/2 on the quarter k.

    The angle falls along a solid circle and grows along a hollow one, so that the tangent turned
    left points out of the material.
    """

    def __init__(self, centre: Floats, radius: float, hollow: bool = False) -> None:
        """Take centre C (2,) and radius R, m; ValueError if R is not positive.

        ``hollow``: the material is outside of the circle: a die, touched from inside.
        """
        if not (np.isfinite(radius) and radius > 0.0):
            raise ValueError(f"the radius of a circle must be positive, not {radius:g}")
        self.centre, self.radius = np.array(centre, dtype=np.float64), float(radius)
        self.sign = 1.0 if hollow else -1.0
        extent = np.stack([self.centre - self.radius, self.centre + self.radius])
        self.least_radius = self.radius
        super().__init__(QUARTERS, self.centre, self.radius, extent)

    def closest(self, points: Floats, frozen_facets: Ints | None) -> Feet:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidShape`; of the centre that at φ = 0."""
        apart = points - self.centre
        # Rounding may make the remainder 2π itself, the end of the last quarter.
        turned = self.sign * np.arctan2(apart[:, 1], apart[:, 0]) % (2.0 * np.pi) / _ARC
        facet = np.minimum(turned.astype(np.int32), QUARTERS - 1)
        return Feet(facet, (turned - facet)[:, None])

    def at(self, facet: Ints, xi: Floats) -> Places:
        angle = self.sign * _ARC * (facet + xi[:, 0])
        radial = self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ahead = np.stack([-radial[:, 1], radial[:, 0]], axis=1)
        return Places(
            self.centre + radial,
            (self.sign * _ARC * ahead)[:, None],
            (-(_ARC**2) * radial)[:, None, None],
        )

    def outline(self, box: Floats, count: int = 64) -> Outline:
        # Beside a large roll the bodies are thin: chords within FLAT of their size.
        seen = max(float(np.linalg.norm(box[1] - box[0])), 0.01 * self.radius)
        count = max(count, int(np.ceil(np.pi * np.sqrt(0.5 * self.radius / (FLAT * seen)))))
        number = np.arange(count, dtype=np.int32)
        turned = QUARTERS * number / count
        points = self.at(np.zeros(count, dtype=np.int32), turned[:, None]).place
        return Outline(points, np.stack([number, np.roll(number, -1)], axis=1))


# -- A rigid sphere, solid or hollow ---------------------------------------------------------------

PATCHES = 6


class Sphere(RigidShape):
    """Y(ξ) = C + R p/|p| on the sides of a cube, p = e_0 + (2ξ − 1) e_1 + (2η − 1) e_2.

    Six coordinate patches instead of one: none has a pole.
    """

    def __init__(self, centre: Floats, radius: float, hollow: bool = False) -> None:
        """Take centre C (3,) and radius R, m; ValueError if R is not positive.

        ``hollow``: the material is outside of the sphere, which is touched from inside.
        """
        if not (np.isfinite(radius) and radius > 0.0):
            raise ValueError(f"the radius of a sphere must be positive, not {radius:g}")
        self.centre, self.radius = np.array(centre, dtype=np.float64), float(radius)
        extent = np.stack([self.centre - self.radius, self.centre + self.radius])
        self.least_radius = self.radius
        super().__init__(PATCHES, self.centre, self.radius, extent)
        self._frames = _frames(hollow)

    def closest(self, points: Floats, frozen_facets: Ints | None) -> Feet:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidShape`; a centre on the axis."""
        apart = points - self.centre
        # The side of the cube that the ray from the centre passes through.
        axis = np.argmax(np.abs(apart), axis=1)
        largest = np.take_along_axis(apart, axis[:, None], axis=1)[:, 0]
        facet = (2 * axis + (largest < 0.0)).astype(np.int32)
        along = np.einsum("qki,qi->qk", self._frames[facet], apart)
        ahead = np.where(along[:, :1] > 0.0, along[:, :1], 1.0)
        return Feet(facet, 0.5 + 0.5 * along[:, 1:] / ahead)

    def at(self, facet: Ints, xi: Floats) -> Places:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`.

        With ρ = |p| and d = p/ρ: ρ_,α = d·p_,α, d_,α = (p_,α − d ρ_,α)/ρ.
        """
        frame = self._frames[facet]
        p_a = 2.0 * frame[:, 1:]
        p = frame[:, 0] + np.einsum("qa,qai->qi", xi - 0.5, p_a)
        rho = np.linalg.norm(p, axis=1)
        d = p / rho[:, None]
        rho_a = np.einsum("qi,qai->qa", d, p_a)
        d_a = (p_a - d[:, None] * rho_a[..., None]) / rho[:, None, None]
        rho_ab = np.einsum("qbi,qai->qab", d_a, p_a)
        d_ab = d_a[:, :, None] * rho_a[:, None, :, None]
        d_ab = d_ab + d_ab.transpose(0, 2, 1, 3) + d[:, None, None] * rho_ab[..., None]
        curvature = -self.radius * d_ab / rho[:, None, None, None]
        return Places(self.centre + self.radius * d, self.radius * d_a, curvature)

    def outline(self, box: Floats, count: int = 64) -> Outline:
        lines = max(count // 4, 2)
        xi, cells = _grid(lines + 1, lines + 1)
        facet = np.repeat(np.arange(PATCHES, dtype=np.int32), len(xi))
        points = self.at(facet, np.tile(xi, (PATCHES, 1))).place
        first = len(xi) * np.arange(PATCHES, dtype=np.int32)
        return Outline(points, (first[:, None, None] + cells).reshape(-1, 3))


def _frames(hollow: bool) -> Floats:
    """e_0, e_1, e_2 (f, 3, i) of the patches; e_1 × e_2 is e_0, or −e_0 of a hollow sphere."""
    frames = np.empty((PATCHES, 3, 3))
    for patch in range(PATCHES):
        sign = 1.0 - 2.0 * (patch % 2)
        e = np.roll(np.eye(3), -(patch // 2), axis=0)
        frames[patch] = np.stack([sign * e[0], e[1], e[2]])
        if (sign < 0.0) != hollow:
            frames[patch, 1:] = frames[patch, :0:-1]
    return frames


def _grid(along: int, across: int) -> tuple[Floats, Ints]:
    """Places ξ (n, 2) of a grid on the unit square, and triangles (t, 3) on it."""
    sides = np.linspace(0.0, 1.0, along), np.linspace(0.0, 1.0, across)
    xi = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 2).astype(np.float64)
    number = np.arange(len(xi), dtype=np.int32).reshape(along, across)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    return xi, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


class Extruded(RigidShape):
    """Y(ξ, η) = O + s_1(ξ) e_1 + s_2(ξ) e_2 − η L e_3, with s a shape in the plane; without end."""

    def __init__(self, section: RigidShape, origin: Floats, first: Floats, axis: Floats) -> None:
        """Take a section in the plane, its origin O (3,), m, directions; ValueError if parallel.

        ``first``: (3,) e_1, less its part along the axis (3,) e_3; e_2 = e_3 × e_1.
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
        return self.section.excess(facet, xi[:, :1])

    def cut_off(self, facet: Ints, xi: Floats) -> Bools:
        return self.section.cut_off(facet, xi[:, :1])

    def outline(self, box: Floats, count: int = 64) -> Outline:
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
        """Take a point (3,), m, near where it is touched, on the axis (3,), and the radius, m.

        ``hollow``: touched from inside; ValueError of a radius or axis that is none.
        """
        along = unit(axis, "an axis")
        circle = Circle(np.zeros(2), radius, hollow)
        super().__init__(circle, point, directions_across(along)[0], along)
