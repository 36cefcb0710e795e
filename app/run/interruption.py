"""Signals to stop a run, and writes that fail: all ranks stop together, between two steps."""

from __future__ import annotations

import signal
from collections.abc import Callable, Collection
from types import FrameType, TracebackType
from typing import Self

from mpi4py import MPI

from tribox.app.build.load_steps import LoadStep
from tribox.app.errors import Interrupted
from tribox.app.implicit.stepper import StepResult
from tribox.app.results.saving import Saving
from tribox.app.run.ranks import (
    INTERRUPTED,
    give_back,
    repeats,
    say_stopping,
    stopping_signals,
    taken,
    tell_exit_code,
)
from tribox.app.simulation.history import Row
from tribox.app.simulation.run_state import Observer, RunState


class Interruption(Observer):
    """Context in which a signal to stop is noted, and obeyed after the step it came in.

    SIGINT, SIGTERM, SIGHUP unless it was ignored before, and SIGUSR1, by which ranks are told.
    Ranks that stop at different places wait for each other for ever. Ctrl-C, or the same signal
    again, does what it would have done outside, at once. A write that has failed on a rank ends
    the run likewise.

    Attributes:
        noted: called at once when a signal comes, on this rank alone.
        asked: whether one has come to this rank.
    """

    def __init__(self, comm: MPI.Comm, saving: Saving) -> None:
        """No signal is taken before the context is entered.

        Args:
            comm: ranks that stop together.
            saving: that the run writes its files in.
        """
        self._comm, self._saving = comm, saving
        self.noted: Callable[[], None] | None = None
        self.asked = False
        self._before: dict[signal.Signals, signal._HANDLER] = {}

    def __enter__(self) -> Self:
        self._before = taken(dict.fromkeys(stopping_signals(), self._note))
        if self._before:
            # PETSc, unless told not to, takes this one too, and ends the process at a closed pipe.
            signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.restore()

    def ready(self, state: RunState) -> None:
        """Stop here if any rank has been asked to, or could not write."""
        self.look()

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Stop here if any rank has been asked to, or could not write."""
        self.look()

    def load_step(
        self, state: RunState, load_step: LoadStep, row: Row, steady: bool | None
    ) -> None:
        """Stop here if any rank could not write."""
        self._saving.raise_together(self._comm)

    def _note(self, number: int, frame: FrameType | None) -> None:
        first, self.asked = not self.asked, True
        self.restore(repeats(number))
        if not first:
            return
        # mpirun, if it is the one that was asked, will not wait for long.
        if self._comm.rank == 0 and not tell_exit_code(INTERRUPTED):
            say_stopping()  # else the process that waits for the ranks has said it
        if self.noted is not None:
            self.noted()

    def restore(self, numbers: Collection[int] | None = None) -> None:
        """Take no more signals, or none of these numbers."""
        chosen = [n for n in self._before if numbers is None or n in numbers]
        give_back({number: self._before.pop(number) for number in chosen})

    def look(self) -> None:
        """Stop here if any rank has been asked to, or could not write; collective.

        Raises:
            OutputError: a rank could not write.
            Interrupted: a rank has been asked to stop.
        """
        self._saving.raise_together(self._comm)
        if self._comm.allreduce(self.asked, op=MPI.LOR):
            raise Interrupted
