"""The tables of a run: a row for each converged step, and each pair, surface, body, tool at it."""

from __future__ import annotations

import math
from dataclasses import astuple, replace
from pathlib import Path

from tribox.app.results.directory import GrowingTable
from tribox.app.simulation.history import COLUMNS
from tribox.app.simulation.run_state import RunState


class RunTables:
    """``history.csv``, ``surfaces.csv``, ``bodies.csv``; ``contacts.csv``, ``tools.csv`` if any."""

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
        for table in tables:
            if table is not None:
                table.sync()
