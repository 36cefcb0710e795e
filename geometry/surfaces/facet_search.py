"""The facets that can hold the closest point of each of many points, without missing one.

Axis letters: q points, f facets, n nodes, a nodes of a facet, p pairs of a point and a facet.

A facet lies in a sphere round the mean of its nodes, so its distance from x is at least
|x − centre| − radius. Any known distance is an upper bound for the least, hence every facet whose
lower bound lies below it is examined, and no other can be the closest. Spheres are kept in k-d
trees by size, so that one long facet does not make all spheres large.

The pairs found stay valid while points and nodes move: if the distances of the facets that are left
out exceed the least one by a slack s, a motion by less than s/2 cannot make one of them the
closest.

Far away, a great many facets are almost equally near. In space, points many facets away are
therefore paired with the facet with the nearest centre only: their distance is a little too large,
by r²/(2 d) at most at the distance d from facets of radius r.
"""

from __future__ import annotations

from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from tribox.geometry.surfaces.compiled_facets import Candidates, CompiledFacets
from tribox.geometry.surfaces.facets import Bools, FacetShape, Floats, Ints, Longs, unit_normals

SLACK = {1: 1.0, 2: 0.5}  # over a typical facet's diameter, by the number of surface directions
TIE = 1e-12  # distances closer than this, over the slack, are equal
FAR = 8.0  # distance over the slack from which a point in space is given one facet only
_RATIO = 4.0  # of sphere radii within one tree


class FacetSearch:
    """Pairs of points and facets among which the closest are, kept while little moves."""

    def __init__(
        self,
        shape: FacetShape,
        facets: Floats,
        code: CompiledFacets | None = None,
        number: Longs | None = None,
        slack: float | None = None,
    ) -> None:
        """Store a typical size of facets (f, a, i), m, undeformed; ``code``: what knows them.

        ``number``: (f,) by which equals are ordered, None: theirs; ``slack``: m, of the whole
        surface.
        """
        self.shape, self._code = shape, code or CompiledFacets(shape, len(facets))
        self._number = np.arange(len(facets)) if number is None else number
        if slack is None:
            radius = self._spheres(facets)[1]
            slack = SLACK[shape.directions] * 2.0 * float(np.median(radius))
        self.slack = slack
        self.searches = 0
        self._points: Floats | None = None
        self._facets = facets
        self._far: Ints = np.empty(0, dtype=np.int32)

    def candidates(self, points: Floats, facets: Floats) -> Candidates:
        """Facets that may hold the closest points, by point; every point has at least one.

        Args:
            points: (q, i), m, current.
            facets: (f, a, i), m, current.
        """
        motion = self._motion(points, facets)
        if not motion < 0.5 * self.slack:
            self.search(points, facets)
            motion = 0.0
        alone = None
        if len(self._far):
            alone = np.full(len(points), -1, dtype=np.int32)
            alone[self._far] = self._of_nearest_centre(points[self._far], facets)
        # A facet further than the closest by more than twice the motion since is not closest yet.
        limit = 2.0 * motion + TIE * self.slack
        return Candidates(self._start, self._facet, self._excess, limit, alone)

    @property
    def searched_at(self) -> tuple[Floats, Floats] | None:
        """Points (q, i) and facets (f, a, i), m, of the last search; None before it."""
        return None if self._points is None else (self._points, self._facets)

    def search(self, points: Floats, facets: Floats) -> None:
        """Find the candidates anew, at these places."""
        point, self._facet, self._excess = self._search(points, facets)
        self._start: Longs = np.searchsorted(point, np.arange(len(points) + 1))
        self._points, self._facets = points.copy(), facets.copy()
        self.searches += 1

    def table(self, points: Floats, facets: Floats) -> tuple[Ints, float]:
        """Candidates (q, k) of a new search, and how far, m, points and nodes together may move.

        Of points (q, i) and nodes (f, a, i), m, current; rows repeat their first, or hold −1 where
        the facet of the nearest centre will do.
        """
        far = self._far  # of the search that `candidates` goes on from
        point, facet, _ = self._search(points, facets)
        self._far = far
        self.searches += 1
        start = np.searchsorted(point, np.arange(len(points)))
        count = np.bincount(point, minlength=len(points))
        column = np.arange(int(count.max(initial=1)))
        at = start[:, None] + np.where(column < count[:, None], column, 0)
        found = np.append(facet, np.int32(-1))[at]
        found[count == 0] = -1
        return found, 0.5 * self.slack

    def _motion(self, points: Floats, facets: Floats) -> float:
        """Bound, m, on the change of any distance since the last search; common shifts are free."""
        if self._points is None or self._points.shape != points.shape:
            return np.inf
        if not len(points):
            return 0.0
        facets_moved, points_moved = facets - self._facets, points - self._points
        common = facets_moved.mean(axis=(0, 1))
        # |Σ_a N_a δ_a| ≤ Σ_a |N_a| max |δ_a|: shape functions of higher degree are negative
        # somewhere.
        moved = self.shape.lebesgue * _longest(facets_moved - common)
        return moved + _longest(points_moved - common)

    def _spheres(self, facets: Floats) -> tuple[Floats, Floats]:
        """Centres (f, i) and radii (f,) of spheres that hold the facets."""
        centre = facets.mean(axis=1)
        reach = np.linalg.norm(facets - centre[:, None], axis=2).max(axis=1)
        return centre, self.shape.lebesgue * reach

    def _search(self, points: Floats, facets: Floats) -> tuple[Ints, Ints, Floats]:
        """Pairs, sorted by point, and (p,), m, bounds of what each exceeds the least by."""
        if not len(points):
            return np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32), np.empty(0)
        trees = self._trees(facets)
        centre, radius = self._spheres(facets)
        _, least = self._nearest(points, facets, trees)
        far = (least > FAR * self.slack) & (self.shape.directions == 2)
        self._far, close = _where(far), _where(~far)
        # A centre farther off than that belongs to a sphere that begins beyond the least distance
        # and the slack. One radius per tree; the facets' own ones sort out the rest below.
        reach = least[close] + self.slack
        found = [_inside(tree, at, points[close], reach + radius[at].max()) for tree, at in trees]
        point, facet = (np.concatenate(parts) for parts in zip(*found, strict=True))
        point = close[point]
        bound = np.linalg.norm(points[point] - centre[facet], axis=1) - radius[facet]
        keep = bound <= least[point] + self.slack
        point, facet = point[keep], facet[keep]
        order = np.lexsort((self._number[facet], point))
        point, facet = point[order], facet[order]
        start = np.searchsorted(point, np.arange(len(points) + 1))
        # Spheres are coarse round long facets: bounds by the hulls of their control points are
        # sharper.
        excess = self._code.beyond(points, facets, start, facet)
        keep = np.nonzero(excess <= self.slack)[0]
        return point[keep], facet[keep], excess[keep]

    def _trees(self, facets: Floats) -> list[tuple[cKDTree, Ints]]:
        """k-d trees of the centres of facets of about one size, and which facets these are."""
        centre, radius = self._spheres(facets)
        size = np.floor(np.log(radius / radius.max()) / np.log(_RATIO)).astype(int)
        return [(cKDTree(centre[at]), at) for s in np.unique(size) for at in [_where(size == s)]]

    def _of_nearest_centre(self, points: Floats, facets: Floats) -> Ints:
        """The facets (q,) that points far away are paired with."""
        trees = self._trees(facets)
        if len(trees) > 1:
            return self._nearest(points, facets, trees)[0]
        ((tree, at),) = trees
        return at[tree.query(points)[1]]

    def _nearest(
        self, points: Floats, facets: Floats, trees: list[tuple[cKDTree, Ints]]
    ) -> tuple[Ints, Floats]:
        """Of the facets with the nearest centre of each size the closest, and its distance, m."""
        facet = np.zeros(len(points), dtype=np.int32)
        least = np.full(len(points), np.inf)
        everyone = np.arange(len(points), dtype=np.int32)
        for tree, at in trees:
            candidate = at[tree.query(points)[1]]
            distance = self._code.distances(points, facets, everyone, candidate)
            nearer = distance < least
            facet[nearer], least[nearer] = candidate[nearer], distance[nearer]
        return facet, least


def _where(mask: Bools) -> Ints:
    return np.nonzero(mask)[0].astype(np.int32)


def _longest(vectors: Floats) -> float:
    return float(np.sqrt(np.einsum("...i,...i->...", vectors, vectors).max()))


def _inside(tree: cKDTree, facets: Ints, points: Floats, reach: Floats) -> tuple[Ints, Ints]:
    """Pairs of a point and a facet whose centre is within ``reach`` (q,) of it."""
    lists = tree.query_ball_point(points, reach, return_sorted=False)
    counts = np.fromiter(map(len, lists), dtype=np.int64, count=len(lists))
    flat = np.fromiter(chain.from_iterable(lists), dtype=np.int64, count=int(counts.sum()))
    return np.repeat(np.arange(len(points), dtype=np.int32), counts), facets[flat]


# -- Projection of slave points along normals of the slave, for masters with kinks in the plane ----
#
# Axis letters: q slave points, f facets, m nodes of a facet, e ends of a facet, i space.
#
# The normal of the closest point jumps where two facets of the master meet at an angle. While it is
# small, as on a round tool made of facets, nothing comes of it. At real kinks there may be no
# equilibrium on either side of the jump. On a master with such kinks all points are therefore
# projected along the normals n of the slave (:mod:`tribox.geometry.surfaces.slave_points`), which
# turn only as the slave itself does: with t = n turned to the right,
#
#     t·(x − ȳ(ξ)) = 0,   g = n·(x − ȳ).
#
# On a smooth or flat master the closest points are better: where the slave bends, at its ends above
# all, its normals turn the pressure by as much.


KINK = np.radians(3.0)  # angle between undeformed facets from which on they form a kink
_GRAZING = 0.05  # cosine between a facet and t below which a ray only grazes it
_HOPS = 50  # facets that a ray's hit may be away from the closest point
_MET = 1e-9  # ξ that a hit may be off
_ITERATIONS = 12  # of Newton's method along a curved facet; three or four are usual


class RaySearch:
    """Projection along given normals; ``across``: (f, e) facets beyond ends, −1 at the last.

    ``has_kinks``: whether undeformed facets meet at an angle.
    """

    def __init__(self, shape: FacetShape, facets: Ints, controls: Floats) -> None:
        """Find neighbours and kinks of facets (f, a), ends first, with controls (f, m, i), m."""
        self.shape = shape
        # Facet (f, e) beyond each end of each segment (f, e), −1 at the ends of the surface.
        ends = facets[:, :2]
        count = int(ends.max(initial=-1)) + 1
        # Facet that starts, and facet that ends at each node: a line has one of each at most.
        starting = np.full(count, -1, dtype=np.int32)
        ending = starting.copy()
        starting[ends[:, 0]] = ending[ends[:, 1]] = np.arange(len(ends), dtype=np.int32)
        self.across = np.stack([ending[ends[:, 0]], starting[ends[:, 1]]], axis=1)
        at_ends = shape.first(np.array([[0.0], [1.0]]))
        here = unit_normals(np.einsum("eba,fai->febi", at_ends, controls))
        # Beyond a first end lies the second one of the facet before, and the other way round.
        cosine = np.einsum("fei,fei->fe", here, here[self.across, np.array([1, 0])])
        self.has_kinks = bool(np.any((cosine < np.cos(KINK)) & (self.across >= 0)))

    def hits(
        self, points: Floats, normals: Floats, controls: Floats, facet: Ints, xi: Floats
    ) -> tuple[Ints, Floats, Bools]:
        """Facets (q,), ξ (q, 1), where rays from points (q, i) meet the surface, and whether.

        Along ``normals`` (q, i) with ``controls`` (f, m, i), m, all current, beginning at ``facet``
        (q,) and ``xi`` (q, 1), such as the closest points.
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
        # t·(x − ȳ) falls along a facet that faces the ray: negative at its first end the hit lies
        # before it, positive at its second beyond. Both at once: it faces away, and has no hit.
        low, high = ends[:, 0] < 0.0, ends[:, 1] > 0.0
        beyond = np.where(high, self.across[own, 1], self.across[own, 0])
        leaves = low ^ high
        stays = ~leaves
        here = at[stays]
        xi[here], met[here] = self._solved(points[here], along[stays], mine[stays], xi[here])
        passes = leaves & (beyond >= 0)
        facet[at[passes]] = beyond[passes]
        # On the next facet from its nearer end; at an end of the line, that end.
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
