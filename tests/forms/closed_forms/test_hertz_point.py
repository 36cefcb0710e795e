"""Point contact: load, contact radius and moment belong to the same pressure and traction."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from tribox.forms.closed_forms.hertz import PointContact, Twist

CONTACT = PointContact(load=2.0, radius=0.3, modulus=40.0)
TWIST = Twist(CONTACT, shear=7.0, mu=0.4)


def test_the_pressure_carries_the_load():
    a = CONTACT.contact_radius
    total, _ = quad(lambda r: 2.0 * np.pi * r * CONTACT.pressure(r), 0.0, a)
    assert total == pytest.approx(CONTACT.load, rel=1e-8)
    np.testing.assert_allclose(CONTACT.pressure([0.0, a, 2.0 * a]), [CONTACT.peak, 0.0, 0.0])


def test_the_peak_belongs_to_the_curvature():
    """p0 = 2 E* a/(π R*), which neither of the formulas for a and p0 uses."""
    peak = 2.0 * CONTACT.modulus * CONTACT.contact_radius / (np.pi * CONTACT.radius)
    assert CONTACT.peak == pytest.approx(peak, rel=1e-12)


def test_a_small_twist_turns_a_glued_disc():
    angle = 1e-6 * TWIST.mu * CONTACT.peak / TWIST.shear
    glued = 16.0 / 3.0 * TWIST.shear * CONTACT.contact_radius**3 * angle
    assert TWIST.moment(angle) == pytest.approx(glued, rel=1e-4)
    assert TWIST.moment(0.0) == pytest.approx(0.0, abs=1e-12)
    assert TWIST.stuck(0.0) == pytest.approx(1.0)


def test_a_large_twist_slides_everywhere():
    a = CONTACT.contact_radius
    moment, _ = quad(lambda r: 2.0 * np.pi * r**2 * TWIST.mu * CONTACT.pressure(r), 0.0, a)
    assert CONTACT.full_twist(TWIST.mu) == pytest.approx(moment, rel=1e-8)
    assert TWIST.moment(1e3) == pytest.approx(moment, rel=1e-7)
    assert TWIST.stuck(1e3) == 0.0


@pytest.mark.parametrize("share", [0.2, 0.6, 0.9])
def test_partial_slip_is_a_sum_of_glued_discs(share):
    """The moment of the tractions, from the discs' own: µp in the slip zone, less inside."""
    a = CONTACT.contact_radius
    angle = float(TWIST.angle(share))
    assert TWIST.stuck(angle) == pytest.approx(share, rel=1e-9)

    def density(s):  # discs of radius s (in units of a): -dθ/ds
        h = 1e-6
        return float(TWIST.angle(s - h) - TWIST.angle(s + h)) / (2.0 * h)

    def traction(r):
        # s² = r² + t² takes the root out of the denominator.
        low = max(share**2 - r**2, 0.0) ** 0.5
        top = (1.0 - r**2) ** 0.5 - 1e-5
        inside, _ = quad(lambda t: density((r**2 + t**2) ** 0.5) / (r**2 + t**2) ** 0.5, low, top)
        return 4.0 * TWIST.shear / np.pi * r * inside

    for r in (0.5 * (1.0 + share), share + 0.05):
        exact = TWIST.mu * float(CONTACT.pressure(r * a))
        assert traction(r) == pytest.approx(exact, rel=1e-3)
    inner, _ = quad(lambda r: 2.0 * np.pi * r**2 * traction(r), 0.0, share, epsrel=1e-4)
    outer, _ = quad(lambda r: 2.0 * np.pi * r**2 * CONTACT.pressure(r * a), share, 1.0)
    expected = a**3 * (inner + TWIST.mu * outer)
    assert TWIST.moment(angle) == pytest.approx(expected, rel=1e-3)
