"""What a fit is worth: confidence intervals, and parameters that the data do not determine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as t_distribution

from tribox.app.fit.model import Coordinate
from tribox.app.fit.result import Found

Floats = NDArray[np.float64]

INSENSITIVE = 1e-4
"""Change of the friction's logarithm per change of the parameter's, below which there is none."""
ALIKE = 3e-3
"""Share of a parameter's effect that no other can have, below which they are one."""
CONFIDENCE = 0.95
BROAD = math.log(10.0)
"""Half-width of an interval, in logarithms, from which on the parameter is not determined."""
NOISE = 1e-3
"""Scatter that is assumed at least when asking whether data determine a parameter."""
CURES = {
    "mu_s": "dry rows (thickness up to D_min)",
    "mu_d": "rows that have slid far beyond A_d",
    "A_d": "rows with slips around A_d",
    "B": "rows with slips beyond A_d",
    "K_T": "rows with slips below mu p/K_T, before all slides",
    "eta_b": "rows in which the film drags: fast ones, or thickness from D_max on",
    "alpha": "dry rows, and slow ones with this film",
    "beta": "dry rows, and slow ones with films between D_min and D_max",
    "V_star": "rows close below and above the threshold speed",
    "gamma": "rows close below and above the threshold speed",
    "mu": "rows that slide",
    "V_s": "rows at velocities over which the friction falls",
    "delta": "rows at velocities over which the friction falls",
    "viscous": "faster rows, in which the friction rises",
}
"""Rows that would determine a parameter."""
CURES_WITHOUT_FILM = CURES | {
    "mu_s": "rows slower than V_s",
    "mu_d": "rows faster than V_s",
}
"""The same for Stribeck and Coulomb friction."""


class Judgement:
    """Slopes of the friction for the parameters at a minimum, and what follows from them.

    Attributes:
        names: Coordinates that have a slope.
        slopes: (n, c), of the weighted residual for the logarithm of each parameter (for alpha of
            alpha/(1 - alpha)), all others held.
        own: (c,), length of the part of each column that the others cannot make up.
    """

    def __init__(
        self,
        coordinates: Sequence[Coordinate],
        star: int | None,
        found: Found,
        bracketed: bool,
        cures: Mapping[str, str] = CURES,
    ) -> None:
        """Take the Jacobian of the search to the parameters themselves.

        Args:
            coordinates: What was searched for.
            star: Which of them is the threshold speed, if any.
            found: The minimum.
            bracketed: Whether the interval of the threshold speed is known otherwise.
            cures: Rows that would determine a parameter, by key.
        """
        self._cures = cures
        varied = [i for i in range(len(coordinates)) if found.free or i != star]
        columns = {coordinates[i].key: found.jacobian[:, n] for n, i in enumerate(varied)}
        full = {coordinates[i].name: found.jacobian[:, n].copy() for n, i in enumerate(varied)}
        if {"mu_s", "mu_d"} <= full.keys():  # Searched as mu_d/mu_s.
            full["mu_s"] -= full["mu_d"]
        if "gamma" in full:  # Searched as V*, with gamma = eta_b V*^2.
            full["gamma"] *= 0.5
            if "eta_b" in full:
                full["eta_b"] -= 0.5 * columns["gamma"]
        if bracketed and star is not None:
            full.pop(coordinates[star].name, None)
        self.names = tuple(full)
        self._squares = found.squares
        n = len(found.residual)
        self.slopes = np.array(list(full.values())).T if full else np.zeros((n, 0))
        self._partners = [self._others(i) for i in range(len(full))]
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
        i, cure = self.names.index(name), _cure(name, cures=self._cures)
        rows = math.sqrt(len(self.slopes))
        length, own = float(np.linalg.norm(self.slopes[:, i])), float(self.own[i])
        if length < INSENSITIVE * rows:
            return (
                f"{name}: the data cannot determine it: the friction hardly depends on it; {cure}"
            )
        partner = self._partners[i][1]
        if own < ALIKE * length and partner is not None:
            other = self.names[partner]
            return (
                f"{name}: the data cannot determine it: a change of {other} has the same effect; "
                f"{cure}"
            )
        half = self.half_width(name, max(scatter, NOISE), degrees)
        if half > BROAD:
            of = " of alpha/(1 - alpha)" if name.partition(" ")[0] == "alpha" else ""
            return (
                f"{name}: the data cannot determine it: the interval{of} spans a factor of "
                f"{_factor(half)} either way; {cure}"
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


def _cure(name: str, rows: str | None = None, cures: Mapping[str, str] = CURES) -> str:
    """What to do about a parameter that is not determined, such as "alpha at 10 nm"."""
    key = name.partition(" ")[0]
    return f"add {rows or cures[key]}"


def _factor(half: float) -> str:
    return f"{math.exp(half):.2g}" if half < 50.0 else "more than 1e20"


def interval(
    coordinate: Coordinate, value: float, half: float
) -> tuple[float | None, float | None]:
    """Ends of a confidence interval of half-width ``half`` in logarithms; None: open."""
    if half > 50.0:
        return None, None
    at = coordinate.to_search(value)
    return coordinate.to_value(at - half), coordinate.to_value(at + half)


def star_warning(
    name: str, low: float | None, high: float | None, width: float | None
) -> str | None:
    """Why the data do not determine the threshold speed; None if they do.

    Args:
        name: Of the parameter.
        low: Logarithm of the lower end of V*'s interval; None: open.
        high: Upper end.
        width: Of the transition that is assumed, where V* rests on one or two rows in it.
    """
    if low is None and high is None:
        reason, rows = "they fit with every threshold speed", CURES["V_star"]
    elif low is None:
        reason, rows = "it may lie below all their velocities", "slower rows"
    elif high is None:
        reason, rows = "it may lie above all their velocities", "faster rows"
    elif high - low > 2.0 * BROAD:
        factor = _factor(0.5 * (high - low))
        reason, rows = f"the interval spans a factor of {factor} either way", CURES["V_star"]
    elif width is not None:
        reason = (
            "it rests on one or two rows between both branches, and with them on "
            f"transition_width = {width:g}, which is assumed"
        )
        rows = CURES["V_star"]
    else:
        return None
    return f"{name}: the data cannot determine it: {reason}; {_cure(name, rows)}"


def with_star_warning(name: str, star: str) -> str:
    """Why the data do not determine a parameter that is found only at some threshold speeds."""
    return (
        f"{name}: the data cannot determine it: another {star} fits as well, with which they leave "
        f"{name} open; {_cure(name)}"
    )


def at_bound_warnings(
    names: Sequence[str], at_bound: NDArray[np.bool_], cures: Mapping[str, str] = CURES
) -> dict[str, str]:
    """Lines on parameters that ended at a bound of the search."""
    return {
        name: f"{name}: the data cannot determine it: the search ended at its bound; "
        f"{_cure(name, cures=cures)}"
        for name, hit in zip(names, at_bound, strict=True)
        if hit
    }
