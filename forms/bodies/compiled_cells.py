"""Bodies whose forces, energy and tangent compiled loops compute, several cells at a time.

The loops give what the forms that DOLFINx compiles give, to round-off.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any, Protocol

import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.deformation import centre_rows, quadrature_rows, ring_volume
from tribox.forms.bodies.materials import Hencky, Material, MooneyRivlin, NeoHookean, Yeoh
from tribox.forms.bodies.point_cells import LANES, Beside, in_lanes
from tribox.forms.bodies.solid import Solid
from tribox.forms.native.libraries import library
from tribox.geometry.compat import cell_order
from tribox.geometry.surfaces.facets import Bools, Floats, Ints


class CompiledCells(Protocol):
    """Owned cells of one body.

    Axis letters: c cells, a and b corners, i and j space; n local unknowns, ghosts included.

    Attributes:
        nodes: (c, a) local nodes of each cell, in the order of the loop.
    """

    nodes: Ints

    def part(self, take: Bools) -> CompiledCells:
        """The cells (c,) to ``take`` by themselves."""
        ...

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """See :meth:`tribox.forms.bodies.internal_force.BodyForce.add`.

        Forces of a cell that is turned inside out are NaN where the forms' would be.
        """
        ...

    def energy(self, u: Floats) -> float:
        """Strain energy at ``u`` (n,), J per unit thickness; infinite where a cell is inverted."""
        ...

    def add_tangent(
        self,
        u: Floats,
        values: Floats,
        starts: NDArray[np.int32],
        excess: Floats | None = None,
        beside: Beside | None = None,
    ) -> None:
        """Add the element matrices at ``u`` (n,), N/m per unit thickness.

        Args:
            u: m.
            values: of a sparse matrix, changed.
            starts: (c, a, i, b), contiguous, from where on in ``values`` the dim numbers of the
                row (a, i) and the columns (b, j) are.
            excess: (c,), Pa, added to the volumetric pressures of ``q1-sri``
                (:mod:`tribox.forms.bodies.solid`).
            beside: points of the same cells that remember, whose matrices are added too.
        """
        ...


def compiled_cells(space: dolfinx.fem.FunctionSpace, solid: Solid) -> CompiledCells | None:
    """The loop for this rank's cells of a body, even if there are none; None: no loop covers it.

    All ranks get one, or none does.
    """
    in_space = solid.section == "3D"
    return space_cells(space, solid) if in_space else plane_cells(space, solid)


def _kind(material: Material, kinds: dict[type, int], volumetric: int) -> int:
    """Number of a material in the sources; that of K/2 (ln J)² alone, if it has no other energy."""
    alone = isinstance(material, Hencky) and material.shear_modulus == 0.0
    return volumetric if alone else kinds[type(material)]


# -- First-order cells in the plane: forces, energy and tangent by the compiled loops --------------
#
# In plane strain, and in half sections of bodies of revolution.

FORCES = "plane_kernel.c"
TANGENT = "plane_tangent.c"
RING = "ring_cells.c"
_KINDS: dict[type, int] = {NeoHookean: 0, MooneyRivlin: 1, Hencky: 2}
_VOLUMETRIC = 3
_POINTER = ctypes.c_void_p
_CELLS: list[Any] = [ctypes.c_int, ctypes.c_int, _POINTER, ctypes.c_int64, ctypes.c_int]
_CELLS += [_POINTER] * 3


class PlaneCells:
    """Cells of one body by the compiled loops, ``LANES`` at a time.

    See :class:`CompiledCells`.
    """

    def __init__(
        self, code: PlaneCode, nodes: Ints, table: Floats, material: Material, reduced: bool
    ) -> None:
        """Arrange the cells for the loops.

        Args:
            code: the loops.
            nodes: (c, a) int32, local nodes of each cell, a = 3 for triangles, 4 for quadrilaterals
                in DOLFINx's order.
            table: (c, k) what the loops need of the geometry of each cell.
            material: its strain energy.
            reduced: whether the volumetric part is taken at the centre.
        """
        self._code, self._table = code, table
        self._material, self._reduced = material, reduced
        count, corners = nodes.shape
        self.nodes = nodes
        self._rows, self._tables = in_lanes(_four(nodes)), in_lanes(table)
        blocks = len(self._rows)
        self._parameters = np.array(list(material.parameters().values()))
        self._result = np.zeros(1)
        self._arguments = (
            _kind(material, _KINDS, _VOLUMETRIC),
            2 if corners == 3 else int(reduced),
            self._parameters.ctypes.data,
            blocks,
            count - (blocks - 1) * LANES,
            self._rows.ctypes.data,
            self._tables.ctypes.data,
        )

    def part(self, take: Bools) -> PlaneCells:
        """See ``CompiledCells.part``."""
        return PlaneCells(
            self._code, self.nodes[take], self._table[take], self._material, self._reduced
        )

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """See ``CompiledCells.add``."""
        bad: int = self._code.forces(*self._arguments, u.ctypes.data, out.ctypes.data)
        return bad == 0

    def energy(self, u: Floats) -> float:
        """See ``CompiledCells.energy``."""
        bad = self._code.energy(*self._arguments, u.ctypes.data, self._result.ctypes.data)
        return float(np.inf if bad else self._result[0])

    def add_tangent(
        self,
        u: Floats,
        values: Floats,
        starts: NDArray[np.int32],
        excess: Floats | None = None,
        beside: Beside | None = None,
    ) -> None:
        """See ``CompiledCells.add_tangent``."""
        assert starts.flags.c_contiguous and starts.dtype == np.int32
        assert starts.shape[:2] == self.nodes.shape
        more = None if excess is None else np.ascontiguousarray(excess)
        self._code.tangent(
            *self._arguments,
            u.ctypes.data,
            None if more is None else more.ctypes.data,
            None if beside is None else ctypes.addressof(beside),
            starts.ctypes.data,
            values.ctypes.data,
        )


@dataclass(frozen=True, slots=True)
class PlaneCode:
    """The compiled loops over plane cells."""

    forces: Any
    energy: Any
    tangent: Any


def _code(ring: bool) -> PlaneCode:
    """The loops."""
    loops, tangents = library(RING if ring else FORCES), library(RING if ring else TANGENT)
    kind = "ring" if ring else "plane"
    code = PlaneCode(
        getattr(loops, f"tribox_{kind}_forces"),
        getattr(loops, f"tribox_{kind}_energy"),
        getattr(tangents, f"tribox_{kind}_tangent"),
    )
    for function in (code.forces, code.energy):
        function.argtypes, function.restype = [*_CELLS, _POINTER], ctypes.c_int
    code.tangent.argtypes, code.tangent.restype = _CELLS + [_POINTER] * 4, ctypes.c_int
    return code


def plane_cells(space: dolfinx.fem.FunctionSpace, solid: Solid) -> PlaneCells | None:
    """The loops for a body; None where they do not cover its cells, element or material."""
    mesh = space.mesh
    corners = {
        dolfinx.mesh.CellType.quadrilateral: 4,
        dolfinx.mesh.CellType.triangle: 3,
    }.get(mesh.topology.cell_type)
    linear = space.dofmap.dof_layout.num_dofs == corners
    if not linear or type(solid.elastic) not in _KINDS:
        return None
    ring = solid.section == "axisymmetric"
    code = _code(ring)
    if code is None:
        return None
    nodes = np.asarray(space.dofmap.list, dtype=np.int32)[solid.cells]
    if ring:
        table = _points(space, solid)
    else:
        position = space.tabulate_dof_coordinates()[:, :2]
        table = _edges(_four(nodes), position)
    assert solid.elastic is not None
    return PlaneCells(code, nodes, table, solid.elastic, reduced=solid.reduced)


def _points(space: dolfinx.fem.FunctionSpace, solid: Solid) -> Floats:
    """Table (c, p·(3 a + 1)) of the points of the cells of a ring.

    Of each point the gradients (j, a), 1/m, of the shape functions, these over the radius (a), 1/m,
    and the weight, m³. The last point of ``q1-sri`` is the centre.
    """
    section, cells = solid.section, solid.cells
    rows, weight = quadrature_rows(space, section, cells, solid.full_degree)
    if solid.reduced:
        rows.append(centre_rows(space, section, cells))
        weight = np.concatenate([weight, ring_volume(rows[-1], section)[None]])
    out = []
    for g, one in enumerate(rows):
        gradients, hoop = one.gradients, one.values / one.place[:, :1]
        out += [gradients[:, :, 0], gradients[:, :, 1], hoop, weight[g, :, None]]
    return np.concatenate(out, axis=1)


def _four(nodes: Ints) -> Ints:
    """Nodes (c, 4) as the loops take them: triangles repeat their third one."""
    return nodes[:, [0, 1, 2, 3 if nodes.shape[1] == 4 else 2]]


def _edges(four: Ints, position: Floats) -> Floats:
    """Edges (c, 6), m, along both directions of a cell, and the mixed difference."""
    x = position[four]
    edges = [x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 3] - x[:, 2] - x[:, 1] + x[:, 0]]
    return np.stack(edges, axis=1).reshape(len(four), 6)


# -- First-order cells in space: forces, energy and tangent by the compiled loop -------------------

SOURCE = "space_kernel.c"
_KINDS_IN_SPACE: dict[type, int] = {NeoHookean: 0, MooneyRivlin: 1, Hencky: 2, Yeoh: 3}
_VOLUMETRIC_IN_SPACE = 4
_CORNERS = {
    dolfinx.mesh.CellType.hexahedron: 8,
    dolfinx.mesh.CellType.tetrahedron: 4,
}


class _Work(ctypes.Structure):
    """What a call works on, see ``Work`` of the source."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("c", "edge", "u", "excess")),
        *((name, ctypes.c_int64) for name in ("blocks", "lanes_of_last")),
        *((name, ctypes.c_void_p) for name in ("node", "start")),
        *((name, ctypes.c_void_p) for name in ("forces", "total", "values", "beside")),
    )


class SpaceCells:
    """Cells of one body by the compiled loop, ``LANES`` at a time.

    See :class:`CompiledCells`.
    """

    def __init__(
        self, code: ctypes.CDLL, nodes: Ints, position: Floats, material: Material, reduced: bool
    ) -> None:
        """Arrange the cells for the loop.

        Args:
            code: the library of ``SOURCE``.
            nodes: (c, a) local nodes of each cell, a = 4 for tetrahedra, 8 for hexahedra in
                DOLFINx's order.
            position: (n, i), m, reference position of the nodes.
            material: its strain energy.
            reduced: whether the volumetric part is taken at the centre.
        """
        self._code, self._position = code, position
        self._material, self._reduced = material, reduced
        self.nodes = nodes.astype(np.int32)
        count, corners = nodes.shape
        self._rows = in_lanes(self.nodes)
        self._edges = in_lanes(coefficients(position[nodes]).reshape(count, 21))
        self._parameters = np.array(list(material.parameters().values()))
        self._total = np.zeros(1)
        blocks = len(self._rows)
        kind = _kind(material, _KINDS_IN_SPACE, _VOLUMETRIC_IN_SPACE)
        self._kind = kind, 2 if corners == 4 else int(reduced)
        self._work = _Work(
            c=self._parameters.ctypes.data,
            edge=self._edges.ctypes.data,
            blocks=blocks,
            lanes_of_last=count - (blocks - 1) * LANES,
            node=self._rows.ctypes.data,
            total=self._total.ctypes.data,
        )

    def part(self, take: Bools) -> SpaceCells:
        """See ``CompiledCells.part``."""
        return SpaceCells(
            self._code, self.nodes[take], self._position, self._material, self._reduced
        )

    def add(self, u: Floats, out: Floats, dt: float | None) -> bool:
        """See ``CompiledCells.add``."""
        self._work.u, self._work.forces = u.ctypes.data, out.ctypes.data
        bad: int = self._code.tribox_space_forces(*self._kind, ctypes.byref(self._work))
        return bad == 0

    def energy(self, u: Floats) -> float:
        """See ``CompiledCells.energy``; J."""
        self._work.u = u.ctypes.data
        bad = self._code.tribox_space_energy(*self._kind, ctypes.byref(self._work))
        return float(np.inf if bad else self._total[0])

    def add_tangent(
        self,
        u: Floats,
        values: Floats,
        starts: NDArray[np.int32],
        excess: Floats | None = None,
        beside: Beside | None = None,
    ) -> None:
        """See ``CompiledCells.add_tangent``; N/m."""
        assert starts.flags.c_contiguous and starts.dtype == np.int32
        assert starts.shape[:2] == self.nodes.shape
        more = None if excess is None else np.ascontiguousarray(excess)
        self._work.u, self._work.values = u.ctypes.data, values.ctypes.data
        self._work.start = starts.ctypes.data
        self._work.beside = None if beside is None else ctypes.addressof(beside)
        self._work.excess = None if more is None else more.ctypes.data
        self._code.tribox_space_tangent(*self._kind, ctypes.byref(self._work))


def space_cells(space: dolfinx.fem.FunctionSpace, solid: Solid) -> SpaceCells | None:
    """The loop for a body; None where it does not cover its cells, element or material."""
    mesh = space.mesh
    corners = _CORNERS.get(mesh.topology.cell_type)
    linear = space.dofmap.dof_layout.num_dofs == corners and cell_order(mesh) == 1
    if not linear or type(solid.elastic) not in _KINDS_IN_SPACE:
        return None
    nodes = np.asarray(space.dofmap.list)[solid.cells]
    position = space.tabulate_dof_coordinates()
    assert solid.elastic is not None
    return SpaceCells(library(SOURCE), nodes, position, solid.elastic, reduced=solid.reduced)


def coefficients(x: Floats) -> Floats:
    """Coefficients (c, 7, i) of ξ, η, ξη, ζ, ξζ, ηζ, ξηζ in the positions (c, a, i) of the nodes.

    The parent cell is [−1, 1]³; tetrahedra have the edges from their first node in the places of
    ξ, η and ζ.
    """
    if x.shape[1] == 4:
        found = np.zeros((len(x), 7, 3))
        found[:, [0, 1, 3]] = x[:, 1:] - x[:, :1]
        return found
    signs = np.array([[(-1.0) ** (m & ~a).bit_count() for a in range(8)] for m in range(1, 8)])
    return np.einsum("ma,cai->cmi", signs / 8.0, x - x[:, :1])
