"""`run --resume` and `--extend` as their users meet them: what they say, refuse and leave alone."""

import errno
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.app.checkpoint.going_on import as_killed, numbers, unlike
from tests.app.conftest import BLOCK
from tests.app.read_log import read_log
from tests.own_law import documented_law, with_law
from tribox.app.checkpoint import checkpointer as files
from tribox.app.results import read
from tribox.app.results.reading import read_table
from tribox.app.run.progress import Together

CASE = (
    BLOCK.replace("[10, 5]", "[5, 3]")
    .replace("[15, 4]", "[7, 2]")
    .replace("steps = 3", "steps = 2")
    .replace("steps = 6", "steps = 4")
    .replace("figures = false", "figures = false\nfields_every = 2\ncheckpoint_every = 1")
    + "checkpoints_kept = 100\n"
)
LATER = '[[stage]]\nname = "back"\nduration = "1 s"\nsteps = 2\n[output]\n'
LONGER = {"stage.1.duration": '"1.5 s"', "stage.1.steps": "6"}
STEP = Together.step


def settings(keys: dict[str, str]) -> list[str]:
    return [word for key, value in keys.items() for word in ("--set", f"{key}={value}")]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of the case that has run to its end, with all its checkpoints."""
    from tribox.app.case.reading import load_case
    from tribox.app.run.run import run_case

    directory = tmp_path_factory.mktemp("finished")
    (directory / "case.toml").write_text(CASE, encoding="utf-8")
    run_case(load_case(directory / "case.toml"), directory / "out", quiet=True)
    return directory / "out"


@pytest.fixture
def killed(finished: Path, tmp_path: Path) -> Path:
    """The results as they were when the run was killed after the fourth step."""
    return as_killed(finished, tmp_path / "out", 4, running=True)


def test_it_says_from_where_it_goes_on(tribox, case_file, killed, finished):
    done = tribox("run", case_file(CASE), "--out", killed, "--resume")
    assert done.returncode == 0, done.stderr
    assert "goes on after step 4, stage slide, time 1.5 s" in done.stdout
    assert unlike(finished, killed) == []
    log = read_log(killed)
    assert "goes on after step 4" in log and log.count("results in") == 2
    assert read(killed).summary["resumed"] == [4]


def test_a_run_that_is_done_says_so(tribox, case_file, finished, tmp_path):
    directory = as_killed(finished, tmp_path / "out", 99)
    before = {p: p.stat().st_mtime_ns for p in directory.rglob("*")}
    done = tribox("run", case_file(CASE), "--out", directory, "--resume")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{directory}: the run is done; --extend goes on past its end\n"
    assert {p: p.stat().st_mtime_ns for p in directory.rglob("*")} == before


@pytest.mark.parametrize("word", ["--resume", "--extend"])
def test_to_begin_anew_and_to_go_on_exclude_each_other(tribox, case_file, killed, word):
    done = tribox("run", case_file(CASE), "--out", killed, "--force", word)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "--force begins anew, --resume and --extend go on: give one of them" in done.stderr


def test_of_a_damaged_checkpoint_the_one_before_is_taken(tribox, case_file, killed, finished):
    last = killed / "checkpoints" / "000004"
    (last / "arrays.npz").write_bytes(b"")
    done = tribox("run", case_file(CASE), "--out", killed, "--resume")
    assert done.returncode == 0 and "goes on after step 3, stage slide" in done.stdout
    assert f"note: {last}: is damaged (arrays.npz is not what was written)" in done.stdout
    assert unlike(finished, killed) == []


# -- nothing to go on from ------------------------------------------------------------------------


@pytest.mark.parametrize("there", [False, True])
def test_without_a_checkpoint_a_run_begins_anew(tribox, case_file, killed, finished, there):
    if there:  # killed before its first checkpoint
        shutil.rmtree(killed / "checkpoints")
    else:
        shutil.rmtree(killed)
    done = tribox("run", case_file(CASE), "--out", killed, "--resume")
    assert done.returncode == 0 and "goes on" not in done.stdout
    assert unlike(finished, killed) == []
    assert read(killed).summary["resumed"] == []


@pytest.mark.parametrize("what", ["done", "foreign", "no summary"])
def test_results_that_are_whole_are_never_cleared(tribox, case_file, finished, tmp_path, what):
    directory = as_killed(finished, tmp_path / "out", 99)
    shutil.rmtree(directory / "checkpoints")
    if what == "foreign":
        shutil.rmtree(directory)
        directory.mkdir()
        (directory / "thesis.tex").write_text("all of it")
    elif what == "no summary":
        (directory / "summary.json").unlink()
    before = {p: p.read_bytes() for p in directory.rglob("*") if p.is_file()}
    for word in ("--resume", "--extend"):
        done = tribox("run", case_file(CASE), "--out", directory, word)
        if what == "done" and word == "--resume":
            assert done.returncode == 0 and "the run is done" in done.stdout
        else:
            assert done.returncode == 2 and done.stderr.count("\n") == 1
            assert "no checkpoint" in done.stderr
    assert {p: p.read_bytes() for p in directory.rglob("*") if p.is_file()} == before


# -- what must be the same ------------------------------------------------------------------------

REFUSED = {
    "contact.0.friction.mu": ("0.25", "contact.0.friction.mu = 0.25 instead of 0.2"),
    "geometry.upper.elements": ("[6, 3]", "geometry.upper.elements = [6, 3] instead of [5, 3]"),
    "stage.0.steps": ("3", "stage.0.steps = 3 instead of 2"),
    "stage.1.steps": ("3", "stage.1.steps = 3 instead of 4"),
    "solver.linear": ('"krylov"', 'solver.linear = "krylov" instead of "direct"'),
}


@pytest.mark.parametrize("key", REFUSED)
def test_another_case_is_refused_by_the_key_that_differs(tribox, case_file, killed, key):
    value, said = REFUSED[key]
    before = {p: p.read_bytes() for p in killed.rglob("*") if p.is_file()}
    words = ["--set", f"{key}={value}", "--resume"]
    done = tribox("run", case_file(CASE), "--out", killed, *words)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert f"{killed}: the case is not the one of the run: " in done.stderr
    assert said in done.stderr
    assert {p: p.read_bytes() for p in killed.rglob("*") if p.is_file()} == before


ALLOWED = {
    "title": '"another"', "output.fields_every": "0", "output.checkpoint_every": "0",
    "solver.tolerance": "1e-9", "solver.max_iterations": "30", "solver.min_step_fraction": "1e-3",
    "solver.partition": '"cells"', "geometry.max_cells": "10000", "stage.1.duration": '"1.25 s"\n',
    "probe": '[{ name = "upper", body = "elastomer" }]',
}  # fmt: skip


@pytest.mark.parametrize("keys", [tuple(ALLOWED)[:8], tuple(ALLOWED)[8:]], ids=range(2))
def test_what_may_change_is_allowed(tribox, case_file, killed, keys):
    chosen = {key: ALLOWED[key].strip() for key in keys}
    if "stage.1.duration" in chosen:
        chosen["stage.1.steps"] = "5"
    done = tribox("run", case_file(CASE), "--out", killed, "--resume", *settings(chosen))
    assert done.returncode == 0, done.stderr
    rows = read_table(killed / "history.csv")
    assert [row["step"] for row in rows] == list(range(1, 8 if "stage.1.steps" in chosen else 7))
    if "probe" in chosen:  # from the step on that the run goes on after
        steps = [row["step"] for row in read_table(killed / "body_probes.csv")]
        assert steps == [5, 6, 7]


def test_another_mesh_is_refused(tribox, case_file, killed):
    path = killed / "checkpoints" / "000004"
    found, _ = files.latest(killed)
    found.arrays["mesh/nodes"][3] += 1e-5
    files.write_checkpoint(killed, found, 100)
    assert path.with_name("000005").is_dir()
    done = tribox("run", case_file(CASE), "--out", killed, "--resume")
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "the mesh is not the one of the run: nodes moved by up to 1e-05 m" in done.stderr


ROOF = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
1 1 "roof"
$EndPhysicalNames
$Nodes
2
1 1 0.01 0
2 -1 0.01 0
$EndNodes
$Elements
1
1 1 2 1 1 1 2
$EndElements
"""
UNDER_A_ROOF = """
[tools.roof]
shape = "mesh"
file = "roof-2.msh"
surface = "roof"
[[contact]]
slave = "top"
master = "roof"
friction = { law = "frictionless" }
"""


def test_a_law_or_tool_that_was_changed_is_refused(tribox, case_file, tmp_path):
    path = case_file(with_law(CASE) + UNDER_A_ROOF)
    law, roof = path.with_name("my_law.py"), path.with_name("roof-2.msh")
    law.write_text(documented_law())
    roof.write_text(ROOF)
    words = ("run", path, "--out", tmp_path / "out", "--trust")
    done = tribox(*words, "--set", "stage.1.max_steps=9")
    done = tribox(*words)
    assert done.returncode == 0, done.stderr
    again = tribox(*words, "--resume")
    assert again.returncode == 0 and "the run is done" in again.stdout, again.stderr
    other, third = ROOF.replace("0.01 0", "0.02 0"), path.with_name("roof-3.msh")
    third.write_text(other)
    elsewhere = settings({"tools.roof.file": '"roof-3.msh"'})
    for now, how in ((third, ["--extend", *elsewhere]), (roof, ["--extend"]), (roof, ["--resume"])):
        now.write_text(other)
        done = tribox(*words, *how, *(settings(LONGER) if "--extend" in how else ()))
        assert done.returncode == 2 and done.stderr.count("\n") == 1
        assert f"tools.roof.file: {now} is not the file that the run was" in done.stderr
        assert done.stderr.endswith(f"{tmp_path / 'out' / 'inputs' / 'roof-2.msh'}\n")
    third.write_text(ROOF)
    roof.write_text(ROOF)
    law.write_text(documented_law().replace("closed = pressure > 0.0", "closed = pressure > 1.0"))
    done = tribox(*words, "--extend", *settings(LONGER))
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "my_law.py is not the file that the run was begun with, a copy of which" in done.stderr
    law.write_text(documented_law())
    assert tribox(*words, "--extend", *settings(LONGER), *elsewhere).returncode == 0
    assert "the run is done" in tribox(*words, "--resume", *settings(LONGER), *elsewhere).stdout


# -- past the end ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("how", "ended"), [("longer", True), ("further stage", False), ("both", True)]
)
def test_a_run_goes_on_past_its_end(tribox, case_file, finished, tmp_path, how, ended):
    """As if it had been asked for all of it in the beginning, also where it was stopped before."""
    text = CASE if how == "longer" else CASE.replace("[output]\n", LATER)
    path, keys = case_file(text), {} if how == "further stage" else LONGER
    whole, directory = tmp_path / "whole", as_killed(finished, tmp_path / "out", 99 if ended else 4)
    assert tribox("run", path, "--out", whole, *settings(keys)).returncode == 0
    words = ["run", path, "--out", directory, "--extend", *settings(keys)]
    done = tribox(*words)
    assert done.returncode == 0, done.stderr
    assert unlike(whole, directory) == []
    again = tribox(*words)
    assert again.returncode == 2 and "--extend: the run is done" in again.stderr


def test_past_the_end_there_must_be_something(tribox, case_file, finished, tmp_path):
    directory = as_killed(finished, tmp_path / "out", 99)
    done = tribox("run", case_file(CASE), "--out", directory, "--extend")
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "the run is done, and the case has no stage after its end" in done.stderr
    assert unlike(finished, directory) == []


# -- stopped, failed, full ------------------------------------------------------------------------


def at_step(monkeypatch: pytest.MonkeyPatch, number: int, action: Callable[[], None]) -> None:
    """Have something happen after a step."""

    def step(self: Together, *arguments: object) -> None:
        STEP(self, *arguments)
        if arguments[1].step == number:
            action()

    monkeypatch.setattr(Together, "step", step)


def test_a_run_that_was_told_to_stop_goes_on(tribox, case_file, finished, tmp_path, monkeypatch):
    """Without a checkpoint of its own choice: the one that is written then is enough."""
    never = ("--set", "output.checkpoint_every=0")
    words = ("run", case_file(CASE), "--out", tmp_path / "out", *never)
    with monkeypatch.context() as patch:
        at_step(patch, 4, lambda: os.kill(os.getpid(), signal.SIGTERM))
        stopped = tribox(*words)
    assert stopped.returncode == 130 and numbers(tmp_path / "out") == [1]
    done = tribox(*words, "--resume")
    assert done.returncode == 0 and "goes on after step 4" in done.stdout
    assert unlike(finished, tmp_path / "out") == []


def test_a_run_that_failed_goes_on_with_more_patience(
    tribox, case_file, finished, tmp_path, monkeypatch
):
    words = ("run", case_file(CASE), "--out", tmp_path / "out")
    impatient = settings({"solver.max_iterations": "1", "solver.min_step_fraction": "0.5"})
    failed = tribox(*words, *impatient)
    assert failed.returncode == 3
    assert tribox(*words, *impatient, "--resume").returncode == 3
    done = tribox(*words, "--resume")
    assert done.returncode == 0, done.stderr
    assert len(read(tmp_path / "out").history) == len(read(finished).history)


def test_a_full_disk_leaves_the_last_checkpoint(tribox, case_file, finished, tmp_path, monkeypatch):
    def full(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    words = ("run", case_file(CASE), "--out", tmp_path / "out")
    with monkeypatch.context() as patch:
        at_step(patch, 4, lambda: patch.setattr(files, "_fill", full))
        failed = tribox(*words)
    assert failed.returncode == 4 and failed.stderr.count("\n") == 1
    assert "no checkpoint could be written ([Errno 28] No space left on device)" in failed.stderr
    results = read(tmp_path / "out")
    assert results.summary["status"] == "failed" and len(results.history) == 4
    assert numbers(tmp_path / "out") == [1, 2, 3]
    done = tribox(*words, "--resume")
    assert done.returncode == 0 and "goes on after step 3" in done.stdout
    assert unlike(finished, tmp_path / "out") == []
