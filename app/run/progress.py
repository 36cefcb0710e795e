"""What a run tells the person who started it: lines on the terminal and in ``log.txt``."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tribox.app.case.case import Case
from tribox.app.case.stage import LoadStep, Stage
from tribox.app.errors import SaidOnce, folded
from tribox.app.implicit.stepper import StepResult
from tribox.app.results.directory import GrowingFile
from tribox.app.results.saving import Saving
from tribox.app.run.process import drop_output, ranks_around
from tribox.app.simulation.failure_diagnosis import reason_of
from tribox.app.simulation.history import Row, time_text
from tribox.app.simulation.run_state import Interval, Observer, RunState

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

LINE_EVERY = 2.0  # s between two lines on an explicit run


class Reporter(Observer):
    """Prints one line per step, or moves bars on a terminal; keeps all lines in the log.

    An explicit run, with its many steps, has a line every two seconds.

    Only the first rank makes one; the others use a plain :class:`Observer`.

    Attributes:
        saving: keeps errors of writing files.
    """

    def __init__(
        self,
        log: Path,
        case: Case,
        saving: Saving,
        quiet: bool = False,
        console: Console | None = None,
        resumed: bool = False,
    ) -> None:
        self.saving = saving
        self._log = Log(log, saving, resumed)
        self._console = console or _terminal()
        self._quiet = quiet
        self._pace = _Pace()
        self._progress = StagesProgress(case)
        self._touching = any(not contact.tied for contact in case.contact)
        self._tied = {contact.label for contact in case.contact if contact.tied}
        self._once = SaidOnce()
        self._bars: StageBars | None = None
        if self._console is None or ranks_around() > 1 or quiet:
            return
        if self._console.file.isatty() and not self._console.is_dumb_terminal:
            self._bars = StageBars(self._progress, self._console)

    def go_on(self, state: RunState, ends: Iterable[tuple[float, float]], steps: int) -> None:
        """A run goes on that had come somewhere.

        Args:
            ends: s, time and last step of each load step that had ended.
        """
        dt = state.rows[-1].dt if state.rows else state.time
        self._progress.go_on(ends, state.time, dt)
        self._pace.speed(steps)

    def say(self, line: str, *, always: bool = True) -> None:
        """Print a line and log it; lines not ``always`` printed stay in the log on a terminal."""
        line = self._once(line)
        self._log.write(line)
        if always or (self._bars is None and not self._quiet):
            self._print(line)

    def tell(self, line: str) -> None:
        """Print a line unless the run is to be quiet, and log it."""
        self.say(line, always=not self._quiet)

    def _print(self, line: str) -> None:
        try:
            if self._console is None:
                print(line, flush=True)
                return
            self._console.print(folded(line, self._console.width), markup=False)
            if not self._console.is_terminal:
                sys.stdout.flush()
        except OSError:
            drop_output()  # a full disk behind it costs what is printed, not the run

    def note(self, line: str) -> None:
        """Log a line that somebody else prints."""
        self._log.write(line)

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """One line of the step's forces and Newton iterations; or, now and then, of a row."""
        here = self._progress.at(row.time, row.dt)
        if isinstance(result, Interval):
            if self._pace.is_due():
                self._explicit_line(state, row, result)
            return
        residual = residual_text(result, state.model.case.solver.tolerance)
        linear = f", linear {row.linear_iterations}" if row.linear_iterations else ""
        self.say(
            f"step {row.step:4d}  {row.stage:<10s} t {time_text(row.time, row.dt)}  "
            f"{self._forces(state, row)}  "
            f"Newton {row.newton_iterations} ({residual}){linear}",
            always=False,
        )
        self._show(f"step {row.step}  {self._forces(state, row)}  {residual}  {_cuts(here)}")

    def within(self, state: RunState, load_step: LoadStep, steps: int) -> None:
        """A line where no row has come for a while."""
        moved = state.time - self._progress.here.time
        self._progress.at(state.time, moved)
        if self._pace.is_due():
            speed = self._pace.speed(steps)
            when = time_text(state.time, moved)
            self.say(
                f"time step {steps}  {load_step.stage.name:<10s} t {when}  {speed:.0f} steps/s",
                always=False,
            )
            self._show(f"time step {steps}, {speed:.0f} steps/s")

    def _explicit_line(self, state: RunState, row: Row, interval: Interval) -> None:
        speed = self._pace.speed(interval.total)
        ratio = f"E_kin/E_strain {interval.kinetic_ratio:.1e}"
        self.say(
            f"row {row.step:4d}  {row.stage:<10s} t {time_text(row.time, row.dt)}  "
            f"{self._forces(state, row)}  {ratio}  "
            f"time step {interval.total} of {interval.dt:.3g} s, {speed:.0f} steps/s",
            always=False,
        )
        self._show(f"row {row.step}  {self._forces(state, row)}  {ratio}  {speed:.0f} steps/s")

    def _forces(self, state: RunState, row: Row) -> str:
        """Speed, if anything moves, and forces of a step; the work where there is no contact."""
        moving = f"V {state.speed:.3g} m/s  " if state.speed else ""
        if not self._touching:
            return f"{moving}{_work(asdict(row))}"
        return f"{moving}N {row.normal_force:.5g} N  F_T {row.friction_force:.5g} N"

    def _show(self, details: str) -> None:
        if self._bars is not None:
            self._bars.details = details

    def load_step(
        self, state: RunState, load_step: LoadStep, row: Row, steady: bool | None
    ) -> None:
        """One line of what the load step ended with."""
        how = "" if steady is None else (" steady:" if steady else " NOT steady:")
        pairs = state.last_of_pairs()
        at_end = _at_end if self._touching else _work
        several = len(pairs) > 1
        loose = len(pairs) - len(self._tied)
        together = " what is not tied:" if self._tied else " all pairs together:"
        whose = together if several and loose else ""
        viscosity = 0.0 if several else row.effective_viscosity
        line = f"{load_step.label}:{how}{whose} {at_end(asdict(row))}"
        self.tell(line + _viscosity(viscosity))
        for pair in pairs if several or not loose else ():
            bonded = pair["pair"] in self._tied
            forces = _bond(pair) if bonded else _at_end(pair)
            self.tell(f"  {pair['pair']}: {forces}{_viscosity(pair['effective_viscosity'])}")
        self._progress.end_load_step()
        if self._progress.here.ended is not None:
            self._show("all stages done; writing results and figures")

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Say that a step is tried again shorter."""
        how = "too long" if result.too_long else "not solved"
        self.say(
            f"          step of {dt:.3g} s {how} after {result.iterations} iterations "
            f"({reason_of(result)}): cut in two",
            always=False,
        )
        here = self._progress.here
        here.cuts += 1
        self._show(f"step of {dt:.3g} s cut in two, {_cuts(here)}")

    def close(self) -> None:
        """Take the bars away."""
        if self._bars is not None:
            self._bars.close()


def _terminal() -> Console | None:
    """Standard output if it is a terminal; rich, which writes on one, takes long to load."""
    if sys.stdout is None or not sys.stdout.isatty():
        return None
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True)


def _work(values: Mapping[str, Any]) -> str:
    """What moved the bodies, where no contact tells."""
    return f"work {values['external_work']:.5g} J"


def _at_end(values: Mapping[str, Any]) -> str:
    """Forces at the end of a load step, of all pairs or of one."""
    return (
        f"N {values['normal_force']:.5g} N, F_T {values['friction_force']:.5g} N, "
        f"F_T/N {values['friction_coefficient']:.4g}"
    )


def _bond(values: Mapping[str, Any]) -> str:
    """What a tied pair carries: the force on its slave."""
    parts = (f"{values[f'force_{i}']:.5g}" for i in "xyz" if f"force_{i}" in values)
    return f"tied, force on the slave ({', '.join(parts)}) N"


def _viscosity(value: float) -> str:
    return f", η_eff {value:.4g} Pa s" if value else ""


def _cuts(stage: StageProgress) -> str:
    return f"{stage.cuts} cut{'' if stage.cuts == 1 else 's'}"


def residual_text(result: StepResult, tolerance: float) -> str:
    """How well a solved step is balanced; what presses nowhere has no force but rounding."""
    last = result.residuals[-1]
    return f"residual {last:.1e}" if last <= tolerance else "residual at round-off"


class _Pace:
    """Says when the next line is due, and how fast the steps have come since the last one."""

    def __init__(self) -> None:
        self._last = self._since = time.monotonic()
        self._steps = 0

    def is_due(self) -> bool:
        now = time.monotonic()
        due = now - self._last > LINE_EVERY
        if due:
            self._last = now
        return due

    def speed(self, steps: int) -> float:
        """Steps per second since the last call, the run having made ``steps``."""
        now = time.monotonic()
        pace = (steps - self._steps) / max(now - self._since, 1e-9)
        self._since, self._steps = now, steps
        return pace


def _passed_on(event: str) -> Callable[..., None]:
    """A method that tells every observer of an event."""

    def tell(self: Together, *about: object) -> None:
        for observer in self.observers:
            getattr(observer, event)(*about)

    return tell


class Together(Observer):
    """Several observers as one, told in order."""

    def __init__(self, *observers: Observer) -> None:
        self.observers = observers

    step = _passed_on("step")
    ready = _passed_on("ready")
    within = _passed_on("within")
    load_step = _passed_on("load_step")
    attempt = _passed_on("attempt")
    cut = _passed_on("cut")


# -- The log of a run: every line is on the disk as soon as it is written --------------------------


class Log:
    """``log.txt``; lines that could not be written wait for the next that can."""

    def __init__(self, path: Path, saving: Saving, resumed: bool = False) -> None:
        self._keep = path.stat().st_size if resumed and path.is_file() else 0
        self._path, self._saving = path, saving
        self._file: GrowingFile | None = None
        self._waiting = ""
        self.write()

    def write(self, *lines: str) -> None:
        """Append lines, folded where they are long."""
        self._waiting += "".join(folded(line) + "\n" for line in lines)
        with self._saving:
            if self._file is None:
                self._file = GrowingFile(self._path, keep=self._keep)
            self._file.append(self._waiting)
            self._waiting = ""


# -- How far a run has come within its stages, by what it tells while it goes on  -----------------


@dataclass(slots=True)
class StageProgress:
    """How far one stage has come."""

    stage: Stage  # the stage
    number: int  # from 1
    velocities: tuple[float, ...]  # m/s, of its load steps; none if it has a duration
    began: float  # s, time of the run at its start
    started: float  # s, of the clock
    time: float  # s, of the run
    turned: float  # s, time of the run at the start of the one at hand
    dt: float = 0.0  # s, of the last step
    done: int = 0  # load steps done
    cuts: int = 0  # steps cut so far
    ended: float | None = None  # s, of the clock; None before
    before: float = 0.0  # share that was done when a run was gone on with

    @property
    def load_steps(self) -> int:
        """Number of load steps."""
        return max(1, len(self.velocities))

    @property
    def steps(self) -> float:
        """Steps at the velocity at hand; 0 in a stage that has a duration."""
        if self.done >= len(self.velocities) or self.stage.slip_step is None:
            return 0.0
        return (self.time - self.turned) * abs(self.velocities[self.done]) / self.stage.slip_step

    @property
    def share(self) -> float:
        """Share of the stage that is done, from 0 to 1; until steady, at least so much."""
        if self.done >= self.load_steps:
            return 1.0
        if self.stage.duration is not None:
            return min(max((self.time - self.began) / self.stage.duration, 0.0), 1.0)
        return (self.done + min(self.steps / self.stage.max_steps, 1.0)) / self.load_steps

    def seconds_left(self, now: float) -> float | None:
        """Seconds of the clock that the rest takes at the pace so far; None at the start.

        Until steady it is the most it can be.
        """
        share = self.share
        made = share - self.before
        return (now - self.started) * (1.0 - share) / made if made > 0.0 else None

    def place(self) -> str:
        """Where the stage is: its own time, or its load step and the steps at this velocity."""
        if self.stage.duration is not None:
            own = time_text(self.time - self.began, self.dt).removesuffix(" s")
            return f"{own}/{self.stage.duration:g} s"
        if self.done >= self.load_steps:
            return f"{self.load_steps} load steps"
        return (
            f"load step {self.done + 1}/{self.load_steps}, "
            f"step {self.steps:.0f}/{self.stage.max_steps}"
        )

    def time_left(self, now: float) -> str:
        """The time left in words, or the time taken by a stage that is done."""
        if self.before == 1.0:
            return "done before"
        if self.ended is not None:
            return f"done in {clock(self.ended - self.started)}"
        left = self.seconds_left(now)
        if left is None:
            return ""
        most = "" if self.stage.duration is not None else "at most "
        return f"{most}{clock(left)} left"


class StagesProgress:
    """The stages of a run, one after the other.

    Attributes:
        begun: progress of the stages begun so far; the last is the one at hand.
        now: the clock, s.
    """

    def __init__(self, case: Case, now: Callable[[], float] = time.monotonic) -> None:
        """Begin with the first stage.

        Args:
            now: the clock, s.
        """
        self._stages = case.stage
        self._conductance = case.film_conductance
        self.now = now
        self.begun: list[StageProgress] = []
        self._begin(0.0)

    @property
    def here(self) -> StageProgress:
        """The stage at hand, or the last of all."""
        return self.begun[-1]

    @property
    def count(self) -> int:
        """Number of stages, those to come included."""
        return len(self._stages)

    def at(self, time: float, dt: float) -> StageProgress:
        """The run has come to ``time`` (s), by a step of ``dt`` (s)."""
        here = self.here
        here.time, here.dt = time, dt
        return here

    def end_load_step(self) -> None:
        """A load step of the stage at hand has ended, and perhaps the stage."""
        here = self.here
        here.done, here.turned = here.done + 1, here.time
        if here.done == here.load_steps:
            here.ended = self.now()
            if len(self.begun) < self.count:
                self._begin(here.time)

    def go_on(self, ends: Iterable[tuple[float, float]], time: float, dt: float) -> None:
        """A run goes on that had come somewhere.

        Args:
            ends: s, time and last step of each load step that had ended.
            time: s, to which it had come; dt: s, its last step.
        """
        for end in ends:
            self.at(*end)
            self.end_load_step()
        self.at(time, dt)
        for one in self.begun:
            one.before = one.share

    def _begin(self, time: float) -> None:
        stage = self._stages[len(self.begun)]
        velocities = stage.velocities_within(self._conductance)
        number = len(self.begun) + 1
        self.begun.append(
            StageProgress(stage, number, velocities, time, self.now(), time=time, turned=time)
        )


def clock(seconds: float) -> str:
    """A duration as 0:05 or 1:02:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


# -- The stages of a run on a terminal: a bar for each, and a line on the step at hand  -----------

MOST_BARS = 6  # stages shown at a time
NAME_WIDTH, BAR_WIDTH = 20, 20  # characters


class StageBars:
    """Bars that stay below the lines of a run while it goes on, and vanish at its end.

    Attributes:
        details: what is said of the step at hand.
    """

    def __init__(self, progress: StagesProgress, console: Console) -> None:
        from rich.live import Live  # takes long to load, and no other run has a use for it

        self._progress = progress
        self.details = ""
        self._live = Live(
            console=console,
            transient=True,
            refresh_per_second=4,
            get_renderable=self.render,
            redirect_stderr=False,
        )
        self._live.start()

    def render(self) -> RenderableType:
        """The bars as they stand."""
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        grid = Table.grid(padding=(0, 1))
        begun = self._progress.begun[-MOST_BARS:]
        names = [f"{one.number}/{self._progress.count} {one.stage.name}" for one in begun]
        width = min(max(map(len, names)), NAME_WIDTH)
        grid.add_column(no_wrap=True, overflow="ellipsis", width=width)
        grid.add_column(width=BAR_WIDTH)
        grid.add_column(no_wrap=True, overflow="ellipsis")
        now = self._progress.now()
        for name, one in zip(names, begun, strict=True):
            said = one.time_left(now)
            if one.ended is None:
                said = ", ".join(part for part in (one.place(), said) if part)
            grid.add_row(
                Text(name), ProgressBar(total=1.0, completed=one.share, width=BAR_WIDTH), Text(said)
            )
        return Group(grid, Text(self.details, no_wrap=True, overflow="ellipsis"))

    def close(self) -> None:
        """Take the bars away."""
        self._live.stop()
