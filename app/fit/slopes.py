"""What any fit is worth: confidence intervals, and parameters that the data do not determine."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as t_distribution

Floats = NDArray[np.float64]

INSENSITIVE = 1e-4
"""Change of what is computed, relative, per change of the parameter's logarithm, below which there
is none."""
ALIKE = 3e-3
"""Share of a parameter's effect that no other can have, below which they are one."""
CONFIDENCE = 0.95
BROAD = math.log(10.0)
"""Half-width of an interval, in logarithms, from which on the parameter is not determined."""
NOISE = 1e-3
"""Scatter that is assumed at least when asking whether data determine a parameter."""


class Searched:
    """A parameter that is searched by its logarithm, or if bounded by that of a/(1 - a)."""

    __slots__ = ()
    name: str

    @property
    def bounded(self) -> bool:
        """Whether it is a share between 0 and 1."""
        return False

    @property
    def unit(self) -> str:
        """SI, "" of a plain number."""
        return ""

    def to_search(self, value: float) -> float:
        """Logarithm, or that of a/(1 - a)."""
        return math.log(value / (1.0 - value)) if self.bounded else math.log(value)

    def to_value(self, x: float) -> float:
        """Reverts ``to_search``."""
        return 1.0 / (1.0 + math.exp(-x)) if self.bounded else math.exp(x)


class Slopes:
    """Slopes of what was computed at a minimum, and what follows from them.

    Attributes:
        names: Parameters that have a slope.
        slopes: (n, c), of the weighted residual for the logarithm of each parameter (of shares
            that of a/(1 - a)), all others held.
        own: (c,), length of the part of each column that the others cannot make up.
    """

    def __init__(
        self,
        coordinates: Sequence[Searched],
        slopes: Floats,
        squares: float,
        cure: Callable[[str], str],
        of: str,
    ) -> None:
        """Take the slopes at a minimum.

        Args:
            coordinates: Parameters, one for each column.
            slopes: (n, c).
            squares: Sum of the squares of the weighted residual there.
            cure: What to do about a parameter of this name that the data do not determine.
            of: What was computed, for messages.
        """
        self.names = tuple(c.name for c in coordinates)
        self.slopes, self._squares = slopes, squares
        self._cure, self._of = cure, of
        self._bounded = {c.name for c in coordinates if c.bounded}
        self._partners = [self._others(i) for i in range(len(self.names))]
        self.own = np.array([own for own, _ in self._partners])

    def _others(self, i: int) -> tuple[float, int | None]:
        """Length of column i beyond what the others make up, and the column most like it."""
        column = self.slopes[:, i]
        others = np.delete(self.slopes, i, axis=1)
        lengths = np.linalg.norm(others, axis=0)
        if not lengths.any():
            return float(np.linalg.norm(column)), None
        unit = others / np.where(lengths > 0.0, lengths, 1.0)
        share, *_ = np.linalg.lstsq(unit, column, rcond=1e-10)
        most = int(np.argmax(np.abs(share)))
        return float(np.linalg.norm(column - unit @ share)), most + (most >= i)

    def half_width(self, name: str, scatter: float, degrees: int) -> float:
        """Half of the confidence interval in logarithms; infinite without any slope."""
        own = float(self.own[self.names.index(name)])
        quantile = float(t_distribution.ppf(0.5 + 0.5 * CONFIDENCE, degrees))
        return quantile * scatter / own if own > 0.0 else math.inf

    def warning(self, name: str, scatter: float, degrees: int) -> str | None:
        """Why the data do not determine a parameter; None if they do."""
        i, cure = self.names.index(name), self._cure(name)
        rows = math.sqrt(len(self.slopes))
        length, own = float(np.linalg.norm(self.slopes[:, i])), float(self.own[i])
        if length < INSENSITIVE * rows:
            return f"{name}: the data cannot determine it: {self._of} hardly depends on it; {cure}"
        partner = self._partners[i][1]
        if own < ALIKE * length and partner is not None:
            other = self.names[partner]
            return (
                f"{name}: the data cannot determine it: a change of {other} has the same effect; "
                f"{cure}"
            )
        return self.broad(name, scatter, degrees)

    def broad(self, name: str, scatter: float, degrees: int) -> str | None:
        """That the interval of a parameter is too wide; None if it is not."""
        half = self.half_width(name, max(scatter, NOISE), degrees)
        if half > BROAD:
            key = name.partition(" ")[0]
            of = f" of {key}/(1 - {key})" if name in self._bounded else ""
            return (
                f"{name}: the data cannot determine it: the interval{of} spans a factor of "
                f"{factor_of(half)} either way; {self._cure(name)}"
            )
        return None

    def open_names(self, degrees: int) -> set[str]:
        """Coordinates that the data do not determine at this minimum."""
        scatter = math.sqrt(self._squares / degrees)
        return {name for name in self.names if self.warning(name, scatter, degrees)}

    def singular_values(self) -> tuple[float, ...]:
        """Of the slopes with columns of unit length, relative to the largest."""
        if not self.names:
            return ()
        lengths = np.linalg.norm(self.slopes, axis=0)
        values = np.linalg.svd(self.slopes / np.where(lengths > 0.0, lengths, 1.0))[1]
        return tuple(float(v) for v in values / values[0]) if values[0] > 0.0 else ()

    def correlation(self) -> Floats:
        """(c, c), of the estimates; of the pseudo-inverse where it does not exist."""
        covariance = np.linalg.pinv(self.slopes.T @ self.slopes, hermitian=True)
        scale = np.sqrt(np.diag(covariance))
        scale = np.where(scale > 0.0, scale, 1.0)
        return np.asarray(covariance / np.outer(scale, scale))


def factor_of(half: float) -> str:
    """Half-width of an interval in logarithms as a factor, in words."""
    return f"{math.exp(half):.2g}" if half < 50.0 else "more than 1e20"


def interval(coordinate: Searched, value: float, half: float) -> tuple[float | None, float | None]:
    """Ends of a confidence interval of half-width ``half`` in logarithms; None: open."""
    if half > 50.0:
        return None, None
    at = coordinate.to_search(value)
    return coordinate.to_value(at - half), coordinate.to_value(at + half)
