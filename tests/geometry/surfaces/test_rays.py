"""Hits of rays on a polyline or a curved one, from any start; its kinks."""

import numpy as np
import pytest

from tribox.geometry.surfaces.facet_search import RaySearch
from tribox.geometry.surfaces.facets import facet_shape

LINE = facet_shape("interval", 1)
CURVE = facet_shape("interval", 2)


def chain(count, degree=1):
    """Facets (f, a) of a chain: ends, then the node between."""
    ends = np.arange(count + 1)
    facets = np.stack([ends[:-1], ends[1:]], axis=1)
    if degree == 2:
        facets = np.concatenate([facets, count + 1 + np.arange(count)[:, None]], axis=1)
    return facets.astype(np.int32)


def search(nodes, order=None):
    facets = chain(len(nodes) - 1)
    facets = facets if order is None else facets[order]
    return RaySearch(LINE, facets, nodes[facets]), nodes[facets]


def hits(rays, controls, points, normals, start, xi=0.5):
    points, normals = np.atleast_2d(points), np.atleast_2d(np.asarray(normals, dtype=float))
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    start = np.broadcast_to(np.asarray(start, dtype=np.int32), len(points))
    return rays.hits(points, normals, controls, start, np.full((len(points), 1), xi))


def turning(angles):
    """A chain of facets of length 1 with these directions, in degrees."""
    way = np.radians(np.asarray(angles, dtype=float))
    steps = np.stack([np.cos(way), np.sin(way)], axis=1)
    return np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])


@pytest.mark.parametrize(
    ("angles", "kinked"),
    [
        ([0.0, 2.9, 5.8], False),
        ([0.0, 3.1, 3.1], True),
        ([0.0, 0.0, -3.1], True),
        (np.arange(0.0, 180.0, 2.0), False),  # its first and last facet are not neighbours
        ([10.0], False),
    ],
)
def test_kinks_are_angles_between_neighbours(angles, kinked):
    nodes = turning(angles)
    order = np.random.default_rng(0).permutation(len(angles))
    assert search(nodes, order)[0].has_kinks is kinked


def test_a_curved_facet_is_no_kink():
    """Its own ends differ by more than neighbours may: only tangents where facets meet count."""
    angle = np.linspace(0.0, np.pi, 5)
    ends, middles = np.cos(angle), np.cos(0.5 * (angle[1:] + angle[:-1]))
    x = -np.concatenate([ends, middles])
    nodes = np.stack([x, 0.02 * (1.0 - x**2)], axis=1)
    facets = chain(4, 2)
    assert not RaySearch(CURVE, facets, nodes[facets]).has_kinks


@pytest.mark.parametrize("degree", [1, 2])
def test_hits_are_those_of_brute_force_from_any_start(degree):
    """Rough surfaces with facets in any order; the point of the facet is on the ray."""
    rng = np.random.default_rng(3)
    count, shape = 12, LINE if degree == 1 else CURVE
    x = np.cumsum(np.append(0.0, rng.uniform(0.5, 1.5, count)))
    facets = chain(count, degree)
    nodes = np.stack([x, rng.uniform(-0.2, 0.2, count + 1)], axis=1)
    if degree == 2:
        middle = 0.5 * (nodes[1:] + nodes[:-1]) + rng.uniform(-0.05, 0.05, (count, 2))
        nodes = np.concatenate([nodes, middle])
    facets = facets[rng.permutation(count)]
    rays, controls = RaySearch(shape, facets, nodes[facets]), nodes[facets]
    assert rays.has_kinks
    number, xi = rng.integers(0, count, 60), rng.uniform(0.02, 0.98, (60, 1))
    foot = np.einsum("qa,qai->qi", shape.values(xi), controls[number])
    normals = np.stack([rng.uniform(-0.3, 0.3, 60), np.ones(60)], axis=1)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    points = foot + rng.uniform(-0.1, 0.1, 60)[:, None] * normals
    start, place = rng.integers(0, count, 60).astype(np.int32), rng.random((60, 1))
    given = start.copy(), place.copy()
    facet, found, met = rays.hits(points, normals, controls, start, place)
    assert met.all()
    np.testing.assert_array_equal(facet, number)
    np.testing.assert_allclose(found, xi, rtol=0, atol=1e-11)
    np.testing.assert_array_equal(start, given[0])
    np.testing.assert_array_equal(place, given[1])


def test_rays_past_the_ends_meet_nothing():
    rays, controls = search(turning([0.0, 20.0, 0.0]))
    x, y = turning([0.0, 20.0, 0.0])[-1]
    points = np.array([[-0.1, 0.3], [0.1, 0.3], [x + 0.1, y + 0.3], [x - 0.1, y + 0.3]])
    facet, xi, met = hits(rays, controls, points, [[0.0, 1.0]] * 4, [2, 2, 0, 0])
    np.testing.assert_array_equal(met, [False, True, False, True])
    np.testing.assert_array_equal(facet, [0, 0, 2, 2])
    np.testing.assert_allclose(xi[:, 0], [0.0, 0.1, 1.0, 0.9], atol=1e-12)


@pytest.mark.parametrize(("cosine", "meets"), [(0.06, True), (0.04, False), (-0.5, False)])
def test_rays_that_graze_a_facet_or_come_from_behind_meet_nothing(cosine, meets):
    rays, controls = search(0.1 * turning([0.0]))
    slope = np.sqrt(1.0 - cosine**2)
    normal = np.array([slope, cosine])  # its t, to the right of it, is at this cosine
    facet, xi, met = hits(rays, controls, np.array([0.04, 0.0]) + 0.02 * normal, normal, 0)
    assert met[0] == meets and facet[0] == 0
    assert xi[0, 0] == pytest.approx(0.4 if meets else 0.5, rel=1e-9)


@pytest.mark.parametrize(("away", "meets"), [(40, True), (60, False)])
def test_a_hit_far_from_the_start_is_given_up(away, meets):
    rays, controls = search(np.stack([np.arange(101.0), np.zeros(101)], axis=1))
    assert hits(rays, controls, [away + 10.5, 0.1], [0.0, 1.0], 10)[2][0] == meets
