r"""Patterns of text such as "30 nm", by which an editor sees a unit of the wrong kind.

A unit that is one word is right if the unit library understands it as one of the right dimension:
the pattern holds all these words, as `(prefixes)?(names)s?`. A unit of several words or with an
operator ("N s/m^2", "mm²") passes unseen, as regular expressions cannot reckon with dimensions. No
pattern refuses what the program accepts. Lookaheads are not used; some editors know none.
"""

from __future__ import annotations

import functools
import re
from collections import Counter, defaultdict
from collections.abc import Iterable
from decimal import Decimal
from typing import Any

from tribox.app.case.quantities import QuantityError, _registry, parse_quantity

_LETTERS = "A-Za-z_µμ"
_WORD = re.compile(rf"[{_LETTERS}][0-9{_LETTERS}]*")
_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"

Ends = tuple[frozenset[str], frozenset[str]]
"""Prefixes with which a name is a unit, without and with a plural s."""


def unit_pattern(unit: str) -> str:
    """Regular expression (of ECMAScript, Python and Rust) of a quantity given as text.

    Args:
        unit: SI unit of the quantity, "" for a plain number.
    """
    c = f"0-9{_LETTERS}"
    more = rf"(?:[^\s{c}]|\s+\S).*"  # An operator, or another word.
    free = (
        rf"\s+(?:[^\s{c}]|[{c}]+{more}).*",
        rf"(?:[^\s{c}.,]|,[^0-9]).*",
        # Without a blank the unit does not begin with what could be part of the number.
        rf"[A-DF-Za-df-z_µμ][{c}]*{more}",
        rf"[eE][{_LETTERS}][{c}]*{more}",
        r"[eE](?:[^\s+\-" + c + r"]|\s+\S).*",
    )
    words = "|".join(_words(unit))
    known = [rf"\s*(?:{words})"] if words else []
    optional = "" if unit else "?"  # Text without a unit is no quantity that has one.
    return rf"^\s*{_NUMBER}(?:[eE][+-]?[0-9]+)?(?:{'|'.join((*known, *free))}){optional}\s*$"


def _words(unit: str) -> list[str]:
    """Alternatives that match the units of one word of this kind."""
    groups: dict[Ends, list[str]] = defaultdict(list)
    for name, ends in _units_like(unit).items():
        groups[ends].append(name)
    words = []
    for (single, plural), names in groups.items():
        stem = _either(names)
        if single == plural:
            words.append(f"{_either(single)}{stem}s?")
            continue
        words += [f"{_either(single)}{stem}"] if single else []
        words += [f"{_either(plural)}{stem}s"] if plural else []
    return words


def _either(words: Iterable[str]) -> str:
    """Pattern of one of these words; an empty one among them makes it optional."""
    listed = sorted(set(words) - {""})
    optional = "?" if "" in set(words) else ""
    return f"(?:{'|'.join(listed)}){optional}" if listed else ""


def _units_like(unit: str) -> dict[str, Ends]:
    """The names of the unit library of this unit's dimension, and what may stand around them."""
    dimension = _registry().parse_units(unit).dimensionality
    found = {}
    for name, of in _names().items():
        if of == dimension and _converts(name, unit):
            single, plural = (
                frozenset(p for p in _prefixes() if _is_read_as(p, name, end, dimension))
                for end in ("", "s")
            )
            found[name] = (single, plural)
    return found


def _converts(name: str, unit: str) -> bool:
    """Whether a unit is a multiple of this one: those of temperatures and levels are not."""
    try:
        parse_quantity(f"1 {name}", unit)
    except QuantityError:
        # A name that may be read in another way: with some prefixes it may do.
        return _readings()[name] > 1
    return True


def _is_read_as(prefix: str, name: str, end: str, dimension: object) -> bool:
    """Whether the library reads a word as a multiple of units of this dimension.

    "dB" could be a tenth of a byte, and is read as a level.
    """
    word = f"{prefix}{name}{end}"
    if _readings()[word] == 1:
        return True
    read = _library().parse_unit_name(word)[0][1]
    return bool(_names()[read] == dimension and _library()._units[read].is_multiplicative)


@functools.cache
def _library() -> Any:
    """A unit library that has read no text: what it has read before may be names to it later."""
    import pint

    return pint.UnitRegistry(non_int_type=Decimal)


@functools.cache
def _prefixes() -> tuple[str, ...]:
    """The library's prefixes, the empty one among them."""
    return tuple(_library()._prefixes)


@functools.cache
def _names() -> dict[str, object]:
    """Dimension of each name of one word in the unit library."""
    library = _library()
    return {
        name: library.Unit(definition.name).dimensionality
        for name, definition in list(library._units.items())
        if _WORD.fullmatch(name)
    }


@functools.cache
def _readings() -> Counter[str]:
    """In how many ways the words of the unit library can be read as prefix, name and plural."""
    return Counter(p + name + end for name in _names() for p in _prefixes() for end in ("", "s"))
