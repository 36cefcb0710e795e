"""Checkpoints as files: whole or not there, checked when they are read, the last few kept."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tribox.app.checkpoint import checkpointer as files
from tribox.app.checkpoint.checkpointer import Checkpoint, latest, write_checkpoint
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
    "manifest binary": ("manifest.json", lambda path: path.write_bytes(b"\xff\x00")),
    "manifest deep": ("manifest.json", lambda path: path.write_text("[" * 100_000)),
    "manifest of another": ("manifest.json", _other),
    "files a list": ("manifest.json", lambda path: path.write_text('{"format": 5, "files": []}')),
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
    said = r"of format 99, this version of tribox reads 5; .* \(9\.9"
    with pytest.raises(InputError, match=said):
        latest(tmp_path)


@pytest.mark.parametrize("name", ["_fill", "_sync"])
def test_a_write_that_fails_leaves_those_before(tmp_path, monkeypatch, name):
    for step in (1, 2):
        write_checkpoint(tmp_path, checkpoint(step), 2)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}

    def fail(path: Path, *more: object) -> None:
        (path / "state.json").write_text("half") if path.is_dir() else None
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(files, name, fail)
        with pytest.raises(OSError, match="No space left"):
            write_checkpoint(tmp_path, checkpoint(3), 2)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


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
