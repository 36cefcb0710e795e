"""Goes on with a run from its last checkpoint, on as many ranks as there are now."""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from mpi4py import MPI
from pydantic import ValidationError

from tribox.app.case.case import Case
from tribox.app.checkpoint import same_case
from tribox.app.checkpoint.checkpointer import DAMAGE, INSTEAD, Checkpoint, latest, why
from tribox.app.checkpoint.layout import Layout, differences
from tribox.app.equilibrium.snapshot import Array, Snapshot
from tribox.app.errors import InputError
from tribox.app.results.claim import is_beginning
from tribox.app.results.directory import CHECKPOINTS, PROBE_TABLES, TEXT_COLUMNS
from tribox.app.results.inputs import copy_names, versions
from tribox.app.results.recorder import tables_of
from tribox.app.results.saving import on_first
from tribox.app.simulation.history import Row, time_text
from tribox.app.simulation.run_state import RunState
from tribox.app.simulation.simulation import Simulation


@dataclass(frozen=True, slots=True)
class Found:
    """The checkpoint that a run goes on from."""

    about: dict[str, Any]  # its manifest, on all ranks
    notes: list[str]  # what the user should know of it, one line each
    checkpoint: Checkpoint | None = field(default=None, repr=False)  # all of it, on the first rank

    @property
    def is_done(self) -> bool:
        """Whether the run has come to its end."""
        return bool(self.about["status"] == "done")


def find_checkpoint(directory: Path, comm: MPI.Comm) -> Found | None:
    """The last whole checkpoint, or None; collective; InputError if all are damaged or foreign."""
    found, notes = on_first(comm, lambda: _latest(directory)) or (None, [])
    about = comm.bcast(None if found is None else found.about)
    return None if about is None else Found(about, comm.bcast(notes), found)


def _latest(directory: Path) -> tuple[Checkpoint | None, list[str]]:
    """The last whole checkpoint, and notes; on the first rank."""
    if is_beginning(directory):  # what is there is what was to be cleared
        return None, []
    found, notes = latest(directory)
    if found is None and notes:  # the run began, and its tables are not to be lost
        raise InputError(
            f"{notes[0].removesuffix(INSTEAD)}, and there is no other to go on from; begin anew "
            "with --force, or name another directory with --out"
        )
    return found, notes


def go_on(simulation: Simulation, found: Found, directory: Path, extend: bool) -> Snapshot:
    """Put a run where its checkpoint was taken; what the recorder had seen; collective.

    InputError if case, files, mesh or tables are others.
    """
    model, comm = simulation.model, simulation.model.problem.comm
    checkpoint = found.checkpoint
    layout = Layout(model)
    on_first(comm, lambda: _compare(simulation, checkpoint, layout, directory))
    tree: Any = None if checkpoint is None else checkpoint.tree
    arrays: dict[str, Array] = {} if checkpoint is None else checkpoint.arrays
    kept = layout.scatter(tree, arrays)
    restore_rows(simulation.state, directory, found.about["step"], comm)
    try:
        simulation.restore(kept["simulation"])
        recorder: Snapshot = kept["recorder"]
        if found.about["status"] == "failed":
            simulation.state.position.try_again()
        if found.is_done:
            _open_again(simulation, recorder, extend)
    except DAMAGE as error:  # the tree is the same on all ranks
        raise InputError(_strange(directory, error)) from error
    return recorder


def _strange(directory: Path, error: BaseException) -> str:
    """That a checkpoint is whole, and yet not one that could be gone on from."""
    return (
        f"{directory / CHECKPOINTS}: the last checkpoint is not as this version of tribox writes "
        f"it ({why(error)}); begin anew with --force, or name another directory with --out"
    )


def started_line(found: Found, simulation: Simulation) -> str:
    """From where a run goes on, in words."""
    about, rows = found.about, simulation.rows
    dt = rows[-1].dt if rows else about["time"]
    return (
        f"goes on after step {about['step']}, stage {about['stage']}, "
        f"time {time_text(about['time'], dt)}"
    )


def _compare(
    simulation: Simulation, checkpoint: Checkpoint | None, layout: Layout, directory: Path
) -> None:
    """Refuse another case, files or mesh; on the first rank."""
    assert checkpoint is not None
    case = simulation.model.case
    try:
        began = _past_case(checkpoint.tree["case"], directory)
        at = checkpoint.tree["simulation"]["state"]["position"]["load_step"]
        load_steps = began.load_steps
        stage = began.stage.index(load_steps[min(at, len(load_steps) - 1)].stage)
    except DAMAGE as error:
        raise InputError(_strange(directory, error)) from error
    same_case.refuse(
        same_case.changes(began, case, stage, time=checkpoint.about["time"]), directory
    )
    names, sums = copy_names(began), checkpoint.about["inputs"]
    files = {
        key: names[path] for key, path in same_case.named_files(began) if key != same_case.MESH
    }
    same_case.refuse_files(
        {key: (name, sums.get(name)) for key, name in files.items()}, case, directory
    )
    mesh = {n.removeprefix("mesh/"): a for n, a in checkpoint.arrays.items() if n[:5] == "mesh/"}
    try:
        found = list(differences(layout.identity, mesh))
    except DAMAGE as error:
        raise InputError(_strange(directory, error)) from error
    if found:
        raise InputError(
            f"{directory}: the mesh is not the one of the run: {same_case.listed(found)}"
        )


def _past_case(text: str, directory: Path) -> Case:
    """The resolved case that the run began with."""
    try:
        context = {"source": directory / "case.toml", "past": True}
        return Case.model_validate(tomllib.loads(text), context=context)
    except ValidationError:
        raise InputError(
            f"{directory}: the run was begun by a version of tribox whose cases had other keys"
        ) from None


def _open_again(simulation: Simulation, recorder: Snapshot, extend: bool) -> None:
    """Let a run that is done go on with further stages, or with more of the last one."""
    at = simulation.state.position
    load_steps = simulation.model.case.load_steps
    last = load_steps[at.load_step - 1]
    if last.steps is not None and last.steps > at.count:
        at.load_step, at.begun = at.load_step - 1, True
        recorder["load_steps"] = recorder["load_steps"][:-1]
    elif at.load_step >= len(load_steps) and extend:
        raise InputError(
            "--extend: the run is done, and the case has no stage after its end: add one, or make "
            "the last one longer (duration and steps)"
        )


def version_notes(about: dict[str, Any]) -> Iterator[str]:
    """A line for each version that is another than when the checkpoint was written."""
    now = versions()
    for name, was in about["versions"].items():
        if now.get(name) != was:
            yield f"{name} is {now.get(name)}, the run was begun with {was}"


# -- The rows that a run has written, put back into its state when it goes on ----------------------

_COUNTS = tuple(f.name for f in fields(Row) if f.type in ("int", int))


def restore_rows(state: RunState, directory: Path, step: int, comm: MPI.Comm) -> None:
    """Put the rows of the first ``step`` steps back; collective; InputError if changed."""
    tables = tables_of(state)

    def read() -> list[list[dict[str, Any]]]:
        for name in PROBE_TABLES:
            _check_steps(directory / name)
        return [
            _rows(directory / f"{name}.csv", step, columns, each)
            for name, (columns, each, _) in tables.items()
        ]

    found = comm.bcast(on_first(comm, read))
    for (name, (_, _, rows)), kept in zip(tables.items(), found, strict=True):
        whole = name == "history"
        rows[:] = [Row(**row) if whole else tuple(row.values()) for row in kept]


def _rows(path: Path, last: int, columns: Sequence[str], each: int) -> list[dict[str, Any]]:
    """Rows up to a step."""
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
    """See that each row of a table, which need not be there, begins with the number of a step."""
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
