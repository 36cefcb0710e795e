"""Sums of powers of principal stretches against eigenvalues, at equal stretches too."""

from __future__ import annotations

import numpy as np
import pytest

from tribox.forms.bodies.principal_powers import space_power_sum

# Isochoric stretches: none, all equal but for little, two equal but for little, three apart.
STATES = {
    "undeformed": lambda s: (1.0, 1.0, 1.0),
    "nearly undeformed": lambda s: (1.0 + 1e-5 * s, 1.0, 1.0 / (1.0 + 1e-5 * s)),
    "uniaxial": lambda s: (s, s**-0.5, s**-0.5),
    "equibiaxial": lambda s: (s**-1.0, s**0.5, s**0.5),
    "nearly uniaxial": lambda s: (s, s ** (-0.5 + 1e-6), s ** (-0.5 - 1e-6)),
    "planar": lambda s: (s, 1.0, 1.0 / s),
}


def excess(stretches):
    squares = np.asarray(stretches) ** 2
    return squares.sum() - 3.0, (1.0 / squares).sum() - 3.0


@pytest.mark.parametrize("alpha", [0.5, 1.3, -2.0, 5.0, -7.3, 10.0])
@pytest.mark.parametrize("state", STATES)
def test_values(state, alpha):
    for stretch in (1.05, 1.5, 2.0, 4.0):
        stretches = np.array(STATES[state](stretch))
        found = space_power_sum(*excess(stretches), [(1.0, alpha)]).value
        assert found == pytest.approx(
            np.sum(stretches**alpha) - 3.0, rel=1e-9, abs=1e-14 * alpha**2
        )


def cubic(x, y, alpha):
    """The sum from the eigenvalues of a matrix with the invariants, and its exact derivatives.

    The eigenvalues w of C̄ satisfy w³ − I1 w² + I2 w − 1 = 0; with p = 3w² − 2 I1 w + I2,
    ∂w/∂I1 = w²/p and ∂w/∂I2 = −w/p.
    """
    w = np.roots([1.0, -(x + 3.0), y + 3.0, -1.0]).real
    slope = 0.5 * alpha * w ** (0.5 * alpha - 1.0) / (3.0 * w**2 - 2.0 * (x + 3.0) * w + y + 3.0)
    return np.sum(slope * w**2), -np.sum(slope * w)


@pytest.mark.parametrize("alpha", [1.3, -2.5, 8.0])
def test_first_derivatives_of_stretches_apart(alpha):
    for stretches in ((2.0, 1.1, 1.0 / 2.2), (0.6, 0.9, 1.0 / 0.54), (3.0, 0.5, 2.0 / 3.0)):
        point = excess(stretches)
        found = space_power_sum(*point, [(1.0, alpha)]).first
        np.testing.assert_allclose(found, cubic(*point, alpha), rtol=1e-10)


def test_derivatives_where_stretches_coincide():
    """tr Cᵏ are polynomials of the invariants: at det C = 1, λ⁴ sums to I1² − 2 I2, λ⁻⁴ to …"""
    for state in STATES:
        x, y = excess(STATES[state](1.7))
        quartic = space_power_sum(x, y, [(1.0, 4.0)])
        np.testing.assert_allclose(quartic.first, (2.0 * (x + 3.0), -2.0), rtol=1e-10)
        np.testing.assert_allclose(quartic.second, (2.0, 0.0, 0.0), rtol=0, atol=1e-10)
        inverse = space_power_sum(x, y, [(1.0, -4.0)])
        np.testing.assert_allclose(inverse.first, (-2.0, 2.0 * (y + 3.0)), rtol=1e-10)
        np.testing.assert_allclose(inverse.second, (0.0, 0.0, 2.0), rtol=0, atol=1e-10)
        sextic = space_power_sum(x, y, [(1.0, 6.0)])  # I1³ − 3 I1 I2 + 3
        a, b = x + 3.0, y + 3.0
        np.testing.assert_allclose(sextic.first, (3.0 * a**2 - 3.0 * b, -3.0 * a), rtol=1e-10)
        np.testing.assert_allclose(sextic.second, (6.0 * a, -3.0, 0.0), rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("alpha", [1.3, -0.7, 3.5])
def test_second_derivatives_of_odd_powers(alpha):
    """They are those of the first ones, also across the state of equal stretches."""
    h = 1e-4
    for state in STATES:
        x, y = excess(STATES[state](1.7))
        x, y = x + 2e-3, y + 2e-3  # inside of what tensors can have, for both differences
        second = space_power_sum(x, y, [(1.0, alpha)]).second
        right, left = (space_power_sum(x + s * h, y, [(1.0, alpha)]).first for s in (1, -1))
        up, down = (space_power_sum(x, y + s * h, [(1.0, alpha)]).first for s in (1, -1))
        differences = [(right[0] - left[0]), (right[1] - left[1]), (up[1] - down[1])]
        np.testing.assert_allclose(
            second, np.array(differences) / (2.0 * h), rtol=0, atol=1e-7 * max(np.abs(second))
        )


def test_terms_add():
    point = excess((1.4, 0.9, 1.0 / 1.26))
    parts = [space_power_sum(*point, [term]) for term in ((0.7, 1.3), (-0.2, -2.0))]
    both = space_power_sum(*point, [(0.7, 1.3), (-0.2, -2.0)])
    assert both.value == pytest.approx(sum(p.value for p in parts), rel=1e-14)
    np.testing.assert_allclose(both.second, np.sum([p.second for p in parts], axis=0), rtol=1e-13)
