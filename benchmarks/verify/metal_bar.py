r"""A bar of metal drawn or pressed without friction: stretch and force at a plastic strain.

With Hencky's elasticity the logarithmic strain is :math:`\ln\lambda = \pm(\tau/E + \alpha)`,
where the Kirchhoff stress :math:`\tau = J\sigma` is the yield stress :math:`\sigma_Y(\alpha)`, and
the force over the area before is :math:`\tau/\lambda`; no strain needs to be small, and the elastic
change of volume is in it. The force of a drawn bar is largest where
:math:`\sigma_Y' = \sigma_Y (1 + \sigma_Y'/E)`: Considère's condition (Ann. Ponts et
Chaussées 9 (1885) 574) of a metal that is also elastic.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Law = Callable[[Floats], Floats]
HALVINGS = 60  # of an interval of strain: beyond the 53 bits of its ends


class Hardening(Protocol):
    """A yield stress, not falling, as a function of the equivalent plastic strain α."""

    def stress(self, alpha: Floats) -> Floats:
        """σ_Y(α), Pa."""
        ...

    def slope(self, alpha: Floats) -> Floats:
        """dσ_Y/dα, Pa."""
        ...


def stretch_and_stress(
    alpha: Floats, young: float, hardening: Hardening, pressed: bool = False
) -> tuple[Floats, Floats]:
    """Stretch λ and force over the area before, Pa, of a bar that flows.

    Args:
        alpha: (n,), equivalent plastic strain.
        young: E, Pa.
        hardening: yield stress over it.
        pressed: whether the bar is pressed; its force is negative then.
    """
    tau, sign = hardening.stress(alpha), -1.0 if pressed else 1.0
    stretch = np.exp(sign * (tau / young + alpha))
    return stretch, sign * tau / stretch


def stress_at(stretch: Floats, young: float, hardening: Hardening, pressed: bool = False) -> Floats:
    """Force over the area before, Pa, at a stretch (n,), elastic ones among them."""
    tau = _flowing(np.abs(np.log(stretch)), young, hardening.stress)
    out: Floats = (-tau if pressed else tau) / stretch
    return out


def _flowing(strain: Floats, modulus: float, yield_stress: Law) -> Floats:
    """Stress, Pa, at total strains ε = σ/modulus + α, elastic ones among them."""
    low, high = np.zeros_like(strain), strain.copy()
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = middle + yield_stress(middle) / modulus > strain
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.minimum(modulus * strain, yield_stress(low))


def load_maximum(young: float, hardening: Hardening) -> tuple[float, float]:
    """Stretch and force over the area before, Pa, where a drawn bar bears most.

    Args:
        young: E, Pa.
        hardening: of a slope that does not rise, so that there is one maximum.

    Raises:
        ValueError: the bar bears most where it begins to flow, or goes on bearing more.
    """

    def rises(alpha: float) -> bool:
        at = np.array([alpha])
        stress, slope = float(hardening.stress(at)[0]), float(hardening.slope(at)[0])
        return slope > stress * (1.0 + slope / young)

    low, high = 0.0, 20.0
    if not rises(low) or rises(high):
        raise ValueError("the force has no maximum after the bar has begun to flow")
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if rises(middle) else (low, middle)
    stretch, stress = stretch_and_stress(np.array([low]), young, hardening)
    assert math.isfinite(stress[0])
    return float(stretch[0]), float(stress[0])


# -- Thick tube of an incompressible metal under inner pressure, in plane strain, at any expansion -
#
# All of it follows from r² − R² = a² − A²: the equivalent strain is :math:`2/\sqrt3\,\ln(r/R)`
# with a direction that does not change, so that the yield stress over the whole strain gives the
# stresses, and equilibrium the pressure :math:`p = \int 2/\sqrt3\,\bar\sigma\,dr/r` (R. Hill, *The
# mathematical theory of plasticity*, 1950, ch. V, there for small strain and for the rigid,
# ideally plastic tube).


_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(16)
PIECES = 64  # of the wall: the strain at first yield is a kink somewhere within it


def flow_curve(strain: Floats, shear_modulus: float, yield_stress: Law) -> Floats:
    """Equivalent stress, Pa, at an equivalent strain, elastic and plastic part together.

    Args:
        strain: total equivalent strain ε = σ/3G + α, not negative.
        shear_modulus: G, Pa.
        yield_stress: σ_Y(α), Pa, not falling.
    """
    return _flowing(np.asarray(strain, dtype=np.float64), 3.0 * shear_modulus, yield_stress)


def inner_pressure(
    displacement: float, inner: float, outer: float, shear_modulus: float, yield_stress: Law
) -> float:
    """Pressure on the present inner surface, Pa.

    Args:
        displacement: m, of the inner surface, outwards.
        inner: m, A, its radius before.
        outer: m, B, radius of the outer surface before, free of stress.
        shear_modulus: G, Pa.
        yield_stress: σ_Y(α), Pa, not falling.
    """
    growth = (inner + displacement) ** 2 - inner**2
    edges = np.linspace(inner, outer, PIECES + 1)
    half = 0.5 * np.diff(edges)[:, None]
    R = edges[:-1, None] + half * (1.0 + _POINTS)
    r = np.sqrt(R**2 + growth)
    stress = flow_curve(2.0 / np.sqrt(3.0) * np.log(r / R), shear_modulus, yield_stress)
    return float(np.sum(half * _WEIGHTS * 2.0 / np.sqrt(3.0) * stress * R / r**2))


# -- Springback of a wide strip bent by a moment alone, by integration over its fibres -------------
#
# Sections stay plane, the strip stays in plane strain and thin against its radius: a fibre at a
# distance y of the middle has the strain κy along the strip, none across it, and no stress through
# the thickness. The stresses of each fibre, along the strip and across it, follow from Prandtl's
# and Reuss' equations by backward Euler steps in the plane of these two (Simo & Taylor, Int. J.
# Numer. Methods Engng 22 (1986) 649), and the moment is :math:`\int \sigma y\,dy`. What is left
# out is of the order (t/R)².


@dataclass(frozen=True, slots=True)
class Strip:
    """A strip and how it is integrated."""

    thickness: float  # m
    young: float  # E, Pa
    poisson: float  # ν
    yield_stress: Law  # σ_Y(α), Pa, not falling
    fibres: int = 200  # of half the thickness; the other half is its mirror image
    steps: int = 100  # of the curvature

    def bent(self, curvature: float) -> tuple[float, float]:
        """Moment of a strip that is bent, and the curvature that is left of it.

        Args:
            curvature: 1/m, κ, to which it is bent.

        Returns:
            N m/m, moment per width at κ; 1/m, curvature without moment.
        """
        half = 0.5 * self.thickness
        points, weights = np.polynomial.legendre.leggauss(self.fibres)
        y, weight = 0.5 * half * (1.0 + points), half * weights  # of both halves
        stress: Floats = np.zeros((2, len(y)))
        alpha: Floats = np.zeros(len(y))
        for _ in range(self.steps):
            stress, alpha = self._stepped(stress, alpha, curvature / self.steps * y)
        moment = float(weight @ (stress[0] * y))
        # Back, as far as an elastic strip would; then by secants, lest some of it flows.
        stiffness = self.young * self.thickness**3 / (12.0 * (1.0 - self.poisson**2))
        back = moment / stiffness
        for _ in range(20):
            left = float(weight @ (self._stepped(stress, alpha, -back * y)[0][0] * y))
            back += left / stiffness
        return moment, curvature - back

    def _stepped(self, stress: Floats, alpha: Floats, strain: Floats) -> tuple[Floats, Floats]:
        """Stresses (2, n), Pa, along and across, and α (n,), after strains (n,) along the strip."""
        E, nu = self.young, self.poisson
        along = E / (1.0 - nu**2) * strain
        trial = stress + np.stack([along, nu * along])
        # Sum and difference of both over √2 are independent of each other.
        parts = np.stack([trial[0] + trial[1], trial[1] - trial[0]]) / np.sqrt(2.0)
        rates = np.array([E / (3.0 * (1.0 - nu)), E / (1.0 + nu)])[:, None]

        def returned(gamma: Floats) -> tuple[Floats, Floats, Floats]:
            now = parts / (1.0 + rates * gamma)
            equivalent = np.sqrt(0.5 * now[0] ** 2 + 1.5 * now[1] ** 2)
            return now, equivalent, alpha + 2.0 / 3.0 * gamma * equivalent

        low, high = np.zeros_like(alpha), np.full_like(alpha, 1.0 / float(rates.min()))
        flows = returned(low)[1] > self.yield_stress(alpha)
        for _ in range(60):  # up to where the stress is below the yield stress
            _, equivalent, after = returned(high)
            above = equivalent > self.yield_stress(after)
            if not above.any():
                break
            high = np.where(above, 2.0 * high, high)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            _, equivalent, after = returned(middle)
            above = equivalent > self.yield_stress(after)
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        now, _, after = returned(np.where(flows, low, 0.0))
        out = np.stack([now[0] - now[1], now[0] + now[1]]) / np.sqrt(2.0)
        return out, np.where(flows, after, alpha)
