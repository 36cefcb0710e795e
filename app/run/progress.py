"""What a run tells the person who started it: lines on the terminal and in ``log.txt``."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tribox.app.build.load_steps import LoadStep
from tribox.app.case.case import Case
from tribox.app.errors import SaidOnce, folded
from tribox.app.implicit.stepper import StepResult
from tribox.app.results.directory import GrowingFile
from tribox.app.results.saving import Saving
from tribox.app.run.process import drop_output, ranks_around
from tribox.app.run.stage_progress import StageProgress, StagesProgress
from tribox.app.simulation.failure_diagnosis import reason_of
from tribox.app.simulation.history import Row, time_text
from tribox.app.simulation.run_state import Interval, Observer, RunState

if TYPE_CHECKING:
    from rich.console import Console

    from tribox.app.run.stage_bars import StageBars

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
        """Open the log.

        Args:
            log: file that receives every line.
            case: that is run.
            saving: keeps errors of writing the log.
            quiet: print warnings and results only.
            console: where lines are printed; default: standard output, plainly where that is no
                terminal.
            resumed: whether the log goes on with one that is there.
        """
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
            from tribox.app.run.stage_bars import StageBars  # rich takes long to load

            self._bars = StageBars(self._progress, self._console)

    def go_on(self, state: RunState, ends: Iterable[tuple[float, float]], steps: int) -> None:
        """A run goes on that had come somewhere.

        Args:
            state: to which it had come.
            ends: s, time and last step of each load step that had ended.
            steps: explicit time steps that it had made.
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
        residual = f"residual {result.residuals[-1]:.1e}"
        linear = f", linear {row.linear_iterations}" if row.linear_iterations else ""
        self.say(
            f"step {row.step:4d}  {row.stage:<10s} t {time_text(row.time, row.dt)}  "
            f"{self._forces(state, row)}  "
            f"Newton {row.newton_iterations} ({residual}){linear}",
            always=False,
        )
        self._tell(f"step {row.step}  {self._forces(state, row)}  {residual}  {_cuts(here)}")

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
            self._tell(f"time step {steps}, {speed:.0f} steps/s")

    def _explicit_line(self, state: RunState, row: Row, interval: Interval) -> None:
        speed = self._pace.speed(interval.total)
        ratio = f"E_kin/E_strain {interval.kinetic_ratio:.1e}"
        self.say(
            f"row {row.step:4d}  {row.stage:<10s} t {time_text(row.time, row.dt)}  "
            f"{self._forces(state, row)}  {ratio}  "
            f"time step {interval.total} of {interval.dt:.3g} s, {speed:.0f} steps/s",
            always=False,
        )
        self._tell(f"row {row.step}  {self._forces(state, row)}  {ratio}  {speed:.0f} steps/s")

    def _forces(self, state: RunState, row: Row) -> str:
        """Speed, if anything moves, and forces of a step; the work where there is no contact."""
        moving = f"V {state.speed:.3g} m/s  " if state.speed else ""
        if not self._touching:
            return f"{moving}{_work(asdict(row))}"
        return f"{moving}N {row.normal_force:.5g} N  F_T {row.friction_force:.5g} N"

    def _tell(self, details: str) -> None:
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
        self.say(line + _viscosity(viscosity), always=not self._quiet)
        for pair in pairs if several or not loose else ():
            bonded = pair["pair"] in self._tied
            forces = _bond(pair) if bonded else _at_end(pair)
            line = f"  {pair['pair']}: {forces}{_viscosity(pair['effective_viscosity'])}"
            self.say(line, always=not self._quiet)
        self._progress.end_load_step()
        if self._progress.here.ended is not None:
            self._tell("all stages done; writing results and figures")

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
        self._tell(f"step of {dt:.3g} s cut in two, {_cuts(here)}")

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


class Together(Observer):
    """Several observers as one, told in order."""

    def __init__(self, *observers: Observer) -> None:
        self.observers = observers

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """Pass on."""
        for observer in self.observers:
            observer.step(state, row, result)

    def ready(self, state: RunState) -> None:
        """Pass on."""
        for observer in self.observers:
            observer.ready(state)

    def within(self, state: RunState, load_step: LoadStep, steps: int) -> None:
        """Pass on."""
        for observer in self.observers:
            observer.within(state, load_step, steps)

    def load_step(
        self, state: RunState, load_step: LoadStep, row: Row, steady: bool | None
    ) -> None:
        """Pass on."""
        for observer in self.observers:
            observer.load_step(state, load_step, row, steady)

    def attempt(
        self, state: RunState, load_step: LoadStep, dt: float, result: StepResult | Interval
    ) -> None:
        """Pass on."""
        for observer in self.observers:
            observer.attempt(state, load_step, dt, result)

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Pass on."""
        for observer in self.observers:
            observer.cut(state, dt, result)


# -- The log of a run: every line is on the disk as soon as it is written --------------------------


class Log:
    """``log.txt``; lines that could not be written wait for the next that can."""

    def __init__(self, path: Path, saving: Saving, resumed: bool = False) -> None:
        """Begin the file.

        Args:
            path: of the file.
            saving: keeps errors of writing.
            resumed: whether it goes on with one that is there.
        """
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
