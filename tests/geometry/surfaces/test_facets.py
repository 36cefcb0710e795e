"""Facet shapes: nodes, derivatives, sides and the boundary of the reference domain."""

import numpy as np
import pytest

from tribox.geometry.surfaces.facets import facet_shape

KINDS = [(cell, degree) for cell in ("interval", "triangle", "quadrilateral") for degree in (1, 2)]
KINDS += [("interval", 3), ("quadrilateral", 3)]
RNG = np.random.default_rng(0)


@pytest.fixture(params=KINDS, ids=lambda kind: f"{kind[0]}{kind[1]}")
def shape(request):
    return facet_shape(*request.param)


def test_each_function_is_one_at_its_node_and_zero_at_the_others(shape):
    np.testing.assert_allclose(shape.values(shape.points), np.eye(shape.count), atol=2e-13)


def test_polynomials_of_the_degree_are_reproduced(shape):
    def polynomial(xi):
        x = np.column_stack([xi, np.zeros(len(xi))])[:, :2]
        square = shape.degree >= 2
        return 1.0 - 2.0 * x[:, 0] + x[:, 1] + square * (x[:, 0] ** 2 + 3.0 * x[:, 0] * x[:, 1])

    xi = RNG.uniform(-0.2, 1.2, (7, shape.directions))
    np.testing.assert_allclose(shape.values(xi) @ polynomial(shape.points), polynomial(xi))


def test_derivatives_against_differences(shape):
    xi, h = RNG.uniform(0.1, 0.6, (5, shape.directions)), 1e-5
    for alpha, step in enumerate(h * np.eye(shape.directions)):
        first = (shape.values(xi + step) - shape.values(xi - step)) / (2.0 * h)
        np.testing.assert_allclose(shape.first(xi)[:, alpha], first, atol=1e-9)
        second = (shape.first(xi + step) - shape.first(xi - step)) / (2.0 * h)
        np.testing.assert_allclose(shape.second(xi)[:, alpha], second, atol=1e-9)


def test_excess_over_the_domain(shape):
    assert shape.excess(shape.points).max() <= 1e-15
    assert shape.excess(shape.points.mean(axis=0)) < -0.1
    assert shape.excess(np.full(shape.directions, -0.25)) == pytest.approx(0.25)
    assert shape.excess(np.full(shape.directions, 1.25)) >= 0.25 - 1e-15
    beyond = np.full(2, 0.75)[: shape.directions]
    assert (shape.excess(beyond) > 0.0) == (shape.cell == "triangle")


def test_bound_on_the_sum_of_the_functions(shape):
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 41)] * shape.directions), axis=-1)
    xi = grid.reshape(-1, shape.directions)
    inside = xi[shape.excess(xi) <= 0.0]
    largest = np.abs(shape.values(inside)).sum(axis=1).max()
    assert largest <= shape.lebesgue + 1e-14
    assert largest >= 0.99 * shape.lebesgue
