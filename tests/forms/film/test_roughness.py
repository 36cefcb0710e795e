"""Films between rough surfaces and what their asperities carry."""

import numpy as np
import pytest
from scipy.integrate import quad

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


def normal(z):
    return np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)


@pytest.mark.parametrize("ratio", [-7.0, -5.0, -3.5, -1.0, 0.4, 2.5])
def test_the_mean_film_is_the_mean_of_what_is_open(ratio):
    """Of gaps g + σz with normal z, those below 0 being closed."""
    mean = quad(lambda z: (ratio + z) * normal(z), -ratio, 12.0, epsabs=0.0)[0]
    found = RoughGap(SIGMA).film(np.array([ratio * SIGMA]))[0][0] / SIGMA - 1e-3
    assert found == pytest.approx(mean, rel=5e-3 if ratio < -6.0 else 1e-7)


@pytest.mark.parametrize("ratio", [0.0, 0.5, 1.0, 1.5, 2.0])
def test_greenwood_and_tripps_asperities_are_the_integral_of_their_heights(ratio):
    """F_5/2(g/σ): within what its fit misses it by."""
    exact = quad(lambda s: (s - ratio) ** 2.5 * normal(s), ratio, 12.0)[0]
    found = GreenwoodTripp(1.0, SIGMA).pressure(np.array([ratio * SIGMA]))[0][0]
    assert found == pytest.approx(exact, rel=0.12)


def test_a_table_has_the_pressures_of_its_rows_and_lines_between_them():
    law = LAWS[2]
    z = np.array([-2.0, -1.0, -0.25, 0.5, 1.75, 3.0, 9.0])
    pressure, slope = law.pressure(z * SIGMA)
    third = 2e6 / 1.5
    assert pressure == pytest.approx([3e6 + third, 3e6, 2e6, 1e6, 0.5e6, 0.0, 0.0])
    assert slope[[0, 2, 4, 6]] * SIGMA == pytest.approx([-third, -third, -0.4e6, 0.0])


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


@pytest.mark.parametrize(
    ("gamma", "ratio", "factor"),
    [  # N. Patir, H. Cheng, J. Lubr. Technol. 100, 1978; below the range of their fit its ends
        (1 / 9, 1.0, 1.0 - 1.48 * np.exp(-0.42)),
        (1 / 9, 0.5, 0.01),
        (1 / 6, 1.5, 1.0 - 1.38 * np.exp(-0.63)),
        (1 / 3, 1.0, 1.0 - 1.18 * np.exp(-0.42)),
        (1.0, 2.0, 1.0 - 0.90 * np.exp(-1.12)),
        (3.0, 4.0, 1.0 + 0.225 / 8.0),
        (6.0, 1.0, 1.520),
        (9.0, 1.0, 1.870),
        (9.0, 0.1, 1.0 + 0.870 * 2.0**1.5),
    ],
)
def test_flow_factors_are_those_of_their_table(gamma, ratio, factor):
    found = RoughGap(SIGMA, gamma).flow(np.array([ratio * SIGMA]))[0][0]
    assert found == pytest.approx(factor, rel=1e-12)


def test_values_that_are_not_allowed_are_refused_in_one_line():
    with pytest.raises(ValueError, match=r"gamma = 2\.0: must be one of"):
        RoughGap(SIGMA, 2.0)
    with pytest.raises(ValueError, match="asperity table"):
        AsperityTable(((0.0, 1.0), (1.0, 2.0)), SIGMA)
    with pytest.raises(ValueError, match="u_0"):
        Exponential(1.0, 0.0)
