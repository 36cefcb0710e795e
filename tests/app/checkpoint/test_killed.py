"""Runs as processes that are killed, and go on: the same bytes in the end, nothing twice."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.app.checkpoint.going_on import unlike
from tests.app.checkpoint.small_cases import COARSE, changed
from tests.app.checkpoint.test_resume import CASE
from tests.app.conftest import BLOCK
from tests.app.run.test_signals import of_run
from tests.own_law import documented_law, with_law
from tests.ranks import LIMIT, ROOT, called, mpi_environment
from tribox.app.case.toml_files import toml_text
from tribox.app.results import read

OUTPUT = {"figures": False, "fields_every": 3, "checkpoint_every": 2, "checkpoint_interval": 0.3}
KILLED = changed(BLOCK, COARSE | {"stage.1.steps": 24})


def start(path: Path, out: Path, *words: str) -> subprocess.Popen[str]:
    """Start a run as a process."""
    return subprocess.Popen(
        [sys.executable, "-m", "tribox", "run", str(path), "--out", str(out), *words],
        cwd=ROOT,
        env=mpi_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> str:
    """Wait for a run that is to come to its end; what it said."""
    said, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, said
    return said


def rows_in(out: Path) -> int:
    """Rows that a run has written so far."""
    path = out / "history.csv"
    return max(path.read_bytes().count(b"\n") - 1, 0) if path.exists() else 0


def kill_after(process: subprocess.Popen[str], out: Path, rows: int) -> None:
    """Kill a run, with all its processes at once, when it has written so many rows."""
    ends = time.monotonic() + LIMIT
    while rows_in(out) < rows:
        assert process.poll() is None and time.monotonic() < ends, "the run ended too early"
        time.sleep(0.002)
    processes = of_run(out)
    for sent in (signal.SIGSTOP, signal.SIGKILL):  # none is left that ends the others in good order
        for number in processes:
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, sent)
    process.kill()
    process.communicate()
    while of_run(out):
        time.sleep(0.01)


def test_a_killed_run_goes_on_with_the_same_bytes(tmp_path):
    path, reference, out = tmp_path / "case.toml", tmp_path / "reference", tmp_path / "out"
    path.write_text(toml_text(KILLED | {"title": "killed", "output": OUTPUT}), encoding="utf-8")
    code, said = called("run", path, "--out", reference)
    assert code == 0, said
    # Early: on a quick machine the last rows may be written before the kill comes.
    kill_after(start(path, out), out, rows_in(reference) // 5)
    assert rows_in(out) < rows_in(reference)
    finish(start(path, out, "--resume"))
    assert unlike(reference, out) == [] and read(out).summary["resumed"]
    written = (out / "history.csv").stat().st_mtime_ns
    code, again = called("run", path, "--out", out, "--resume")
    assert code == 0  # nothing is left to be done
    assert (out / "history.csv").stat().st_mtime_ns == written
    assert again == f"{out}: the run is done; --extend goes on past its end\n"


FEW_FILES = {"output.fields_every": 0, "output.checkpoint_every": 4, "stage.1.steps": 1}


@pytest.mark.long
def test_a_run_that_is_killed_at_any_rename_goes_on_with_the_same_bytes(tmp_path):
    """Into a new directory and into one with other results, with a copied law among the files."""
    path = tmp_path / "case.toml"
    path.write_text(toml_text(changed(with_law(CASE), FEW_FILES)), encoding="utf-8")
    (tmp_path / "my_law.py").write_text(documented_law(), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "tests.app.checkpoint.at_renames", str(path), str(tmp_path / "out")],
        cwd=ROOT,
        env=mpi_environment(),
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    lines = done.stdout.splitlines()
    assert done.returncode == 0 and len(lines) > 12, done.stderr
    assert all(line.endswith("done, same bytes") for line in lines), done.stdout + done.stderr
