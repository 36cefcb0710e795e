"""What a search for the parameters of the law finds, and what a fit gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from tribox.app.fit.model import Coordinate, Parameters
from tribox.app.fit.slopes import Searched

Floats = NDArray[np.float64]
Which = TypeVar("Which", bound=Searched)


@dataclass(frozen=True, slots=True)
class Estimate(Generic[Which]):
    """One parameter of the fit.

    Attributes:
        coordinate: Which.
        value: SI.
        low: Lower end of the confidence interval, SI; None: open.
        high: Upper end.
        warning: Why the data do not determine it, if they do not.
    """

    coordinate: Which
    value: float
    low: float | None
    high: float | None
    warning: str | None


@dataclass(frozen=True, slots=True)
class FitResult:
    """What a fit found.

    Attributes:
        parameters: The calibrated law.
        estimates: One for each coordinate.
        traction: (n,), Pa, of the law, for the rows of the data.
        scatter: Standard deviation of the logarithm of the friction.
        degrees: Rows less parameters.
        singular_values: Of the Jacobian with columns of unit length, relative to the largest.
        correlation: (c, c), of the coordinates ``correlated``.
        correlated: Names of the coordinates that have a slope.
    """

    parameters: Parameters
    estimates: tuple[Estimate[Coordinate], ...]
    traction: Floats
    scatter: float
    degrees: int
    singular_values: tuple[float, ...]
    correlation: Floats
    correlated: tuple[str, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the data do not determine, a line each."""
        return tuple(e.warning for e in self.estimates if e.warning)


@dataclass(frozen=True, slots=True)
class Found:
    """A minimum.

    Attributes:
        x: (c,), search coordinates.
        residual: (n,), weighted.
        jacobian: (n, c), or (n, c - 1) where V* was held.
        at_bound: (c,), whether the search ended at a bound.
        free: Whether V* was varied; else it was held.
    """

    x: Floats
    residual: Floats
    jacobian: Floats
    at_bound: NDArray[np.bool_]
    free: bool

    @property
    def squares(self) -> float:
        """Sum of the squares of the residual."""
        return float(self.residual @ self.residual)
