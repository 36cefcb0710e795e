"""Metals that flow against closed forms: other elements, meshes and steps; checks that can fail."""

import numpy as np
import pytest

from benchmarks.verify.flowing import (
    FLOWS,
    GROWTH,
    INNER,
    SATURATING,
    SWIFT,
    TUBE,
    YOUNG,
    drawn_bar,
    metal,
    quarter_of_tube,
    tube_of_revolution,
)
from benchmarks.verify.flowing_bending import (
    ANGLES,
    POISSON,
    PUBLISHED,
    STRIPS,
    THICKNESS,
    BentStrip,
    curvature,
    limit,
    membrane_tip,
    springback,
)
from benchmarks.verify.metal_bar import Strip, inner_pressure, load_maximum, stress_at
from tribox.forms.bodies.hardening import Backstress, Voce

RIGID_VOLUME = metal(TUBE, poisson=0.4999)

# -- thick tube -----------------------------------------------------------------------------------


def test_a_tube_of_revolution_converges_to_the_closed_form():
    errors = [tube_of_revolution(RIGID_VOLUME, n).error for n in (4, 8, 16)]
    assert errors[2] < 1.5e-3
    assert errors[0] > 2.5 * errors[1] > 6.0 * errors[2]


def test_second_order_elements_meet_the_closed_form_where_metals_are_compressible():
    found = quarter_of_tube(metal(TUBE), (4, 6), "q2")
    np.testing.assert_allclose(found.pressure[FLOWS:], found.exact[FLOWS:], rtol=0.01)


def test_a_tube_in_few_steps_is_that_in_many():
    """Flow in one direction: the step's size does not count."""
    exact = [
        inner_pressure(
            float(g) * INNER, INNER, 2.0 * INNER, RIGID_VOLUME.shear_modulus, TUBE.stress
        )
        for g in GROWTH
    ]
    few = quarter_of_tube(RIGID_VOLUME, (6, 6), pressures=np.array(exact[FLOWS:]))
    many = quarter_of_tube(RIGID_VOLUME, (6, 6), pressures=np.array(exact))
    np.testing.assert_allclose(few.displacement, many.displacement[FLOWS:], rtol=2e-3)


# -- drawn bars -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("formulation", "counts", "section"),
    [("q1", (1, 2, 3), "3D"), ("q1-sri", (2, 4), "axisymmetric"), ("q2", (1, 1, 2), "3D")],
)
def test_a_bar_bears_most_where_considere_says(formulation, counts, section):
    bar = drawn_bar(SWIFT, counts, section, np.array([0.04, 0.16, 0.19, 0.22]), formulation)
    stretch, stress = load_maximum(YOUNG, SWIFT)
    assert bar.maximum() == pytest.approx((stretch, stress), rel=5e-3)
    np.testing.assert_allclose(bar.stress, stress_at(bar.stretch, YOUNG, SWIFT), rtol=1e-7)
    assert bar.uneven < 1e-6


def test_a_bar_drawn_in_one_step_bears_what_it_does_in_ten():
    one = drawn_bar(SATURATING, (1, 1), "axisymmetric", np.array([0.2]))
    ten = drawn_bar(SATURATING, (1, 1), "axisymmetric", np.linspace(0.02, 0.2, 10))
    assert one.stress[-1] == pytest.approx(ten.stress[-1], rel=1e-8)


# -- Cook's membrane ------------------------------------------------------------------------------


def test_the_limit_of_a_geometric_series_is_found():
    assert limit(np.array([9.0, 1.0, 2.0, 2.5])) == pytest.approx(3.0)


def test_cooks_membrane_tends_to_the_published_range():
    for kind, counts in (("q1-sri", (8, 16, 32)), ("q2", (4, 8, 16))):
        tips = np.array([membrane_tip(n, kind)[0] for n in counts])
        assert np.all(np.diff(tips) > 0.0) and tips[-1] < PUBLISHED[1]
        assert limit(tips) == pytest.approx(np.mean(PUBLISHED), rel=0.02)


def test_cooks_membrane_of_full_integration_locks():
    full, reduced = (membrane_tip(8, kind)[0] for kind in ("q1", "q1-sri"))
    assert full < 0.5 * reduced


def test_more_steps_change_cooks_membrane_in_first_order():
    tips = [membrane_tip(8, "q1-sri", steps)[0] for steps in (5, 10, 20)]
    assert tips[2] == pytest.approx(tips[1], rel=5e-3)
    assert 1.4 < (tips[0] - tips[1]) / (tips[1] - tips[2]) < 3.0


# -- springback -----------------------------------------------------------------------------------


def lost(found, hardening):
    """Error of 1 − K against fibres."""
    curvature = found.curvature
    exact = 1.0 - Strip(THICKNESS, YOUNG, POISSON, hardening.stress).bent(curvature)[1] / curvature
    return (1.0 - found.ratio) / exact - 1.0


@pytest.mark.parametrize("name", STRIPS)
def test_springback_of_a_coarse_strip_meets_that_of_fibres(name):
    found = springback(STRIPS[name], ANGLES[1], (8, 4))
    assert abs(lost(found, STRIPS[name])) < 0.01
    assert abs(found.left) < 1e-6


def test_springback_with_selective_reduced_integration_needs_elements_as_long_as_high():
    law = STRIPS["Voce"]
    square, long = (
        lost(springback(law, ANGLES[0], counts, "q1-sri", 10), law) for counts in ((64, 8), (8, 8))
    )
    assert abs(square) < 0.01 < abs(long)


# -- bent and bent back ---------------------------------------------------------------------------


def fibre_moments(curvatures, law, kinematic, steps=2000, fibres=40, young=YOUNG):
    """Moments (n,), N m/m, of a wide strip bent to one curvature after the other.

    Prandtl's and Reuss' equations with Armstrong's and Frederick's backstress at each fibre, plane
    stress through the thickness, no strain across the strip; small steps forward in time.
    """
    y, weight = np.polynomial.legendre.leggauss(fibres)
    y, weight = 0.5 * THICKNESS * y, 0.5 * THICKNESS * weight
    D = young / (1.0 - POISSON**2) * np.array([[1.0, POISSON], [POISSON, 1.0]])
    sigma, alpha, at, found = np.zeros((2, fibres)), np.zeros(fibres), 0.0, []
    X = [np.zeros((3, fibres)) for _ in kinematic]
    for end in curvatures:
        strain = np.stack([(end - at) / steps * y, np.zeros(fibres)])
        for _ in range(steps):
            s = np.stack([sigma[0], np.zeros(fibres), sigma[1]])  # along, through, across
            xi = s - s.mean(axis=0) - sum(X)
            size = np.sqrt(1.5 * (xi**2).sum(axis=0)) + 1e-9
            n = 1.5 * xi / size
            hard = law.slope(alpha)
            for branch, part in zip(kinematic, X, strict=True):
                hard = hard + branch.modulus - branch.recovery * (n * part).sum(axis=0)
            m, trial = n[::2], D @ strain
            over = size - law.stress(alpha) + (m * trial).sum(axis=0)
            step = np.where(over > 0.0, over / ((m * (D @ m)).sum(axis=0) + hard), 0.0)
            sigma, alpha = sigma + trial - D @ (step * m), alpha + step
            X = [
                part + step * (2.0 / 3.0 * branch.modulus * n - branch.recovery * part)
                for branch, part in zip(kinematic, X, strict=True)
            ]
        at = end
        found.append(weight @ (sigma[0] * y))
    return np.array(found)


@pytest.mark.parametrize("reversed_", [False, True], ids=["straight", "other way"])
def test_a_strip_bent_and_bent_back_has_the_moments_of_its_fibres(reversed_):
    law, kinematic = Voce(60e6, 120e6, 12.0), (Backstress(8e9, 200.0),)
    strip = BentStrip(metal(law, kinematic=kinematic), (8, 4), "q2")
    moments, curvatures = [], []
    for end in (0.16, -0.16) if reversed_ else (0.16, 0.02):
        start = 0.16 * len(moments)
        for angle in np.linspace(start, end, 17)[1:]:
            moment = strip.turn(angle)
        moments.append(moment)
        curvatures.append(curvature(strip.body.X, strip.body.moved))
    wanted = fibre_moments(curvatures, law, kinematic)
    without = fibre_moments(curvatures, Voce(100e6, 160e6, 12.0), ())
    assert abs(without[1] / wanted[1] - 1.0) > 0.05  # the Bauschinger effect is not a small one
    np.testing.assert_allclose(moments, wanted, rtol=0.01)
