"""Vertices of a pair's slave facets: averages of point values, the same on every rank.

Axis letters: v vertices, q slave points, k vertices of a slave facet. The linear shape functions
N_A of the vertices serve for facets of any degree: they are never negative, so that the mean of a
gap that is closed everywhere is closed.
"""

from __future__ import annotations

from dataclasses import dataclass

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.geometry.surfaces.facets import (
    Bools,
    FacetShape,
    Floats,
    Longs,
    facet_shape,
    order_by_place,
)


@dataclass(frozen=True, slots=True)
class SlaveVertices:
    """The vertices of all slave facets, in an order that does not depend on the ranks.

    Attributes:
        nodes: (v,) global nodes (displacement blocks).
        position: (v, i), m, reference.
        of_point: (q, k) vertices of the facet of each point of this rank.
        shape: (q, k) their linear shape functions there.
        area: (v,) m_A = Σ_q w N_A: m, m² or, of rings, m².
        length: (v,) m: h_A, mean length of the slave facets around.
        shared: (v,) whether points of more than one rank have this vertex.
        comm: of the mesh.
    """

    nodes: Longs
    position: Floats
    of_point: Longs
    shape: Floats
    area: Floats
    length: Floats
    shared: Bools
    comm: MPI.Comm

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
        out: Floats = np.einsum("qk,qk->q", shape, values[self.of_point])
        return out

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

    Args:
        space: of the displacement.
        form: shape of the facets; their corners come first.
        nodes: (q, a) global nodes of each point's facet.
        xi: (q, α) reference coordinates of the points on their facets.
        weight: (q,) quadrature weights, of whole rings with axial symmetry.
        size: (q,) m, length of each point's facet.
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
    index = space.dofmap.index_map
    local = index.global_to_local(mine)
    dim = space.mesh.geometry.dim
    here = space.tabulate_dof_coordinates()[local][:, :dim]
    out = np.empty((len(distinct), dim))
    for numbers, places in space.mesh.comm.allgather((mine, here)):
        out[np.searchsorted(distinct, numbers)] = places
    return out
