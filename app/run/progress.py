"""What a run tells the person who started it: lines on the terminal and in ``log.txt``."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tribox.app.case.case import Case
from tribox.app.case.stage import LoadStep
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
    from rich.progress import Progress

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
        self._touching = any(not contact.tied for contact in case.contact)
        self._tied = {contact.label for contact in case.contact if contact.tied}
        self._once = SaidOnce()
        moving = self._console is not None and ranks_around() == 1 and not quiet
        if moving and self._console is not None:
            moving = self._console.file.isatty() and not self._console.is_dumb_terminal
        self._bars = StageBars(case, self._console if moving else None)

    def go_on(self, state: RunState, ends: Iterable[tuple[float, float]], steps: int) -> None:
        """A run goes on that had come somewhere.

        Args:
            ends: s, time and last step of each load step that had ended.
        """
        dt = state.rows[-1].dt if state.rows else state.time
        self._bars.go_on(ends, state.time, dt)
        self._pace.speed(steps)

    def say(self, line: str, *, always: bool = True) -> None:
        """Print a line and log it; lines not ``always`` printed stay in the log on a terminal."""
        line = self._once(line)
        self._log.write(line)
        if always or not (self._bars.shown or self._quiet):
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
        self._bars.at(row.time, row.dt)
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
        said = f"step {row.step}  {self._forces(state, row)}  {residual}  {_cuts(self._bars.cuts)}"
        self._bars.show(said)

    def within(self, state: RunState, load_step: LoadStep, steps: int) -> None:
        """A line where no row has come for a while."""
        moved = state.time - self._bars.time
        self._bars.at(state.time, moved)
        if self._pace.is_due():
            speed = self._pace.speed(steps)
            when = time_text(state.time, moved)
            self.say(
                f"time step {steps}  {load_step.stage.name:<10s} t {when}  {speed:.0f} steps/s",
                always=False,
            )
            self._bars.show(f"time step {steps}, {speed:.0f} steps/s")

    def _explicit_line(self, state: RunState, row: Row, interval: Interval) -> None:
        speed = self._pace.speed(interval.total)
        ratio = f"E_kin/E_strain {interval.kinetic_ratio:.1e}"
        self.say(
            f"row {row.step:4d}  {row.stage:<10s} t {time_text(row.time, row.dt)}  "
            f"{self._forces(state, row)}  {ratio}  "
            f"time step {interval.total} of {interval.dt:.3g} s, {speed:.0f} steps/s",
            always=False,
        )
        self._bars.show(f"row {row.step}  {self._forces(state, row)}  {ratio}  {speed:.0f} steps/s")

    def _forces(self, state: RunState, row: Row) -> str:
        """Speed, if anything moves, and forces of a step; the work where there is no contact."""
        moving = f"V {state.speed:.3g} m/s  " if state.speed else ""
        if not self._touching:
            return f"{moving}{_work(asdict(row))}"
        return f"{moving}N {row.normal_force:.5g} N  F_T {row.friction_force:.5g} N"

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
        self._bars.end_load_step()
        if self._bars.ended:
            self._bars.show("all stages done; writing results and figures")

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Say that a step is tried again shorter."""
        how = "too long" if result.too_long else "not solved"
        self.say(
            f"          step of {dt:.3g} s {how} after {result.iterations} iterations "
            f"({reason_of(result)}): cut in two",
            always=False,
        )
        self._bars.cuts += 1
        self._bars.show(f"step of {dt:.3g} s cut in two, {_cuts(self._bars.cuts)}")

    def close(self) -> None:
        """Take the bars away."""
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


def _cuts(count: int) -> str:
    return f"{count} cut{'' if count == 1 else 's'}"


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


# -- How far a run has come within its stages: on a terminal a bar for each ------------------------

MOST_BARS = 6  # stages shown at a time
BAR_WIDTH, NAME_WIDTH = 20, 24  # characters
PACE_OVER = 3600.0  # s, over which the pace is taken that says what time is left


class StageBars:
    """The stages of a run one after the other; bars of them stay below its lines and vanish.

    Attributes:
        time: s, that the run has come to; cuts: steps cut in the stage at hand.
    """

    def __init__(self, case: Case, console: Console | None) -> None:
        """Begin with the first stage; bars are shown if there is a console."""
        self._stages, self._conductance = case.stage, case.film_conductance
        self._number = self.cuts = 0
        self.time = 0.0
        self._details = ""
        self._bars: Progress | None = None
        if console is not None:
            self._show_on(console)
        self._begin()

    def _show_on(self, console: Console) -> None:
        from rich.console import Group
        from rich.live import Live
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
        from rich.table import Column
        from rich.text import Text

        # Where the terminal is narrow, names and places are cut, not bars and times.
        name, place = (
            TextColumn(f"{{task.{what}}}", markup=False, table_column=column)
            for what, column in (
                ("description", Column(no_wrap=True, overflow="ellipsis", max_width=NAME_WIDTH)),
                ("fields[place]", Column(no_wrap=True, overflow="ellipsis", ratio=1)),
            )
        )
        left = TimeRemainingColumn(compact=True, table_column=Column(no_wrap=True))
        bars = Progress(
            name, BarColumn(BAR_WIDTH), left, place, speed_estimate_period=PACE_OVER, expand=True
        )

        def rendered() -> RenderableType:
            return Group(bars, Text(self._details, no_wrap=True, overflow="ellipsis"))

        self._bars = bars
        self._live = Live(
            console=console,
            transient=True,
            refresh_per_second=4,
            get_renderable=rendered,
            redirect_stderr=False,
        )
        self._live.start()

    @property
    def shown(self) -> bool:
        """Whether there are bars."""
        return self._bars is not None

    @property
    def ended(self) -> bool:
        """Whether all stages are done."""
        return self._done == self._load_steps

    def _begin(self) -> None:
        """Begin the next stage."""
        stage = self._stages[self._number]
        self._number += 1
        self._velocities = stage.velocities_within(self._conductance)  # m/s; none with a duration
        self._load_steps = max(1, len(self._velocities))
        self._began = self._turned = self.time  # s, of the stage and the load step at hand
        self._done = self.cuts = 0
        if self._bars is not None:
            name = f"{self._number}/{len(self._stages)} {stage.name}"
            self._task = self._bars.add_task(name, total=1.0, place="")
            for old in self._bars.task_ids[:-MOST_BARS]:
                self._bars.update(old, visible=False)

    def at(self, time: float, dt: float) -> None:
        """The run has come to ``time`` (s), by a step of ``dt`` (s)."""
        self.time = time
        if self._bars is not None and not self.ended:
            share, place = self._come_to(dt)
            self._bars.update(self._task, completed=share, place=place)

    def _come_to(self, dt: float) -> tuple[float, str]:
        """Share of the stage that is done, until steady at least so much, and where that is."""
        stage = self._stages[self._number - 1]
        if stage.duration is not None:
            own = self.time - self._began
            place = f"{time_text(own, dt).removesuffix(' s')}/{stage.duration:g} s"
            return min(max(own / stage.duration, 0.0), 1.0), place
        way = (self.time - self._turned) * abs(self._velocities[self._done])  # m, at this velocity
        steps = way / stage.slip_step if stage.slip_step else 0.0
        place = f"load step {self._done + 1}/{self._load_steps}, step {steps:.0f}/{stage.max_steps}"
        return (self._done + min(steps / stage.max_steps, 1.0)) / self._load_steps, place

    def end_load_step(self) -> None:
        """A load step of the stage at hand has ended, and perhaps the stage."""
        self._done, self._turned = self._done + 1, self.time
        if not self.ended:
            return
        if self._bars is not None:
            self._bars.update(self._task, completed=1.0, place="done")
        if self._number < len(self._stages):
            self._begin()

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
        if self._bars is not None and not self.ended:
            # What was done before says nothing of the pace.
            self._bars.reset(self._task)
            self._bars.tasks[-1].completed = self._come_to(dt)[0]

    def show(self, details: str) -> None:
        """Say something of the step at hand."""
        self._details = details

    def close(self) -> None:
        """Take the bars away."""
        if self._bars is not None:
            self._live.stop()
