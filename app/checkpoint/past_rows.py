"""The rows that a run has written, put back into its state when it goes on."""

from __future__ import annotations

import csv
from dataclasses import fields
from pathlib import Path
from typing import Any

from mpi4py import MPI

from app.errors import InputError
from app.results.directory import TEXT_COLUMNS
from app.simulation.history import Row
from app.simulation.run_state import RunState

_COUNTS = tuple(f.name for f in fields(Row) if f.type in ("int", int))


def restore_rows(state: RunState, directory: Path, step: int, comm: MPI.Comm) -> None:
    """Put the rows of the first ``step`` steps back; collective.

    Raises:
        InputError: a table has been changed.
    """
    names = ("history.csv", "contacts.csv", "surfaces.csv", "bodies.csv")
    tables: list[list[dict[str, Any]]] | str | None = None
    if comm.rank == 0:
        try:
            tables = [_rows(directory / name, step) for name in names]
        except InputError as error:
            tables = str(error)
    tables = comm.bcast(tables)
    if tables is None or isinstance(tables, str):
        raise InputError(str(tables))
    history, pairs, surfaces, bodies = tables
    motion = state.motion
    state.rows = [Row(**row) for row in history]
    state.pair_rows = [tuple(row.values()) for row in pairs]
    motion.surface_rows = [tuple(row.values()) for row in surfaces]
    motion.body_rows = [tuple(row.values()) for row in bodies]


def _rows(path: Path, last: int) -> list[dict[str, Any]]:
    """Rows up to a step.

    Raises:
        InputError: the table is not there, or is not as it was written.
    """
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            rows = []
            for row in csv.DictReader(stream):
                if int(row["step"]) > last:
                    break
                rows.append({name: _value(name, text) for name, text in row.items()})
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{path}: cannot be read ({reason}); the run cannot go on") from None
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path}: is not as the run wrote it; it cannot go on") from None
    steps = sorted({row["step"] for row in rows})
    if steps != list(range(1, last + 1)) and (rows or path.name == "history.csv"):
        raise InputError(
            f"{path}: does not hold the {last} steps that the checkpoint was taken after; the run "
            "cannot go on"
        )
    return rows


def _value(name: str, text: str) -> int | float | str:
    if name in TEXT_COLUMNS:
        return text
    return int(text) if name in _COUNTS else float(text)
