"""Closest points on surfaces of curved segments and of facets in space."""

import numpy as np
import pytest

from tests.geometry.surfaces.closest import nearest
from tests.geometry.surfaces.searched import pairs
from tribox.geometry.surfaces.facets import facet_shape, unit_normals
from tribox.geometry.surfaces.projection import OVERRUN, FacetSurface

SPACE = [("triangle", 1), ("quadrilateral", 1), ("triangle", 2), ("quadrilateral", 2)]
ALL = [("interval", 2), *SPACE]
SMOOTH = [("interval", 1, 0.8), ("quadrilateral", 1, 0.8)]


def ids(kind):
    return "".join(str(part) for part in kind)


def hilly(*x):
    return 0.1 * np.sin(4.0 * x[0]) * np.cos(3.0 * x[-1] + 0.5)


def surface_of(sheet, kind, count, height=hilly):
    count = count[: 1 if kind[0] == "interval" else 2]
    shape, facets, nodes = sheet(*kind[:2], count, height)
    return FacetSurface(shape, facets, nodes, *kind[2:]), nodes


def every_facet(surface, points, nodes):
    controls = nodes[surface.stencil]
    if surface.extraction is not None:
        controls = surface.extraction @ controls
    return nearest(surface.shape, controls, points)


def check(surface, points, nodes):
    """Nearest of all facets, with consistent geometry; returns the projection."""
    at = surface.project(points, nodes)
    apart = points - at.foot
    np.testing.assert_allclose(
        np.linalg.norm(apart, axis=1), every_facet(surface, points, nodes), rtol=1e-10, atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.norm(at.normal, axis=1), 1.0, rtol=1e-13)
    np.testing.assert_allclose(apart, at.gap[:, None] * at.normal, rtol=0, atol=1e-10)
    return at


@pytest.mark.parametrize("kind", [*ALL, *SMOOTH], ids=ids)
def test_nearest_of_all_facets(sheet, kind):
    surface, nodes = surface_of(sheet, kind, (6, 5))
    rng = np.random.default_rng(1)
    dim = nodes.shape[1]
    points = rng.uniform(-0.1, 1.1, (150, dim))
    points[:, -1] = 0.5 * points[:, -1] - 0.25
    for beside in (nodes, nodes + 1e-3 * np.eye(dim)[-1]):  # several facets are equally near
        check(surface, beside, nodes)
    at = check(surface, points, nodes)
    assert at.clamped.any() and not at.clamped.all()
    assert at.on_surface.any() and not at.on_surface.all()


@pytest.mark.parametrize("kind", ALL, ids=ids)
def test_deformed_and_turned(sheet, kind):
    surface, nodes = surface_of(sheet, kind, (6, 5))
    rng = np.random.default_rng(2)
    dim = nodes.shape[1]
    turn = np.linalg.qr(rng.normal(size=(dim, dim)))[0]
    turn[0] *= np.sign(np.linalg.det(turn))
    bent = nodes + 0.02 * rng.normal(size=nodes.shape)
    points = bent[rng.integers(0, len(nodes), 80)] + 0.1 * rng.normal(size=(80, dim))
    one = check(surface, points, bent)
    other = check(surface, points @ turn.T + 5.0, bent @ turn.T + 5.0)
    np.testing.assert_allclose(other.gap, one.gap, rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.normal, one.normal @ turn.T, rtol=0, atol=1e-7)


@pytest.mark.parametrize("kind", ALL, ids=ids)
def test_side_of_the_surface(sheet, kind):
    """Above a surface without overhang the gap is positive, below it negative, also at kinks."""
    surface, nodes = surface_of(sheet, kind, (7, 5))
    xi = np.random.default_rng(3).uniform(0.15, 0.85, (400, nodes.shape[1] - 1))
    foot = np.column_stack([xi, np.zeros(400)])
    for side in (1.0, -1.0):
        at = surface.project(foot + 0.17 * side * np.eye(foot.shape[1])[-1], nodes)
        assert at.on_surface.all()
        assert (side * at.gap > 0.0).all()
        assert at.clamped.any() or kind[1] == 2


@pytest.mark.parametrize("kind", SPACE, ids=ids)
def test_past_the_end_there_is_no_contact(sheet, kind):
    surface, nodes = surface_of(sheet, kind, (4, 3), lambda x, y: 0.0 * x)
    inside = np.array([[0.01, 0.5, -0.1], [0.5, 0.99, -0.1], [0.99, 0.01, -0.1]])
    outside = np.array([[-0.01, 0.5, -0.1], [0.5, 1.01, -0.1], [1.01, -0.01, -0.1]])
    assert surface.project(inside, nodes).on_surface.all()
    assert not surface.project(outside, nodes).on_surface.any()


@pytest.mark.parametrize("kind", SPACE, ids=ids)
def test_over_the_seams_of_a_plane_nothing_is_clamped(sheet, kind):
    """Points over edges and corners of a flat surface, to round-off: none is lost, none sticks."""
    surface, nodes = surface_of(sheet, kind, (4, 3), lambda x, y: 0.3 * x + 0.1 * y)
    xi = np.concatenate([nodes[:, :2], 0.5 * (nodes[:-1, :2] + nodes[1:, :2])])
    xi = xi[(np.abs(xi - 0.5) < 0.45).all(axis=1)]
    n = np.array([-0.3, -0.1, 1.0]) / np.sqrt(1.1)
    # Next to a seam both facets are equally near: the one that holds the point inside counts.
    for gap, beside in ((0.01, 0.0), (-0.01, 0.0), (0.0, 0.0), (0.01, 2e-9), (-0.01, -3e-9)):
        xi = xi + beside * np.array([1.0, 0.7])
        points = np.column_stack([xi, xi @ [0.3, 0.1]]) + gap * n
        at = surface.project(points, nodes)
        assert not at.clamped.any() and at.on_surface.all()
        np.testing.assert_allclose(at.gap, gap, rtol=0, atol=1e-15)
        np.testing.assert_allclose(at.normal, np.broadcast_to(n, at.normal.shape), atol=1e-12)


@pytest.mark.parametrize("kind", [("interval", 1), *ALL], ids=ids)
def test_a_point_may_be_frozen_on_its_facet_just_past_an_edge(sheet, kind):
    """As if the facet continued; not further than ``OVERRUN``."""
    surface, nodes = surface_of(sheet, kind, (6, 5))
    rng = np.random.default_rng(8)
    dim = nodes.shape[1]
    points = rng.uniform(0.2, 0.8, (4000, dim))
    points[:, -1] = hilly(*points[:, :-1].T) - 1e-3
    usual = surface.project(points, nodes)
    again = surface.project(points, nodes, usual.facet)
    np.testing.assert_array_equal(again.facet, usual.facet)
    np.testing.assert_allclose(again.xi[~usual.clamped], usual.xi[~usual.clamped], atol=1e-11)

    for past, stays in ((0.5 * OVERRUN, True), (2.0 * OVERRUN, False)):
        edge = np.array([[0.5, -past]] if dim == 3 else [[-past]])
        facet = np.arange(len(surface.facets), dtype=np.int32)
        inside = surface.shape.values(np.broadcast_to(edge, (len(facet), dim - 1)))
        slope = surface.shape.first(np.broadcast_to(edge, (len(facet), dim - 1)))
        mine = nodes[surface.facets]
        below = unit_normals(np.einsum("qba,qai->qbi", slope, mine))
        there = np.einsum("qa,qai->qi", inside, mine) - 1e-4 * below
        at = surface.project(there, nodes, facet)
        assert (at.facet == facet).mean() == (1.0 if stays else pytest.approx(0.0, abs=0.35))
        if stays:
            np.testing.assert_allclose(at.xi, np.broadcast_to(edge, at.xi.shape), atol=1e-7)
            np.testing.assert_allclose(at.gap, -1e-4, rtol=1e-6)
            assert not at.clamped.any()
        np.testing.assert_array_less(surface.shape.excess(at.xi), OVERRUN)


@pytest.mark.parametrize("kind", [*ALL, *SMOOTH], ids=ids)
def test_answers_do_not_depend_on_earlier_searches(sheet, kind):
    """A walk with kept pairs against searches of other points, after steps small and large."""
    surface, nodes = surface_of(sheet, kind, (8, 6))
    start = nodes
    rng = np.random.default_rng(5)
    points = rng.uniform(0.0, 1.0, (60, nodes.shape[1]))
    points[:, -1] *= 0.2
    for size in (0.0, 0.01, 0.02, 0.01, 0.3, 0.01):
        points = points + size * rng.uniform(-1.0, 1.0, points.shape)
        nodes = nodes + 0.2 * size * rng.uniform(-1.0, 1.0, nodes.shape)
        kept = surface.project(points, nodes)
        shape = facet_shape(*kind[:2])
        for part in (slice(None, None, -1), slice(0, None, 3)):
            fresh = FacetSurface(shape, surface.facets, start, *kind[2:])
            fresh = fresh.project(points[part], nodes)
            np.testing.assert_array_equal(kept.facet[part], fresh.facet)
            np.testing.assert_array_equal(kept.xi[part], fresh.xi)
    assert 2 <= surface.search.searches <= 5


@pytest.mark.parametrize("size", [1e-6, 1e3])
def test_units(sheet, size):
    kind = SMOOTH[1]
    surface, nodes = surface_of(sheet, kind, (7, 5))
    points = np.random.default_rng(11).uniform(-0.1, 1.1, (200, 3)) * [1.0, 1.0, 0.02]
    at = surface.project(points, nodes)
    other = FacetSurface(facet_shape(*kind[:2]), surface.facets, size * nodes, kind[2])
    other = other.project(size * points, size * nodes)
    np.testing.assert_array_equal(other.facet, at.facet)
    np.testing.assert_allclose(other.gap, size * at.gap, rtol=0, atol=1e-12 * size)


def test_common_motion_needs_no_new_search(sheet):
    surface, nodes = surface_of(sheet, ("quadrilateral", 1), (6, 6))
    points = nodes[:30] + 0.01
    for shift in np.linspace(0.0, 3.0, 5):
        surface.project(points + shift, nodes + shift)
    assert surface.search.searches == 1
    surface.project(points + 0.4, nodes)
    assert surface.search.searches == 2


@pytest.mark.parametrize("kind", SPACE[:2], ids=ids)
def test_facets_of_very_different_size_and_shape(sheet, kind):
    """Graded 1:1000 along one axis, slivers of 1:1000: no closest facet is missed."""
    shape, facets, nodes = sheet(*kind, (24, 3), lambda x, y: 0.0 * x)
    nodes[:, 0] = 1000.0 ** (nodes[:, 0] - 1.0)
    nodes[:, 2] = 0.002 * np.sin(300.0 * nodes[:, 0])
    surface = FacetSurface(shape, facets, nodes)
    rng = np.random.default_rng(6)
    points = np.column_stack([1000.0 ** -rng.random(120), rng.random(120), np.zeros(120)])
    points[:, 2] = 0.01 * rng.normal(size=120)
    found = np.linalg.norm(points - surface.project(points, nodes).foot, axis=1)
    np.testing.assert_allclose(found, every_facet(surface, points, nodes), rtol=1e-10, atol=1e-15)


def test_one_huge_facet_among_thousands_of_small_ones(sheet):
    """The nearest thousand centres all belong to others."""
    shape, facets, nodes = sheet("quadrilateral", 1, (40, 40), lambda x, y: 0.0 * x)
    big = np.array([[-50, -50, -0.1], [50, -50, -0.1], [-50, 50, -0.1], [50, 50, -0.1]])
    every = np.concatenate([facets, [[0, 1, 2, 3]] + len(nodes) * np.ones((1, 4), dtype=int)])
    nodes = np.vstack([nodes, big])
    surface = FacetSurface(shape, every.astype(np.int32), nodes)
    points = np.array([[0.5, 0.5, -0.07], [0.5, 0.5, -0.03], [1.3, 0.5, 0.1]])
    at = surface.project(points, nodes)
    np.testing.assert_array_equal(at.facet == 1600, [True, False, True])
    np.testing.assert_allclose(at.gap, [0.03, -0.03, 0.2], rtol=1e-12)


def test_ties_go_to_the_first_facet_whatever_else_is_looked_at(sheet):
    """Inside a right-angled groove, equally far from both sides."""
    shape, facets, nodes = sheet("quadrilateral", 1, (4, 1), lambda x, y: np.abs(x - 0.5))
    points = np.column_stack([np.full(5, 0.5), np.linspace(0.1, 0.9, 5), np.linspace(0.1, 0.3, 5)])
    one = FacetSurface(shape, facets, nodes).project(points, nodes)
    turned = FacetSurface(shape, facets, nodes).project(points[::-1], nodes)
    np.testing.assert_array_equal(one.facet, turned.facet[::-1])
    assert (one.facet == 1).all()


def test_branching_surfaces_are_refused():
    triangle = facet_shape("triangle", 1)
    nodes = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], dtype=float)
    for facets in ([[0, 1, 2], [1, 0, 3], [0, 1, 4]], [[0, 1, 2], [0, 1, 3]]):
        with pytest.raises(ValueError, match="branches"):
            FacetSurface(triangle, np.array(facets, dtype=np.int32), nodes)
    segment = facet_shape("interval", 1)
    for word, facets in (("start", [[0, 1], [0, 2]]), ("end", [[1, 0], [2, 0]])):
        with pytest.raises(ValueError, match=f"branches: two of its facets {word} at one node"):
            FacetSurface(segment, np.array(facets, dtype=np.int32), nodes[:, :2])


@pytest.mark.parametrize("kind", ALL, ids=ids)
def test_no_points(sheet, kind):
    surface, nodes = surface_of(sheet, kind, (2, 2))
    at = surface.project(np.empty((0, nodes.shape[1])), nodes)
    assert at.gap.shape == (0,) and at.tangents.shape[1] == nodes.shape[1] - 1


def test_far_points_cost_little_and_are_nearly_right(sheet):
    """Of a surface of thousands of facets, points up to a hundred facets away."""
    surface, nodes = surface_of(sheet, ("quadrilateral", 1), (40, 40))
    rng = np.random.default_rng(8)
    points = np.column_stack([rng.random((200, 2)), 2.5 * rng.random(200) ** 3])
    at = surface.project(points, nodes)
    exact = every_facet(surface, points, nodes)
    distance = np.abs(at.gap)
    near = exact < 0.1
    assert 10 < np.count_nonzero(near) < 100
    np.testing.assert_allclose(distance[near], exact[near], rtol=1e-10, atol=1e-14)
    np.testing.assert_allclose(distance, exact, rtol=0.01)
    point, _ = pairs(surface.search, points, nodes[surface.facets])
    assert len(point) < 1.3 * len(points)
    # Small steps use no new search for those near, and the same rule for those far off.
    moved = surface.project(points + 0.001, nodes)
    fresh = FacetSurface(surface.shape, surface.facets, nodes).project(points + 0.001, nodes)
    np.testing.assert_array_equal(moved.facet, fresh.facet)
    assert surface.search.searches == 1
