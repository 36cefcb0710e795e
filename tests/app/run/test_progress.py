"""What a run prints on a terminal and elsewhere, and what its log keeps."""

import io
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from rich.console import Console

from tests.app.read_log import read_log, unfolded
from tests.tool_cases import block_case, block_mesh, case_of, circle, plane
from tribox.app.case.reading import load_case
from tribox.app.case.stage import load_steps_of
from tribox.app.implicit.stepper import StepResult
from tribox.app.report import contents
from tribox.app.results import read
from tribox.app.results.saving import Saving
from tribox.app.run.progress import Reporter, StageBar
from tribox.app.run.run import run_case
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
    state = SimpleNamespace(
        time=0.1, step=1, speed=0.0, last_of_pairs=lambda: [], model=SimpleNamespace(case=case)
    )
    [load_step] = load_steps_of(case.stage[0])
    solved = StepResult(True, 3, 2, 2, [1.0, 1e-9])
    reporter.say("note: step 1 is not a step")
    reporter.step(state, row(1, 0.1, 1e-9), solved)
    reporter.cut(state, 1e-9, StepResult(False, 25, 25, -5, [1.0]))
    reporter.cut(state, 1e-9, StepResult(False, 5, 5, 2, [1.0], too_long=True))
    state.speed = 0.25
    reporter.step(state, row(2, 0.1 + 5e-10, 5e-10), replace(solved, residuals=[3.1]))
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
    assert re.findall(r"\((residual.*?)\)", unfolded(log)) == [
        "residual 1.0e-09",
        "residual at round-off",
    ]


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
    for text, width in ((log, 100), (re.sub(r"\x1b\[[^A-Za-z]*[A-Za-z]", "", shown), 40)):
        lines = text.splitlines()
        assert max(len(line) for line in lines if "ddd" not in line) <= width
        assert text.count("corners 0.25") == 3 and text.count("smooth the") == 1
        assert "d" * 120 in text  # a name is not broken
    said = unfolded(log).splitlines()
    assert said[0] == NOTE.format(0, 0.25)
    assert said[2] == "note: contact.2: corners 0.25 m apart, with a peak each"


def test_a_terminal_keeps_only_lines_that_stay_and_shows_a_bar(told):
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


def test_of_a_run_that_goes_on_the_stages_stand_where_they_were(case_file, block):
    """What was done before counts as done, and says nothing of the pace."""
    console = Console(file=Terminal(), width=100, highlight=False, force_terminal=True)
    bar = StageBar(load_case(case_file(block)), console)
    bar.go_on([1.0], 1.25)
    [here] = bar._bar.tasks
    assert here.description == "2/2 slide" and not bar.ended
    assert here.completed == pytest.approx(0.25) and here.time_remaining is None
    bar.at(2.0)
    bar.end_load_step()
    assert bar.ended and here.completed == 1.0
    bar.close()


# -- What is told of rigid tools at the end of a run: on the terminal, and in the report -----------

DOWN = {"y": [["0 s", "0 m"], ["1 s", "-50 um"], ["2 s", "-10 um"]]}
TURN = {"angle": [["1 s", "0 rad"], ["2 s", "0.02 rad"]]}


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    """Results of a tool that presses most in the middle of its run, and one that does nothing."""
    directory = tmp_path_factory.mktemp("tools")
    tools = {
        "punch": circle(displacement=DOWN, rotation=TURN),
        "idle": plane(point=[0, 5e-3], normal=[0, -1]),
    }
    contact = {"master": "punch", "slave": "top", "friction": {"law": "coulomb", "mu": 0.3}}
    stage = [{"name": name, "duration": "1 s", "steps": 2} for name in ("press", "leave")]
    data = block_case(
        block_mesh(directory / "block.msh"), tools=tools, contact=[contact], stage=stage
    )
    data["output"] = {"figures": False, "fields_every": 1}
    run_case(case_of(data), directory / "out", quiet=True, comm=MPI.COMM_SELF)
    return read(directory / "out")


def test_a_line_of_each_tool_is_in_the_log(pressed):
    lines = read_log(pressed.directory).splitlines()
    first, second = (line for line in lines if re.search(r"\btool (punch|idle): moved", line))
    rows = pressed.tools[pressed.tools["tool"] == "punch"]
    force, moment = rows[["force_x", "force_y"]].to_numpy(), rows["moment_z"].to_numpy()
    most = np.linalg.norm(force, axis=1).max()
    assert most > 1.5 * np.linalg.norm(force[-1])
    assert f"moved by (0, -1e-05) m, turned by 0.02 rad; force on it ({force[-1][0]:.4g}, " in first
    assert f"{force[-1][1]:.4g}) N, at most {most:.4g} N; moment {moment[-1]:.4g} N m" in first
    assert first.endswith(f"at most {np.abs(moment).max():.4g} N m")
    assert second.endswith(
        "tool idle: moved by (0, 0) m; force on it (0, 0) N, at most 0 N; moment 0 N m, "
        "at most 0 N m"
    )


def test_the_report_has_tables_of_tools_at_the_ends_and_at_their_largest(pressed):
    (part,) = contents(pressed)["parts"]
    tables = {table.caption: table for table in part["tables"]}
    ends = tables["Tools: force and moment of the bodies on them"]
    most = tables["Tools: largest value of each over the run"]
    assert [row[:2] for row in ends.rows] == [
        ("punch", "press"), ("punch", "leave"), ("idle", "press"), ("idle", "leave"),
    ]  # fmt: skip
    assert [row[0] for row in most.rows] == ["punch", "idle"]
    titles = [title for title, _ in most.headings]
    at = {title: dict(zip(titles, row, strict=True)) for title, row in zip("ab", most.rows)}
    assert (
        at["a"]["displacement u_y"] == "-50"
        and most.headings[titles.index("displacement u_y")][1] == "µm"
    )
    assert at["a"]["rotation θ"] == "0.02" and at["b"]["rotation θ"] == "0"
    force = 1e3 * pressed.tools["force_y"].max()
    assert most.headings[titles.index("force R_y")][1] == "mN"
    assert float(at["a"]["force R_y"]) == pytest.approx(force, rel=1e-3)
    # The driving force is the other way round, and keeps its sign.
    assert float(at["a"]["driving force, y"]) == pytest.approx(-force, rel=1e-3)
    assert any(table.title == "Tool punch" for table in contents(pressed)["inputs"])
