"""The example of docs/python-api.md runs as it stands, and gives what the page says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tribox.app.implicit.stepper import NotConvergedError

PAGE = Path(__file__).parents[3] / "docs" / "python-api.md"
BLOCK = re.compile(r"```(python|text)\n(.*?)```", re.DOTALL)


def example() -> tuple[str, str]:
    """The code of the page, and what it prints by the page."""
    (_, code), (_, printed) = BLOCK.findall(PAGE.read_text(encoding="utf-8"))[:2]
    return code, printed


@pytest.fixture(scope="module")
def ran() -> dict[str, object]:
    names: dict[str, object] = {"__name__": "example"}
    exec(compile(example()[0], str(PAGE), "exec"), names)
    return names


def test_the_example_of_the_page_prints_the_coefficient_of_friction(ran, capsys):
    exec(compile(example()[0], str(PAGE), "exec"), {"__name__": "example"})
    printed = capsys.readouterr().out
    found = re.search(r"T/N = (\d\.\d+)", printed)
    assert found and float(found[1]) == pytest.approx(0.3, abs=1e-3 * 0.3)
    assert printed.strip() == example()[1].strip()


def test_the_example_is_about_ten_lines_without_its_imports():
    lines = [line for line in example()[0].splitlines() if line.strip()]
    own = [line for line in lines if not line.startswith(("import ", "from "))]
    assert len(own) <= 14


def test_reactions_balance_and_equal_the_contact_forces(ran):
    problem, fixed = ran["problem"], ran["fixed"]
    across = [problem.reaction(part) for part in (fixed[0], ran["slide"])]
    along = [problem.reaction(part) for part in (fixed[1], ran["press"])]
    (trial,) = problem.committed
    weight = ran["contact"].surface.slave.weight
    assert sum(across) == pytest.approx(0.0, abs=1e-7 * abs(across[0]))
    assert sum(along) == pytest.approx(0.0, abs=1e-7 * abs(along[0]))
    assert weight @ trial.pressure == pytest.approx(-along[1], rel=1e-3)


def test_a_step_without_solution_is_an_error_and_commits_nothing(ran):
    stepper, press = ran["stepper"], ran["press"]
    before, value = stepper.x.array_r.copy(), press.value
    press.value = -6e-3  # deeper than the block is high
    with pytest.raises(NotConvergedError, match="move less"):
        stepper.advance(1.0)
    assert (stepper.x.array_r == before).all()
    press.value = value
    assert stepper.advance(1.0).converged
