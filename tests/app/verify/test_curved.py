"""Films and pressures over curved tools: the measures are right, and the checks can fail."""

import numpy as np
import pytest

from tribox.app.verify.curved import (
    BY_FORCE,
    SOFT,
    beyond_point,
    disc,
    film_drag,
    press_nodes,
    stages,
)

SHORT = stages(4, 4, 0.3e-3)
POINTWISE = 'contact.0.pressure="pointwise"'
R, A = 10e-3, 0.5e-3


def under_a_sphere(size: float, shift: float) -> np.ndarray:
    """Nodes of a square grid on the surface that Hertz's point contact leaves of a flat."""
    at = np.arange(-20, 21) * size
    x, z = (c.ravel() for c in np.meshgrid(at, at))
    r = np.hypot(x - shift, z)
    gap = A**2 / (np.pi * R) * beyond_point(np.maximum(r / A, 1.0))
    return np.stack([x, R - np.sqrt(R**2 - (x - shift) ** 2 - z**2) - gap, z], axis=1)


@pytest.mark.parametrize("shift", [0.0, 0.03e-3])
def test_the_circle_of_contact_is_found_from_coarse_nodes(shift):
    centre = np.array([shift, R, 0.0])
    assert disc(under_a_sphere(0.13e-3, shift), centre, R) == pytest.approx(A, rel=3e-3)


def test_no_circle_where_nothing_touches():
    with pytest.raises(ValueError, match="touch"):
        disc(np.array([[0.0, -1e-3, 0.0]]), np.array([0.0, R, 0.0]), R)


def test_the_drag_of_a_film_is_that_of_the_true_extent():
    film = film_drag(0.495, [SHORT])
    assert film.drag.mean() == pytest.approx(film.exact.mean(), rel=0.01)
    assert film.ripple < 0.005 and len(film.drag) == 3


@pytest.mark.long
def test_point_by_point_a_film_drags_too_little():
    """Only a few points of each facet touch where the rubber cannot follow the tool."""
    film = film_drag(0.495, [SHORT, POINTWISE])
    assert film.drag.mean() < 0.5 * film.exact.mean()


COARSE = (*SOFT, "geometry.contact_size=24 um", "geometry.block.contact_size=31 um")


def test_nodal_pressures_meet_hertz_under_a_force_from_first_touch():
    found = press_nodes("hertz-line", [*COARSE, *BY_FORCE])
    assert found.exact.load == pytest.approx(32.0, rel=1e-6)
    assert found.pressure.max() == pytest.approx(found.exact.peak, rel=0.015)
    assert found.apart(0.7) < 0.03


def test_a_pressure_that_is_wrong_is_seen():
    found = press_nodes("hertz-line", [*COARSE, "contact.0.penalty_factor=1e-4"])
    assert found.apart(0.9) > 0.1


def test_without_nodal_pressures_there_is_no_result():
    with pytest.raises(ValueError, match="nodal"):
        press_nodes(
            "hertz-line", [*COARSE, "stage.0.steps=4", POINTWISE, "bodies.elastomer.nu=0.45"]
        )
