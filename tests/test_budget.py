"""What is noted of the costs of tests, and what is said when they have grown."""

import subprocess
import sys
from pathlib import Path

from tests import budget

MINE = "tests/test_budget.py"
COSTS = {
    ("guard", f"{MINE}::test_a[x, y]"): 1.25,
    ("guard", f"{MINE}::test_b"): 0.1,
    ("guard", f"{MINE}::test_c"): 0.15,
    ("long", f"{MINE}::test_d"): 4.0,
}
NOTED = {
    ("guard", MINE): 0.2,
    ("guard", f"{MINE}::test_a[x, y]"): 1.2,
    ("long", f"{MINE}::test_d"): 4.0,
}


def test_cheap_tests_are_noted_together_and_other_files_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[1])
    path = tmp_path / "budget.csv"
    gone, kept = ("guard", "tests/test_gone.py"), ("guard", "tests/test_layers.py::test_x")
    budget.write_budget({gone: 3.0, kept: 2.0}, path)
    budget.write_budget(COSTS, path)
    assert budget.read_budget(path) == {**NOTED, kept: 2.0}
    # A run of one tier leaves the lines of the other.
    budget.write_budget({("guard", f"{MINE}::test_b"): 0.1}, path)
    assert budget.read_budget(path) == {
        ("guard", MINE): 0.1,
        ("long", f"{MINE}::test_d"): 4.0,
        kept: 2.0,
    }


def test_growth_is_pointed_out():
    assert [line.split(":")[0] for line in budget.report(COSTS, NOTED)] == ["guard", "long"]
    more = {**COSTS, ("guard", f"{MINE}::test_a[x, y]"): 2.6, ("guard", f"{MINE}::test_new"): 0.9}
    guard, long, first, second = budget.report(more, NOTED)
    assert guard == "guard: 4 s of CPU time in 4 tests, budget 1 s"
    assert long == "long: 4 s of CPU time in 1 tests, budget 4 s"
    assert first == f"over budget: 2.6 s instead of 1.2 s: {MINE}::test_a[x, y]"
    assert second == f"over budget: 1.1 s instead of 0.2 s: {MINE}, all its cheap tests"


def test_what_has_no_budget_is_summed_up():
    # New files go by the file, as their tests have no lines of their own yet.
    new = {
        ("guard", "tests/test_new.py::test_x"): 10.1,
        ("guard", "tests/test_new.py::test_y"): 0.3,
        ("long", "tests/test_newer.py::test_z"): 5.0,
    }
    *_, last = budget.report({**COSTS, **new}, NOTED)
    assert last == "no budget yet: 3 tests in 2 files, 15.4 s together"
    assert not any("over budget" in line for line in budget.report({**COSTS, **new}, NOTED))
    *_, last = budget.report(new, {})
    assert last == "no budget yet: 3 tests in 2 files, 15.4 s together"


def test_times_of_processes_that_have_ended_count(environment):
    before = budget.cpu_time()
    subprocess.run([sys.executable, "-c", "sum(range(10**7))"], env=environment, check=True)
    assert budget.cpu_time() - before > 0.02
