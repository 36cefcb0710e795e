"""A rigid sphere, solid or hollow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tribox.geometry.surfaces.rigid import Feet, Outline, Places, RigidShape

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facets import Floats, Ints

PATCHES = 6


class Sphere(RigidShape):
    """Y(ξ) = C + R p/|p| on the sides of a cube, p = e_0 + (2ξ − 1) e_1 + (2η − 1) e_2.

    Six coordinate patches instead of one: none has a pole.
    """

    def __init__(self, centre: Floats, radius: float, hollow: bool = False) -> None:
        """Take the place.

        Args:
            centre: (3,), m: C.
            radius: m: R.
            hollow: whether the material is outside of the sphere, which is touched from inside.

        Raises:
            ValueError: a radius that is not positive.
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
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`."""
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
