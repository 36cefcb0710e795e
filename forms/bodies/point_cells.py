"""Cells of any kind whose material points remember, by a compiled loop, several at a time.

The loop takes a cell from its displacements to its forces or its matrix: deformation gradients at
its points, their update by the kernel of the material, and the contraction with the gradients of
the nodes' functions, without arrays between them. Points without a kernel are updated in Python,
between two passes of the same loop.

Axis letters: c cells, a and b nodes, q points of a cell, k = (c, q) points of the body, i and j
space, p components of F and P, s values of a point's state; n local unknowns, ghosts included.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import basix
import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.deformation import quadrature_rows
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.point_state import CELLS, Kernel, address_of
from tribox.forms.native import library
from tribox.geometry.meshes.places import shape_functions
from tribox.geometry.surfaces.facets import Bools, Floats, Ints

LANES = 8  # cells that the compiled loops take at a time
NAMES: dict[Section, str] = {"plane-strain": "strain", "axisymmetric": "ring", "3D": "space"}


def in_lanes(table: NDArray[Any]) -> NDArray[Any]:
    """Rows (c, k) of the cells as (blocks, k, LANES), the last cell repeated to fill the last."""
    missing = -len(table) % LANES
    padded = np.concatenate([table, table[-1:].repeat(missing, axis=0)])
    return np.ascontiguousarray(padded.reshape(-1, LANES, table.shape[1]).transpose(0, 2, 1))


@dataclass(slots=True)
class Moduli:
    """Where the moduli of the tangent come from: a kernel and the state it starts at, or arrays."""

    kernel: Kernel | None = None  # None: ``A`` is given
    state: Floats | None = None  # (k, s)
    # (k, s), what the kernel has made of the state before; None: that is found anew
    end: Floats | None = None
    A: Floats | None = None  # (k, p, p), Pa

    def arrays(self) -> dict[str, Floats]:
        """What the loop reads."""
        if self.kernel is None:
            assert self.A is not None, "the points have not been evaluated for a tangent"
            return {"A": self.A}
        assert self.state is not None
        return {"state": self.state} | ({} if self.end is None else {"end": self.end})


class _Work(ctypes.Structure):
    """``Work`` of the C source."""

    _fields_ = (
        *(
            (name, ctypes.c_int64)
            for name in (
                "blocks",
                "lanes_of_last",
                "points",
                "nodes",
                "width",
                "symmetric",
                "begin",
            )
        ),
        *((name, ctypes.c_void_p) for name in ("shape", "table", "node", "cell", "u")),
        *((name, ctypes.c_void_p) for name in ("update", "add", "material", "state")),
        *((name, ctypes.c_void_p) for name in ("P", "A", "F", "end", "energies")),
        *((name, ctypes.c_void_p) for name in ("forces", "values", "start")),
    )


class Beside(ctypes.Structure):
    """``Beside`` of ``lanes.h``."""

    work: _Work  # that ``cells`` points to
    arrays: dict[str, Floats]
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("add", "moduli", "cells")),
        ("points", ctypes.c_int64),
        ("symmetric", ctypes.c_int64),
    )


@dataclass(frozen=True, slots=True)
class Cells:
    """What the loop is told of cells, in the order of a body."""

    nodes: Ints  # (c, a) local nodes
    number: Ints  # (c,) of each cell in the body
    table: Floats  # (c, q·(dim² + 2)) of each point ∂ξ/∂X (α, j), 1/m, its weight and in rings 1/x
    shape: Floats  # (q, a, 1 + dim) functions of the nodes and their slopes in the reference cell
    count: int  # of all points of the body


def cells_of(
    space: dolfinx.fem.FunctionSpace, section: Section, cells: Ints, degree: int
) -> tuple[Cells, Floats]:
    """The cells, and the weights (k,) of their points, m² or m³, of whole rings.

    Args:
        cells: (c,) local.
    """
    kind = space.mesh.topology.cell_name()
    points, _ = basix.make_quadrature(basix.CellType[kind], degree)
    rows, weight = quadrature_rows(space, section, cells, degree)
    table = [
        np.column_stack([one.inverse.reshape(len(cells), points.shape[1] ** 2), volume, one.across])
        for one, volume in zip(rows, weight, strict=True)
    ]
    shape = shape_functions(kind, space.element.basix_element.degree, 1, points)
    nodes = np.asarray(space.dofmap.list, dtype=np.int32)[cells]
    number = np.arange(len(cells), dtype=np.int32)
    shape = np.ascontiguousarray(shape.transpose(1, 2, 0))
    found = Cells(nodes, number, np.concatenate(table, axis=1), shape, weight.size)
    return found, weight.T.reshape(-1)


class PointCells:
    """Owned cells of a body, whose points remember.

    Attributes:
        nodes: (c, a) local nodes of each cell; moduli: what the tangent is made from.
    """

    def __init__(self, section: Section, cells: Cells, moduli: Moduli | None = None) -> None:
        """Arrange the cells for the loop."""
        self._section, self._cells = section, cells
        self.nodes = cells.nodes
        self.moduli = Moduli() if moduli is None else moduli
        self._call = getattr(library(CELLS), f"tribox_point_cells_{NAMES[section]}")
        self._call.argtypes, self._call.restype = [ctypes.c_void_p], ctypes.c_int64
        names = f"point_block_{NAMES[section]}", "point_moduli"
        self._beside = [address_of(CELLS, name) for name in names]
        tables = (cells.table, cells.nodes, cells.number[:, None])
        self._tables = [in_lanes(table) for table in tables]
        table, node, cell = (part.ctypes.data for part in self._tables)
        blocks = len(self._tables[0])
        self._fixed: dict[str, int] = {
            "blocks": blocks,
            "lanes_of_last": len(cells.nodes) - (blocks - 1) * LANES,
            "points": cells.shape.shape[0],
            "nodes": cells.shape.shape[1],
            "shape": cells.shape.ctypes.data,
            "table": table,
            "node": node,
            "cell": cell,
        }

    def part(self, take: Bools) -> PointCells:
        """The cells (c,) to ``take`` by themselves."""
        cells = self._cells
        rows = cells.nodes[take], cells.number[take], cells.table[take]
        return PointCells(self._section, Cells(*rows, cells.shape, cells.count), self.moduli)

    def _run(self, kernel: Kernel | None = None, symmetric: bool = False, **arrays: Any) -> bool:
        """Call the loop with what ``Work`` shall point to; False: a point is not valid."""
        return not self._call(ctypes.byref(self._work(kernel, symmetric, **arrays)))

    def _work(self, kernel: Kernel | None, symmetric: bool, **arrays: Any) -> _Work:
        for array in arrays.values():
            assert array.flags.c_contiguous
        # What is not set stays a null pointer, by which the loop knows what it is asked for.
        work = _Work(**self._fixed, symmetric=symmetric)
        for name, array in arrays.items():
            setattr(work, name, array.ctypes.data)
        if kernel is not None:
            work.width = arrays["state"].shape[1]
            work.update, work.material = kernel.function, ctypes.addressof(kernel.material)
            work.add, work.begin = kernel.moduli, kernel.begin
        return work

    def beside(self, u: Floats) -> Beside | None:
        """What adds the matrices at ``u`` (n,), m, in a loop over the same cells that goes on then.

        None where the points are not updated by a kernel.
        """
        of = self.moduli
        if of.kernel is None:
            return None
        found = Beside(*self._beside)
        found.points, found.symmetric = self._fixed["points"], of.kernel.symmetric
        found.arrays = {"u": u} | of.arrays()
        found.work = self._work(of.kernel, of.kernel.symmetric, **found.arrays)
        found.cells = ctypes.addressof(found.work)
        return found

    def evaluate(self, kernel: Kernel, u: Floats, state: Floats, **out: Floats) -> bool:
        """Update the points at ``u`` (n,), m, from ``state`` (k, s).

        Args:
            u: m.
            state: (k, s).
            out: what is written: end (k, s); or added to: energies (3,), J (J/m), stored,
                dissipated and the part of that due to the step's length; forces (n,), N (N/m).

        Returns:
            Whether all could be evaluated; where not, energies and forces are NaN.
        """
        return self._run(kernel, False, u=u, state=state, **out)

    def gradients(self, u: Floats, F: Floats) -> None:
        """Put the deformation gradients at ``u`` (n,), m, into ``F`` (k, p)."""
        self._run(u=u, F=F)

    def add_forces(self, u: Floats, P: Floats, forces: Floats) -> None:
        """Add the nodal forces of the stress ``P`` (k, p), Pa, to ``forces`` (n,), N (N/m)."""
        self._run(u=u, P=P, forces=forces)

    def add_tangent(
        self,
        u: Floats,
        values: Floats,
        starts: NDArray[np.int32],
        excess: Floats | None = None,
        beside: Beside | None = None,
    ) -> None:
        """See ``CompiledCells.add_tangent``; no volumetric part, and nothing beside."""
        assert starts.flags.c_contiguous and starts.dtype == np.int32
        assert starts.shape[:2] == self.nodes.shape
        of = self.moduli
        symmetric = of.kernel is not None and of.kernel.symmetric
        self._run(of.kernel, symmetric, u=u, values=values, start=starts, **of.arrays())
