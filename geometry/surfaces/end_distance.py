"""How far places on a surface are from its open end, and how much of a contact counts there.

Axis letters: n nodes, f facets, v corners, q places, i space, α surface directions. Distances are
those of the undeformed surface: in the plane along it, in space straight to the nearest open edge,
both linear between the corners of a facet.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.facets import Bools, FacetShape, Floats, Ints, facet_shape


class EndDistance:
    """Distances of the corners from the open end of a surface.

    Attributes:
        length: m, way over which a contact fades; corners: (f, v), m, distances of the corners.
    """

    def __init__(
        self, shape: FacetShape, facets: Ints, nodes: Floats, is_open: Bools, length: float
    ) -> None:
        """Measure them.

        Args:
            shape: of the facets.
            facets: (f, a) their nodes; corners come first.
            nodes: (n, i), m, undeformed.
            is_open: (n,) whether a corner lies at an open end.
            length: m, way over which a contact fades.

        Raises:
            ValueError: no part of the surface would count in full.
        """
        corners = facets[:, : shape.corners]
        distance: Floats
        if not is_open.any():
            distance = np.full(len(nodes), np.inf)
        elif shape.directions == 1:
            distance = _along(corners, nodes, is_open)
        else:
            distance = _to_edges(_open_edges(shape, corners), nodes)
        largest = float(distance[corners].max())
        if largest < length:
            raise ValueError(
                f"fade_length = {length:g} m: no part of the master is so far from its ends "
                f"({largest:.3g} m at most)"
            )
        self.length = length
        far = 1e3 * length  # without an open end all counts
        self.corners: Floats = np.where(np.isfinite(distance), distance, far)[corners]
        self._shape = facet_shape(shape.cell, 1)

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
    ends = np.nonzero(is_open)[0]
    out: Floats = dijkstra(graph, directed=False, indices=ends, min_only=True)
    return out


def _open_edges(shape: FacetShape, corners: Ints) -> Ints:
    """Corners (e, 2) of the edges that one facet alone has."""
    edges = np.concatenate([corners[:, side.nodes[:2]] for side in shape.sides])
    _, first, count = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    out: Ints = edges[first[count == 1]]
    return out


def _to_edges(edges: Ints, nodes: Floats) -> Floats:
    """Distance (n,), m, of nodes from the nearest of some edges (e, 2)."""
    start, way = nodes[edges[:, 0]], nodes[edges[:, 1]] - nodes[edges[:, 0]]
    squared = np.einsum("ei,ei->e", way, way)
    out = np.empty(len(nodes))
    for rows in np.array_split(np.arange(len(nodes)), max(1, len(nodes) * len(edges) // 10**6)):
        apart = nodes[rows][:, None] - start
        along = np.clip(np.einsum("nei,ei->ne", apart, way) / squared, 0.0, 1.0)
        rest = apart - along[..., None] * way
        out[rows] = np.sqrt(np.einsum("nei,nei->ne", rest, rest).min(axis=1))
    return out
