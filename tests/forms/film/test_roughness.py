"""Films between rough surfaces and what their asperities carry."""

from __future__ import annotations

import numpy as np
import pytest

from tribox.forms.film.roughness import (
    AsperityTable,
    Exponential,
    GreenwoodTripp,
    NoAsperities,
    RoughGap,
)

SIGMA = 3e-7
LAWS = [
    Exponential(1e6, SIGMA),
    GreenwoodTripp(4e6, SIGMA),
    AsperityTable(((-1.0, 3e6), (0.5, 1e6), (3.0, 0.0)), SIGMA),
    NoAsperities(),
]
GAPS = SIGMA * np.array([-40.0, -7.0, -5.9, -2.0, -0.3, 0.2, 1.7, 2.9, 3.7, 6.0, 60.0])


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_asperities_push_the_more_the_closer_and_their_slope_is_that_of_differences(law):
    p, slope = law.pressure(GAPS)
    assert np.all(np.diff(p) <= 0.0)
    assert np.all(p >= 0.0)
    e = 1e-6 * SIGMA
    difference = (law.pressure(GAPS + e)[0] - law.pressure(GAPS - e)[0]) / (2 * e)
    assert slope == pytest.approx(difference, rel=1e-5, abs=1e-6 * np.abs(slope).max())
    work = (law.energy(GAPS - e) - law.energy(GAPS + e)) / (2 * e)
    assert p == pytest.approx(work, rel=1e-5, abs=1e-6 * p.max())
    assert law.energy(np.array([1e3 * SIGMA])) == pytest.approx(0.0, abs=1e-30)


def test_the_mean_film_is_the_gap_far_apart_and_stays_positive_pressed_flat():
    h, slope = RoughGap(SIGMA).film(GAPS)
    assert np.all(h > 0.0)
    assert np.all(np.diff(h) >= 0.0)
    assert h[-1] == pytest.approx(GAPS[-1] + 1e-3 * SIGMA, rel=1e-12)
    e = 1e-5 * SIGMA
    difference = (RoughGap(SIGMA).film(GAPS + e)[0] - RoughGap(SIGMA).film(GAPS - e)[0]) / (2 * e)
    assert slope == pytest.approx(difference, rel=1e-4, abs=1e-8)
    at_zero = RoughGap(SIGMA).film(np.zeros(1))[0][0]
    assert at_zero == pytest.approx(SIGMA * (1.0 / np.sqrt(2.0 * np.pi) + 1e-3), rel=1e-12)


def test_the_film_is_continuous_where_its_tail_begins():
    edge = SIGMA * np.array([-6.0 - 1e-9, -6.0 + 1e-9])
    low, high = RoughGap(SIGMA).film(edge)[0] - 1e-3 * SIGMA
    assert low == pytest.approx(high, rel=5e-3)


@pytest.mark.parametrize("gamma", [1 / 9, 1 / 3, 1.0, 3.0, 9.0])
def test_flow_factors_tend_to_one_and_have_their_slope(gamma):
    rough = RoughGap(SIGMA, gamma)
    film = SIGMA * np.array([0.1, 0.45, 1.1, 2.0, 4.0, 30.0])
    phi, slope = rough.flow(film)
    assert np.all(phi > 0.0)
    assert phi[-1] == pytest.approx(1.0, abs=0.01)
    assert np.all((phi < 1.0) if gamma <= 1.0 else (phi > 1.0))
    e = 1e-6 * SIGMA
    difference = (rough.flow(film + e)[0] - rough.flow(film - e)[0]) / (2 * e)
    assert slope == pytest.approx(difference, rel=1e-6, abs=1e-6 / SIGMA)


def test_values_that_are_not_allowed_are_refused_in_one_line():
    with pytest.raises(ValueError, match=r"gamma = 2\.0 is not allowed"):
        RoughGap(SIGMA, 2.0)
    with pytest.raises(ValueError, match="asperity table"):
        AsperityTable(((0.0, 1.0), (1.0, 2.0)), SIGMA)
    with pytest.raises(ValueError, match="u_0"):
        Exponential(1.0, 0.0)
