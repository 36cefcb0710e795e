"""The example of docs/python-api.md leaves forces in balance; tests/docs has what it prints."""

import re
from pathlib import Path

import pytest

from tribox.app.implicit.stepper import NotConvergedError

PAGE = Path(__file__).parents[3] / "docs" / "python-api.md"


def example() -> str:
    """The code of the page."""
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)[0]


@pytest.fixture(scope="module")
def ran() -> dict[str, object]:
    names: dict[str, object] = {"__name__": "example"}
    exec(compile(example(), str(PAGE), "exec"), names)
    return names


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
