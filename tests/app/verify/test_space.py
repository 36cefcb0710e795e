"""Verification on flat surfaces in space: the checks see what they are made for."""

from __future__ import annotations

import numpy as np
import pytest

from tribox.app.verify.space import QUICK_BOXES, patch_errors, slide


def test_more_points_carry_the_pressure_better():
    """Non-matching both ways: the error of the stress falls with the points on a facet."""
    near = [
        patch_errors((7, 3, 7), (6, 2, 5), [f"contact.0.quadrature_degree={degree}"]).near
        for degree in (1, 3, 9)
    ]
    assert near[0] > 2.0 * near[1] > 4.0 * near[2] > 1e-5
    assert near[2] < 0.01


def test_tetrahedra_pass_the_patch_test_too():
    options = ["geometry.cell=tetrahedron", "contact.0.quadrature_degree=9"]
    found = patch_errors((7, 3, 7), (6, 2, 5), options)
    assert 1e-6 < found.far < 0.005 and 1e-5 < found.near < 0.01


def test_errors_see_a_wrong_pressure():
    found = patch_errors((3, 2, 3), (3, 2, 3), ["boundary.1.pressure=1.1e5"])
    assert found.near == pytest.approx(0.1) and found.far == pytest.approx(0.1)
    assert found.pressure == pytest.approx(0.1)


def test_friction_follows_the_direction_of_sliding():
    quick = [*QUICK_BOXES, "stage.1.steps=8"]
    for angle in (0.3, -2.0):
        friction, normal = slide(angle, quick)
        way = np.array([np.cos(angle), 0.0, np.sin(angle)])
        assert normal == pytest.approx(0.5, rel=1e-5)
        np.testing.assert_allclose(friction, 0.2 * normal * way, rtol=0, atol=1e-5 * normal)


def test_before_all_slides_friction_is_less():
    friction, normal = slide(0.3, [*QUICK_BOXES, "stage.1.duration=0.2", "stage.1.steps=1"])
    assert np.linalg.norm(friction) < 0.15 * normal
