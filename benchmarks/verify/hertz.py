"""Closed forms of Hertz's contacts: elastic cylinders per unit length, and spheres (below).

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
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import ellipe, ellipkm1

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
        """
        return self.traction(x, peak, mu) - 2.0 * self.traction(x, 0.5 * (peak - share), mu)


# -- Closed forms of a sphere pressed on a flat, and twisted, at small strain ----------------------
#
# Hertz's pressure holds for half-spaces, that is for a contact radius much smaller than the
# sphere's. Twisting about the axis of symmetry does not change it for any bodies. Sources: K. L.
# Johnson, Contact Mechanics, Cambridge University Press 1985, section 4.2; J. L. Lubkin, J. Appl.
# Mech. 18 (1951) 183-187, for the moment in partial slip.

STUCK = 1e-9  # c/a below which the whole contact counts as sliding


@dataclass(frozen=True, slots=True)
class PointContact:
    """A sphere and a flat, or two spheres."""

    load: float  # N, P
    radius: float  # m, R*
    modulus: float  # Pa, E*

    @property
    def contact_radius(self) -> float:
        r"""m, :math:`a = (3 P R^*/(4 E^*))^{1/3}`."""
        return float(np.cbrt(0.75 * self.load * self.radius / self.modulus))

    @property
    def peak(self) -> float:
        r"""Pa, :math:`p_0 = 3 P/(2 \pi a^2)`."""
        return 1.5 * self.load / (math.pi * self.contact_radius**2)

    def pressure(self, r: ArrayLike) -> Floats:
        r"""Pa, :math:`p_0 \sqrt{1 - r^2/a^2}` at r (m, from the axis), zero outside."""
        return self.peak * ellipse(r, self.contact_radius)

    def full_twist(self, mu: float) -> float:
        r"""N m, moment at which all slides: :math:`\int \mu p r\,dA = \frac{3\pi}{16}\mu P a`."""
        return 3.0 * math.pi / 16.0 * mu * self.load * self.contact_radius


@dataclass(frozen=True, slots=True)
class Twist:
    r"""Partial slip of a point contact that is turned about its axis after pressing.

    The stuck disc r < c turns rigidly. Tractions :math:`4 G \omega r/(\pi\sqrt{s^2 - r^2})` in
    r < s are those of a disc of radius s that is glued and turned by ω; discs with c < s < a add
    up to µp where there is slip if

    .. math:: \theta(c) = \frac{\mu p_0}{2 G} [K(k) - E(k)], \quad k^2 = 1 - c^2/a^2,
    .. math:: M = \frac{16}{3} G [c^3 \theta(c) + 3 \int_c^a s^2 \theta(s)\,ds],

    with complete elliptic integrals K and E, and :math:`1/G = 1/G_1 + 1/G_2` of the two bodies.
    """

    contact: PointContact  # the contact, pressed
    shear: float  # Pa, G of both bodies together
    mu: float  # coefficient of friction, > 0

    def angle(self, share: ArrayLike) -> Floats:
        """Angle θ, rad, at which discs of radius c = share · a still stick; 0 < share <= 1."""
        square = np.asarray(share, dtype=np.float64) ** 2
        factor = 0.5 * self.mu * self.contact.peak / self.shear
        return np.asarray(factor * (ellipkm1(square) - ellipe(1.0 - square)))

    def stuck(self, angle: float) -> float:
        """c/a at an angle, rad; 0 where it would be less than a billionth."""
        if angle >= float(self.angle(STUCK)):
            return 0.0
        return float(brentq(lambda c: float(self.angle(c)) - angle, STUCK, 1.0, xtol=1e-14))

    def moment(self, angle: float) -> float:
        """Twisting moment M, N m, at an angle >= 0, rad."""
        c = self.stuck(angle)
        inner = c**3 * angle if c > 0.0 else 0.0
        outer, _ = quad(lambda s: s**2 * float(self.angle(s)), c, 1.0, epsabs=0.0, epsrel=1e-10)
        return float(16.0 / 3.0 * self.shear * self.contact.contact_radius**3 * (inner + 3 * outer))
