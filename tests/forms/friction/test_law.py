"""The state, plain Coulomb friction and no friction."""

import dataclasses

import numpy as np
import pytest

from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters, FrictionlessLaw
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import FrictionLaw, FrictionState, Regime
from tribox.forms.friction.parameters import FrictionMapParameters

K_T, MU, P = 1e12, 0.1, 3e6
COULOMB = CoulombLaw(CoulombParameters(mu=MU, K_T=K_T))
DRY_MAP = FrictionMap(
    FrictionMapParameters(
        mu_s=MU, K_T=K_T, D_max=250e-9, alpha=0.5, V_star=1e-3, V_star_at=10e-9, eta_b=0.8
    )
)


def test_coulomb_sticks_then_slips():
    presliding = MU * P / K_T
    state = COULOMB.initial_state(1, 2)
    tractions, regimes = [], []
    for _ in range(4):
        response = COULOMB.update(
            np.array([[0.4 * presliding, 0.0]]), 1.0, np.array([P]), np.zeros(1), state
        )
        state = response.state
        tractions.append(response.traction[0, 0])
        regimes.append(response.regime[0])
    np.testing.assert_allclose(tractions, MU * P * np.array([0.4, 0.8, 1.0, 1.0]), rtol=1e-14)
    assert regimes == [Regime.STICK, Regime.STICK, Regime.SLIP, Regime.SLIP]
    np.testing.assert_allclose(state.slip_path, 0.6 * presliding, rtol=1e-13)
    np.testing.assert_allclose(response.dissipation.coulomb, MU * P * 0.4 * presliding)


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("rate_dependent", [True, False])
def test_friction_map_without_film_is_coulomb(dim, rate_dependent):
    n, rng = 50, np.random.default_rng(dim)
    states = [law.initial_state(n, dim) for law in (COULOMB, DRY_MAP)]
    for _ in range(8):
        slip = 2e-7 * rng.normal(size=(n, dim))
        pressure = P * rng.random(n) * (rng.random(n) > 0.2)
        ours, theirs = (
            law.update(slip, 0.1, pressure, np.zeros(n), state, rate_dependent=rate_dependent)
            for law, state in zip((DRY_MAP, COULOMB), states[::-1], strict=True)
        )
        states = [theirs.state, ours.state]
        for name in (
            "traction",
            "d_traction_d_slip",
            "d_traction_d_elastic",
            "d_traction_d_pressure",
            "d_traction_d_film",
        ):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
        np.testing.assert_array_equal(ours.regime, theirs.regime)
        np.testing.assert_allclose(ours.dissipation.total, theirs.dissipation.total, rtol=1e-13)
        for field in dataclasses.fields(FrictionState):
            np.testing.assert_array_equal(
                getattr(ours.state, field.name), getattr(theirs.state, field.name)
            )
        np.testing.assert_array_equal(
            DRY_MAP.stored_energy(ours.state), COULOMB.stored_energy(theirs.state)
        )


def test_frictionless_has_no_traction_and_counts_the_slip():
    law: FrictionLaw = FrictionlessLaw()
    slip = np.array([[3e-6, 4e-6], [1e-6, 0.0]])
    response = law.update(slip, 0.5, np.array([P, 0.0]), np.zeros(2), law.initial_state(2, 2))
    assert not response.traction.any() and not response.d_traction_d_slip.any()
    np.testing.assert_allclose(response.state.slip_path, [5e-6, 0.0])
    np.testing.assert_allclose(response.state.speed, [1e-5, 0.0])
    assert response.regime.tolist() == [Regime.SLIP, Regime.OPEN]
    assert not law.stored_energy(response.state).any()


@pytest.mark.parametrize("law", [COULOMB, DRY_MAP, FrictionlessLaw()])
def test_a_rate_dependent_step_needs_a_duration(law):
    arguments = (np.zeros((1, 2)), 0.0, np.ones(1), np.zeros(1), law.initial_state(1, 2))
    with pytest.raises(ValueError, match=r"dt = 0\.0 s"):
        law.update(*arguments)
    assert law.update(*arguments, rate_dependent=False).state.speed[0] == 0.0


@pytest.mark.parametrize("law", [COULOMB, DRY_MAP, FrictionlessLaw()])
def test_a_rank_without_points(law):
    response = law.update(np.zeros((0, 3)), 1.0, np.zeros(0), np.zeros(0), law.initial_state(0, 3))
    assert response.traction.shape == (0, 3)
    assert response.d_traction_d_slip.shape == response.d_traction_d_elastic.shape == (0, 3, 3)
    assert response.d_traction_d_pressure.shape == response.d_traction_d_film.shape == (0, 3)
    assert response.dissipation.total.shape == (0,)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mu": -0.1, "K_T": 1.0}, r"mu = -0\.1: must be >= 0"),
        ({"mu": float("nan"), "K_T": 1.0}, "mu = nan"),
        ({"mu": 0.1, "K_T": 0.0}, r"K_T = 0\.0: must be > 0"),
    ],
)
def test_coulomb_refuses_impossible_parameters(values, message):
    with pytest.raises(ValueError, match=message):
        CoulombParameters(**values)
