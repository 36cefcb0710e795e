"""Sums of powers of principal stretches against eigenvalues, at equal stretches too."""

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
