"""Closest-point projection of points onto a polyline of straight master segments.

Notation (axis letters): q slave points, f master facets, n master nodes, a nodes of a facet, i, j
space, α, β surface directions (one in the plane). A segment with nodes y₀, y₁ is parametrised by
ȳ(ξ) = (1 − ξ) y₀ + ξ y₁, 0 ≤ ξ ≤ 1, its tangent τ = y₁ − y₀ and its outward normal is τ turned
left by 90°: nodes are ordered so that the body lies to the right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]


@dataclass(slots=True)
class Projection:
    """The closest master point of every slave point.

    Attributes:
        facet: (q,) master facet that carries the closest point.
        xi: (q, α) its parent coordinates, in [0, 1].
        foot: (q, i), m, current: the closest point ȳ.
        normal: (q, i) unit outward normal of the master at ȳ; from ȳ to x where clamped.
        tangents: (q, α, i), m, current: τ_α = ∂ȳ/∂ξ^α.
        gap: (q,), m: g = (x − ȳ)·n, negative in penetration.
        clamped: (q,) the closest point is a vertex: it does not move when x does.
        on_surface: (q,) False past the end of the master, where there is no contact.
    """

    facet: Ints
    xi: Floats
    foot: Floats
    normal: Floats
    tangents: Floats
    gap: Floats
    clamped: Bools
    on_surface: Bools


def segment_shape(xi: Floats) -> Floats:
    """Shape functions (…, a) of a straight segment at the parent coordinates ``xi`` (…, 1)."""
    return np.concatenate([1.0 - xi, xi], axis=-1)


def segment_shape_derivative(xi: Floats) -> Floats:
    """Derivatives (…, α, a) of :func:`segment_shape` at the coordinates ``xi`` (…, 1)."""
    out = np.empty((*xi.shape, 2))
    out[..., 0] = -1.0
    out[..., 1] = 1.0
    return out


class Polyline:
    """Master segments, their neighbours, and the search for the closest point on them."""

    def __init__(self, facets: Ints, nodes: Floats) -> None:
        """Prepare the connectivity.

        ``chain`` (f,) is the position of each facet along its chain of neighbours, ``at_position``
        the inverse.

        Args:
            facets: (f, 2) node numbers, ordered so that the body lies to the right.
            nodes: (n, i), m: node positions, reference.
        """
        self.facets = facets
        n = len(nodes)
        # The facet that ends and the one that starts at each node; −1 at the ends of a chain.
        self.previous = np.full(n, -1, dtype=np.int32)
        self.next = np.full(n, -1, dtype=np.int32)
        order = np.arange(len(facets), dtype=np.int32)
        self.previous[facets[:, 1]] = order
        self.next[facets[:, 0]] = order
        self.chain, self.at_position = _chain_order(facets, self.previous, self.next)
        length = np.linalg.norm(nodes[facets[:, 1]] - nodes[facets[:, 0]], axis=1)
        # Long facets carry several samples, so that the nearest sample lies on the right facet or
        # beside it however the sizes vary along the surface.
        samples = np.clip(np.ceil(length / np.median(length)), 1, 50).astype(np.int32) * 2
        self._sample_facet = np.repeat(order, samples)
        first = np.repeat(np.cumsum(samples) - samples, samples)
        at = (np.arange(len(first)) - first + 0.5) / np.repeat(samples, samples)
        self._sample_shape = segment_shape(at[:, None])

    def candidates(self, points: Floats, nodes: Floats, count: int = 6) -> Ints:
        """Facets (q, k) that can hold the closest point of each of ``points`` (q, i)."""
        where = np.einsum("sa,sai->si", self._sample_shape, nodes[self.facets[self._sample_facet]])
        count = min(count, len(where))
        _, sample = cKDTree(where).query(points, k=count)
        near = self._sample_facet[np.asarray(sample).reshape(len(points), count)]
        # The neighbours of the nearest two close the gap between sampling and geometry.
        ends = self.facets[near[:, :2]].reshape(len(points), 2 * min(2, count))
        around = np.concatenate([self.previous[ends], self.next[ends]], axis=1)
        around = np.where(around < 0, near[:, :1], around)
        return np.concatenate([near, around], axis=1)

    def project(self, points: Floats, nodes: Floats, candidates: Ints) -> Projection:
        """Closest points among the given candidate facets.

        Args:
            points: (q, i), m, current: slave points.
            nodes: (n, i), m, current: master nodes.
            candidates: (q, k) facets to choose from.
        """
        start = nodes[self.facets[candidates, 0]]
        tau = nodes[self.facets[candidates, 1]] - start
        free = np.einsum("qki,qki->qk", points[:, None] - start, tau)
        free /= np.einsum("qki,qki->qk", tau, tau)
        xi = np.clip(free, 0.0, 1.0)
        apart = points[:, None] - start - xi[..., None] * tau
        best = np.argmin(np.einsum("qki,qki->qk", apart, apart), axis=1)
        row = np.arange(len(points))
        return self._at(points, nodes, candidates[row, best], free[row, best])

    def _at(self, points: Floats, nodes: Floats, facet: Ints, free: Floats) -> Projection:
        """Geometry at the closest points on the chosen facets, ``free`` the unclamped ξ (q,)."""
        ends = nodes[self.facets[facet]]
        tau = ends[:, 1] - ends[:, 0]
        xi = np.clip(free, 0.0, 1.0)
        foot = ends[:, 0] + xi[:, None] * tau
        normal = facet_normal(tau)
        clamped = (free < 0.0) | (free > 1.0)
        on_surface = np.ones(len(points), dtype=bool)
        gap = np.einsum("qi,qi->q", points - foot, normal)
        if clamped.any():
            at = np.nonzero(clamped)[0]
            vertex = self.facets[facet[at], (free[at] > 1.0).astype(int)]
            before, after = self.previous[vertex], self.next[vertex]
            on_surface[at] = (before >= 0) & (after >= 0)
            # Outward direction of the vertex: the mean of the normals of its two facets.
            outward = np.zeros((len(at), normal.shape[1]))
            for other in (before, after):
                there = nodes[self.facets[np.maximum(other, 0)]]
                outward += np.where(
                    (other >= 0)[:, None], facet_normal(there[:, 1] - there[:, 0]), 0.0
                )
            outward /= np.linalg.norm(outward, axis=1)[:, None]
            apart = points[at] - foot[at]
            distance = np.linalg.norm(apart, axis=1)
            sign = np.where(np.einsum("qi,qi->q", apart, outward) < 0.0, -1.0, 1.0)
            tiny = distance <= 1e-12 * np.linalg.norm(tau[at], axis=1)
            safe = np.where(tiny, 1.0, distance)[:, None]
            normal[at] = np.where(tiny[:, None], outward, sign[:, None] * apart / safe)
            gap[at] = sign * distance
        return Projection(
            facet=facet.astype(np.int32),
            xi=xi[:, None],
            foot=foot,
            normal=normal,
            tangents=tau[:, None, :],
            gap=gap,
            clamped=clamped,
            on_surface=on_surface,
        )


def _chain_order(facets: Ints, previous: Ints, after: Ints) -> tuple[Ints, Ints]:
    """Position of each facet along its chain, and the facet at each position; at set-up."""
    position = np.full(len(facets), -1, dtype=np.int32)
    starts = np.nonzero(previous[facets[:, 0]] < 0)[0]
    count = 0
    for first in (*starts, *range(len(facets))):  # the second part only for closed chains
        here = int(first)
        while here >= 0 and position[here] < 0:
            position[here] = count
            count += 1
            here = int(after[facets[here, 1]])
    return position, np.argsort(position).astype(np.int32)


def facet_normal(tau: Floats) -> Floats:
    """Unit normals (q, i) of segments with tangents ``tau`` (q, i): turned left by 90°."""
    turned = np.stack([-tau[:, 1], tau[:, 0]], axis=1)
    unit: Floats = turned / np.linalg.norm(turned, axis=1)[:, None]
    return unit
