r"""Thick tube of an incompressible metal under inner pressure, in plane strain, at any expansion.

All of it follows from r² − R² = a² − A²: the equivalent strain is :math:`2/\sqrt3\,\ln(r/R)` with a
direction that does not change, so that the yield stress over the whole strain gives the stresses,
and equilibrium the pressure :math:`p = \int 2/\sqrt3\,\bar\sigma\,dr/r` (R. Hill, *The mathematical
theory of plasticity*, 1950, ch. V, there for small strain and for the rigid, ideally plastic tube).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Law = Callable[[Floats], Floats]

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(16)
HALVINGS = 60  # of an interval: to round-off
PIECES = 64  # of the wall: the strain at first yield is a kink somewhere within it


def flow_curve(strain: Floats, shear_modulus: float, yield_stress: Law) -> Floats:
    """Equivalent stress, Pa, at an equivalent strain, elastic and plastic part together.

    Args:
        strain: total equivalent strain ε = σ/3G + α, not negative.
        shear_modulus: G, Pa.
        yield_stress: σ_Y(α), Pa, not falling.
    """
    low, high = np.zeros_like(strain), np.asarray(strain, dtype=np.float64)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        above = middle + yield_stress(middle) / (3.0 * shear_modulus) > strain
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.minimum(3.0 * shear_modulus * strain, yield_stress(low))


def inner_pressure(
    displacement: float,
    inner: float,
    outer: float,
    shear_modulus: float,
    yield_stress: Law,
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
