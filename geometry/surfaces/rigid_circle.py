"""A rigid circle in the plane, solid or hollow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tribox.geometry.surfaces.rigid import Feet, Outline, Places, RigidShape

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facets import Floats, Ints

QUARTERS = 4
_ARC = 2.0 * np.pi / QUARTERS


class Circle(RigidShape):
    """Y(ξ) = C + R (cos φ, sin φ) in four quarters, with φ = ∓(k + ξ) π/2 on the quarter k.

    The angle falls along a solid circle and grows along a hollow one, so that the tangent turned
    left points out of the material.
    """

    def __init__(self, centre: Floats, radius: float, hollow: bool = False) -> None:
        """Take the place.

        Args:
            centre: (2,), m: C.
            radius: m: R.
            hollow: whether the material is outside of the circle: a die, touched from inside.

        Raises:
            ValueError: a radius that is not positive.
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
        turned = self.sign * np.arctan2(apart[:, 1], apart[:, 0]) % (2.0 * np.pi) / _ARC
        facet = np.minimum(turned.astype(np.int32), QUARTERS - 1)
        return Feet(facet, (turned - facet)[:, None])

    def at(self, facet: Ints, xi: Floats) -> Places:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`."""
        angle = self.sign * _ARC * (facet + xi[:, 0])
        radial = self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        ahead = np.stack([-radial[:, 1], radial[:, 0]], axis=1)
        return Places(
            self.centre + radial,
            (self.sign * _ARC * ahead)[:, None],
            (-(_ARC**2) * radial)[:, None, None],
        )

    def outline(self, box: Floats, count: int = 64) -> Outline:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`."""
        number = np.arange(count, dtype=np.int32)
        turned = QUARTERS * number / count
        points = self.at(np.zeros(count, dtype=np.int32), turned[:, None]).place
        return Outline(points, np.stack([number, np.roll(number, -1)], axis=1))
