"""What all rigid shapes must do: closest points, derivatives, and being carried along."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geometry.surfaces.rigid import normals
from tests.geometry.surfaces.rigid_shapes import SMOOTH, around, moved

BOX = np.array([[-3.0, -3.0, -3.0], [3.0, 3.0, 3.0]])


@pytest.fixture(params=SMOOTH)
def shape(request):
    return SMOOTH[request.param]()


def test_places_are_the_control_points_times_their_weights(shape):
    nodes = moved(shape, 0.7, 0.1)
    at = shape.project(around(shape), nodes)
    foot, tangents = shape.places(at.facet, at.xi, nodes)
    np.testing.assert_allclose(at.foot, foot, atol=1e-14)
    np.testing.assert_allclose(at.tangents, tangents, atol=1e-14)
    controls = nodes[shape.stencil[at.facet]]
    by_weights = np.einsum("qa,qai->qi", shape.weights(at.facet, at.xi), controls)
    by_slopes = np.einsum("qba,qai->qbi", shape.slopes(at.facet, at.xi), controls)
    np.testing.assert_allclose(by_weights, foot, atol=1e-14)
    np.testing.assert_allclose(by_slopes, tangents, atol=1e-14)


def test_tangents_and_curvature_are_derivatives(shape):
    nodes = moved(shape, -0.4, 0.2)
    at = shape.project(around(shape), nodes)
    h = 1e-5
    directions = at.xi.shape[1]
    for alpha in range(directions):
        step = np.zeros(directions)
        step[alpha] = h
        ahead, behind = (shape.places(at.facet, at.xi + s * step, nodes) for s in (1.0, -1.0))
        slope = (ahead[0] - behind[0]) / (2.0 * h)
        np.testing.assert_allclose(at.tangents[:, alpha], slope, atol=1e-8)
        bend = (ahead[1] - behind[1]) / (2.0 * h)
        curvature = 0.0 * bend if at.curvature is None else at.curvature[:, alpha]
        np.testing.assert_allclose(curvature, bend, atol=1e-8)
    np.testing.assert_allclose(normals(at.tangents), at.normal, atol=1e-14)
    size = np.linalg.norm(at.tangents, axis=2) / shape.size
    assert size.min() > 0.2 and size.max() < 7.0


def test_closest_points_against_samples(shape):
    """No sample is closer, the nearest is about as near, and x − ȳ is along the normal."""
    nodes = moved(shape, 0.3, -0.2)
    outline = shape.outline(BOX[:, : shape.dim], 400)
    samples = shape.moved(_filled(outline), nodes)
    points = shape.moved(around(shape), nodes)
    at = shape.project(points, nodes)
    apart = np.linalg.norm(points[:, None] - samples, axis=2).min(axis=1)
    assert np.all(np.abs(at.gap) <= apart + 1e-4)
    np.testing.assert_allclose(np.abs(at.gap), apart, atol=0.02)
    np.testing.assert_allclose(at.foot + at.gap[:, None] * at.normal, points, atol=1e-14)
    assert not at.clamped.any() and at.on_surface.all()
    assert (at.gap > 0.0).any() and (at.gap < 0.0).any()


def _filled(outline):
    """Points (n, i) of lines or triangles, dense enough to be compared with."""
    corners = outline.points[outline.cells]
    count = 3 if outline.cells.shape[1] == 3 and len(outline.cells) > 100 else 150
    share = np.linspace(0.0, 1.0, count)
    if outline.cells.shape[1] == 2:
        weights = np.stack([1.0 - share, share], axis=1)
    else:
        weights = np.array([[1.0 - a, a * (1.0 - b), a * b] for a in share for b in share])
    return np.einsum("sa,cai->csi", weights, corners).reshape(-1, outline.points.shape[1])


@settings(max_examples=30, deadline=None)
@given(
    name=st.sampled_from(sorted(SMOOTH)),
    theta=st.floats(-7.0, 7.0),
    shift=st.floats(-5.0, 5.0),
    seed=st.integers(0, 1000),
)
def test_nothing_changes_when_all_moves_as_one(name, theta, shift, seed):
    shape = SMOOTH[name]()
    nodes, points = moved(shape, theta, shift), around(shape, 5, seed=seed)
    turn = shape.moved(np.eye(shape.dim), nodes) - shape.moved(np.zeros((1, shape.dim)), nodes)
    before = shape.project(points, shape.control_points)
    after = shape.project(shape.moved(points, nodes), nodes)
    np.testing.assert_allclose(after.gap, before.gap, atol=1e-13)
    np.testing.assert_allclose(after.normal, before.normal @ turn, atol=1e-11)
    np.testing.assert_allclose(after.foot, shape.moved(before.foot, nodes), atol=1e-11)


def test_control_points_that_are_strained_are_refused(shape):
    with pytest.raises(ValueError, match="strained"):
        shape.project(around(shape), 1.01 * shape.control_points)


def test_points_have_a_place_on_several_facets_or_one(shape):
    """Every facet is used, and may follow on every other."""
    at = shape.project(around(shape, 400), shape.control_points)
    np.testing.assert_array_equal(np.unique(at.facet), np.arange(len(shape.stencil)))
    assert shape.neighbours.toarray().all()
    assert shape.stencil.shape[1] == shape.dim + 1


def test_extent_holds_what_is_drawn(shape):
    points = shape.outline(BOX[:, : shape.dim], 30).points
    low, high = shape.extent
    assert np.all(points >= low - 1e-12) and np.all(points <= high + 1e-12)


def test_closed_forms():
    circle, hollow = SMOOTH["circle"](), SMOOTH["hollow circle"]()
    points = around(circle)
    distance = np.linalg.norm(points - circle.centre, axis=1)
    at = circle.project(points, circle.control_points)
    np.testing.assert_allclose(at.gap, distance - 0.8, rtol=1e-12)
    inside = hollow.project(points, hollow.control_points)
    np.testing.assert_allclose(inside.gap, 0.8 - distance, rtol=1e-12)
    np.testing.assert_allclose(inside.normal, -at.normal, atol=1e-14)


@pytest.mark.parametrize("name", ["line", "plane"])
def test_the_gap_of_a_plane_is_the_height(name):
    plane = SMOOTH[name]()
    points = around(plane)
    at = plane.project(points, plane.control_points)
    np.testing.assert_allclose(at.gap, (points - plane.point) @ plane.normal, atol=1e-14)
    assert at.curvature is None


def test_the_centre_has_some_closest_point():
    for name in ("circle", "hollow circle"):
        shape = SMOOTH[name]()
        at = shape.project(shape.centre[None], shape.control_points)
        np.testing.assert_allclose(np.abs(at.gap), 0.8, rtol=1e-14)
        assert np.isfinite(at.normal).all()


@pytest.mark.parametrize("number", [0.0, -1.0, np.nan, np.inf])
def test_sizes_that_are_none_are_refused(number):
    from geometry.surfaces.rigid_circle import Circle
    from geometry.surfaces.rigid_plane import Plane

    with pytest.raises(ValueError, match="radius"):
        Circle(np.zeros(2), number)
    with pytest.raises(ValueError, match="size"):
        Plane(np.zeros(3), np.ones(3), number)
    with pytest.raises(ValueError, match="direction"):
        Plane(np.zeros(3), np.zeros(3))
