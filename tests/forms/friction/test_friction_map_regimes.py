"""The friction-map law in its three regimes, and what its options do."""

from typing import Any

import numpy as np
import pytest

from tests.forms.friction.test_friction_map import K_T, V_STAR, P, parameters
from tribox.forms.friction.film import at_rest
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import Regime
from tribox.forms.friction.parameters import FrictionMapParameters, with_preset


def steady(law: FrictionMap, speed: float, film: np.ndarray, step: float = 1e-3) -> Any:
    """The response after long steady sliding at one speed, for several film thicknesses."""
    n = len(film)
    state = law.initial_state(n, 2)
    for _ in range(20):
        slip = np.tile([0.6 * step, -0.8 * step], (n, 1))
        response = law.update(slip, step / speed, np.full(n, P), film, state)
        state = response.state
    return response


PRINTED = {
    # V: (literal at 10, 30, 180 nm), (weighted at 10, 30, 180 nm); Pa s, mu = 0.1, p = 3 MPa
    1e-8: ((3.0e5, 9.0e5, 5.4e6), (2.88e5, 2971.0, 540.8)),
    1e-6: ((3000.0, 9001.0, 5.4e4), (2883.0, 30.5, 6.20)),
    1e-4: ((30.0, 90.8, 540.8), (28.9, 1.094, 0.854)),
    1e-2: ((0.331, 1.70, 6.20), (0.320, 0.800, 0.801)),
}


@pytest.mark.parametrize("speed", PRINTED)
def test_effective_viscosity_of_steady_sliding(speed):
    film = np.array([10e-9, 30e-9, 180e-9])
    values = {"mu_s": 0.1, "K_T": K_T, "V_star": 10.0, "V_star_at": 10e-9}
    found = {}
    for rule, expected in zip(("literal", "weighted"), PRINTED[speed], strict=True):
        law = FrictionMap(
            FrictionMapParameters(**with_preset("friction-map", values | {"flow_rule": rule}))
        )
        traction = np.linalg.norm(steady(law, speed, film).traction, axis=1)
        found[rule] = traction * film / speed
        np.testing.assert_allclose(found[rule], expected, rtol=5e-3)
    # The thin film is on top, as in a friction map, under the weighted rule only
    # (and where friction, not the film, makes the most of the traction).
    assert (np.diff(found["literal"]) > 0).all()
    if speed < 1e-2:
        assert (np.diff(found["weighted"]) < 0).all()


@pytest.mark.parametrize("rule", ["literal", "weighted"])
def test_above_the_threshold_speed_or_in_a_thick_film_the_response_is_newtonian(rule):
    values = {"mu_s": 0.1, "K_T": K_T, "V_star": 1e-3, "V_star_at": 10e-9, "flow_rule": rule}
    law = FrictionMap(FrictionMapParameters(**with_preset("friction-map", values)))
    film = np.array([10e-9, 30e-9, 180e-9])
    fast = steady(law, 2e-3, film)
    np.testing.assert_allclose(np.linalg.norm(fast.traction, axis=1) * film / 2e-3, 0.8, rtol=1e-12)
    assert (fast.regime == Regime.VISCOUS).all()
    for speed in (1e-8, 1e-4):
        thick = steady(law, speed, np.array([250e-9, 1e-6]))
        eta = np.linalg.norm(thick.traction, axis=1) * np.array([250e-9, 1e-6]) / speed
        np.testing.assert_allclose(eta, 0.8, rtol=1e-12)
        assert (thick.regime == Regime.VISCOUS).all()


def test_a_film_up_to_D_min_is_dry_at_every_speed_without_a_warning():
    law = FrictionMap(parameters(D_min=5e-9, B=0.0))
    with np.errstate(all="raise"):
        for speed in (1e-8, 1e3):
            dry = steady(law, speed, np.array([0.0, 5e-9]))
            np.testing.assert_allclose(np.linalg.norm(dry.traction, axis=1), 0.12 * P, rtol=1e-12)
            assert (dry.regime == Regime.SLIP).all() and not dry.state.alpha.any()


def test_elastic_slip_and_path_stay_defined_where_the_film_carries_all():
    law = FrictionMap(parameters(alpha=0.5, B=0.0, mu_d=0.12))
    slip, film = np.array([[1e-6, 0.0]]), np.array([30e-9])
    response = law.update(slip, 1e-6, np.array([P]), film, law.initial_state(1, 2))
    assert response.state.alpha[0] == 1.0
    assert response.state.elastic_slip[0, 0] == pytest.approx(0.12 * P / K_T, rel=1e-12)
    assert response.state.slip_path[0] == pytest.approx(1e-6 - 0.12 * P / K_T, rel=1e-12)
    assert response.dissipation.coulomb[0] == 0.0


def test_a_step_without_rate_effects_does_not_know_the_time():
    law = FrictionMap(parameters(alpha=0.4))
    slip, film = np.array([[1e-6, 0.0]]), np.array([30e-9])
    responses = [
        law.update(slip, dt, np.array([P]), film, law.initial_state(1, 2), rate_dependent=False)
        for dt in (0.0, 1e-9, 1.0)
    ]
    for response in responses:
        np.testing.assert_array_equal(response.traction, responses[0].traction)
        assert response.state.alpha[0] == pytest.approx(0.4)
        assert response.state.speed[0] == 0.0 and response.dissipation.viscous[0] == 0.0
        mu = law.parameters.friction.coefficient(response.state.slip_path)
        np.testing.assert_allclose(response.traction[:, 0], 0.6 * mu * P, rtol=1e-12)


def test_the_lagged_switch_takes_the_last_converged_speed():
    laws = {name: FrictionMap(parameters(switch=name)) for name in ("implicit", "lagged")}
    slip, film = np.array([[1e-6, 0.0]]), np.array([30e-9])
    dt = 1e-6 / (10 * V_STAR)
    alphas = {}
    for name, law in laws.items():
        first = law.update(slip, dt, np.array([P]), film, law.initial_state(1, 2))
        second = law.update(slip, dt, np.array([P]), film, first.state)
        alphas[name] = first.state.alpha[0], second.state.alpha[0]
        assert first.state.speed[0] == pytest.approx(10 * V_STAR)
    rest = 1.0 - at_rest(laws["lagged"].parameters, film).solid[0]
    assert alphas == {"implicit": (1.0, 1.0), "lagged": (pytest.approx(rest), 1.0)}


def test_the_film_stress_is_per_current_area():
    law = FrictionMap(parameters(alpha=0.5, mu_s=0.0, mu_d=0.0))
    slip, film = np.array([[1e-9, 0.0]]), np.array([30e-9])
    tractions = [
        law.update(
            slip, 1.0, np.array([P]), film, law.initial_state(1, 2), area_ratio=area
        ).traction[0, 0]
        for area in (1.0, 1.5)
    ]
    np.testing.assert_allclose(tractions, 0.5 * 0.8 * 1e-9 / 30e-9 * np.array([1.0, 1.5]))
