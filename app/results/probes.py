"""Follows the probes of a case through its history into tables: one row per step and point."""

from __future__ import annotations

import time
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from app.build.model import Model
from app.implicit.stepper import StepResult
from app.results.body_probes import BodyProbes
from app.results.contact_probes import ContactProbes
from app.results.directory import write_table
from app.results.point_probes import PointProbes
from app.simulation.history import Row
from app.simulation.observer import Interval, Observer
from app.simulation.run_state import RunState

WRITE_EVERY = 2.0  # s between two rewrites of the tables while running
WHEN = ("step", "time", "stage")


class Table(Protocol):
    """What a table of probes offers."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns after those that say when."""
        ...

    def rows(self) -> list[tuple[object, ...]]:
        """Rows after the last step, on the first rank; collective."""
        ...


class ProbeRecorder(Observer):
    """Observer that writes the tables of the probes; all ranks take part, the first one writes.

    As a context it writes them at the end, however that comes.
    """

    def __init__(self, model: Model, directory: Path) -> None:
        """Make the tables that the case has probes for; collective.

        Args:
            model: what is solved.
            directory: of the results.
        """
        self._problem = model.problem
        self._tables = {directory / name: table for name, table in _tables(model).items()}
        self._rows: dict[Path, list[tuple[object, ...]]] = {path: [] for path in self._tables}
        self._written = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.write()

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """Add the rows of a step."""
        if not self._tables:
            return
        with self._problem.timer("output"):
            self._problem.spread(state.stepper.x)
            when = (row.step, row.time, row.stage)
            for path, table in self._tables.items():
                self._rows[path] += [(*when, *values) for values in table.rows()]
            if time.monotonic() - self._written > WRITE_EVERY:
                self.write()
                self._written = time.monotonic()

    def write(self) -> None:
        """Write what there is so far; not collective."""
        if self._problem.comm.rank == 0:
            for path, table in self._tables.items():
                write_table(path, (*WHEN, *table.columns), self._rows[path])


def _tables(model: Model) -> dict[str, Table]:
    """The tables by the names of their files."""
    probes = model.case.probe
    bodies = [(p.name, p.body) for p in probes if p.kind == "body" and p.body]
    contacts = [(p.name, p.contact, p.points) for p in probes if p.contact]
    tables: dict[str, Table] = {}
    if model.probes:
        tables["probes.csv"] = PointProbes(model, model.probes)
    if bodies:
        tables["body_probes.csv"] = BodyProbes(model, bodies)
    if contacts:
        tables["contact_probes.csv"] = ContactProbes(model, contacts)
    return tables
