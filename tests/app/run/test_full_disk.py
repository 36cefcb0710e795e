"""Runs whose results cannot be written any more: one line, code 4, all that fits is kept."""

import errno
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from tests.app.conftest import BLOCK
from tests.ranks import LIMIT
from tribox.app.case.case import Case
from tribox.app.errors import OutputError
from tribox.app.results import read
from tribox.app.results.directory import RESERVE, GrowingFile
from tribox.app.run.progress import Together
from tribox.app.run.run import run_case

FROM = 4  # the step from which the disk is full, or the directory gone
APPEND, STEP = GrowingFile.append, Together.step


def no_room(*arguments: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@contextmanager
def full(directory: Path, what: str) -> Iterator[None]:
    """A disk that has no room but what the reserve takes, after the step before ``FROM``."""
    now = False

    def step(self: Together, *arguments: Any) -> None:
        nonlocal now
        now = arguments[1].step >= FROM
        STEP(self, *arguments)

    def append(self: GrowingFile, text: str) -> None:
        if now and (directory / RESERVE).exists():
            no_room()
        APPEND(self, text)

    with patch.object(Together, "step", step):
        if what == "tables":
            with patch.object(GrowingFile, "append", append):
                yield
        else:
            name = "tribox.app.results.output_files.write_vtu"

            def write(path: Path, *arguments: Any) -> None:
                if what in path.parent.name and arguments[-1] >= FROM:
                    no_room()

            with patch(name, write):
                yield


@contextmanager
def deleted(directory: Path) -> Iterator[None]:
    """A results directory that somebody deletes after the step before ``FROM``."""

    def step(self: Together, *arguments: Any) -> None:
        if arguments[1].step == FROM:
            shutil.rmtree(directory, ignore_errors=True)
        STEP(self, *arguments)

    with patch.object(Together, "step", step):
        yield


def ended(comm, directory: Path, where) -> dict[str, Any]:
    """What is left of a small run, and what it raised on all ranks."""
    case = Case.model_validate(tomllib.loads(BLOCK))
    said = "nothing"
    with where:
        try:
            run_case(case, directory, quiet=True, comm=comm)
        except OutputError as error:
            said = str(error).removeprefix(f"{directory}: ")
    all_said = comm.allgather(said)
    summary = json.loads((directory / "summary.json").read_text())
    tables = {path.stem: path.read_text().count("\n") - 1 for path in directory.glob("*.csv")}
    files = sorted(path.name for path in directory.iterdir())
    return {"said": all_said, "files": files, "tables": tables, "status": summary["status"]}


def full_disk(comm, directory: Path) -> dict[str, Any]:
    kinds = ("tables", "field", "contact")
    return {kind: ended(comm, directory / kind, full(directory / kind, kind)) for kind in kinds}


def directory_gone(comm, directory: Path) -> dict[str, Any]:
    return ended(comm, directory / "out", deleted(directory / "out"))


ROWS = {"history": FROM, "contacts": FROM, "bodies": 2 * FROM, "surfaces": 2 * FROM}


@pytest.mark.mpi(full_disk, 2)
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_full_disk_keeps_the_history_on_all_ranks(on_ranks, ranks):
    for kind, found in on_ranks(full_disk, ranks).items():
        assert found["said"] == ranks * ["cannot be written (No space left on device)"], kind
        assert found["tables"] == ROWS | {"progress": FROM} and found["status"] == "failed"
        assert not [n for n in found["files"] if n.startswith("tribox.") or n.endswith(".part")]


@pytest.mark.mpi(directory_gone, 2)
@pytest.mark.parametrize("ranks", [1, 2])
def test_of_a_directory_that_is_deleted_the_history_is_written_again(on_ranks, ranks):
    found = on_ranks(directory_gone, ranks)
    assert found["said"] == ranks * ["cannot be written (No such file or directory: log.txt)"]
    assert found["tables"] == ROWS | {"progress": 0} and found["status"] == "failed"
    assert "case.toml" in found["files"]


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 1.5 MB; made by root only."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1500k", "none", str(disk)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("needs the right to mount")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.mpi
@pytest.mark.long
@pytest.mark.parametrize("ranks", [1, 2])
def test_a_disk_that_becomes_full_in_truth(small_disk, case_file, block, environment, ranks):
    out = small_disk / "out"
    words = ["run", str(case_file(block)), "--out", str(out), "--np", str(ranks)]
    words += ["--set", "stage.1.steps=500"]
    told = subprocess.run(
        [sys.executable, "-m", "tribox", *words],
        env=environment,
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert told.returncode == 4
    said = re.escape(f"tribox: {out}: cannot be written (No space left on device")
    assert re.fullmatch(said + r"(: \w+\.csv)?\)\n", told.stderr)  # a table, if it came first
    results = read(out)
    assert results.summary["status"] == "failed" and len(results.history) >= 1
    assert results.summary["steps"] == len(results.history) == len(results.contacts)
    assert len(results.fields().points)
