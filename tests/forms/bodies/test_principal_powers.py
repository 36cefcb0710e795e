"""Sums of powers of principal stretches in space against eigenvalues, at equal stretches too."""

import numpy as np
import pytest

from tribox.forms.bodies.materials import Ogden
from tribox.forms.bodies.point_stress import DISTORTION, energy_at_points

# Isochoric stretches: none, all equal but for little, two equal but for little, three apart.
STATES = {
    "undeformed": lambda s: (1.0, 1.0, 1.0),
    "nearly undeformed": lambda s: (1.0 + 1e-5 * s, 1.0, 1.0 / (1.0 + 1e-5 * s)),
    "uniaxial": lambda s: (s, s**-0.5, s**-0.5),
    "equibiaxial": lambda s: (s**-1.0, s**0.5, s**0.5),
    "nearly uniaxial": lambda s: (s, s ** (-0.5 + 1e-6), s ** (-0.5 - 1e-6)),
    "planar": lambda s: (s, 1.0, 1.0 / s),
}


def at(stretches, alpha, tangent=False):
    """Energy, stress and moduli of one term with mu = alpha."""
    energy = energy_at_points(Ogden((alpha,), (alpha,), 1.0), DISTORTION, True)
    return energy(np.stack([np.diag(row).reshape(9) for row in stretches]), tangent)


@pytest.mark.parametrize("alpha", [0.5, 1.3, -2.0, 5.0, -7.3, 10.0])
@pytest.mark.parametrize("state", STATES)
def test_values(state, alpha):
    stretches = np.array([STATES[state](stretch) for stretch in (1.05, 1.5, 2.0, 4.0)])
    expected = np.sum(stretches**alpha, axis=1) - 3.0
    found = at(stretches, alpha)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-14 * alpha**2)


@pytest.mark.parametrize("alpha", [1.3, -0.7, 3.5])
def test_moduli_of_odd_powers(alpha):
    """They are the derivatives of the stresses, also across the state of equal stretches."""
    h, along = 1e-4, np.random.default_rng(1).normal(size=(3,))
    for state in STATES:
        one = np.array(STATES[state](1.7))
        sides = at([one + h * along, one - h * along], alpha)[1]
        slope = (sides[0] - sides[1])[[0, 4, 8]] / (2.0 * h)
        A = at([one], alpha, True)[2][0][[0, 4, 8]][:, [0, 4, 8]]
        np.testing.assert_allclose(A @ along, slope, rtol=0, atol=1e-6 * np.abs(A).max())
