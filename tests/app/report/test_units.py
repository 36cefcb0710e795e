"""Numbers with units as a person writes them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tribox.app.case.quantities import COMMON_UNITS, format_quantity, parse_quantity
from tribox.app.report.page import readable


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("3e-08 m", "30 nm"), ("0.0005 m", "500 µm"), ("0.35 m", "0.35 m"), ("0.0 m", "0 m"),
        ("70000000000.0 Pa", "70 GPa"), ("100000000000.0 Pa/m", "100 GPa/m"),
        ("0.8 Pa*s", "0.8 Pa s"), ("0.02 Pa*s", "20 mPa s"), ("1000000.0 1/m", "1e6 1/m"),
        ("1100.0 kg/m^3", "1100 kg/m³"), ("-1e-05 m/s", "-10 µm/s"), ("5e-13 s", "0.5 ps"),
        ("0.33", "0.33"), ("30.0", "30"), ("neo-hookean", "neo-hookean"), ("1.2.3", "1.2.3"),
    ],
)  # fmt: skip
def test_quantities_are_readable(text, said):
    assert readable(text) == said


@settings(deadline=None)  # the first call loads the unit library
@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([*COMMON_UNITS]))
def test_readable_quantities_are_exact(value, unit):
    assert parse_quantity(readable(str(format_quantity(value, unit))), unit) == value
