"""Numbers with units as a person writes them: 30 nm instead of 3e-08 m."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

_PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n", -12: "p"}
# Units that take a prefix, with its powers of ten in use and the power of the unit under it.
_SCALED = {
    "m": (range(-12, 1), 1),
    "s": (range(-12, 1), 1),
    "m/s": (range(-12, 1), 1),
    "Pa": (range(0, 10), 1),
    "Pa/m": (range(0, 10), 1),
    "N": (range(-12, 10), 1),
    "J": (range(-12, 10), 1),
    "N m": (range(-12, 10), 1),
    "Pa s": (range(-12, 10), 1),
    "m²": (range(-12, 1), 2),
}
_RAISED = {"^2": "²", "^3": "³", "*": " "}
_QUANTITY = re.compile(r"([+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?)(?: (.*))?")


@dataclass(frozen=True, slots=True)
class Scale:
    """A unit that fits some values.

    Attributes:
        power: of ten, from it to SI; unit: its name.
    """

    power: int
    unit: str

    def text(self, value: float, digits: int = 4) -> str:
        """A value given in SI, as a number in this unit."""
        if not math.isfinite(value):
            return "–"
        return f"{value * 10.0**-self.power:.{digits}g}"


def fitting(values: Iterable[float], unit: str) -> Scale:
    """The unit in which the largest of the values has one to three digits before the point.

    Args:
        values: in SI; those that are not finite do not count.
        unit: SI unit.
    """
    largest = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    if unit not in _SCALED or largest == 0.0:
        return Scale(0, unit)
    powers, exponent = _SCALED[unit]
    usual = [power for power in _PREFIXES if power in powers]
    # A hair below, since 1 mm may come as 0.000999999….
    fits = [p for p in usual if largest >= 10.0 ** (p * exponent) * (1.0 - 1e-9)]
    power = fits[0] if fits else usual[-1]
    return Scale(power * exponent, _PREFIXES[power] + unit)


def readable(text: str) -> str:
    """A quantity as a resolved case holds it, such as "3e-08 m", exactly, but as "30 nm"."""
    match = _QUANTITY.fullmatch(text)
    if match is None:
        return text
    try:
        number = Decimal(match[1])
    except InvalidOperation:
        return text
    unit = match[2] or ""
    for old, new in _RAISED.items():
        unit = unit.replace(old, new)
    if not 0.1 <= abs(number) < 1000:
        scale = fitting([float(number)], unit)
        number, unit = number.scaleb(-scale.power), scale.unit
    return f"{_plain(number)} {unit}".rstrip()


def _plain(number: Decimal) -> str:
    """A number without needless zeros; with a power of ten where it is long."""
    number = number.normalize()
    if number == 0 or -5 < number.adjusted() < 6:
        return f"{number:f}"
    return f"{number:e}".replace("e+", "e")
