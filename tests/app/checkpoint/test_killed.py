"""Runs as processes that are killed, and go on: the same bytes in the end, nothing twice."""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from tests.app.checkpoint.campaign import CASES, campaign, finish, kill_after, left_alone, start
from tests.app.checkpoint.going_on import numbers, unlike
from tests.app.checkpoint.small_cases import changed
from tests.app.checkpoint.test_resume import CASE
from tests.app.run.test_signals import statuses
from tests.own_law import documented_law, with_law
from tests.ranks import LIMIT, ROOT, called, mpi_environment
from tribox.app.case.toml_files import toml_text
from tribox.app.results import read

MOMENTS = int(os.environ.get("TRIBOX_KILLS", "0"))


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory in which each case is left alone once, for all tests."""
    return tmp_path_factory.mktemp("work")


@pytest.mark.parametrize("kind", ["implicit 2D", pytest.param("sweep", marks=pytest.mark.long)])
def test_a_killed_run_goes_on_with_the_same_bytes(work, kind):
    [killed] = campaign([kind], 0, work)
    assert killed.unlike == [] and 0 < killed.row < killed.rows
    assert "step" in killed.after
    out = work / f"{kind} 0 0"
    written = {path: path.stat().st_mtime_ns for path in out.glob("**/history.csv")}
    code, again = called("run", work / f"{kind}.toml", "--out", out, "--resume")
    assert code == 0  # nothing is left to be done
    assert {path: path.stat().st_mtime_ns for path in written} == written
    if kind != "sweep":
        assert again == f"{out}: the run is done; --extend goes on past its end\n"


FEW_FILES = {"output.fields_every": 0, "output.checkpoint_every": 4, "stage.1.steps": 1}


@pytest.mark.long
def test_a_run_that_is_killed_at_any_rename_goes_on_with_the_same_bytes(tmp_path):
    """Into a new directory and into one with other results, with a copied law among the files."""
    path = tmp_path / "case.toml"
    data = changed(with_law(CASE), FEW_FILES)
    path.write_text(toml_text(data), encoding="utf-8")
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


@pytest.mark.long
@pytest.mark.skipif(not MOMENTS, reason="takes 10 s for each of TRIBOX_KILLS moments")
def test_kills_at_random_moments(work):
    kinds = (list(CASES) * MOMENTS)[:MOMENTS]
    for killed in campaign(kinds, random.SystemRandom().randrange(1, 10**6), work):
        print(killed)
        assert killed.unlike == [], killed


@pytest.mark.long
def test_a_run_may_be_killed_again_and_again(work, tmp_path):
    path, reference, out = *left_alone("explicit 2D", work), tmp_path / "out"
    for row, words in ((8, ()), (16, ("--resume",))):
        kill_after(start(path, out, *words), out, row, 0.0)
    finish(start(path, out, "--resume"))
    assert unlike(reference, out) == []
    resumed = read(out).summary["resumed"]
    assert len(resumed) == 2 and resumed == sorted(set(resumed))


@pytest.mark.mpi
@pytest.mark.long
def test_ranks_that_are_killed_go_on_as_many(work, tmp_path):
    """Two ranks write the same bytes again as two ranks."""
    path, _ = left_alone("implicit 2D", work)
    out, reference = tmp_path / "out", tmp_path / "two"
    finish(start(path, reference, "--np", "2"))
    kill_after(start(path, out, "--np", "2"), out, 10, 0.0)
    assert statuses(out) == {"out": "running"} and numbers(out)
    finish(start(path, out, "--np", "2", "--resume"))
    assert unlike(reference, out) == []
