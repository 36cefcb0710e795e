"""First-order cells in space: forces, energy and tangent by the compiled loop."""

from __future__ import annotations

import ctypes

import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.lanes import LANES, in_lanes
from tribox.forms.bodies.materials import Hencky, Material, MooneyRivlin, NeoHookean, Yeoh
from tribox.forms.bodies.solid import Solid
from tribox.forms.native.libraries import library
from tribox.geometry.compat import cell_order
from tribox.geometry.surfaces.facets import Bools, Floats, Ints

SOURCE = "space_kernel.c"
_KINDS: dict[type, int] = {NeoHookean: 0, MooneyRivlin: 1, Hencky: 2, Yeoh: 3}
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
        *((name, ctypes.c_void_p) for name in ("forces", "total", "values")),
    )


class SpaceCells:
    """Cells of one body by the compiled loop, ``LANES`` at a time.

    See :class:`tribox.forms.bodies.compiled_cells.CompiledCells`.
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
        self._kind = _KINDS[type(material)], 2 if corners == 4 else int(reduced)
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
        self, u: Floats, values: Floats, starts: NDArray[np.int32], excess: Floats | None = None
    ) -> None:
        """See ``CompiledCells.add_tangent``; N/m."""
        assert starts.flags.c_contiguous and starts.dtype == np.int32
        assert starts.shape[:2] == self.nodes.shape
        more = None if excess is None else np.ascontiguousarray(excess)
        self._work.u, self._work.values = u.ctypes.data, values.ctypes.data
        self._work.start = starts.ctypes.data
        self._work.excess = None if more is None else more.ctypes.data
        self._code.tribox_space_tangent(*self._kind, ctypes.byref(self._work))


def space_cells(space: dolfinx.fem.FunctionSpace, solid: Solid) -> SpaceCells | None:
    """The loop for a body; None where it does not cover its cells, element or material."""
    mesh = space.mesh
    corners = _CORNERS.get(mesh.topology.cell_type)
    linear = space.dofmap.dof_layout.num_dofs == corners and cell_order(mesh) == 1
    if not linear or type(solid.elastic) not in _KINDS:
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
