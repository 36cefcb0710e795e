"""What a master is to the contact: the closest points on it.

Axis letters: q slave points, i space, α, β surface directions. A facet here is any piece of a
surface with coordinates ξ of its own: one facet of a mesh
(:mod:`tribox.geometry.surfaces.projection`), or one smooth piece of a rigid shape
(:mod:`tribox.geometry.surfaces.rigid`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:  # rigid shapes are made without DOLFINx
    from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
    from tribox.geometry.surfaces.slave_points import PointNormals

TOUCHING = 1e-12  # distance over |τ| below which x − ȳ has no direction


def fade_at_ends(
    is_open: Bools, xi: Floats, length: Floats, reach: Floats
) -> tuple[Floats, Floats]:
    """Shares (p,) of points ξ (p,) beside an open end of pieces in the plane, and ∂/∂ξ.

    A share falls evenly to 0 over the last way ``reach`` (p,), m, of pieces of length (p,), m, up
    to the nearer end that ``is_open`` (p, 2).
    """
    # A reach longer than the piece would leave no point of it whole.
    per_length = length / np.minimum(reach, length)
    way = np.where(is_open, np.stack([xi, 1.0 - xi], axis=1) * per_length[:, None], np.inf)
    end = np.argmin(way, axis=1)
    share = way[np.arange(len(xi)), end]
    slope = np.where(end == 0, per_length, -per_length)
    return np.minimum(share, 1.0), np.where(share < 1.0, slope, 0.0)


@dataclass(slots=True)
class Projection:
    """The closest master point of every slave point."""

    facet: Ints  # (q,) master facet that carries the closest point
    xi: Floats  # (q, α) its reference coordinates
    foot: Floats  # (q, i), m, current: the closest point ȳ
    normal: Floats  # (q, i) unit outward normal of the master at ȳ; along x − ȳ where clamped
    tangents: Floats  # (q, α, i), m, current: τ_α = ∂ȳ/∂ξ^α
    gap: Floats  # (q,), m: g = (x − ȳ)·n, negative in penetration
    clamped: Bools  # (q,) the closest point is on an edge or a corner and cannot leave it
    on_surface: Bools  # (q,) False past the end of the master, where there is no contact
    # (q, α, β, i), m, current: ∂²ȳ/∂ξ^α∂ξ^β; None where all facets are flat
    curvature: Floats | None = None
    # (q, α) reference direction of the edge that a clamped point can move along, zero at a corner;
    # None in the plane, where there are corners only
    along: Floats | None = None
    # (q,) how much of each point counts: less than 1 only beside the open end of a master, or where
    # rays hardly face it
    share: Floats | None = None
    share_slope: Floats | None = None  # (q, α) its derivatives for ξ. None: 1 everywhere
    # (q, i) that for the ray's normal over a master that does not turn; None: zero
    share_turn: Floats | None = None
    # the slave's normals, where ȳ lies along them; None where it is the closest point
    rays: PointNormals | None = None
    offset: Floats | None = None

    @property
    def distance(self) -> Floats:
        """(x − ȳ)·n (q,), m, the way between the surfaces as they lie, whatever is felt of it."""
        return self.gap if self.offset is None else self.gap - self.offset

    def shift(self, offset: Floats) -> None:
        """Let contact feel gaps that are wider by ``offset`` (q,), m: the master is set back."""
        self.gap, self.offset = self.gap + offset, offset

    def of(self, take: Longs) -> Projection:
        """The same of the points ``take`` (p,)."""

        def taken(part: Any) -> Any:
            return part if part is None else part.of(take) if part is self.rays else part[take]

        return Projection(*(taken(getattr(self, one.name)) for one in fields(self)))

    def clamp(self, at: Longs | Ints, points: Floats, outward: Floats) -> None:
        """Give points ``at`` (p,) that an edge or corner holds normal and gap along x − ȳ.

        x (p, i), m; ``outward``: (p, i), for the sign and where x − ȳ is nothing.
        """
        apart = points - self.foot[at]
        distance = np.linalg.norm(apart, axis=1)
        sign = np.where(np.einsum("qi,qi->q", apart, outward) < 0.0, -1.0, 1.0)
        tiny = distance <= TOUCHING * np.linalg.norm(self.tangents[at, 0], axis=1)
        safe = np.where(tiny, 1.0, distance)[:, None]
        self.normal[at] = np.where(tiny[:, None], outward, sign[:, None] * apart / safe)
        self.gap[at] = sign * distance
