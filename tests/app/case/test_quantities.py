"""Units, bounds and tables of user input."""

import math
import re
import subprocess
import sys
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic_core import PydanticCustomError

from tribox.app.case.quantities import (
    COMMON_UNITS,
    Quantity,
    QuantityError,
    _registry,
    format_quantity,
    parse_quantity,
)
from tribox.app.case.schema import unit_pattern
from tribox.app.case.time_tables import NumberOrTable, Program, TimeTable

FINITE = st.floats(allow_nan=False, allow_infinity=False)


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        ("30 nm", "m", 3e-8), ("30nm", "m", 3e-8), ("  -0.35   mm ", "m", -3.5e-4),
        ("0.5 µm", "m", 5e-7), ("0.5 μm", "m", 5e-7), ("0.3", "", 0.3), (3e-8, "m", 3e-8),
        (3, "m", 3.0), (".5 m", "m", 0.5), ("3 MPa", "Pa", 3e6), ("3.0e6 N/m^2", "Pa", 3e6),
        ("3.0e6 N/m**2", "Pa", 3e6), ("2 bar", "Pa", 2e5), ("0.8 Pa*s", "Pa*s", 0.8),
        ("0.8 N s/m^2", "Pa*s", 0.8), ("800 cP", "Pa*s", 0.8), ("1 poise", "Pa*s", 0.1),
        ("1e13 Pa/m", "Pa/m", 1e13), ("10 N/mm^3", "Pa/m", 1e10), ("1e6 1/m", "1/m", 1e6),
        ("2 1/nm", "1/m", 2e9), ("4e-25 N/s", "N/s", 4e-25), ("60 mm/min", "m/s", 1e-3),
        ("1.1 g/cm^3", "kg/m^3", 1100.0), ("2 min", "s", 120.0), ("3 %", "", 0.03), (0.1, "", 0.1),
        ("20 °C", "K", 293.15), ("20 degC", "K", 293.15), ("180 °", "rad", math.pi),
    ],
)  # fmt: skip
def test_parses_to_the_nearest_float(value, unit, expected):
    assert parse_quantity(value, unit) == expected


@pytest.mark.parametrize(
    ("value", "unit", "reason"),
    [
        ("3 s", "m", '"s" has the wrong dimension; must be a number (in m)'),
        ("3 Pa", "Pa*s", '"Pa" has the wrong dimension'),
        ("3 mm mm", "m", '"mm mm" has the wrong dimension'),
        ("0.2 m", "", "must be a plain number"),
        ("3 nmm", "m", 'unknown unit "nmm"; must be a number (in m)'),
        ("3 Mpa", "Pa", 'unknown unit "Mpa"; did you mean "MPa"?'),
        ("3 MM/s", "m/s", '"MM/s" has the wrong dimension; did you mean "mm/s"?'),
        ("3 N/mm2", "Pa", 'unknown unit "N/mm2"; did you mean "N/mm^2"?'),
        ("3 MN/m2", "Pa", 'did you mean "MN/m^2"?'), ("3 m2", "m", "must be a number (in m)"),
        ("3 s-1", "1/s", 'did you mean "s^-1"?'), ("3 mPas", "Pa*s", 'did you mean "mPa*s"?'),
        ("3 Newton", "N", 'did you mean "newton"?'), ("3 m/s2", "m/s^2", 'mean "m/s^2"?'),
        ("0,5 mm", "m", "decimals stand behind a point"), ("20 degC", "m", "wrong dimension"),
        ("3 MPa/", "Pa", "unknown unit"), ("3 __import__('os')", "m", "unknown unit"),
        ("3,5 mm", "m", "unknown unit"), ("3 m 4 s", "m", "unknown unit"),
        ("3e-8", "m", "is text without a unit; must be a number (in m) or text with a unit"),
        ("5 {MPa}", "Pa", 'unknown unit "{MPa}"'), ("5 MPa!", "Pa", 'unknown unit "MPa!"'),
        ("5 m" + "*m" * 3000, "m", "has 6003 letters"),
        ("1e9999999999999999999 m", "m", "must be finite"),
        ("nm", "m", "must be a number (in m) or text with a unit of its kind"),
        ("", "m", "must be a number"), ("thin", "m", "must be a number"),
        (True, "m", "must be a number"), (None, "m", "must be a number"),
        ([1.0], "m", "must be a number"), ("inf m", "m", "must be finite"),
        ("nan", "m", "must be finite"), (math.inf, "m", "must be finite"),
        (math.nan, "m", "must be finite"), ("1e400 m", "m", "must be finite"),
        ("1e99999999 km", "m", "must be finite"), (10**400, "m", "must be finite"),
    ],
)  # fmt: skip
def test_refuses_what_is_no_such_quantity(value, unit, reason):
    with pytest.raises(QuantityError) as error:
        parse_quantity(value, unit)
    assert reason in str(error.value)
    assert "\n" not in str(error.value)


def test_common_units_agree_with_the_unit_library():
    registry = _registry()
    for unit, spellings in COMMON_UNITS.items():
        for text, factor in spellings.items():
            given_unit = registry.Quantity(Decimal(1), registry.parse_units(text))
            assert given_unit.to(registry.parse_units(unit)).magnitude == Decimal(factor), text


def test_common_units_do_not_start_the_unit_library():
    script = (
        "import sys; from tribox.app.case.quantities import parse_quantity as p;"
        "assert p('30 nm', 'm') == 3e-8; assert 'pint' not in sys.modules;"
        "assert p('1 inch', 'm') == 0.0254; assert 'pint' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


@given(FINITE, st.sampled_from([*COMMON_UNITS]))
def test_written_quantities_read_back_exactly(value, unit):
    assert parse_quantity(format_quantity(value, unit), unit) == value
    assert format_quantity(np.float64(value), unit) == format_quantity(value, unit)


@pytest.mark.parametrize(
    ("quantity", "value", "reason"),
    [
        (Quantity("m", ge=0.0), "-3 nm", "must be >= 0 m"),
        (Quantity("m", gt=0.0), 0, "must be > 0 m"),
        (Quantity("", gt=-1.0, lt=0.5), 0.5, "must be > -1 and < 0.5"),
        (Quantity("", ge=0.0, le=1.0), 1.5, "must be >= 0 and <= 1"),
        (Quantity("m/s", nonzero=True), "0 mm/s", "must not be 0"),
        (Quantity("m/s", nonzero=True), -0.0, "must not be 0"),
    ],
)
def test_bounds(quantity, value, reason):
    with pytest.raises(QuantityError) as error:
        quantity.parse(value)
    assert str(error.value) == reason


def test_bounds_include_and_exclude_their_ends():
    assert Quantity("m", ge=0.0).parse(0) == 0.0
    assert Quantity("", le=1.0).parse(1) == 1.0
    assert Quantity("m/s", nonzero=True).parse("-1 mm/s") == -1e-3


def test_time_table_is_linear_and_held():
    table = TimeTable((1.0, 3.0), (2.0, 6.0))
    assert [table(t) for t in (0.0, 1.0, 1.5, 3.0, 9.0)] == [2.0, 2.0, 3.0, 6.0, 6.0]
    assert TimeTable.constant(4.0)(-1.0) == TimeTable.constant(4.0)(7.0) == 4.0


def test_integral_of_a_time_table():
    table = TimeTable((1.0, 3.0), (2.0, 6.0))
    assert table.integral(0.0) == 0.0
    assert table.integral(1.0) == pytest.approx(2.0)
    assert table.integral(2.0) == pytest.approx(2.0 + 3.0)
    assert table.integral(5.0) == pytest.approx(2.0 + 8.0 + 12.0)
    assert TimeTable((-2.0, 2.0), (0.0, 4.0)).integral(2.0) == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("times", "values"),
    [((), ()), ((0.0,), (1.0, 2.0)), ((0.0, 0.0), (1.0, 2.0)), ((0.0,), (math.nan,))],
)
def test_time_table_refuses_what_is_no_function(times, values):
    with pytest.raises(ValueError, match="time table"):
        TimeTable(times, values)


def test_program_takes_constants_tables_and_its_word():
    program = Program("Pa", word="driven")
    assert program.parse("3 MPa") == TimeTable.constant(3e6)
    assert program.parse(0) == TimeTable.constant(0.0)
    table = program.parse([["0 s", "0 MPa"], ["100 ms", "3 MPa"]])
    assert table == TimeTable((0.0, 0.1), (0.0, 3e6))
    assert program.parse("driven") == "driven"
    with pytest.raises(PydanticCustomError, match="has displacement = "):
        Program("m/s").parse("driven")


@pytest.mark.parametrize(
    ("value", "place", "reason"),
    [
        ("3 m", (), "wrong dimension"),
        ("drven", (), 'or a table [[time, value], ...], or "driven"'),
        ([], (), "at least one row"),
        ([1, 2], (0,), "must be a pair [time, value]"),
        ([[0, 1], [1, 2, 3]], (1,), "must be a pair"),
        ([[0, 1], ["1 m", 2]], (1, 0), "wrong dimension"),
        ([[0, 1], [1, "2 m"]], (1, 1), "wrong dimension"),
        ([[0, 1], [0, 2]], (1, 0), "the time must increase"),
        ([[2, 1], [1, 2]], (1, 0), "the time must increase"),
        ([[0, math.inf]], (0, 1), "must be finite"),
    ],
)
def test_program_says_where_a_table_is_wrong(value, place, reason):
    with pytest.raises(PydanticCustomError) as error:
        Program("Pa", word="driven").parse(value)
    assert error.value.context is not None
    assert error.value.context["at"] == place
    assert reason in error.value.context["reason"]


def test_a_program_in_a_unit_that_is_nearly_one_asks_for_that_alone():
    with pytest.raises(PydanticCustomError) as error:
        Program("Pa", word="driven").parse("3 Mpa")
    assert error.value.context is not None
    assert error.value.context["reason"] == 'unknown unit "Mpa"; did you mean "MPa"?'


def test_number_or_table():
    kind = NumberOrTable(Quantity("m", gt=0.0, name="film thickness"), Quantity(le=1.0))
    assert kind.parse(0.5) == 0.5
    assert kind.parse([["10 nm", 0.039], ["30 nm", 0.9967]]) == ((1e-8, 0.039), (3e-8, 0.9967))
    for wrong, reason in (
        (2, "must be <= 1"),
        ([["10 nm", 2]], "must be <= 1"),
        ([["0 nm", 1]], "must be > 0 m"),
        ([["10 nm", 1], ["10 nm", 1]], "the film thickness must increase"),
    ):
        with pytest.raises(PydanticCustomError, match=reason):
            kind.parse(wrong)


# -- Patterns of text with a unit: nothing that the program takes is refused -----------------------

UNITS = [*COMMON_UNITS, "rad"]


def accepts(text: str, unit: str) -> bool:
    try:
        parse_quantity(text, unit)
    except QuantityError as error:
        return "finite" in str(error)  # 1e999 mm is of the right kind
    return True


def matches(text: str, unit: str) -> bool:
    return re.search(unit_pattern(unit), text) is not None


ODD = ("eV", "Em", "1/s", "²m", "(N/m)", "Pa s⁻¹", "N·m", "square mm", "m per s", "m squared")


@pytest.mark.parametrize("unit", UNITS)
def test_spellings_in_use_and_the_unit_itself_match(unit):
    for text in (unit, *COMMON_UNITS.get(unit, ()), *ODD):
        assert matches(f"1 {text}", unit) and matches(f"\t+.5e-3\u00a0{text} ", unit)
        assert matches(f"3.{text}", unit) or not accepts(f"3.{text}", unit)
    assert matches("7", unit) == matches(" -1e-9 ", unit) == (not unit) == accepts("7", unit)


@pytest.mark.parametrize("text", ["ten nm", "", "nm", "1.5", "-1e-9", "12", "7 "])
def test_an_editor_sees_a_number_or_unit_that_is_missing(text):
    assert not matches(text, "m") and not accepts(text, "m")
