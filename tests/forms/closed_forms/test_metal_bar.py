"""Drawn and pressed bars of metal: forces against material points, the maximum against others."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from tribox.forms.bodies.hardening import Linear, Swift, Voce
from tribox.forms.closed_forms.metal_bar import load_maximum, stress_at, stretch_and_stress

LAW = Voce(60e6, 160e6, 12.0, 50e6)


@pytest.mark.parametrize("pressed", [False, True])
def test_stress_at_a_stretch_is_that_of_its_plastic_strain(pressed):
    alpha = np.array([0.0, 1e-5, 0.02, 0.4])
    stretch, stress = stretch_and_stress(alpha, 70e9, LAW, pressed)
    np.testing.assert_allclose(stress_at(stretch, 70e9, LAW, pressed), stress, rtol=1e-9)
    assert np.all(stress < 0.0 if pressed else stress > 0.0)
    assert np.all(np.diff(stretch) < 0.0 if pressed else np.diff(stretch) > 0.0)


def test_below_yield_the_bar_is_elastic():
    stretch = np.array([1.0, 1.0005])
    np.testing.assert_allclose(
        stress_at(stretch, 70e9, LAW), 70e9 * np.log(stretch) / stretch, rtol=1e-12
    )


@pytest.mark.parametrize("law", [Swift(180e6, 0.002, 0.2), LAW, Voce(60e6, 160e6, 12.0)])
def test_the_maximum_is_that_of_the_forces(law):
    found = minimize_scalar(
        lambda s: -float(stress_at(np.array([s]), 70e9, law)[0]), bounds=(1.01, 2.0)
    )
    stretch, stress = load_maximum(70e9, law)
    assert (stretch, stress) == pytest.approx((found.x, -found.fun), rel=1e-4)


def test_a_rigid_swift_bar_bears_most_at_a_strain_of_its_exponent():
    stretch, _ = load_maximum(1e18, Swift(180e6, 0.01, 0.2))
    assert np.log(stretch) == pytest.approx(0.19, rel=1e-6)


def test_an_ideally_plastic_bar_has_no_maximum_later():
    with pytest.raises(ValueError, match="no maximum"):
        load_maximum(70e9, Linear(100e6))
