"""Film thickness D of a contact: a number, a table over the pressure, or a field of points.

D is an input of the friction law; it does not evolve, and it is not the gap of the contact.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tribox.forms.friction.parameters import FrictionMapParameters, Table
from tribox.forms.parameters import Refused

Floats = NDArray[np.float64]


@runtime_checkable
class FilmThickness(Protocol):
    """A film: anything with a thickness that depends on the contact pressure."""

    def at(self, pressure: Floats) -> tuple[Floats, Floats]:
        """Thickness D (q,), m, and dD/dt_N (q,), m/Pa, at t_N (q,) >= 0, Pa per reference area.

        At a kink the derivative is that of the higher pressures.
        """
        ...


@dataclass(frozen=True, slots=True)
class ConstantFilm(FilmThickness):
    """The same thickness D ≥ 0, m, everywhere; ValueError if it is negative or not finite."""

    thickness: float

    def __post_init__(self) -> None:
        require_thickness(self.thickness)

    def at(self, pressure: Floats) -> tuple[Floats, Floats]:
        return np.full(pressure.shape, float(self.thickness)), np.zeros(pressure.shape)


@dataclass(frozen=True, slots=True)
class FilmTable(FilmThickness):
    """A thickness that follows the pressure: linear between (Pa, m) rows, constant outside.

    ValueError if there is no row, pressures do not rise, or a thickness is not allowed.
    """

    rows: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        pressures = [pressure for pressure, _ in self.rows]
        rising = all(b > a for a, b in itertools.pairwise(pressures))
        if not pressures or pressures[0] < 0.0 or not rising or not np.isfinite(pressures).all():
            reason = "must have at least one row, with pressures of at least 0 that rise"
            raise Refused("film thickness table", reason, self.rows)
        require_thickness([thickness for _, thickness in self.rows])

    def at(self, pressure: Floats) -> tuple[Floats, Floats]:
        rows = np.array(self.rows)
        return np.interp(pressure, *rows.T), _slope(pressure, rows)


@dataclass(frozen=True, slots=True)
class FilmField:
    """A thickness (q,), m, D >= 0, of its own at each point; ValueError if one is not finite."""

    thickness: Floats

    def __post_init__(self) -> None:
        require_thickness(self.thickness)

    def at(self, pressure: Floats) -> tuple[Floats, Floats]:
        """See ``FilmThickness.at``; ValueError if there are not as many as pressures."""
        if self.thickness.shape != pressure.shape:
            raise ValueError(
                f"film: {self.thickness.size} thicknesses for {pressure.size} contact points"
            )
        return self.thickness.copy(), np.zeros(pressure.shape)


def film_thickness(value: FilmThickness | ArrayLike) -> FilmThickness:
    """A film from a thickness, m, an array of them, or a film; a ValueError as its class raises."""
    if isinstance(value, FilmThickness):
        return value
    thickness = np.asarray(value, dtype=np.float64)
    return FilmField(thickness) if thickness.ndim else ConstantFilm(float(thickness))


def require_thickness(value: ArrayLike) -> None:
    """Raise a ValueError for a thickness, m, or one of an array, that is negative or not finite."""
    thickness = np.atleast_1d(np.asarray(value, dtype=np.float64))
    bad = thickness[~(np.isfinite(thickness) & (thickness >= 0.0))]
    if bad.size:
        raise ValueError(
            f"film thickness = {bad[0]:g} m is not allowed: expected a finite number of at least 0"
        )


# -- The friction map: what the film carries, over film thickness D and slip speed V ---------------
#
# .. math::
#    \alpha_0(D) = \min\left\{\left(\frac{\langle D - D_{min}\rangle_+}{D_{max} - D_{min}}
#    \right)^\beta, 1\right\}, \qquad V^*(D) = \sqrt{\gamma D_{max}/(\eta_b D)}
#
# (Luege & Luccioni), alpha = alpha_0 below the threshold speed V* and 1 above it. Here the change
# from one to the other may have a relative width w:
#
# .. math::
#    1 - \alpha = (1 - \alpha_0)\, y^2 (3 - 2 y), \qquad
#    y = \min\{\max\{(1 + w - V/V^*)/(2 w), 0\}, 1\}
#
# so that alpha is continuously differentiable in V for w > 0. Where D <= D_min there is no film:
# alpha = 0 at every speed; where D >= D_max there is only film: alpha = 1 at every speed.
#
# The film resists a slip increment by its stress per length of slip. With :math:`\hat\eta` the
# viscosity at the shear rate :math:`|\Delta g_T|/(D \Delta t)`:
#
# .. math:: f = \min\{t_N/p_{on}, 1\}\, \frac{\hat\eta}{D \Delta t} \frac{da}{dA}, \qquad
# T_{film} = \alpha f \Delta g_T
#
# The film's pressure is per current area, :math:`t_N/(da/dA)`.
#


@dataclass(frozen=True, slots=True)
class AtRest:
    """The film below the threshold speed."""

    solid: Floats  # (q,), 1 - alpha_0
    d_alpha_d_film: Floats  # (q,), 1/m, derivative of alpha_0 for the film thickness


@dataclass(frozen=True, slots=True)
class FilmPoint:
    """The film fraction at points of the map."""

    alpha: Floats  # (q,), film fraction
    solid: Floats  # (q,), 1 - alpha, exactly
    d_alpha_d_speed: Floats | None  # (q,), s/m, or None where it is zero at all points
    d_alpha_d_film: Floats  # (q,), 1/m


def at_rest(parameters: FrictionMapParameters, film: Floats) -> AtRest:
    """Film fraction below the threshold speed, for film thicknesses D, (q,), m."""
    lowest, highest = parameters.D_min, parameters.D_max
    inside = (film > lowest) & (film < highest)
    # Any thickness of the open interval stands in for the others, whose alpha is 0 or 1.
    safe = np.where(inside, film, 0.5 * (lowest + highest))
    if parameters.beta is not None:
        beta, slope = _exponent(parameters.beta, safe)
        x = (safe - lowest) / (highest - lowest)
        logarithm = np.log(x)
        # Not 1 - x^beta: that loses all digits for the small exponents of the paper.
        solid = -np.expm1(beta * logarithm)
        rate = (1.0 - solid) * (beta / (safe - lowest) + slope * logarithm)
    else:
        assert parameters.alpha is not None
        value = parameters.alpha
        if isinstance(value, tuple):  # From dry at D_min on, and up to all film at D_max.
            rows = (row for row in value if lowest < row[0] < highest)
            value = ((lowest, 0.0), *rows, (highest, 1.0))
        alpha, rate = _linear(value, safe)
        solid = 1.0 - alpha
    outside = np.where(film >= highest, 0.0, 1.0)
    return AtRest(np.where(inside, solid, outside), np.where(inside, rate, 0.0))


def threshold_speed(parameters: FrictionMapParameters, film: Floats) -> Floats:
    """V*(D), (q,), m/s, for film thicknesses D, (q,), m; infinite where D <= D_min."""
    wet = film > parameters.D_min
    speed = np.sqrt(parameters.threshold_constant / np.where(wet, film, 1.0))
    return np.where(wet, speed, np.inf)


@lru_cache
def _of_one_film(parameters: FrictionMapParameters, film: float) -> tuple[AtRest, Floats]:
    """:func:`at_rest` and :func:`threshold_speed` of a thickness, m, (1,): most films keep one."""
    thickness = np.array([film])
    return at_rest(parameters, thickness), threshold_speed(parameters, thickness)


def film_point(parameters: FrictionMapParameters, film: Floats, speed: Floats) -> FilmPoint:
    """Film fraction and derivatives, of films (q,) or (1,), m, and slip speeds (q,), m/s."""
    if film.size == 1:
        rest, v_star = _of_one_film(parameters, float(film[0]))
    else:
        rest, v_star = at_rest(parameters, film), threshold_speed(parameters, film)
    width = parameters.transition_width
    ratio = speed / v_star
    if width == 0.0:
        solid = np.where(ratio >= 1.0, 0.0, rest.solid)
        d_speed, d_film = None, np.where(ratio >= 1.0, 0.0, rest.d_alpha_d_film)
    else:
        y = np.clip((1.0 + width - ratio) / (2.0 * width), 0.0, 1.0)
        share = y * y * (3.0 - 2.0 * y)
        solid = rest.solid * share
        # ∂α/∂(V/V*), and V/V* grows as √D.
        slope = rest.solid * (3.0 / width) * y * (1.0 - y)
        d_film = rest.d_alpha_d_film * share
        d_speed = None
        if slope.any():
            d_speed = slope / v_star
            d_film = d_film + 0.5 * slope * ratio / np.where(film > 0.0, film, 1.0)
    alpha = 1.0 - solid
    # The state keeps alpha: with 1 - alpha taken from it (exactly, as alpha >= 1/2 or the loss is
    # below its own round-off) a constant film fraction is constant to the last bit.
    return FilmPoint(alpha, 1.0 - alpha, d_speed, d_film)


@dataclass(frozen=True, slots=True)
class FilmResistance:
    """Resistance f at q points, with its derivatives; all zero where the contact is open."""

    value: Floats  # (q,), Pa/m
    # (q,), Pa/m^2, for the length of the slip; None where the film is Newtonian
    d_length: Floats | None
    # (q,), 1/m, for the pressure t_N; None where it is zero at all points
    d_pressure: Floats | None
    d_film: Floats  # (q,), Pa/m^2, for the film thickness


def film_resistance(
    parameters: FrictionMapParameters,
    film: Floats,
    length: Floats,
    dt: Floats | float,
    pressure: Floats,
    area_ratio: Floats | float,
    cover: Floats | float = 1.0,
) -> FilmResistance:
    """Resistance of a film (q,) or (1,), m, for alpha = 1.

    ``length``: (q,), m, of the slip increment; ``dt``: (q,) or a number, s, > 0, infinite: no film;
    ``pressure``: (q,), Pa, t_N; ``area_ratio``: da/dA, ``cover``: share with film; (q,) or numbers.
    """
    area = np.asarray(area_ratio, dtype=np.float64)
    closed = pressure > 0.0
    wet = film > parameters.D_min
    thickness = np.where(wet, film, 1.0)
    onset = parameters.film_onset_pressure
    scale = np.where(wet, 1.0 / (thickness * dt), 0.0) * area * cover
    scale = np.where(closed, scale, 0.0)
    if onset > 0.0:
        scale *= np.minimum(pressure / onset, 1.0)
    d_length: Floats | None = None
    d_pressure: Floats | None = None
    if parameters.newtonian:
        value = parameters.eta_b * scale
        d_film = -value / thickness
    else:
        rate = length / (thickness * dt)
        eta = parameters.viscosity(rate, np.asarray(pressure / area))
        value = eta.value * scale
        d_length = scale * eta.d_rate / (thickness * dt)
        # A thicker film is sheared at a lower rate: ∂γ̇/∂D = −γ̇/D.
        d_film = -(value + scale * eta.d_rate * rate) / thickness
        d_pressure = scale * eta.d_pressure / area
    forming = closed & (pressure < onset)
    if forming.any():
        # In proportion to t_N below the onset.
        growth = np.where(forming, value / np.where(forming, pressure, 1.0), 0.0)
        d_pressure = growth if d_pressure is None else d_pressure + growth
    return FilmResistance(value, d_length, d_pressure, d_film)


def _linear(value: float | Table, film: Floats) -> tuple[Floats, Floats]:
    """A number or table over the film thickness, and its derivative (one-sided at its rows)."""
    if not isinstance(value, tuple):
        return np.full_like(film, value), np.zeros_like(film)
    rows = np.array(value)
    return np.interp(film, rows[:, 0], rows[:, 1]), _slope(film, rows)


def _exponent(value: float | Table, film: Floats) -> tuple[Floats, Floats]:
    """Exponent beta and its derivative: a table is linear in both logarithms."""
    if not isinstance(value, tuple):
        return np.full_like(film, value), np.zeros_like(film)
    rows = np.log(np.array(value))
    logarithm = np.log(film)
    beta = np.exp(np.interp(logarithm, rows[:, 0], rows[:, 1]))
    return beta, beta * _slope(logarithm, rows) / film


def _slope(x: Floats, rows: Floats) -> Floats:
    """Slope of the piecewise linear curve through rows (r, 2), constant outside, right-sided."""
    rise: Floats = np.diff(rows, axis=0)
    slopes: Floats = np.zeros(len(rows) + 1)
    slopes[1:-1] = rise[:, 1] / rise[:, 0]
    return slopes[np.searchsorted(rows[:, 0], x, side="right")]
