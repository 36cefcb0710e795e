"""Signals to a process that waits for others: passed on to them, and waited for."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
from collections.abc import Callable, Mapping
from types import FrameType, TracebackType
from typing import Self

from tribox.app.run.process import STOPPING

SAID = "finishing the step at hand; Ctrl-C, or the same signal again, stops at once"
Handler = Callable[[int, FrameType | None], None]


def say_stopping() -> None:
    """Say on standard error that the step at hand is being finished; for handlers of signals.

    These come in the middle of anything, also of a write to a buffered stream.
    """
    with contextlib.suppress(OSError):
        start = "\n" if os.isatty(2) else ""  # below what a terminal shows of Ctrl-C
        os.write(2, f"{start}tribox: {SAID}\n".encode())


def stopping_signals() -> tuple[signal.Signals, ...]:
    """Signals that stop a run: not SIGHUP where it was ignored from the start, as by nohup.

    SIGUSR1 does so too, by which mpirun tells its ranks.
    """
    ignored = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return tuple(n for n in (*STOPPING, signal.SIGUSR1) if n != signal.SIGHUP or not ignored)


def taken(handlers: Mapping[signal.Signals, Handler]) -> dict[signal.Signals, signal._HANDLER]:
    """Set handlers of signals, and return those before; in the main thread only.

    In another one nothing is set: its owner decides what stops it.
    """
    if threading.current_thread() is not threading.main_thread():
        return {}
    return {number: signal.signal(number, handler) for number, handler in handlers.items()}


def give_back(before: Mapping[signal.Signals, signal._HANDLER]) -> None:
    """Set the handlers that :func:`taken` returned."""
    for number, handler in before.items():
        signal.signal(number, signal.SIG_DFL if handler is None else handler)


def repeats(first: int) -> tuple[int, ...]:
    """Signals that, after a first one to stop, are a second one.

    Not any other: engines of containers whose terminal has gone send SIGHUP, and SIGTERM after it.
    But mpirun, which has passed on SIGUSR1, ends its ranks by SIGTERM.
    """
    by_mpirun = (signal.SIGTERM,) if first == signal.SIGUSR1 else ()
    return first, signal.SIGINT, *by_mpirun


class Forwarding:
    """Context in which signals to stop go to child processes, and none ends this one.

    The children stand in process groups of their own, so that a terminal tells this process alone.

    Attributes:
        asked: how many signals to stop have come.
    """

    def __init__(self, first: signal.Signals, further: signal.Signals) -> None:
        """Nothing is passed on before the context is entered.

        Args:
            first: what children are sent at the first signal to stop, to finish their step.
            further: what they are sent at any further one, to stop at once.
        """
        self.asked = 0
        self._first: int | None = None
        self._sent = (first, further)
        self._telling = threading.RLock()  # a handler may come in the middle of another
        self._children: dict[subprocess.Popen[str], int] = {}
        self._before: dict[signal.Signals, signal._HANDLER] = {}

    def __enter__(self) -> Self:
        """Take the signals."""
        self._before = taken(dict.fromkeys(stopping_signals(), self._stop))
        self._before |= taken({signal.SIGTSTP: self._pause})
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the signals back."""
        give_back(self._before)

    def add(self, child: subprocess.Popen[str]) -> None:
        """Pass signals on to this child from now on, and one that has come before."""
        self._children[child] = 0
        self._tell()

    def remove(self, child: subprocess.Popen[str]) -> None:
        """This child has ended."""
        del self._children[child]

    def _stop(self, number: int, frame: FrameType | None) -> None:
        if self._first is None:
            self._first, self.asked = number, 1
            say_stopping()
        elif number in repeats(self._first):
            self.asked += 1
        self._tell()

    def _tell(self) -> None:
        """Send every child what it has not been sent yet."""
        with self._telling:
            for child, told in list(self._children.items()):
                if told < self.asked:
                    self._children[child] = self.asked
                    child.send_signal(self._sent[self.asked > 1])

    def _pause(self, number: int, frame: FrameType | None) -> None:
        """Ctrl-Z: stop with the children, and go on with them."""
        for child in list(self._children):
            child.send_signal(signal.SIGTSTP)
        os.kill(os.getpid(), signal.SIGSTOP)
        for child in list(self._children):
            child.send_signal(signal.SIGCONT)
