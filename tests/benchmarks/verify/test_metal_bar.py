"""Drawn and pressed bars of metal: forces against material points, the maximum against others."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from benchmarks.verify.metal_bar import (
    flow_curve,
    inner_pressure,
    load_maximum,
    stress_at,
    stretch_and_stress,
)
from tribox.forms.bodies.elastoplastic import ElastoPlastic, PlasticPoints
from tribox.forms.bodies.hardening import Linear, Swift, Voce

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


# -- The thick tube against formulas of its limits, and against plastic points through the wall ----


def test_the_flow_curve_is_elastic_up_to_yield_and_adds_the_strains_beyond():
    law, shear = Voce(60e6, 160e6, 12.0), 26e9
    plastic = np.array([0.0, 1e-4, 0.03, 0.5])
    strain = plastic + law.stress(plastic) / (3.0 * shear)
    np.testing.assert_allclose(flow_curve(strain, shear, law.stress), law.stress(plastic))
    below = np.array([0.0, 3e-4])
    np.testing.assert_allclose(flow_curve(below, shear, law.stress), 3.0 * shear * below)


def test_small_elastic_expansion_is_lames():
    """An incompressible one: p = 2G u/a (1 − a²/b²)."""
    found = inner_pressure(1e-7, 0.02, 0.05, 26e9, Linear(1e12).stress)
    assert found == pytest.approx(2.0 * 26e9 * 1e-7 / 0.02 * (1.0 - 0.16), rel=1e-4)


def test_ideal_plasticity_throughout_is_twice_the_shear_strength_times_the_log_of_the_radii():
    found = inner_pressure(0.01, 0.02, 0.05, 26e12, Linear(60e6).stress)
    radii = np.sqrt(0.05**2 + 0.03**2 - 0.02**2) / 0.03
    assert found == pytest.approx(2.0 / np.sqrt(3.0) * 60e6 * np.log(radii), rel=1e-9)


@pytest.mark.parametrize("steps", [1, 7])
def test_plastic_points_through_the_wall_give_the_same_pressure(steps):
    """Their distortional stress in F = diag(R/r, r/R, 1); equilibrium by a rule of their own."""
    law, shear, inner, outer, moved = Voce(60e6, 160e6, 12.0), 26e9, 0.02, 0.05, 0.004
    points = PlasticPoints(ElastoPlastic(shear, 70e9, law), space=False)
    R = np.linspace(inner, outer, 4001)
    state = points.start(len(R))
    for step in range(1, steps + 1):
        r = np.sqrt(R**2 + (inner + moved * step / steps) ** 2 - inner**2)
        F = np.column_stack([R / r, 0.0 * R, 0.0 * R, r / R, np.ones_like(R)])
        update = points.update(F, state, 1.0, False, volumetric=False)
        state = update.state
    tau = update.P[:, 3] * F[:, 3] - update.P[:, 0] * F[:, 0]
    pressure = np.trapezoid(tau / r, r)
    assert (state[0, -1] > 0.0) and pressure == pytest.approx(
        inner_pressure(moved, inner, outer, shear, law.stress), rel=1e-6
    )
