"""Closest points on single facets: the stationary point inside, or the closest on a side.

Axis letters: p pairs of a point and a facet, a nodes of the facet, i space, α surface directions.
Inside a facet the distance to x is stationary where τ_α·(x − ȳ(ξ)) = 0. Where that has no solution
in the reference domain, the closest point lies on one of the sides, which are facets of one
dimension less, and so on down to the corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tribox.geometry.surfaces.facets import Bools, FacetShape, Floats, Ints, Side

INTERIOR = -1  # entity of a closest point inside a facet; sides count from 0
CORNER = 8  # entity of a corner: this plus its number
SEAM = 1e-11  # reference distance past a seam up to which a point belongs to the facet itself
_STEPS = 40
_LAST = 1e-9  # step in ξ, where the Hessian is positive definite, after which nothing is left


@dataclass(slots=True)
class Closest:
    """Closest points of p pairs.

    Attributes:
        xi: (p, α) reference coordinates on the facet.
        squared: (p,), m², squared distance.
        entity: (p,) INTERIOR, the number of the side, or CORNER plus that of the corner.
    """

    xi: Floats
    squared: Floats
    entity: Ints


def closest_points(shape: FacetShape, nodes: Floats, points: Floats) -> Closest:
    """Closest point of each facet to its point.

    Args:
        shape: of all facets.
        nodes: (p, a, i), m: nodes of the facets.
        points: (p, i), m.
    """
    if shape.count == 2:
        return _on_segment(nodes, points)
    xi, found = stationary_points(shape, nodes, points)
    found &= shape.excess(xi) <= SEAM
    out = Closest(xi, np.empty(len(xi)), np.full(len(xi), INTERIOR, dtype=np.int32))
    apart = points - np.einsum("pa,pai->pi", shape.values(xi), nodes)
    out.squared[:] = np.where(found, np.einsum("pi,pi->p", apart, apart), np.inf)
    rest = np.nonzero(~found)[0]
    for number, side in enumerate(shape.sides):
        there = _on_side(number, side, nodes[rest][:, side.nodes], points[rest])
        nearer = there.squared < out.squared[rest]
        at = rest[nearer]
        for whole, part in (
            (out.xi, there.xi),
            (out.squared, there.squared),
            (out.entity, there.entity),
        ):
            whole[at] = part[nearer]
    return out


def _on_segment(nodes: Floats, points: Floats) -> Closest:
    """Straight segments, in closed form."""
    start = nodes[:, 0]
    tau, apart = nodes[:, 1] - start, points - start
    free = np.einsum("pi,pi->p", apart, tau) / np.einsum("pi,pi->p", tau, tau)
    xi = np.clip(free, 0.0, 1.0)
    apart = apart - xi[:, None] * tau
    entity = np.where(free < 0.0, CORNER, np.where(free > 1.0, CORNER + 1, INTERIOR))
    return Closest(xi[:, None], np.einsum("pi,pi->p", apart, apart), entity.astype(np.int32))


def _on_side(number: int, side: Side, nodes: Floats, points: Floats) -> Closest:
    """Closest points on one side, in the coordinates of the facet."""
    if side.shape is None:
        apart = points - nodes[:, 0]
        count = len(points)
        return Closest(
            np.broadcast_to(side.origin, (count, len(side.origin))),
            np.einsum("pi,pi->p", apart, apart),
            np.full(count, CORNER + side.nodes[0], dtype=np.int32),
        )
    along = closest_points(side.shape, nodes, points)
    ends = np.array([CORNER + side.nodes[0], CORNER + side.nodes[1]], dtype=np.int32)
    corner = along.entity >= CORNER
    entity = np.where(corner, ends[np.where(corner, along.entity - CORNER, 0)], number)
    return Closest(side.origin + along.xi * side.direction, along.squared, entity.astype(np.int32))


def stationary_points(shape: FacetShape, nodes: Floats, points: Floats) -> tuple[Floats, Bools]:
    """Coordinates (p, α) where the distance is least inside or near the domain, and whether found.

    That of a flat facet may be anywhere in its plane.

    Newton's method for min ½ |x − ȳ(ξ)|² from the nearest of some samples, with the Gauss–Newton
    matrix where the Hessian is not positive definite, and halved steps where the distance grows.
    """
    xi = _nearest_sample(shape, nodes, points)
    if shape.is_flat:
        return xi + _newton_step(shape, nodes, points, xi)[0], np.ones(len(points), dtype=bool)
    found = np.zeros(len(points), dtype=bool)
    active = np.arange(len(points))
    for _ in range(_STEPS):
        at, y, x = xi[active], nodes[active], points[active]
        step, convex = _newton_step(shape, y, x, at)
        size = np.abs(step).max(axis=1)
        last = (size < _LAST) & convex
        # The last step is taken whole: whether the distance grows by it is rounding alone.
        rows = np.nonzero(~last)[0]
        step[rows] = _halved(shape, y[rows], x[rows], at[rows], step[rows])
        new = at + step
        xi[active] = new
        done = (size < 1e-13) | last
        found[active] = done & convex
        # Far outside the domain: the closest point is on a side.
        active = active[~done & (shape.excess(new) < 0.3) & np.any(new != at, axis=1)]
        if not len(active):
            break
    return xi, found


def _nearest_sample(shape: FacetShape, nodes: Floats, points: Floats) -> Floats:
    """Reference coordinates (p, α) of the nearest of a lattice of samples; the middle of a flat."""
    lattice = samples(shape)
    if shape.is_flat:
        return np.repeat(lattice, len(points), axis=0)
    places = np.einsum("sa,pai->psi", shape.values(lattice), nodes, optimize=True)
    apart = points[:, None] - places
    return lattice[np.argmin(np.einsum("psi,psi->ps", apart, apart), axis=1)].copy()


@lru_cache
def samples(shape: FacetShape) -> Floats:
    """Samples (s, α) to begin at, two intervals along each side, four on shapes of higher degree.

    The middle of a flat facet, where one step leads to the stationary point.
    """
    if shape.is_flat:
        return shape.points[: shape.corners].mean(axis=0)[None]
    steps = np.linspace(0.0, 1.0, min(2 * shape.degree, 4) + 1)
    grid = np.stack(np.meshgrid(*[steps] * shape.directions), axis=-1)
    xi = grid.reshape(-1, shape.directions)
    inside: Floats = xi[shape.excess(xi) <= SEAM]
    return inside


def _newton_step(
    shape: FacetShape, nodes: Floats, points: Floats, xi: Floats
) -> tuple[Floats, Bools]:
    """Newton step (p, α) at ``xi``, and where the Hessian is positive definite."""
    apart = points - np.einsum("pa,pai->pi", shape.values(xi), nodes)
    tau = np.einsum("pba,pai->pbi", shape.first(xi), nodes)
    slope = np.einsum("pbi,pi->pb", tau, apart)
    metric = np.einsum("pbi,pci->pbc", tau, tau)
    if shape.is_flat:
        return solve_small(metric, slope), np.ones(len(points), dtype=bool)
    bend = np.einsum("pbca,pai->pbci", shape.second(xi), nodes)
    hessian = metric - np.einsum("pbci,pi->pbc", bend, apart)
    convex = np.all(np.diagonal(hessian, axis1=1, axis2=2) > 0.0, axis=1)
    if shape.directions == 2:
        convex &= _determinant(hessian) > 1e-8 * _determinant(metric)
    matrix = np.where(convex[:, None, None], hessian, metric)
    return solve_small(matrix, slope), convex


def _halved(shape: FacetShape, nodes: Floats, points: Floats, xi: Floats, step: Floats) -> Floats:
    """Steps (p, α) shortened until the distance no longer grows."""

    def squared(at: Floats, rows: Ints | slice) -> Floats:
        apart = points[rows] - np.einsum("pa,pai->pi", shape.values(at), nodes[rows])
        out: Floats = np.einsum("pi,pi->p", apart, apart)
        return out

    taken = step.copy()
    start = squared(xi, slice(None)) * (1.0 + 1e-12)
    rows: Ints = np.arange(len(xi), dtype=np.int32)
    for _ in range(12):
        rows = rows[squared(xi[rows] + taken[rows], rows) > start[rows]]
        if not len(rows):
            break
        taken[rows] *= 0.5
    return taken


def solve_small(matrix: Floats, right: Floats) -> Floats:
    """Solutions (p, α) of p systems of one or two equations, (p, α, α) and (p, α)."""
    if matrix.shape[-1] == 1:
        out: Floats = right / matrix[..., 0]
        return out
    a, b, c, d = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1]
    over = 1.0 / _determinant(matrix)
    first = (d * right[:, 0] - b * right[:, 1]) * over
    return np.stack([first, (a * right[:, 1] - c * right[:, 0]) * over], axis=1)


def _determinant(matrix: Floats) -> Floats:
    """Determinants (p,) of matrices (p, 2, 2)."""
    out: Floats = matrix[:, 0, 0] * matrix[:, 1, 1] - matrix[:, 0, 1] * matrix[:, 1, 0]
    return out
