"""Closest points on single facets of all shapes against dense sampling."""

import numpy as np
import pytest

from tests.geometry.surfaces.closest import closest_points
from tribox.geometry.surfaces.compiled_facets import CORNER, INTERIOR
from tribox.geometry.surfaces.facets import facet_shape, solve_small

KINDS = [(cell, degree) for cell in ("interval", "triangle", "quadrilateral") for degree in (1, 2)]


@pytest.fixture(params=KINDS, ids=lambda kind: f"{kind[0]}{kind[1]}")
def shape(request):
    return facet_shape(*request.param)


def warped(shape, rng, count, size=None):
    """Facets (count, a, i) of size one, turned at random and bent by about ``size``.

    Quadratic facets bent more would fold within the distance of the points.
    """
    size = (0.15 if shape.degree == 1 else 0.06) if size is None else size
    dim = shape.directions + 1
    flat = np.zeros((count, shape.count, dim))
    flat[..., :-1] = shape.points
    turn = np.linalg.qr(rng.normal(size=(count, dim, dim)))[0]
    bent = flat + size * rng.uniform(-1.0, 1.0, flat.shape)
    return np.einsum("pij,paj->pai", turn, bent)


def sampled(shape, nodes, points, steps=40):
    """Least distance (p,) to a fine grid of samples on the facet, and the grid's spacing."""
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, steps + 1)] * shape.directions), axis=-1)
    xi = grid.reshape(-1, shape.directions)
    xi = xi[shape.excess(xi) <= 1e-12]
    places = np.einsum("sa,pai->psi", shape.values(xi), nodes)
    return np.linalg.norm(points[:, None] - places, axis=2).min(axis=1), 1.0 / steps


def points_round(shape, rng, nodes, reach):
    """Points within about ``reach`` of the facets, all round and off their edges."""
    xi = rng.uniform(-0.3, 1.3, (len(nodes), shape.directions))
    foot = np.einsum("pa,pai->pi", facet_shape(shape.cell, 1).values(xi), nodes[:, : shape.corners])
    return foot + reach * rng.uniform(-1.0, 1.0, foot.shape)


@pytest.mark.parametrize("reach", [0.05, 0.5, 5.0])
def test_against_samples(shape, reach):
    rng = np.random.default_rng(3)
    nodes = warped(shape, rng, 200)
    points = points_round(shape, rng, nodes, reach)
    at = closest_points(shape, nodes, points)
    distance = np.sqrt(at.squared)
    found = np.einsum("pa,pai->pi", shape.values(at.xi), nodes)
    np.testing.assert_allclose(np.linalg.norm(points - found, axis=1), distance, rtol=1e-12)
    assert shape.excess(at.xi).max() <= 1e-10
    around, spacing = sampled(shape, nodes, points)
    assert (distance <= around + 1e-12).all()
    # Samples lie within a spacing of the closest point: they are a little further away only.
    assert (around <= distance + 1.5 * spacing).all()


def test_entities_name_where_the_point_is(shape):
    rng = np.random.default_rng(4)
    nodes = warped(shape, rng, 300)
    points = points_round(shape, rng, nodes, 0.3)
    at = closest_points(shape, nodes, points)
    inside = at.entity == INTERIOR
    corner = at.entity >= CORNER
    assert inside.any() and corner.any()
    np.testing.assert_allclose(
        at.xi[corner], shape.points[at.entity[corner] - CORNER], rtol=0, atol=1e-15
    )
    apart = points - np.einsum("pa,pai->pi", shape.values(at.xi), nodes)
    tau = np.einsum("pba,pai->pbi", shape.first(at.xi), nodes)
    slope = np.einsum("pbi,pi->pb", tau, apart)
    np.testing.assert_allclose(slope[inside], 0.0, atol=1e-12)
    edge = ~inside & ~corner
    if shape.directions == 1:
        assert not edge.any()
        return
    assert edge.any()
    directions = np.array([side.direction for side in shape.sides])[at.entity[edge]]
    np.testing.assert_allclose(np.einsum("pb,pb->p", slope[edge], directions), 0.0, atol=1e-12)
    origins = np.array([side.origin for side in shape.sides])[at.entity[edge]]
    away = at.xi[edge] - origins
    cross = away[:, 0] * directions[:, 1] - away[:, 1] * directions[:, 0]
    np.testing.assert_allclose(cross, 0.0, atol=1e-15)


def test_points_on_the_facet_are_their_own_closest(shape):
    rng = np.random.default_rng(5)
    nodes = warped(shape, rng, 200)
    xi = rng.dirichlet(np.ones(3), 200)[:, : shape.directions]
    points = np.einsum("pa,pai->pi", shape.values(xi), nodes)
    at = closest_points(shape, nodes, points)
    np.testing.assert_allclose(at.xi, xi, rtol=0, atol=1e-9)
    np.testing.assert_allclose(at.squared, 0.0, atol=1e-24)
    assert (at.entity == INTERIOR).all()


def test_slivers(shape):
    """Facets a thousand times as long as wide."""
    rng = np.random.default_rng(6)
    nodes = warped(shape, rng, 200, size=0.0)
    dim = nodes.shape[2]
    stretch = np.diag([1000.0, *[1.0] * (dim - 1)])
    flat = np.zeros((200, shape.count, dim))
    flat[..., :-1] = shape.points
    nodes = flat @ stretch
    points = points_round(shape, rng, nodes, 0.5)
    at = closest_points(shape, nodes, points)
    clipped = np.clip(points[:, :-1] / np.diag(stretch)[:-1], 0.0, 1.0)
    if shape.cell != "triangle":
        np.testing.assert_allclose(at.xi, clipped, rtol=0, atol=1e-9)
    around, _ = sampled(shape, nodes, points, steps=50)
    assert (np.sqrt(at.squared) <= around + 1e-9).all()


def test_no_facets(shape):
    none = closest_points(
        shape, np.empty((0, shape.count, shape.directions + 1)), np.empty((0, shape.directions + 1))
    )
    assert none.xi.shape == (0, shape.directions) and none.squared.shape == (0,)


@pytest.mark.parametrize("size", [1, 2])
def test_small_systems(size):
    rng = np.random.default_rng(7)
    matrix, right = rng.normal(size=(9, size, size)), rng.normal(size=(9, size))
    expected = np.linalg.solve(matrix, right[..., None])[..., 0]
    np.testing.assert_allclose(solve_small(matrix, right), expected, rtol=1e-10)
