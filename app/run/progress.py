"""What a run tells the person who started it: lines on the terminal and in ``log.txt``."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from app.build.load_steps import LoadStep
from app.case.stage import Stage
from app.implicit.stepper import StepResult
from app.simulation.failure_diagnosis import reason_of
from app.simulation.history import Row
from app.simulation.observer import Interval, Observer
from app.simulation.run_state import RunState

LINE_EVERY = 2.0  # s between two lines on an explicit run


class Reporter(Observer):
    """Prints one line per step, or moves a bar on a terminal; keeps all lines in the log.

    An explicit run, with its many steps, has a line every two seconds.

    Only the first rank makes one; the others use a plain :class:`Observer`.
    """

    def __init__(self, log: Path, stages: tuple[Stage, ...], quiet: bool = False) -> None:
        """Open the log.

        Args:
            log: file that receives every line.
            stages: the stages to come, for the bar.
            quiet: print warnings and results only.
        """
        self._log = log.open("w", encoding="utf-8", buffering=1)
        self._console = Console(highlight=False, soft_wrap=True)
        self._quiet = quiet
        self._bar: Progress | None = None
        self._pace = _Pace()
        if sys.stdout.isatty() and not quiet and "OMPI_COMM_WORLD_SIZE" not in os.environ:
            self._bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn(
                    "{task.completed:.0f}/{task.total:.0f} load steps, step {task.fields[step]}"
                ),
                TimeElapsedColumn(),
                console=self._console,
                transient=True,
            )
            load_steps = sum(max(1, len(stage.velocities)) for stage in stages)
            self._task = self._bar.add_task("starting", total=load_steps, step=0)
            self._bar.start()

    def say(self, line: str, *, always: bool = True) -> None:
        """Print a line and log it; lines not ``always`` printed stay in the log on a terminal."""
        self._log.write(line + "\n")
        if always or (self._bar is None and not self._quiet):
            self._console.print(line, markup=False)
            if not self._console.is_terminal:
                sys.stdout.flush()

    def note(self, line: str) -> None:
        """Log a line that somebody else prints."""
        self._log.write(line + "\n")

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """One line of the step's forces and Newton iterations; or, now and then, of a row."""
        if isinstance(result, Interval):
            if self._pace.is_due():
                self._explicit_line(state, row, result)
            return
        self.say(
            f"step {row.step:4d}  {row.stage:<10s} t {row.time:.6g} s  V {row.velocity:.3g} m/s  "
            f"N {row.normal_force:.5g} N  T {row.tangential_force:.5g} N  "
            f"Newton {row.newton_iterations} (residual {result.residuals[-1]:.1e})",
            always=False,
        )
        self._move_bar(row.stage, row.step)

    def within(self, state: RunState, load_step: LoadStep, steps: int) -> None:
        """A line where no row has come for a while."""
        if self._pace.is_due():
            speed = self._pace.speed(steps)
            self.say(
                f"time step {steps}  {load_step.stage.name:<10s} t {state.time:.8g} s  "
                f"{speed:.0f} steps/s",
                always=False,
            )
            self._move_bar(f"{load_step.label}, {speed:.0f} steps/s", state.step)

    def _explicit_line(self, state: RunState, row: Row, interval: Interval) -> None:
        speed = self._pace.speed(interval.total)
        self.say(
            f"row {row.step:4d}  {row.stage:<10s} t {row.time:.8g} s  V {row.velocity:.3g} m/s  "
            f"N {row.normal_force:.5g} N  T {row.tangential_force:.5g} N  "
            f"E_kin/E_strain {interval.kinetic_ratio:.1e}  time step {interval.total} of "
            f"{interval.dt:.3g} s, {speed:.0f} steps/s",
            always=False,
        )
        self._move_bar(f"{row.stage}, {speed:.0f} steps/s", row.step)

    def _move_bar(self, text: str, step: int) -> None:
        if self._bar is not None:
            self._bar.update(self._task, description=text, step=step)

    def load_step(
        self, state: RunState, load_step: LoadStep, row: Row, steady: bool | None
    ) -> None:
        """One line of what the load step ended with."""
        how = "" if steady is None else (" steady:" if steady else " NOT steady:")
        self.say(
            f"{load_step.label}:{how} N {row.normal_force:.5g} N, T {row.tangential_force:.5g} N, "
            f"T/N {row.friction_coefficient:.4g}"
            + (f", η_eff {row.effective_viscosity:.4g} Pa s" if row.effective_viscosity else ""),
            always=not self._quiet,
        )
        if self._bar is not None:
            self._bar.advance(self._task)

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Say that a step is tried again shorter."""
        self.say(
            f"          step of {dt:.3g} s not solved after {result.iterations} iterations "
            f"({reason_of(result)}): cut in two",
            always=False,
        )

    def close(self) -> None:
        """Stop the bar and close the log."""
        if self._bar is not None:
            self._bar.stop()
        self._log.close()


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

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Pass on."""
        for observer in self.observers:
            observer.cut(state, dt, result)
