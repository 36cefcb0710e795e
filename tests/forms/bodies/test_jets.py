"""Derivatives that are carried along, against those of the formulas by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tribox.forms.bodies.principal_powers import Jet

X, Y = 1.3, 0.7


def both():
    return Jet(X, (1.0, 0.0)), Jet(Y, (0.0, 1.0))


def parts(jet):
    return [jet.value, *jet.first, *jet.second]


def test_arithmetic():
    """(x² y + 3)/(x − 2 y) by the quotient rule."""
    x, y = both()
    u, v = X**2 * Y + 3.0, X - 2.0 * Y
    ux, uy, uxx, uxy, uyy = 2.0 * X * Y, X**2, 2.0 * Y, 2.0 * X, 0.0
    vx, vy = 1.0, -2.0

    def second(first, other, mixed, va, vb):
        return mixed / v - (first * vb + other * va) / v**2 + 2.0 * u * va * vb / v**3

    expected = [
        u / v,
        ux / v - u * vx / v**2,
        uy / v - u * vy / v**2,
        second(ux, ux, uxx, vx, vx),
        second(ux, uy, uxy, vx, vy),
        second(uy, uy, uyy, vy, vy),
    ]
    assert parts((x * x * y + 3.0) / (x - 2.0 * y)) == pytest.approx(expected, rel=1e-13)


def test_roots():
    """√(x y) has the derivatives √(y/x)/2, …, of which the mixed one is 1/(4 √(x y))."""
    x, y = both()
    root = np.sqrt(X * Y)
    expected = [root, 0.5 * Y / root, 0.5 * X / root]
    expected += [-0.25 * Y**2 / root**3, 0.25 / root, -0.25 * X**2 / root**3]
    assert parts((x * y).root()) == pytest.approx(expected, rel=1e-13)


def test_composition_is_what_arithmetic_gives():
    x, y = both()
    u, v = x * y + x, y * y + 2.0 * x
    a, b = Jet(u.value, (1.0, 0.0)), Jet(v.value, (0.0, 1.0))
    outer, direct = a * b.root() / (a + 1.0), u * v.root() / (u + 1.0)
    assert parts(outer.of(u, v)) == pytest.approx(parts(direct), rel=1e-13)


def test_taylor():
    jet = Jet(1.0, (2.0, 3.0), (4.0, 5.0, 6.0))
    assert jet.taylor(0.1, -0.2) == pytest.approx(1.0 + 0.2 - 0.6 + 0.02 - 0.1 + 0.12)
