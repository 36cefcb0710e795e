"""The largest load that a body bears is named where a force asks for more, and only there."""

import math
import re
from unittest.mock import patch

import numpy as np
import pytest

from tests.solved import built
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.errors import SolutionError
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

SWIFT = {"law": "swift", "K": 200e6, "strain0": 0.002, "n": 0.2}
HEIGHT = 2e-3


def bar(load: float, **body: object) -> dict:
    """A bar in plane strain, pulled by a platen under a stress that grows to ``load`` (Pa)."""
    metal = {"material": "elastoplastic", "E": 70e9, "nu": 0.33, "hardening": SWIFT}
    blocks = {"bar": {"x": [0, 1e-2], "y": [0, HEIGHT], "elements": [5, 1]}}
    platen = {"direction": "x", "pressure": [[0, 0], [2, -2.0 * load]]}
    sides = [{"surface": f"bar_{side}", "symmetry": True} for side in ("left", "bottom")]
    return {
        "geometry": {"kind": "blocks", "blocks": blocks},
        "bodies": {"bar": body or metal},
        "boundary": [*sides, {"surface": "bar_right", "platen": platen}],
        "stage": [{"name": "pull", "duration": 1, "steps": 10}],
    }


def failure(data: dict) -> tuple[str, Simulation]:
    simulation = built(data)
    with pytest.raises(SolutionError) as caught:
        simulation.run(Observer())
    return str(caught.value), simulation


def largest_force() -> float:
    """Force per thickness, N/m, at which a bar of Swift's metal necks (Considère 1885).

    In plane strain the stress is σ = c K (ε₀ + c ε)ⁿ with c = 2/√3, and its force σ exp(−ε) is
    largest where dσ/dε = σ.
    """
    c, n = 2.0 / math.sqrt(3.0), SWIFT["n"]
    strain = n - SWIFT["strain0"] / c
    return c * SWIFT["K"] * (c * n) ** n * math.exp(-strain) * HEIGHT


def test_a_pull_beyond_the_force_that_necks_is_told_the_largest_one():
    text, simulation = failure(bar(200e6))
    said = re.search(r"beyond the load reached \((\S+) N on a platen\): it is the largest", text)
    assert said is not None, text
    assert float(said[1]) == pytest.approx(largest_force(), rel=3e-3)
    assert simulation.state.time * 200e6 * HEIGHT == pytest.approx(float(said[1]), rel=1e-3)
    assert "try a displacement in the place of the force" in text
    assert 'kind = "explicit"' in text and "finer mesh" not in text


def by_displacement(data: dict) -> None:
    data["boundary"][2] = {"surface": "bar_right", "displacement": {"x": [[0, 0], [1, 3e-3]]}}
    data["stage"][0]["steps"] = 30


def with_less(data: dict) -> None:
    data["boundary"][2]["platen"]["pressure"] = [[0, 0], [1, -0.99 * largest_force() / HEIGHT]]


@pytest.mark.parametrize("cure", [by_displacement, with_less])
def test_what_the_message_says_to_try_helps(cure):
    data = bar(200e6)
    cure(data)
    simulation = built(data)
    simulation.run(Observer())
    assert simulation.rows[-1].time == pytest.approx(1.0)


def too_coarse() -> dict:
    """Rubber pulled to seven times its length in steps that may not be cut, nor take long."""
    data = bar(4e6, material="neo-hookean", E=1e6, nu=0.45)
    data["stage"][0]["steps"] = 2
    return data | {"solver": {"max_iterations": 3, "min_step_fraction": 0.4}}


def pushed_in() -> dict:
    """Rubber under a pressure that turns its elements inside out in all steps that are allowed."""
    data = bar(-1e9, material="neo-hookean", E=1e6, nu=0.3)
    data["stage"][0]["steps"] = 4
    return data | {"solver": {"max_iterations": 6, "min_step_fraction": 0.2}}


def free() -> dict:
    """Nothing holds the bar in x."""
    data = bar(1e6)
    del data["boundary"][0]
    return data


@pytest.mark.parametrize("data", [too_coarse, pushed_in, free], ids=lambda d: d.__name__)
def test_nothing_is_said_of_a_largest_load_where_another_thing_is_wrong(data):
    text, _ = failure(data())
    assert "largest that the bodies bear" not in text, text


def hardening(stress: float) -> dict:
    """A bar that yields under 115 MPa, where its stiffness falls to a fortieth, and hardens on."""
    metal = {"law": "linear", "yield_stress": 100e6, "modulus": 2e9}
    return bar(stress, material="elastoplastic", E=70e9, nu=0.33, hardening=metal)


SOFT = {"material": "neo-hookean", "E": 1e6, "nu": 0.45}
MOST = largest_force() / HEIGHT


@pytest.mark.parametrize(
    ("data", "more", "said"),
    [
        (bar(0.997 * MOST), 0.01, True),
        (bar(0.997 * MOST), 1e-4, False),  # less than what is missing
        (bar(0.997 * MOST), 0.0, False),  # the same load, held
        (bar(0.9 * MOST), 0.01, False),
        (bar(2e6, **SOFT), 0.1, False),  # softens, and has no largest load
        *[(hardening(stress), 0.1, False) for stress in (117e6, 120e6, 127e6, 130e6, 140e6)],
    ],
)
def test_a_load_that_goes_on_is_told_from_one_that_has_come_to_its_end(data, more, said):
    """The same step is asked for after steps that were solved; it need not be tried."""
    simulation = built(data)
    simulation.run(Observer())
    simulation.model.set_loads(1.0 + more, 0.0)
    stepper = simulation.implicit.stepper
    step = StepMode.of_stage(more, [], False)
    before = stepper.trial.array_r.copy()
    assert stepper.predictor.meets_limit(stepper.x, stepper.trial, step) is said
    assert np.array_equal(stepper.trial.array_r, before)
    with patch.object(stepper.solver, "solve", return_value=False):  # says nothing of a slope
        assert not stepper.predictor.meets_limit(stepper.x, stepper.trial, step)
