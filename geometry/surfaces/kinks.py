"""A normal without jumps where two facets of a master in the plane meet at an angle.

Axis letters: q slave points, f facets, m nodes of a facet, e ends of a facet, i space.

A quadrature point stands for a piece of the slave surface. While that piece passes a kink of the
master, a growing share of it lies over the next facet. The normal of the point is therefore that
of both facets, by these shares: within the half length ℓ of the piece from the kink, at the
distance s from it,

    n̂(ξ) = m/|m|,   m = λ n(ξ) + (1 − λ) n',   λ = ½(1 + s/ℓ),

with n the normal of the facet itself and n' that of its neighbour at the kink; beyond, n̂ = n. On
both sides of the kink m is the same. The point is then projected along n̂: x = ȳ(ξ) + g n̂(ξ), which
has one solution as long as g times the angle is less than 2ℓ. Nothing changes away from kinks, nor
on a flat master.

A projection along normals of the slave has no jumps either (Puso & Laursen, Comput. Methods Appl.
Mech. Engng 193 (2004) 601), but turns the pressure at the ends of the slave, where the body bends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.surfaces.facets import Bools, FacetShape, Floats, Ints, Longs, unit_normals

# Sine of the angle between two facets below which they count as one plane.
LEAST_KINK = 1e-8
_HOPS = 3  # facets that a point may change to, one after the other
_ITERATIONS = 12  # of Newton's method along a facet; three or four are usual


@dataclass(slots=True)
class Kinks:
    """Points that are near a kink.

    Attributes:
        points: (p,) which points, sorted; beside: (p,) the facet on the other side of the kink.
        there: (p, 1) where the kink is in ξ of that facet; tangent: (p, i), m, its tangent there.
        share: (p,) λ; slope: (p,) dλ/dξ.
    """

    points: Longs
    beside: Ints
    there: Floats
    tangent: Floats
    share: Floats
    slope: Floats

    def of(self, take: Longs) -> Kinks | None:
        """Those among the points ``take`` (r,), sorted, numbered in their order; None: none."""
        keep = np.isin(self.points, take)
        if not keep.any():
            return None
        return Kinks(
            np.searchsorted(take, self.points[keep]),
            self.beside[keep],
            self.there[keep],
            self.tangent[keep],
            self.share[keep],
            self.slope[keep],
        )


class KinkSearch:
    """Projection along the normal that turns steadily past the kinks.

    Attributes:
        shape: of the facets; across: (f, e) the facet beyond each end, −1 at the end of all.
    """

    def __init__(self, shape: FacetShape, across: Ints, controls: Floats) -> None:
        """Take the undeformed facets (f, m, i), m."""
        self.shape, self.across = shape, across
        self.length = np.linalg.norm(controls[:, 1] - controls[:, 0], axis=1)

    def angles(self, controls: Floats) -> Bools:
        """Whether each end (f, e) of the current facets (f, m, i) is at a kink."""
        here = self.end_normals(controls)
        there = here[self.across, np.array([1, 0])]
        sine = here[..., 0] * there[..., 1] - here[..., 1] * there[..., 0]
        kinked: Bools = (np.abs(sine) > LEAST_KINK) & (self.across >= 0)
        return kinked

    def end_normals(self, controls: Floats) -> Floats:
        """Normals (f, e, i) of the facets at their ends."""
        ends = self.shape.first(np.array([[0.0], [1.0]]))
        return unit_normals(np.einsum("eba,fai->febi", ends, controls))

    def project(
        self, points: Floats, controls: Floats, facet: Ints, xi: Floats, half: Floats
    ) -> tuple[Kinks, Longs]:
        """Move points near kinks to where n̂ points at them; changes ``facet`` and ``xi``.

        Returns:
            The points that are near a kink, and all that were moved.

        Args:
            points: (q, i), m, current.
            controls: (f, m, i), m, current.
            facet: (q,), of the closest points.
            xi: (q, 1), of the closest points.
            half: (q,), m: half the length that each point stands for.
        """
        kinked = self.angles(controls)
        normals = self.end_normals(controls)
        zone = _Zones(self, points, controls, normals, kinked, half)
        near = zone.near(np.arange(len(points)), facet, xi[:, 0])
        moving = near
        for _ in range(_HOPS):
            if not len(moving):
                break
            moving = zone.move(moving, facet, xi)
        return zone.kinks(near, facet, xi[:, 0]), near


@dataclass(slots=True)
class _Zones:
    """The neighbourhoods of the kinks on the current facets."""

    search: KinkSearch
    points: Floats
    controls: Floats
    normals: Floats
    kinked: Bools
    half: Floats

    def widths(self, at: Ints, facet: Ints) -> Floats:
        """Width (p, e) of the zones at both ends of the facets, in ξ; 0 without a kink."""
        length, across = self.search.length, self.search.across[facet]
        shorter = np.minimum(length[facet][:, None], length[across])
        width = np.minimum(self.half[at][:, None], 0.5 * shorter) / length[facet][:, None]
        return np.where(self.kinked[facet], width, 0.0)

    def near(self, at: Ints, facet: Ints, xi: Floats) -> Ints:
        """Those of the points that are within a zone."""
        width = self.widths(at, facet[at])
        inside = (xi[at] < width[:, 0]) | (1.0 - xi[at] < width[:, 1])
        return at[inside]

    def share(self, at: Ints, facet: Ints, end: Ints, xi: Floats) -> tuple[Floats, Floats]:
        """λ (p,) and dλ/dξ (p,) at a distance from the end of a facet."""
        width = self.widths(at, facet)[np.arange(len(at)), end]
        sign = np.where(end == 0, 1.0, -1.0)
        from_end = np.where(end == 0, xi, 1.0 - xi)
        share = 0.5 * (1.0 + from_end / width)
        inside = from_end < width
        return np.where(inside, share, 1.0), np.where(inside, sign * 0.5 / width, 0.0)

    def residual(self, at: Ints, facet: Ints, end: Ints, xi: Floats) -> tuple[Floats, Floats]:
        """(x − ȳ) against m, turned to the right (p,), and its derivative for ξ."""
        shape, mine = self.search.shape, self.controls[facet]
        place = xi[:, None]
        tau = np.einsum("pba,pai->pbi", shape.first(place), mine)
        apart = self.points[at] - np.einsum("pa,pai->pi", shape.values(place), mine)
        normal, other = unit_normals(tau), self.beyond(facet, end)
        share, slope = self.share(at, facet, end, xi)
        m = share[:, None] * normal + (1.0 - share)[:, None] * other
        d_m = slope[:, None] * (normal - other)
        if not shape.is_flat:
            second = np.einsum("pbca,pai->pbci", shape.second(place), mine)[:, 0, 0]
            d_m += share[:, None] * turned(tau[:, 0], normal, second)
        return _right(m, apart), _right(d_m, apart) - _right(m, tau[:, 0])

    def beyond(self, facet: Ints, end: Ints) -> Floats:
        """Normals (p, i) of the neighbours at the kinks."""
        return self.normals[self.search.across[facet, end], 1 - end]

    def move(self, at: Ints, facet: Ints, xi: Floats) -> Ints:
        """Solve for the points ``at`` on their facets; returns those that belong to the next."""
        own, start = facet[at], xi[at, 0]
        end = self._nearest_end(at, own, start)
        vertex = end.astype(np.float64)
        # The residual falls with ξ: its sign at the kink tells on which side the point is.
        at_kink = self.residual(at, own, end, vertex)[0]
        over = np.where(end == 0, at_kink < 0.0, at_kink > 0.0)
        stays, leaves = ~over, over
        xi[at[stays], 0] = self._solved(at[stays], own[stays], end[stays], start[stays])
        # It may have come near the kink at the other end.
        crossed = stays & (self._nearest_end(at, own, xi[at, 0]) != end)
        again = at[crossed]
        xi[again, 0] = self._solved(again, own[crossed], 1 - end[crossed], xi[again, 0])
        facet[at[leaves]] = self.search.across[own[leaves], end[leaves]]
        xi[at[leaves], 0] = 1.0 - vertex[leaves]
        return at[leaves]

    def _solved(self, at: Ints, facet: Ints, end: Ints, xi: Floats) -> Floats:
        out = xi.copy()
        for _ in range(_ITERATIONS):
            value, slope = self.residual(at, facet, end, out)
            change = np.where(slope < 0.0, -value / np.where(slope < 0.0, slope, -1.0), 0.0)
            out = np.clip(out + change, 0.0, 1.0)
            if np.all(np.abs(change) < 1e-14):
                break
        return out

    def _nearest_end(self, at: Ints, facet: Ints, xi: Floats) -> Ints:
        width = self.widths(at, facet)
        end = (xi > 0.5).astype(np.int64)
        rows = np.arange(len(at))
        other = width[rows, end] == 0.0
        out: Ints = np.where(other, 1 - end, end)
        return out

    def kinks(self, at: Ints, facet: Ints, xi: Floats) -> Kinks:
        """The points of ``at`` that are within a zone where they ended."""
        at = self.near(at, facet, xi)
        own = facet[at]
        end = self._nearest_end(at, own, xi[at])
        share, slope = self.share(at, own, end, xi[at])
        beside = self.search.across[own, end]
        there: Floats = (1.0 - end)[:, None].astype(np.float64)
        derivative = self.search.shape.first(there)[:, 0]
        tangent = np.einsum("pa,pai->pi", derivative, self.controls[beside])
        return Kinks(at, beside, there, tangent, share, slope)


def turned(tau: Floats, normal: Floats, change: Floats) -> Floats:
    """Change (p, i) of unit normals to tangents τ (p, i) that change by ``change`` (p, i)."""
    along = np.einsum("pi,pi->p", normal, change) / np.einsum("pi,pi->p", tau, tau)
    out: Floats = -along[:, None] * tau
    return out


def _right(m: Floats, v: Floats) -> Floats:
    """Component of v (p, i) to the right of m (p, i), times |m|."""
    out: Floats = m[:, 1] * v[:, 0] - m[:, 0] * v[:, 1]
    return out
