"""Hardening laws and rate factors: values, slopes against differences, and what is refused."""

import numpy as np
import pytest

from tribox.forms.bodies.hardening import JohnsonCook, Linear, Perzyna, Swift, Table, Voce

POINTS = ((0.0, 60.0), (0.02, 90.0), (0.1, 120.0), (0.5, 120.0))
LAWS = {
    "linear": Linear(60.0, 200.0),
    "voce": Voce(60.0, 160.0, 12.0, 50.0),
    "swift": Swift(180.0, 0.01, 0.22),
    "table": Table(POINTS),
}
RATES = {"johnson-cook": JohnsonCook(0.015, 2.0), "perzyna": Perzyna(6500.0, 0.25)}


@pytest.mark.parametrize("name", LAWS)
def test_slope_is_the_derivative_of_the_stress(name):
    law = LAWS[name]
    alpha = np.array([[0.001, 0.013, 0.04], [0.21, 0.7, 3.0]])  # not at the table's points
    h = 1e-6
    differences = (law.stress(alpha + h) - law.stress(alpha - h)) / (2.0 * h)
    np.testing.assert_allclose(law.slope(alpha), differences, rtol=1e-7, atol=1e-6)
    assert law.stress(alpha).shape == law.slope(alpha).shape == alpha.shape


def test_stresses_at_given_strains():
    assert Linear(60.0, 200.0).stress(np.array([0.1])) == pytest.approx([80.0], rel=1e-14)
    assert Linear(60.0).slope(np.array([0.1])) == 0.0
    voce = LAWS["voce"]
    assert voce.stress(np.array([0.0])) == pytest.approx([60.0], rel=1e-14)
    assert voce.stress(np.array([1.0 / 12.0])) == pytest.approx(
        [160.0 - 100.0 / np.e + 50.0 / 12.0], rel=1e-14
    )
    swift = LAWS["swift"].stress(np.array([0.09]))
    assert np.log(swift / 180.0) == pytest.approx([0.22 * np.log(0.1)], rel=1e-14)


def test_a_table_is_straight_between_its_points_and_level_beyond_the_last():
    table = Table([[0, 60], [0.02, 90], [0.1, 120]])
    alpha = np.array([0.0, 0.01, 0.02, 0.06, 0.1, 7.0])
    np.testing.assert_allclose(table.stress(alpha), [60.0, 75.0, 90.0, 105.0, 120.0, 120.0])
    np.testing.assert_allclose(table.slope(alpha), [1500.0, 1500.0, 375.0, 375.0, 0.0, 0.0])
    assert table.largest_strain == 0.1
    assert Table([(0.0, 60.0)]).stress(np.array([0.3])) == 60.0
    assert all(LAWS[name].largest_strain == np.inf for name in ("linear", "voce", "swift"))


def test_factors_at_given_rates():
    """Johnson and Cook's law by decades; Cowper and Symonds' doubles the stress at rate D."""
    johnson_cook = RATES["johnson-cook"].factor(np.array([0.1, 2.0, 200.0]))
    np.testing.assert_allclose(johnson_cook, [1.0, 1.0, 1.0 + 0.03 * np.log(10.0)], rtol=1e-14)
    np.testing.assert_allclose(RATES["perzyna"].factor(np.array([0.0, 6500.0])), [1.0, 2.0])
