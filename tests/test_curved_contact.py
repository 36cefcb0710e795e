"""The measures of contact over curved tools: extent from the free surface, slip, choice of rows."""

import numpy as np
import pytest

from tribox.app.verify.curved import beyond_line, beyond_point, extent, half_width, slip_integral

RADIUS, A = 5e-3, 0.5e-3


def surfaces(size: float, middle: float, comb: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A parabola and the flat that it touches over 2 A; the flat's nodes hang by up to ``comb``."""
    tool = np.arange(-1.5e-3, 1.5e-3, 1.3 * size)
    x = np.arange(-2e-3, 2e-3, size)
    rho = np.maximum(np.abs(x - middle) / A, 1.0)
    gap = 0.5 * A**2 / RADIUS * beyond_line(rho)
    gap += np.where(rho == 1.0, comb * (np.arange(len(x)) % 3), 0.0)
    height = 0.5 * (x - middle) ** 2 / RADIUS - gap
    return np.stack([x, height], 1), np.stack([tool + middle, 0.5 * tool**2 / RADIUS], 1)


@pytest.mark.parametrize("size", [2e-5, 8e-5])
def test_extent_is_found_within_a_hundredth_of_a_facet(size):
    """Wherever the ends lie in their facets, and though nodes inside hang free."""
    for middle in np.linspace(0.0, size, 5):
        rubber, tool = surfaces(size, middle, comb=1e-7)
        found = extent(rubber, tool, rubber, RADIUS)
        assert found.half_width == pytest.approx(A, abs=1e-2 * size)
        assert 0.5 * (found.left + found.right) == pytest.approx(middle, abs=1e-2 * size)
        assert found.length == pytest.approx(2.0 * A, rel=5e-3)


def test_surfaces_apart_have_no_extent():
    rubber, tool = surfaces(4e-5, 0.0)
    with pytest.raises(ValueError, match="do not touch"):
        extent(rubber - np.array([0.0, 1e-3]), tool, rubber, RADIUS)


def test_half_width_of_a_point_contact():
    r = np.arange(0.0, 2e-3, 4e-5)
    gap = A**2 / (np.pi * RADIUS) * beyond_point(np.maximum(r / A, 1.0))
    tool = np.stack([r, 0.5 * r**2 / RADIUS], 1)
    found = half_width(tool - np.stack([0.0 * r, gap], 1), tool, RADIUS, beyond_point)
    assert found == pytest.approx(A, rel=1e-3)


def test_slip_is_faster_where_the_surface_is_stretched():
    """In a steady slide the points of a surface stretched by λ pass the tool at λV."""
    rubber, tool = surfaces(4e-5, 0.0)
    found, dt, step, stretch = extent(rubber, tool, rubber, RADIUS), 0.1, 1e-6, 1.02
    along = np.array([step, 0.0])
    back = rubber - np.array([(1.0 - stretch) * step, 0.0])
    slip = slip_integral((rubber, tool), (back, tool - along), found, dt)
    assert slip == pytest.approx(stretch * step / dt * 2.0 * A, rel=1e-3)
