"""The compiled search for closest points against numpy's, facet by facet and on whole surfaces."""

from __future__ import annotations

import ctypes
from dataclasses import fields

import numpy as np
import pytest

import tribox.geometry.surfaces.compiled_facets as compiled
from tests.geometry.surfaces.closest import NumpySurface, closest_points
from tests.geometry.surfaces.searched import pairs
from tribox.geometry.surfaces.compiled_facets import Candidates, CompiledFacets
from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.projection import FacetSurface

SHAPES = [
    *(("interval", degree) for degree in (1, 2, 3)),
    *(("triangle", degree) for degree in (1, 2)),
    *(("quadrilateral", degree) for degree in (1, 2, 3)),
]
# Shapes of facets, and whether they are made smooth.
SURFACES = [
    *(("interval", degree, None) for degree in (1, 2)),
    ("interval", 1, 0.8),
    *(("triangle", degree, None) for degree in (1, 2)),
    *(("quadrilateral", degree, None) for degree in (1, 2)),
    ("quadrilateral", 1, 0.8),
]


def name(kind):
    return "".join(str(part) for part in kind if part is not None)


def warped(shape, rng, count, size):
    """Facets (count, a, i) of size one, turned at random and bent by about ``size``."""
    dim = shape.directions + 1
    flat = np.zeros((count, shape.count, dim))
    flat[..., :-1] = shape.points
    turn = np.linalg.qr(rng.normal(size=(count, dim, dim)))[0]
    bent = flat + size * rng.uniform(-1.0, 1.0, flat.shape)
    return np.einsum("pij,paj->pai", turn, bent)


def one_each(shape, facets, points, code=None):
    """Closest points (q,) of facets (q, a, i), each with its own point."""
    count = len(points)
    own = np.arange(count, dtype=np.int32)
    among = Candidates(np.arange(count + 1), own, np.zeros(count), 0.0)
    surface = code or CompiledFacets(shape, count)
    return surface.closest(points, facets, among, 1e-12)


@pytest.mark.parametrize("kind", SHAPES, ids=name)
@pytest.mark.parametrize("reach", [0.0, 0.03, 0.5, 30.0])
def test_one_facet(kind, reach):
    """On the facet, near it, beside it and far away: the same place on the same entity."""
    shape = facet_shape(*kind)
    rng = np.random.default_rng(5)
    facets = warped(shape, rng, 400, 0.05 if shape.degree > 1 else 0.2)
    xi = rng.uniform(-0.3 if reach else 0.0, 1.3 if reach else 1.0, (400, shape.directions))
    if not reach and shape.cell == "triangle":
        xi *= 0.5
    points = np.einsum("qa,qai->qi", shape.values(xi), facets)
    points += reach * rng.uniform(-1.0, 1.0, points.shape)
    expected = closest_points(shape, facets, points)
    facet, found, entity = one_each(shape, facets, points)
    np.testing.assert_array_equal(facet, np.arange(400))
    np.testing.assert_array_equal(entity, expected.entity)
    np.testing.assert_allclose(found, expected.xi, rtol=0, atol=1e-9)
    apart = points - np.einsum("qa,qai->qi", shape.values(found), facets)
    distance = np.sqrt(expected.squared)
    # The shape functions of numpy round by some 1e-14 on cubic facets.
    close = {"rtol": 1e-12, "atol": 1e-13}
    np.testing.assert_allclose(np.linalg.norm(apart, axis=1), distance, **close)
    code = CompiledFacets(shape, 400)
    np.testing.assert_allclose(code.distances(points, facets, facet, facet), distance, **close)


@pytest.mark.parametrize("kind", SHAPES, ids=name)
def test_points_on_edges_and_corners(kind):
    """Exactly on the nodes, and right above them: no other place is as near."""
    shape = facet_shape(*kind)
    facets = np.repeat(warped(shape, np.random.default_rng(2), 1, 0.05), shape.count, axis=0)
    for lift in (0.0, 1e-3):
        points = facets[0] + lift * np.eye(shape.directions + 1)[-1]
        _, xi, _ = one_each(shape, facets, points)
        expected = closest_points(shape, facets, points).xi
        np.testing.assert_allclose(xi, expected, rtol=0, atol=1e-10)
        if not lift:
            np.testing.assert_allclose(xi, shape.points, rtol=0, atol=1e-10)


def test_a_point_at_the_centre_of_curvature():
    """All of an arc is about equally near, and Newton's method has no convex minimum to go to."""
    shape = facet_shape("interval", 3)
    angle = 0.6 * (shape.points - 0.5)
    arc = np.stack([np.sin(angle), np.cos(angle)], axis=-1).reshape(1, -1, 2)
    points = np.array([[0.0, 0.0], [1e-9, 0.0], [0.0, -1e-6]])
    arcs = np.repeat(arc, 3, axis=0)
    expected = np.sqrt(closest_points(shape, arcs, points).squared)
    _, xi, _ = one_each(shape, arcs, points)
    apart = points - np.einsum("qa,qai->qi", shape.values(xi), arcs)
    np.testing.assert_allclose(np.linalg.norm(apart, axis=1), expected, rtol=1e-9)


def both(sheet, kind, height=None):
    """Surfaces with and without the library, and their nodes."""
    cell, degree, angle = kind

    def hills(*x):
        return 0.1 * np.sin(4.0 * x[0]) * np.cos(3.0 * x[-1] + 0.5)

    count = (7,) if cell == "interval" else (7, 5)
    shape, facets, nodes = sheet(cell, degree, count, height or hills)
    surfaces = [kind(shape, facets, nodes, angle) for kind in (FacetSurface, NumpySurface)]
    return *surfaces, nodes


def around(nodes, count, reach):
    rng = np.random.default_rng(11)
    points = rng.uniform(-0.1, 1.1, (count, nodes.shape[1]))
    points[:, -1] = reach * rng.uniform(-1.0, 1.0, count)
    # On nodes and right above them too: several facets are equally near.
    return np.concatenate([points, nodes, nodes + 1e-3 * np.eye(nodes.shape[1])[-1]])


def assert_same(one, other, atol):
    """Two projections agree: facets exactly, numbers up to ``atol``."""
    for field in fields(one):
        mine, theirs = getattr(one, field.name), getattr(other, field.name)
        if mine is None or theirs is None:
            assert mine is theirs, field.name
        elif mine.dtype.kind == "f":
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=atol, err_msg=field.name)
        else:
            np.testing.assert_array_equal(mine, theirs, err_msg=field.name)


@pytest.mark.parametrize("kind", SURFACES, ids=name)
@pytest.mark.parametrize("reach", [1e-3, 0.3, 12.0])
def test_whole_surfaces(sheet, kind, reach):
    ours, numpys, nodes = both(sheet, kind)
    points = around(nodes, 300, reach)
    at = ours.project(points, nodes)
    theirs = numpys.project(points, nodes)
    # The normal of a point next to an edge is the direction of a tiny vector.
    near = np.abs(at.gap) < 1e-6
    np.testing.assert_allclose(at.normal[near], theirs.normal[near], rtol=0, atol=1e-6)
    at.normal[near] = theirs.normal[near]
    assert_same(at, theirs, 1e-9)
    assert at.clamped.any() and (~at.clamped).any()


@pytest.mark.parametrize("kind", SURFACES, ids=name)
def test_kept_facets_and_kept_candidates(sheet, kind):
    """Facets that points may not leave at once, and a search that is some motion old."""
    ours, numpys, nodes = both(sheet, kind)
    points = around(nodes, 200, 0.02)
    kept = np.roll(ours.project(points, nodes).facet, 1)
    kept[::2] = np.roll(kept, -1)[::2]
    numpys.project(points, nodes)
    moved = points + 0.1 * ours.search.slack
    assert_same(ours.project(moved, nodes, kept), numpys.project(moved, nodes, kept), 1e-8)
    assert ours.search.searches == numpys.search.searches == 1


@pytest.mark.parametrize("kind", SURFACES, ids=name)
def test_each_point_by_itself(sheet, kind):
    """Bit by bit the same in another order, among fewer points, and after a new search."""
    ours, _, nodes = both(sheet, kind)
    points = around(nodes, 200, 0.05)
    ours.project(points - 0.1 * ours.search.slack, nodes)
    whole = ours.project(points, nodes)
    for part in (np.arange(0, len(points), 3), np.arange(len(points))[::-1]):
        fresh = FacetSurface(facet_shape(kind[0], kind[1]), ours.facets, nodes, kind[2])
        assert_same(fresh.project(points[part], nodes), whole.of(part), 0.0)


@pytest.mark.parametrize("size", [1e-6, 1e3])
def test_units(sheet, size):
    ours, _, nodes = both(sheet, ("quadrilateral", 1, 0.8))
    shape = facet_shape("quadrilateral", 1)
    points = around(nodes, 200, 0.02)
    at = ours.project(points, nodes)
    other = FacetSurface(shape, ours.facets, size * nodes, 0.8).project(size * points, size * nodes)
    np.testing.assert_array_equal(other.facet, at.facet)
    np.testing.assert_allclose(other.gap, size * at.gap, rtol=0, atol=1e-12 * size)


def test_of_equally_close_facets_the_first(sheet):
    """Above the ridge between two facets both are as near; which, does not hang on the search."""
    ours, _, nodes = both(sheet, ("quadrilateral", 1, None), lambda *x: -np.abs(x[0] - 3 / 7))
    ridge = nodes[np.abs(nodes[:, 0] - 3 / 7) < 1e-12]
    points = 0.5 * (ridge[1:] + ridge[:-1]) + [0.0, 0.0, 0.01]
    at = ours.project(points, nodes)
    assert at.clamped.all()
    _, around_them = pairs(ours.search, points, nodes[ours.facets])
    assert len(around_them) >= 2 * len(points)
    distances = ours._code.distances(
        np.repeat(points, len(ours.facets), axis=0),
        nodes[ours.facets],
        np.arange(len(points) * len(ours.facets), dtype=np.int32),
        np.tile(np.arange(len(ours.facets), dtype=np.int32), len(points)),
    ).reshape(len(points), -1)
    first = np.argmax(distances <= distances.min(axis=1)[:, None] + 1e-12, axis=1)
    np.testing.assert_array_equal(at.facet, first)


def test_no_points(sheet):
    ours, _, nodes = both(sheet, ("quadrilateral", 1, 0.8))
    assert ours.project(np.empty((0, 3)), nodes).gap.shape == (0,)


def test_structures_of_another_layout_are_refused(monkeypatch):
    class Shorter(ctypes.Structure):
        _fields_ = (("count", ctypes.c_int64),)

    monkeypatch.setattr(compiled, "_Task", Shorter)
    with pytest.raises(RuntimeError, match="the same fields in one order"):
        CompiledFacets(facet_shape("interval", 1), 3)


@pytest.mark.parametrize("kind", SURFACES, ids=name)
def test_places_of_the_last_step(sheet, kind):
    ours, numpys, nodes = both(sheet, kind)
    at = ours.project(around(nodes, 100, 0.05), nodes)
    moved = nodes + 0.01 * np.sin(7.0 * nodes[:, ::-1])
    for mine, theirs in zip(
        ours.places(at.facet, at.xi, moved), numpys.places(at.facet, at.xi, moved), strict=True
    ):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-12)
