"""TOML of anyone's making as plain data within bounds; what goes beyond them is refused."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from datetime import date, time
from typing import Any

DEEPEST = 30
"""Tables and arrays inside each other; a case needs eight."""
DIGITS = 400
"""Of a whole number; no float is larger."""


class TomlError(ValueError):
    """Text that is not TOML, or goes beyond the bounds.

    Attributes:
        line: number of the line, from 1; None where it is not known.
        is_toml: whether the text is TOML all the same.
    """

    def __init__(self, reason: str, line: int | None = None, is_toml: bool = True) -> None:
        super().__init__(reason)
        self.line, self.is_toml = line, is_toml


def parse_toml(text: str) -> dict[str, Any]:
    """Nested tables, arrays, texts, numbers and truth values of TOML text.

    Raises:
        TomlError: it is none, is nested too deeply, or holds an endless number or a date.
    """
    try:
        data = tomllib.loads(text)
    except RecursionError:
        raise TomlError(_TOO_DEEP) from None
    except tomllib.TOMLDecodeError as error:
        match = re.fullmatch(r"(.*) \(at line (\d+), column (\d+)\)", str(error), re.DOTALL)
        if match is None:
            raise TomlError(f"not valid TOML: {error}", is_toml=False) from None
        reason = f"not valid TOML: {match[1]} (column {match[3]})"
        raise TomlError(reason, int(match[2]), is_toml=False) from None
    except ValueError:  # Python reads no more than 4300 digits.
        found = re.search(rf"[0-9_]{{{DIGITS},}}", text)
        line = None if found is None else text.count("\n", 0, found.start()) + 1
        raise TomlError(_TOO_LONG, line) from None
    see_bounds(data)
    return data


_TOO_DEEP = f"tables or arrays are nested more than {DEEPEST} deep"
_TOO_LONG = f"holds a whole number of more than {DIGITS} digits"


def see_bounds(data: dict[str, Any]) -> None:
    """See that plain data keep the bounds; without recursion, which has a bound of its own.

    Raises:
        TomlError: they do not.
    """
    level: list[tuple[str, Any]] = [("", data)]
    for _ in range(DEEPEST + 1):
        level = [entry for place, value in level for entry in _entries(place, value)]
        for place, value in level:
            if isinstance(value, int) and value.bit_length() > DIGITS * 10 // 3:
                raise TomlError(f"{place}: {_TOO_LONG}")
            if isinstance(value, date | time):
                raise TomlError(f"{place}: is a date or time of day, which no key takes")
    if level:
        raise TomlError(f"{level[0][0].split('.')[0]}: {_TOO_DEEP}")


def _entries(place: str, value: Any) -> Iterator[tuple[str, Any]]:
    """What is inside a value, with its dotted place."""
    before = f"{place}." if place else ""
    if isinstance(value, dict):
        yield from ((f"{before}{key}", inner) for key, inner in value.items())
    elif isinstance(value, list):
        yield from ((f"{before}{index}", inner) for index, inner in enumerate(value))
