"""Where metal goes that flows steadily through tools at rest."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from tests.solved import built
from tribox.app.implicit.predictor import Predictor
from tribox.app.implicit.steady_flow import steady_flows
from tribox.app.simulation.run_state import Observer

CASE = Path(__file__).parents[3] / "cases" / "forming" / "ironing.toml"


def ironing(facets: int = 42):
    """A strip drawn through the gap in steps of six tenths of a facet, until it flows steadily."""
    data = tomllib.loads(CASE.read_text())
    data["geometry"]["blocks"]["strip"]["x"] = ["-4 mm", "3 mm"]
    data["geometry"]["blocks"]["strip"]["elements"] = [facets, 3]
    close, _, draw, _ = data["stage"]
    data["stage"] = [close | {"steps": 12}, draw | {"duration": "1.8 s", "steps": 3 * facets // 7}]
    return data


@pytest.fixture(scope="module")
def flow():
    found = steady_flows(built(ironing()).stepper.problem)
    assert len(found) == 1
    return found[0]


def test_a_quadratic_is_carried_exactly_where_slopes_are_known_on_both_sides(flow):
    X = flow._places
    inside = np.array([[-1.13e-3, 0.41e-3], [0.37e-3, 0.52e-3], [-2.9e-3, 0.5e-3]])

    def field(x):
        return np.stack([1.0 + x[:, 0] - 200.0 * x[:, 0] ** 2, x[:, 0] * x[:, 1]], axis=1)

    def linear(x):
        return np.stack([1.0 + x[:, 0] - 2.0 * x[:, 1], 3.0 * x[:, 1]], axis=1)

    assert flow.carried(X, field(X), inside) == pytest.approx(field(inside), rel=1e-12)
    assert flow.carried(X, linear(X), X) == pytest.approx(linear(X), rel=1e-12)


def test_a_steady_flow_goes_on_as_it_does_in_space(flow):
    """Each step leads to the same places from the same places, whatever is there."""
    X, centre = flow._places, np.array([-1e-3, 0.5e-3])
    states, place = [], X
    for _ in range(4):
        u = np.zeros((flow.nodes.max() + 1, 2))
        u[flow.nodes] = place - X
        states.append(u)
        place = centre + 0.95 * (place - centre)
    path = [(float(k), states[k]) for k in (2, 1, 0)]
    assert flow.onwards(path, 3.0) == pytest.approx(states[3][flow.nodes], abs=1e-12)
    # A step of half the length goes half as far.
    half = 0.5 * (states[2] + states[3])
    assert flow.onwards(path, 2.5) == pytest.approx(half[flow.nodes], abs=1e-12)


class Starts(Observer):
    """What is left where the steps begin at which the strip is drawn, and their iterations."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, flows: bool = True) -> None:
        self.iterations, self.row, self.shares = 0, None, []
        flow_on = Predictor._flow_on if flows else lambda self, trial, ratio, step, norm: norm

        def shared(predictor, trial, ratio, step, norm):
            left = flow_on(predictor, trial, ratio, step, norm)
            self.shares.append(left / norm)
            return left

        monkeypatch.setattr(Predictor, "_flow_on", shared)

    def step(self, simulation, row, result):
        self.row = row
        if row.stage == "draw":
            self.iterations += result.iterations


def test_a_steady_flow_leaves_half_of_what_the_path_leaves(monkeypatch):
    """By the residual before any correction; never more, for the better start is taken.

    Also: fewer iterations, and the same forces."""
    seen = Starts(monkeypatch)
    built(ironing(35)).run(seen)
    assert max(seen.shares) <= 1.0
    assert np.exp(np.mean(np.log(seen.shares[-10:]))) < 0.55
    monkeypatch.undo()
    without = Starts(monkeypatch, flows=False)
    built(ironing(35)).run(without)
    assert seen.iterations < 0.9 * without.iterations
    assert seen.row.normal_force == pytest.approx(without.row.normal_force, rel=1e-6)
