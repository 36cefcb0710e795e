"""The rows that a run has written, put back into its state when it goes on."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from mpi4py import MPI

from tribox.app.errors import InputError
from tribox.app.results.directory import PROBE_TABLES, TEXT_COLUMNS
from tribox.app.results.first_rank import on_first
from tribox.app.simulation.history import COLUMNS, Row
from tribox.app.simulation.run_state import RunState

_COUNTS = tuple(f.name for f in fields(Row) if f.type in ("int", int))


def restore_rows(state: RunState, directory: Path, step: int, comm: MPI.Comm) -> None:
    """Put the rows of the first ``step`` steps back; collective.

    Raises:
        InputError: a table has been changed.
    """
    motion, case = state.motion, state.model.case
    names = {
        "history.csv": (COLUMNS, 1),
        "contacts.csv": (state.pair_columns, len(case.contact)),
        "surfaces.csv": (motion.surface_columns, len(motion.surfaces)),
        "bodies.csv": (motion.body_columns, len(state.model.problem.solids)),
    }

    tools = state.model.problem.tools
    if tools:
        names["tools.csv"] = (state.tools.columns, len(tools))

    def read() -> list[list[dict[str, Any]]]:
        for name in PROBE_TABLES:
            _check_steps(directory / name)
        return [_rows(directory / name, step, *kind) for name, kind in names.items()]

    history, pairs, surfaces, bodies, *tool_rows = comm.bcast(on_first(comm, read))
    state.rows = [Row(**row) for row in history]
    state.pair_rows = [tuple(row.values()) for row in pairs]
    motion.surface_rows = [tuple(row.values()) for row in surfaces]
    motion.body_rows = [tuple(row.values()) for row in bodies]
    state.tools.rows = [tuple(row.values()) for rows in tool_rows for row in rows]


def _rows(path: Path, last: int, columns: Sequence[str], each: int) -> list[dict[str, Any]]:
    """Rows up to a step.

    Args:
        path: of the table.
        last: number of the step.
        columns: of the table.
        each: number of rows of a step.

    Raises:
        InputError: the table is not there, or is not as it was written.
    """
    if last == 0 or each == 0:  # the tables may not have begun, or are not written
        return []
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            lines = csv.reader(line for line in stream if line.endswith("\n"))  # whole ones
            if tuple(next(lines, ())) != tuple(columns):
                raise ValueError("other columns")
            rows = []
            for line in lines:
                if int(line[0]) > last:
                    break
                named = zip(columns, line, strict=True)
                rows.append({name: _value(name, text) for name, text in named})
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{path}: cannot be read ({reason}); the run cannot go on") from None
    except (LookupError, ValueError, csv.Error):
        raise InputError(f"{path}: is not as the run wrote it; it cannot go on") from None
    if [row["step"] for row in rows] != [n for n in range(1, last + 1) for _ in range(each)]:
        raise InputError(
            f"{path}: does not hold the {last} steps that the checkpoint was taken after; the run "
            "cannot go on"
        )
    return rows


def _check_steps(path: Path) -> None:
    """See that each row of a table, which need not be there, begins with the number of a step.

    Raises:
        InputError: one does not.
    """
    try:
        for row in path.read_bytes().splitlines(keepends=True)[1:]:
            if row.endswith(b"\n"):
                int(row.split(b",", 1)[0])
    except FileNotFoundError:
        return
    except (OSError, ValueError):
        raise InputError(f"{path}: is not as the run wrote it; it cannot go on") from None


def _value(name: str, text: str) -> int | float | str:
    if name in TEXT_COLUMNS:
        return text
    return int(text) if name in _COUNTS else float(text)
