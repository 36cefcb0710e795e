"""What one rank does for all of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from mpi4py import MPI

from tribox.app.errors import InputError, OutputError

Result = TypeVar("Result")


def on_first(comm: MPI.Comm, action: Callable[[], Result]) -> Result | None:
    """Do something on the first rank; collective.

    Returns:
        What it gives; None on the other ranks.

    Raises:
        InputError, OutputError: as of the action, on all ranks.
    """
    result, problem = None, None
    if comm.rank == 0:
        try:
            result = action()
        except (InputError, OutputError) as error:
            problem = error
    problem = comm.bcast(problem)
    if problem is not None:
        raise problem
    return result
