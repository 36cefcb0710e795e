"""Which runs ``tribox bench`` makes of a case."""

from __future__ import annotations

from pathlib import Path

import pytest

from tribox.app.bench.jobs import jobs_of, level_options
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError

ROOT = Path(__file__).parents[3]


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
