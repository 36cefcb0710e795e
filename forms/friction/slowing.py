r"""Points that slow down out of the film within a step: where they come to rest.

While the film fraction alpha falls, the asperities take over what the film gives up. Their traction
grows by the slip that is made under them, not by all of the step's:

.. math:: dT^e = (1 - \alpha) K_T\, dg, \qquad dT = dT^e + df = -\kappa\, dg,
   \qquad f = \alpha \frac{\eta_b V}{D} \frac{da}{dA}

if the traction T falls evenly with the slip g, by :math:`\kappa` per length, as it does at a point
of an elastic body that unloads. With the share y = 1 - alpha of the asperities taken to rise from
:math:`y_n` to y in proportion to the fall of f, from :math:`f_c` (at the speed of the last step, or
at V*(1 + w) if that was above) to :math:`f_t`, and then to stay while f falls on to its value at
the end, the slip of the step is

.. math:: |\Delta g_T| = \frac{f_n - f_c}{\kappa}
   + \frac{f_c - f_t}{K_T (y - y_n)} \ln\frac{\kappa + K_T y}{\kappa + K_T y_n}
   + \frac{f_t - f}{\kappa + K_T y}

with :math:`f_n` the film's traction before the step: slip of the film alone, through V*, and of
asperities. It has one solution kappa, which gives :math:`T = T_n - \kappa |\Delta g_T|`.

Without this, backward Euler counts all slip of the step as bending asperities. A step longer than
about :math:`\eta_b/(D K_T)` then has two solutions beside each other, film and asperities at rest
that carry whatever the film did, and the latter is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tribox.forms.friction.film import (
    FilmPoint,
    at_rest,
    film_point,
    film_resistance,
    threshold_speed,
)
from tribox.forms.friction.parameters import FrictionMapParameters

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]

SMALLEST = -600.0  # logarithm of the least (kappa + K_T y_n) over its upper bound
NO_SLIP = 1e-12  # of the slip at the speed before: less counts as that much
NO_COVER = 1e-6  # share of the area, so small that what a film carries there is nothing
CLOSE = 1e-9  # change of a logarithm whose square is below round-off: Newton's method is quadratic
ITERATIONS = 100  # at most, for kappa; about 8 do


@dataclass(frozen=True, slots=True)
class Slowing:
    """Points whose film fraction falls with the speed in a step."""

    points: Longs  # (c,), their indices
    elastic: Floats  # (c,), Pa, the most that their asperities can have taken over, |T^e|
    # (3, c), derivatives of it for the length of the slip (Pa/m), the pressure (-) and the film
    # thickness (Pa/m)
    slopes: Floats
    d_bend: Floats  # (c,), Pa/m, that for the length of the elastic slip

    def take(self, which: NDArray[np.bool_]) -> Slowing:
        """Some of the points, by a mask (c,)."""
        return Slowing(*(getattr(self, name)[..., which] for name in self.__slots__))


@dataclass(frozen=True, slots=True)
class Motion:
    """How points move in a step; each (q,), or a number, or (1,) where that stands for all."""

    length: Floats  # (q,), m, of the slip
    dt: Floats | float  # s
    speed_before: Floats  # (q,), m/s, of the last converged step
    solid_before: Floats  # (q,), 1 - alpha there
    bend: Floats  # (q,), m, length of the elastic slip there
    pressure: Floats  # (q,), Pa
    film: Floats  # m
    area_ratio: Floats | float  # as the law takes them
    cover: Floats | float  # likewise

    def at(self, points: Longs) -> Motion:
        """The same of some points, every entry (c,)."""
        shape = self.length.shape
        values = (getattr(self, name) for name in self.__slots__)
        return Motion(*(np.broadcast_to(value, shape)[points] for value in values))


@dataclass(frozen=True, slots=True)
class _Value:
    """A quantity (c,) with its derivatives (3, c) for length of slip, pressure, film thickness."""

    value: Floats
    slopes: Floats

    def __sub__(self, other: _Value) -> _Value:
        return _Value(self.value - other.value, self.slopes - other.slopes)

    def __mul__(self, other: _Value) -> _Value:
        slopes = self.value * other.slopes + other.value * self.slopes
        return _Value(self.value * other.value, slopes)


def slowing(parameters: FrictionMapParameters, at: FilmPoint, motion: Motion) -> Slowing | None:
    """The points that slow down through V*, None if there are none."""
    speed = motion.length / motion.dt
    slower = (at.solid > motion.solid_before) & (speed < motion.speed_before)
    points = np.flatnonzero(slower & (motion.pressure > 0.0))
    if points.size:
        before = film_point(parameters, motion.film, motion.speed_before).solid
        points = points[at.solid[points] > before[points]]
    if not points.size:
        return None
    here = motion.at(points)
    # Beyond the rim of a contact no film gives anything up, and the asperities take over nothing.
    here = replace(
        here,
        length=np.maximum(here.length, NO_SLIP * here.speed_before * here.dt),
        cover=np.maximum(here.cover, NO_COVER),
    )
    d_slip: Floats | float = 0.0
    if at.d_alpha_d_speed is not None:
        d_slip = np.asarray(at.d_alpha_d_speed[points] / here.dt)
    d_film = np.broadcast_to(at.d_alpha_d_film, at.alpha.shape)[points]
    return _taken_over(parameters, points, here, _varied(at.alpha[points], d_slip, 0.0, d_film))


def _varied(
    value: Floats,
    d_slip: Floats | float = 0.0,
    d_pressure: Floats | float = 0.0,
    d_film: Floats | float = 0.0,
) -> _Value:
    """A quantity (c,) by its derivatives, each (c,) or a number."""
    slopes = np.zeros((3, len(value)))
    slopes[0], slopes[1], slopes[2] = d_slip, d_pressure, d_film
    return _Value(value, slopes)


def _taken_over(
    parameters: FrictionMapParameters, points: Longs, here: Motion, alpha: _Value
) -> Slowing:
    """What the asperities of some points have taken over; ``alpha`` at the end of the step."""
    width = parameters.transition_width
    v_star = threshold_speed(parameters, here.film)
    speed = np.asarray(here.length / here.dt, dtype=np.float64)
    before = here.speed_before
    start = film_point(parameters, here.film, before)
    alpha_n = _varied(start.alpha, d_film=start.d_alpha_d_film)
    rest = at_rest(parameters, here.film)
    alpha_0 = _varied(1.0 - rest.solid, d_film=rest.d_alpha_d_film)
    one = _varied(np.ones(points.size))
    end = alpha * _stress(parameters, here, speed, moving=True)
    f_n = alpha_n * _stress(parameters, here, before)
    # V* goes with D^(−1/2): speeds that follow it change with the film too.
    upper = _stress(parameters, here, v_star * (1.0 + width), follows=True)
    f_c = _where(before > v_star * (1.0 + width), upper, f_n)
    lower = alpha_0 * _stress(parameters, here, v_star * (1.0 - width), follows=True)
    f_t = _where(speed < v_star * (1.0 - width), lower, end)
    bent = (parameters.K_T * here.solid_before) * here.bend
    falls = (f_n - f_c, f_c - f_t, f_t - end)
    elastic = _taken(parameters.K_T, here.length, falls, one - alpha_n, one - alpha)
    return Slowing(
        points=points,
        elastic=np.maximum(bent + elastic.value, 0.0),
        slopes=elastic.slopes,
        d_bend=parameters.K_T * here.solid_before,
    )


def _where(condition: NDArray[np.bool_], yes: _Value, no: _Value) -> _Value:
    return _Value(
        np.where(condition, yes.value, no.value), np.where(condition, yes.slopes, no.slopes)
    )


def _stress(
    parameters: FrictionMapParameters,
    here: Motion,
    speed: Floats,
    *,
    moving: bool = False,
    follows: bool = False,
) -> _Value:
    """Traction of a film that carries all, Pa."""
    length = speed * here.dt
    flow = film_resistance(
        parameters, here.film, length, here.dt, here.pressure, here.area_ratio, here.cover
    )
    per_length: Floats = (
        flow.value if flow.d_length is None else flow.value + flow.d_length * length
    )
    d_film: Floats = flow.d_film * length
    if follows:
        d_film -= per_length * length / (2.0 * here.film)
    d_pressure = 0.0 if flow.d_pressure is None else flow.d_pressure * length
    return _varied(flow.value * length, per_length if moving else 0.0, d_pressure, d_film)


def _taken(
    K_T: float, length: Floats, falls: tuple[_Value, _Value, _Value], y_n: _Value, y: _Value
) -> _Value:
    """Traction that the asperities have taken over, with its derivatives, Pa."""
    alone, through, below = (fall.value for fall in falls)
    low, high = K_T * y_n.value, K_T * y.value
    rise = high - low

    def slip(x: Floats) -> tuple[Floats, Floats]:
        """Slip and its derivative, for x = kappa + K_T y_n."""
        first = np.divide(alone, x, out=np.zeros_like(x), where=alone > 0.0)
        log, last = np.log1p(rise / x) / rise, below / (x + rise)
        past: Floats = x + rise
        slope: Floats = first / x + through / (x * past) + last / past
        return first + through * log + last, -slope

    x = _solved(slip, alone + through + below, length)
    # Implicit derivative of slip(κ) = |Δg_T|. Where the film slipped alone (f_n > f_c) it carried
    # all: y_n = 0, so that x = κ there, and the first term has no derivative for y_n.
    log, slope = np.log1p(rise / x) / rise, slip(x)[1]
    end, dy = x + rise, y.value - y_n.value
    d_y = through * (1.0 / end - log) / dy - below * K_T / end**2
    d_y_n = through * (log - 1.0 / x) / dy
    parts = np.divide(1.0, x, out=np.zeros_like(x), where=alone > 0.0), log, 1.0 / end
    slopes = -(d_y * y.slopes + d_y_n * y_n.slopes)
    for fall, part in zip(falls, parts, strict=True):
        slopes -= part * fall.slopes
    slopes[0] += 1.0
    kappa, d_kappa = x - low, slopes / slope
    # The fall of the film's traction less kappa times the slip, which is the difference of nearly
    # the same numbers where the film alone slipped most.
    value = through * (_one_less_log(rise / x) + low * log) + below * high / end
    slopes = falls[0].slopes + falls[1].slopes + falls[2].slopes - length * d_kappa
    slopes[0] -= kappa
    lost = np.log(x) <= np.log((alone + through + below) / length) + 0.5 * SMALLEST
    whole = alone + through + below - kappa * length
    return _Value(np.where(lost, whole, value), slopes)


def _one_less_log(z: Floats) -> Floats:
    """1 - ln(1 + z)/z for z > 0, whose digits the series keeps where z is small."""
    small = np.minimum(z, 0.02)
    series = sum((-1.0) ** (k + 1) * small**k / (k + 1) for k in range(1, 9))
    return np.where(z < 0.02, series, 1.0 - np.log1p(z) / z)


def _solved(slip: Callable[[Floats], tuple[Floats, Floats]], total: Floats, at: Floats) -> Floats:
    """Where a falling function that is at most ``total``/x comes to ``at``, (c,)."""
    high = np.log(total / at)
    low, x = high + SMALLEST, high.copy()
    for _ in range(ITERATIONS):
        value, slope = slip(np.exp(x))
        above = value > at
        low, high = np.where(above, x, low), np.where(above, high, x)
        # Newton's method for ln(slip) over ln x, of slope −1 where x is large; elsewhere bisection.
        newton = x - np.log(value / at) * value / (slope * np.exp(x))
        inside = (newton > low - CLOSE) & (newton < high + CLOSE)
        new = np.where(inside, newton, 0.5 * (low + high))
        near, x = np.abs(new - x) <= CLOSE, new
        if near.all():
            break
    return np.exp(x)
