"""Projection of slave points along normals of the slave, for masters with kinks in the plane.

Axis letters: q slave points, f facets, m nodes of a facet, e ends of a facet, i space.

The normal of the closest point jumps where two facets of the master meet at an angle. While it is
small, as on a round tool made of facets, nothing comes of it. At real kinks there may be no
equilibrium on either side of the jump. On a master with such kinks all points are therefore
projected along the normals n of the slave (:mod:`tribox.geometry.surfaces.slave_points`), which
turn only as the slave itself does: with t = n turned to the right,

    t·(x − ȳ(ξ)) = 0,   g = n·(x − ȳ).

On a smooth or flat master the closest points are better: where the slave bends, at its ends above
all, its normals turn the pressure by as much.
"""

from __future__ import annotations

import numpy as np

from tribox.geometry.surfaces.facets import Bools, FacetShape, Floats, Ints, Longs, unit_normals

KINK = np.radians(3.0)  # angle between undeformed facets from which on they form a kink
_GRAZING = 0.05  # cosine between a facet and t below which a ray only grazes it
_HOPS = 50  # facets that a ray's hit may be away from the closest point
_MET = 1e-9  # ξ that a hit may be off
_ITERATIONS = 12  # of Newton's method along a curved facet; three or four are usual


class RaySearch:
    """Projection along given normals.

    Attributes:
        shape: of the facets; across: (f, e) the facet beyond each end, −1 at the end of all.
        has_kinks: whether undeformed facets meet at an angle.
    """

    def __init__(self, shape: FacetShape, facets: Ints, controls: Floats) -> None:
        """Find the neighbours and the kinks.

        Args:
            shape: of the facets.
            facets: (f, a) their nodes; the first two are their ends.
            controls: (f, m, i), m, undeformed.
        """
        self.shape = shape
        # Facet (f, e) beyond each end of each segment (f, e), −1 at the ends of the surface.
        ends = facets[:, :2]
        count = int(ends.max(initial=-1)) + 1
        starting = np.full(count, -1, dtype=np.int32)
        ending = starting.copy()
        starting[ends[:, 0]] = ending[ends[:, 1]] = np.arange(len(ends), dtype=np.int32)
        self.across = np.stack([ending[ends[:, 0]], starting[ends[:, 1]]], axis=1)
        at_ends = shape.first(np.array([[0.0], [1.0]]))
        here = unit_normals(np.einsum("eba,fai->febi", at_ends, controls))
        there = here[self.across, np.array([1, 0])]
        cosine = np.einsum("fei,fei->fe", here, there)
        self.has_kinks = bool(np.any((cosine < np.cos(KINK)) & (self.across >= 0)))

    def hits(
        self, points: Floats, normals: Floats, controls: Floats, facet: Ints, xi: Floats
    ) -> tuple[Ints, Floats, Bools]:
        """Where the rays through the points meet the surface, from a place nearby.

        Args:
            points: (q, i), m, current.
            normals: (q, i), of the points.
            controls: (f, m, i), m, current.
            facet: (q,) where to begin, for example the closest points.
            xi: (q, 1), likewise.

        Returns:
            Facets (q,), ξ (q, 1), and whether the ray meets the surface (q,).
        """
        facet, xi = facet.copy(), xi.copy()
        moving: Longs = np.arange(len(points))
        met = np.zeros(len(points), dtype=bool)
        for _ in range(_HOPS):
            if not len(moving):
                break
            moving = self._move(points, normals, controls, moving, (facet, xi, met))
        return facet, xi, met

    def _move(
        self,
        points: Floats,
        normals: Floats,
        controls: Floats,
        at: Longs,
        found: tuple[Ints, Floats, Bools],
    ) -> Longs:
        """Look on the facets of the points ``at`` (p,); returns those that belong to the next."""
        facet, xi, met = found
        own = facet[at]
        mine, n = controls[own], normals[at]
        along = np.stack([n[:, 1], -n[:, 0]], axis=1)
        ends = np.einsum("pi,pei->pe", along, points[at][:, None] - mine[:, :2])
        low, high = ends[:, 0] < 0.0, ends[:, 1] > 0.0
        beyond = np.where(high, self.across[own, 1], self.across[own, 0])
        leaves = low ^ high
        stays = ~leaves
        here = at[stays]
        xi[here], met[here] = self._solved(points[here], along[stays], mine[stays], xi[here])
        passes = leaves & (beyond >= 0)
        facet[at[passes]] = beyond[passes]
        xi[at[leaves], 0] = np.where(high == passes, 0.0, 1.0)[leaves]
        return at[passes]

    def _solved(
        self, points: Floats, along: Floats, controls: Floats, xi: Floats
    ) -> tuple[Floats, Bools]:
        """ξ (p, 1) of the rays on their facets, and whether they do not only graze them (p,)."""
        out, met = xi[:, 0].copy(), np.zeros(len(xi), dtype=bool)
        for _ in range(_ITERATIONS):
            place = out[:, None]
            tau = np.einsum("pba,pai->pbi", self.shape.first(place), controls)[:, 0]
            apart = points - np.einsum("pa,pai->pi", self.shape.values(place), controls)
            slope = np.einsum("pi,pi->p", along, tau)
            steep = slope > _GRAZING * np.linalg.norm(tau, axis=1)
            step = np.einsum("pi,pi->p", along, apart) / np.where(steep, slope, np.inf)
            met = steep & (np.abs(step) < _MET)
            if np.max(np.abs(step), initial=0.0) < 1e-15:
                break
            out = np.clip(out + step, 0.0, 1.0)
        return out[:, None], met
