r"""Closed forms of line contact between elastic cylinders at small strain, per unit length.

Hertz's pressure and the tangential traction of Cattaneo and Mindlin hold for half-spaces in plane
strain, that is for a half-width much smaller than the radii. Friction does not change the pressure
where the bodies are alike or both incompressible (Dundurs' second parameter is zero). Source:
K. L. Johnson, Contact Mechanics, Cambridge University Press 1985, sections 4.2 and 7.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def contact_modulus(first: tuple[float, float], second: tuple[float, float]) -> float:
    r"""E*, Pa, of two bodies: :math:`1/E^* = (1-\nu_1^2)/E_1 + (1-\nu_2^2)/E_2`.

    Args:
        first: Young's modulus, Pa, and Poisson's ratio of one body.
        second: Of the other.
    """
    return 1.0 / sum((1.0 - nu**2) / E for E, nu in (first, second))


def relative_radius(first: float, second: float = math.inf) -> float:
    """R*, m, of two cylinders, 1/R* = 1/R1 + 1/R2; infinite radii are flat."""
    return 1.0 / (1.0 / first + 1.0 / second)


def ellipse(x: ArrayLike, half_width: float) -> Floats:
    r""":math:`\sqrt{1 - x^2/a^2}`, zero outside."""
    ratio = np.asarray(x, dtype=np.float64) / half_width
    return np.sqrt(np.maximum(1.0 - ratio**2, 0.0))


@dataclass(frozen=True, slots=True)
class LineContact:
    """Two cylinders pressed together without friction, or with friction and alike.

    Attributes:
        load: N/m, P' per unit length.
        radius: m, R*.
        modulus: Pa, E*.
    """

    load: float
    radius: float
    modulus: float

    @property
    def half_width(self) -> float:
        r"""m, :math:`a = \sqrt{4 P' R^*/(\pi E^*)}`."""
        return math.sqrt(4.0 * self.load * self.radius / (math.pi * self.modulus))

    @property
    def peak(self) -> float:
        r"""Pa, :math:`p_0 = 2 P'/(\pi a)`."""
        return 2.0 * self.load / (math.pi * self.half_width)

    def pressure(self, x: ArrayLike) -> Floats:
        r"""Pa, :math:`p_0 \sqrt{1 - x^2/a^2}` at x (m, from the middle), zero outside."""
        return self.peak * ellipse(x, self.half_width)

    def stress_below(self, depth: ArrayLike) -> tuple[Floats, Floats]:
        r"""Pa, stress along and across the surface under the middle of the contact, depth z (m).

        :math:`\sigma_x = -\frac{p_0}{a} \left(\frac{a^2 + 2 z^2}{\sqrt{a^2 + z^2}} - 2 z\right)`
        and :math:`\sigma_z = -p_0 a/\sqrt{a^2 + z^2}` (Johnson, equations 4.45).
        """
        a, z = self.half_width, np.asarray(depth, dtype=np.float64)
        root = np.sqrt(a**2 + z**2)
        along = -self.peak / a * ((a**2 + 2.0 * z**2) / root - 2.0 * z)
        return np.asarray(along), np.asarray(-self.peak * a / root)

    def stick_half_width(self, share: float) -> float:
        r"""m, :math:`c = a \sqrt{1 - Q'/(\mu P')}`, zero in gross sliding.

        Args:
            share: Q'/(mu P'), tangential load over the load at which all slides.
        """
        return self.half_width * math.sqrt(max(1.0 - share, 0.0))

    def traction(self, x: ArrayLike, share: float, mu: float) -> Floats:
        r"""Pa, tangential traction :math:`\mu p_0 [\sqrt{1-x^2/a^2} - (c/a) \sqrt{1-x^2/c^2}]`.

        Args:
            x: m, from the middle.
            share: Q'/(mu P'), grown from zero after pressing.
            mu: Coefficient of friction.
        """
        c = self.stick_half_width(share)
        stuck = c / self.half_width * ellipse(x, c) if c > 0.0 else 0.0
        return np.asarray(mu * self.peak * (ellipse(x, self.half_width) - stuck))

    def reversed_traction(self, x: ArrayLike, peak: float, share: float, mu: float) -> Floats:
        r"""Pa, traction after the tangential load has gone back from its peak.

        The change is that of fresh slip under twice the friction (Mindlin and Deresiewicz):
        :math:`q = q(x; s_p) - 2 q(x; (s_p - s)/2)` with the traction q of first loading.

        Args:
            x: m, from the middle.
            peak: s_p, largest Q'/(mu P') before the load went back.
            share: s, Q'/(mu P') now, between -s_p and s_p.
            mu: Coefficient of friction.
        """
        return self.traction(x, peak, mu) - 2.0 * self.traction(x, 0.5 * (peak - share), mu)
