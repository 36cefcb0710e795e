"""Verification on flat surfaces in space: the checks see what they are made for."""

import numpy as np
import pytest

from benchmarks.verify.space import (
    QUICK_BOXES,
    SECTION,
    hertz_point,
    patch_errors,
    press_sphere,
    slide,
    sphere_twist,
)


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


# -- The sphere on a block, coarse: closed forms are met, and the checks can fail ------------------

COARSE = ("geometry.contact_size=52 um", "geometry.contact_width=0.78 mm", "geometry.growth=2")


def test_section_meets_hertz():
    found = press_sphere([*SECTION, "geometry.contact_size=32.5 um"])
    radius, peak = found.fitted
    assert radius == pytest.approx(found.exact.contact_radius, rel=0.02)
    assert peak == pytest.approx(found.exact.peak, rel=0.01)


def test_a_coarse_quarter_meets_the_section():
    """Five elements over the radius give load, energy and peak; too few for the radius."""
    quarter = press_sphere(["stage.0.steps=1", *COARSE])
    section = press_sphere([*SECTION, *COARSE[1:]])
    assert quarter.exact.load == pytest.approx(section.exact.load, rel=0.02)
    assert quarter.energy == pytest.approx(section.energy, rel=0.03)
    assert quarter.fitted[1] == pytest.approx(quarter.exact.peak, rel=0.02)


def test_checks_of_the_point_contact_can_fail():
    coarse = ("geometry.contact_size=130 um", "geometry.contact_width=1.05 mm", "geometry.growth=2")
    found = hertz_point(coarse)
    failed = {check.quantity for check in found.checks if not check.passed}
    assert {"quarter: radius a", "section: radius a"} <= failed
    assert len(found.checks) == 8 and len(found.panels[0].lines) == 3
    assert [check.bar for check in found.checks] == [0.03] * 4 + [0.02] * 4


def test_contact_beyond_the_fine_zone_is_no_result():
    with pytest.raises(ValueError, match="contact_width"):
        press_sphere([*SECTION, "geometry.contact_width=0.5 mm"])


@pytest.mark.long
def test_twist_goes_over_into_full_slip():
    found = sphere_twist(["geometry.contact_size=80 um"])
    last = found.checks[-3:]
    assert max(check.error for check in found.checks) < 0.05  # three elements over the radius
    assert [check.quantity for check in last][1:] == [
        "last moment, 3π/16 µPa",
        "friction force / normal force, max",
    ]
    assert all(check.passed for check in last)
    moments = found.panels[0].lines[1].y
    assert np.all(np.diff(moments) > 0.0) and moments[0] < 0.5 < 0.97 < moments[-1] < 1.0
