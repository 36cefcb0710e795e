"""Patterns of text with a unit: nothing that the program takes is refused."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tribox.app.case.quantities import COMMON_UNITS, QuantityError, parse_quantity
from tribox.app.case.schema import _names, _prefixes, unit_pattern

UNITS = [*COMMON_UNITS, "rad"]


def accepts(text: str, unit: str) -> bool:
    try:
        parse_quantity(text, unit)
    except QuantityError as error:
        return "finite" in str(error)  # 1e999 mm is of the right kind
    return True


def matches(text: str, unit: str) -> bool:
    return re.search(unit_pattern(unit), text) is not None


numbers = st.sampled_from(["1", "-2.5", ".5", "3.", "1e3", "+4E-2", "12"])
blanks = st.sampled_from(["", " ", "  ", "\t", "\u00a0"])
ends = st.sampled_from(["", "s"])
words = st.builds(
    lambda prefix, name, end: prefix + name + end * (len(name) > 2),  # "yms": once "ms" was read
    st.sampled_from(_prefixes()),
    st.sampled_from(sorted(_names())),
    ends,
)
short = st.sampled_from("m mm um µm μm nm s ms min h N kN kg g Pa MPa bar K rad deg % ²m".split())
between = st.sampled_from(" |*|/| / |·|⋅|^2/|**2*| per |²|³ |⁻¹ ".split("|"))
tails = st.sampled_from(["", "^2", "^3", "^-1", "**2", "²", "³", "⁻²", " squared", ")"])
firsts = st.sampled_from(["1", "square mm", "cubic meter", "(N", "sq m"])
compounds = st.builds(
    lambda first, operator, second, tail: first + operator + second + tail,
    st.one_of(short, firsts),
    between,
    st.one_of(short, words),
    tails,
)


@settings(max_examples=120, deadline=None)
@given(numbers, blanks, st.one_of(words, compounds, short), blanks, st.sampled_from(UNITS))
def test_what_the_program_takes_matches(number, before, text, after, unit):
    whole = after + number + before + text + after
    assert matches(whole, unit) or not accepts(whole, unit)


@settings(max_examples=120, deadline=None)
@given(numbers, blanks, words, st.sampled_from(UNITS))
def test_a_single_word_matches_only_where_it_is_of_the_right_kind(number, before, word, unit):
    whole = number + before + word
    assert matches(whole, unit) == accepts(whole, unit)


@pytest.mark.parametrize("unit", UNITS)
def test_spellings_in_use_and_the_unit_itself_match(unit):
    for text in (unit, *COMMON_UNITS.get(unit, ())):
        assert matches(f"1 {text}", unit) and matches(f"2.5e-3{text} ", unit)
    assert matches("7", unit) == matches(" -1e-9 ", unit) == (not unit) == accepts("7", unit)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("10 ms", "m"), ("10ms", "m"), ("1e-5 ms", "m"), ("1.5ms ", "m"), ("12 mn", "m"),
        ("5 Mpa", "Pa"), ("5 N", "Pa"), ("3 m", "s"), ("ten nm", "m"), ("1,5 mm", "s"), ("", "m"),
        ("0.2 m", ""), ("3 kms", "Pa"), ("1dB", "rad"), ("1 dB", ""),
    ],
)  # fmt: skip
def test_what_an_editor_sees_at_once(text, unit):
    assert not matches(text, unit) and not accepts(text, unit)
