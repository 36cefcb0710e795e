"""Signals to stop: noted first, obeyed at the next step; the second one at once."""

from __future__ import annotations

import os
import signal
import threading
from typing import Any

import pytest
from mpi4py import MPI

from app.run.interruption import SIGNALS, Interruption

ANY: Any = None  # What an observer is told plays no part here.


@pytest.fixture(autouse=True)
def _handlers_stay():
    # As Python sets it, whatever was found: the second Ctrl-C is to be an exception, not the end.
    found = signal.signal(signal.SIGINT, signal.default_int_handler)
    before = [signal.getsignal(number) for number in SIGNALS]
    yield
    after = [signal.getsignal(number) for number in SIGNALS]
    signal.signal(signal.SIGINT, found)
    assert after == before


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("when", ["step", "cut"])
def test_a_signal_stops_at_the_next_step_or_cut(number, when):
    with pytest.raises(KeyboardInterrupt), Interruption(MPI.COMM_SELF) as interruption:
        interruption.step(ANY, ANY, ANY)
        os.kill(os.getpid(), number)
        reached = True
        getattr(interruption, when)(ANY, ANY, ANY)
    assert reached


def test_a_second_signal_stops_at_once():
    reached = False
    with pytest.raises(KeyboardInterrupt), Interruption(MPI.COMM_SELF):
        signal.raise_signal(signal.SIGINT)
        reached = True
        signal.raise_signal(signal.SIGINT)
        pytest.fail("the second signal was not obeyed")
    assert reached


def test_in_another_thread_signals_are_left_alone():
    seen = []

    def work() -> None:
        with Interruption(MPI.COMM_SELF) as interruption:
            seen.append([signal.getsignal(number) for number in SIGNALS])
            interruption.step(ANY, ANY, ANY)

    before = [signal.getsignal(number) for number in SIGNALS]
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]
