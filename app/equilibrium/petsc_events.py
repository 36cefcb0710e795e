"""Lets a function hear of the events PETSc logs, as they begin and end.

PETSc's own log keeps wall time only. Its callback interface, which petsc4py leaves out, is called
through ctypes; see the manual page of ``PetscLogHandlerCreateLegacy``.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from mpi4py import MPI
from petsc4py import PETSc

_EVENT = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_int, *[ctypes.c_void_p] * 4)
_OBJECT = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)


@contextmanager
def events(
    names: Mapping[str, str], begin: Callable[[str], None], end: Callable[[], None]
) -> Iterator[None]:
    """Call ``begin(part)`` and ``end()`` around the events named, within a ``with`` block.

    Args:
        names: part by name of PETSc's event, such as "MatLUFactorNum".
        begin: told that an event of the part begins.
        end: told that the event begun last ends.

    Raises:
        RuntimeError: PETSc refuses the callbacks.
    """
    parts = {PETSc.Log.Event(event).id: part for event, part in names.items()}

    def begun(event: int, *_: object) -> int:
        if event in parts:
            begin(parts[event])
        return 0

    def ended(event: int, *_: object) -> int:
        if event in parts:
            end()
        return 0

    # The names keep the callbacks alive until PETSc has let go of them.
    calls = (_EVENT(begun), _EVENT(ended), _OBJECT(lambda _: 0), _OBJECT(lambda _: 0))
    library = ctypes.CDLL(PETSc.__file__)
    handler = ctypes.c_void_p()
    _check(library.PetscLogHandlerCreateLegacy(_self(), *calls, ctypes.byref(handler)))
    _check(library.PetscLogHandlerStart(handler))
    try:
        yield
    finally:
        _check(library.PetscLogHandlerStop(handler))
        _check(library.PetscLogHandlerDestroy(ctypes.byref(handler)))


def _self() -> ctypes.c_void_p | ctypes.c_int:
    """This process alone, as C passes a communicator: a pointer or an integer."""
    pointer = MPI._sizeof(MPI.Comm) == ctypes.sizeof(ctypes.c_void_p)
    kind = ctypes.c_void_p if pointer else ctypes.c_int
    return kind.from_address(MPI._addressof(MPI.COMM_SELF))


def _check(code: int) -> None:
    if code:
        raise RuntimeError(f"PETSc does not let its events be heard (error {code})")
