"""Cells of any kind by a compiled loop over their material points, several cells at a time.

The loop takes a cell from its displacements to its forces or its matrix: deformation gradients at
its points, stress and moduli by the kernel of the material, and the contraction with the gradients
of the nodes' functions, without arrays between them. Points that remember but have no kernel are
updated in Python, between two passes of the same loop.

Axis letters: c cells, a and b nodes, q points of a cell, k = (c, q) points of the body, i and j
space, p components of F and P, s values of a point's state; n local unknowns, ghosts included.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import basix
import dolfinx
import numpy as np
from numpy.typing import NDArray

from tribox.forms.bodies.deformation import centre_rows, quadrature_rows, ring_volume
from tribox.forms.bodies.kinematics import Section
from tribox.forms.bodies.point_state import CELLS, Kernel
from tribox.forms.native import library
from tribox.geometry.meshes.places import centre, shape_functions
from tribox.geometry.surfaces.facets import Bools, Floats, Ints

PAIRS = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2)]  # of the C sources
PIECE = 4096  # cells that tables are made of at a time: a multiple of `lanes`
NAMES: dict[Section, str] = {"plane-strain": "strain", "axisymmetric": "ring", "3D": "space"}


@functools.cache
def lanes() -> int:
    """Cells that the compiled loops take at a time, as many as the processor has in a register."""
    count = library(CELLS).tribox_lanes
    count.restype = ctypes.c_int64
    return int(count())


def in_lanes(table: NDArray[Any]) -> NDArray[Any]:
    """Rows (c, k) of the cells as (blocks, k, lanes), the last cell repeated to fill the last."""
    missing = -len(table) % lanes()
    padded = np.concatenate([table, table[-1:].repeat(missing, axis=0)])
    return np.ascontiguousarray(padded.reshape(-1, lanes(), table.shape[1]).transpose(0, 2, 1))


@dataclass(slots=True)
class Moduli:
    """Where the moduli of the tangent come from: a kernel and the state it starts at, or arrays."""

    kernel: Kernel | None = None  # None: ``A`` is given
    state: Floats | None = None  # (k, s); None: points that remember nothing
    # (k, s), what the kernel has made of the state before; None: that is found anew
    end: Floats | None = None
    A: Floats | None = None  # (k, m), Pa, see `moduli_in_place`

    def arrays(self) -> dict[str, Floats]:
        """What the loop reads."""
        if self.kernel is None:
            assert self.A is not None, "the points have not been evaluated for a tangent"
            return {"A": self.A}
        known = {"state": self.state, "end": self.end}
        return {name: array for name, array in known.items() if array is not None}


def moduli_in_place(F: Floats, P: Floats, A: Floats) -> Floats:
    """Moduli (k, m) as kernels give them (``MODULI`` of ``point_lanes.h``), τ and then c, Pa.

    Of F (k, p), first Piola stress P (k, p), Pa, and A = ∂P/∂F (k, p, p), Pa.
    """
    count, components = F.shape
    at = [0, 1, 3, 4, 8] if components == 5 else list(range(9))
    pairs = PAIRS[:4] if components == 5 else PAIRS
    rows, columns = (list(ends) for ends in zip(*pairs, strict=True))
    wide, slope = np.zeros((2, count, 9)), np.zeros((count, 9, 9))
    wide[:, :, at], slope[:, np.array(at)[:, None], at] = (F, P), A
    f, stress = wide.reshape(2, count, 3, 3)
    tau = np.einsum("niJ,njJ->nij", stress, f)
    c = np.einsum("niJkL,njJ,nlL->nijkl", slope.reshape(count, 3, 3, 3, 3), f, f, optimize=True)
    c -= np.einsum("ik,njl->nijkl", np.eye(3), tau)
    c = c[:, rows, columns][:, :, rows, columns]
    return np.column_stack([tau[:, rows, columns], c.reshape(count, -1)])


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
                "parents",
                "width",
                "read",
                "symmetric",
            )
        ),
        *((name, ctypes.c_void_p) for name in ("shape", "table", "node", "cell", "u")),
        *((name, ctypes.c_void_p) for name in ("update", "material", "state")),
        *((name, ctypes.c_void_p) for name in ("P", "A", "F", "end", "energies")),
        *((name, ctypes.c_void_p) for name in ("forces", "values", "start", "take", "excess")),
        *((name, ctypes.c_void_p) for name in ("same", "next")),
    )


@dataclass(frozen=True, slots=True)
class Cells:
    """What the loop is told of cells, in the order of a body."""

    nodes: Ints  # (c, a) local nodes
    number: Ints  # (c,) of each cell in the body
    # (c, q·(dim z + 2)) in lanes: of each point the shares (z, j), 1/m, of the slopes in the
    # gradients, its weight, m² or m³, and in rings 1/x
    table: Floats
    # (q, a, 1 + z) functions of the nodes and their slopes in the reference cell
    shape: Floats
    centre: bool = False  # whether the points are the centres, of the volumetric energy

    @property
    def count(self) -> int:
        """Number of all points."""
        return len(self.nodes) * len(self.shape)

    @property
    def weights(self) -> Floats:
        """Weights (k,) of the points, m² or m³, of whole rings."""
        blocks, points = len(self.table), len(self.shape)
        rows = self.table.reshape(blocks, points, self.table.shape[1] // points, lanes())[:, :, -2]
        return np.ascontiguousarray(rows.transpose(0, 2, 1)).reshape(-1)[: self.count]

    def part(self, take: Bools) -> Cells:
        """The cells (c,) to ``take`` by themselves."""
        at = np.nonzero(take)[0]
        rows = self.table[at // lanes(), :, at % lanes()]
        return replace(self, nodes=self.nodes[at], number=self.number[at], table=in_lanes(rows))


def cells_of(space: dolfinx.fem.FunctionSpace, section: Section, cells: Ints, degree: int) -> Cells:
    """The cells (c,), local, with the points of a quadrature."""
    kind = space.mesh.topology.cell_name()
    points, _ = basix.make_quadrature(basix.CellType[kind], degree)

    shape = shape_functions(kind, space.element.basix_element.degree, 1, points)
    size = points.shape[1] ** 2
    table = np.empty((-(-len(cells) // lanes()), len(points) * (size + 2), lanes()))
    for at in range(0, len(cells), PIECE):  # what numpy makes on the way is many times as large
        piece = cells[at : at + PIECE]
        rows, weight = quadrature_rows(space, section, piece, degree)
        parts = [
            np.column_stack([one.inverse.reshape(len(piece), size), volume, one.across])
            for one, volume in zip(rows, weight, strict=True)
        ]
        block, filled = at // lanes(), in_lanes(np.concatenate(parts, axis=1))
        table[block : block + len(filled)] = filled
    return _cells(space, cells, table, shape)


def _cells(space: dolfinx.fem.FunctionSpace, cells: Ints, table: Floats, shape: Floats) -> Cells:
    """Of a table in lanes, and of functions and slopes (z, q, a)."""
    nodes = np.asarray(space.dofmap.list, dtype=np.int32)[cells]
    shape = np.ascontiguousarray(shape.transpose(1, 2, 0))
    return Cells(nodes, np.arange(len(cells), dtype=np.int32), table, shape)


def centres_of(space: dolfinx.fem.FunctionSpace, section: Section, cells: Ints) -> Cells:
    """The centres of first-order cells (c,), where ``q1-sri`` takes the volumetric energy."""
    if section != "axisymmetric":
        return replace(cells_of(space, section, cells, 1), centre=True)
    # A ring's gradients are those at the centroid of its volume: slopes at the centre and the mixed
    # second derivative have shares in them.
    kind, rows = space.mesh.topology.cell_name(), centre_rows(space, section, cells)
    # The order of basix: N, N_ξ, N_η, N_ξξ, N_ξη, N_ηη.
    shape = shape_functions(kind, 1, 2, centre(kind))[[0, 1, 2, 4]]
    share = np.linalg.pinv(shape[1:, 0].T) @ rows.gradients
    volume = ring_volume(rows, section)
    table = np.column_stack([share.reshape(len(cells), 6), volume, rows.across])
    return replace(_cells(space, cells, in_lanes(table), shape), centre=True)


class PointCells:
    """Points of owned cells of a body.

    Attributes:
        cells: them; nodes: (c, a) local nodes of each; moduli: what the tangent is made from.
    """

    def __init__(self, section: Section, cells: Cells, moduli: Moduli | None = None) -> None:
        self.section, self.cells, self.nodes = section, cells, cells.nodes
        self.moduli = Moduli() if moduli is None else moduli
        self._call = getattr(library(CELLS), f"tribox_point_cells_{NAMES[section]}")
        self._call.argtypes, self._call.restype = [ctypes.c_void_p], ctypes.c_int64
        self._lanes = [in_lanes(rows) for rows in (cells.nodes, cells.number[:, None])]
        node, cell = (rows.ctypes.data for rows in self._lanes)
        blocks, (points, nodes, shapes) = len(cells.table), cells.shape.shape
        self._fixed: dict[str, int] = {
            "blocks": blocks,
            "lanes_of_last": len(cells.nodes) - (blocks - 1) * lanes(),
            "points": points,
            "nodes": nodes,
            "parents": shapes - 1,
            "shape": cells.shape.ctypes.data,
            "table": cells.table.ctypes.data,
            "node": node,
            "cell": cell,
        }

    def _run(self, kernel: Kernel | None = None, **arrays: Any) -> bool:
        """Call the loop with what ``Work`` shall point to; False: a point is not valid."""
        return self.run([self.work(kernel, **arrays)])

    def run(self, works: Sequence[_Work]) -> bool:
        """Call the loop over the points of all ``works``, of the same cells; see :meth:`_run`."""
        heads: dict[int, _Work] = {}
        last: _Work | None = None
        for work in works:
            # Matrices of points at the same places are added up; forces and energies are not.
            if works[0].values and (head := heads.get(work.shape)) is not None:
                work.same, head.same = head.same, ctypes.addressof(work)
                continue
            heads[work.shape] = work
            if last is not None:
                last.next = ctypes.addressof(work)
            last = work
        return not self._call(ctypes.byref(works[0]))

    def work(self, kernel: Kernel | None = None, **arrays: Any) -> _Work:
        """What the loop is told of these points."""
        # What is not set stays a null pointer, by which the loop knows what it is asked for.
        work = _Work(**self._fixed)
        for name, array in arrays.items():
            assert array.flags.c_contiguous
            setattr(work, name, array.ctypes.data)
        if kernel is not None:
            work.update, work.material = kernel.function, ctypes.addressof(kernel.material)
            work.width = arrays["state"].shape[1] if "state" in arrays else 0
            work.symmetric, work.read = kernel.symmetric, kernel.read or work.width
        return work

    def evaluate(self, kernel: Kernel, u: Floats, state: Floats, **out: Floats) -> bool:
        """Update points at ``u`` (n,), m, from ``state`` (k, s) into ``out``; whether all could be.

        Its end (k, s) is written, energies (3,), J (J/m), stored, dissipated and by step length,
        and forces (n,), N (N/m), added to; they are NaN where not.
        """
        return self._run(kernel, u=u, state=state, **out)

    def deformation(self, u: Floats) -> Floats:
        """The deformation gradients (k, p) at ``u`` (n,), m."""
        F = np.empty((self.cells.count, 9 if self.section == "3D" else 5))
        self._run(u=u, F=F)
        return F

    def dilatation(self, u: Floats) -> tuple[Floats, Floats]:
        """Log of J (c,) at centres of cells in space, and slopes (c, a·i), 1/m, at u (n,), m."""
        cells, F = self.cells, self.deformation(u).reshape(-1, 3, 3)
        table = cells.table.transpose(0, 2, 1).reshape(-1, cells.table.shape[1])[: cells.count]
        # The gradients of the nodes' functions, carried over to the present place.
        carried = table[:, :9].reshape(-1, 3, 3) @ np.linalg.inv(F)
        slopes: Floats = np.einsum("az,czj->caj", cells.shape[0, :, 1:], carried)
        return np.log(np.linalg.det(F)), slopes.reshape(cells.count, -1)

    def add_forces(self, u: Floats, P: Floats, forces: Floats) -> None:
        """Add the nodal forces of the stress ``P`` (k, p), Pa, to ``forces`` (n,), N (N/m)."""
        self._run(u=u, P=P, forces=forces)


def parts(loops: Sequence[PointCells], take: Bools) -> list[PointCells]:
    """The cells (c,) to ``take``, of loops over points of the same cells."""
    if take.all():
        return list(loops)
    found = {id(loop.cells): loop.cells.part(take) for loop in loops}
    return [PointCells(loop.section, found[id(loop.cells)], loop.moduli) for loop in loops]


def add_tangent(
    loops: Sequence[PointCells],
    u: Floats,
    values: Floats,
    starts: NDArray[np.int32],
    excess: Floats | None = None,
    take: Bools | None = None,
) -> None:
    """Add the element matrices at ``u`` (n,), N/m per unit thickness, of points of the same cells.

    Args:
        loops: one at least.
        u: m.
        values: of a sparse matrix, changed.
        starts: (c, a, i, b), contiguous, from where on in ``values`` the dim numbers of the row (a,
            i) and the columns (b, j) are.
        excess: by cell of the body, Pa, added to the volumetric pressures at the centres
            (:mod:`tribox.forms.bodies.solid`).
        take: which cells alone are added, those that there are starts of; None: all.
    """
    take = np.ones(len(loops[0].nodes), dtype=bool) if take is None else take
    assert starts.flags.c_contiguous and starts.dtype == np.int32
    assert starts.shape[:2] == (np.count_nonzero(take), loops[0].nodes.shape[1])
    works, kept = [], None if excess is None else np.ascontiguousarray(excess)
    for loop in loops:
        of = loop.moduli
        works.append(loop.work(of.kernel, u=u, **of.arrays()))
        if loop.cells.centre and kept is not None:
            works[-1].excess = kept.ctypes.data
    first = works[0]
    first.values, first.start = values.ctypes.data, starts.ctypes.data
    first.take = take.ctypes.data
    loops[0].run(works)
