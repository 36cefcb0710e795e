"""Closest points on a polyline: against brute force, and where there is more than one case."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.projection import FacetSurface

SEGMENT = facet_shape("interval", 1)


def polyline(nodes, order=None):
    """A chain through ``nodes`` with the body to its right, its facets in the given order."""
    facets = np.stack([np.arange(len(nodes) - 1), np.arange(1, len(nodes))], axis=1)
    facets = facets.astype(np.int32)
    return FacetSurface(SEGMENT, facets if order is None else facets[order], np.asarray(nodes))


def project(line, points, nodes):
    points = np.atleast_2d(np.asarray(points, dtype=float))
    nodes = np.asarray(nodes, dtype=float)
    return line.project(points, nodes)


def distances(points, nodes):
    """Distance of every point from every segment, without any search, (q, f)."""
    start, tau = nodes[:-1], np.diff(nodes, axis=0)
    xi = np.einsum("qfi,fi->qf", points[:, None] - start, tau) / np.sum(tau**2, axis=1)
    foot = start + np.clip(xi, 0.0, 1.0)[..., None] * tau
    return np.linalg.norm(points[:, None] - foot, axis=2)


def check_nearest(line, points, nodes):
    at = project(line, points, nodes)
    noise = 1e-14 * max(1.0, np.abs(nodes).max())
    nearest = distances(points, nodes).min(axis=1)
    found = np.linalg.norm(points - at.foot, axis=1)
    np.testing.assert_allclose(found, nearest, rtol=1e-12, atol=noise)
    np.testing.assert_allclose(np.abs(at.gap[at.on_surface]), nearest[at.on_surface], atol=noise)
    apart = points - at.foot
    inside = at.on_surface
    np.testing.assert_allclose(
        apart[inside], (at.gap[:, None] * at.normal)[inside], rtol=0, atol=noise
    )
    np.testing.assert_allclose(np.linalg.norm(at.normal, axis=1), 1.0, rtol=1e-14)
    return at


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 40))
def test_closest_point_is_that_of_brute_force(seed, facets):
    """Rough but graph-like surfaces, points near them, facet numbers shuffled."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([[0.0], np.cumsum(0.2 + rng.random(facets))])
    nodes = np.stack([x, 0.2 * rng.normal(size=len(x))], axis=1)
    line = polyline(nodes, rng.permutation(facets))
    where = rng.uniform(0.0, x[-1], 50)
    height = np.interp(where, x, nodes[:, 1]) + rng.uniform(-0.1, 0.1, 50)
    check_nearest(line, np.stack([where, height], axis=1), nodes)


def test_gap_is_continuous_through_a_kink():
    """On a walk round a vertex, outside a ridge and inside a groove, gap and normal do not jump."""
    for bend in (-0.3, 0.3):
        nodes = np.array([[-1.0, bend], [0.0, 0.0], [1.0, bend]])
        side = 0.1 if bend < 0.0 else -0.1
        points = np.stack([np.linspace(-0.2, 0.2, 2001), np.full(2001, side)], axis=1)
        at = project(polyline(nodes), points, nodes)
        assert 0 < np.count_nonzero(at.clamped) < 1000
        assert np.abs(np.diff(at.gap)).max() < 2.1e-4
        assert np.abs(np.diff(at.normal, axis=0)).max() < 3e-3


def test_next_to_nothing_from_a_vertex_the_normal_is_the_mean():
    """The direction from the vertex to the point would be round-off there."""
    nodes = np.array([[-1.0, -1.0], [0.0, 0.0], [1.0, -1.0]])
    at = project(polyline(nodes), [[2e-15, 1e-14], [0.0, 1e-10]], nodes)
    assert at.clamped.all() and at.on_surface.all()
    np.testing.assert_allclose(at.normal, [[0.0, 1.0]] * 2, atol=1e-15)
    np.testing.assert_allclose(at.gap, [1e-14, 1e-10], rtol=0.03)


def test_no_contact_past_the_ends():
    nodes = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    points = [[-0.01, -0.1], [2.01, -0.1], [0.01, -0.1], [1.99, -0.1]]
    at = project(polyline(nodes), points, nodes)
    np.testing.assert_array_equal(at.on_surface, [False, False, True, True])
    np.testing.assert_allclose(at.gap[2:], -0.1, rtol=1e-14)


def test_two_separate_chains():
    """A master in two pieces: the gap between them has no surface."""
    nodes = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.5], [3.0, 0.5]])
    line = FacetSurface(SEGMENT, np.array([[2, 3], [0, 1]], dtype=np.int32), nodes)
    at = project(line, [[0.5, 0.1], [2.5, 0.1], [1.2, 0.0]], nodes)
    np.testing.assert_array_equal(at.facet, [1, 0, 1])
    np.testing.assert_allclose(at.gap[:2], [0.1, -0.4], rtol=1e-14)
    np.testing.assert_array_equal(at.on_surface, [True, True, False])
    assert line.neighbours.nnz == 2


def test_closed_chain_has_no_end():
    angle = -2.0 * np.pi * np.arange(12) / 12
    nodes = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    facets = np.stack([np.arange(12), (np.arange(12) + 1) % 12], axis=1).astype(np.int32)
    # Clockwise, the body lies to the right: inside.
    line = FacetSurface(SEGMENT, facets, nodes)
    points = np.random.default_rng(3).normal(size=(40, 2))
    at = project(line, points / np.linalg.norm(points, axis=1)[:, None] * 1.1, nodes)
    assert at.on_surface.all()
    assert (at.gap > 0.0).all()
    assert (line.neighbours.sum(axis=1) == 3).all()


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.sampled_from([0.05, 0.2, 0.4, 1.0]))
def test_closest_point_of_a_waved_smooth_line_is_that_of_samples(seed, facets, height):
    """Waves up to a facet high, and points up to five heights away on both sides."""
    found, sampled = found_and_sampled(seed, facets, height)
    assert np.all(found <= sampled + 1e-9)
    np.testing.assert_allclose(found, sampled, rtol=0.0, atol=1e-3 * max(1.0, 5.0 * height))


@pytest.mark.parametrize(("seed", "facets", "height"), [(76, 6, 1.0), (120, 12, 2.0)])
def test_points_beside_steep_waves_find_the_nearest_of_several_minima(seed, facets, height):
    """Between uneven nodes; from the nearest of five samples a facet they find a farther one."""
    found, sampled = found_and_sampled(seed, facets, height, (0.3, 1.7))
    assert np.all(found <= sampled + 1e-9)


def test_a_point_past_the_end_of_a_valley_stays_or_goes_as_its_own_wall_says():
    """Not to the opposite wall, where the facet has another nearest point, inside."""
    nodes = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, -1.0]])
    line = FacetSurface(facet_shape("interval", 2), np.array([[0, 1, 2]], dtype=np.int32), nodes)
    along, off = np.array([1.0, -4.0]) / np.sqrt(17.0), np.array([4.0, 1.0]) / np.sqrt(17.0)
    for past in (1e-5, 2e-3, 2e-2):
        point = (nodes[0] + 0.1 * off - past * along)[None]
        at = line.project(point, nodes, np.zeros(1, dtype=np.int32))
        assert np.linalg.norm(point - at.foot) == pytest.approx(0.1, rel=0.05)
        assert abs(at.xi[0, 0]) < 0.02


def found_and_sampled(seed, facets, height, spacing=(0.7, 1.3)):
    """Distances of points from a waved smooth line: projected, and from 1001 places a facet."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([[0.0], np.cumsum(rng.uniform(*spacing, facets))])
    nodes = np.stack([x, height * rng.uniform(-1.0, 1.0, len(x))], axis=1)
    order = np.arange(len(nodes), dtype=np.int32)
    line = FacetSurface(SEGMENT, np.stack([order[:-1], order[1:]], axis=1), nodes, np.pi)
    xi = np.tile(np.linspace(0.0, 1.0, 1001), facets)[:, None]
    places = line.places(np.repeat(order[:-1], 1001), xi, nodes)[0]
    points = np.stack([rng.uniform(0.0, x[-1], 40), rng.uniform(-5.0, 5.0, 40) * height], axis=1)
    found = np.linalg.norm(points - line.project(points, nodes).foot, axis=1)
    return found, cKDTree(places).query(points)[0]


def test_a_surface_for_other_points_has_the_same_shape_and_a_search_of_its_own():
    """Chords of this smooth arc lie .009 inside it."""
    angle = np.linspace(0.0, np.pi, 13)
    nodes = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    facets = np.stack([np.arange(12), np.arange(1, 13)], axis=1)
    surface = FacetSurface(facet_shape("interval", 1), facets, nodes, np.radians(30.0))
    own = surface.project(0.9 * nodes[3:5], nodes)
    other = surface.for_others().project(np.array([[0.0, 2.0], [0.6, 0.6], [0.0, 0.9]]), nodes)
    assert abs(np.abs(other.gap) - [1.0, 1.0 - 0.6 * np.sqrt(2.0), 0.1]).max() < 1e-3
    again = surface.project(0.9 * nodes[3:5], nodes)
    assert np.array_equal(again.facet, own.facet) and np.array_equal(again.gap, own.gap)
