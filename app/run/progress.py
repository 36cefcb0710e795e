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
    from rich.console import Console
    from rich.progress import Progress

LINE_EVERY = 2.0  # s between two lines on an explicit run


class Reporter(Observer):
    """Prints one line per step, or moves a bar on a terminal; keeps all lines in the log.

    Only the first rank makes one; explicit runs have a line every two seconds.
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
        self._bar = StageBar(case, self._console if moving else None)

    def go_on(self, state: RunState, ends: Iterable[float], steps: int) -> None:
        """A run goes on that had come somewhere; ``ends``: s, of load steps that had ended."""
        self._bar.go_on(ends, state.time)
        self._pace.speed(steps)

    def say(self, line: str, *, always: bool = True) -> None:
        """Print a line and log it; lines not ``always`` printed stay in the log on a terminal."""
        line = self._once(line)
        self._log.write(line)
        if always or not (self._bar.shown or self._quiet):
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
        self._bar.at(row.time)
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
        said = f"step {row.step}  {self._forces(state, row)}  {residual}  {_cuts(self._bar.cuts)}"
        self._bar.show(said)

    def within(self, state: RunState, load_step: LoadStep, steps: int) -> None:
        """A line where no row has come for a while."""
        moved = state.time - self._bar.time
        self._bar.at(state.time)
        if self._pace.is_due():
            speed = self._pace.speed(steps)
            when = time_text(state.time, moved)
            self.say(
                f"time step {steps}  {load_step.stage.name:<10s} t {when}  {speed:.0f} steps/s",
                always=False,
            )
            self._bar.show(f"time step {steps}, {speed:.0f} steps/s")

    def _explicit_line(self, state: RunState, row: Row, interval: Interval) -> None:
        speed = self._pace.speed(interval.total)
        ratio = f"E_kin/E_strain {interval.kinetic_ratio:.1e}"
        self.say(
            f"row {row.step:4d}  {row.stage:<10s} t {time_text(row.time, row.dt)}  "
            f"{self._forces(state, row)}  {ratio}  "
            f"time step {interval.total} of {interval.dt:.3g} s, {speed:.0f} steps/s",
            always=False,
        )
        self._bar.show(f"row {row.step}  {self._forces(state, row)}  {ratio}  {speed:.0f} steps/s")

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
        self._bar.end_load_step()
        if self._bar.ended:
            self._bar.show("all stages done; writing results and figures")

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Say that a step is tried again shorter."""
        how = "too long" if result.too_long else "not solved"
        self.say(
            f"          step of {dt:.3g} s {how} after {result.iterations} iterations "
            f"({reason_of(result)}): cut in two",
            always=False,
        )
        self._bar.cuts += 1
        self._bar.show(f"step of {dt:.3g} s cut in two, {_cuts(self._bar.cuts)}")

    def close(self) -> None:
        """Take the bar away."""
        self._bar.close()


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
    """``log.txt``, after what it holds of a run that goes on."""

    def __init__(self, path: Path, saving: Saving, resumed: bool = False) -> None:
        keep = path.stat().st_size if resumed and path.is_file() else 0
        self._saving = saving
        self._file: GrowingFile | None = None
        with saving:
            self._file = GrowingFile(path, keep=keep)

    def write(self, *lines: str) -> None:
        """Append lines, folded where they are long."""
        if self._file is not None:
            with self._saving:
                self._file.append("".join(folded(line) + "\n" for line in lines))


# -- How far a run has come within the stage at hand: on a terminal a bar --------------------------

BAR_WIDTH, NAME_WIDTH = 20, 24  # characters
PACE_OVER = 3600.0  # s, over which the pace is taken that says what time is left


class StageBar:
    """The stages of a run one after the other; a bar of the one at hand stays below its lines.

    Attributes:
        time: s, that the run has come to; cuts: steps cut in the stage at hand.
    """

    def __init__(self, case: Case, console: Console | None) -> None:
        """Begin with the first stage; the bar is shown if there is a console."""
        self._stages, self._conductance = case.stage, case.film_conductance
        self._number = self.cuts = 0
        self.time, self._said = 0.0, ""
        self._bar: Progress | None = None
        if console is not None:
            from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
            from rich.table import Column

            # Where the terminal is narrow, name and place are cut, not bar and time.
            name = Column(no_wrap=True, overflow="ellipsis", max_width=NAME_WIDTH)
            place = Column(no_wrap=True, overflow="ellipsis", ratio=1)
            self._bar = Progress(
                TextColumn("{task.description}", markup=False, table_column=name),
                BarColumn(BAR_WIDTH),
                TimeRemainingColumn(compact=True, table_column=Column(no_wrap=True)),
                TextColumn("{task.fields[said]}", markup=False, table_column=place),
                console=console,
                transient=True,
                expand=True,
                redirect_stderr=False,
                refresh_per_second=4,
                speed_estimate_period=PACE_OVER,
            )
            self._bar.start()
        self._begin()

    @property
    def shown(self) -> bool:
        """Whether there is a bar."""
        return self._bar is not None

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
        self._draw(0.0)

    def _draw(self, share: float) -> None:
        """A bar of its own for the stage at hand: what was before says nothing of its pace."""
        if self._bar is not None:
            for old in self._bar.task_ids:
                self._bar.remove_task(old)
            name = f"{self._number}/{len(self._stages)} {self._stages[self._number - 1].name}"
            self._task = self._bar.add_task(name, total=1.0, said=self._said)
            self._bar.update(self._task, completed=share)

    def at(self, time: float) -> None:
        """The run has come to ``time``, s."""
        self.time = time
        if self._bar is not None and not self.ended:
            self._bar.update(self._task, completed=self._share())

    def _share(self) -> float:
        """Of the stage, that is done; of what runs until steady, at least so much."""
        stage = self._stages[self._number - 1]
        if stage.duration is not None:
            return min(max((self.time - self._began) / stage.duration, 0.0), 1.0)
        way = (self.time - self._turned) * abs(self._velocities[self._done])  # m, at this velocity
        steps = way / stage.slip_step if stage.slip_step else 0.0
        return (self._done + min(steps / stage.max_steps, 1.0)) / self._load_steps

    def end_load_step(self) -> None:
        """A load step of the stage at hand has ended, and perhaps the stage."""
        self._done, self._turned = self._done + 1, self.time
        if self.ended and self._number < len(self._stages):
            self._begin()
        elif self.ended and self._bar is not None:
            self._bar.update(self._task, completed=1.0)

    def go_on(self, ends: Iterable[float], time: float) -> None:
        """A run goes on that had come to ``time``, s; ``ends``: s, of load steps that had ended."""
        for end in ends:
            self.at(end)
            self.end_load_step()
        self.at(time)
        if not self.ended:
            self._draw(self._share())

    def show(self, said: str) -> None:
        """Say something of the step at hand."""
        self._said = said
        if self._bar is not None:
            self._bar.update(self._task, said=said)

    def close(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.stop()
