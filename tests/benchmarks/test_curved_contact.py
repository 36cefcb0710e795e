"""Contact over curved tools: the measures are right, and films and pressures meet closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.curved_contact import film, pressed
from benchmarks.curved_contact.runs import STRESS
from benchmarks.curved_contact.surfaces import (
    Photographer,
    beyond_line,
    beyond_point,
    disc,
    extent,
    half_width,
    slip_integral,
)
from benchmarks.verify.result import solve
from benchmarks.verify.space import held

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


# --- in space ------------------------------------------------------------------------------------

SPHERE = 10e-3


def under_a_sphere(size: float, shift: float) -> np.ndarray:
    """Nodes of a square grid on the surface that Hertz's point contact leaves of a flat."""
    at = np.arange(-20, 21) * size
    x, z = (c.ravel() for c in np.meshgrid(at, at))
    r = np.hypot(x - shift, z)
    gap = A**2 / (np.pi * SPHERE) * beyond_point(np.maximum(r / A, 1.0))
    return np.stack([x, SPHERE - np.sqrt(SPHERE**2 - (x - shift) ** 2 - z**2) - gap, z], axis=1)


@pytest.mark.parametrize("shift", [0.0, 0.03e-3])
def test_the_circle_of_contact_is_found_from_coarse_nodes(shift):
    centre = np.array([shift, SPHERE, 0.0])
    assert disc(under_a_sphere(0.13e-3, shift), centre, SPHERE) == pytest.approx(A, rel=3e-3)


def test_no_circle_where_nothing_touches():
    with pytest.raises(ValueError, match="touch"):
        disc(np.array([[0.0, -1e-3, 0.0]]), np.array([0.0, SPHERE, 0.0]), SPHERE)


OVER_A_SPHERE = (
    'geometry.part="half"',
    'geometry.contact_width="2 mm"',
    'geometry.contact_size="200 um"',
    'geometry.block={radius="5 mm", height="5 mm"}',
    'bodies.elastomer={material="hencky", E="70 GPa", nu=0.33}',
    'bodies.aluminium={material="neo-hookean", E="10 MPa", nu=0.495}',
    'contact.0.film={thickness="250 nm"}',
    'contact.0.friction={law="friction-map", mu_s=0.1, K_T="1e11 Pa/m", alpha=1.0, '
    f'eta_b={STRESS * 250e-9 / 1e-3}, D_max="250 nm", V_star="1 mm/s", V_star_at="250 nm"}}',
    'contact.0.smoothing_angle="30 deg"',
    'contact.0.slave="aluminium_contact"',
    'contact.0.master="elastomer_contact"',
    f"boundary=[{held('top', 'displacement={x=0, y=0, z=0}')}, "
    + held("bottom", 'displacement={x="driven", y=[["0 s", 0], ["1 s", "30 um"]], z=0}')
    + f", {held('elastomer_symmetry_z', 'displacement={z=0}')}, "
    f"{held('aluminium_symmetry_z', 'displacement={z=0}')}]",
    'stage=[{name="press", duration=1, steps=2, rate_dependent=false}, '
    '{name="slide", velocity=1e-3, duration=0.09, steps=3}]',
)


@pytest.mark.long
def test_the_drag_of_a_film_under_a_sphere_is_that_of_the_circle_it_covers():
    observer = Photographer()
    solve("sphere-on-block", OVER_A_SPHERE, observer)
    slid = [frame for frame in observer.frames if frame.row.stage == "slide"]
    centre = np.array([0.0, SPHERE, 0.0])
    radius = np.array([disc(f.nodes["aluminium_contact"], centre, SPHERE) for f in slid])
    drag = np.array([2.0 * abs(f.row.friction_x) for f in slid])
    assert len(slid) == 3
    assert drag == pytest.approx(STRESS * np.pi * radius**2, rel=0.03)


# --- in the plane --------------------------------------------------------------------------------


def test_the_drag_of_a_film_is_that_of_the_true_extent(tmp_path):
    found = film.row(replace(film.QUICK, slide=0.3, nu=0.495), tmp_path)
    assert found["T/∫ηv/D"] == pytest.approx(1.0, abs=0.01) and found["ripple std %"] < 0.5


def meets_hertz(found: dict) -> bool:
    """Whether nodal pressures are Hertz's: 1.5 % of the largest, 3 % of p0 at any within 0.9 a."""
    assert found["worst of"] == "nodes"
    return abs(found["p max %"]) < 1.5 and found["worst %"] < 3.0 and abs(found["a fit %"]) < 1.0


def test_nodal_pressures_meet_hertz_under_a_force_from_first_touch(tmp_path):
    found = pressed.row(replace(pressed.BASE, by="force"), tmp_path)
    assert found["load N"] == pytest.approx(65.0, rel=1e-6)
    assert meets_hertz(found) and abs(found["a surface %"]) < 1.0


def test_a_pressure_that_is_wrong_is_seen(tmp_path):
    soft = ("contact.0.penalty_factor=5e-3",)
    assert not meets_hertz(pressed.row(pressed.BASE, tmp_path, soft))
