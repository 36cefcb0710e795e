"""Stribeck friction: bounds, energy, tangents, limits."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters
from tribox.forms.friction.law import Regime
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters

K_T, P, V_S = 1e12, 3e6, 1e-3


def law(**changes: float) -> StribeckLaw:
    values = {"mu_s": 0.15, "mu_d": 0.08, "V_s": V_S, "K_T": K_T} | changes
    return StribeckLaw(StribeckParameters(**values))


laws = st.builds(
    law,
    delta=st.sampled_from([0.5, 1.0, 2.0]),
    viscous=st.sampled_from([0.0, 1e6, 1e8]),
    mu_d=st.sampled_from([0.01, 0.08, 0.15]),
)


@settings(derandomize=True, deadline=None, max_examples=80)
@given(laws, st.integers(0, 10**6), st.sampled_from([2, 3]))
def test_random_paths(stribeck, seed, dim):
    n, rng = 60, np.random.default_rng(seed)
    p, state = stribeck.parameters, stribeck.initial_state(60, dim)
    for _ in range(8):
        dt = 10 ** rng.uniform(-5, -2)
        slip = rng.normal(size=(n, dim)) * V_S * dt * 10 ** rng.uniform(-1, 1, (n, 1))
        slip[rng.random(n) < 0.05] = 0.0
        pressure = P * rng.random(n) * (rng.random(n) > 0.1)
        area = rng.uniform(0.8, 1.2, n)

        def traction(dx, dt=dt, pressure=pressure, state=state, area=area, slip=slip, dp=0.0):
            return stribeck.update(
                slip + dx, dt, pressure + dp, np.zeros(n), state, area_ratio=area
            )

        response = traction(0.0)
        speed = np.linalg.norm(slip, axis=1) / dt
        elastic = p.K_T * np.linalg.norm(response.state.elastic_slip, axis=1)
        mu = p.coefficient(speed)[0]
        assert (elastic <= mu * pressure * (1 + 1e-12)).all()
        work = np.einsum("qi,qi->q", response.traction, slip)
        before, after = stribeck.stored_energy(state), stribeck.stored_energy(response.state)
        parts = response.dissipation
        scale = np.abs(work) + before + after + np.abs(parts.total)
        assert (np.abs(work - after + before - parts.total) <= 1e-12 * scale).all()
        for part in (parts.coulomb, parts.viscous, parts.numerical, parts.opening):
            assert (part >= -1e-12 * scale).all()
        size = np.linalg.norm(slip, axis=1)
        compared = 0
        for j in range(dim):
            h = 1e-4 * np.where(size > 0.0, size, 1.0)
            step = np.zeros((n, dim))
            step[:, j] = h
            four = [traction(c * step) for c in (-2, -1, 1, 2)]
            smooth = (size > 0.0) & np.all([r.regime == response.regime for r in four], axis=0)
            a, b, c, d = (r.traction for r in four)
            slope = (a - 8 * b + 8 * c - d) / (12 * h[:, None])
            exact = response.d_traction_d_slip[:, :, j]
            allowed = 1e-7 * np.abs(response.d_traction_d_slip).max(axis=(1, 2))
            allowed += 1e-13 * (np.linalg.norm(response.traction, axis=1) + mu * pressure) / h
            error = np.abs(slope - exact).max(axis=1)
            assert (error <= allowed)[smooth].all()
            compared += smooth.sum()
        assert compared > 0.7 * dim * n
        state = response.state


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
