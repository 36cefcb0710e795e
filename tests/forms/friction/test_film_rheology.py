"""The film's flow: limits, derivatives, refusals."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tribox.forms.friction.film_rheology import FilmRheology

rheologies = st.builds(
    lambda limit, thinning, **rest: FilmRheology(eta_b=0.8, **limit, **thinning, **rest),
    limit=st.sampled_from(
        [{}, {"tau_0": 1e5}, {"tau_0": 0.0, "zeta": 0.03}, {"tau_0": 1e4, "zeta": 0.1}]
    ),
    thinning=st.sampled_from(
        [
            {},
            {"critical_rate": 1e4, "thinning_exponent": 0.5},
            {"critical_rate": 1e4, "thinning_exponent": 0.0},
            {"critical_rate": 1e2, "thinning_exponent": 0.3, "eta_inf": 0.02},
        ]
    ),
    barus=st.sampled_from([0.0, 2e-8, 5e-7]),
)


def inputs(seed: int, n: int = 200) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return 10 ** rng.uniform(-4, 8, n), 10 ** rng.uniform(2, 7, n)


@settings(derandomize=True, deadline=None, max_examples=100)
@given(rheologies, st.integers(0, 10**6))
def test_derivatives_are_exact_and_the_stress_neither_falls_nor_exceeds_its_limit(flow, seed):
    rate, pressure = inputs(seed)
    here = flow.viscosity(rate, pressure)
    for exact, x, at in (
        (here.d_rate, rate, lambda x: flow.viscosity(x, pressure).value),
        (here.d_pressure, pressure, lambda x: flow.viscosity(rate, x).value),
    ):
        h = 1e-3 * x
        slope = (at(x - 2 * h) - 8 * at(x - h) + 8 * at(x + h) - at(x + 2 * h)) / (12 * h)
        noise = 1e-8 * here.value / x  # Truncation, and round-off where effects cancel.
        assert (np.abs(slope - exact) <= 1e-8 * np.abs(exact) + noise).all()
    stress = here.value * rate
    assert (here.value > 0.0).all() and (here.value + rate * here.d_rate >= -1e-12).all()
    base = flow.eta_b * np.exp(flow.barus * pressure)
    assert (here.value <= base * (1 + 1e-12)).all()
    if flow.tau_0 is not None:
        assert (stress <= (flow.tau_0 + flow.zeta * pressure) * (1 + 1e-12)).all()


def test_each_option_does_what_it_is_named_after():
    one = np.ones(1)
    limit = FilmRheology(eta_b=0.8, tau_0=1e5, zeta=0.1)
    assert limit.viscosity(1e12 * one, 1e6 * one).value[0] * 1e12 == pytest.approx(2e5)
    assert limit.viscosity(0.0 * one, 1e6 * one).value[0] == 0.8
    thin = FilmRheology(eta_b=0.8, critical_rate=1e3, thinning_exponent=0.25)
    ratio = thin.viscosity(1e9 * one, one).value / thin.viscosity(1e8 * one, one).value
    assert math.log10(ratio[0]) == pytest.approx(-0.75, abs=1e-9)  # Stress ~ rate^n.
    thick = FilmRheology(eta_b=0.8, barus=2e-8)
    assert thick.viscosity(one, 1e8 * one).value[0] == pytest.approx(0.8 * math.exp(2.0))
    assert FilmRheology(eta_b=0.8).newtonian and not thick.newtonian


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"zeta": 0.1}, "zeta = 0.1: must be 0 without tau_0"),
        ({"tau_0": 0.0}, "tau_0 = 0.0: must be > 0 Pa, or zeta > 0"),
        ({"tau_0": -1.0}, "tau_0 = -1.0"),
        ({"critical_rate": 1e3}, "thinning_exponent: missing"),
        ({"critical_rate": 1e3, "thinning_exponent": 1.5}, r"thinning_exponent = 1\.5"),
        ({"thinning_exponent": 0.5}, "goes with critical_rate only"),
        ({"eta_inf": 0.1}, "0 without critical_rate"),
        (
            {"eta_inf": 0.9, "critical_rate": 1e3, "thinning_exponent": 0.5},
            r"must be <= eta_b = 0\.8",
        ),
        ({"barus": -1.0}, "barus = -1.0"),
    ],
)
def test_impossible_parameters_are_refused(values: dict[str, Any], message: str):
    with pytest.raises(ValueError, match=message):
        FilmRheology(eta_b=0.8, **values)
