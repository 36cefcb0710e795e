"""PETSc's own library, which petsc4py has loaded, for what petsc4py leaves out."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any

from petsc4py import PETSc


def petsc_library(signatures: Mapping[str, Sequence[Any]]) -> ctypes.CDLL | None:
    """The library with the functions wanted; None where one of them is not found in it.

    Args:
        signatures: kinds of the arguments (of ctypes) by the functions' names; all return an error
            code, 0 where there was none.
    """
    try:
        found = ctypes.CDLL(PETSc.__file__)  # a search there goes on in what it is linked to
        for name, kinds in signatures.items():
            function = getattr(found, name)
            function.argtypes, function.restype = list(kinds), ctypes.c_int
    except (OSError, AttributeError):
        return None
    return found
