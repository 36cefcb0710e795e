"""What a process of tribox does with its memory."""

import ctypes

import numpy as np
import pytest
from petsc4py import PETSc

from tribox.app.run.process import give_memory_back


class Malloc(ctypes.Structure):
    """``struct mallinfo2`` of glibc."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    ]


def test_large_arrays_go_back_to_the_system_once_they_are_freed():
    """Each is mapped by itself, whatever libraries beside PETSc have asked of glibc."""
    libc = ctypes.CDLL(None)
    if not hasattr(libc, "mallinfo2"):
        pytest.skip("another C library")
    libc.mallinfo2.restype = Malloc
    assert PETSc.Sys.isInitialized()
    give_memory_back()
    before = libc.mallinfo2().hblkhd
    array = np.ones(2_000_000)
    assert libc.mallinfo2().hblkhd >= before + array.nbytes
    del array
    assert libc.mallinfo2().hblkhd == before
