"""Quadrature points of a contact pair's slave facets: what moves them, and what they stand for.

Axis letters: q points, a facet nodes, i space, α surface directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix
import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from tribox.geometry.surfaces.body_facets import facet_nodes, owned_facets, require_facets
from tribox.geometry.surfaces.facets import (
    Bools,
    FacetShape,
    Floats,
    Ints,
    Longs,
    facet_shape,
    measure,
    order_by_place,
)


@dataclass(slots=True)
class SlavePoints:
    """Quadrature points of the slave facets owned by this rank."""

    nodes: Longs  # (q, a) global node (displacement block) numbers that move each point
    shape: Floats  # (q, a) shape functions there
    # (q, α, a) their derivatives along ``tangents``, per reference length, 1/m
    shape_derivative: Floats
    # (q,) quadrature weight times reference facet measure: m (per unit thickness) in the plane, m²
    # in space and with axial symmetry (the whole ring 2πR)
    weight: Floats
    position: Floats  # (q, i), m, reference
    tangents: Floats  # (q, α, i) orthonormal tangents of the facets, reference
    facet: Ints  # (q,) number of the slave facet, for counting pairs of facets
    mesh_facet: Ints  # (q,) its local number in the mesh
    xi: Floats  # (q, α) reference coordinates on it
    # (q,), m, its length, in space the side of a square or of half a square of its area
    facet_length: Floats
    facet_share: Floats  # (q,) share of it that the point stands for
    # (q,), m, in the plane half the way from the point to the end of that piece, so that no point
    # fades while slave and master end at the same place
    reach: Floats


def slave_points(
    space: dolfinx.fem.FunctionSpace, form: FacetShape, facets: NDArray[np.int32], degree: int
) -> SlavePoints:
    """The points of this rank; collective; ValueError, on every rank, if there is no facet."""
    mesh = space.mesh
    require_facets(mesh, facets, "slave")
    own = np.sort(owned_facets(mesh, facets))
    table, rule = basix.make_quadrature(basix.CellType[form.cell], degree)
    number, xi = np.repeat(np.arange(len(own)), len(rule)), np.tile(table, (len(own), 1))
    local = facet_nodes(space, own)[number]
    nodes = space.dofmap.index_map.local_to_global(local.reshape(-1)).reshape(local.shape)
    corners = space.tabulate_dof_coordinates()[:, : mesh.geometry.dim][local]
    shape, derivative = form.values(xi), form.first(xi)
    tangents = np.einsum("qba,qai->qbi", derivative, corners)
    weight = np.tile(rule, len(own)) * measure(tangents)
    tangents, derivative = _orthonormal(tangents, derivative)
    # Length (q,), m, of each point's facet from the weights on it.
    size = np.bincount(number, weight).astype(np.float64)
    share = weight / size[number]
    if form.directions == 2:
        # Of an area the side of a square, or of half a square.
        size = np.sqrt(2.0 * size if form.cell == "triangle" else size)
    length: Floats = size[number]
    return SlavePoints(
        nodes=nodes.astype(np.int64),
        shape=shape,
        shape_derivative=derivative,
        weight=weight,
        position=np.einsum("qa,qai->qi", shape, corners),
        tangents=tangents,
        facet=number.astype(np.int32),
        mesh_facet=own[number].astype(np.int32),
        xi=xi,
        facet_length=length,
        facet_share=share,
        reach=length * _half_way_to_the_end(number, xi, share),
    )


def _half_way_to_the_end(facet: Longs, xi: Floats, share: Floats) -> Floats:
    """Half the way (q,), in lengths of a facet, from the points to the ends of their pieces.

    Along a facet in the plane the pieces lie one after the other, each with its point inside.
    """
    order = np.lexsort([xi[:, 0], facet])
    total = np.cumsum(share[order])  # a facet's shares add up to one
    end = np.empty_like(total)
    end[order] = total - facet[order]
    inside = xi[:, 0]
    return 0.5 * np.minimum(inside - (end - share), end - inside)


def _orthonormal(tangents: Floats, derivative: Floats) -> tuple[Floats, Floats]:
    """Gram–Schmidt on tangents (q, α, i), with the same combinations of derivatives (q, α, a)."""
    tangents, derivative = tangents.copy(), derivative.copy()
    if tangents.shape[1] == 2:
        first = np.einsum("qi,qi->q", tangents[:, 0], tangents[:, 0])
        share = (np.einsum("qi,qi->q", tangents[:, 0], tangents[:, 1]) / first)[:, None]
        tangents[:, 1] -= share * tangents[:, 0]
        derivative[:, 1] -= share * derivative[:, 0]
    length = np.linalg.norm(tangents, axis=2)[..., None]
    return tangents / length, derivative / length


# -- Normals of a slave surface in the plane that do not jump from facet to facet ------------------
#
# Axis letters: v vertices, q slave points, s the four vertices around a point's facet, i space, e
# the two ends of the facet.
#
# At a vertex the normal is that of the chord e_A = x_next − x_before over the facets on both sides
# (one-sided at an end), and between the vertices A and B of a facet
#
#     n = −M/|M|,   M = N_A ν_A + N_B ν_B,   ν = J e/|e|,
#
# with J a turn to the left, so that n points from the master to the slave (Puso & Laursen, Comput.
# Methods Appl. Mech. Engng 193 (2004) 601; Popp et al., Int. J. Numer. Meth. Engng 83 (2010) 1428).

# e_A and e_B from the positions of the vertices before A, A, B and after B.
CHORDS = np.array([[-1.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]])


@dataclass(slots=True)
class PointNormals:
    """Normals at the points, and how they change."""

    normal: Floats  # (q, i), unit, towards the slave
    change: Floats  # (q, e, i, j): ∂n/∂e of both chords, 1/m

    def of(self, take: Longs) -> PointNormals:
        """The same of the points ``take`` (p,)."""
        return PointNormals(self.normal[take], self.change[take])


class SlaveNormals:
    """The vertices around each point's facet, and the normals from their positions.

    ``around``: (q, s), before A, A, B and after B, at ends A or B again; ``shape``: (q, e) of A, B.
    """

    def __init__(self, vertices: SlaveVertices, flipped: Bools) -> None:
        """Find the neighbours; collective.

        ``flipped``: (q,) whether a facet is run through backwards for its normal to point out.
        """
        rows = np.arange(len(flipped))
        first = flipped.astype(np.int64)
        # A facet of another rank may be the neighbour: all pairs (start, end) are known to all.
        start, end = vertices.of_point[rows, first], vertices.of_point[rows, 1 - first]
        gathered = vertices.comm.allgather(np.unique(np.stack([start, end]), axis=1))
        pairs = np.concatenate(gathered, axis=1)
        before = np.full(vertices.count, -1, dtype=np.int64)
        after = before.copy()
        before[pairs[1]], after[pairs[0]] = pairs[0], pairs[1]
        left = np.where(before[start] >= 0, before[start], start)
        right = np.where(after[end] >= 0, after[end], end)
        self.around: Longs = np.stack([left, start, end, right], axis=1)
        self.shape = vertices.shape[rows[:, None], np.stack([first, 1 - first], axis=1)]

    def at(self, position: Floats) -> PointNormals:
        """Normals from the current positions (q, s, i), m, of the vertices ``around``."""
        chord = np.einsum("es,qsi->qei", CHORDS, position)
        length = np.linalg.norm(chord, axis=2)[..., None]
        nu = np.stack([-chord[..., 1], chord[..., 0]], axis=2) / length
        total = np.einsum("qe,qei->qi", self.shape, nu)
        size = np.linalg.norm(total, axis=1)
        normal = -total / size[:, None]
        # ∂ν/∂e = (I − ν⊗ν) J/|e|, and ∂n/∂M = −(I − n⊗n)/|M|.
        turn = np.array([[0.0, -1.0], [1.0, 0.0]])
        across = np.eye(2) - nu[..., :, None] * nu[..., None, :]
        d_nu = (self.shape[..., None, None] / length[..., None]) * (across @ turn)
        plane = np.eye(2) - normal[:, :, None] * normal[:, None, :]
        change = -(plane / size[:, None, None])[:, None] @ d_nu
        return PointNormals(normal, change)


# -- Vertices of a pair's slave facets: averages of point values, the same on every rank -----------
#
# Axis letters: v vertices, q slave points, k vertices of a slave facet. The linear shape functions
# N_A of the vertices serve for facets of any degree: they are never negative, so that the mean of a
# gap that is closed everywhere is closed.


@dataclass(frozen=True, slots=True)
class SlaveVertices:
    """The vertices of all slave facets, in an order that does not depend on the ranks."""

    nodes: Longs  # (v,) global nodes (displacement blocks)
    position: Floats  # (v, i), m, reference
    of_point: Longs  # (q, k) vertices of the facet of each point of this rank
    shape: Floats  # (q, k) their linear shape functions there
    area: Floats  # (v,) m_A = Σ_q w N_A: m, m² or, of rings, m²
    length: Floats  # (v,) m: h_A, mean length of the slave facets around
    shared: Bools  # (v,) whether points of more than one rank have this vertex
    comm: MPI.Comm  # of the mesh

    @property
    def count(self) -> int:
        """Number of vertices."""
        return len(self.nodes)

    def sums(self, values: Floats, shape: Floats | None = None) -> Floats:
        """Σ_q N_A f_q (v,) of point values ``values`` (q,), over all ranks; collective.

        With other functions ``shape`` (q, k) in the place of N, where they are given.
        """
        local: Floats = np.bincount(
            self.of_point.reshape(-1),
            ((self.shape if shape is None else shape) * values[:, None]).reshape(-1),
            minlength=self.count,
        ).astype(np.float64, copy=False)
        return self.total(local)

    def at_points(self, values: Floats, shape: Floats | None = None) -> Floats:
        """Σ_A N_A f_A (q,) of vertex values ``values`` (v,); as :meth:`sums`, with other N."""
        shape = self.shape if shape is None else shape
        return np.einsum("qk,qk->q", shape, values[self.of_point])

    def on_all_ranks(self, here: bool) -> bool:
        """Whether something holds on all ranks; collective."""
        if self.comm.size == 1:
            return here
        return bool(self.comm.allreduce(here, op=MPI.LAND))

    def total(self, local: Floats) -> Floats:
        """Sum over all ranks of vertex values ``local`` (…, v); collective."""
        if self.comm.size == 1:
            return local
        total = np.empty_like(local)
        self.comm.Allreduce(local, total, op=MPI.SUM)
        return total


def slave_vertices(
    space: dolfinx.fem.FunctionSpace,
    form: FacetShape,
    nodes: Longs,
    xi: Floats,
    weight: Floats,
    size: Floats,
) -> SlaveVertices:
    """Collect the vertices; collective.

    ``form``: of facets; of each point (q,) its facet's nodes (q, a), ξ (q, α), weights, whole
    rings, and lengths, m.
    """
    comm = space.mesh.comm
    corners = nodes[:, : form.corners]
    mine = np.unique(corners)
    distinct = np.unique(np.concatenate(comm.allgather(mine)))
    place = _positions(space, mine, distinct)
    order = order_by_place(place)
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    present = np.zeros(len(order), dtype=np.int64)
    present[number[np.searchsorted(distinct, mine)]] = 1
    out = SlaveVertices(
        nodes=distinct[order],
        position=place[order],
        of_point=number[np.searchsorted(distinct, corners)],
        shape=facet_shape(form.cell, 1).values(xi),
        area=np.ones(len(order)),
        length=np.ones(len(order)),
        shared=comm.allreduce(present, op=MPI.SUM) > 1,
        comm=comm,
    )
    out.area[:] = out.sums(weight)
    out.length[:] = out.sums(weight * size) / out.area
    return out


def _positions(space: dolfinx.fem.FunctionSpace, mine: Longs, distinct: Longs) -> Floats:
    """Reference positions (v, i) of the ``distinct`` global nodes; collective."""
    local = space.dofmap.index_map.global_to_local(mine)
    dim = space.mesh.geometry.dim
    here = space.tabulate_dof_coordinates()[local][:, :dim]
    out = np.empty((len(distinct), dim))
    for numbers, places in space.mesh.comm.allgather((mine, here)):
        out[np.searchsorted(distinct, numbers)] = places
    return out
