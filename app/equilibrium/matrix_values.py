"""The values of an assembled matrix where they lie, to be changed in place.

petsc4py gives copies of them only, so PETSc's own library is asked.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.forms.native import library
from tribox.geometry.surfaces.facets import Floats, Ints

SOURCE = "cell_places.c"
_VALUES = ctypes.c_void_p, ctypes.POINTER(ctypes.POINTER(ctypes.c_double))
_PATTERN = ctypes.c_void_p, *3 * [ctypes.c_int32], *4 * [ctypes.c_void_p]
_SIGNATURES = {
    "MatSeqAIJGetArray": _VALUES,
    "MatSeqAIJRestoreArray": _VALUES,
    "MatGetRowIJ": _PATTERN,
    "MatRestoreRowIJ": _PATTERN,
    "MatMPIAIJGetSeqAIJ": [ctypes.c_void_p, *3 * [ctypes.POINTER(ctypes.c_void_p)]],
    "MatMPIBAIJGetSeqBAIJ": [ctypes.c_void_p, *3 * [ctypes.POINTER(ctypes.c_void_p)]],
    "MatGetSize": [ctypes.c_void_p, *2 * [ctypes.POINTER(ctypes.c_int32)]],
    "MatProductClear": [ctypes.c_void_p],
    "MatMultAdd": 4 * [ctypes.c_void_p],
    "MatMultTransposeAdd": 4 * [ctypes.c_void_p],
}
_NUMBERS = ctypes.POINTER(ctypes.c_int32)
_PLAIN = 0, 0, 0  # counted from zero, not made symmetric, not compressed
_DIRECT = {PETSc.Mat.Type.SEQAIJ, PETSc.Mat.Type.MPIAIJ}


@functools.cache
def _petsc() -> ctypes.CDLL | None:
    """The library that petsc4py has loaded; None where a function wanted is not found in it."""
    try:
        found = ctypes.CDLL(PETSc.__file__)  # a search there goes on in what it is linked to
        for name, kinds in _SIGNATURES.items():
            function = getattr(found, name)
            function.argtypes, function.restype = list(kinds), ctypes.c_int
    except (OSError, AttributeError):
        return None
    return found


def is_direct(A: PETSc.Mat) -> bool:
    """Whether `values_in_place` and `pattern_in_place` can be used with a matrix."""
    kinds = np.dtype(PETSc.ScalarType), np.dtype(PETSc.IntType)
    return kinds == (np.float64, np.int32) and A.getType() in _DIRECT and _petsc() is not None


def own_block(A: PETSc.Mat) -> PETSc.Mat:
    """The part of ``A`` with this rank's rows and columns, not a copy; on one rank all of it."""
    return A.getDiagonalBlock() if A.getType() == PETSc.Mat.Type.MPIAIJ else A


@contextmanager
def values_in_place(A: PETSc.Mat) -> Iterator[Floats]:
    """Within a ``with`` block the values of :func:`own_block`, in the order of its rows."""
    block = own_block(A)
    count = int(block.getInfo(PETSc.Mat.InfoType.LOCAL)["nz_used"])
    with _values_of_part(block.handle, count) as found:
        yield found


@contextmanager
def _values_of_part(part: int, count: int) -> Iterator[Floats]:
    """The same of PETSc's matrix ``part``, which is of this rank alone, with so many entries."""
    petsc, first = _petsc(), ctypes.POINTER(ctypes.c_double)()
    assert petsc is not None
    if petsc.MatSeqAIJGetArray(part, ctypes.byref(first)):
        raise PETSc.Error("the values of the matrix cannot be had")
    try:
        yield np.ctypeslib.as_array(first, shape=(count,)) if count else np.empty(0)
    finally:
        petsc.MatSeqAIJRestoreArray(part, ctypes.byref(first))


@contextmanager
def pattern_in_place(A: PETSc.Mat) -> Iterator[tuple[Ints, Ints]]:
    """Within a ``with`` block the pattern of :func:`own_block`: ends of rows, and columns."""
    with _pattern_of_part(own_block(A).handle) as found:
        yield found


@contextmanager
def _pattern_of_part(part: int) -> Iterator[tuple[Ints, Ints]]:
    """The same of PETSc's matrix ``part``, which is of this rank alone."""
    petsc = _petsc()
    assert petsc is not None and np.dtype(PETSc.IntType) == np.int32
    size, done = ctypes.c_int32(), ctypes.c_int()
    ends, columns = (ctypes.POINTER(ctypes.c_int32)() for _ in range(2))
    found = (*map(ctypes.byref, (size, ends, columns, done)),)
    if petsc.MatGetRowIJ(part, *_PLAIN, *found) or not done.value:
        raise PETSc.Error("the pattern of the matrix cannot be had")
    try:
        indptr = np.ctypeslib.as_array(ends, shape=(size.value + 1,))
        count = int(indptr[-1])
        yield indptr, np.ctypeslib.as_array(columns, (count,)) if count else np.empty(0, np.int32)
    finally:
        petsc.MatRestoreRowIJ(part, *_PLAIN, *found)


def columns_of_others(A: PETSc.Mat) -> tuple[int, Ints]:
    """The part of ``A`` with this rank's rows and others' columns, PETSc's, and these columns.

    Args:
        A: on several ranks, by entries or in blocks; columns are those of blocks.
    """
    petsc, of, size = _petsc(), ctypes.byref, ctypes.c_int32()
    own, other, columns = ctypes.c_void_p(), ctypes.c_void_p(), ctypes.c_void_p()
    assert petsc is not None
    in_blocks = A.getType() == PETSc.Mat.Type.MPIBAIJ
    parts = petsc.MatMPIBAIJGetSeqBAIJ if in_blocks else petsc.MatMPIAIJGetSeqAIJ
    if parts(A.handle, of(own), of(other), of(columns)) or petsc.MatGetSize(other, None, of(size)):
        raise PETSc.Error("the parts of the matrix cannot be had")
    count = size.value // (A.getBlockSize() if in_blocks else 1)
    first = ctypes.cast(columns, _NUMBERS)
    found = np.ctypeslib.as_array(first, (count,)).copy() if count else np.empty(0, np.int32)
    return int(other.value or 0), found


def add_product(part: int, x: PETSc.Vec, y: PETSc.Vec, transposed: bool = False) -> None:
    """Add what :func:`columns_of_others` has found, times ``x``, to ``y``."""
    petsc = _petsc()
    assert petsc is not None
    product = petsc.MatMultTransposeAdd if transposed else petsc.MatMultAdd
    if product(part, x.handle, y.handle, y.handle):
        raise PETSc.Error("a product failed")


def _parts_of(A: PETSc.Mat) -> list[int]:
    """PETSc's matrices of this rank's rows: its own columns, and on several ranks the others."""
    own = own_block(A).handle
    return [own] if A.comm.size == 1 else [own, columns_of_others(A)[0]]


class SharedEntries:
    """Entries that this rank adds to a matrix, whoever's rows they are in.

    PETSc sends what is added to others' rows with its places, and sorts it, each time. Here the
    owner looks places up once, and is sent values alone.
    """

    def __init__(self, A: PETSc.Mat, rows: Ints, columns: Ints) -> None:
        """Tell the owners of global rows (n,), ascending, and columns (n,); collective.

        Raises:
            RuntimeError: see :meth:`find`.
        """
        self._comm = A.comm.tompi4py()
        self._through_petsc = None if is_direct(A) else (rows, columns)
        # Where the values begin that each rank is given, and this one's own ones.
        self._begin = np.searchsorted(rows, A.getOwnershipRanges())
        self._own = slice(*self._begin[self._comm.rank : self._comm.rank + 2])
        self._given = np.diff(self._begin)
        self._given[self._comm.rank] = 0
        cuts = zip(self._begin, self._begin[:-1] + self._given, strict=False)
        parts = [slice(*cut) for cut in cuts]
        got = self._comm.alltoall([(rows[part], columns[part]) for part in parts])
        self._taken = np.array([len(row) for row, _ in got])
        row, column = (
            np.concatenate([own[self._own], *(one[k] for one in got)])
            for k, own in enumerate((rows, columns))
        )
        left, right = A.getOwnershipRangeColumn()
        mine = (column >= left) & (column < right)
        # Those of other ranks' columns are negative.
        self._row, self._column = (
            row - A.getOwnershipRange()[0],
            np.where(mine, column - left, ~column),
        )
        self.find(A)

    def find(self, A: PETSc.Mat) -> None:
        """Look the places up, in a matrix of the same rows; collective.

        Raises:
            RuntimeError: on every rank, where it has no room for an entry.
        """
        if self._through_petsc is not None:
            return
        search, there, column = library(SOURCE).tribox_entry_places, True, self._column
        search.argtypes, search.restype = [ctypes.c_int64, *[ctypes.c_void_p] * 7], ctypes.c_int
        parts = _parts_of(A)
        if len(parts) > 1:
            others, beyond, column = columns_of_others(A)[1], column < 0, column.copy()
            wanted = ~column[beyond]
            number = np.searchsorted(others, wanted)
            there = np.array_equal(np.append(others, -1)[number], wanted)
            column[beyond] = ~number
        self._places = np.empty_like(self._row)
        with ExitStack() as stack:
            patterns = [stack.enter_context(_pattern_of_part(part)) for part in parts]
            arrays = [*patterns[0], *patterns[-1], self._row, column, self._places]
            there &= bool(search(len(self._row), *(array.ctypes.data for array in arrays)))
            self._sizes = [len(columns) for _, columns in patterns]
        if not self._comm.allreduce(there, op=MPI.LAND):
            raise RuntimeError("cells: an entry of the tangent is not in the matrix's pattern")

    def add(self, A: PETSc.Mat, values: Floats) -> None:
        """Add values (n,) to them; collective."""
        if self._through_petsc is not None:
            rows, columns = self._through_petsc
            ends, add = np.arange(len(rows) + 1, dtype=PETSc.IntType), PETSc.InsertMode.ADD_VALUES
            A.setValuesIJV(ends, columns, values, addv=add, rowmap=rows)
            return
        got = np.empty(self._taken.sum())
        given = self._given, self._begin[:-1]
        self._comm.Alltoallv([values, given], [got, self._taken])
        put = library(SOURCE).tribox_add_entries
        put.argtypes, put.restype = [ctypes.c_int64, *[ctypes.c_void_p] * 4], None
        own = values[self._own]
        with ExitStack() as stack:
            of_parts = zip(_parts_of(A), self._sizes, strict=True)
            outs = [stack.enter_context(_values_of_part(*part)) for part in of_parts]
            for some, places in ((own, self._places[: len(own)]), (got, self._places[len(own) :])):
                arrays = places, some, outs[0], outs[-1]
                put(len(some), *(array.ctypes.data for array in arrays))


class PlacesOfPart:
    """Where the values of a part of a matrix, some of its rows and columns, lie in it.

    PETSc looks for them each time that it takes a part out, and cannot tell whether that has
    still the same entries where the matrix has more.

    Attributes:
        rows: of the part; found: whether the places are known.
    """

    def __init__(self, rows: Ints, columns: Ints) -> None:
        """Of owned local ``rows`` (r,) and ``columns`` (c,), ascending."""
        self.rows, self.found = np.ascontiguousarray(rows, np.int32), False
        self._columns = columns
        self._places: list[tuple[Ints, int]] = []

    def find(self, A: PETSc.Mat, part: PETSc.Mat) -> bool:
        """Look the places up; returns whether ``part`` has just the entries it should; collective.

        And that this can be told: of PETSc's kinds of matrices :func:`is_direct` knows some.
        """
        self.found, self._places = False, []
        if not is_direct(A):
            return False
        search = library(SOURCE).tribox_part_places
        search.argtypes, search.restype = [ctypes.c_int64, *[ctypes.c_void_p] * 8], ctypes.c_int
        fits = True
        for whole, mine, number, numbers in self._parts(A, part):
            with _pattern_of_part(whole) as outer, _pattern_of_part(mine) as inner:
                places = np.empty(len(inner[1]), np.int32)
                arrays = self.rows, *outer, number, *inner, numbers, places
                at = (None if one is None else one.ctypes.data for one in arrays)
                fits &= bool(search(len(self.rows), *at))
                self._places.append((places, len(outer[1])))
        self.found = bool(A.comm.tompi4py().allreduce(fits, op=MPI.LAND))
        return self.found

    def _parts(self, A: PETSc.Mat, part: PETSc.Mat) -> Iterator[tuple[int, int, Ints, Ints | None]]:
        """PETSc's matrices of this rank alone, and the numbers of columns in those of the part.

        Own columns are counted from the rank's first one; collective.
        """
        number = np.full(A.getLocalSize()[1], -1, np.int32)
        number[self._columns] = np.arange(len(self._columns))
        yield own_block(A).handle, own_block(part).handle, number, None
        if A.comm.size == 1:
            return
        (whole, columns), (mine, numbers) = columns_of_others(A), columns_of_others(part)
        everywhere, here = A.createVecRight(), PETSc.Vec().createSeq(len(columns))
        everywhere.array[:] = np.where(number < 0, -1, number + part.getOwnershipRangeColumn()[0])
        wanted = PETSc.IS().createGeneral(columns, comm=MPI.COMM_SELF)
        scatter = PETSc.Scatter().create(everywhere, wanted, here, None)
        scatter.scatter(everywhere, here)
        yield whole, mine, here.array.astype(np.int32), numbers
        for one in (scatter, wanted, everywhere, here):
            one.destroy()

    def take(self, A: PETSc.Mat, part: PETSc.Mat) -> None:
        """Put the values of ``A`` into ``part``."""
        take = library(SOURCE).tribox_take_entries
        take.argtypes, take.restype = [ctypes.c_int64, *[ctypes.c_void_p] * 3], None
        parts = zip(_parts_of(A), _parts_of(part), self._places, strict=True)
        for whole, mine, (places, count) in parts:
            with (
                _values_of_part(whole, count) as values,
                _values_of_part(mine, len(places)) as out,
            ):
                take(len(places), *(array.ctypes.data for array in (places, values, out)))
        part.stateIncrease()  # or a solver would keep its factors


def forget_products(matrices: Sequence[PETSc.Mat]) -> None:
    """Let go of what made matrices, if they are products: the factors, and what lies between.

    Products could then not be made again from other values. Collective.
    """
    petsc = _petsc()
    for matrix in matrices:
        if petsc is not None and petsc.MatProductClear(matrix.handle):
            raise PETSc.Error("a product cannot be let go of")
