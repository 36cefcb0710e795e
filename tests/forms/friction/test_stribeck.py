"""Stribeck friction: bounds, limits."""

import math

import numpy as np
import pytest

from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters
from tribox.forms.friction.law import Regime
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters

K_T, P, V_S = 1e12, 3e6, 1e-3


def law(**changes: float) -> StribeckLaw:
    values = {"mu_s": 0.15, "mu_d": 0.08, "V_s": V_S, "K_T": K_T} | changes
    return StribeckLaw(StribeckParameters(**values))


@pytest.mark.parametrize("delta", [0.5, 1.0, 2.0])
def test_the_elastic_part_stays_within_the_threshold(delta):
    """Energy and tangents: `test_law_check`."""
    stribeck, rng = law(delta=delta, viscous=1e6), np.random.default_rng(3)
    state = stribeck.initial_state(60, 2)
    for _ in range(8):
        dt = 10 ** rng.uniform(-5, -2)
        slip = rng.normal(size=(60, 2)) * V_S * dt * 10 ** rng.uniform(-1, 1, (60, 1))
        pressure = P * rng.random(60) * (rng.random(60) > 0.1)
        state = stribeck.update(slip, dt, pressure, np.zeros(60), state).state
        mu = stribeck.parameters.coefficient(np.linalg.norm(slip, axis=1) / dt)[0]
        elastic = K_T * np.linalg.norm(state.elastic_slip, axis=1)
        assert (elastic <= mu * pressure * (1 + 1e-12)).all() and elastic.any()


def test_rest_is_static_and_fast_is_dynamic_friction():
    for speed, mu in ((0.0, 0.15), (1e3 * V_S, 0.08), (V_S, 0.08 + 0.07 / math.e)):
        found, slope = law().parameters.coefficient(np.array([speed]))
        assert found[0] == pytest.approx(mu) and slope[0] <= 0.0
    slip = np.array([[1e-3, 0.0]])
    response = law(viscous=1e7).update(
        slip, 1.0, np.array([P]), np.zeros(1), law().initial_state(1, 2), area_ratio=1.5
    )
    expected = (0.08 + 0.07 / math.e) * P + 1.5e7 * 1e-3
    assert response.traction[0, 0] == pytest.approx(expected)
    assert response.regime[0] == Regime.SLIP
    assert law().coefficient(response.state)[0] == pytest.approx(0.08 + 0.07 / math.e)


def test_without_weakening_or_rate_it_is_coulomb():
    rng = np.random.default_rng(2)
    slip, pressure = 1e-6 * rng.normal(size=(50, 3)), P * rng.random(50)
    coulomb = CoulombLaw(CoulombParameters(mu=0.15, K_T=K_T))
    arguments = (slip, 0.1, pressure, np.zeros(50), coulomb.initial_state(50, 3))
    expected = coulomb.update(*arguments)
    for other in (
        law(mu_d=0.15).update(*arguments),
        law(viscous=1e9).update(*arguments, rate_dependent=False),
    ):
        np.testing.assert_array_equal(other.traction, expected.traction)
        np.testing.assert_array_equal(other.d_traction_d_slip, expected.d_traction_d_slip)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mu_d": 0.2}, r"mu_d = 0\.2: must be <= mu_s = 0\.15"),
        ({"V_s": 0.0}, r"V_s = 0\.0"),
        ({"delta": -1.0}, "delta = -1.0"),
        ({"viscous": -1.0}, "viscous = -1.0"),
        ({"K_T": 0.0}, "K_T = 0.0"),
    ],
)
def test_impossible_parameters_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        law(**changes)
