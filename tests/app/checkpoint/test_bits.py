"""A run that goes on from a checkpoint writes what it would have written, byte for byte."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from app.results.directory import read_table
from app.simulation import explicit_stage
from tests.app.checkpoint.going_on import as_killed, case_of, numbers, position_of, run, unlike
from tests.app.checkpoint.small_cases import EXPLICIT, IMPLICIT

CASES = {
    **{f"implicit {name}": maker for name, maker in IMPLICIT.items()},
    **{f"explicit {name}": maker for name, maker in EXPLICIT.items()},
}
# Each of these has something of its own; what the others have, they have among other things.
FIRST = ("implicit coulomb", "implicit cut", "implicit space by Krylov", "explicit thrown")
Went = tuple[Any, Path]


@pytest.fixture(scope="module")
def went(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Went]:
    """A finished run of a case, with all its checkpoints; each is made once."""
    made: dict[str, Went] = {}

    def find(name: str) -> Went:
        if name not in made:
            directory = tmp_path_factory.mktemp("case")
            case = case_of(CASES[name](directory))
            run(case, directory / "out")
            made[name] = case, directory / "out"
        return made[name]

    return find


@pytest.fixture(autouse=True)
def short_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Explicit runs can be stopped every ten time steps."""
    monkeypatch.setattr(explicit_stage, "CHECK_EVERY", 10)


def places(name: str) -> list[Any]:
    """A case with two of its checkpoints, by how much of them lies before."""
    return [pytest.param(name, share, id=f"{name} {share}") for share in (0.2, 0.65)]


def tiers() -> list[Any]:
    found = []
    for name in CASES:
        marks = () if name in FIRST else (pytest.mark.long,)
        found += [pytest.param(*one.values, id=one.id, marks=marks) for one in places(name)]
    return found


@pytest.mark.parametrize(("name", "share"), tiers())
def test_a_run_goes_on_as_if_nothing_had_been(went, tmp_path, name, share):
    case, reference = went(name)
    written = numbers(reference)
    directory = as_killed(reference, tmp_path / "out", written[int(share * (len(written) - 1))])
    run(case, directory, resume=True)
    assert unlike(reference, directory) == []
    resumed = json.loads((directory / "summary.json").read_text())["resumed"]
    assert len(resumed) == 1 and 0 < resumed[0] < len(read_table(reference / "history.csv"))
