"""The complete case of the documentation: it is correct and keeps what is said of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.blocks import find_blocks
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError

PAGE = Path(__file__).parents[3] / "docs" / "case-file.md"


def documented_case() -> str:
    [block] = [b for b in find_blocks(PAGE) if b.marks.get("file") == "slide.toml"]
    return block.text


def test_the_documented_film_case_is_correct(case_file):
    case = load_case(case_file(documented_case()))
    assert [stage.name for stage in case.stage] == ["press", "slide"]
    [contact] = case.contact
    assert contact.film.at(0.0) == pytest.approx(30e-9)
    # The elastic slip of dry asperities is in the range that the page gives.
    upper = case.geometry.upper
    pressure = 20.0 / (upper.width * case.geometry.thickness)
    assert 0.1e-6 <= contact.friction.mu_s * pressure / contact.friction.K_T <= 1e-6
    # One velocity at least lies on either side of V*.
    speeds = case.stage[1].velocities
    assert min(speeds) < contact.friction.V_star < max(speeds)


def test_check_finds_nothing_to_remark_on(case_file, tribox):
    done = tribox("check", case_file(documented_case()))
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("correct (1 run, 2 stages)\n")
    assert len(done.stdout.splitlines()) == 1


def test_a_body_without_a_table_is_asked_for(case_file):
    text = re.sub(r"^\[bodies\.aluminium\][^\[]*", "", documented_case(), flags=re.MULTILINE)
    with pytest.raises(InputError, match=r"missing; add \[bodies\.aluminium\] with its material"):
        load_case(case_file(text))
