"""The values of an assembled matrix where they lie, to be changed in place.

petsc4py gives copies of them only. What it leaves out is called in PETSc's own library, which
petsc4py has loaded.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from petsc4py import PETSc

from geometry.surfaces.facets import Floats

_SIGNATURE: list[Any] = [ctypes.c_void_p, ctypes.POINTER(ctypes.POINTER(ctypes.c_double))]
_DIRECT = {PETSc.Mat.Type.SEQAIJ, PETSc.Mat.Type.MPIAIJ}


@functools.cache
def _petsc() -> ctypes.CDLL | None:
    """PETSc's library; None where the functions needed are not found in it."""
    try:
        found = ctypes.CDLL(PETSc.__file__)  # a search there goes on in what it is linked to
        for function in (found.MatSeqAIJGetArray, found.MatSeqAIJRestoreArray):
            function.argtypes, function.restype = _SIGNATURE, ctypes.c_int
    except (OSError, AttributeError):
        return None
    return found


def is_direct(A: PETSc.Mat) -> bool:
    """Whether `values_in_place` can be used with a matrix."""
    real = np.dtype(PETSc.ScalarType) == np.float64
    return real and A.getType() in _DIRECT and _petsc() is not None


def own_block(A: PETSc.Mat) -> PETSc.Mat:
    """The part of ``A`` with this rank's rows and columns, not a copy; on one rank all of it."""
    return A.getDiagonalBlock() if A.getType() == PETSc.Mat.Type.MPIAIJ else A


@contextmanager
def values_in_place(A: PETSc.Mat) -> Iterator[Floats]:
    """Within a ``with`` block the values of :func:`own_block`, in the order of its rows.

    Args:
        A: a matrix that :func:`is_direct`, assembled since its pattern was made.
    """
    petsc, block, first = _petsc(), own_block(A), ctypes.POINTER(ctypes.c_double)()
    assert petsc is not None
    if petsc.MatSeqAIJGetArray(block.handle, ctypes.byref(first)):
        raise PETSc.Error("the values of the matrix cannot be had")
    count = int(block.getInfo(PETSc.Mat.InfoType.LOCAL)["nz_used"])
    try:
        yield np.ctypeslib.as_array(first, shape=(count,)) if count else np.empty(0)
    finally:
        petsc.MatSeqAIJRestoreArray(block.handle, ctypes.byref(first))
