"""Runs whose results cannot be written any more: one line, code 4, all that fits is kept."""

import errno
import json
import os
import shutil
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from mpi4py import MPI

from tests.app.conftest import BLOCK
from tribox.app.case.case import Case
from tribox.app.errors import OutputError
from tribox.app.results.directory import GrowingFile
from tribox.app.run.progress import Together
from tribox.app.run.run import run_case

FROM = 4  # the step from which the disk is full, or the directory gone
APPEND, STEP = GrowingFile.append, Together.step
KINDS = ("tables", "field", "contact", "gone", "replaced")


def no_room(*arguments: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextmanager
def spoilt(directory: Path, kind: str) -> Iterator[None]:
    """From step ``FROM`` on there is no room for files of a kind, or the directory is another."""
    now = False

    def step(self: Together, *arguments: Any) -> None:
        nonlocal now
        now = arguments[1].step >= FROM
        first = now and MPI.COMM_WORLD.rank == 0
        if first and kind in ("gone", "replaced") and not (directory / "of_another").exists():
            shutil.rmtree(directory, ignore_errors=True)
            if kind == "replaced":
                directory.mkdir()
                (directory / "of_another").touch()
        STEP(self, *arguments)

    def append(self: GrowingFile, text: str) -> None:
        if now and kind == "tables":
            no_room()
        APPEND(self, text)

    def write(path: Path, *arguments: Any) -> None:
        if kind in path.parent.name and arguments[-1] >= FROM:
            no_room()

    with patch.object(Together, "step", step), patch.object(GrowingFile, "append", append):
        if kind in ("field", "contact"):
            with patch("tribox.app.results.output_files.write_vtu", write):
                yield
        else:
            yield


def ended(comm, root: Path) -> dict[str, Any]:
    """What small runs leave, and what they raise on all ranks."""
    case, found = Case.model_validate(tomllib.loads(BLOCK)), {}
    for kind in KINDS:
        directory, said = root / kind, "nothing"
        with spoilt(directory, kind):
            try:
                run_case(case, directory, quiet=True, comm=comm)
            except OutputError as error:
                said = str(error).removeprefix(f"{directory}: ")
        tables = {path.stem: path.read_text().count("\n") - 1 for path in directory.glob("*.csv")}
        summary = directory / "summary.json"
        found[kind] = {
            "said": comm.allgather(said),
            "files": sorted(path.name for path in directory.glob("*")),
            "tables": tables,
            "status": json.loads(summary.read_text())["status"] if summary.exists() else None,
        }
    return found


def rows(steps: int) -> dict[str, int]:
    """Of each table, after so many steps."""
    of_two = dict.fromkeys(("bodies", "surfaces"), 2 * steps)
    return of_two | {"history": steps, "contacts": steps, "progress": FROM}


@pytest.mark.mpi(ended, 2)
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_full_disk_keeps_the_history_and_ends_all_ranks(on_ranks, ranks):
    """What is lost is the step that could not be written; of a directory that is gone, all."""
    found = on_ranks(ended, ranks)
    for kind, said in {"gone": "No such file or directory", "replaced": ""}.items():
        gone = found.pop(kind)
        assert gone["said"][0].startswith(f"cannot be written ({said}")
        assert gone["said"] == ranks * gone["said"][:1] and not gone["tables"]
        assert gone["files"] == ["of_another"] * (kind == "replaced")
    for kind, left in found.items():
        assert left["said"] == ranks * ["cannot be written (No space left on device)"], kind
        assert left["tables"] == rows(FROM - (kind == "tables"))
        assert left["status"] == "failed"
        assert not [n for n in left["files"] if n.startswith("tribox.") or n.endswith(".part")]
