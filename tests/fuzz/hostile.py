"""Values that a person, a script or an attacker may put where a case expects a number or a name."""

import json
import re
from collections.abc import Mapping
from typing import Any

from hypothesis import strategies as st

_BARE = re.compile(r"[A-Za-z0-9_-]+")


class Raw(str):
    """Text that stands in a file as it is, such as 1e999, which no float can say."""


def text_of(value: Any) -> str:
    """One value as TOML on one line; `Raw` as it stands."""
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key_of(k)} = {text_of(v)}" for k, v in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(text_of, value))}]"
    return str(value)


def key_of(key: str) -> str:
    """A key of TOML, in quotes where it needs them."""
    return key if _BARE.fullmatch(key) else json.dumps(key, ensure_ascii=False)


def toml_of(case: Mapping[str, Any]) -> str:
    """A case as TOML, one line for each key at the top."""
    return "".join(f"{key_of(key)} = {text_of(value)}\n" for key, value in case.items())


NUMBERS = [
    *("1e999", "-1e999", "nan", "-nan", "inf", "-inf", "1e308", "-1e308", "1.8e308", "1e300"),
    *("5e-324", "1e-400", "-0.0", "0", "0.0", "-1", "1e-300", "1e154", "1e-160", "1e100", "3"),
    *("2147483648", "4294967297", "9223372036854775807", "18446744073709551616"),
    *("1000000000000", "1e12", "0x7fffffff", "0b1", "1_000", "9e15", "0.9999999999999999"),
    *("1" + "0" * 400, "9" * 4300, "9" * 5000, "-" + "9" * 5000, "0x" + "f" * 5000),
    "0." + "3" * 5000, "1e" + "9" * 5000, "2020-01-01", "12:00:00", "2020-01-01T00:00:00Z",
]  # fmt: skip
UNITS = [
    *("m", "mm", "nm", "Pa", "MPa", "s", "N", "m/s", "Pa*s", "rad", "deg", "1/m", "kg/m^3", "K"),
    *("{MPa}", "{}", "{0}", "{reason}", "m{x}", "m!", "m[0]", "%", "%s", "degC", "dB", "m**m"),
    *("m^0.5", "m**-1e400", "m" + "*m" * 3000, "(" * 3000 + "m" + ")" * 3000, "m" * 5000),
    *("\x00", "m\x00", "m\nm", "\u202em", "m\u0301", "🙂", "m/0", "lambda: m", "pi*m", "e", "m 1"),
]
WORDS = [
    *("", " ", "x", "10", "-0", "nan", "inf", "driven", "{}", "{0}", "{reason}", "{0.__class__}"),
    *("%s%n", "a.b", "..", "../../x", "/", "/dev/null", "/dev/zero", "~", "C:\\x", "a\x00b", "\n"),
    *("\x1b[31mred", "\u202eabc", "e\u0301", "🙂", "\ufeff", "null", "None", "__class__", "-h"),
    *("a" * 400, "ü" * 300, "x" * 100_000, "elastomer", "aluminium", "elastomer_contact", "top"),
    *("bottom", "implicit", "explicit", "neo-hookean", "coulomb", "friction-map", "stribeck"),
]
NESTED = [
    Raw("[" * 10_000 + "]" * 10_000), Raw("[" * 200 + "]" * 200),
    Raw("{a = " * 10_000 + "1" + "}" * 10_000), Raw("{a = " * 150 + "1" + "}" * 150),
    Raw("[" + "0," * 100_000 + "]"), Raw("[" * 10_000), Raw("{}"), Raw("[]"), Raw("[[]]"),
    Raw("[{}]"), Raw('[["0 s", "1 s"], ["0 s", "1 s"]]'), Raw('[["0 s", 1e308], ["1 s", -1e308]]'),
    Raw('[[-1e308, 0], [1e308, "1 m"]]'), Raw('[[1, 2, 3], "x"]'),
    Raw('{ table = [[0, 0], [5e-324, 1]], ramp = "smooth" }'),
    Raw('{ table = [], ramp = "{}" }'), Raw('{ table = "x", "{}" = 1 }'),
    Raw('{ "{0.__class__}" = { "\\u0000" = 1 } }'),
]  # fmt: skip

numbers = st.one_of(
    st.sampled_from(NUMBERS).map(Raw),
    st.floats().map(lambda x: Raw(repr(x))),
    st.integers().map(lambda n: Raw(str(n))),
)
quantities = st.builds(
    lambda number, blank, unit: f"{number}{blank}{unit}",
    st.one_of(st.sampled_from(NUMBERS), st.floats().map(repr)),
    st.sampled_from(["", " ", "  ", "\t"]),
    st.sampled_from(UNITS),
)
words = st.one_of(st.sampled_from(WORDS), st.text(max_size=8).filter(lambda t: "\ud800" not in t))
nested = st.sampled_from(NESTED)

values = st.one_of(
    numbers,
    quantities,
    words,
    nested,
    st.booleans(),
    st.lists(st.one_of(numbers, quantities, words), max_size=4),
)
"""Anything."""
