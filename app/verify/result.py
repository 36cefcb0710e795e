"""What a verification case finds: numbers beside closed forms, and curves to draw."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Check:
    """One number compared with a closed form (or another code's result).

    Attributes:
        quantity: what it is, in a few words.
        error: relative (or normalised, as ``quantity`` says), >= 0.
        bar: largest error allowed.
        computed: the number, in ``unit``; None where only a deviation is measured.
        exact: what it is compared with; None likewise.
        unit: of both.
    """

    quantity: str
    error: float
    bar: float
    computed: float | None = None
    exact: float | None = None
    unit: str = ""

    @property
    def passed(self) -> bool:
        """Whether the error is a number and within the bar."""
        return bool(self.error <= self.bar)


def compare(quantity: str, computed: float, exact: float, bar: float, unit: str = "") -> Check:
    """A check of one number by its relative error."""
    error = abs(computed / exact - 1.0) if exact != 0.0 else math.inf
    return Check(quantity, error, bar, computed, exact, unit)


@dataclass(frozen=True, slots=True)
class Line:
    """One curve of a figure.

    Attributes:
        label: for the legend.
        x, y: (n,), in the units of the axes.
        exact: a closed form, drawn as a line; computed values are drawn as points.
    """

    label: str
    x: NDArray[np.floating[Any]]
    y: NDArray[np.floating[Any]]
    exact: bool = False


@dataclass(frozen=True, slots=True)
class Panel:
    """One pair of axes with its curves."""

    x_label: str
    y_label: str
    lines: tuple[Line, ...]
    log: bool = False


@dataclass(frozen=True, slots=True)
class Verification:
    """The outcome of one verification case.

    Attributes:
        name: as on the command line.
        title: what is verified, in one line.
        setup: mesh, load and norms, a few sentences of Markdown.
        checks: the numbers.
        panels: the figure.
        failure: why it could not be computed; empty if it could.
    """

    name: str
    title: str
    setup: str
    checks: tuple[Check, ...]
    panels: tuple[Panel, ...] = ()
    failure: str = ""

    @property
    def passed(self) -> bool:
        """Whether it was computed and every check is within its bar."""
        return not self.failure and all(check.passed for check in self.checks)
