"""A run that goes on from a checkpoint writes what it would have written, to 1e-9."""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from tests.app.checkpoint.going_on import (
    TABLES,
    as_killed,
    case_of,
    numbers,
    position_of,
    run,
    unlike,
)
from tests.app.checkpoint.small_cases import EXPLICIT, IMPLICIT
from tribox.app.checkpoint import checkpointer
from tribox.app.errors import Interrupted, SolutionError
from tribox.app.explicit.energies import ExplicitError
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.implicit.stepper import StepResult
from tribox.app.results.reading import read_table
from tribox.app.run.run import Interruption
from tribox.app.simulation import explicit_stage
from tribox.app.simulation.run_state import RunState

CASES = {
    **{f"implicit {name}": maker for name, maker in IMPLICIT.items()},
    **{f"explicit {name}": maker for name, maker in EXPLICIT.items()},
}
# Each of these has something of its own; what the others have, they have among other things.
FIRST = (
    "implicit coulomb", "implicit cut", "implicit frozen", "implicit boundaries by stage",
    "implicit pairs", "implicit space by Krylov", "explicit thrown",
)  # fmt: skip
Went = tuple[Any, Path]


@pytest.fixture(scope="module")
def went(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Went]:
    """A finished run of a case, with all its checkpoints; each is made once."""
    made: dict[str, Went] = {}

    def find(name: str) -> Went:
        if name not in made:
            directory = tmp_path_factory.mktemp("case")
            data = CASES[name](directory)
            # Runs that go on differ by what the solver leaves.
            data["solver"] = {"tolerance": 1e-11} | data.get("solver", {})
            case = case_of(data)
            run(case, directory / "out")
            made[name] = case, directory / "out"
        return made[name]

    return find


@pytest.fixture(autouse=True)
def short_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Explicit runs can be stopped every ten time steps."""
    monkeypatch.setattr(explicit_stage, "CHECK_EVERY", 10)


def places(name: str) -> list[Any]:
    """A case with some of its checkpoints, by how much of them lies before."""
    own = {
        "implicit cut": (0.4, 0.6),
        "implicit boundaries by stage": (0.3, 0.85),
        "implicit frozen": (0.7, 1.0),
        "implicit space by Krylov": (0.2, 0.85),
        "explicit film": (0.0, 0.65),
    }
    return [pytest.param(name, share, id=f"{name} {share}") for share in own.get(name, (0.65,))]


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
    assert len(resumed) == 1 and 0 <= resumed[0] <= len(read_table(reference / "history.csv"))


def test_each_attempt_has_a_row(went):
    """Failed ones too; resuming keeps them, which the comparisons of all files here show."""
    _, cut = went("implicit cut")
    attempts, history = (read_table(cut / f"{name}.csv") for name in ("progress", "history"))
    done = [row for row in attempts if row["converged"] == 1.0]
    assert [row["time"] for row in done] == [row["time"] for row in history]
    assert [row["attempt"] for row in done] == [row["attempts"] for row in history]
    assert [row["step"] for row in done] == [row["step"] for row in history]
    spent = {row["step"]: 0.0 for row in history}
    for row in attempts:
        spent[row["step"]] += row["iterations"]
    assert list(spent.values()) == [row["newton_iterations"] for row in history]
    failed = [row for row in attempts if row["converged"] == 0.0]
    assert failed and failed[-1]["cuts"] == len(failed) == attempts[-1]["cuts"]
    for one, then in pairwise(attempts):
        if one["converged"] == 0.0:
            assert then["step"] == one["step"] and then["attempt"] == one["attempt"] + 1
            assert then["fraction"] == 0.5 * one["fraction"]


def test_each_explicit_interval_has_a_row_of_the_same_columns(went):
    """Cuts are those of implicit steps; resuming in an interval keeps its count of time steps."""
    _, thrown = went("explicit thrown")
    _, cut = went("implicit cut")
    intervals, history = (read_table(thrown / f"{name}.csv") for name in ("progress", "history"))
    assert intervals[0].keys() == read_table(cut / "progress.csv")[0].keys()
    for name in ("step", "time", "stage"):
        assert [row[name] for row in intervals] == [row[name] for row in history]
    explicit = [row for row in intervals if row["time_steps"] > 0.0]
    assert explicit and {row["iterations"] for row in explicit} == {0.0}
    for row in explicit:
        assert row["time_step"] * row["time_steps"] == pytest.approx(row["dt"], rel=0.3)
        assert row["fraction"] == row["converged"] == row["attempt"] == 1.0
        assert row["cuts"] == 0.0 and row["kinetic_ratio"] > 0.0


def test_checkpoints_change_nothing(went, tmp_path):
    for name in ("implicit space by Krylov", "explicit thrown"):
        case, reference = went(name)
        none = case.output.model_copy(update={"checkpoints_kept": 0})
        run(case.model_copy(update={"output": none}), tmp_path / name)
        for table in TABLES:
            assert (tmp_path / name / table).read_bytes() == (reference / table).read_bytes()
        assert not (tmp_path / name / "checkpoints").exists()


@pytest.mark.parametrize("cuts", [1, 2])
def test_a_run_stopped_between_two_attempts_goes_on_with_the_next(
    went, tmp_path, monkeypatch, cuts
):
    """What the attempts before have cost is in the row of the step, and in the solver's state."""
    case, reference = went("implicit cut")
    seen = 0

    def cut(self: Interruption, state: RunState, dt: float, result: StepResult) -> None:
        nonlocal seen
        seen += 1
        if seen == cuts:
            raise Interrupted

    with monkeypatch.context() as patch:
        patch.setattr(Interruption, "cut", cut)
        with pytest.raises(Interrupted):
            run(case, tmp_path / "out")
    at = position_of(tmp_path / "out", numbers(tmp_path / "out")[-1])
    assert at["failures"] == 1 and at["done"] == (0.0, 0.5)[cuts - 1] and at["piece"] < 1.0
    run(case, tmp_path / "out", resume=True)
    assert unlike(reference, tmp_path / "out") == []


def test_an_explicit_run_that_failed_goes_on_from_what_it_had_in_memory(
    went, tmp_path, monkeypatch
):
    """In the middle of a time step there is nothing to be written but what was kept before."""
    case, reference = went("explicit thrown")
    advance, seen = ExplicitStepper.advance, 0

    def fold(self: ExplicitStepper, dt: float) -> None:
        nonlocal seen
        seen += 1
        if seen == 105:
            raise ExplicitError("an element folds", (0.0, 0.0), 0.0)
        advance(self, dt)

    seldom = {"checkpoint_interval": 1e9, "checkpoint_every": 0}
    never = case.model_copy(update={"output": case.output.model_copy(update=seldom)})
    run(never, tmp_path / "whole")  # one that is done writes its end, not what memory holds
    assert numbers(tmp_path / "whole") == [1]
    assert position_of(tmp_path / "whole", 1) == position_of(reference, numbers(reference)[-1])
    with monkeypatch.context() as patch:
        patch.setattr(ExplicitStepper, "advance", fold)
        patch.setattr(checkpointer, "KEEP_EVERY", 0.0)
        with pytest.raises(SolutionError, match="an element folds"):
            run(never, tmp_path / "out")
    assert numbers(tmp_path / "out") == [1]
    at = position_of(tmp_path / "out", 1)
    assert at["within"] > 0
    run(case, tmp_path / "out", resume=True)
    assert unlike(reference, tmp_path / "out") == []
