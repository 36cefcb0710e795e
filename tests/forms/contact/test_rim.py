"""Where a contact ends within a facet, and how much of its points' pieces is covered."""

from dataclasses import replace

import numpy as np
import pytest

from tests.contact_boxes import PENALTY, Scene
from tests.forms.contact.test_pressure import touching
from tests.laws import film_map
from tribox.forms.contact.pressure import _EARLY, PointwisePressure, _along_slope, rim_cover
from tribox.forms.contact.state import AS_IS, NormalContact

MODULUS, STEEP = 7.0, 1.3  # E*; k of the pressure k √d


def normal_of(surface, gap):
    """Contact with these mean gaps (v,) at its vertices."""
    vertices, active = surface.vertices, gap <= 0.0
    spring = np.where(active, -PENALTY * gap, 0.0)
    pressure = vertices.at_points(spring)
    closed = active[vertices.of_point].any(axis=1)
    return NormalContact(closed, pressure, pressure, gap, spring, active)


def cover_of(surface, gap, modulus=MODULUS):
    stiffness = np.full(surface.vertices.count, PENALTY)
    return rim_cover(surface, normal_of(surface, gap), stiffness, modulus)


def at_the_end(distance):
    """Mean gaps beside the end of a smooth contact, from signed distances, positive inside."""
    inside, outside = np.maximum(distance, 0.0), np.maximum(-distance, 0.0)
    gap = 4.0 * STEEP / (3.0 * MODULUS) * outside**1.5
    return np.where(distance > 0.0, -STEEP * np.sqrt(inside) / PENALTY, gap)


@pytest.mark.parametrize("place", [0.0, 0.02, 0.4, 0.77, 0.99])
@pytest.mark.parametrize("shape", ["Q4", "T6"])
def test_root_pressure_and_gap_give_the_exact_end(shape, place):
    """On the facet where the end is, pieces are covered up to it and a little further."""
    surface = touching(shape)[0].surface
    vertices, slave = surface.vertices, surface.slave
    low, high = np.unique(np.round(vertices.position[:, 0], 12))[2:4]
    size = high - low
    end = low + place * size
    distance = end - vertices.position[:, 0]
    distance[np.abs(distance) < 1e-9] = 0.0  # a vertex at the end itself just touches
    cover, _ = cover_of(surface, at_the_end(distance))
    here = np.abs(slave.position[:, 0] - 0.5 * (low + high)) < 0.5 * size
    piece = (slave.facet_length * slave.facet_share)[here]
    away = end - slave.position[here, 0] + _EARLY * size
    np.testing.assert_allclose(cover[here], np.clip(0.5 + away / piece, 0.0, 1.0), atol=1e-9)
    np.testing.assert_array_equal(cover[~here], 1.0)


@pytest.mark.parametrize("place", [0.0, 0.4, 0.9])
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("shape", ["hex8", "hex27"])
def test_the_exact_end_on_facets_in_space(shape, side, place):
    """A straight end beside one side of facets that are no squares: only the other side counts."""
    surface = touching(shape)[0].surface
    vertices, slave = surface.vertices, surface.slave
    turn = np.array([[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]])
    along, at = ((x[:, :2] @ turn.T)[:, side] for x in (vertices.position, slave.position))
    low, high = np.unique(np.round(along, 9))[1:3]
    size = high - low
    assert size == pytest.approx((0.1, 0.125)[side])
    distance = low + place * size - along
    distance[np.abs(distance) < 1e-8] = 0.0
    cover, _ = cover_of(surface, at_the_end(distance))
    here = np.abs(at - 0.5 * (low + high)) < 0.5 * size
    piece = size * np.sqrt(slave.facet_share[here])
    away = low + place * size - at[here] + _EARLY * size
    np.testing.assert_allclose(cover[here], np.clip(0.5 + away / piece, 0.0, 1.0), atol=1e-7)
    np.testing.assert_array_equal(cover[~here], 1.0)


@pytest.mark.parametrize("corners", [
    [[0, 0], [1, 0], [0, 1], [1, 1]],
    [[0, 0], [np.sqrt(2.0 / np.sqrt(3.0)), 0], np.sqrt([0.5 / np.sqrt(3.0), 1.5 / np.sqrt(3.0)])],
])  # fmt: skip
@pytest.mark.parametrize("longer", [1.0, 10.0])
def test_length_along_the_slope_of_the_gaps(corners, longer):
    """A square and an equilateral triangle, of length 1, are as long in all directions."""
    flat = np.array(corners, dtype=float)
    x = np.column_stack([longer * flat[:, 0], flat[:, 1], np.full(len(flat), 0.3)])
    for angle in (0.0, 0.4, 1.2, np.pi / 2):
        slope = np.array([np.cos(angle), np.sin(angle), 0.0])
        length, change = _along_slope(x[None], 3.0 + (x @ slope)[None], np.array([np.sqrt(longer)]))
        expected = np.hypot(longer * slope[0], slope[1])
        np.testing.assert_allclose(length, expected, rtol=1e-12)
        np.testing.assert_allclose(change.sum(), 0.0, atol=1e-12)
    level, change = _along_slope(x[None], np.zeros((1, len(x))), np.array([np.sqrt(longer)]))
    assert level[0] == np.sqrt(longer) and np.all(change == 0.0)


@pytest.mark.parametrize("shape", ["Q4", "T6", "tet4", "hex8"])
def test_derivatives_against_differences(shape):
    surface = touching(shape)[0].surface
    count, rng = surface.vertices.count, np.random.default_rng(5)
    felt, h = 0, 1e-7
    for _ in range(6):
        gap, way = rng.uniform(-0.02, 0.03, count), rng.normal(size=count)
        cover, slope = cover_of(surface, gap)
        sides = [cover_of(surface, gap + sign * h * way)[0] for sign in (1.0, -1.0)]
        expected = (sides[0] - sides[1]) / (2.0 * h)
        change = np.einsum("qk,qk->q", slope, way[surface.vertices.of_point])
        scale = np.abs(expected).max(initial=1.0)
        np.testing.assert_allclose(change, expected, rtol=0, atol=1e-6 * scale)
        assert np.all((cover >= 0.0) & (cover <= 1.0))
        felt += np.count_nonzero(slope.any(axis=1))
    assert felt > 3


def test_all_is_covered_where_there_is_no_rim():
    rule, at = touching("Q4")
    surface = rule.surface
    count = surface.vertices.count
    mixed = np.random.default_rng(2).uniform(-0.02, 0.03, count)
    for gap, modulus in (
        (np.full(count, -0.01), MODULUS),
        (np.full(count, 0.01), MODULUS),
        (mixed, None),
    ):
        cover, slope = cover_of(surface, gap, modulus)
        assert slope is None and np.all(cover == 1.0)
    assert (cover_of(surface, mixed)[0] < 1.0).any()
    points = 0.03 * np.sin(9.0 * surface.slave.position[:, 0])
    normal = PointwisePressure(surface, PENALTY).evaluate(replace(at, gap=points), AS_IS)
    cover, slope = rim_cover(surface, normal, np.ones(count), MODULUS)
    assert slope is None and np.all(cover == 1.0)


def test_vertices_that_only_touch_give_no_end():
    """Neither pressure nor opening says where it is: numbers stay finite all the same."""
    surface = touching("Q4")[0].surface
    gap = np.where(np.arange(surface.vertices.count) % 2 == 0, 0.0, 1e-300)
    cover, slope = cover_of(surface, gap)
    assert np.all(np.isfinite(cover)) and np.all((cover > 0.5) & (cover <= 1.0))
    assert slope is not None and np.all(np.isfinite(slope))


@pytest.mark.parametrize("modulus", [MODULUS, None])
def test_on_the_way_from_inside_a_film_covers_what_gaps_close(modulus):
    """All vertices press there, most of them by next to nothing: no film rubs on them."""
    surface = touching("Q4")[0].surface
    gap = np.random.default_rng(3).uniform(-0.02, 0.03, surface.vertices.count)
    exact, stiffness = normal_of(surface, gap), np.full(surface.vertices.count, PENALTY)
    every = np.ones_like(exact.closed), np.ones_like(exact.active)
    inside = replace(exact, closed=every[0], active=every[1])
    cover, slope = rim_cover(surface, inside, stiffness, modulus, only_met=True)
    wanted, wanted_slope = rim_cover(surface, exact, stiffness, modulus)
    assert 0.0 < np.mean(exact.closed) < 1.0 and np.all(cover[~exact.closed] == 0.0)
    np.testing.assert_array_equal(cover[exact.closed], wanted[exact.closed])
    np.testing.assert_equal(slope, wanted_slope)


def test_cover_of_points_that_leave_the_master():
    """What is covered of them counts by their share, and so do its derivatives."""
    scene = Scene("Q4", film_map(), degree=5, fine=True, film=0.5)
    surface, term = scene.surface, scene.term
    term.modulus = MODULUS
    gap = np.random.default_rng(2).uniform(-0.02, 0.03, surface.vertices.count)
    at = scene.residual(scene.moved(np.zeros_like))[1].projection
    share = np.linspace(0.2, 0.9, len(at.gap))
    whole, part = normal_of(surface, gap), normal_of(surface, gap)
    term.cover_rim(whole, at, linearise=True)
    term.cover_rim(part, replace(at, share=share), linearise=True)
    assert whole.cover_slope.any() and (whole.cover < 1.0).any()
    np.testing.assert_allclose(part.cover, share * whole.cover, rtol=1e-14)
    np.testing.assert_allclose(part.cover_slope, share[:, None] * whole.cover_slope, rtol=1e-14)
    scaled = normal_of(surface, gap)
    term.cover_rim(scaled, at, 0.1)
    assert scaled.cover_slope is None and not np.allclose(scaled.cover, whole.cover)
