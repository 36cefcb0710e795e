"""Facet shapes: nodes, derivatives, sides and the boundary of the reference domain."""

import dolfinx
import numpy as np
import pytest

from tests.grid import grid
from tribox.geometry.surfaces.body_facets import OuterFacets, displacement_facet, outward_facets
from tribox.geometry.surfaces.ends import EndDistance
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
    largest = np.abs(shape.values(xi[shape.excess(xi) <= 0.0])).sum(axis=1).max()
    assert largest <= shape.lebesgue + 1e-14
    assert largest >= 0.99 * shape.lebesgue


# -- Where named surfaces end on the boundary of their body: at its corners, or amid it ------------

CELLS = {2: ("triangle", "quadrilateral"), 3: ("tetrahedron", "hexahedron")}


def space_on(dim: int, cell: str, degree: int) -> dolfinx.fem.FunctionSpace:
    """A unit box of four cells to a side."""
    return dolfinx.fem.functionspace(grid(cell, [4] * dim), ("Lagrange", degree, (dim,)))


def top(space: dolfinx.fem.FunctionSpace, low: float, high: float) -> np.ndarray:
    """Nodes (f, a) of the facets on top of the box, from one x to another."""
    dim = space.mesh.topology.dim

    def inside(x: np.ndarray) -> np.ndarray:
        return np.isclose(x[dim - 1], 1.0) & (low <= x[0]) & (x[0] <= high)

    found = dolfinx.mesh.locate_entities_boundary(space.mesh, dim - 1, inside)
    return outward_facets(space, displacement_facet(space), found)[0].astype(np.int64)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("dim", "cell"), [(d, c) for d, cells in CELLS.items() for c in cells])
def test_a_surface_ends_smoothly_only_where_its_face_goes_on(dim, cell, degree):
    """Half of the top of a box; all of it; half of it, and the other half beside it."""
    space = space_on(dim, cell, degree)
    half, rest, whole = (top(space, *ends) for ends in ((-0.1, 0.6), (0.4, 1.1), (-0.1, 1.1)))
    outer = OuterFacets(space)
    assert len(outer.smooth_ends(whole, whole[:0])) == 0
    assert len(outer.smooth_ends(half, rest)) == 0
    ends = outer.smooth_ends(half, whole[:0])
    assert len(ends) == (1 if dim == 2 else 4)
    places = space.tabulate_dof_coordinates()[ends.reshape(-1)]
    assert np.allclose(places[:, 0], 0.5) and np.allclose(places[:, dim - 1], 1.0)


# -- Distances from the open end of a surface, and the share that counts there ---------------------

CHAIN = facet_shape("interval", 1)


def chain(count, closed=False):
    """A polygon of unit segments round a corner, (n, i), and its facets."""
    angle = np.arange(count + 1) * (2 * np.pi / count if closed else 0.4)
    steps = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    nodes = np.cumsum(steps, axis=0)[: count + (not closed)]
    row = np.arange(count)
    return nodes, np.stack([row, (row + 1) % len(nodes)], axis=1).astype(np.int32)


def test_the_way_is_measured_along_the_surface():
    nodes, facets = chain(7)
    end = EndDistance.measured(CHAIN, facets, nodes, np.isin(np.arange(8), [0, 7]), 2.5)
    assert np.allclose(end.corners, np.minimum(facets, 7 - facets))
    share, slope = end.share(np.array([0, 1, 2, 6]), np.array([[0.0], [0.25], [0.6], [0.5]]))
    s = np.array([0.0, 0.5, 1.0, 0.2])
    assert np.allclose(share, s**2 * (3 - 2 * s))
    assert np.allclose(slope[:, 0], [0.0, 1.5 / 2.5, 0.0, -0.96 / 2.5])


def test_a_surface_without_an_end_counts_in_full():
    nodes, facets = chain(6, closed=True)
    end = EndDistance.measured(CHAIN, facets, nodes, np.zeros(6, dtype=bool), 100.0)
    share, slope = end.share(np.arange(6), np.full((6, 1), 0.3))
    assert np.all(share == 1.0) and np.all(slope == 0.0)


def test_in_space_the_nearest_open_edge_counts():
    x, y = np.meshgrid(np.arange(4.0), np.arange(6.0), indexing="ij")
    nodes = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
    number = np.arange(24).reshape(4, 6)
    facets = np.stack(
        [number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]], axis=-1
    ).reshape(-1, 4)
    is_open = (x == 0) | (x == 3) | (y == 0) | (y == 5)
    end = EndDistance.measured(
        facet_shape("quadrilateral", 1), facets.astype(np.int32), nodes, is_open.ravel(), 0.5
    )
    expected = np.minimum(np.minimum(x, 3 - x), np.minimum(y, 5 - y)).ravel()
    assert np.allclose(end.corners, expected[facets])
    share, slope = end.share(np.array([2]), np.array([[0.2, 0.7]]))
    s = 0.2 / 0.5
    assert np.allclose(share, s**2 * (3 - 2 * s))
    assert np.allclose(slope, [[6 * s * (1 - s) / 0.5, 0.0]])


def test_a_surface_that_would_fade_everywhere_is_refused():
    nodes, facets = chain(4)
    with pytest.raises(ValueError, match=r"fade_length = 2\.5 m: no part of the master"):
        EndDistance.measured(CHAIN, facets, nodes, np.isin(np.arange(5), [0, 4]), 2.5)
