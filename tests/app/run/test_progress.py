"""What a run prints on a terminal and elsewhere, and what its log keeps."""

from __future__ import annotations

import io
import re
from types import SimpleNamespace

import pytest
from rich.console import Console

from tests.app.read_log import unfolded
from tribox.app.build.load_steps import load_steps_of
from tribox.app.case.reading import load_case
from tribox.app.errors import folded
from tribox.app.errors import tell as print_folded
from tribox.app.implicit.stepper import StepResult
from tribox.app.results.saving import Saving
from tribox.app.run.progress import Reporter
from tribox.app.run.sweep_runs import is_passing
from tribox.app.simulation.history import COLUMNS, Row
from tribox.app.simulation.run_state import Interval


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def row(step: int, time: float, dt: float) -> Row:
    numbers = dict.fromkeys(COLUMNS, 0.5)
    return Row(**numbers | {"step": step, "time": time, "dt": dt, "stage": "press"})


def tell(case, log, stream) -> str:
    """Let a reporter tell of two steps, one cut, an interval and the end of the load step."""
    console = Console(file=stream, width=200, highlight=False, soft_wrap=True)
    reporter = Reporter(log, case, Saving(log.parent), console=console)
    state = SimpleNamespace(time=0.1, step=1, speed=0.0, last_of_pairs=lambda: [])
    [load_step] = load_steps_of(case.stage[0])
    solved = StepResult(True, 3, 2, 2, [1.0, 1e-9])
    reporter.say("note: step 1 is not a step")
    reporter.step(state, row(1, 0.1, 1e-9), solved)
    reporter.cut(state, 1e-9, StepResult(False, 25, 25, -5, [1.0]))
    reporter.cut(state, 1e-9, StepResult(False, 5, 5, 2, [1.0], too_long=True))
    state.speed = 0.25
    reporter.step(state, row(2, 0.1 + 5e-10, 5e-10), solved)
    reporter._pace._last = -10.0
    reporter.step(state, row(3, 0.2, 1e-3), Interval(100, 1e-3, 2e-3, 300, 1e-4))
    reporter._pace._last = -10.0
    reporter.within(state, load_step, 400)
    reporter.load_step(state, load_step, row(3, 0.2, 1e-3), None)
    reporter.close()
    return log.read_text(encoding="utf-8")


@pytest.fixture
def told(case_file, block, tmp_path, monkeypatch):
    """Tells a stream, and returns the log and what the stream received."""
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("OMPI_COMM_WORLD_SIZE", raising=False)

    def run(stream: io.StringIO) -> tuple[str, str]:
        log = tell(load_case(case_file(block)), tmp_path / "log.txt", stream)
        return log, stream.getvalue()

    return run


def test_without_a_terminal_all_lines_are_plain_and_in_the_log(told):
    log, plain = told(io.StringIO())
    assert plain == log and "\x1b" not in plain


NOTE = "note: contact.{}: corners {} m apart, with a peak each; smooth the master, or shorten its "
NOTE += "facets (dividing its cells keeps the corners)"


def test_advice_is_given_once_and_no_line_is_wide(case_file, block, tmp_path, monkeypatch):
    """What is found is said of each contact; a terminal is folded at its width, a log at 100."""
    monkeypatch.setenv("TERM", "xterm")
    case, stream = load_case(case_file(block)), Terminal()
    console = Console(file=stream, width=40, highlight=False, soft_wrap=True)
    reporter = Reporter(tmp_path / "log.txt", case, Saving(tmp_path), console=console)
    for number in range(3):
        reporter.say(NOTE.format(number, 0.25))
    reporter.say("results in " + "d" * 120)
    reporter.close()
    log, shown = (tmp_path / "log.txt").read_text(), stream.getvalue()
    for text, width in ((log, 100), (re.sub(r"\x1b\[[^A-Za-z]*[A-Za-z]|\r", "", shown), 40)):
        lines = text.splitlines()
        assert max(len(line) for line in lines if "ddd" not in line) <= width
        assert text.count("corners 0.25") == 3 and text.count("smooth the") == 1
        assert "d" * 120 in text  # a name is not broken
    said = unfolded(log).splitlines()
    assert said[0] == NOTE.format(0, 0.25)
    assert said[2] == "note: contact.2: corners 0.25 m apart, with a peak each"


def test_no_line_ends_between_a_number_and_its_unit():
    line = "the contact is uncertain by 33 % of 0.02 m at 3 MPa, and 4 facets wide; " * 5
    for width in range(40, 90):
        shown = folded(line.strip(), width)
        assert not re.search(r"\d\n +(%|m|MPa)\b", shown), shown
        assert unfolded(shown) == line.strip() + "\n"


def test_errors_and_notes_are_folded_on_terminals_only(monkeypatch):
    monkeypatch.setenv("COLUMNS", "50")
    for stream, several in ((Terminal(), True), (io.StringIO(), False)):
        print_folded(NOTE, stream)
        assert (len(stream.getvalue().splitlines()) > 1) == several
        assert unfolded(stream.getvalue()) == NOTE + "\n"


def test_a_terminal_keeps_only_lines_that_stay_and_shows_bars(told):
    log, terminal = told(Terminal())
    lines = unfolded(log).splitlines()
    passing = [line for line in lines if is_passing(line)]
    assert len(passing) == 6
    assert "step of 1e-09 s too long after 5 iterations (points slow down through V*" in unfolded(
        log
    )
    for line in lines:
        assert (line in terminal) is (line not in passing), line
    assert "1/2 press" in terminal and "━" in terminal
    assert "time step 400, " in terminal


@pytest.mark.parametrize(("ranks", "term"), [("2", "xterm"), (None, "dumb")])
def test_there_are_no_bars_under_mpirun_and_on_a_dumb_terminal(told, monkeypatch, ranks, term):
    monkeypatch.setenv("TERM", term)
    if ranks is not None:
        monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", ranks)
    log, terminal = told(Terminal())
    assert "━" not in terminal and unfolded(terminal) == unfolded(log)


def test_times_of_short_steps_differ(told):
    log, _ = told(io.StringIO())
    first, second = (line for line in log.splitlines() if line.startswith("step"))
    assert "t 0.1 s" in first and "t 0.1000000005 s" in second
    # The velocity of what is driven says nothing where nothing is.
    assert "V " not in first and "  V 0.25 m/s  N " in second
