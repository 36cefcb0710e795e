"""Signals to stop: noted first, obeyed at the next step; the second one at once."""

import json
import os
import signal
import threading
import tomllib
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import pytest
from mpi4py import MPI

from tribox.app.case.case import Case
from tribox.app.errors import Interrupted, OutputError
from tribox.app.results.saving import Saving
from tribox.app.run import progress
from tribox.app.run.ranks import stopping_signals
from tribox.app.run.run import Interruption, run_case

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1)
ARGUMENTS = {"ready": 1, "cut": 3, "load_step": 4}  # how many an observer is told
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


@pytest.fixture
def saving(tmp_path):
    return Saving(tmp_path)


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("when", ["ready", "cut"])
def test_a_signal_stops_at_the_next_step_or_cut(number, when, saving):
    told = []
    with pytest.raises(Interrupted), Interruption(MPI.COMM_SELF, saving) as interruption:
        interruption.noted = partial(told.append, True)
        interruption.ready(ANY)
        os.kill(os.getpid(), number)
        assert told == [True]  # at once
        reached = True
        getattr(interruption, when)(*(ANY,) * ARGUMENTS[when])
    assert reached


def test_a_second_signal_stops_at_once(saving):
    reached = False
    with pytest.raises(KeyboardInterrupt) as caught, Interruption(MPI.COMM_SELF, saving):
        signal.raise_signal(signal.SIGINT)
        reached = True
        signal.raise_signal(signal.SIGINT)
        pytest.fail("the second signal was not obeyed")
    assert reached and not isinstance(caught.value, Interrupted)


def test_what_mpirun_passes_on_twice_is_no_second_signal(saving):
    with pytest.raises(Interrupted), Interruption(MPI.COMM_SELF, saving) as interruption:
        signal.raise_signal(signal.SIGUSR1)
        signal.raise_signal(signal.SIGUSR1)
        interruption.ready(ANY)
    with pytest.raises(KeyboardInterrupt) as caught, Interruption(MPI.COMM_SELF, saving):
        signal.raise_signal(signal.SIGUSR1)
        signal.raise_signal(signal.SIGINT)
    assert not isinstance(caught.value, Interrupted)


def test_another_signal_is_no_second_one(saving):
    with pytest.raises(Interrupted), Interruption(MPI.COMM_SELF, saving) as interruption:
        os.kill(os.getpid(), signal.SIGHUP)
        os.kill(os.getpid(), signal.SIGTERM)  # as engines of containers do
        interruption.ready(ANY)


def test_a_signal_that_was_ignored_stays_so(saving):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interruption(MPI.COMM_SELF, saving) as interruption:
            os.kill(os.getpid(), signal.SIGHUP)
            interruption.ready(ANY)
        assert signal.SIGHUP not in stopping_signals()
    finally:
        signal.signal(signal.SIGHUP, before)
    assert signal.SIGHUP in stopping_signals()


def test_a_rank_that_learns_of_a_stop_from_another_outlives_its_own_signal(saving):
    """On a loaded machine mpirun's signal to the second rank comes when all have stopped."""
    answers = iter((False, True))  # all could write; one has been asked
    told = SimpleNamespace(rank=1, size=2, allreduce=lambda one, op: next(answers))
    before = signal.getsignal(signal.SIGUSR1)
    try:
        with pytest.raises(Interrupted), Interruption(cast("MPI.Comm", told), saving) as stop:
            stop.ready(ANY)
        assert signal.getsignal(signal.SIGUSR1) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGUSR1, before)


@pytest.mark.parametrize("when", ["ready", "cut", "load_step"])
def test_what_could_not_be_written_stops_all_ranks(when, saving, tmp_path):
    with Interruption(MPI.COMM_SELF, saving) as interruption:
        arguments = (ANY,) * ARGUMENTS[when]
        getattr(interruption, when)(*arguments)
        with saving:
            (tmp_path / "gone" / "a.txt").write_text("text")
        with pytest.raises(OutputError, match=r"No such file or directory: gone/a.txt\)$"):
            getattr(interruption, when)(*arguments)


def test_in_another_thread_signals_are_left_alone(saving):
    seen = []

    def work() -> None:
        with Interruption(MPI.COMM_SELF, saving) as interruption:
            seen.append([signal.getsignal(number) for number in SIGNALS])
            interruption.ready(ANY)

    before = [signal.getsignal(number) for number in SIGNALS]
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [before]


@pytest.mark.parametrize("signalled", [True, False])
def test_what_a_second_signal_becomes_in_a_library_is_no_failure(
    signalled, block, tmp_path, monkeypatch
):
    """Libraries in C make another error of an exception that a handler raises in what they call."""

    def step(self, state, row, result) -> None:
        if signalled:
            signal.raise_signal(signal.SIGTERM)
        raise SystemError("returned a result with an exception set")

    monkeypatch.setattr(progress.Together, "step", step)
    case = Case.model_validate(tomllib.loads(block))
    with pytest.raises(KeyboardInterrupt if signalled else SystemError):
        run_case(case, tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["status"] == ("interrupted" if signalled else "failed")
