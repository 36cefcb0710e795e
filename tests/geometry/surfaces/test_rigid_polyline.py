"""Fillets that fit, sharp corners, ends, rays, and which side the material is on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.geometry.surfaces.rigid_shapes import STEP, TRIANGLE, around, moved
from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.rigid import normals
from tribox.geometry.surfaces.rigid_polyline import AT_ONCE, Polyline
from tribox.geometry.surfaces.slave_points import PointNormals

SQUARE = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])


def project(line, points, **options):
    return line.project(np.array(points, dtype=float), line.control_points, **options)


def along(normals):
    normals = np.array(normals, dtype=float)
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    return PointNormals(normals, np.zeros((len(normals), 2, 2, 2)))


# -- fillets --------------------------------------------------------------------------------------


def test_a_rounded_corner_in_closed_form():
    """A right angle of radius 1: the arc's middle lies √2 − 1 from the corner."""
    corner = Polyline(np.array([[-3.0, 0.0], [0.0, 0.0], [0.0, -3.0]]), 1.0)
    at = project(corner, [[0.0, 0.0], [-1.0, 0.5], [-2.0, 0.5], [0.5, -2.0], [0.0, -1.0]])
    np.testing.assert_allclose(at.gap, [np.sqrt(2.0) - 1.0, 0.5, 0.5, 0.5, 0.0], atol=1e-15)
    np.testing.assert_allclose(at.normal[0], np.sqrt([0.5, 0.5]), rtol=1e-14)
    assert corner.pieces.length == pytest.approx([2.0, 0.5 * np.pi, 2.0], rel=1e-14)
    assert not corner.has_kinks and not at.clamped.any()


@pytest.mark.parametrize("closed", [False, True])
def test_pieces_go_on_into_each_other(closed):
    """End and start are the same, with the same direction; the curvature is 1/r on arcs."""
    line = Polyline(TRIANGLE if closed else STEP, 0.15, closed=closed)
    pieces, count = line.pieces, len(line.stencil)
    assert count == (6 if closed else 7)
    piece = np.arange(count, dtype=np.int32)
    ends = line.at(piece, np.ones((count, 1)))
    starts = line.at(np.roll(piece, -1), np.zeros((count, 1)))
    joint = slice(None) if closed else slice(None, -1)
    np.testing.assert_allclose(ends.place[joint], starts.place[joint], atol=1e-14)
    ways = normals(ends.tangents), normals(starts.tangents)
    np.testing.assert_allclose(ways[0][joint], ways[1][joint], atol=1e-13)
    bend = np.linalg.norm(ends.curvature[:, 0, 0], axis=1) / pieces.length**2
    np.testing.assert_allclose(bend, np.where(pieces.sweep == 0.0, 0.0, 1.0 / 0.15), atol=1e-11)


def test_fillets_may_take_all_of_a_side():
    """A square with fillets of half its side is a circle."""
    round_one = Polyline(SQUARE, 0.5, closed=True)
    points = around(round_one)
    at = round_one.project(points, round_one.control_points)
    np.testing.assert_allclose(at.gap, np.linalg.norm(points - 0.5, axis=1) - 0.5, atol=1e-14)
    assert len(round_one.stencil) == 4


def test_fillets_that_do_not_fit_are_refused_with_the_numbers():
    with pytest.raises(ValueError, match=r"radius 0.51 m at point 0 and 0.51 m at point 1.*1.02"):
        Polyline(SQUARE, 0.51, closed=True)
    with pytest.raises(ValueError, match=r"0.2 m at point 1 and 0.9 m at .* 2 take 1.1 m .* 1 m"):
        Polyline(SQUARE, [0.2, 0.9])


@pytest.mark.parametrize(
    ("points", "options", "wrong"),
    [
        ([[0.0, 0.0]], {}, "at least 2 points"),
        (SQUARE[:2], {"closed": True}, "at least 3 points"),
        ([[0.0, 0.0], [1.0, np.nan]], {}, "not finite"),
        ([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]], {}, "points 1 and 2 .* the same"),
        ([[0.0, 0.0], [1.0, 0.0], [0.5, 0.0]], {}, "back on itself at its point 1"),
        ([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], {}, "crosses itself, after .* 0 and 2"),
        (SQUARE, {"radius": -0.1}, "must not be negative"),
        (SQUARE, {"radius": [0.1] * 3}, "3 fillet radii for 2 corners"),
        (SQUARE, {"radius": [0.1] * 3, "closed": True}, "3 fillet radii for 4 corners"),
        (SQUARE, {"closed": True, "continued": (True, False)}, "cannot be continued"),
        (SQUARE, {"radius": [0.0, 1.0], "continued": (False, True)}, "nothing straight"),
        (SQUARE, {"closed": True, "inside": [0.0, 0.5]}, "lies on it"),
    ],
)
def test_what_is_no_line_is_refused(points, options, wrong):
    with pytest.raises(ValueError, match=wrong):
        Polyline(np.array(points), **options)


@settings(max_examples=40, deadline=None)
@given(
    radius=st.floats(0.0, 0.2),
    closed=st.booleans(),
    seed=st.integers(0, 1000),
    theta=st.floats(-4.0, 4.0),
)
def test_the_distance_is_that_from_many_samples(radius, closed, seed, theta):
    line = Polyline(TRIANGLE if closed else STEP, radius, closed=closed)
    nodes = moved(line, theta, 0.3)
    samples = []
    for piece in range(len(line.stencil)):
        xi = np.linspace(0.0, 1.0, 801)[:, None]
        samples.append(line.places(np.full(801, piece, dtype=np.int32), xi, nodes)[0])
    points = line.moved(around(line, 10, 2.0, seed), nodes)
    at = line.project(points, nodes)
    apart = np.linalg.norm(points[:, None] - np.concatenate(samples), axis=2).min(axis=1)
    assert np.all(np.abs(at.gap) <= apart + 1e-13)
    np.testing.assert_allclose(np.abs(at.gap), apart, atol=2e-3)
    np.testing.assert_allclose(at.foot + at.gap[:, None] * at.normal, points, atol=1e-13)


@settings(max_examples=30, deadline=None)
@given(s=st.floats(-0.3, 0.3), height=st.floats(-0.03, 0.3))
def test_nothing_jumps_where_pieces_meet(s, height):
    """Gap and normal along a line past a joint between flat and arc, to first order."""
    line = Polyline(STEP, 0.2, continued=(True, True))
    joint = int(np.nonzero(line.pieces.sweep)[0][1])
    at = line.at(np.array([joint], dtype=np.int32), np.zeros((1, 1)))
    tau = at.tangents[0, 0] / np.linalg.norm(at.tangents[0, 0])
    normal = np.array([-tau[1], tau[0]])
    h = 1e-6
    path = at.place + (np.array([[s * 0.1], [s * 0.1 + h]]) * tau) + height * 0.5 * normal
    found = project(line, path)
    assert abs(found.gap[1] - found.gap[0]) <= 1.01 * h
    assert np.abs(found.normal[1] - found.normal[0]).max() <= 60.0 * h


@pytest.mark.parametrize("unit", [1e-6, 1e3])
@pytest.mark.parametrize("radius", [0.0, 0.15])
def test_nothing_depends_on_the_unit_of_length(unit, radius):
    line, other = Polyline(STEP, radius), Polyline(unit * STEP, unit * radius)
    points = around(line, 200)
    ours, theirs = project(line, points), project(other, unit * points)
    np.testing.assert_array_equal(ours.facet, theirs.facet)
    np.testing.assert_array_equal(ours.clamped, theirs.clamped)
    np.testing.assert_allclose(theirs.gap / unit, ours.gap, rtol=1e-9, atol=1e-14)


def test_many_pieces_give_the_same_as_facets():
    """More points and pieces than are looked at at once."""
    x = np.linspace(-1.0, 1.0, 401)
    wave = np.stack([x, 0.01 * np.cos(40.0 * x)], axis=1)
    line, count = Polyline(wave), 4000
    facets = np.stack([np.arange(400), np.arange(1, 401)], axis=1).astype(np.int32)
    mesh = FacetSurface(facet_shape("interval", 1), facets, wave)
    rng = np.random.default_rng(2)
    points = np.stack([rng.uniform(-1.0, 1.0, count), rng.uniform(-0.1, 0.1, count)], axis=1)
    assert count * 400 > AT_ONCE
    ours, theirs = project(line, points), mesh.project(points, wave)
    np.testing.assert_array_equal(ours.facet, theirs.facet)
    np.testing.assert_allclose(ours.gap, theirs.gap, atol=1e-14)
    met = project(line, points, rays=along(np.tile([0.05, 1.0], (count, 1))))
    on, inner = met.on_surface, np.abs(points[:, 0]) < 0.98
    assert on[inner].all() and not on.all()
    there = met.foot + met.gap[:, None] * met.normal
    np.testing.assert_allclose(there[on], points[on], atol=1e-13)


# -- the side of the material ---------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, -1])
def test_a_point_inside_says_where_the_material_is(order):
    points, radii = SQUARE[::order], np.array([0.1, 0.2, 0.3, 0.4])[::order]
    solid = Polyline(points, radii, closed=True, inside=np.array([0.5, 0.5]))
    hollow = Polyline(points, radii, closed=True, inside=np.array([3.0, 0.5]))
    places = [[0.5, 1.25], [0.5, 0.9], [1.0, 0.0], [0.0, 0.0]]
    corner = np.sqrt(2.0) - 1.0
    expected = [0.25, -0.1, 0.4 * corner, 0.1 * corner]
    np.testing.assert_allclose(project(solid, places).gap, expected, atol=1e-15)
    np.testing.assert_allclose(project(hollow, places).gap, np.negative(expected), atol=1e-15)


def test_turned_about_an_open_line_keeps_its_ends():
    line = Polyline(STEP, 0.1, continued=(True, False), inside=np.array([0.0, 5.0]))
    assert project(line, [[-9.0, 0.6]]).gap[0] == pytest.approx(-0.1, rel=1e-12)
    past = project(line, [[2.0, 2.0]])
    assert not past.on_surface[0] and past.clamped[0]


# -- sharp corners --------------------------------------------------------------------------------


def test_sharp_corners_are_those_of_facets():
    """Same gap, normal, clamped and left points, whatever the side."""
    facets = np.array([[0, 1], [1, 2], [2, 3], [3, 4]], dtype=np.int32)
    mesh = FacetSurface(facet_shape("interval", 1), facets, STEP)
    line = Polyline(STEP)
    points = around(line, 300, 1.2)
    ours, theirs = line.project(points, line.control_points), mesh.project(points, STEP)
    assert line.has_kinks and ours.clamped.any() and not ours.on_surface.all()
    for name in ("facet", "clamped", "on_surface"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    for name in ("gap", "normal", "foot", "xi", "tangents"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-13)
    excess = line.excess(ours.facet, ours.xi)
    np.testing.assert_allclose(np.maximum(excess, 0.0), 0.0, atol=1e-15)
    assert np.isclose(excess, 0.0).any()


def test_rays_and_shares_are_those_of_facets():
    """Where all of them face the slave."""
    step = STEP * [1.0, 0.25]
    facets = np.array([[0, 1], [1, 2], [2, 3], [3, 4]], dtype=np.int32)
    mesh = FacetSurface(facet_shape("interval", 1), facets, step)
    line = Polyline(step)
    rng = np.random.default_rng(1)
    points = np.stack([rng.uniform(-1.2, 1.4, 200), np.zeros(200)], axis=1)
    points[:, 1] = np.interp(points[:, 0], *step.T) + rng.uniform(-0.05, 0.1, 200)
    rays = along(np.stack([rng.uniform(-0.1, 0.1, 200), np.ones(200)], axis=1))
    reach = np.full(200, 0.15)
    ours = line.project(points, line.control_points, rays=rays, fading=reach)
    theirs = mesh.project(points, step, rays=rays, fading=reach)
    met = theirs.on_surface
    np.testing.assert_array_equal(ours.on_surface, met)
    assert 100 < met.sum() < 200 and (theirs.share < 1.0).sum() > 10
    for name in ("gap", "normal", "foot", "xi", "share", "share_slope"):
        np.testing.assert_allclose(getattr(ours, name)[met], getattr(theirs, name)[met], atol=1e-12)
    assert not ours.clamped.any()


def test_rays_meet_arcs_and_straight_pieces():
    """x = ȳ + g n, with ȳ on the line, and the gap of least size of all hits from above."""
    line = Polyline(STEP, [0.2, 0.0, 0.2], continued=(True, True))
    assert line.has_kinks
    x = np.linspace(-1.5, 1.5, 301)
    points = np.stack([x, np.full_like(x, 0.7)], axis=1)
    rays = along(np.tile([0.1, 1.0], (len(x), 1)))
    at = project(line, points, rays=rays)
    assert at.on_surface.all() and at.rays is rays
    np.testing.assert_allclose(at.foot + at.gap[:, None] * at.normal, points, atol=1e-14)
    np.testing.assert_allclose(project(line, at.foot).gap, 0.0, atol=1e-14)
    assert len(np.unique(at.facet)) == len(line.stencil)
    assert np.all(np.diff(at.facet) >= 0)


def test_a_point_that_may_not_leave_its_piece_stays_a_little_past_the_corner():
    punch = Polyline(np.array([[1.0, 1.0], [1.0, 0.0], [-1.0, 0.0], [-1.0, 1.0]]))
    points = [[1.0 + 1e-5, -0.1], [1.01, -0.1]]
    at = project(punch, points, frozen_facets=np.array([1, 1], dtype=np.int32))
    np.testing.assert_array_equal(at.clamped, [False, True])
    np.testing.assert_allclose(at.normal[0], [0.0, -1.0], atol=1e-14)
    assert at.gap[0] == pytest.approx(0.1, rel=1e-14)


def test_contact_ends_at_open_ends_and_not_where_the_line_goes_on():
    points = [[-1.5, 0.7], [1.5, 1.0]]
    for continued in ((False, False), (True, False), (False, True), (True, True)):
        at = project(Polyline(STEP, 0.1, continued=continued), points)
        np.testing.assert_array_equal(at.on_surface, continued)
        np.testing.assert_array_equal(at.clamped, np.logical_not(continued))


# -- ends that are none of an edge ----------------------------------------------------------------


def cut(points, **options):
    """Whether contact would go on at the start and at the end of a line."""
    line = Polyline(np.array(points), **options)
    last = len(line.stencil) - 1
    facet, xi = np.array([0, last], dtype=np.int32), np.array([[0.0], [1.0]])
    assert not line.cut_off(facet, np.full((2, 1), 0.5)).any()
    return line.cut_off(facet, xi).tolist()


def test_an_end_of_a_round_line_is_cut_off_and_that_of_a_straight_one_is_an_edge():
    angle = np.radians(np.linspace(-20.0, 20.0, 9))
    arc = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    assert cut(arc) == [True, True]
    assert cut(arc[[0, 4, 8]]) == [False, False]  # a chamfer
    assert cut([[-1.0, 0.0], [1.0, 0.0]]) == [False, False]
    assert cut([[-3.0, 0.0], [0.0, 0.0], [0.0, -3.0]], radius=1.0) == [False, False]
    assert cut([[-3.0, 0.0], [0.0, 0.0], [0.0, -3.0]], radius=3.0) == [True, True]
    flank = np.concatenate([arc[:1] - [0.0, 1.0], arc])
    assert cut(flank) == [False, True]
    assert cut(np.concatenate([arc, [[3.0, 0.5]]]), continued=(False, True)) == [True, False]
