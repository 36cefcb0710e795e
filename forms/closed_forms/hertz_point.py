r"""Closed forms of a sphere pressed on a flat, and twisted, at small strain.

Hertz's pressure holds for half-spaces, that is for a contact radius much smaller than the sphere's.
Twisting about the axis of symmetry does not change it for any bodies. Sources: K. L. Johnson,
Contact Mechanics, Cambridge University Press 1985, section 4.2; J. L. Lubkin, J. Appl. Mech. 18
(1951) 183-187, for the moment in partial slip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import ellipe, ellipkm1

from tribox.forms.closed_forms.hertz_line import Floats, ellipse

STUCK = 1e-9  # c/a below which the whole contact counts as sliding


@dataclass(frozen=True, slots=True)
class PointContact:
    """A sphere and a flat, or two spheres.

    Attributes:
        load: N, P.
        radius: m, R*.
        modulus: Pa, E*.
    """

    load: float
    radius: float
    modulus: float

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

    Attributes:
        contact: the contact, pressed.
        shear: Pa, G of both bodies together.
        mu: coefficient of friction, > 0.
    """

    contact: PointContact
    shear: float
    mu: float

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
