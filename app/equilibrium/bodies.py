"""Forces, strain energy and tangent of all bodies.

Strain energies go through loops over cells (:mod:`tribox.forms.bodies.compiled_cells`), with those
of points that remember (:mod:`tribox.forms.bodies.point_cells`).
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.app.equilibrium.matrix_values import (
    SharedEntries,
    is_direct,
    pattern_in_place,
    values_in_place,
)
from tribox.forms.bodies.compiled_cells import compiled_cells
from tribox.forms.bodies.memory_solid import MemorySolid
from tribox.forms.bodies.point_cells import PointCells, add_tangent, parts
from tribox.forms.bodies.solid import Solid
from tribox.forms.native import library
from tribox.geometry.surfaces.facets import Bools, Floats, Ints

# -- Where the element matrices of a body go in the tangent's matrix -------------------------------
#
# PETSc looks up every row and column of an element matrix each time it is added, which takes longer
# than computing it. The places stay the same as long as the pattern of the matrix does: they are
# looked up once, and the values are added where they lie.
#
# Axis letters: c cells, a and b corners, i and j space.

SOURCE = "cell_places.c"
Places = NDArray[np.int32]


class CellPlaces:
    """The places of a body's element matrices in a matrix of one pattern and one numbering.

    Most cells are `inside`: all rows are this rank's own, and so are the columns. The others (with
    nodes of other ranks, or of platens, whose unknowns are sent to their leaders) are few; their
    values are summed up here, and sent to the ranks whose rows they are in.

    Attributes:
        inside: (c,) whether all values of a cell are in :func:`own_block`.
        starts: (cells inside, a, i, b) int32, place among the values of that block of the first of
            the values in the row of (a, i) and the columns of (b, j); the others follow it.
        dense: the same for the cells that are not inside, in an array (cells outside, a, i, b, j).
        ends: of the rows of that block.
    """

    def __init__(
        self, A: PETSc.Mat, nodes: Ints, dim: int, before: CellPlaces | None = None
    ) -> None:
        """Look the places up; collective.

        Args:
            nodes: (c, a) local nodes of the cells, ghosts included.
            before: the places of the same cells in a narrower pattern, which are overwritten.
        """
        unknowns = nodes[..., None].astype(np.int64) * dim + np.arange(dim)
        # By the matrix's own map, in which a platen's unknowns have the number of their leader.
        numbers = A.getLGMap()[0].indices[unknowns].astype(np.int64)
        first, end = A.getOwnershipRange()
        direct = is_direct(A)
        mine = (numbers >= first) & (numbers < end) & direct
        in_order = numbers == numbers[..., :1] + np.arange(dim)
        self.inside: Bools = np.all(mine & in_order, axis=(1, 2))
        own = (numbers[self.inside] - first).astype(np.int32)
        self.starts: Places = np.empty((*own.shape, own.shape[1]), np.int32)
        self.ends: Ints = np.zeros(1, np.int32)
        if direct:
            there = self._look_up(A, own, before)
        if direct and not np.all(there):  # an error, which `SharedEntries` tells on every rank
            self.inside[np.nonzero(self.inside)[0][~there]] = False
            self.starts = np.ascontiguousarray(self.starts[there])
        outside = numbers[~self.inside]
        same = before is not None and np.array_equal(before._outside.unknowns, outside)
        if before is not None and A.comm.tompi4py().allreduce(same, op=MPI.LAND):
            self._outside: _Sums = before._outside
            self._outside.entries.find(A)
        else:
            self._outside = _Sums(A, outside)
        count, corners = np.count_nonzero(~self.inside), nodes.shape[1]
        shape = (count, corners, dim, corners)
        self.dense: Places = dim * np.arange(np.prod(shape), dtype=np.int32).reshape(shape)

    def _look_up(
        self, A: PETSc.Mat, unknowns: NDArray[np.int32], before: CellPlaces | None
    ) -> Bools:
        """Find the `starts` of cells with rows (c, a, i); whether they have all columns (c,)."""
        there = np.empty(len(unknowns), dtype=bool)
        search = library(SOURCE).tribox_cell_places
        search.argtypes = [ctypes.c_int64, ctypes.c_int, ctypes.c_int, *[ctypes.c_void_p] * 6]
        search.restype = None
        ends = None
        with pattern_in_place(A) as (indptr, columns):
            self.ends = indptr.copy()
            if before is not None and before.starts.shape == self.starts.shape:
                self.starts, ends = before.starts, before.ends.ctypes.data
                assert len(before.ends) == len(self.ends), "a matrix of other rows"
            arrays = (array.ctypes.data for array in (unknowns, self.starts, there))
            search(*unknowns.shape, indptr.ctypes.data, columns.ctypes.data, ends, *arrays)
        return there

    @contextmanager
    def values(self, A: PETSc.Mat) -> Iterator[Floats]:
        """Within a ``with`` block the values of ``A`` that `starts` are places in.

        Raises:
            ValueError: the matrix has another pattern than the one the places are for.
        """
        with values_in_place(A) as values:
            if len(values) != self.ends[-1]:
                raise ValueError(f"{len(values)} values in a matrix, places for {self.ends[-1]}")
            yield values

    def add_outside(self, A: PETSc.Mat, matrices: Floats) -> None:
        """Add the element matrices (cells outside, a, i, b, j) that are not inside; collective."""
        self._outside.add(A, matrices)


class _Sums:
    """Element matrices summed by row and column, whoever's the rows are.

    Attributes:
        unknowns: (c, a, i), global, of the cells.
        entries: where the sums go.
    """

    def __init__(self, A: PETSc.Mat, unknowns: NDArray[np.int64]) -> None:
        """Find the distinct entries of the cells in a matrix; collective."""
        self.unknowns = unknowns
        at = unknowns.reshape(len(unknowns), np.prod(unknowns.shape[1:]))
        distinct, number = np.unique(at, return_inverse=True)
        number = number.reshape(at.shape)
        width = max(len(distinct), 1)
        # One number for each pair of unknowns of a cell: equal ones are one entry of the matrix.
        pairs = number[:, :, None] * width + number[:, None, :]
        entries, entry = np.unique(pairs, return_inverse=True)
        self._entry = entry.reshape(-1).astype(np.int32)
        distinct, self._count = distinct.astype(PETSc.IntType), len(entries)
        self.entries = SharedEntries(A, *(distinct[one] for one in np.divmod(entries, width)))

    def add(self, A: PETSc.Mat, matrices: Floats) -> None:
        """Add element matrices (c, …) of the cells; collective."""
        sums: NDArray[Any] = np.bincount(self._entry, matrices.reshape(-1), self._count)
        self.entries.add(A, sums)


@dataclass(slots=True)
class _Placed:
    """Loops over the cells of a body, with the places of these in a matrix of one pattern."""

    pattern: object
    places: CellPlaces
    loops: list[PointCells]
    outside: list[PointCells]  # of the few cells that are not inside alone


class Bodies:
    """All bodies at the present displacement.

    Attributes:
        solids: the bodies; cells: the loop over the cells of each.
    """

    def __init__(self, u: dolfinx.fem.Function, solids: Sequence[Solid]) -> None:
        """Set up the loop over the cells of each body; ``u``: displacement, m."""
        self.solids = list(solids)
        self._u, self._dim = u, u.function_space.dofmap.index_map_bs
        self.cells = [compiled_cells(u.function_space, solid) for solid in solids]
        self._placed: dict[int, _Placed] = {}

    def evaluate(self, u: Floats, out: Floats, dt: float | None = math.inf) -> bool:
        """Put the nodal forces (n,), N per unit thickness, at ``u`` (m) into ``out``.

        Args:
            u: local unknowns, ghosts included; what the displacement is now stays.
            out: of the same shape; ghosts get this rank's share.
            dt: s, time step, infinite where rates do not count; None: forces of bodies that do not
                flow on, for their elastic stiffness.

        Returns:
            False where a cell of this rank is turned inside out.
        """
        out[:] = 0.0
        values, before = self._u.x.array, None
        if u.ctypes.data != values.ctypes.data:
            before = values.copy()
            values[:] = u
        try:
            valid = [s.evaluate_elastic() if dt is None else s.evaluate(dt) for s in self.solids]
            return self.add_forces(out) and all(valid)
        finally:
            if before is not None:
                values[:] = before

    def add_forces(self, out: Floats) -> bool:
        """Add the nodal forces (n,), N per unit thickness, of this rank's cells.

        Where a material cannot be evaluated they are NaN. Materials that remember must have been
        evaluated before. Returns False where a cell is turned inside out.
        """
        u, valid = self._u.x.array, True
        for solid, cells in zip(self.solids, self.cells, strict=True):
            if cells is not None:
                valid &= cells.add(u, out)
            solid.add_point_forces(out)
        return valid and (None not in self.cells or bool(np.isfinite(out.sum())))

    def strain_energy(self) -> float:
        """This rank's strain energy, J per unit thickness; not finite where a cell is inverted."""
        return sum(self.strain_energies())

    def strain_energies(self) -> list[float]:
        """The same of each body."""
        return [
            (0.0 if cells is None else cells.energy(self._u.x.array)) + solid.point_energy()
            for solid, cells in zip(self.solids, self.cells, strict=True)
        ]

    def add_tangent(self, A: PETSc.Mat, index: int, pattern: object, carried: bool) -> None:
        """Add the tangent of one solid; collective."""
        solid, cells = self.solids[index], self.cells[index]
        carrier = solid.carried if carried else None
        loops = [] if cells is None else list(cells.tangent_loops(self._u.x.array))
        if isinstance(solid, MemorySolid):
            loops.append(solid.point_cells)
        known = self._placed.get(index)
        if known is None or known.pattern != pattern:
            known = self._placed[index] = self._found(A, loops, pattern, known)
        self._add_cells(A, known, None if carrier is None else carrier.excess())

    def add_elastic_tangent(self, A: PETSc.Mat, index: int) -> None:
        """Add the tangent of the strain energy of one solid to a matrix that is made once."""
        cells = self.cells[index]
        if cells is not None:
            self._add_cells(A, self._found(A, cells.tangent_loops(self._u.x.array)), None)

    def _found(
        self,
        A: PETSc.Mat,
        loops: list[PointCells],
        pattern: object = None,
        known: _Placed | None = None,
    ) -> _Placed:
        """Loops with their places, looked up, more quickly beside those of another pattern."""
        before = None if known is None else known.places
        places = CellPlaces(A, loops[0].nodes, self._dim, before)
        inside = places.inside
        if known is not None and before is not None and np.array_equal(inside, before.inside):
            return replace(known, pattern=pattern, places=places)
        return _Placed(pattern, places, loops, parts(loops, ~inside))

    def _add_cells(self, A: PETSc.Mat, placed: _Placed, excess: Floats | None) -> None:
        """Add the matrices of cells."""
        u, places = self._u.x.array, placed.places
        if len(places.starts):
            with places.values(A) as values:
                add_tangent(placed.loops, u, values, places.starts, excess, places.inside)
        matrices = np.zeros((*places.dense.shape, self._dim))
        if len(places.dense):
            add_tangent(placed.outside, u, matrices, places.dense, excess)
        places.add_outside(A, matrices)
