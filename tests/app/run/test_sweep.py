"""Runs of a sweep side by side: how many at a time, what they say, and how they fail."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tribox.app.case.reading import load_case
from tribox.app.errors import InputError, SolutionError, TriboxError
from tribox.app.figures.sweep import comparison_figure
from tribox.app.results import read
from tribox.app.results.claim import claimed, is_beginning
from tribox.app.results.directory import BEGINNING, write_table
from tribox.app.run.ranks import RunOptions
from tribox.app.run.sweep_runs import (
    NO_SUMMARY,
    Part,
    SweepLines,
    _make_ready,
    _to_run,
    collate,
    run_side_by_side,
    run_sweep,
)
from tribox.app.simulation.history import COLUMNS


@pytest.fixture
def part(tmp_path: Path) -> Callable[[str, str], Part]:
    """Makes parts of a sweep out of programs; each that ends well leaves a summary."""

    def make(label: str, program: str) -> Part:
        directory = tmp_path / "parts" / label
        directory.mkdir(parents=True)
        left = f"; open({str(directory / 'summary.json')!r}, 'w').write('{{\"status\": \"done\"}}')"
        return Part(label, [sys.executable, "-c", program + left], directory)

    return make


SWEPT = '[sweep]\nkey = "contact.0.friction.mu"\nvalues = [0.1, 0.3]\n'


class Said(SweepLines):
    """Calls a function with each line."""

    def __init__(self, hear: Callable[[str, str], None] = lambda label, line: None) -> None:
        self.say = hear


def test_all_parts_run_and_their_lines_are_labelled(part, capsys):
    program = "import sys; print('one'); print('two', file=sys.stderr)"
    run_side_by_side([part(label, program) for label in "abc"], 2, SweepLines())
    said = capsys.readouterr().out.splitlines()
    assert sorted(said) == sorted(f"[{a}] {line}" for a in "abc" for line in ("one", "two"))


def test_a_note_of_several_parts_is_said_once_and_a_warning_of_each(part, capsys):
    program = "print('note: film has no effect'); print('warning: coarse')"
    run_side_by_side([part(label, program) for label in "abc"], 1, SweepLines())
    said = capsys.readouterr().out.splitlines()
    assert [line for line in said if "note: " in line] == ["[a] note: film has no effect"]
    assert [line for line in said if "warning: " in line] == [
        f"[{a}] warning: coarse" for a in "abc"
    ]


@pytest.mark.parametrize("jobs", [1, 2])
def test_no_more_parts_run_at_a_time_than_asked_for(part, jobs):
    running: set[str] = set()
    most = []

    def hear(label: str, line: str) -> None:
        running.add(label) if line == "begin" else running.discard(label)
        most.append(len(running))

    program = "import time; print('begin', flush=True); time.sleep(0.3); print('end')"
    run_side_by_side([part(label, program) for label in "abcd"], jobs, Said(hear))
    assert max(most) == jobs


@pytest.mark.parametrize(
    ("codes", "kind"),
    [((0, 3, 0), SolutionError), ((2, 3, 0), SolutionError), ((2, 0, 2), InputError)],
)
def test_failures_are_reported_after_all_have_run(part, tmp_path, codes, kind):
    ran = tmp_path / "ran"
    ran.mkdir()
    parts = [
        part(f"p{i}", f"open({str(ran / str(i))!r}, 'w'); {code} and exit({code})")
        for i, code in enumerate(codes)
    ]
    failed = ", ".join(f"p{i}" for i, code in enumerate(codes) if code)
    count = sum(code != 0 for code in codes)
    with pytest.raises(kind, match=rf"^{count} of 3 runs of the sweep failed: {failed}$"):
        run_side_by_side(parts, 1, Said())
    assert len(list(ran.iterdir())) == 3


def test_a_part_that_ends_well_and_writes_nothing_has_failed(part, capsys):
    parts = [part("a", "pass"), part("b", "import os; os._exit(0)"), part("c", "os = 0")]
    old = parts[1].directory / "summary.json"
    for there in (None, '{"status": "running"}', '{"status": "done"}'):  # of an earlier run
        if there is not None:
            old.write_text(there)
        with pytest.raises(TriboxError, match=r"^1 of 3 runs of the sweep failed: b$"):
            run_side_by_side(parts, 1, SweepLines())
        assert capsys.readouterr().out == f"[b] {NO_SUMMARY}\n"


def test_a_part_that_crashes_is_neither_wrong_input_nor_no_solution(part):
    with pytest.raises(TriboxError) as caught:
        run_side_by_side([part("a", "raise SystemExit(1)")], 1, Said())
    assert caught.value.exit_code == 1


def test_after_an_interrupted_part_no_other_begins(part, tmp_path):
    ran = tmp_path / "ran"
    ran.mkdir()
    parts = [part("a", "raise SystemExit(130)")]
    parts += [part(label, f"open({str(ran / label)!r}, 'w')") for label in "bc"]
    with pytest.raises(KeyboardInterrupt):
        run_side_by_side(parts, 1, Said())
    assert list(ran.iterdir()) == []


def test_collating_tells_of_parts_that_were_not_run(case_file, block, tmp_path):
    collate(load_case(case_file(block + SWEPT)), tmp_path, "done")
    parts = json.loads((tmp_path / "summary.json").read_text())["parts"]
    assert parts == {"mu=0.1": {"status": "not run"}, "mu=0.3": {"status": "not run"}}
    assert len((tmp_path / "sweep.csv").read_text().splitlines()) == 1


def test_collating_adds_rows_of_pairs_tools_and_shapes(case_file, block, tmp_path):
    part = tmp_path / "mu=0.1"
    part.mkdir()
    (part / "case.toml").write_text(block)
    ends = [
        {"label": f"stage {n}", "steady": None, **dict.fromkeys(COLUMNS, 0.0), "stage": f"s{n}"}
        | {"step": 2 * n, "time": float(n), "normal_force": 10.0 * n}
        for n in (1, 2)
    ]
    summary = {"status": "done", "warnings": [], "steps": 4, "newton_iterations": 8}
    (part / "summary.json").write_text(json.dumps(summary | {"load_steps": ends}))
    keys = [(k, 0.5 * k, f"s{(k + 1) // 2}") for k in range(1, 5)]
    tables = {
        "contacts": (("pair", "normal_force"), [("a", 3.0), ("b", 4.0)]),
        "tools": (("tool", "force_y"), [("punch", -7.0)]),
        "shape_probes": (("probe", "bend_angle", "min_thickness"), [("edge", 0.0, 1e-3)]),
    }
    for name, (columns, values) in tables.items():
        found = [(*key, *row) for key in keys for row in values]
        if name == "shape_probes":  # bent by 0.9 in the middle of a step, 0.8 and 0.7 at the ends
            found = [(*key, "edge", angle, 1e-3) for key, angle in zip(keys, BENT, strict=True)]
        write_table(part / f"{name}.csv", ("step", "time", "stage", *columns), found)
    collate(load_case(case_file(block + SWEPT)), tmp_path, "done")
    (tmp_path / "case.toml").write_text(block + SWEPT)
    results = read(tmp_path)
    assert results.sweep["normal_force"].tolist() == [10.0, 20.0]
    assert "kind" not in results.sweep and "bend_angle" not in results.sweep
    details = results.sweep_details
    assert list(zip(details["kind"], details["name"], strict=True)) == 2 * [
        *(("pair", "a"), ("pair", "b"), ("tool", "punch"), ("probe", "edge")),
    ]  # fmt: skip
    assert details["label"].tolist() == ["mu=0.1"] * 8 and details["value"].tolist() == [0.1] * 8
    shape = details[details["kind"] == "probe"]
    assert shape["bend_angle"].tolist() == [0.8, 0.7]
    assert shape["springback"].tolist() == pytest.approx([0.0, 0.1])
    assert details[details["kind"] == "tool"]["force_y"].tolist() == [-7.0, -7.0]
    figure = comparison_figure(results)
    labels = [axes.get_ylabel() for axes in figure.axes if axes.get_visible()]
    assert labels == [
        *("normal force of pairs N (N)", "force on tools |R| (N)"),
        *("bend angle (°)", "springback (°)", "least thickness (mm)"),
    ]  # fmt: skip
    assert figure.axes[3].lines[0].get_ydata().tolist() == pytest.approx([np.degrees(0.1)])


BENT = (0.9, 0.8, 0.75, 0.7)
LEFT = {"summary.json": json.dumps(BEGINNING), "case.toml": "", "mu=0.1/history.csv": "x"}


@pytest.mark.parametrize("left", [{}, {"summary.json.part": "{"}, LEFT], ids=range(3))
def test_a_sweep_that_was_killed_before_it_began_begins_anew(case_file, block, tmp_path, left):
    """While its directory was made ready; LEFT: in the middle of clearing other results."""
    case = load_case(case_file(block + SWEPT))
    out = tmp_path / "out"
    for name, text in left.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text(text)
    if left is LEFT:
        (out / "case.toml").write_text(block + SWEPT)
        (out / "mu=0.1" / "summary.json").write_text('{"status": "done"}')
    options = RunOptions(resume=True)
    assert [label for _, label in _to_run(case, out, options)] == ["mu=0.1", "mu=0.3"]
    with claimed(out, force=True, goes_on=True) as claim:
        _make_ready(case, claim, goes_on=True)
        assert {path.name for path in out.iterdir()} == {
            *("case.toml", "summary.json", "sweep.csv", "tribox.lock")
        }
    assert not is_beginning(out)


def test_a_sweep_does_not_go_on_in_the_place_of_something_else(case_file, block, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "history.csv").write_text("")
    path = case_file(block + SWEPT)
    with pytest.raises(InputError, match="holds no checkpoint and no unfinished run to go on with"):
        run_sweep(load_case(path), path, tmp_path / "out", RunOptions(resume=True))
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["history.csv"]


@pytest.mark.parametrize(
    ("key", "values", "expected"),
    [
        ("contact.0.friction.mu", "[0.1, 0.3]", [0.1, 0.3]),
        ("geometry.upper.height", '["500 um", "0.6 mm"]', [0.5e-3, 0.6e-3]),
        ("boundary.0.displacement.x", '[0, "1 um"]', [0.0, 1e-6]),
        ("contact.0.pressure", '["averaged", "pointwise"]', ["averaged", "pointwise"]),
        ("geometry.upper.elements", "[[4, 2], [8, 4]]", [None, None]),
    ],
)
def test_a_sweep_knows_its_values_as_numbers(case_file, block, key, values, expected):
    case = load_case(case_file(block + f'[sweep]\nkey = "{key}"\nvalues = {values}\n'))
    assert [case.swept_value(part) for _, part in case.sweep_cases()] == expected
