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
    petsc, block = _petsc(), own_block(A)
    assert petsc is not None and np.dtype(PETSc.IntType) == np.int32
    size, done = ctypes.c_int32(), ctypes.c_int()
    ends, columns = (ctypes.POINTER(ctypes.c_int32)() for _ in range(2))
    found = (*map(ctypes.byref, (size, ends, columns, done)),)
    if petsc.MatGetRowIJ(block.handle, *_PLAIN, *found) or not done.value:
        raise PETSc.Error("the pattern of the matrix cannot be had")
    try:
        indptr = np.ctypeslib.as_array(ends, shape=(size.value + 1,))
        count = int(indptr[-1])
        yield indptr, np.ctypeslib.as_array(columns, (count,)) if count else np.empty(0, np.int32)
    finally:
        petsc.MatRestoreRowIJ(block.handle, *_PLAIN, *found)


def pattern_of(A: PETSc.Mat) -> tuple[Ints, Ints]:
    """Ends of this rank's rows, and the columns in them, counted over all ranks."""
    ends, columns = A.getRowIJ() if A.comm.size == 1 else A.getValuesCSR()[:2]
    return ends, columns


def forget_product(A: PETSc.Mat) -> None:
    """Give back what ``A`` was made with as a product, which nobody makes again; collective.

    On several ranks that is twice as much as the matrices of the multigrid themselves.
    """
    petsc = _petsc()
    if petsc is not None and petsc.MatProductClear(A.handle):
        raise PETSc.Error("the parts of a product cannot be given back")


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
