"""What field output is made of: stress in the cells, contact pressure at the nodes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import basix
import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from tribox.forms.bodies.deformation import centre_rows, rows_at
from tribox.forms.bodies.point_stress import mean_pressure, von_mises
from tribox.forms.bodies.solid import Solid
from tribox.geometry.meshes.places import centre
from tribox.geometry.surfaces.facets import Floats, Longs, facet_shape
from tribox.geometry.surfaces.surface import ContactSurface

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
    # By place, for basix and VTK number edges and faces each in their own way.
    apart = np.linalg.norm(places[:, None] - element.points[None], axis=2)
    order: Longs = apart.argmin(axis=1)
    assert apart.min(axis=1).max() < 1e-12, "nodes of another element"
    return order


class GatheredMesh:
    """The mesh of a displacement, whole on the first rank; empty on the others.

    ``cells``: (c, a) in VTK's order, ``kind`` its number; ``reference``: (n, i), m, of nodes;
    ``node_order``: (n,) their numbers among all ranks' nodes.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace) -> None:
        """Gather a blocked Lagrange space of degree 1 or 2: cells, reference places; collective."""
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
            # The order of the mesh file or generator, whichever rank has a cell.
            self._cell_order = np.argsort(numbers, kind="stable")
            self.cells, self.node_order = _numbered(rows[self._cell_order])
        places = space.tabulate_dof_coordinates()[: index.size_local, : mesh.geometry.dim]
        self.reference = self.nodal(places)

    def nodal(self, values: Floats) -> Floats:
        """Values (n, k) at all nodes, from (m, k) at own ones; on the first rank; collective."""
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
    """Cells (c, a) with nodes numbered as they come, and (n,) the old number of each."""
    old, first, at = np.unique(rows.reshape(-1), return_index=True, return_inverse=True)
    # Unique numbers come sorted; where each first stands says in which order cells name them.
    order = np.argsort(first)
    new = np.empty(len(order), dtype=np.int64)
    new[order] = np.arange(len(order))
    return new[at].reshape(rows.shape), old[order]


# -- Deformation and stress at the centre of every cell, contact pressure at the nodes -------------


@dataclass(frozen=True, slots=True)
class Strain:
    """Measures of the deformation of each cell."""

    J: Floats  # (c,) volume ratio det F
    max_stretch: Floats  # (c,) largest principal stretch
    log_strain: Floats  # (c, 3, 3) ln V = ½ ln(F Fᵀ), along the axes of the deformed body


def strain_of(F: Floats) -> Strain:
    """The measures of deformation gradients (c, 3, 3)."""
    # F Fᵀ = Σ λ² n nᵀ: ln V has the same axes n, and ½ ln λ² along them.
    squares, axes = np.linalg.eigh(F @ F.transpose(0, 2, 1))
    logs = 0.5 * np.log(squares)
    strain = (axes * logs[:, None]) @ axes.transpose(0, 2, 1)
    return Strain(np.linalg.det(F), np.sqrt(squares[:, -1]), strain)


@dataclass(frozen=True, slots=True)
class CellValues:
    """What there is to say of the cells of this rank."""

    stress: Floats  # (c, 3, 3), Pa, Cauchy's
    plastic_strain: Floats  # (c,), equivalent plastic strain
    strain: Strain

    @property
    def von_mises(self) -> Floats:
        """(c,), Pa."""
        return von_mises(self.stress)

    @property
    def pressure(self) -> Floats:
        """(c,), Pa, −tr σ/3."""
        return mean_pressure(self.stress)


class StressField:
    """Evaluates deformation and Cauchy stress at the centres of this rank's own cells.

    Of bodies that remember, that of the last committed step, brought there by
    :mod:`tribox.forms.bodies.memory_solid`; ``flows``: whether one does.
    """

    def __init__(self, u: dolfinx.fem.Function, solids: Sequence[Solid]) -> None:
        space, topology = u.function_space, u.function_space.mesh.topology
        self._u, self._dim = u, topology.dim
        self._count = topology.index_map(topology.dim).size_local
        self._parts = []
        for solid in solids:
            cells, middle, volumes = solid.cells, centre(solid.cell), None
            if solid.remembers and solid.reduced:
                volumes = centre_rows(space, solid.section, cells)
            rows = rows_at(space, solid.section, cells, middle)
            nodes, stress = space.dofmap.list[cells], solid.stress_at(cells, middle)
            self._parts.append((cells, nodes, rows, volumes, stress))
        self.flows = any(solid.flows for solid in solids)

    def evaluate(self) -> CellValues:
        """What there is at the present displacement."""
        F = np.tile(np.eye(3), (self._count, 1, 1))
        stress, flow = np.zeros_like(F), np.zeros(self._count)
        nodal = self._u.x.array.reshape(-1, self._dim)
        for cells, nodes, rows, volumes, of_body in self._parts:
            F[cells] = rows.deformation(nodal[nodes])
            volumetric = None if volumes is None else volumes.deformation(nodal[nodes])
            stress[cells] = of_body.cauchy(F[cells], volumetric)
            if (flowed := of_body.plastic_strain()) is not None:
                flow[cells] = flowed
        return CellValues(stress, flow, strain_of(F))


class ContactPressureField:
    """Contact pressure at the nodes of slave surfaces, 0 at all others."""

    def __init__(self, u: dolfinx.fem.Function, surfaces: Sequence[ContactSurface]) -> None:
        """Find the nodes; collective."""
        index = u.function_space.dofmap.index_map
        self._count = index.size_local + index.num_ghosts
        self._rows = [_interpolation(surface) for surface in surfaces]

    def at(self, pressures: Sequence[Floats]) -> Floats:
        """Pressure (n,), Pa, at this rank's nodes, from (v,), Pa, at all vertices of surfaces.

        Where surfaces share a node the largest counts.
        """
        out = np.zeros(self._count)
        for (nodes, vertices, share), values in zip(self._rows, pressures, strict=True):
            here = np.einsum("nk,nk->n", share, values[vertices])
            out[nodes] = np.maximum(out[nodes], here)
        return out


def _interpolation(surface: ContactSurface) -> tuple[Longs, Longs, Floats]:
    """Local nodes (n,) of a slave surface, their facets' vertices (n, k) and shares; collective."""
    slave, vertices, form = surface.slave, surface.vertices, surface.shape
    linear = facet_shape(form.cell, 1).values(form.points)
    _, first = np.unique(slave.facet, return_index=True)
    number = np.repeat(vertices.of_point[first], form.count, axis=0)
    share = np.tile(linear, (len(first), 1))
    mine = (slave.nodes[first].reshape(-1), number, share)
    # A rank may have a node of the surface, but none of the facets around it.
    gathered = zip(*vertices.comm.allgather(mine), strict=True)
    nodes, number, share = (np.concatenate(parts) for parts in gathered)
    distinct, once = np.unique(nodes, return_index=True)
    local = surface.space.dofmap.index_map.global_to_local(distinct).astype(np.int64)
    here = local >= 0
    return local[here], number[once][here], share[once][here]
