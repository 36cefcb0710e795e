"""Closest points on single facets of all shapes against samples."""

import numpy as np
import pytest

from tribox.geometry.surfaces.compiled_facets import CORNER, INTERIOR, Candidates, CompiledFacets
from tribox.geometry.surfaces.facets import FacetShape, Floats, facet_shape

SHAPES = [
    *(("interval", degree) for degree in (1, 2, 3)),
    *(("triangle", degree) for degree in (1, 2)),
    *(("quadrilateral", degree) for degree in (1, 2, 3)),
]


@pytest.fixture(params=SHAPES, ids=lambda kind: f"{kind[0]}{kind[1]}")
def shape(request):
    return facet_shape(*request.param)


def distances(shape: FacetShape, nodes: Floats, points: Floats, steps: int = 24) -> Floats:
    """Least distance (p,) of each point (p, i) from its own facet (p, a, i)."""
    line = [np.linspace(0.0, 1.0, steps + 1)] * shape.directions
    spread = np.stack(np.meshgrid(*line), axis=-1).reshape(-1, shape.directions)
    around = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 9)] * shape.directions), axis=-1)
    around = around.reshape(-1, shape.directions)
    place = _nearest(shape, nodes, points, np.broadcast_to(spread, (len(points), *spread.shape)))
    size = 1.0 / steps
    while size > 1e-9:
        place = _nearest(shape, nodes, points, place[:, None] + size * around)
        size *= 0.4
    found = np.einsum("pa,pai->pi", shape.values(place), nodes)
    out: Floats = np.linalg.norm(points - found, axis=1)
    return out


def _nearest(shape: FacetShape, nodes: Floats, points: Floats, xi: Floats) -> Floats:
    """Which (p, α) of places (p, s, α), put back into the domain, is nearest."""
    xi = np.clip(xi, 0.0, 1.0)
    if shape.cell == "triangle":
        xi = np.maximum(xi - 0.5 * np.maximum(xi.sum(axis=2, keepdims=True) - 1.0, 0.0), 0.0)
        xi = xi / np.maximum(xi.sum(axis=2, keepdims=True), 1.0)
    values = shape.values(xi.reshape(-1, xi.shape[2])).reshape(*xi.shape[:2], -1)
    apart = points[:, None] - values @ nodes
    best = np.argmin(np.einsum("psi,psi->ps", apart, apart), axis=1)
    out: Floats = xi[np.arange(len(xi)), best]
    return out


def warped(shape, rng, count, size):
    """Facets (count, a, i) of size one, turned at random and bent by about ``size``."""
    dim = shape.directions + 1
    flat = np.zeros((count, shape.count, dim))
    flat[..., :-1] = shape.points
    turn = np.linalg.qr(rng.normal(size=(count, dim, dim)))[0]
    bent = flat + size * rng.uniform(-1.0, 1.0, flat.shape)
    return np.einsum("pij,paj->pai", turn, bent)


def one_each(shape, facets, points):
    """Closest points of facets (q, a, i), each with its own point: ξ (q, α), entity (q,), x − ȳ."""
    count = len(points)
    own = np.arange(count, dtype=np.int32)
    among = Candidates(np.arange(count + 1), own, np.zeros(count), 0.0)
    facet, xi, entity = CompiledFacets(shape, count).closest(points, facets, among, 1e-12)
    np.testing.assert_array_equal(facet, own)
    return xi, entity, points - np.einsum("qa,qai->qi", shape.values(xi), facets)


@pytest.mark.parametrize("reach", [0.0, 0.03, 0.5, 30.0])
def test_the_distance_is_that_of_samples(shape, reach):
    """On the facet, near it, beside it and far away; and x − ȳ is across what the place is on."""
    rng = np.random.default_rng(5)
    facets = warped(shape, rng, 400, (0.2, 0.05, 0.02)[shape.degree - 1])
    given = rng.uniform(-0.3 if reach else 0.0, 1.3 if reach else 1.0, (400, shape.directions))
    if not reach and shape.cell == "triangle":
        given *= 0.5
    points = np.einsum("qa,qai->qi", shape.values(given), facets)
    points += reach * rng.uniform(-1.0, 1.0, points.shape)
    xi, entity, apart = one_each(shape, facets, points)
    distance = np.linalg.norm(apart, axis=1)
    np.testing.assert_allclose(distance, distances(shape, facets, points), rtol=1e-7, atol=1e-7)
    assert shape.excess(xi).max() <= 1e-10
    own = np.arange(400, dtype=np.int32)
    close = {"rtol": 1e-12, "atol": 1e-13}
    found = CompiledFacets(shape, 400).distances(points, facets, own, own)
    np.testing.assert_allclose(found, distance, **close)
    if not reach:
        np.testing.assert_allclose(xi, given, rtol=0, atol=1e-9)
        assert distance.max() < 1e-12 and (entity == INTERIOR).all()
        return
    inside, corner = entity == INTERIOR, entity >= CORNER
    edge = ~inside & ~corner
    assert corner.any() and (inside.any() or reach > 1.0)
    assert shape.directions == 1 or edge.any()
    np.testing.assert_allclose(xi[corner], shape.points[entity[corner] - CORNER], atol=1e-15)
    tangents = np.einsum("qba,qai->qbi", shape.first(xi), facets)
    slope = np.einsum("qbi,qi->qb", tangents, apart) / (1.0 + reach)
    np.testing.assert_allclose(slope[inside], 0.0, atol=1e-11)
    if edge.any():
        way = np.array([side.direction for side in shape.sides])[entity[edge]]
        off = xi[edge] - np.array([side.origin for side in shape.sides])[entity[edge]]
        np.testing.assert_allclose(np.einsum("qb,qb->q", slope[edge], way), 0.0, atol=1e-11)
        np.testing.assert_allclose(off[:, 0] * way[:, 1] - off[:, 1] * way[:, 0], 0.0, atol=1e-15)


def test_slivers(shape):
    """Facets a thousand times as long as wide."""
    flat = np.zeros((200, shape.count, shape.directions + 1))
    flat[..., :-1] = shape.points
    facets = flat @ np.diag([1000.0, *[1.0] * shape.directions])
    rng = np.random.default_rng(6)
    points = np.einsum(
        "qa,qai->qi", shape.values(rng.uniform(-0.3, 1.3, (200, shape.directions))), facets
    )
    points += 0.5 * rng.uniform(-1.0, 1.0, points.shape)
    xi, _, apart = one_each(shape, facets, points)
    if shape.cell != "triangle":
        expected = np.clip(points[:, :-1] / [1000.0, 1.0][: shape.directions], 0.0, 1.0)
        np.testing.assert_allclose(xi, expected, rtol=0, atol=1e-9)
    nearest = distances(shape, facets, points)
    assert (np.linalg.norm(apart, axis=1) <= nearest * (1.0 + 1e-9) + 1e-9).all()


def test_a_point_at_the_centre_of_curvature():
    """All of an arc is about equally near, and Newton's method has no convex minimum to go to."""
    shape = facet_shape("interval", 3)
    angle = 0.6 * (shape.points - 0.5)
    arc = np.stack([np.sin(angle), np.cos(angle)], axis=-1).reshape(1, -1, 2)
    points = np.array([[0.0, 0.0], [1e-9, 0.0], [0.0, -1e-6]])
    arcs = np.repeat(arc, 3, axis=0)
    found = np.linalg.norm(one_each(shape, arcs, points)[2], axis=1)
    np.testing.assert_allclose(found, distances(shape, arcs, points), rtol=1e-9)
