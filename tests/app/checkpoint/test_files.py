"""Checkpoints as files: whole or not there, checked when they are read, the last few kept."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.checkpoint.going_on import case_of
from tests.app.checkpoint.small_cases import IMPLICIT
from tribox.app.build.model import build_model
from tribox.app.checkpoint.checkpointer import Checkpoint, latest, write_checkpoint
from tribox.app.checkpoint.layout import Layout, differences
from tribox.app.equilibrium.snapshot import AtPoints, Nodal, Partial
from tribox.app.errors import InputError


def checkpoint(step: int) -> Checkpoint:
    arrays = {"0": np.arange(5.0) + step, "mesh/cells": np.array([[1, 2]]), "1/0/x": np.empty(0)}
    return Checkpoint({"step": step}, {"a": [step, None, {"b": np.float64(0.1)}]}, arrays)


def names(directory: Path) -> list[str]:
    return sorted(path.name for path in (directory / "checkpoints").iterdir())


def test_what_is_written_is_read_bit_for_bit(tmp_path):
    made = checkpoint(7)
    assert write_checkpoint(tmp_path, made, 2) == tmp_path / "checkpoints" / "000001"
    found, notes = latest(tmp_path)
    assert notes == [] and found is not None
    assert found.tree == {"a": [7, None, {"b": 0.1}]} and found.about["step"] == 7
    assert found.arrays.keys() == made.arrays.keys()
    for name, array in made.arrays.items():
        assert found.arrays[name].dtype == array.dtype
        assert np.array_equal(found.arrays[name], array)


def test_without_any_there_is_none(tmp_path):
    assert latest(tmp_path) == (None, [])
    (tmp_path / "checkpoints").mkdir()
    assert latest(tmp_path) == (None, [])


@pytest.mark.parametrize("keep", [1, 2, 3])
def test_the_last_few_are_kept(tmp_path, keep):
    for step in range(1, 6):
        write_checkpoint(tmp_path, checkpoint(step), keep)
    assert names(tmp_path) == [f"{number:06d}" for number in range(6 - keep, 6)]
    assert latest(tmp_path)[0].about["step"] == 5


def _shorten(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def _change(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def _other(path: Path) -> None:
    text = path.read_text()
    assert text.count('"step": ') == 1
    path.write_text(text.replace('"step": ', '"step": 1'))


DAMAGES = {
    **{f"{name} {what.__name__}": (name, what) for name in ("state.json", "arrays.npz") for what in
       (_shorten, _change, Path.unlink)},
    "manifest gone": ("manifest.json", Path.unlink),
    "manifest cut off": ("manifest.json", _shorten),
    "manifest a list": ("manifest.json", lambda path: path.write_text("[]")),
    "manifest empty": ("manifest.json", lambda path: path.write_text("{}")),
    "manifest of a format": ("manifest.json", lambda path: path.write_text('{"format": 12}')),
    "manifest binary": ("manifest.json", lambda path: path.write_bytes(b"\xff\x00")),
    "manifest deep": ("manifest.json", lambda path: path.write_text("[" * 100_000)),
    "manifest of another": ("manifest.json", _other),
    "files a list": ("manifest.json", lambda path: path.write_text('{"format": 12, "files": []}')),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
def test_of_a_damaged_one_the_one_before_is_taken_with_a_note(tmp_path, damage):
    name, spoil = DAMAGES[damage]
    for step in (1, 2):
        write_checkpoint(tmp_path, checkpoint(step), 2)
    last = tmp_path / "checkpoints" / "000002"
    spoil(last / name)
    found, notes = latest(tmp_path)
    assert found is not None and found.about["step"] == 1
    [note] = notes
    assert note.startswith(f"{last}: is damaged (") and note.endswith("the one before it is taken")
    spoil(tmp_path / "checkpoints" / "000001" / name)
    assert latest(tmp_path)[0] is None and len(latest(tmp_path)[1]) == 2
    # The numbers go on, so that what was damaged stays to be looked at for a while.
    write_checkpoint(tmp_path, checkpoint(3), 2)
    assert latest(tmp_path)[0].about["step"] == 3


def test_one_that_was_not_finished_is_not_there(tmp_path):
    write_checkpoint(tmp_path, checkpoint(1), 2)
    shutil.copytree(tmp_path / "checkpoints" / "000001", tmp_path / "checkpoints" / "000002.part")
    found, notes = latest(tmp_path)
    assert found.about["step"] == 1 and notes == []
    write_checkpoint(tmp_path, checkpoint(2), 2)
    assert names(tmp_path) == ["000001", "000002"]


def test_another_format_is_refused_with_the_version_that_wrote_it(tmp_path):
    made = checkpoint(1)
    about = made.about | {"versions": {"tribox": "9.9"}}
    path = write_checkpoint(tmp_path, Checkpoint(about, made.tree, made.arrays), 2)
    manifest = json.loads((path / "manifest.json").read_text())
    (path / "manifest.json").write_text(json.dumps(manifest | {"format": 99}))
    said = r"of format 99, this version of tribox reads 12; .* \(9\.9"
    with pytest.raises(InputError, match=said):
        latest(tmp_path)


LIMITED = """
import resource, signal, sys
from pathlib import Path
from tests.app.checkpoint.test_files import checkpoint
from tribox.app.checkpoint.checkpointer import write_checkpoint
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
write_checkpoint(Path(sys.argv[1]), checkpoint(1), 2)
resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
try:
    write_checkpoint(Path(sys.argv[1]), checkpoint(2), 2)
except OSError as error:
    print(error.strerror)
"""


def test_a_disk_that_is_full_in_truth_leaves_those_before(tmp_path, environment):
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(tmp_path)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "File too large\n"
    assert names(tmp_path) == ["000001"] and latest(tmp_path)[0].about["step"] == 1


# -- Snapshots of all ranks in an order that ranks do not change, and back on other ranks ----------


def laid_out(comm: MPI.Comm, directory: Path, name: str) -> tuple[Layout, dict[str, Any]]:
    """A layout of a small case, and a snapshot whose values follow from places alone."""
    # One rank writes its mesh.
    data = comm.bcast(IMPLICIT[name](directory) if comm.rank == 0 else None)
    model = build_model(case_of(data), comm)
    problem = model.problem
    where = problem.space.tabulate_dof_coordinates()[: problem.owned // problem.dim, : problem.dim]
    points = [term.surface.slave.position for term in problem.contacts]
    snapshot = {
        "nodal": Nodal((2.0 * where - 1.0).reshape(-1)),
        "points": [AtPoints(pair, at + pair) for pair, at in enumerate(points)],
        "flags": AtPoints(0, points[0][:, 0] > 1e-3),
        "facets": {"deep": [AtPoints(0, (1e6 * points[0]).round().astype(np.int32))]},
        "sum": Partial(np.array([1.0, comm.rank + 1.0])),
        "array": np.arange(3.0),
        "plain": [1, "two", None, {"three": 3.0}],
    }
    return Layout(model), snapshot


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> tuple[Layout, dict[str, Any]]:
    return laid_out(MPI.COMM_SELF, tmp_path_factory.mktemp("plane"), "coulomb")


def _swap(mesh: dict[str, Any]) -> None:
    mesh["cells"] = mesh["cells"][:, [1, 2, 3, 0]]


def _shift(mesh: dict[str, Any], name: str, by: float) -> None:
    mesh[name] = mesh[name] + by


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: None, []), (lambda m: _shift(m, "nodes", 1e-14), []),
        (lambda m: _shift(m, "nodes", 2e-9), ["nodes moved by up to 2e-09 m"]),
        (lambda m: _shift(m, "points_0", 1e-3), ["points moved by up to 0.001 m"]),
        (_swap, ["other cells"]),
        (lambda m: _shift(m, "bodies", 1), ["other bodies of the cells"]),
        (lambda m: m.update(cells=m["cells"][1:]), ["28 cells instead of 29"]),
        (lambda m: m.update(points_0=m["points_0"][1:]),
         ["other facets or points: contact points"]),
        (lambda m: m.pop("points_0"), ["other facets or points: contact points"]),
    ],
    ids=range(9),
)  # fmt: skip
def test_differences_of_meshes_are_named(plane, change, said):
    kept = plane[0].identity
    mine = dict(kept)
    change(mine)
    assert list(differences(mine, kept)) == said
