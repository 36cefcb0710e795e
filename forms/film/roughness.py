r"""Two rough surfaces at a mean gap: the film between them, what their asperities carry, the flow.

The gap g is that of the mean planes; :math:`\sigma` is the rms roughness of both together. For
heights with a normal distribution the mean film (N. Patir, H. Cheng, J. Lubr. Technol. 100, 1978)
is

.. math:: h_T = g\,\Phi(g/\sigma) + \sigma\,\varphi(g/\sigma) + 10^{-3}\,\sigma

with its distribution function and density; the last term keeps a path open where the surfaces are
squeezed flat. Axis letter: n places.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import ndtr

from tribox.forms.parameters import Refused, require
from tribox.geometry.surfaces.facets import Floats

LEAST_FILM = 1e-3  # of the roughness: film between surfaces that are squeezed flat
_TAIL = -6.0  # g/σ below which g Φ + σ φ loses its digits

# Constants of the pressure flow factor by γ (Patir & Cheng 1978): φ = 1 − C exp(−r H) up to γ = 1
# and 1 + C H^(−r) above, and the least H = h/σ that they were fitted to.
_FLOW: dict[float, tuple[float, float]] = {
    1 / 9: (1.48, 0.42),
    1 / 6: (1.38, 0.42),
    1 / 3: (1.18, 0.42),
    1.0: (0.90, 0.56),
    3.0: (0.225, 1.5),
    6.0: (0.520, 1.5),
    9.0: (0.870, 1.5),
}
_LEAST_FLOW = 0.01  # of a smooth film's, where the fit for γ < 1 would fall below it
_LEAST_RATIO = 0.5  # h/σ below which the fit for γ > 1 is not continued


class Asperities(Protocol):
    """What the asperities carry at a gap of the mean planes."""

    def pressure(self, gap: Floats) -> tuple[Floats, Floats]:
        """Pressure p_a (n,), Pa, and dp_a/dg (n,), Pa/m, at gaps (n,), m."""
        ...

    def energy(self, gap: Floats) -> Floats:
        """What closing the gap to ``gap`` (n,), m, has stored (n,), J/m²."""
        ...


@dataclass(frozen=True, slots=True)
class Exponential(Asperities):
    """p_a = p_0 exp(−g/u_0), linear with the same slope below g = 0 (B. Persson's)."""

    reference: float  # p_0 = c E*, Pa
    length: float  # u_0, m

    def __post_init__(self) -> None:
        require("reference pressure", self.reference, gt=0.0)
        require("u_0", self.length, gt=0.0)

    def pressure(self, gap: Floats) -> tuple[Floats, Floats]:
        z = gap / self.length
        decayed = self.reference * np.exp(-np.maximum(z, 0.0))
        inside = z < 0.0
        value = np.where(inside, self.reference * (1.0 - z), decayed)
        return value, np.where(inside, -self.reference, -decayed) / self.length

    def energy(self, gap: Floats) -> Floats:
        z, scale = gap / self.length, self.reference * self.length
        below = np.minimum(z, 0.0)
        return scale * (np.exp(-np.maximum(z, 0.0)) - below + 0.5 * below**2)


@dataclass(frozen=True, slots=True)
class GreenwoodTripp(Asperities):
    r"""p_a = K' E* 4.4086e-5 (4 − g/σ)^6.804 up to g = 4 σ, linear below g = 0.

    J. Greenwood, J. Tripp, Proc. Inst. Mech. Eng. 185, 1970, with the fit of F_5/2 by Y. Hu et al.,
    Int. J. Mech. Sci. 36, 1994.
    """

    reference: float  # K' E*, Pa, with K' = 16 √2/15 π (σ β n)² √(σ/β)
    sigma: float  # σ, m

    def __post_init__(self) -> None:
        require("reference pressure", self.reference, gt=0.0)
        require("sigma", self.sigma, gt=0.0)

    def pressure(self, gap: Floats) -> tuple[Floats, Floats]:
        z = gap / self.sigma
        scale, power = 4.4086e-5 * self.reference, 6.804
        depth = np.maximum(4.0 - np.maximum(z, 0.0), 0.0)
        value = scale * depth**power
        slope = scale * power * depth ** (power - 1.0)
        return value - slope * np.minimum(z, 0.0), -slope / self.sigma

    def energy(self, gap: Floats) -> Floats:
        z, (at_zero, slope) = gap / self.sigma, self.pressure(np.zeros(1))
        depth, below = np.maximum(4.0 - np.maximum(z, 0.0), 0.0), np.minimum(gap, 0.0)
        # ∫ (4 − z)^6.804 dz from z to 4, and below 0 that of the straight line.
        far = self.sigma * 4.4086e-5 * self.reference * depth**7.804 / 7.804
        return far - at_zero * below - 0.5 * slope * below**2


@dataclass(frozen=True, slots=True)
class AsperityTable(Asperities):
    """A measured or computed pressure over g/σ: linear between rows, 0 above the last.

    Below the first row it goes on with the slope of the first two.
    """

    # (g/σ, Pa): separations that rise, pressures that fall to 0
    rows: tuple[tuple[float, float], ...]
    sigma: float  # σ, m

    def __post_init__(self) -> None:
        require("sigma", self.sigma, gt=0.0)
        table = np.array(self.rows, dtype=np.float64).reshape(-1, 2)
        falls = len(table) > 1 and bool(np.all(np.diff(table[:, 1]) < 0.0))
        rises = bool(np.all(np.diff(table[:, 0]) > 0.0))
        if not (falls and rises and np.isfinite(table).all() and table[-1, 1] == 0.0):
            reason = "must have two rows or more, g/sigma rising and the pressure falling to 0"
            raise Refused("asperity table", reason, self.rows)

    def pressure(self, gap: Floats) -> tuple[Floats, Floats]:
        z, p = np.array(self.rows).T
        slopes = np.append(np.diff(p) / np.diff(z), 0.0)
        at = gap / self.sigma
        piece = np.clip(np.searchsorted(z, at, side="right") - 1, 0, len(z) - 1)
        return p[piece] + slopes[piece] * (at - z[piece]), slopes[piece] / self.sigma

    def energy(self, gap: Floats) -> Floats:
        z, p = np.array(self.rows).T
        parts = 0.5 * (p[1:] + p[:-1]) * np.diff(z)
        # From each row to the last: trapezia are exact for straight lines.
        beyond = np.append(np.cumsum(parts[::-1])[::-1], 0.0)
        at = gap / self.sigma
        piece = np.clip(np.searchsorted(z, at, side="right") - 1, 0, len(z) - 1)
        mean = 0.5 * (p[piece] + self.pressure(gap)[0])
        return self.sigma * (beyond[piece] - mean * (at - z[piece]))


@dataclass(frozen=True, slots=True)
class NoAsperities(Asperities):
    """Smooth surfaces: the film carries all."""

    def pressure(self, gap: Floats) -> tuple[Floats, Floats]:
        return np.zeros_like(gap), np.zeros_like(gap)

    def energy(self, gap: Floats) -> Floats:
        return np.zeros_like(gap)


@dataclass(frozen=True, slots=True)
class RoughGap:
    """The film between two rough surfaces, and how roughness hinders its flow."""

    sigma: float  # σ, m, rms roughness of both surfaces together; 0: smooth
    # γ, ratio of the roughness's lengths along and across the flow (1: isotropic); None: no flow
    # factor
    gamma: float | None = 1.0

    def __post_init__(self) -> None:
        require("sigma", self.sigma, ge=0.0)
        if self.gamma is not None and self._constants() is None:
            raise Refused("gamma", "must be one of 1/9, 1/6, 1/3, 1, 3, 6, 9", self.gamma)

    def _constants(self) -> tuple[float, float] | None:
        gamma = self.gamma or 1.0
        near = [c for g, c in _FLOW.items() if abs(g / gamma - 1.0) < 0.01]
        return near[0] if near else None

    def film(self, gap: Floats) -> tuple[Floats, Floats]:
        """Mean film h_T (n,), m, and dh_T/dg (n,), at gaps (n,), m, of either sign."""
        if self.sigma == 0.0:
            return gap.copy(), np.ones_like(gap)
        z = gap / self.sigma
        share, density = ndtr(z), np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
        thickness = z * share + density
        below = z < _TAIL
        if below.any():
            # z Φ + φ cancels there: the asymptotic series, φ/z² (1 − 3/z² + 15/z⁴).
            low = z[below] ** -2
            thickness[below] = density[below] * low * (1.0 - 3.0 * low + 15.0 * low**2)
        return self.sigma * (thickness + LEAST_FILM), share

    def flow(self, film: Floats) -> tuple[Floats, Floats]:
        """Pressure flow factor φ (n,) of films (n,), m, and dφ/dh (n,), 1/m."""
        constants = self._constants()
        if self.sigma == 0.0 or self.gamma is None or constants is None:
            return np.ones_like(film), np.zeros_like(film)
        c, r = constants
        ratio = film / self.sigma
        if self.gamma < 1.01:
            gone = c * np.exp(-r * ratio)
            low = 1.0 - gone < _LEAST_FLOW
            slope = np.where(low, 0.0, r * gone)
            return np.where(low, _LEAST_FLOW, 1.0 - gone), slope / self.sigma
        low, ratio = ratio < _LEAST_RATIO, np.maximum(ratio, _LEAST_RATIO)
        more = c * ratio**-r
        return 1.0 + more, np.where(low, 0.0, -r * more / ratio) / self.sigma
