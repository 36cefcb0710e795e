"""Two sides of a comparison: how they run, what is read from them, and the tables."""

import json
import math
import shutil
from pathlib import Path

import pytest

from benchmarks import comparison
from benchmarks.bench import Options, run_bench
from benchmarks.comparison import (
    SOURCES,
    Cost,
    Difference,
    Job,
    Ran,
    Side,
    compare,
    force_difference,
    jobs_of,
    level_options,
)
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError

JOB = Job("short", 1, ("short.toml",))
SIDES = (Side("old"), Side("new"))
SHORT = ("stage.0.steps=2", "stage.1.steps=3", "output.figures=false")
OTHER_MAIN = """
import sys
if sys.argv[1] == "run":
    sys.argv += ["--set", "contact.0.friction.mu=0.1", "--set", "solver.tolerance=1e-12"]
"""


def ran(side: str = "old", cpu: float = 2.0, clock: float = 3.0, **changes) -> Ran:
    history = changes.pop("history", None) or rows()
    counts = dict.fromkeys(("dofs", "steps", "attempts", "iterations", "tangents"), 10)
    parts = {"imports": 0.5, "search": 0.25, "law": 0.25, "time integration": 0.1}
    values = counts | {"parts": parts, "history": history} | changes
    return Ran(side, Cost(cpu, clock), **values)


def rows(**columns: list[float]) -> list[dict[str, float]]:
    values = {"normal_force": [1.0, 2.0], "force_z": [0.0, 1e-15], "energy": [5.0, 6.0]} | columns
    return [
        {"step": float(i + 1), "time": 0.1 * i} | {name: v[i] for name, v in values.items()}
        for i in range(len(values["normal_force"]))
    ]


def difference(**columns: list[float]) -> Difference:
    return force_difference(ran(), ran(history=rows(**columns)))


# --- forces ---------------------------------------------------------------------------------------


def test_forces_are_compared_with_the_largest_of_their_column():
    assert difference() == Difference(0.0, "normal_force, row 1")
    found = difference(normal_force=[1.0 + 2e-6, 2.0])
    assert found.worst == pytest.approx(1e-6) and found.where == "normal_force, row 1"


def test_round_off_of_a_force_that_vanishes_is_small():
    assert difference(force_z=[1e-15, 0.0]).worst == pytest.approx(5e-14)
    # No round-off, however small beside the others.
    assert difference(force_z=[4e-5, 0.0]).worst == pytest.approx(4e-5 / 2e-2)


def test_histories_of_other_steps_cannot_be_compared():
    longer = ran(history=rows(normal_force=[1.0, 2.0, 3.0], force_z=[0.0] * 3, energy=[0.0] * 3))
    assert force_difference(ran(), longer) == Difference(math.inf, "2 and 3 rows")
    late = rows()
    late[1]["time"] = 0.2
    assert force_difference(ran(), ran(history=late)).worst == math.inf


# --- runs -----------------------------------------------------------------------------------------


def test_sides_run_in_turn_and_the_fastest_of_each_counts(monkeypatch):
    costs = iter([(3.0, 1.0), (9.0, 1.0), (2.0, 4.0), (8.0, 0.5)])
    order = []

    def fake(job: Job, side: Side, probed: bool) -> Ran:
        order.append((side.name, probed))
        return ran(side.name, *next(costs))

    monkeypatch.setattr(comparison, "run_warm", fake)
    found = compare(JOB, SIDES, 2)
    assert order == [("old", True), ("new", True)] * 2
    assert (found.first.cost.cpu, found.second.cost.cpu) == (2.0, 8.0)


@pytest.fixture(scope="module")
def other_tree(tmp_path_factory) -> Path:
    """A copy of this tree whose runs have half the friction, and iterate further."""
    tree = tmp_path_factory.mktemp("other") / "tree"
    skipped = shutil.ignore_patterns("__pycache__")
    shutil.copytree(SOURCES / "tribox", tree / "src" / "tribox", ignore=skipped)
    for name in ("app", "forms", "geometry"):
        (tree / name).symlink_to(tree / "src" / "tribox" / name)
    (tree / "benchmarks").symlink_to(SOURCES.parent / "benchmarks")
    main = tree / "src" / "tribox" / "__main__.py"
    text = main.read_text(encoding="utf-8")
    future = "from __future__ import annotations\n"
    assert future in text
    main.write_text(text.replace(future, future + OTHER_MAIN), encoding="utf-8")
    return tree


@pytest.mark.long
def test_the_other_tree_is_what_runs_and_is_probed(other_tree, block, case_file, tmp_path):
    out = tmp_path / "bench"
    run_bench(["1"], Options(case_file(block), out, 1, overrides=SHORT, against=other_tree))
    (found,) = json.loads((out / "bench.json").read_text(encoding="utf-8"))["comparisons"]
    old, new = found["sides"]
    assert old["iterations"] > new["iterations"]
    # Half the friction force, and by so much less than all of it.
    worst, where = found["forces"]
    assert 0.4 < worst < 0.7 and where.startswith(("friction", "tangential", "force_x"))
    for side in (old, new):
        assert side["steps"] == 5 and side["iterations"] >= 5
        assert {"imports", "set-up", "projection", "solve", "output"} <= side["seconds"].keys()
    text = (out / "bench.md").read_text(encoding="utf-8")
    assert f"**{new['cpu'] / old['cpu']:.3f}**" in text


# -- Which runs ``tribox bench`` makes of a case ---------------------------------------------------

ROOT = Path(__file__).parents[2]


def test_a_level_refines_both_blocks():
    case = load_case(ROOT / "cases" / "block-slide.toml")
    assert level_options(case, 1) == []
    assert level_options(case, 2) == [
        *("--set", "geometry.upper.elements=[80, 40]"),
        *("--set", "geometry.lower.elements=[122, 30]"),
    ]


def test_levels_and_values_of_a_sweep_are_runs_of_their_own():
    path = ROOT / "cases" / "sfa.toml"
    jobs = list(jobs_of(path, (1, 2)))
    labels = [label for label, _ in load_case(path).sweep_cases()]
    assert [(job.name, job.level) for job in jobs] == [(n, k) for k in (1, 2) for n in labels]
    assert jobs[1].words == (str(path), "--part", "1")
    assert jobs[-1].words[1] == "--set" and jobs[-1].words[-2:] == ("--part", f"{len(labels) - 1}")


def test_changes_of_the_case_come_before_the_level_refines_it():
    path = ROOT / "cases" / "block-slide.toml"
    (job,) = jobs_of(path, (2,), ["geometry.upper.elements=[10, 5]"])
    changed = [word for word in job.words if "upper" in word]
    assert changed == ["geometry.upper.elements=[10, 5]", "geometry.upper.elements=[20, 10]"]
    with pytest.raises(InputError, match="no_such_key"):
        list(jobs_of(path, (1,), ["no_such_key=1"]))
