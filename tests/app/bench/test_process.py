"""Runs in processes of their own: whose packages they have, and what they cost."""

from __future__ import annotations

import time

import pytest

from tribox.app.bench.process import SOURCES, environment, run_python
from tribox.app.errors import SolutionError

BURN = "import time\nwhile time.process_time() < 0.4: pass\n"


def test_packages_are_those_of_the_tree(tmp_path, monkeypatch):
    """Wherever it is started, and whatever is on the path already."""
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "__init__.py").touch()
    told = tmp_path / "told"
    text = f"import pathlib\npathlib.Path({str(told)!r}).write_text(__file__)\n"
    (tmp_path / "app" / "where.py").write_text(text, encoding="utf-8")
    monkeypatch.chdir(SOURCES)
    monkeypatch.setenv("PYTHONPATH", str(SOURCES))
    run_python(["-m", "app.where"], "a run", tmp_path)
    assert told.read_text(encoding="utf-8") == str(tmp_path / "app" / "where.py")


def test_children_of_a_process_count():
    inner = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {BURN!r}])"
    assert run_python(["-c", inner], "a run").cpu > 0.4


def test_clock_goes_on_where_the_processor_waits():
    cost = run_python(["-c", "import time; time.sleep(0.5)"], "a run")
    assert cost.clock >= 0.5 > cost.cpu


def test_cost_is_of_one_process_only():
    run_python(["-c", BURN], "before")
    started = time.perf_counter()
    cost = run_python(["-c", "pass"], "a run")
    assert cost.cpu < 0.4 and cost.clock <= time.perf_counter() - started


def test_failure_says_the_last_word():
    with pytest.raises(SolutionError, match=r"bench: a run failed: ValueError: why$"):
        run_python(["-c", "raise ValueError('why')"], "a run")


def test_variables_of_mpi_stay_here():
    ours = {"OMPI_COMM_WORLD_SIZE": "2", "PMIX_RANK": "0", "HOME": "/h", "OMP_NUM_THREADS": "8"}
    kept = environment(ours, SOURCES)
    assert kept["HOME"] == "/h" and kept["OMP_NUM_THREADS"] == "1"
    assert not {"OMPI_COMM_WORLD_SIZE", "PMIX_RANK"} & kept.keys()
