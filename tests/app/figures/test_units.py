"""Units that fit the values."""

import numpy as np
import pytest

from tribox.app.figures.units import fitting


@pytest.mark.parametrize(
    ("values", "unit", "name", "factor"),
    [
        ([2e-9, 3e-8], "m", "nm", 1e9), ([1e-3 * (1 - 1e-12)], "m", "mm", 1e3),
        ([25.0], "m", "m", 1.0), ([2500.0], "m", "m", 1.0), ([-3e6, np.nan], "Pa", "MPa", 1e-6),
        ([1e-4], "Pa", "Pa", 1.0), ([0.0], "N", "N", 1.0), ([3.0], "", "", 1.0),
        ([1e-14], "N", "pN", 1e12),
    ],
)  # fmt: skip
def test_the_largest_value_has_one_to_three_digits(values, unit, name, factor):
    found = fitting(values, unit)
    assert found.name == name
    assert found.factor == pytest.approx(factor)


def test_a_value_with_its_unit():
    assert fitting([2e-4], "m/s").text(2e-4) == "200 µm/s"


@pytest.mark.parametrize(
    ("values", "unit", "text", "name"),
    [
        ([1e-3, 2e-3], "m", "1", "mm"), ([3e-8, 1e-9], "m", "30", "nm"),
        ([1e-6], "m²", "1", "mm²"), ([2.0, 1e4], "N", "0.002", "kN"), ([1e-20], "m", "1e-08", "pm"),
        ([0.0], "m", "0", "m"), ([float("nan"), 1e3], "Pa", "–", "kPa"), ([5e3], "", "5000", ""),
        ([2e6, 1e-9], "Pa", "2", "MPa"),
    ],
)  # fmt: skip
def test_a_number_in_the_unit_of_the_largest(values, unit, text, name):
    scale = fitting(values, unit)
    assert (scale.number(values[0]), scale.name) == (text, name)
