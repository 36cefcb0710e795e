"""Writing that fails on one rank: kept until all ranks can end the run together."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self, TypeVar

from mpi4py import MPI

from tribox.app.errors import InputError, OutputError
from tribox.app.results.directory import Place, unwritable

# -- What one rank does for all of them ------------------------------------------------------------

Result = TypeVar("Result")


def on_first(comm: MPI.Comm, action: Callable[[], Result]) -> Result | None:
    """What an action on the first rank gives, None on others; collective, as its errors are."""
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


# -- Writing that fails on one rank: kept until all ranks can end the run together -----------------


class Saving:
    """Context that keeps an error of writing as ``problem``, so that its rank meets the others.

    A block within it may meet other ranks before it writes, not after.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self.place = Place(directory)
        self.problem: str | None = None

    def __enter__(self) -> Self:
        """Begin a block that writes."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        """Keep an error of the system, or of ours that says as much; the first one counts."""
        if not isinstance(error, OSError | OutputError):
            return False
        if isinstance(error, OSError):
            error = unwritable(self._directory, error)
        self.note(str(error))
        return True

    def note(self, problem: str) -> None:
        """Keep what could not be written; the first time counts."""
        self.problem = self.problem or problem

    def problem_of_all(self, comm: MPI.Comm) -> str | None:
        """What the first rank that could not write says; collective."""
        if not comm.allreduce(self.problem is not None, op=MPI.LOR):
            return None
        return next(problem for problem in comm.allgather(self.problem) if problem is not None)

    def raise_together(self, comm: MPI.Comm) -> None:
        """OutputError on all ranks for what one of them could not write; collective."""
        problem = self.problem_of_all(comm)
        if problem is not None:
            raise OutputError(problem)
