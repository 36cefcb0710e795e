"""Film thickness: a number, a table over the pressure, a field."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.forms.friction.test_friction_map import FLOWS, K_T, V_STAR, P, parameters, with_flow
from tribox.forms.friction.film import (
    ConstantFilm,
    FilmField,
    FilmTable,
    at_rest,
    film_thickness,
)
from tribox.forms.friction.film_rheology import FilmRheology
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters

TABLE = FilmTable(((0.0, 60e-9), (1e6, 40e-9), (4e6, 10e-9)))


def test_the_slope_of_the_table_is_that_of_its_values():
    pressure = np.random.default_rng(0).uniform(0.0, 6e6, 1000)
    thickness, slope = TABLE.at(pressure)
    assert (np.diff(thickness[np.argsort(pressure)]) <= 0.0).all()
    h = 1.0
    away = np.min(np.abs(pressure[:, None] - [0.0, 1e6, 4e6]), axis=1) > 2 * h
    difference = (TABLE.at(pressure + h)[0] - TABLE.at(pressure - h)[0]) / (2 * h)
    np.testing.assert_allclose(slope[away], difference[away], rtol=1e-7, atol=1e-22)
    assert away.sum() > 900 and TABLE.at(np.array([9e6]))[0][0] == 10e-9
    # At a row: the slope towards higher pressures.
    np.testing.assert_allclose(TABLE.at(np.array([0.0, 1e6, 4e6]))[1], [-2e-14, -1e-14, 0.0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ConstantFilm(-1e-9), r"film thickness = -1e-09 m is not allowed"),
        (lambda: film_thickness(float("nan")), "film thickness = nan m"),
        (lambda: FilmTable(()), "at least one row"),
        (lambda: FilmTable(((1.0, 1e-9), (1.0, 2e-9))), "that rise"),
        (lambda: FilmTable(((0.0, 1e-9), (1.0, -2e-9))), "-2e-09 m"),
        (lambda: FilmField(np.ones(3)).at(np.zeros(4)), "3 thicknesses for 4 contact points"),
    ],
)
def test_what_is_no_film_is_refused_in_one_line(make, message):
    with pytest.raises(ValueError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


# -- The share of a point's area that is wet: the film's traction is proportional to it ------------

LAWS = {name: FrictionMap(with_flow(parameters(), name)) for name in FLOWS}
LAWS["stribeck"] = StribeckLaw(
    StribeckParameters(mu_s=0.15, mu_d=0.08, V_s=V_STAR, K_T=K_T, viscous=1e8)
)
COVERS = np.array([0.0, 0.3, 1.0])


def responses(law, rate_dependent=True):
    """One step of the same point, fast on a thick film, at each cover."""
    n = len(COVERS)
    return law.update(
        np.tile([3e-6, -1e-6], (n, 1)),
        1e-4,
        np.full(n, P),
        np.full(n, 150e-9),
        law.initial_state(n, 2),
        area_ratio=1.1,
        film_cover=COVERS,
        rate_dependent=rate_dependent,
    )


@pytest.mark.parametrize("name", LAWS)
def test_film_is_linear_in_its_cover(name):
    """Traction, dissipation and derivatives; what is dry or stored does not feel it."""
    out = responses(LAWS[name])
    assert out.dissipation.viscous[0] == 0.0 < out.dissipation.viscous[2]
    for value in (
        out.traction,
        out.d_traction_d_slip,
        out.d_traction_d_pressure,
        out.d_traction_d_elastic,
        out.d_traction_d_film,
        out.dissipation.viscous,
        out.dissipation.total,
    ):
        between = value[0] + 0.3 * (value[2] - value[0])
        np.testing.assert_allclose(value[1], between, rtol=1e-9, atol=1e-12 * np.abs(value).max())
    assert not np.allclose(out.traction[0], out.traction[2], rtol=1e-6)
    for part in (out.state.elastic_slip, out.dissipation.coulomb, out.state.alpha):
        np.testing.assert_array_equal(part, np.broadcast_to(part[:1], part.shape))


@pytest.mark.parametrize("name", ["newtonian", "stribeck"])
def test_without_rates_the_cover_says_nothing(name):
    out = responses(LAWS[name], rate_dependent=False)
    np.testing.assert_array_equal(out.traction, np.broadcast_to(out.traction[:1], (3, 2)))


@pytest.mark.parametrize("name", FLOWS)
def test_a_point_that_slows_down_beyond_the_rim_is_the_limit_of_little_film(name):
    """No film gives anything up there; the tangent was not a number."""
    law, ones = LAWS[name], np.ones(3)
    film, covers = 150e-9 * ones, np.array([0.0, 1e-9, 1e-7])
    fast = law.update(np.tile([3e-6, -1e-6], (3, 1)), 1e-4, P * ones, film, law.initial_state(3, 2))
    for slip in (0.0, 1e-17, 1e-9):
        out = law.update(
            np.tile([slip, 0.0], (3, 1)), 1.0, P * ones, film, fast.state, film_cover=covers
        )
        assert np.all(out.state.alpha < fast.state.alpha)
        assert np.all(np.isfinite(out.d_traction_d_film))
        for value, scale in (
            (out.traction, P),
            (out.d_traction_d_slip, K_T),
            (out.d_traction_d_pressure, 1.0),
            (out.d_traction_d_elastic, K_T),
        ):
            np.testing.assert_allclose(value[0], value[2], rtol=1e-2, atol=1e-3 * scale)


# -- The film's flow: limits, derivatives, refusals ------------------------------------------------

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


def test_a_table_of_film_fractions_goes_from_dry_to_all_film():
    """D = 0 and the least film rub alike, and so do D_max and a little less; by hand in between."""
    film = np.array([0.0, 1e-12, 5e-9, 10e-9, 215e-9, 250e-9 - 1e-12, 250e-9])
    table = parameters(alpha=((10e-9, 0.4), (180e-9, 0.8)), D_min=0.0, D_max=250e-9)
    found = at_rest(table, film)
    assert found.solid == pytest.approx([1.0, 1.0, 0.8, 0.6, 0.1, 0.0, 0.0], abs=1e-4)
    assert found.d_alpha_d_film[[2, 4]] == pytest.approx([0.4 / 10e-9, 0.2 / 70e-9])


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
