"""Where a surface of facets ends, and how little of a contact counts there.

A point that loses its force at once when it runs past an end may leave no equilibrium: it fades
before that, or passes over to another surface that begins there. A plane of symmetry is no end: the
surface goes on as its image.

Axis letters: n nodes, f facets, v corners, q places, i space, α surface directions. Distances are
those of the undeformed surface: in the plane along it, in space straight to the nearest open
edge, both linear between the corners of a facet.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.facets import Bools, FacetShape, Floats, Ints, facet_shape
from tribox.geometry.surfaces.target import Projection, fade_at_ends


class SurfaceEnds:
    """Open ends of a surface, and what of the points beside them counts.

    Attributes:
        is_open: (n,) nodes at open ends; joined: (n,) those, in the plane, at which another surface
            begins.
        fade_length: m, way before an open end over which points fade; None: as each point asks.
        length: (f,), m, undeformed, of facets in the plane; empty in space.
        planes: of symmetry, each with the nodes (n,) on it.
        distance: of the corners from the open ends, where points fade over ``fade_length``.
    """

    def __init__(
        self,
        shape: FacetShape,
        facets: Ints,
        nodes: Floats,
        is_open: Bools,
        fade_length: float | None,
        planes: Sequence[tuple[int, Bools]] = (),
        known: Floats | None = None,
    ) -> None:
        """Measure the ends; ValueError if no part of the surface would count in full.

        ``shape``: of facets (f, a) of the first degree, corners first; ``nodes``: (n, i), m,
        undeformed; ``is_open``: (n,) nodes at open ends; ``planes`` of symmetry, each with the
        nodes (n,) on it; ``known``: (f, v), m, distances of the corners from the ends of a whole
        that is not at hand.
        """
        self._shape, self._corners, self._nodes = shape, facets[:, : shape.corners], nodes
        self.is_open, self.joined = is_open, np.zeros_like(is_open)
        self.fade_length, self.planes = fade_length, planes
        self.length: Floats = np.zeros(0)
        if shape.directions == 1:
            ends = nodes[facets[:, :2]]
            self.length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        self.distance: EndDistance | None = None
        if known is not None and fade_length is not None:
            self.distance = EndDistance(shape, fade_length, known)
        else:
            self._measure()

    def _measure(self) -> None:
        if self.fade_length is not None:
            fading, given = self.is_open & ~self.joined, (self.fade_length, self.planes)
            self.distance = EndDistance.measured(
                self._shape, self._corners, self._nodes, fading, *given
            )

    def join(self, others: Floats, within: float) -> None:
        """Let nothing fade at open ends, in the plane, ``within`` m of another surface's.

        ``others``: (m, i), m, its undeformed nodes.
        """
        if self._shape.directions == 2:
            return
        ends = np.nonzero(self.is_open & ~self.joined)[0]
        apart = np.linalg.norm(self._nodes[ends][:, None] - others, axis=2)
        self.joined[ends[apart.min(axis=1) <= within]] = True
        self._measure()

    def fade(self, out: Projection, reach: Floats) -> None:
        """Let points fade over the last way ``reach`` (q,), m, up to the end of the surface."""
        if self.distance is not None:
            out.share, out.share_slope = self.distance.share(out.facet, out.xi)
        elif self._shape.directions == 1:
            self._fade_at_once(out, reach)
        if self.joined.any():
            self._pass_over(out, reach)

    def _fade_at_once(self, out: Projection, reach: Floats) -> None:
        fading = (self.is_open & ~self.joined)[self._corners[out.facet, :2]]
        at = np.nonzero(fading.any(axis=1) & out.on_surface)[0]
        if not len(at):
            return
        out.share, out.share_slope = np.ones(len(reach)), np.zeros((len(reach), 1))
        out.share[at], out.share_slope[at, 0] = fade_at_ends(
            fading[at], out.xi[at, 0], self.length[out.facet[at]], reach[at]
        )

    def _pass_over(self, out: Projection, reach: Floats) -> None:
        """Let points pass from one surface to the next, over twice ``reach`` (q,), m."""
        ends = self.joined[self._corners[out.facet, :2]]
        at = np.nonzero(ends.any(axis=1) & out.on_surface)[0]
        length, xi = self.length[out.facet[at]], out.xi[at, 0]
        # ½ at the end itself, where both surfaces have the same point: the shares of both add up to
        # 1 over ± reach.
        per_length = 0.5 * length / np.minimum(reach[at], length)
        inside = np.stack([xi, 1.0 - xi], axis=1) * per_length[:, None] + 0.5
        inside = np.where(ends[at], inside, np.inf)
        end = np.argmin(inside, axis=1)
        share = np.clip(inside[np.arange(len(at)), end], 0.0, 1.0)
        slope = np.where(end == 0, 1.0, -1.0) * per_length * ((share > 0.0) & (share < 1.0))
        if out.share is None or out.share_slope is None:
            out.share, out.share_slope = np.ones(len(reach)), np.zeros((len(reach), 1))
        # Product rule: a point may fade at an end and pass over to a neighbour at another.
        out.share_slope[at] *= share[:, None]
        out.share_slope[at, 0] += out.share[at] * slope
        out.share[at] *= share


class EndDistance:
    """Distances of the corners from the open end of a surface.

    Attributes:
        length: m, way over which a contact fades; corners: (f, v), m, distances of the corners.
    """

    def __init__(self, shape: FacetShape, length: float, corners: Floats) -> None:
        """Take the distances; ``shape`` is that of facets of the first degree."""
        self.length, self.corners, self._shape = length, corners, shape

    @classmethod
    def measured(
        cls,
        shape: FacetShape,
        facets: Ints,
        nodes: Floats,
        is_open: Bools,
        length: float,
        planes: Sequence[tuple[int, Bools]] = (),
    ) -> EndDistance:
        """Measure them; ValueError if no part of the surface would count in full.

        ``facets``: (f, a), corners first; ``nodes``: (n, i), m, undeformed; ``is_open``: (n,),
        corners at open ends; ``length``: m, of fading; ``planes`` of symmetry, with the nodes (n,)
        on each.
        """
        corners = facets[:, : shape.corners]
        distance: Floats
        if not is_open.any():
            distance = np.full(len(nodes), np.inf)
        elif shape.directions == 1:
            distance = _along(corners, nodes, is_open)
        else:
            distance = _to_edges(_open_edges(shape, corners, planes), nodes)
        largest = float(distance[corners].max())
        if largest < length:
            raise ValueError(
                f"fade_length = {length:g} m: no part of the master is so far from its ends "
                f"({largest:.3g} m at most)"
            )
        far = 1e3 * length  # without an open end all counts
        found: Floats = np.where(np.isfinite(distance), distance, far)[corners]
        return cls(facet_shape(shape.cell, 1), length, found)

    def share(self, facet: Ints, xi: Floats) -> tuple[Floats, Floats]:
        """How much counts (q,) at places ξ (q, α) of facets (q,), and its derivatives (q, α) for ξ.

        s² (3 − 2 s) of s = d/L at the distance d from the end, 1 from L on.
        """
        mine = self.corners[facet]
        s = np.einsum("qv,qv->q", self._shape.values(xi), mine) / self.length
        slope = np.einsum("qav,qv->qa", self._shape.first(xi), mine) / self.length
        s = np.clip(s, 0.0, 1.0)
        return s * s * (3.0 - 2.0 * s), (6.0 * s * (1.0 - s))[:, None] * slope


def _along(corners: Ints, nodes: Floats, is_open: Bools) -> Floats:
    """Way (n,), m, along segments to the nearest open end."""
    from scipy.sparse.csgraph import dijkstra

    length = np.linalg.norm(nodes[corners[:, 1]] - nodes[corners[:, 0]], axis=1)
    size = (len(nodes), len(nodes))
    graph = scipy.sparse.csr_matrix((length, (corners[:, 0], corners[:, 1])), shape=size)
    return dijkstra(graph, directed=False, indices=np.nonzero(is_open)[0], min_only=True)


def _open_edges(shape: FacetShape, corners: Ints, planes: Sequence[tuple[int, Bools]]) -> Ints:
    """Corners (e, 2) of the edges that one facet alone has, but for those on planes of symmetry."""
    edges = np.concatenate([corners[:, side.nodes[:2]] for side in shape.sides])
    _, first, count = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    out: Ints = edges[first[count == 1]]
    for _, on in planes:
        out = out[~on[out].all(axis=1)]
    return out


def _to_edges(edges: Ints, nodes: Floats) -> Floats:
    """Distance (n,), m, of nodes from the nearest of some edges (e, 2)."""
    start, way = nodes[edges[:, 0]], nodes[edges[:, 1]] - nodes[edges[:, 0]]
    squared = np.einsum("ei,ei->e", way, way)
    out = np.empty(len(nodes))
    # A million pairs at once, for memory's sake.
    for rows in np.array_split(np.arange(len(nodes)), max(1, len(nodes) * len(edges) // 10**6)):
        apart = nodes[rows][:, None] - start
        along = np.clip(np.einsum("nei,ei->ne", apart, way) / squared, 0.0, 1.0)
        rest = apart - along[..., None] * way
        out[rows] = np.sqrt(np.einsum("nei,nei->ne", rest, rest).min(axis=1))
    return out
