"""Two sides of a comparison: how they run, what is read from them, and the tables."""

from __future__ import annotations

import json
import math
import re
import shutil
import time
from pathlib import Path

import pytest

from benchmarks import comparison
from benchmarks.bench import Options, all_jobs, in_order, job_table, run_bench
from benchmarks.comparison import (
    SOURCES,
    Comparison,
    Cost,
    Difference,
    Job,
    Ran,
    Side,
    compare,
    compiled_since,
    environment,
    force_difference,
    jobs_of,
    level_options,
    run_python,
    run_warm,
    sides_of,
)
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError, SolutionError

JOB = Job("short", 1, ("short.toml",))
SIDES = (Side("old"), Side("new"))
SHORT = ("stage.0.steps=2", "stage.1.steps=3", "output.figures=false")
OTHER_MAIN = """
import sys, time
if sys.argv[1] == "run":
    sys.argv += ["--set", "contact.0.friction.mu=0.1"]
    end = time.process_time() + 1.0
    while time.process_time() < end:
        pass
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


def cells(lines: list[str], row: str) -> list[str]:
    (line,) = [line for line in lines if line.startswith(f"| {row} |")]
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


# --- forces ---------------------------------------------------------------------------------------


def test_forces_are_compared_with_the_largest_of_their_column():
    assert difference() == Difference(0.0, "normal_force, row 1")
    found = difference(normal_force=[1.0 + 2e-6, 2.0])
    assert found.worst == pytest.approx(1e-6) and found.where == "normal_force, row 1"


def test_energies_are_no_forces():
    assert difference(energy=[50.0, 6.0]).worst == 0.0


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


def test_a_force_that_is_no_number_differs():
    assert difference(normal_force=[math.nan, 2.0]).worst == math.inf


def test_a_history_without_forces_is_an_error():
    bare = ran(history=[{"step": 1.0, "time": 0.0}])
    with pytest.raises(InputError, match="no column of forces"):
        force_difference(bare, bare)


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


def test_on_ranks_the_clock_counts_and_nothing_is_probed(monkeypatch):
    costs = iter([(3.0, 1.0), (9.0, 1.0), (2.0, 4.0), (8.0, 0.5)])
    probes = []

    def fake(job: Job, side: Side, probed: bool) -> Ran:
        probes.append(probed)
        return ran(side.name, *next(costs))

    monkeypatch.setattr(comparison, "run_warm", fake)
    found = compare(JOB, (Side("1 rank"), Side("2 ranks", ranks=2)), 2)
    assert probes == [False] * 4 and found.by_clock
    assert (found.first.cost.clock, found.second.cost.clock) == (1.0, 0.5)


def test_a_run_that_compiled_something_is_made_again(monkeypatch):
    compiled = iter([True, False])
    costs = iter([9.0, 1.0])
    monkeypatch.setattr(comparison, "compiled_since", lambda started: next(compiled))
    monkeypatch.setattr(comparison, "run", lambda *_: ran(cpu=next(costs)))
    assert run_warm(JOB, SIDES[0], True).cost.cpu == 1.0


def test_what_is_compiled_is_seen(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(comparison.tempfile, "gettempdir", lambda: str(tmp_path / "none"))
    cache = tmp_path / "fenics"
    cache.mkdir()
    assert not compiled_since(0.0)
    library = cache / "form.so"
    library.touch()
    written = library.stat().st_mtime
    assert compiled_since(written - 1.0) and not compiled_since(written)


def test_several_ranks_run_the_program_as_it_is(monkeypatch):
    asked = []

    def fake(words: list[str], name: str, tree: Path) -> Cost:
        asked.append((words, tree))
        results = Path(words[words.index("--out") + 1])
        results.mkdir()
        keys = ("dofs", "steps", "attempts", "newton_iterations", "factorisations")
        summary = dict.fromkeys(keys, 7) | {"seconds": {"run": 2.0, "contact": 1.0}}
        (results / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
        (results / "history.csv").write_text("step,time,normal_force\n1,0.5,2\n")
        return Cost(4.0, 2.0)

    monkeypatch.setattr(comparison, "run_python", fake)
    side = Side("2 ranks", SOURCES, 2, ("a=1",))
    found = comparison.run(JOB, side, False)
    ((words, tree),) = asked
    assert words[:4] == ["-m", "tribox", "run", "short.toml"] and words[-2:] == ["--np", "2"]
    assert words[4:6] == ["--set", "a=1"] and tree == side.tree
    assert found.parts == {"contact": 1.0} and found.iterations == 7
    assert found.history == [{"step": 1.0, "time": 0.5, "normal_force": 2.0}]


@pytest.fixture(scope="module")
def other_tree(tmp_path_factory) -> Path:
    """A copy of this tree whose runs burn a second and have half the friction."""
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
    options = Options(case_file(block), out, 1, overrides=SHORT, against=other_tree)
    run_bench(["1"], options)
    (found,) = json.loads((out / "bench.json").read_text(encoding="utf-8"))["comparisons"]
    old, new = found["sides"]
    assert old["cpu"] > new["cpu"] + 0.5
    # Half the friction force, and by so much less than all of it.
    worst, where = found["forces"]
    assert 0.4 < worst < 0.7 and where.startswith(("friction", "tangential", "force_x"))
    for side in (old, new):
        assert side["steps"] == 5 and side["iterations"] >= 5
        assert {"imports", "set-up", "projection", "solve", "output"} <= side["seconds"].keys()
    text = (out / "bench.md").read_text(encoding="utf-8")
    assert f"**{new['cpu'] / old['cpu']:.3f}**" in text


# --- tables ---------------------------------------------------------------------------------------


def test_tables_divide_the_second_by_the_first():
    second = ran("new", 1.0, 6.0, iterations=11, parts={"imports": 0.5, "projection": 0.1})
    found = Comparison(JOB, ran(), second, Difference(1e-12, "drag, row 3"), False)
    lines = list(job_table(found))
    assert lines[0] == "| short, level 1 | old | new | new / old |"
    assert cells(lines, "command, CPU (s)") == ["2.00", "1.00", "**0.500**"]
    assert cells(lines, "command, clock (s)") == ["3.00", "6.00", "**2.000**"]
    assert cells(lines, "Newton iterations") == ["10", "11", "1.100"]
    assert cells(lines, "largest difference of the forces")[-1] == "1.0e-12 (drag, row 3)"
    assert cells(lines, "contact, CPU (s)") == ["0.500", "0.100", "0.20"]
    assert cells(lines, "time integration, CPU (s)") == ["0.100", "0.000", "0.00"]
    (row,) = list(all_jobs([found]))[2:]
    assert "| 10 | 2.00 | 1.00 | **0.500** | 3.00 | 6.00 | **2.000** | 10 → 11 |" in row


def test_a_ratio_to_nothing_is_left_out():
    none = ran(iterations=0, parts={"imports": 0.001})
    lines = list(job_table(Comparison(JOB, none, none, Difference(0.0, ""), True)))
    assert cells(lines, "Newton iterations") == ["0", "0", "–"]
    assert cells(lines, "imports, clock (s)")[-1] == "–"
    assert cells(lines, "largest difference of the forces")[-1] == "the same"


def test_parts_that_nobody_knows_are_shown_last():
    assert in_order(["checkpoints", "output", "contact", "imports"]) == [
        *("imports", "contact", "output", "checkpoints")
    ]


# -- Runs in processes of their own: whose packages they have, and what they cost ------------------

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


# -- What ``tribox bench`` compares with what ------------------------------------------------------


def test_alone_nothing_is_compared():
    assert sides_of(None, (), 1) is None


def a_tree(place):
    for name in ("app", "forms", "geometry", "src/tribox", "benchmarks"):
        (place / name).mkdir(parents=True)


@pytest.mark.parametrize("ranks", [1, 3])
def test_another_tree_is_the_old_one(tmp_path, ranks):
    a_tree(tmp_path)
    old, new = sides_of(tmp_path, (), ranks)
    assert (old.name, old.tree, old.ranks) == ("old", tmp_path / "src", ranks)
    assert (new.name, new.tree, new.ranks) == ("new", SOURCES, ranks)


def test_probes_of_a_tree_are_where_it_has_them(tmp_path):
    a_tree(tmp_path)
    old, new = sides_of(tmp_path, (), 1)
    assert old.probe == tmp_path / "app" / "bench" / "probe.py"
    (tmp_path / "benchmarks" / "probe.py").touch()
    assert old.probe == tmp_path / "benchmarks" / "probe.py"
    assert new.probe.is_file()


def test_changes_are_made_on_the_second_side_only():
    first, second = sides_of(None, ("a=1", "b=2"), 1)
    assert (first.changes, second.changes) == ((), ("a=1", "b=2"))
    assert first.tree == second.tree == SOURCES


def test_ranks_alone_are_compared_with_one():
    first, second = sides_of(None, (), 2)
    assert (first.ranks, second.ranks) == (1, 2)


def test_a_directory_that_is_no_tree_is_refused(tmp_path):
    with pytest.raises(InputError, match=re.escape(f"{tmp_path}: not a source tree of tribox")):
        sides_of(tmp_path, (), 1)
    with pytest.raises(InputError, match="there is no such directory"):
        sides_of(tmp_path / "none", (), 1)
    (tmp_path / "app").mkdir()
    with pytest.raises(InputError, match="it has no forms"):
        sides_of(tmp_path, (), 1)


def test_two_things_to_compare_with_are_refused():
    with pytest.raises(InputError, match=r"--against /old and --with a=1 .*give one of them"):
        sides_of(Path("/old"), ("a=1",), 1)


# -- Which runs ``tribox bench`` makes of a case ---------------------------------------------------

ROOT = Path(__file__).parents[2]


def test_a_level_refines_both_blocks():
    case = load_case(ROOT / "cases" / "block-slide.toml")
    assert level_options(case, 1) == []
    assert level_options(case, 2) == [
        *("--set", "geometry.upper.elements=[80, 40]"),
        *("--set", "geometry.lower.elements=[122, 30]"),
    ]


def test_a_level_divides_a_given_size(block, case_file):
    text = block.replace("elements = [10, 5]", 'size = "0.1 mm"')
    path = case_file(text)
    options = level_options(load_case(path), 4)
    refined = load_case(path, options[1::2])
    assert refined.geometry.upper.size == pytest.approx(2.5e-5)
    assert refined.geometry.lower.elements == (60, 16)


def test_levels_and_values_of_a_sweep_are_runs_of_their_own():
    path = ROOT / "cases" / "sfa.toml"
    jobs = list(jobs_of(path, (1, 2)))
    labels = [label for label, _ in load_case(path).sweep_cases()]
    assert [(job.name, job.level) for job in jobs] == [(n, k) for k in (1, 2) for n in labels]
    assert jobs[1].words == (str(path), "--part", "1")
    assert jobs[-1].words[1] == "--set" and jobs[-1].words[-2:] == ("--part", f"{len(labels) - 1}")


def test_a_level_refines_boxes_in_all_directions():
    options = level_options(load_case(ROOT / "cases" / "boxes-3d.toml"), 2)
    assert options[1::2] == [
        "geometry.upper.elements=[16, 8, 16]",
        "geometry.lower.elements=[22, 6, 22]",
    ]


def test_changes_of_the_case_come_before_the_level_refines_it():
    path = ROOT / "cases" / "block-slide.toml"
    (job,) = jobs_of(path, (2,), ["geometry.upper.elements=[10, 5]"])
    changed = [word for word in job.words if "upper" in word]
    assert changed == ["geometry.upper.elements=[10, 5]", "geometry.upper.elements=[20, 10]"]
    with pytest.raises(InputError, match="no_such_key"):
        list(jobs_of(path, (1,), ["no_such_key=1"]))


def test_a_mesh_from_a_file_cannot_be_refined(block, case_file, tmp_path):
    head, _, rest = block.partition("[geometry]")
    text = head + '[geometry]\nkind = "file"\nmesh = "m.msh"\n' + rest[rest.index("[bodies") :]
    (tmp_path / "m.msh").write_text("", encoding="utf-8")
    with pytest.raises(
        InputError,
        match=r'level 2 needs geometry\.kind = "two-blocks" or "two-boxes", found "file"',
    ):
        level_options(load_case(case_file(text)), 2)
