"""Where the element matrices of a body go in the tangent's matrix.

PETSc looks up every row and column of an element matrix each time it is added, which takes longer
than computing it. The places stay the same as long as the pattern of the matrix does: they are
looked up once, and the values are added where they lie.

Axis letters: c cells, a and b corners, i and j space.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from app.equilibrium.matrix_values import own_block, values_in_place
from geometry.surfaces.facets import Bools, Floats, Ints

Places = NDArray[np.int32]


class CellPlaces:
    """The places of a body's element matrices in a matrix of one pattern and one numbering.

    Most cells are `inside`: all rows are this rank's own, and so are the columns. The others (with
    nodes of other ranks, or of platens, whose unknowns are sent to their leaders) are few; their
    values are summed up here and go through PETSc.

    Attributes:
        inside: (c,) whether all values of a cell are in :func:`own_block`.
        starts: (cells inside, a, i, b) int32, place among the values of that block of the first of
            the values in the row of (a, i) and the columns of (b, j); the others follow it.
        dense: the same for the cells that are not inside, in an array (cells outside, a, i, b, j).
    """

    def __init__(self, A: PETSc.Mat, nodes: Ints, dim: int) -> None:
        """Look the places up; not collective.

        Args:
            A: the matrix, assembled, with the local to global map that is to be used.
            nodes: (c, a) local nodes of the cells, ghosts included.
            dim: unknowns per node.
        """
        unknowns = nodes[..., None].astype(np.int64) * dim + np.arange(dim)
        numbers = A.getLGMap()[0].indices[unknowns].astype(np.int64)
        first, end = A.getOwnershipRange()
        mine = (numbers >= first) & (numbers < end)
        in_order = numbers == numbers[..., :1] + np.arange(dim)
        self.inside: Bools = np.all(mine & in_order, axis=(1, 2))
        indptr, columns = own_block(A).getRowIJ()
        own = numbers[self.inside] - first
        self.starts, there = _starts(indptr, columns, own)
        if not np.all(there):  # nothing that is ours: PETSc says what is missing
            self.inside[np.nonzero(self.inside)[0][~there]] = False
            self.starts = np.ascontiguousarray(self.starts[there])
        self._outside = _Sums(numbers[~self.inside])
        count, corners = np.count_nonzero(~self.inside), nodes.shape[1]
        shape = (count, corners, dim, corners)
        self.dense: Places = dim * np.arange(np.prod(shape), dtype=np.int32).reshape(shape)

    def add(self, A: PETSc.Mat, matrices: Floats) -> None:
        """Add element matrices (c, a, i, b, j) of all cells; not collective.

        This is what a compiled loop does at once: `starts` and `dense` are made for those.
        """
        dim = matrices.shape[-1]
        with values_in_place(A) as values:
            places = self.starts[..., None] + np.arange(dim)
            values += np.bincount(
                places.reshape(-1), matrices[self.inside].reshape(-1), minlength=len(values)
            )
        self.add_outside(A, matrices[~self.inside])

    def add_outside(self, A: PETSc.Mat, matrices: Floats) -> None:
        """Add the element matrices (cells outside, a, i, b, j) that are not inside."""
        self._outside.add(A, matrices)


def _starts(indptr: Ints, columns: Ints, unknowns: NDArray[np.int64]) -> tuple[Places, Bools]:
    """Places (c, a, i, b) of the columns (b, 0) in the rows (a, i), and cells that have them all.

    Args:
        indptr: ends of the rows of the pattern.
        columns: its columns, in each row in ascending order.
        unknowns: (c, a, i) rows, which are the columns too.
    """
    width, dim = len(indptr), unknowns.shape[-1]
    keys = np.repeat(np.arange(width - 1, dtype=np.int64), np.diff(indptr)) * width + columns
    wanted = unknowns[:, :, :, None] * width + unknowns[:, None, None, :, 0]
    found = np.searchsorted(keys, wanted)
    there = np.append(keys, np.full(dim, -1))[found[..., None] + np.arange(dim)]
    whole = np.all(there == wanted[..., None] + np.arange(dim), axis=(1, 2, 3, 4))
    return found.astype(np.int32), whole


class _Sums:
    """Element matrices summed by row and column and given to PETSc, whoever's the rows are."""

    def __init__(self, unknowns: NDArray[np.int64]) -> None:
        """Find the distinct entries of the cells' global ``unknowns`` (c, a, i)."""
        at = unknowns.reshape(len(unknowns), np.prod(unknowns.shape[1:]))
        distinct, number = np.unique(at, return_inverse=True)
        number = number.reshape(at.shape)
        width = max(len(distinct), 1)
        pairs = number[:, :, None] * width + number[:, None, :]
        entries, self._entry = np.unique(pairs, return_inverse=True)
        row, column = np.divmod(entries, width)
        counts = np.bincount(row, minlength=len(distinct))
        self._indptr = np.append(0, np.cumsum(counts)).astype(PETSc.IntType)
        self._rows = distinct.astype(PETSc.IntType)
        self._columns = distinct[column].astype(PETSc.IntType)

    def add(self, A: PETSc.Mat, matrices: Floats) -> None:
        """Add element matrices (c, …) of the cells."""
        if len(self._rows):
            sums = np.bincount(self._entry.reshape(-1), matrices.reshape(-1), len(self._columns))
            add = PETSc.InsertMode.ADD_VALUES
            A.setValuesIJV(self._indptr, self._columns, sums, addv=add, rowmap=self._rows)
