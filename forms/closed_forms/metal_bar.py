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
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
HALVINGS = 200  # of an interval of strain: to round-off


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
    strain = np.abs(np.log(stretch))
    low, high = np.zeros_like(strain), strain.copy()
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = middle + hardening.stress(middle) / young > strain
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    tau = np.minimum(young * strain, hardening.stress(low))
    out: Floats = (-tau if pressed else tau) / stretch
    return out


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
