"""Film thickness D of a contact: a number, a table over the pressure, or a field of points.

D is an input of the friction law; it does not evolve, and it is not the gap of the contact.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tribox.forms.friction.parameter_checks import refusal

Floats = NDArray[np.float64]


@runtime_checkable
class FilmThickness(Protocol):
    """A film: anything with a thickness that depends on the contact pressure."""

    def at(self, pressure: Floats) -> tuple[Floats, Floats]:
        """Thickness and its derivative for the pressure.

        Args:
            pressure: (q,), Pa, contact pressure t_N >= 0 per reference area.

        Returns:
            D, (q,), m, and dD/dt_N, (q,), m/Pa (at a kink that of the higher pressures).
        """
        ...


@dataclass(frozen=True, slots=True)
class ConstantFilm:
    """The same thickness everywhere.

    Attributes:
        thickness: m, D >= 0.

    Raises:
        ValueError: The thickness is negative or not finite.
    """

    thickness: float

    def __post_init__(self) -> None:
        require_thickness(self.thickness)

    def at(self, pressure: Floats) -> tuple[Floats, Floats]:
        """See ``FilmThickness.at``."""
        return np.full(pressure.shape, float(self.thickness)), np.zeros(pressure.shape)


@dataclass(frozen=True, slots=True)
class FilmTable:
    """A thickness that follows the pressure: linear between the rows, constant outside.

    Attributes:
        rows: (pressure in Pa, D in m), the pressures >= 0 and rising.

    Raises:
        ValueError: There is no row, the pressures do not rise, or a thickness is not allowed.
    """

    rows: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        pressures = [pressure for pressure, _ in self.rows]
        rising = all(b > a for a, b in itertools.pairwise(pressures))
        if not pressures or pressures[0] < 0.0 or not rising or not np.isfinite(pressures).all():
            allowed = "at least one row, with pressures of at least 0 that rise"
            raise refusal("film thickness table", self.rows, allowed)
        require_thickness([thickness for _, thickness in self.rows])

    def at(self, pressure: Floats) -> tuple[Floats, Floats]:
        """See ``FilmThickness.at``."""
        p, D = np.array(self.rows).T
        slopes = np.concatenate([[0.0], np.diff(D) / np.diff(p), [0.0]])
        return np.interp(pressure, p, D), slopes[np.searchsorted(p, pressure, side="right")]


@dataclass(frozen=True, slots=True)
class FilmField:
    """A thickness of its own at each point.

    Attributes:
        thickness: (q,), m, D >= 0, in the order of the contact's points.

    Raises:
        ValueError: A thickness is negative or not finite.
    """

    thickness: Floats

    def __post_init__(self) -> None:
        require_thickness(self.thickness)

    def at(self, pressure: Floats) -> tuple[Floats, Floats]:
        """See ``FilmThickness.at``.

        Raises:
            ValueError: There are not as many thicknesses as pressures.
        """
        if self.thickness.shape != pressure.shape:
            raise ValueError(
                f"film: {self.thickness.size} thicknesses for {pressure.size} contact points"
            )
        return self.thickness.copy(), np.zeros(pressure.shape)


def film_thickness(value: FilmThickness | ArrayLike) -> FilmThickness:
    """A film from a thickness, m, an array of them, or a film.

    Raises:
        ValueError: A thickness is negative or not finite.
    """
    if isinstance(value, FilmThickness):
        return value
    thickness = np.asarray(value, dtype=np.float64)
    return FilmField(thickness) if thickness.ndim else ConstantFilm(float(thickness))


def require_thickness(value: ArrayLike) -> None:
    """Check a film thickness.

    Args:
        value: m, a number or an array.

    Raises:
        ValueError: A thickness is negative or not finite.
    """
    thickness = np.atleast_1d(np.asarray(value, dtype=np.float64))
    bad = thickness[~(np.isfinite(thickness) & (thickness >= 0.0))]
    if bad.size:
        raise ValueError(
            f"film thickness = {bad[0]:g} m is not allowed: expected a finite number of at least 0"
        )
