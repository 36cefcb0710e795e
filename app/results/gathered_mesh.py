"""Cells and nodes of a displacement on the first rank, in an order that ranks do not change.

Cells come in the order of the mesh file or generator, nodes in that in which the cells name them.
Both are found once; afterwards values alone are gathered.
"""

from __future__ import annotations

import math
from typing import TypeVar

import basix
import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from tribox.geometry.surfaces.facets import Floats, Longs

Number = TypeVar("Number", bound=np.generic)

# Reference coordinates of the nodes of VTK's cells: corners, edges, faces, middle.
_SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6))
_CORNERS = {
    "triangle": ((0, 0), (1, 0), (0, 1)),
    "quadrilateral": _SQUARE,
    "tetrahedron": ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "hexahedron": tuple((*corner, z) for z in (0, 1) for corner in _SQUARE),
}
# Nodes beside the corners at degree 2, each the mean of the corners listed.
_MEANS: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quadrilateral": (*_EDGES[:4], (0, 1, 2, 3)),
    "tetrahedron": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": (
        *(*_EDGES, (3, 7)),
        *((0, 3, 4, 7), (1, 2, 5, 6), (0, 1, 4, 5), (2, 3, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7)),
        (0, 1, 2, 3, 4, 5, 6, 7),
    ),
}
# VTK's numbers of the cells: linear; VTK_QUADRATIC_TRIANGLE, VTK_BIQUADRATIC_QUAD,
# VTK_QUADRATIC_TETRA and VTK_TRIQUADRATIC_HEXAHEDRON.
_KINDS = {
    1: {"triangle": 5, "quadrilateral": 9, "tetrahedron": 10, "hexahedron": 12},
    2: {"triangle": 22, "quadrilateral": 28, "tetrahedron": 24, "hexahedron": 29},
}


def vtk_order(element: basix.finite_element.FiniteElement) -> Longs:
    """The node (a,) of a Lagrange element of degree 1 or 2 at each place of VTK's cell."""
    cell = element.cell_type.name
    corners = np.array(_CORNERS[cell], dtype=np.float64)
    means = _MEANS[cell] if element.degree == 2 else ()
    places = np.concatenate([corners, *([corners[list(mean)].mean(axis=0)] for mean in means)])
    apart = np.linalg.norm(places[:, None] - element.points[None], axis=2)
    order: Longs = apart.argmin(axis=1)
    assert apart.min(axis=1).max() < 1e-12, "nodes of another element"
    return order


class GatheredMesh:
    """The mesh of a displacement, whole on the first rank.

    Attributes:
        cells: (c, a) nodes of each cell, in VTK's order; kind: VTK's number of the cells.
        reference: (n, i), m, undeformed places of the nodes.
        node_order: (n,) number of each node among those of all ranks, one rank after the other.
            All are empty on the other ranks.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace) -> None:
        """Gather cells and reference places; collective.

        Args:
            space: of the displacement, blocked Lagrange of degree 1 or 2.
        """
        mesh = space.mesh
        self._comm: MPI.Comm = mesh.comm
        owned_cells = mesh.topology.index_map(mesh.topology.dim).size_local
        index = space.dofmap.index_map
        element = space.element.basix_element
        self.kind = _KINDS[element.degree][element.cell_type.name]
        self._cell_order: Longs = np.empty(0, dtype=np.int64)
        self.node_order: Longs = np.empty(0, dtype=np.int64)
        nodes = space.dofmap.list[:owned_cells][:, vtk_order(element)]
        shape = nodes.shape
        nodes = index.local_to_global(np.ascontiguousarray(nodes).reshape(-1)).reshape(shape)
        original = mesh.topology.original_cell_index[:owned_cells]
        everything = self._comm.gather((nodes, original))
        self.cells = np.empty((0, shape[1]), dtype=np.int64)
        if everything is not None:
            rows, numbers = (np.concatenate(p) for p in zip(*everything, strict=True))
            self._cell_order = np.argsort(numbers, kind="stable")
            self.cells, self.node_order = _numbered(rows[self._cell_order])
        places = space.tabulate_dof_coordinates()[: index.size_local, : mesh.geometry.dim]
        self.reference = self.nodal(places)

    def nodal(self, values: Floats) -> Floats:
        """Values (n, k) at the nodes of those (m, k) at all of this rank's own; collective.

        Returns:
            On the first rank; on the others no row.
        """
        return gathered(self._comm, values).take(self.node_order, axis=0)

    def cellwise(self, values: NDArray[Number]) -> NDArray[Number]:
        """Values (c, …) of the cells of those (d, …) of all this rank has; as :meth:`nodal`."""
        return gathered(self._comm, values).take(self._cell_order, axis=0)


def gathered(comm: MPI.Comm, values: NDArray[Number]) -> NDArray[Number]:
    """Rows (n, …) of all ranks one after the other, on the first; none elsewhere; collective."""
    if comm.size == 1:
        return values
    values = np.ascontiguousarray(values)
    counts = comm.gather(values.size)
    if counts is None:
        comm.Gatherv(values, None)
        return values[:0]
    width = math.prod(values.shape[1:])
    out = np.empty((sum(counts) // width, *values.shape[1:]), dtype=values.dtype)
    comm.Gatherv(values, [out, counts])
    return out


def _numbered(rows: Longs) -> tuple[Longs, Longs]:
    """Nodes numbered as the cells name them.

    Args:
        rows: (c, a) nodes of each cell.

    Returns:
        (c, a) the same cells in new numbers, and (n,) the old number of each node.
    """
    old, first, at = np.unique(rows.reshape(-1), return_index=True, return_inverse=True)
    order = np.argsort(first)
    new = np.empty(len(order), dtype=np.int64)
    new[order] = np.arange(len(order))
    return new[at].reshape(rows.shape), old[order]
