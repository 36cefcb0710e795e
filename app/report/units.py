"""Quantities of a case as a person writes them: 30 nm instead of 3e-08 m."""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation

from tribox.app.figures.units import fitting

_RAISED = {"^2": "²", "^3": "³", "*": " "}
_QUANTITY = re.compile(r"([+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?)(?: (.*))?")


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
        fit = fitting([float(number)], unit)
        number, unit = number.scaleb(-fit.power), fit.name
    return f"{_plain(number)} {unit}".rstrip()


def _plain(number: Decimal) -> str:
    """A number without needless zeros; with a power of ten where it is long."""
    number = number.normalize()
    if number == 0 or -5 < number.adjusted() < 6:
        return f"{number:f}"
    return f"{number:e}".replace("e+", "e")
