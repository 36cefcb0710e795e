"""Ctrl-C during a run: the step at hand is finished, all ranks stop together, files are closed."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Self

from mpi4py import MPI

from app.implicit.stepper import StepResult
from app.simulation.observer import Observer
from app.simulation.run_state import RunState

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruption(Observer):
    """Context in which a signal to stop is noted, and obeyed after the step it came in.

    An exception thrown into one of PETSc's callbacks comes back as an error of PETSc, and ranks
    that stop at different places wait for each other for ever. A second signal stops at once.
    """

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._asked = False
        self._before: dict[signal.Signals, signal._HANDLER] = {}

    def __enter__(self) -> Self:
        # Only the main thread may set handlers; in another, its owner decides what stops it.
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._note) for number in SIGNALS}
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._restore()

    def ready(self, state: RunState) -> None:
        """Stop here if any rank has been asked to."""
        self._look()

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Stop here if any rank has been asked to."""
        self._look()

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._asked = True
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        self._before = {}

    def _look(self) -> None:
        if self._comm.allreduce(self._asked, op=MPI.LOR):
            raise KeyboardInterrupt
