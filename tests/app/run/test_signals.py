"""Runs that are stopped, killed or left by their terminal, as processes: codes, files, orphans."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.app.read_log import read_log
from tests.ranks import LIMIT, called
from tribox.app.results import read
from tribox.app.results.directory import LOCK
from tribox.app.run.process import is_first_rank, ranks_around

STEP = re.compile(r"(\[.*\] )?(step|row|time step) +\d+ ")
SWEEP = '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, 0.2, 0.3]\n'
SAID = "finishing the step at hand; Ctrl-C, or the same signal again, stops at once"
Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start(case_file, block, environment, tmp_path) -> Iterator[Start]:
    """Starts a run into ``tmp_path / "out"``, of minutes unless told otherwise."""
    began: list[subprocess.Popen[str]] = []

    def begin(kind: str, *words: str, steps: int = 5000, nohup: bool = False):
        path, out = case_file(block + SWEEP * (kind == "sweep")), tmp_path / "out"
        length = ["--set", f"stage.1.steps={steps}"]
        command = [sys.executable, "-m", "tribox", "run", str(path), "--out", str(out), *length]
        hangup = signal.SIG_IGN if nohup else signal.SIG_DFL
        process = subprocess.Popen(
            [*command, *words],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            bufsize=1,
            preexec_fn=lambda: signal.signal(signal.SIGHUP, hangup),
        )
        began.append(process)
        return process

    yield begin
    for process in began:
        process.kill()
        process.wait()
        process.stdout.close()
    for number in of_run(tmp_path / "out"):
        with contextlib.suppress(ProcessLookupError):
            os.kill(number, signal.SIGKILL)


def of_run(out: Path) -> dict[int, list[str]]:
    """Processes that write into a directory or below, with their command lines."""
    found = {}
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, UnicodeDecodeError):
            words = (path / "cmdline").read_bytes().decode().split("\0")
            if "--out" in words and words[words.index("--out") + 1].startswith(str(out)):
                found[int(path.name)] = words
    return found


def read_steps(process: subprocess.Popen[str], count: int = 3) -> None:
    """Read what is printed until a number of steps have been made."""
    for line in process.stdout:
        count -= STEP.match(line) is not None
        if count == 0:
            return
    pytest.fail("the run ended too early")


def statuses(out: Path) -> dict[str, str]:
    """How the runs say that they ended, by their directories' names."""
    found = {path.parent.name: path.read_text() for path in out.rglob("summary.json")}
    return {name: json.loads(text)["status"] for name, text in found.items()}


def assert_tidy(out: Path) -> None:
    """All processes are gone, and so are the files that only a run that goes on has."""
    assert not of_run(out)
    assert not [p for p in out.rglob("*") if p.name == LOCK or p.suffix == ".part"]


def assert_stopped(process: subprocess.Popen[str], out: Path) -> None:
    said, _ = process.communicate(timeout=LIMIT)
    assert process.returncode == 130 and "Traceback" not in said
    assert said.count("\ntribox: interrupted; the results so far are saved") == 1
    assert "prterun" not in said and "MPI_ABORT" not in said
    assert SAID in said
    assert_tidy(out)


LOST = """
import os
try:
    os.kill(os.getpid(), {})
except BaseException:
    raise {} from None
"""
INDENTED = LOST.replace("\n", "\n    ")


@pytest.mark.parametrize(
    ("module", "number", "text"),
    [
        ("typer", signal.SIGINT, LOST),
        ("dolfinx", signal.SIGTERM, LOST),
        # Where the case is read.
        ("tomllib", signal.SIGINT, "TOMLDecodeError = ValueError\ndef loads(text):" + INDENTED),
    ],
    ids=lambda given: given if isinstance(given, str) and given.isalpha() else "",
)
def test_a_signal_while_the_program_starts_is_no_traceback(
    case_file, block, environment, tmp_path, module, number, text
):
    """It comes while a module is imported, which makes another error of an exception."""
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / f"{module}.py").write_text(
        text.format(int(number), "ImportError('in the middle')")
    )
    path = f"{tmp_path / 'first'}{os.pathsep}{environment['PYTHONPATH']}"
    words = ["run", str(case_file(block)), "--out", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-P", "-m", "tribox", *words],
        env=environment | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
        timeout=LIMIT,
    )
    assert (done.returncode, done.stderr) == (130, "tribox: interrupted\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("around", "ranks", "first"),
    [
        ({}, 1, True),
        ({"OMPI_COMM_WORLD_SIZE": "3", "OMPI_COMM_WORLD_RANK": "1", "PMIX_RANK": "1"}, 3, False),
        # What srun --mpi=pmix sets, and what stands around a job's script.
        ({"PMIX_RANK": "1", "SLURM_STEP_NUM_TASKS": "2", "SLURM_NTASKS": "2"}, 2, False),
        ({"PMIX_RANK": "0", "SLURM_STEP_NUM_TASKS": "2"}, 2, True),
        ({"SLURM_STEP_NUM_TASKS": "2", "SLURM_NTASKS": "2"}, 1, True),
        ({"PMI_RANK": "1", "PMI_SIZE": "2"}, 2, False),
    ],
)
def test_ranks_are_known_by_what_starts_them(monkeypatch, around, ranks, first):
    for name in os.environ:
        if name.startswith(("OMPI_", "PMI", "SLURM_")):
            monkeypatch.delenv(name)
    for name, value in around.items():
        monkeypatch.setenv(name, value)
    assert (ranks_around(), is_first_rank()) == (ranks, first)


def long(*values: object):
    return pytest.param(*values, marks=pytest.mark.long)


def test_a_signal_stops_a_run_after_its_step(start, tmp_path):
    process, out = start("single"), tmp_path / "out"
    read_steps(process)
    process.send_signal(signal.SIGHUP)
    assert_stopped(process, out)
    results = read(out)
    assert results.summary["status"] == "interrupted" and results.unfinished is None
    assert results.summary["steps"] == len(results.history)


@pytest.mark.parametrize(
    ("number", "whom"),
    [(signal.SIGTERM, "tribox"), long(signal.SIGUSR1, "prterun")],
)
def test_a_signal_stops_all_ranks(start, tmp_path, number, whom):
    process, out = start("single", "--np", "2"), tmp_path / "out"
    read_steps(process)
    starters = [pid for pid, words in of_run(out).items() if words[0].endswith("prterun")]
    assert len(starters) == 1 and len(of_run(out)) == 4
    if whom == "tribox":
        process.send_signal(number)
        assert_stopped(process, out)
    else:
        os.kill(starters[0], number)
        assert process.wait(LIMIT) == 130
        assert_tidy(out)
    results = read(out)
    assert results.summary["status"] == "interrupted" and results.summary["ranks"] == 2
    assert results.summary["steps"] == len(results.history) >= 3


def test_a_signal_to_a_sweep_stops_its_runs(start, tmp_path):
    process, out = start("sweep", "--jobs", "1"), tmp_path / "out"
    read_steps(process)
    process.send_signal(signal.SIGTERM)
    assert_stopped(process, out)
    assert statuses(out) == {"mu=0.1": "interrupted", "out": "interrupted"}
    parts = json.loads((out / "summary.json").read_text())["parts"]
    assert [parts[label]["status"] for label in ("mu=0.1", "mu=0.2", "mu=0.3")] == [
        *("interrupted", "not run", "not run")
    ]
    assert parts["mu=0.1"]["steps"] == len(read(out / "mu=0.1").history) >= 3
    assert (out / "sweep.csv").is_file()


@pytest.mark.long
def test_who_is_killed_leaves_no_orphans(start, tmp_path):
    process, out = start("single", "--np", "2"), tmp_path / "out"
    read_steps(process)
    process.kill()
    process.wait()
    ends = time.monotonic() + LIMIT
    while of_run(out) and time.monotonic() < ends:
        time.sleep(0.1)
    assert not of_run(out)
    assert json.loads((out / "summary.json").read_text())["status"] == "interrupted"


def test_a_run_outlives_its_pipe_and_its_terminal(start, tmp_path):
    process, out = start("single", steps=12, nohup=True), tmp_path / "out"
    read_steps(process, 1)
    process.stdout.close()
    process.send_signal(signal.SIGHUP)
    assert process.wait(LIMIT) == 0
    assert statuses(out) == {"out": "done"} and len(read(out).history) == 15
    assert read_log(out).splitlines()[-1] == f"results in {out}"
    assert_tidy(out)


def test_a_killed_run_is_readable_and_in_nobodys_way(start, case_file, block, tmp_path):
    process, out = start("single"), tmp_path / "out"
    read_steps(process)
    # Meanwhile nobody else may have the directory, whatever they say.
    second = start("single", "--force")
    said, _ = second.communicate(timeout=LIMIT)
    assert second.returncode == 2 and f"{out}: tribox is writing there (process " in said
    assert read(out).unfinished == f"goes on, as process {process.pid} on {os.uname().nodename}"
    process.kill()
    process.wait()
    with (out / "history.csv").open("a") as stream:
        stream.write("7,0.5,sli")  # as if it had been killed in the middle of a row
    results = read(out)
    assert results.summary["status"] == "running" and len(results.history) >= 3
    assert list(results.history.step) == list(range(1, len(results.history) + 1))
    assert len(results.fields().points) and results.steps[0] == 1
    code, told = called("report", out)
    assert code == 0 and "note: the run ended from outside; this is what it had written" in told
    code, told = called("run", case_file(block), "--out", out, "--force")
    assert code == 0 and statuses(out) == {"out": "done"}, told


@pytest.mark.parametrize(("target", "code"), [("closed", 0), ("/dev/full", 4)])
def test_what_is_printed_to_nobody_is_no_traceback(environment, target, code):
    if target == "closed":
        reader, writer = os.pipe()
        os.close(reader)
    else:
        writer = os.open(target, os.O_WRONLY)
    try:
        command = [sys.executable, "-m", "tribox", "schema"]
        told = subprocess.run(
            command, env=environment, stdout=writer, stderr=subprocess.PIPE, text=True, check=False
        )
    finally:
        os.close(writer)
    assert told.returncode == code
    assert told.stderr.count("\n") == (code > 0) and "Traceback" not in told.stderr
