"""What PETSc made of the options it was given, and of what functions that it calls raise."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from mpi4py import MPI
from petsc4py import PETSc

OF_OTHERS = ("snes_", "mat_mumps_")
"""How options begin that do not say how linear systems are solved."""


def sets_solver(names: Iterable[str]) -> bool:
    """Whether options, without prefix, say how linear systems are solved."""
    return any(not name.startswith(OF_OTHERS) for name in names)


def unused(comm: MPI.Comm, prefix: str, names: Iterable[str]) -> list[str]:
    """The options that no object of PETSc has asked for so far, on any rank; collective.

    Raises:
        RuntimeError: PETSc does not tell.
    """
    library = ctypes.CDLL(PETSc.__file__)
    found = []
    for name in names:
        used = ctypes.c_int(0)
        code = library.PetscOptionsUsed(None, f"{prefix}{name}".encode(), ctypes.byref(used))
        if code:
            raise RuntimeError(f"PETSc does not tell whether it used {name} (error {code})")
        if not comm.allreduce(bool(used.value), op=MPI.LOR):
            found.append(name)
    return found


def refusal(error: PETSc.Error) -> ValueError:
    """The error for options with which PETSc does not work: its reason, on one line."""
    silence()
    lines = str(error).strip().splitlines()
    return ValueError(lines[-1].split("] ", 1)[-1])


def silence() -> None:
    """Have PETSc say nothing, at its end, of options that were not used: all is over."""
    PETSc.Options()["options_left"] = False


@contextmanager
def errors_as_raised() -> Iterator[None]:
    """Raise what a function that PETSc called has raised, also Ctrl-C, not PETSc's error for it."""
    try:
        yield
    except PETSc.Error as error:
        if error.__cause__ is None:
            raise
        raise error.__cause__ from None
