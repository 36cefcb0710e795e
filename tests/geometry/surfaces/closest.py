"""Closest points in numpy, written apart from the C source that is compared with it.

Axis letters: p pairs of a point and a facet, a nodes of the facet, i space, α surface directions.
Inside a facet the distance to x is stationary where τ_α·(x − ȳ(ξ)) = 0. Where that has no solution
in the reference domain, the closest point lies on one of the sides, which are facets of one
dimension less, and so on down to the corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.geometry.surfaces.searched import pairs
from tribox.geometry.surfaces.compiled_facets import CORNER, INTERIOR, SEAM, samples
from tribox.geometry.surfaces.facet_search import TIE
from tribox.geometry.surfaces.facets import (
    Bools,
    FacetShape,
    Floats,
    Ints,
    Side,
    solve_small,
    unit_normals,
)
from tribox.geometry.surfaces.projection import OVERRUN, FacetSurface

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
        convex &= np.linalg.det(hessian) > 1e-8 * np.linalg.det(metric)
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


class NumpyFacets:
    """What CompiledFacets says of places on facets."""

    def __init__(self, shape: FacetShape) -> None:
        self.shape = shape

    def geometry(self, points, controls, facet, xi):
        """As CompiledFacets.geometry."""
        mine = controls[facet]
        foot = np.einsum("qa,qai->qi", self.shape.values(xi), mine)
        tangents = np.einsum("qba,qai->qbi", self.shape.first(xi), mine)
        normal = unit_normals(tangents)
        gap = np.einsum("qi,qi->q", points - foot, normal)
        if self.shape.is_flat:
            return foot, tangents, normal, gap, None
        return foot, tangents, normal, gap, np.einsum("qbca,qai->qbci", self.shape.second(xi), mine)

    def places(self, controls, facet, xi):
        """As CompiledFacets.places."""
        return self.geometry(np.zeros((len(facet), controls.shape[2])), controls, facet, xi)[:2]


class NumpySurface(FacetSurface):
    """A surface whose closest points numpy finds, among the candidates of the search."""

    def __init__(self, *arguments) -> None:
        super().__init__(*arguments)
        self._code = NumpyFacets(self.shape)

    def _closest(self, points, controls, frozen_facets):
        point, facet = pairs(self.search, points, controls)
        if not len(points):
            empty = np.empty(0, dtype=np.int32)
            return empty, np.empty((0, self.shape.directions)), empty
        pair = closest_points(self.shape, controls[facet], points[point])
        start = np.searchsorted(point, np.arange(len(points)))
        distance = np.sqrt(pair.squared)
        least = np.minimum.reduceat(distance, start)
        near = distance <= least[point] + TIE * self.search.slack
        rank = facet.astype(np.int64) + np.where(pair.entity == INTERIOR, 0, len(self.facets))
        rank = np.where(near, rank, 2 * len(self.facets))
        best = np.nonzero(rank == np.minimum.reduceat(rank, start)[point])[0]
        facet, xi, entity = facet[best], pair.xi[best], pair.entity[best]
        if frozen_facets is not None:
            there, found = stationary_points(self.shape, controls[frozen_facets], points)
            stays = found & (self.shape.excess(there) <= OVERRUN)
            facet = np.where(stays, frozen_facets, facet)
            entity = np.where(stays, INTERIOR, entity)
            xi = np.where(stays[:, None], there, xi)
        return facet, xi, entity
