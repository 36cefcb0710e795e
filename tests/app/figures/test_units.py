"""Units that fit the values."""

import numpy as np
import pytest

from app.figures.units import fitting


@pytest.mark.parametrize(
    ("values", "unit", "name", "factor"),
    [
        ([2e-9, 3e-8], "m", "nm", 1e9),
        ([1e-3 * (1 - 1e-12)], "m", "mm", 1e3),
        ([25.0], "m", "m", 1.0),
        ([2500.0], "m", "m", 1.0),
        ([-3e6, np.nan], "Pa", "MPa", 1e-6),
        ([1e-4], "Pa", "Pa", 1.0),
        ([0.0], "N", "N", 1.0),
        ([3.0], "", "", 1.0),
        ([1e-14], "N", "nN", 1e9),
    ],
)
def test_the_largest_value_has_one_to_three_digits(values, unit, name, factor):
    found = fitting(values, unit)
    assert found.name == name
    assert found.factor == pytest.approx(factor)


def test_a_value_with_its_unit():
    assert fitting([2e-4], "m/s").text(2e-4) == "200 µm/s"
