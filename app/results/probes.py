"""Follows the probes of a case through its history into tables: one row per step and point."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from tribox.app.build.model import Model
from tribox.app.implicit.stepper import StepResult
from tribox.app.results.body_probes import BodyProbes
from tribox.app.results.contact_probes import ContactProbes, NodeTable, ShapeTable, SurfaceLines
from tribox.app.results.directory import PROBE_TABLES, GrowingTable, has_rows, read_table
from tribox.app.results.point_probes import PointProbes
from tribox.app.results.saving import Saving
from tribox.app.simulation.history import Row
from tribox.app.simulation.motion_history import KEYS
from tribox.app.simulation.observer import Interval, Observer
from tribox.app.simulation.run_state import RunState


class Table(Protocol):
    """What a table of probes offers."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns after those that say when, known once there are rows."""
        ...

    def rows(self) -> list[tuple[object, ...]]:
        """Rows after the last step, on the first rank; collective."""
        ...


class ProbeRecorder(Observer):
    """Observer that follows the probes; all ranks take part, the first one writes."""

    def __init__(
        self,
        model: Model,
        directory: Path,
        saving: Saving | None = None,
        after: int | None = None,
    ) -> None:
        """Make the tables that the case has probes for; collective.

        Args:
            model: what is solved.
            directory: of the results.
            saving: keeps errors of writing; None: nobody asks for them.
            after: step that a run goes on after; rows of later ones are dropped.
        """
        self._saving, self._after = saving or Saving(directory), after
        self._problem = model.problem
        self._tables = {directory / name: table for name, table in _tables(model).items()}
        self._files: dict[Path, GrowingTable] = {}
        self._waiting: dict[Path, list[tuple[object, ...]]] = {}
        if after is not None and self._problem.comm.rank == 0:
            with self._saving:
                self._cut(after)

    def _cut(self, after: int) -> None:
        """Go on with the tables that are there, without the rows after a step."""
        for path in self._tables:
            if has_rows(path):
                self._files[path] = GrowingTable(path, (), after)

    def sync(self) -> None:
        """See that the rows written so far are on the disk; for the first rank."""
        for file in self._files.values():
            file.sync()

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """Append the rows of a step."""
        if not self._tables:
            return
        with self._problem.timer("output"):
            self._problem.spread(state.stepper.x)
            for path, table in self._tables.items():
                rows = [(row.step, row.time, row.stage, *values) for values in table.rows()]
                self._waiting.setdefault(path, []).extend(rows)
                with self._saving:
                    self._write(path)

    def close(self) -> None:
        """Write rows that could not be written before; not collective."""
        for path in self._waiting:
            with self._saving:
                self._write(path)

    def _write(self, path: Path) -> None:
        """Append the rows that wait; there are none but on the first rank."""
        rows = self._waiting[path]
        if not rows:
            return
        if path not in self._files:
            self._files[path] = GrowingTable(
                path, (*KEYS, *self._tables[path].columns), self._after
            )
        self._files[path].extend(rows)
        rows.clear()


def _tables(model: Model) -> dict[str, Table]:
    """The tables by the names of their files."""
    probes = model.case.probe
    bodies = [(p.name, p.body) for p in probes if p.kind == "body" and p.body]
    contacts = [(p.name, p.contact, p.points) for p in probes if p.contact]
    tables: dict[str, Table] = {}
    points_table, body_table, contact_table, shape_table, node_table = PROBE_TABLES
    if model.probes:
        tables[points_table] = PointProbes(model, model.probes)
    if bodies:
        tables[body_table] = BodyProbes(model, bodies)
    if contacts:
        tables[contact_table] = ContactProbes(model, contacts)
    if model.lines:
        lines = SurfaceLines(model)
        tables[shape_table], tables[node_table] = ShapeTable(lines), NodeTable(lines)
    return tables


def final_shapes(directory: Path, ends: Sequence[int]) -> dict[str, dict[str, float | None]]:
    """The last row of each probe of a surface by its name, with its springback, rad.

    That is the bend angle at the end of the load step in which it was largest, less the last one.

    Args:
        directory: of the results.
        ends: numbers of the steps that load steps ended with.
    """
    path, found = directory / PROBE_TABLES[3], {}
    if not has_rows(path):
        return {}
    rows = read_table(path)
    for name in dict.fromkeys(str(row["probe"]) for row in rows):
        mine = [row for row in rows if row["probe"] == name]
        bent = [float(row["bend_angle"]) for row in mine if int(row["step"]) in ends]
        last = {key: value for key, value in mine[-1].items() if key not in (*KEYS, "probe")}
        most = max(bent, key=abs, default=math.nan)
        last["springback"] = most - last["bend_angle"]
        found[name] = {k: float(v) if math.isfinite(v) else None for k, v in last.items()}
    return found


def shape_line(name: str, shape: Mapping[str, Any]) -> str:
    """What the log says of a shape of :func:`final_shapes` in the end."""
    springback = shape["springback"]
    back = "" if springback is None else f", springback {math.degrees(springback):.4g} deg"
    radius = "straight" if shape["radius"] is None else f"radius {shape['radius']:.4g} m"
    thick = ""
    if shape["mean_thickness"] is not None:
        least, most = shape["min_thickness"], shape["max_thickness"]
        thick = f", thickness {least:.4g} to {most:.4g} m"
    bent = math.degrees(shape["bend_angle"])
    return f"probe {name}: bent by {bent:.4g} deg{back}, {radius}{thick}"
