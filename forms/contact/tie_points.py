"""Integration points of a tie: on the slave facets, at places of the master that do not change.

Axis letters: p points, f slave facets, a nodes of a slave facet, k vertices of it, m nodes that
move a master facet, i space, α surface directions.

In the plane the slave facets are divided where a node of the master lies opposite, so that the
integrals of products of both surfaces' shape functions are exact on straight facets, and a uniform
stress passes exactly. In space each facet is divided into equal parts: what is left of the error
falls with their number and that of the facets.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import numpy as np

from tribox.geometry.surfaces.body_facets import facet_nodes
from tribox.geometry.surfaces.facets import (
    Floats,
    Ints,
    Longs,
    facet_shape,
    solve_small,
    unit_normals,
)
from tribox.geometry.surfaces.surface import ContactSurface, MasterFacets, RigidMaster
from tribox.geometry.surfaces.target import Projection

REACH = 0.1  # distance over the length of the longer facets up to which points are tied
_GAUSS = 4  # points of each part of a segment
_PARTS = 4  # of each side of a facet in space
_DEGREE = 3  # of the rule on each of these parts
_SHORT = 1e-9  # share of a facet below which a part of it is none


@dataclass(frozen=True, slots=True)
class TiePoints:
    """Points of this rank's slave facets that have a master beside them.

    Attributes:
        weight: (p,), quadrature weight times reference area: m, m² in space and for rings.
        rows: (p, a) rows of the pair's nodes that move the point, shape: (p, a) their shares.
        of_point: (p, k) vertices of the slave facet; vertex_shape: (p, k) their linear shapes.
        facet: (p,) master facets; xi: (p, α): the places opposite.
        master: (p, m) shares of the nodes that move that facet in ȳ + along^α τ_α; across: (p,):
            offset o = along^α τ_α + across J τ_1 from there in the plane, with J τ the tangent
            turned left; in space along^α τ_α + across n, across in m. A rigid tool has one place
            for every point, its own: no offset.
    """

    weight: Floats
    rows: Longs
    shape: Floats
    of_point: Longs
    vertex_shape: Floats
    facet: Ints
    xi: Floats
    master: Floats
    across: Floats


def tie_points(surface: ContactSurface) -> TiePoints:
    """Find the points of a pair, undeformed, that are tied."""
    shape, slave, master = surface.shape, surface.slave, surface.master
    _, first = np.unique(slave.facet, return_index=True)
    local = facet_nodes(surface.space, slave.mesh_facet[first])
    where = surface.space.tabulate_dof_coordinates()[:, : surface.dim][local]
    where = where.reshape(len(first), shape.count, surface.dim)
    facet, xi, weight = _divided(surface, master, where)
    values, tangents = shape.values(xi), np.einsum("pba,pai->pbi", shape.first(xi), where[facet])
    position = np.einsum("pa,pai->pi", values, where[facet])
    weight = weight * _measure(tangents)
    if surface.axisymmetric:
        weight = weight * 2.0 * np.pi * position[:, 0]
    at = surface.project(position, master.position)
    reach = REACH * slave.facet_length[first][facet]
    if isinstance(master, MasterFacets):
        reach = np.maximum(reach, REACH * master.sizes()[at.facet])
    keep = np.nonzero(at.on_surface & (np.abs(at.gap) <= reach))[0]
    shares, across = _beside(surface, position[keep], at.of(keep))
    return TiePoints(
        weight=weight[keep],
        rows=surface.slave_rows[first][facet[keep]],
        shape=values[keep],
        of_point=surface.vertices.of_point[first][facet[keep]],
        vertex_shape=facet_shape(shape.cell, 1).values(xi[keep]),
        facet=at.facet[keep],
        xi=at.xi[keep],
        master=shares,
        across=across,
    )


def _beside(surface: ContactSurface, position: Floats, at: Projection) -> tuple[Floats, Floats]:
    """``master`` and ``across`` of :class:`TiePoints`, of places (p, i), m, beside the master."""
    if isinstance(surface.master, RigidMaster):
        return surface.master.surface.shares(position), np.zeros(len(position))
    along, across = _offset(position - at.foot, at.tangents)
    slopes = surface.target.slopes(at.facet, at.xi)
    shares = surface.target.weights(at.facet, at.xi) + np.einsum("pb,pbm->pm", along, slopes)
    return shares, across


def _divided(
    surface: ContactSurface, master: MasterFacets | RigidMaster, where: Floats
) -> tuple[Longs, Floats, Floats]:
    """Facets (p,), reference coordinates (p, α) and reference weights (p,) of all points."""
    count, shape = len(where), surface.shape
    if shape.directions == 1:
        return _segments(master, where)
    xi, weight = _parts(shape.cell)
    facet = np.repeat(np.arange(count), len(xi))
    return facet, np.tile(xi, (count, 1)), np.tile(weight, count)


def _segments(master: MasterFacets | RigidMaster, where: Floats) -> tuple[Longs, Floats, Floats]:
    """The points of segments, divided where master nodes are opposite."""
    ends: Floats = np.empty((0, 2))
    length = 0.0
    if isinstance(master, MasterFacets):
        ends = master.position[np.unique(master.facets[:, :2])]
        length = float(master.sizes().max())
    start = where[:, 0]
    chord = where[:, 1] - start
    squared = np.einsum("fi,fi->f", chord, chord)
    share = np.einsum("fi,ni->fn", chord, ends) - np.einsum("fi,fi->f", chord, start)[:, None]
    share = share / squared[:, None]
    apart = ends[None] - start[:, None] - share[..., None] * chord[:, None]
    reach = REACH * max(float(np.sqrt(squared.max(initial=0.0))), length)
    near = np.linalg.norm(apart, axis=2) <= reach
    facet, node = np.nonzero(near & (share > _SHORT) & (share < 1.0 - _SHORT))
    every = np.arange(len(where))
    number = np.concatenate([every, facet, every])
    place = np.concatenate([np.zeros(len(where)), share[facet, node], np.ones(len(where))])
    order = np.lexsort([place, number])
    number, place = number[order], place[order]
    parts = np.nonzero((number[1:] == number[:-1]) & (np.diff(place) > _SHORT))[0]
    points, weights = np.polynomial.legendre.leggauss(_GAUSS)
    part = place[parts + 1] - place[parts]
    xi = place[parts][:, None] + 0.5 * (1.0 + points) * part[:, None]
    weight = 0.5 * weights * part[:, None]
    return np.repeat(number[parts], _GAUSS), xi.reshape(-1, 1), weight.reshape(-1)


def _parts(cell: str) -> tuple[Floats, Floats]:
    """A rule (p, α), (p,) on a reference face that is divided into equal parts."""
    xi, weight = basix.make_quadrature(basix.CellType[cell], _DEGREE)
    steps = np.stack(np.meshgrid(*[np.arange(_PARTS)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    corners, turned = steps, np.empty((0, 2))
    if cell == "triangle":
        corners = steps[steps.sum(axis=1) < _PARTS]
        turned = steps[steps.sum(axis=1) < _PARTS - 1] + 1.0
    upright = (corners[:, None] + xi).reshape(-1, 2)
    reversed_ = (turned[:, None] - xi).reshape(-1, 2)
    points = np.concatenate([upright, reversed_]) / _PARTS
    return points, np.tile(weight / _PARTS**2, len(corners) + len(turned))


def _measure(tangents: Floats) -> Floats:
    """Length (p,) of one tangent, or area of the parallelogram of two, (p, α, i)."""
    if tangents.shape[1] == 1:
        length: Floats = np.linalg.norm(tangents[:, 0], axis=1)
        return length
    return np.linalg.norm(np.cross(tangents[:, 0], tangents[:, 1]), axis=1)


def _offset(offset: Floats, tangents: Floats) -> tuple[Floats, Floats]:
    """Components (p, α) and (p,) of offsets (p, i) from the places with tangents (p, α, i)."""
    metric = np.einsum("pai,pbi->pab", tangents, tangents)
    along = solve_small(metric, np.einsum("pai,pi->pa", tangents, offset))
    across = np.einsum("pi,pi->p", offset, unit_normals(tangents))
    return along, across / np.sqrt(metric[:, 0, 0]) if tangents.shape[1] == 1 else across
