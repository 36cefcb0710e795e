"""Closed forms of line and point contact: what they must satisfy by themselves."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from benchmarks.verify.hertz import (
    LineContact,
    PointContact,
    Twist,
    contact_modulus,
    relative_radius,
)

CONTACT = LineContact(load=2.0e3, radius=0.01, modulus=5.0e6)
X = CONTACT.half_width * np.linspace(-1.5, 1.5, 300001)


def test_modulus_and_radius_of_two_bodies():
    rigid = (1e30, 0.3)
    assert contact_modulus((5e6, 0.5), rigid) == pytest.approx(5e6 / 0.75, rel=1e-12)
    assert contact_modulus((5e6, 0.4), (5e6, 0.4)) == pytest.approx(2.5e6 / 0.84, rel=1e-12)
    assert relative_radius(0.02, 0.02) == pytest.approx(0.01, rel=1e-12)
    assert relative_radius(0.03) == pytest.approx(0.03, rel=1e-12)


def test_pressure_carries_the_load():
    assert np.trapezoid(CONTACT.pressure(X), X) == pytest.approx(CONTACT.load, rel=1e-6)
    assert CONTACT.pressure(0.0) == pytest.approx(CONTACT.peak, rel=1e-12)
    assert np.all(CONTACT.pressure(X)[np.abs(X) > CONTACT.half_width] == 0.0)


def test_pressure_flattens_the_gap():
    """The surface displacement of the pressure has the curvature 1/R* (Johnson, eq. 2.25)."""
    a, n = CONTACT.half_width, 4000
    # Nodes of Chebyshev: the pressure's ellipse is the weight.
    s = a * np.cos((np.arange(1, n + 1) - 0.5) * np.pi / n)
    weight = CONTACT.peak * (1.0 - (s / a) ** 2) * np.pi * a / n
    x = a * np.linspace(-0.8, 0.8, 9)
    # du/dx = -(2/(pi E*)) int p/(x - s) ds, the principal value, closed up by subtracting p(x).
    p_x = CONTACT.pressure(x)[:, None]
    integrand = (CONTACT.pressure(s) - p_x) / (x[:, None] - s)
    ds = weight / CONTACT.pressure(s)
    log = np.log((a + x) / (a - x))
    slope = -2.0 / (math.pi * CONTACT.modulus) * (integrand @ ds + p_x[:, 0] * log)
    np.testing.assert_allclose(slope, -x / CONTACT.radius, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 1.0])
def test_traction_carries_its_share_and_nowhere_exceeds_friction(share):
    mu = 0.4
    q = CONTACT.traction(X, share, mu)
    assert np.trapezoid(q, X) == pytest.approx(share * mu * CONTACT.load, rel=1e-5, abs=1e-9)
    limit = mu * CONTACT.pressure(X)
    assert np.all(q <= limit * (1.0 + 1e-12)) and np.all(q >= 0.0)
    slips = q > limit * (1.0 - 1e-12)
    c = CONTACT.stick_half_width(share)
    assert np.all(slips[(np.abs(X) > c) & (np.abs(X) < CONTACT.half_width)])
    assert not np.any(slips[np.abs(X) < 0.999 * c])


@pytest.mark.parametrize("share", [0.5, 0.2, -0.3, -0.6])
def test_traction_after_a_reversal(share):
    mu, peak = 0.4, 0.6
    q = CONTACT.reversed_traction(X, peak, share, mu)
    assert np.trapezoid(q, X) == pytest.approx(share * mu * CONTACT.load, rel=1e-5)
    limit = mu * CONTACT.pressure(X)
    assert np.all(np.abs(q) <= limit * (1.0 + 1e-9))
    c = CONTACT.stick_half_width(0.5 * (peak - share))
    back = (np.abs(X) > c) & (np.abs(X) < CONTACT.half_width)
    np.testing.assert_allclose(q[back], -limit[back], rtol=1e-9)  # slides the other way
    turned = CONTACT.reversed_traction(X, peak, -peak, mu)
    np.testing.assert_allclose(turned, -CONTACT.traction(X, peak, mu), atol=1e-9 * limit.max())
    np.testing.assert_array_equal(
        CONTACT.reversed_traction(X, peak, peak, mu), CONTACT.traction(X, peak, mu)
    )


def test_stress_below_the_middle():
    """At the surface −p0 both ways; the largest shear stress is 0.300 p0 at 0.786 a."""
    contact = LineContact(load=1e3, radius=0.01, modulus=1e7)
    a, peak = contact.half_width, contact.peak
    assert np.array(contact.stress_below(0.0)) == pytest.approx([-peak, -peak])
    depth = np.linspace(0.0, 3.0, 30001) * a
    along, across = contact.stress_below(depth)
    shear = 0.5 * (along - across) / peak
    assert shear.max() == pytest.approx(0.30028, rel=1e-4)
    assert depth[shear.argmax()] / a == pytest.approx(0.78615, rel=1e-3)
    # Far below it is Flamant's: −2 P'/(π z) across the surface and nothing along it.
    along, across = contact.stress_below(100.0 * a)
    assert across == pytest.approx(-2.0 * contact.load / (np.pi * 100.0 * a), rel=1e-4)
    assert abs(along) < 1e-4 * abs(across)


# -- Point contact: load, contact radius and moment belong to the same pressure and traction -------

SPHERE = PointContact(load=2.0, radius=0.3, modulus=40.0)
TWIST = Twist(SPHERE, shear=7.0, mu=0.4)


def test_the_pressure_carries_the_load():
    a = SPHERE.contact_radius
    total, _ = quad(lambda r: 2.0 * np.pi * r * SPHERE.pressure(r), 0.0, a)
    assert total == pytest.approx(SPHERE.load, rel=1e-8)
    np.testing.assert_allclose(SPHERE.pressure([0.0, a, 2.0 * a]), [SPHERE.peak, 0.0, 0.0])


def test_the_peak_belongs_to_the_curvature():
    """p0 = 2 E* a/(π R*), which neither of the formulas for a and p0 uses."""
    peak = 2.0 * SPHERE.modulus * SPHERE.contact_radius / (np.pi * SPHERE.radius)
    assert SPHERE.peak == pytest.approx(peak, rel=1e-12)


def test_a_small_twist_turns_a_glued_disc():
    angle = 1e-6 * TWIST.mu * SPHERE.peak / TWIST.shear
    glued = 16.0 / 3.0 * TWIST.shear * SPHERE.contact_radius**3 * angle
    assert TWIST.moment(angle) == pytest.approx(glued, rel=1e-4)
    assert TWIST.moment(0.0) == pytest.approx(0.0, abs=1e-12)
    assert TWIST.stuck(0.0) == pytest.approx(1.0)


def test_a_large_twist_slides_everywhere():
    a = SPHERE.contact_radius
    moment, _ = quad(lambda r: 2.0 * np.pi * r**2 * TWIST.mu * SPHERE.pressure(r), 0.0, a)
    assert SPHERE.full_twist(TWIST.mu) == pytest.approx(moment, rel=1e-8)
    assert TWIST.moment(1e3) == pytest.approx(moment, rel=1e-7)
    assert TWIST.stuck(1e3) == 0.0


@pytest.mark.parametrize("share", [0.2, 0.6, 0.9])
def test_partial_slip_is_a_sum_of_glued_discs(share):
    """The moment of the tractions, from the discs' own: µp in the slip zone, less inside."""
    a = SPHERE.contact_radius
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
        exact = TWIST.mu * float(SPHERE.pressure(r * a))
        assert traction(r) == pytest.approx(exact, rel=1e-3)
    inner, _ = quad(lambda r: 2.0 * np.pi * r**2 * traction(r), 0.0, share, epsrel=1e-4)
    outer, _ = quad(lambda r: 2.0 * np.pi * r**2 * SPHERE.pressure(r * a), share, 1.0)
    expected = a**3 * (inner + TWIST.mu * outer)
    assert TWIST.moment(angle) == pytest.approx(expected, rel=1e-3)
