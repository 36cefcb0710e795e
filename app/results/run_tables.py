"""The tables of a run: a row for each converged step, and each pair, surface, body, tool at it.

``progress.csv`` has a row for each attempt at an implicit step, whether it converged or not, and
for each interval of an explicit stage, also the one in which a run fails.
"""

from __future__ import annotations

import math
from dataclasses import astuple, replace
from pathlib import Path

from tribox.app.build.load_steps import LoadStep
from tribox.app.case.stage import solver_of
from tribox.app.implicit.stepper import StepResult
from tribox.app.results.directory import GrowingTable
from tribox.app.simulation.history import COLUMNS
from tribox.app.simulation.observer import Interval
from tribox.app.simulation.run_state import RunState

ATTEMPT_COLUMNS = (
    *("step", "stage", "attempt", "time", "dt", "fraction", "converged"),
    *("iterations", "factorisations", "residual", "reason", "cuts"),
    *("time_steps", "time_step", "kinetic_ratio"),
)


def attempt_row(
    state: RunState, load_step: LoadStep, dt: float, result: StepResult | Interval
) -> tuple[int | float | str, ...]:
    """A row of ``progress.csv``: an attempt of ``dt`` (s) at the step after the last one."""
    failures = state.position.failures
    case = state.model.case
    stepped = {s.name for s in case.stage if solver_of(s, case.solver.kind) == "implicit"}
    cuts = sum(row.attempts - 1 for row in state.rows if row.stage in stepped) + failures
    if isinstance(result, Interval):
        return (
            *(state.step + 1, load_step.label, 1),
            *(state.time, dt, dt / load_step.dt, int(not result.failed)),
            *(0, 0, math.nan, 0, cuts),
            *(result.steps, result.dt, result.kinetic_ratio),
        )
    return (
        *(state.step + 1, load_step.label, failures + 1),
        *(state.time + dt, dt, dt / load_step.dt, int(result.converged)),
        *(result.iterations, result.factorisations),
        result.residuals[-1] if result.residuals else math.nan,
        result.reason,
        cuts + (not result.converged),
        *(0, math.nan, math.nan),
    )


class RunTables:
    """``history.csv``, ``surfaces.csv``, ``bodies.csv``; others where there is what they tell."""

    def __init__(self, directory: Path, state: RunState, after: int | None = None) -> None:
        """Begin the files, or go on with those of a run ``after`` a step of it."""
        motion = state.motion
        self._driven = {stage.name for stage in state.model.case.stage if stage.is_driven}
        self._history = GrowingTable(directory / "history.csv", COLUMNS, after)
        self._surfaces = GrowingTable(directory / "surfaces.csv", motion.surface_columns, after)
        self._bodies = GrowingTable(directory / "bodies.csv", motion.body_columns, after)
        self._tools: GrowingTable | None = None
        if state.model.problem.tools:
            self._tools = GrowingTable(directory / "tools.csv", state.tools.columns, after)
        self._contacts: GrowingTable | None = None
        if state.model.case.contact:
            self._contacts = GrowingTable(directory / "contacts.csv", state.pair_columns, after)

        path, tried = directory / "progress.csv", state.position.failures
        self._progress = GrowingTable(path, ATTEMPT_COLUMNS, after, tried)

    def add_attempt(self, row: tuple[int | float | str, ...]) -> None:
        """Append an attempt, see :func:`attempt_row`."""
        self._progress.extend([row])

    def write(self, state: RunState) -> None:
        """Append the rows that are new."""
        motion = state.motion
        new = state.rows[self._history.written :]
        self._history.extend(
            [
                astuple(row if row.stage in self._driven else replace(row, velocity=math.nan))
                for row in new
            ]
        )
        if self._contacts is not None:
            self._contacts.extend(state.pair_rows[self._contacts.written :])
        self._surfaces.extend(motion.surface_rows[self._surfaces.written :])
        self._bodies.extend(motion.body_rows[self._bodies.written :])
        if self._tools is not None:
            self._tools.extend(state.tools.rows[self._tools.written :])

    def sync(self) -> None:
        """See that the rows are on the disk."""
        tables = (self._history, self._contacts, self._surfaces, self._bodies, self._tools)
        for table in (*tables, self._progress):
            if table is not None:
                table.sync()
