"""Runs that leave a checkpoint wherever they can, go on from one of them, and are compared."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from tribox.app.case.case import Case
from tribox.app.run.run import run_case
from tribox.app.simulation.simulation import Simulation

OFTEN = {"checkpoint_interval": 1e-9, "checkpoints_kept": 10_000}
OUTPUT = {"figures": False, "fields_every": 2}
# What a run that was gone on with may say otherwise in its summary.
OTHERWISE = ("seconds", "resumed", "memory_MiB_per_rank", "kernels", "started", "command", "host")
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


def as_killed(reference: Path, directory: Path, number: int) -> Path:
    """A results directory with all files of another, but with no checkpoint after a number."""
    shutil.copytree(reference, directory)
    for later in numbers(directory):
        if later > number:
            shutil.rmtree(directory / "checkpoints" / f"{later:06d}")
    return directory


def unlike(reference: Path, directory: Path) -> list[str]:
    """In what two results directories differ, byte for byte, and in what their runs remember."""
    ours, theirs = (sorted(_files(path)) for path in (directory, reference))
    found = [f"{name} is in one only" for name in set(ours) ^ set(theirs)]
    for name in sorted(set(ours) & set(theirs)):
        if (reference / name).read_bytes() != (directory / name).read_bytes():
            found.append(_where(reference / name, directory / name, name))
    pair = [json.loads((p / "summary.json").read_text()) for p in (reference, directory)]
    for key in sorted({*pair[0], *pair[1]} - {*OTHERWISE}):
        if pair[0].get(key) != pair[1].get(key):
            found.append(f"summary {key}: {pair[1].get(key)} instead of {pair[0].get(key)}")
    return found + _unlike_states(reference, directory)


def _files(directory: Path) -> set[str]:
    skipped = ("checkpoints", "log.txt", "summary.json")
    paths = (p.relative_to(directory) for p in directory.rglob("*") if p.is_file())
    return {path.as_posix() for path in paths if path.parts[0] not in skipped}


def _where(reference: Path, other: Path, name: str) -> str:
    if not name.endswith(".csv"):
        return f"{name} differs"
    pairs = zip(other.read_text().splitlines(), reference.read_text().splitlines(), strict=False)
    for number, (a, b) in enumerate(pairs):
        if a != b:
            columns = reference.read_text().split("\n", 1)[0].split(",")
            cells = zip(columns, a.split(","), b.split(","), strict=True)
            wrong = [f"{c} {x} for {y}" for c, x, y in cells if x != y]
            return f"{name} differs first in line {number}: {', '.join(wrong[:4])}"
    return f"{name} has another number of lines"


def _unlike_states(reference: Path, directory: Path) -> list[str]:
    """What the last checkpoints of two runs hold otherwise."""
    last = [path / "checkpoints" / f"{numbers(path)[-1]:06d}" for path in (reference, directory)]
    trees = [json.loads((path / "state.json").read_text(encoding="utf-8")) for path in last]
    for tree in trees:
        tree["recorder"].pop("resumed")
        tree.pop("case")  # compared above, as case.toml
    found = [] if trees[0] == trees[1] else ["the state of the last checkpoint differs"]
    with np.load(last[0] / "arrays.npz") as one, np.load(last[1] / "arrays.npz") as other:
        if set(one.files) != set(other.files):
            return [*found, "the last checkpoint has other arrays"]
        wrong = [n for n in one.files if not np.array_equal(one[n], other[n], equal_nan=True)]
    return found + [f"array {name} of the last checkpoint differs" for name in wrong]
