"""Runs as processes that are killed, and go on: the same bytes in the end, nothing twice."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.app.checkpoint.going_on import unlike, unlike_tables
from tests.app.checkpoint.small_cases import COARSE, changed
from tests.app.checkpoint.test_resume import CASE
from tests.app.conftest import BLOCK, SLID
from tests.app.run.test_signals import SWEEP, of_run
from tests.own_law import documented_law, with_law
from tests.ranks import LIMIT, ROOT, called, mpi_environment
from tribox.app.case.toml_files import toml_text
from tribox.app.results import read

OUTPUT = {"figures": False, "fields_every": 3, "checkpoint_every": 2, "checkpoint_interval": 0.3}
CASES = {
    "implicit": changed(BLOCK, COARSE | {"stage.1.steps": 24}),
    "explicit": changed(SLID, {"stage.1.duration": "40 us", "stage.1.steps": 30}),
    "sweep": changed(BLOCK + SWEEP, COARSE | {"stage.1.steps": 6}),
}


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
    """Rows that a run, or all runs of a sweep, have written so far."""
    found = 0
    for path in (*out.glob("history.csv"), *out.glob("*/history.csv")):
        with contextlib.suppress(FileNotFoundError):
            found += max(path.read_bytes().count(b"\n") - 1, 0)
    return found


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


def unlike_sweeps(reference: Path, out: Path) -> list[str]:
    """In what the results of two sweeps differ."""
    found = unlike_tables(reference / "sweep.csv", out / "sweep.csv", "sweep.csv")
    for part in sorted(path.parent.name for path in reference.glob("*/history.csv")):
        found += [f"{part}: {line}" for line in unlike(reference / part, out / part)]
    return found


def left_alone(kind: str, directory: Path) -> tuple[Path, Path]:
    """A case file and the results of its run, which nobody disturbs; it is run once."""
    path, reference = directory / f"{kind}.toml", directory / f"{kind} reference"
    if not reference.exists():
        data = CASES[kind] | {"title": kind, "output": OUTPUT}
        path.write_text(toml_text(data), encoding="utf-8")
        code, said = called("run", path, "--out", reference)
        assert code == 0, said
    return path, reference


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory in which each case is left alone once, for all tests."""
    return tmp_path_factory.mktemp("work")


@pytest.mark.parametrize("kind", ["implicit", pytest.param("sweep", marks=pytest.mark.long)])
def test_a_killed_run_goes_on_with_the_same_bytes(work, kind, tmp_path):
    path, reference, out = *left_alone(kind, work), tmp_path / "out"
    # Early: on a quick machine the last rows may be written before the kill comes.
    kill_after(start(path, out), out, rows_in(reference) // 5)
    assert rows_in(out) < rows_in(reference)
    finish(start(path, out, "--resume"))
    if kind == "sweep":
        assert unlike_sweeps(reference, out) == []
        assert any(read(run).summary["resumed"] for run in out.glob("*=*"))
    else:
        assert unlike(reference, out) == [] and read(out).summary["resumed"]
    written = {path: path.stat().st_mtime_ns for path in out.glob("**/history.csv")}
    code, again = called("run", path, "--out", out, "--resume")
    assert code == 0  # nothing is left to be done
    assert {path: path.stat().st_mtime_ns for path in written} == written
    if kind != "sweep":
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
