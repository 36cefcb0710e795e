"""The values of an assembled matrix where they lie, to be changed in place.

petsc4py gives copies of them only, so PETSc's own library is asked.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from petsc4py import PETSc

from tribox.geometry.surfaces.facets import Floats, Ints

_VALUES = ctypes.c_void_p, ctypes.POINTER(ctypes.POINTER(ctypes.c_double))
_PATTERN = ctypes.c_void_p, *3 * [ctypes.c_int32], *4 * [ctypes.c_void_p]
_SIGNATURES = {
    "MatSeqAIJGetArray": _VALUES,
    "MatSeqAIJRestoreArray": _VALUES,
    "MatSeqBAIJGetArray": _VALUES,
    "MatSeqBAIJRestoreArray": _VALUES,
    "MatGetRowIJ": _PATTERN,
    "MatRestoreRowIJ": _PATTERN,
    "MatMPIBAIJGetSeqBAIJ": [ctypes.c_void_p, *3 * [ctypes.POINTER(ctypes.c_void_p)]],
    "MatGetSize": [ctypes.c_void_p, *2 * [ctypes.POINTER(ctypes.c_int32)]],
    "MatMultAdd": 4 * [ctypes.c_void_p],
}
_NUMBERS = ctypes.POINTER(ctypes.c_int32)
_PLAIN = 0, 0, 0  # counted from zero, not made symmetric, not compressed
_BLOCKS = 0, 0, 1  # rows and columns of blocks
_DIRECT = {PETSc.Mat.Type.SEQAIJ, PETSc.Mat.Type.MPIAIJ}


def petsc_library(signatures: Mapping[str, Sequence[Any]]) -> ctypes.CDLL | None:
    """The library that petsc4py has loaded; None where a function wanted is not found in it."""
    try:
        found = ctypes.CDLL(PETSc.__file__)  # a search there goes on in what it is linked to
        for name, kinds in signatures.items():
            function = getattr(found, name)
            function.argtypes, function.restype = list(kinds), ctypes.c_int
    except (OSError, AttributeError):
        return None
    return found


@functools.cache
def _petsc() -> ctypes.CDLL | None:
    """PETSc's library; None where the functions needed are not found in it."""
    return petsc_library(_SIGNATURES)


def is_direct(A: PETSc.Mat) -> bool:
    """Whether `values_in_place` can be used with a matrix."""
    real = np.dtype(PETSc.ScalarType) == np.float64
    return real and A.getType() in _DIRECT and _petsc() is not None


def own_block(A: PETSc.Mat) -> PETSc.Mat:
    """The part of ``A`` with this rank's rows and columns, not a copy; on one rank all of it."""
    return A.getDiagonalBlock() if A.getType() == PETSc.Mat.Type.MPIAIJ else A


@contextmanager
def values_in_place(A: PETSc.Mat) -> Iterator[Floats]:
    """Within a ``with`` block the values of :func:`own_block`, in the order of its rows."""
    petsc, block, first = _petsc(), own_block(A), ctypes.POINTER(ctypes.c_double)()
    assert petsc is not None
    if petsc.MatSeqAIJGetArray(block.handle, ctypes.byref(first)):
        raise PETSc.Error("the values of the matrix cannot be had")
    count = int(block.getInfo(PETSc.Mat.InfoType.LOCAL)["nz_used"])
    try:
        yield np.ctypeslib.as_array(first, shape=(count,)) if count else np.empty(0)
    finally:
        petsc.MatSeqAIJRestoreArray(block.handle, ctypes.byref(first))


@contextmanager
def pattern_in_place(A: PETSc.Mat) -> Iterator[tuple[Ints, Ints]]:
    """Within a ``with`` block the pattern of :func:`own_block`: ends of rows, and columns."""
    with _pattern(own_block(A), _PLAIN) as found:
        yield found


@contextmanager
def blocks_in_place(A: PETSc.Mat) -> Iterator[tuple[Ints, Ints, Floats]]:
    """Within a ``with`` block this rank's own blocks of ``A``: ends of rows, columns, values.

    Args:
        A: in blocks (BAIJ), assembled, with numbers of 32 bits; values of a block go by columns.
    """
    petsc, block, first = _petsc(), A, ctypes.POINTER(ctypes.c_double)()
    if A.getType() == PETSc.Mat.Type.MPIBAIJ:
        block = A.getDiagonalBlock()
    assert petsc is not None
    if petsc.MatSeqBAIJGetArray(block.handle, ctypes.byref(first)):
        raise PETSc.Error("the values of the matrix cannot be had")
    try:
        with _pattern(block, _BLOCKS) as (indptr, indices):
            count = len(indices) * A.getBlockSize() ** 2
            values = np.ctypeslib.as_array(first, shape=(count,)) if count else np.empty(0)
            yield indptr, indices, values
    finally:
        petsc.MatSeqBAIJRestoreArray(block.handle, ctypes.byref(first))


def columns_of_others(A: PETSc.Mat) -> tuple[int, Ints]:
    """The part of ``A`` with this rank's rows and others' columns, PETSc's, and these columns.

    Args:
        A: in blocks, on several ranks; columns are those of blocks.
    """
    petsc, of, size = _petsc(), ctypes.byref, ctypes.c_int32()
    own, other, columns = ctypes.c_void_p(), ctypes.c_void_p(), ctypes.c_void_p()
    assert petsc is not None
    if petsc.MatMPIBAIJGetSeqBAIJ(A.handle, of(own), of(other), of(columns)) or petsc.MatGetSize(
        other, None, of(size)
    ):
        raise PETSc.Error("the parts of the matrix cannot be had")
    count, first = size.value // A.getBlockSize(), ctypes.cast(columns, _NUMBERS)
    found = np.ctypeslib.as_array(first, (count,)).copy() if count else np.empty(0, np.int32)
    return int(other.value or 0), found


def add_product(part: int, x: PETSc.Vec, y: PETSc.Vec) -> None:
    """Add what :func:`columns_of_others` has found, times ``x``, to ``y``."""
    petsc = _petsc()
    assert petsc is not None
    if petsc.MatMultAdd(part, x.handle, y.handle, y.handle):
        raise PETSc.Error("a product failed")


@contextmanager
def _pattern(block: PETSc.Mat, kind: tuple[int, int, int]) -> Iterator[tuple[Ints, Ints]]:
    """Within a ``with`` block the pattern of a rank's matrix: ends of rows, and columns."""
    petsc = _petsc()
    assert petsc is not None and np.dtype(PETSc.IntType) == np.int32
    size, done = ctypes.c_int32(), ctypes.c_int()
    ends, columns = (ctypes.POINTER(ctypes.c_int32)() for _ in range(2))
    found = (*map(ctypes.byref, (size, ends, columns, done)),)
    if petsc.MatGetRowIJ(block.handle, *kind, *found) or not done.value:
        raise PETSc.Error("the pattern of the matrix cannot be had")
    try:
        indptr = np.ctypeslib.as_array(ends, shape=(size.value + 1,))
        count = int(indptr[-1])
        yield indptr, np.ctypeslib.as_array(columns, (count,)) if count else np.empty(0, np.int32)
    finally:
        petsc.MatRestoreRowIJ(block.handle, *kind, *found)
