"""What a run prints on a terminal and elsewhere, and what its log keeps."""

import io
import re
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from rich.console import Console

from tests.app.read_log import read_log, unfolded
from tests.tool_cases import block_case, block_mesh, case_of, circle, plane
from tribox.app.build.load_steps import load_steps_of
from tribox.app.case.reading import load_case
from tribox.app.errors import folded
from tribox.app.errors import tell as print_folded
from tribox.app.implicit.stepper import StepResult
from tribox.app.report.page import contents
from tribox.app.results import read
from tribox.app.results.saving import Saving
from tribox.app.run.progress import Reporter, StageBars, StagesProgress, clock
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


# -- How far a run is within its stages, and how long the rest takes -------------------------------


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.time = 100.0

    def __call__(self) -> float:
        return self.time


@pytest.fixture
def now():
    return Clock()


@pytest.fixture
def stages(case_file, film, now):
    """Of a case that presses for 1 s and slides at 1e-5 and 2e-3 m/s, 4 um a step, 60 at most."""
    return StagesProgress(load_case(case_file(film)), now)


def to_the_slide(stages, now):
    stages.at(0.4, 0.4)
    now.time += 2.0
    stages.at(1.0, 0.4)
    stages.end_load_step()


def test_a_stage_with_a_duration_goes_by_its_time(stages, now):
    press = stages.here
    assert (press.share, press.seconds_left(now()), press.time_left(now())) == (0.0, None, "")
    stages.at(0.25, 0.125)
    now.time += 3.0
    assert press.share == 0.25
    assert press.seconds_left(now()) == pytest.approx(9.0, rel=1e-12)
    assert press.place() == "0.25/1 s"
    assert press.time_left(now()) == "0:09 left"


def test_until_steady_it_goes_by_load_steps_and_the_most_steps(stages, now):
    to_the_slide(stages, now)
    press, slide = stages.begun
    assert press.time_left(now()) == "done in 0:02" and press.share == 1.0
    assert slide.place() == "load step 1/2, step 0/60"
    stages.at(1.0 + 15 * 0.4, 0.2)  # 4 um at 1e-5 m/s take 0.4 s; the last step was cut
    now.time += 1.0
    assert slide.place() == "load step 1/2, step 15/60"
    assert slide.share == pytest.approx(15 / 60 / 2, rel=1e-12)
    assert slide.time_left(now()) == "at most 0:07 left"
    stages.end_load_step()
    stages.at(7.0 + 3 * 2e-3, 2e-3)
    assert slide.place() == "load step 2/2, step 3/60"
    assert slide.share == pytest.approx((1 + 3 / 60) / 2, rel=1e-9)
    stages.end_load_step()
    assert slide.share == 1.0 and slide.ended == now()


def test_the_time_of_a_stage_is_its_own_and_tells_steps_apart(case_file, block):
    text = block.replace('duration = "1 s"\nsteps = 6', 'duration = "6 ns"\nsteps = 6')
    stages = StagesProgress(load_case(case_file(text)))
    stages.at(1.0, 1.0)
    stages.end_load_step()
    places = [stages.at(1.0 + k * 1e-9, 1e-9).place() for k in (1, 2, 3)]
    assert [place[:1] for place in places] == ["1", "2", "3"]
    assert all(place.endswith("e-09/6e-09 s") for place in places), places


def rendered(stages, details: str, width: int) -> list[str]:
    console = Console(width=width, record=True, file=open("/dev/null", "w"), force_terminal=False)
    bars = StageBars(stages, console)
    bars.details = details
    bars.close()
    with console.capture() as capture:
        console.print(bars.render())
    return [line.rstrip() for line in capture.get().splitlines()]


def test_bars_fit_into_a_narrow_terminal(stages, now):
    to_the_slide(stages, now)
    stages.at(1.4, 0.4)
    now.time += 1.0
    details = "step 4  V 1e-05 m/s  N 0.5 N  F_T 0.02 N  residual 1.6e-11  0 cuts"
    press, slide, last = rendered(stages, details, 72)
    assert press.startswith("1/2 press ━") and press.endswith("━ done in 0:02")
    assert slide.startswith("2/2 slide ") and "load step 1/2, step 1/60, at most" in slide
    assert last == details
    assert max(map(len, rendered(stages, 3 * details, 40))) <= 40


@pytest.mark.parametrize(
    ("seconds", "text"), [(4.6, "0:05"), (61, "1:01"), (3599.4, "59:59"), (3723, "1:02:03")]
)
def test_clock(seconds, text):
    assert clock(seconds) == text


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
    tables = {table.caption: table for table in part.tables}
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
