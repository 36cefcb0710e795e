"""Runs that leave a checkpoint wherever they can, go on from one of them, and are compared."""

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from tribox.app.case.case import Case
from tribox.app.run.run import run_case
from tribox.app.simulation.history import DECLARED
from tribox.app.simulation.simulation import Simulation

OFTEN = {"checkpoint_interval": 1e-9, "checkpoints_kept": 10_000}
OUTPUT = {"figures": False, "fields_every": 2}
NEAR = 1e-9
LEAST = 1e-3  # N, to which forces are compared that are nothing but rounding
WAY = ("progress.csv",)  # how a run came to its results
TABLES = ("history.csv", "contacts.csv", "surfaces.csv", "bodies.csv")


def case_of(data: dict[str, Any], **output: Any) -> Case:
    """A case that leaves checkpoints wherever it can."""
    return Case.model_validate(data | {"output": OUTPUT | OFTEN | output})


def run(
    case: Case, directory: Path, comm: MPI.Comm = MPI.COMM_SELF, resume: bool = False, **how: Any
) -> Simulation:
    """Run a case quietly, or go on with it."""
    return run_case(case, directory, quiet=True, comm=comm, resume=resume, **how)


def numbers(directory: Path) -> list[int]:
    """Numbers of the checkpoints in a results directory, rising."""
    found = (path.name for path in (directory / "checkpoints").iterdir())
    # One that is being written has another ending until it is whole; a kill may leave it.
    return sorted(int(name) for name in found if name.isdigit())


def state_of(directory: Path, number: int) -> dict[str, Any]:
    """The tree of a checkpoint, as plain data."""
    path = directory / "checkpoints" / f"{number:06d}" / "state.json"
    return json.loads(path.read_text(encoding="utf-8"))


def position_of(directory: Path, number: int) -> dict[str, Any]:
    """Where the loops of the run stood at a checkpoint."""
    return state_of(directory, number)["simulation"]["state"]["position"]


def as_killed(reference: Path, directory: Path, number: int, running: bool = False) -> Path:
    """A results directory with all files of another, but with no checkpoint after a number.

    ``running``: the summary says so, as of a run that was killed.
    """
    shutil.copytree(reference, directory)
    for later in numbers(directory):
        if later > number:
            shutil.rmtree(directory / "checkpoints" / f"{later:06d}")
    if running:
        path = directory / "summary.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"status": "running"}))
    return directory


def unlike(reference: Path, directory: Path) -> list[str]:
    """In what the tables of two results directories differ by more than is promised.

    Numbers are the same to 1e-9 of the largest of their column; of those that are small differences
    of large ones, to that of the largest with the same unit. What tells of the way to the result,
    as iterations do, may be otherwise.
    """
    ours, theirs = (sorted(_files(path)) for path in (directory, reference))
    found = [f"{name} is in one only" for name in set(ours) ^ set(theirs)]
    for name in sorted(set(ours) & set(theirs)):
        if name.endswith(".csv") and name not in WAY:
            found += unlike_tables(reference / name, directory / name, name)
    pair = [json.loads((p / "summary.json").read_text()) for p in (reference, directory)]
    for key in ("status", "steps", "title"):
        if pair[0].get(key) != pair[1].get(key):
            found.append(f"summary {key}: {pair[1].get(key)} instead of {pair[0].get(key)}")
    last = [position_of(path, numbers(path)[-1]) for path in (reference, directory)]
    return found + ([] if last[0] == last[1] else [f"stands at {last[1]} instead of {last[0]}"])


def _files(directory: Path) -> set[str]:
    skipped = ("checkpoints", "log.txt", "summary.json")
    paths = (p.relative_to(directory) for p in directory.rglob("*") if p.is_file())
    return {path.as_posix() for path in paths if path.parts[0] not in skipped}


def unlike_tables(reference: Path, other: Path, name: str) -> list[str]:
    one, two = (_columns(path) for path in (reference, other))
    if one.keys() != two.keys():
        return [f"{name} has other columns"]
    if len({len(values) for table in (one, two) for values in table.values()}) > 1:
        return [f"{name} has another number of rows"]
    found, largest = [], dict[str, float]()
    plain = [c for c in one if _is_number(one[c]) and _is_number(two[c])]
    numeric = {c: [np.array(t[c], dtype=float) for t in (one, two)] for c in plain}
    for column, (a, _) in numeric.items():
        kind = _kind(column)
        largest[kind] = max(largest.get(kind, 0.0), float(np.max(np.abs(a), initial=0.0)))
    for column in one:
        about = DECLARED.get(column)
        if about is not None and about.count and column not in ("step", "stage"):
            continue
        if column not in numeric:
            found += [] if one[column] == two[column] else [f"{name}: {column}"]
            continue
        a, b = numeric[column]
        apart = float(np.max(np.abs(a - b), initial=0.0))
        own = about is not None and not about.difference
        scale = float(np.max(np.abs(a), initial=0.0)) if own else largest[_kind(column)]
        scale *= 1e-3 if column == "twist_moment" else 1.0  # m
        if "force" in column:
            scale = max(scale, LEAST)
        if column.startswith("moment_"):
            scale = max(scale, 1e-3 * largest.get("N", 0.0))  # of its forces, at an arm
        if not apart <= NEAR * scale:
            found.append(f"{name}: {column} differs by {apart / scale if scale else np.inf:.1e}")
    return found


def _columns(path: Path) -> dict[str, list[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    return {name: [row[i] for row in rows[1:]] for i, name in enumerate(rows[0])}


def _is_number(values: list[str]) -> bool:
    try:
        return bool(np.isfinite(np.array(values, dtype=float)).all())
    except ValueError:
        return False


def _kind(column: str) -> str:
    """What a column is compared with: its unit, or the vector that it is a component of.

    A moment is compared with forces at an arm of a millimetre, about half the bodies' width.
    """
    if column == "twist_moment":
        return "N"
    about = DECLARED.get(column)
    return column.rpartition("_")[0] or column if about is None else about.unit or column
