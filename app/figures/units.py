"""Units that fit: the prefix with which the largest of some values has one to three digits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from app.figures.style import Floats

PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
# Nobody says km of a contact, or ks; and pressures below 1 Pa are noise.
LARGEST = {"m": 1.0, "m/s": 1.0, "s": 1.0}
SMALLEST = {"Pa": 1.0}


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit to draw in.

    Attributes:
        factor: from SI to it; name: such as "µm".
    """

    factor: float
    name: str

    def of(self, values: ArrayLike) -> Floats:
        """Values given in SI, in this unit."""
        return np.asarray(values, dtype=np.float64) * self.factor

    def text(self, value: float) -> str:
        """A value given in SI, with the unit behind it."""
        return f"{value * self.factor:.4g} {self.name}".rstrip()


def fitting(values: ArrayLike, unit: str) -> Unit:
    """The unit in which the largest of the values has one to three digits before the point.

    Args:
        values: in SI; NaN is passed over, and without any other the SI unit serves.
        unit: the SI unit, such as "m"; "" for plain numbers, which have no prefix.
    """
    found: Any = np.abs(np.asarray(values, dtype=np.float64))
    largest = float(np.max(found[np.isfinite(found)], initial=0.0))
    if not unit or unit.startswith("-") or largest == 0.0:
        return Unit(1.0, unit)
    usual = [
        (size, prefix)
        for size, prefix in PREFIXES
        if SMALLEST.get(unit, 0.0) <= size <= LARGEST.get(unit, np.inf)
    ]
    for size, prefix in usual:
        # A hair below, since 1 mm may come as 0.000999999….
        if largest >= size * (1.0 - 1e-9):
            return Unit(1.0 / size, prefix + unit)
    size, prefix = usual[-1]
    return Unit(1.0 / size, prefix + unit)
