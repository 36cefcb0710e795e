r"""Flow of the film: Newtonian, with the limits of a thin film under high shear and pressure.

Stress of the film per current area over shear rate :math:`\dot\gamma = V/D` and pressure p:

.. math::
   \eta_0 = \eta_b e^{a p}, \qquad
   \eta_N = \eta_\infty + (\eta_0 - \eta_\infty)
   \left[1 + (\dot\gamma/\dot\gamma_c)^2\right]^{(n - 1)/2}

   \tau = \tau_L \left(1 - e^{-\eta_N \dot\gamma/\tau_L}\right), \qquad
   \tau_L = \tau_0 + \zeta p

after Barus (Am. J. Sci. 45, 1893), Carreau (Trans. Soc. Rheol. 16, 1972) and Bair & Winer
(J. Lubr. Technol. 101, 1979). Each of the three is off by default; without any
:math:`\tau = \eta_b \dot\gamma`. The stress never falls with the shear rate (n >= 0), and
:math:`\tau \dot\gamma \ge 0`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from tribox.forms.parameters import Declared, Refused, parameter

Floats = NDArray[np.float64]

# Up to here (1 - exp(-x))/x is taken from its series: its derivative loses digits otherwise.
_SERIES_UP_TO = 0.02


@dataclass(frozen=True, slots=True)
class Viscosity:
    r"""Viscosity :math:`\tau/\dot\gamma` of the film at q points, with its derivatives."""

    value: Floats  # (q,), Pa s
    d_rate: Floats  # (q,), Pa s^2, for the shear rate
    d_pressure: Floats  # (q,), s, for the pressure


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmRheology(Declared):
    """Flow of the film: its viscosity, and what a thin film makes of it. SI units.

    Raises:
        Refused: A value is not allowed; the message names field, value and what is allowed.
    """

    eta_b: float = parameter("viscosity of the oil in bulk", "Pa*s", ge=0.0)
    tau_0: float | None = parameter(
        "limiting shear stress of the film at no pressure; default: none",
        "Pa",
        ge=0.0,
        default=None,
    )
    zeta: float = parameter(
        "growth of the limiting shear stress with the pressure", ge=0.0, default=0.0
    )
    critical_rate: float | None = parameter(
        "shear rate from which the film thins (Carreau); default: never",
        "1/s",
        gt=0.0,
        default=None,
    )
    thinning_exponent: float | None = parameter(
        "exponent n of the thinning, needed with critical_rate (1: Newtonian, 0: solid-like)",
        ge=0.0,
        le=1.0,
        default=None,
    )
    eta_inf: float = parameter(
        "viscosity of the film at infinite shear rate, at most eta_b", "Pa*s", ge=0.0, default=0.0
    )
    barus: float = parameter("coefficient a of eta_b exp(a p) (Barus)", "1/Pa", ge=0.0, default=0.0)

    def faults(self) -> Iterator[Refused]:
        """Values that do not fit together."""
        if self.tau_0 == 0.0 and self.zeta == 0.0:
            yield Refused("tau_0", "must be > 0 Pa, or zeta > 0", self.tau_0)
        if self.tau_0 is None and self.zeta > 0.0:
            yield Refused("zeta", "must be 0 without tau_0", self.zeta)
        if self.critical_rate is None:
            if self.thinning_exponent is not None:
                reason = "goes with critical_rate only"
                yield Refused("thinning_exponent", reason, self.thinning_exponent)
            if self.eta_inf > 0.0:
                yield Refused("eta_inf", "must be 0 without critical_rate", self.eta_inf)
        elif self.thinning_exponent is None:
            yield Refused("thinning_exponent", "missing; a number in [0, 1] with critical_rate")
        elif self.eta_inf > self.eta_b:
            reason = f"must be <= eta_b = {self.eta_b:g} Pa*s"
            yield Refused("eta_inf", reason, self.eta_inf)

    @property
    def newtonian(self) -> bool:
        """Whether the viscosity is eta_b at every shear rate and pressure."""
        unlimited = self.tau_0 is None and self.critical_rate is None
        return unlimited and self.barus == 0.0

    @property
    def feels_pressure(self) -> bool:
        """Whether the viscosity changes with the pressure."""
        return self.barus > 0.0 or self.zeta > 0.0

    def viscosity(self, rate: Floats, pressure: Floats) -> Viscosity:
        r""":math:`\tau/\dot\gamma` at shear rates V/D (q,), 1/s, and pressures (q,), Pa."""
        unlimited = self._unlimited(rate, pressure)
        return unlimited if self.tau_0 is None else self._limited(unlimited, rate, pressure)

    def _unlimited(self, rate: Floats, pressure: Floats) -> Viscosity:
        """Barus and Carreau."""
        base = self.eta_b * np.exp(self.barus * pressure)
        d_base = self.barus * base
        if self.critical_rate is None or self.thinning_exponent is None:
            return Viscosity(base, np.zeros_like(base), d_base)
        relative = rate / self.critical_rate
        inside, power = 1.0 + relative**2, 0.5 * (self.thinning_exponent - 1.0)
        share = inside**power
        excess = base - self.eta_inf
        slope = 2.0 * power * excess * (share / inside) * relative / self.critical_rate
        return Viscosity(self.eta_inf + excess * share, slope, d_base * share)

    def _limited(self, flow: Viscosity, rate: Floats, pressure: Floats) -> Viscosity:
        """The limiting shear stress over a flow without one."""
        assert self.tau_0 is not None
        limit = self.tau_0 + self.zeta * pressure
        limit = np.where(limit > 0.0, limit, 1.0)  # zero at open points only
        # τ = τ_L (1 − e^(−x)), x = η_N γ̇/τ_L, so that τ/γ̇ = η_N (1 − e^(−x))/x, which has a limit
        # at rest.
        x = flow.value * rate / limit
        share, slope = _saturation(x)
        d_x_d_rate = (flow.value + rate * flow.d_rate) / limit
        d_x_d_pressure = (rate * flow.d_pressure - self.zeta * x) / limit
        weight = flow.value * slope
        return Viscosity(
            flow.value * share,
            share * flow.d_rate + weight * d_x_d_rate,
            share * flow.d_pressure + weight * d_x_d_pressure,
        )


def _saturation(x: Floats) -> tuple[Floats, Floats]:
    """(1 - exp(-x))/x for x >= 0, and its derivative."""
    small = x < _SERIES_UP_TO
    safe = np.where(small, 1.0, x)
    gone = np.exp(-safe)
    near = np.minimum(x, _SERIES_UP_TO)
    share = np.where(small, polyval(near, _SHARE), -np.expm1(-safe) / safe)
    slope = np.where(small, polyval(near, _SLOPE), (gone * (1.0 + safe) - 1.0) / safe**2)
    return share, slope


# Taylor coefficients of (1 - exp(-x))/x, and of its derivative.
_SHARE = (1.0, -1 / 2, 1 / 6, -1 / 24, 1 / 120, -1 / 720, 1 / 5040, -1 / 40320)
_SLOPE = tuple(k * c for k, c in enumerate(_SHARE))[1:]
