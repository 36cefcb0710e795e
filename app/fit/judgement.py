"""What a fit of friction is worth: slopes for its parameters, and what V* rests on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tribox.app.fit.model import Coordinate
from tribox.app.fit.result import Found
from tribox.app.fit.slopes import BROAD, Slopes, factor_of

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


class Judgement(Slopes):
    """Slopes of the friction for the parameters of its law."""

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
        slopes = np.array(list(full.values())).T if full else np.zeros((len(found.residual), 0))
        kept = [c for c in coordinates if c.name in full]
        super().__init__(
            kept, slopes, found.squares, lambda name: _cure(name, cures=cures), "the friction"
        )


def _cure(name: str, rows: str | None = None, cures: Mapping[str, str] = CURES) -> str:
    """What to do about a parameter that is not determined, such as "alpha at 10 nm"."""
    key = name.partition(" ")[0]
    return f"add {rows or cures[key]}"


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
        factor = factor_of(0.5 * (high - low))
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
