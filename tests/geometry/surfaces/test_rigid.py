"""What all rigid shapes must do: closest points, derivatives, and being carried along."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.geometry.surfaces.closest import nearest
from tests.geometry.surfaces.rigid_shapes import SMOOTH, around, moved
from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.rigid import RigidMotion
from tribox.geometry.surfaces.rigid_polyline import FACING, LineEnds, filleted
from tribox.geometry.surfaces.rigid_shapes import Circle, Plane

BOX = np.array([[-3.0, -3.0, -3.0], [3.0, 3.0, 3.0]])


@pytest.fixture(params=SMOOTH)
def shape(request):
    return SMOOTH[request.param]()


def test_closest_points_against_fine_facets(shape):
    """The distance is that from many lines or triangles, and x − ȳ is along the normal."""
    nodes = moved(shape, 0.3, -0.2)
    outline = shape.outline(BOX[:, : shape.dim], 100)
    facets = shape.moved(outline.points, nodes)[outline.cells]
    form = facet_shape("interval" if shape.dim == 2 else "triangle", 1)
    points = shape.moved(around(shape), nodes)
    at = shape.project(points, nodes)
    apart = nearest(form, facets, points)
    np.testing.assert_allclose(np.abs(at.gap), apart, atol=1.5e-3)  # r h²/8 of the coarsest
    np.testing.assert_allclose(at.foot + at.gap[:, None] * at.normal, points, atol=1e-14)
    assert not at.clamped.any() and at.on_surface.all()
    assert (at.gap > 0.0).any() and (at.gap < 0.0).any()


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


def test_shapes_need_neither_meshes_nor_solvers():
    """A case may be checked where there is no DOLFINx."""
    names = "_shapes", "", "_polyline"
    script = "".join(f"import tribox.geometry.surfaces.rigid{name}\n" for name in names)
    script += "import sys; print([m for m in ('basix', 'dolfinx', 'mpi4py') if m in sys.modules])"
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_control_points_that_are_strained_are_refused(shape):
    with pytest.raises(ValueError, match="strained"):
        shape.project(around(shape), 1.01 * shape.control_points)


def test_extent_holds_what_is_drawn(shape):
    points = shape.outline(BOX[:, : shape.dim], 30).points
    low, high = shape.extent
    assert np.all(points >= low - 1e-12) and np.all(points <= high + 1e-12)


def test_pictures_show_a_large_roll_round_and_a_flat_die_beyond_what_spreads_under_it():
    strip = np.array([[-20.0, -1.0], [20.0, 1.0]])
    places = Circle(np.array([0.0, 51.0]), 50.0).outline(strip).points
    middles = 0.5 * (places + np.roll(places, 1, axis=0)) - [0.0, 51.0]
    assert np.all(np.linalg.norm(middles, axis=1) > 50.0 - 1e-4 * 40.1)
    die = Plane(np.array([0.0, 1.0]), np.array([0.0, -1.0])).outline(strip).points
    assert die[:, 0].min() < -60.0 and die[:, 0].max() > 60.0


def test_a_rank_without_points_has_none_to_project(shape):
    at = shape.project(np.empty((0, shape.dim)), shape.control_points, fading=np.empty(0))
    assert at.facet.shape == (0,) and at.gap.shape == (0,)
    assert at.xi.shape == (0, shape.dim - 1) and at.tangents.shape == (0, shape.dim - 1, shape.dim)


def from_point(points):
    return points - np.array([0.2, 0.1, -0.3])[: points.shape[1]]


def from_axis(points):
    axis = np.array([1.0, -0.4, 0.3]) / np.sqrt(1.25)
    apart = from_point(points)
    return apart - np.outer(apart @ axis, axis)


@pytest.mark.parametrize(
    ("name", "apart"),
    [
        ("circle", from_point), ("hollow circle", from_point), ("sphere", from_point),
        ("hollow sphere", from_point), ("cylinder", from_axis),
        ("hollow cylinder", lambda points: points * [1.0, 1.0, 0.0]),
    ],
)  # fmt: skip
def test_round_ones_in_closed_form(name, apart):
    shape = SMOOTH[name]()
    points = around(shape)
    at = shape.project(points, shape.control_points)
    distance = np.linalg.norm(apart(points), axis=1)
    sign = -1.0 if "hollow" in name else 1.0
    np.testing.assert_allclose(at.gap, sign * (distance - 0.8), atol=1e-14)
    np.testing.assert_allclose(at.normal, sign * apart(points) / distance[:, None], atol=1e-14)


def test_the_centre_has_some_closest_point():
    for name in ("circle", "hollow circle", "sphere", "hollow sphere", "hollow cylinder"):
        shape = SMOOTH[name]()
        at = shape.project(shape.control_points.mean(axis=0)[None], shape.control_points)
        np.testing.assert_allclose(np.abs(at.gap), 0.8, rtol=1e-14)
        assert np.isfinite(at.normal).all()


# -- How much of a point counts beside ends and sharp corners, and how that changes ----------------

# Convex and concave corners, steep and gentle ones, arcs, and an open end on both sides.
POINTS = [[3.0, 2.0], [2.6, 0.6], [2.0, 0.0], [1.0, 0.0], [1.0, -1.0], [0.2, -0.9], [-1.0, -1.0]]
LINE = filleted(np.array(POINTS), [0.0, 0.3, 0.0, 0.0, 0.0], closed=False)
ENDS = LineEnds(LINE)
COUNT = len(LINE.sweep)


def places(per_piece=40):
    """Pieces (q,) and ξ (q,) all along the line, and normals (q, i) that it faces more or less."""
    rng = np.random.default_rng(0)
    piece = np.repeat(np.arange(COUNT, dtype=np.int32), per_piece)
    xi = rng.uniform(0.0, 1.0, len(piece))
    angle = rng.uniform(-1.0, 1.0, len(piece)) * 1.6 - 0.5 * np.pi
    return piece, xi, np.stack([np.cos(angle), np.sin(angle)], axis=1)


def shares(piece, xi, normals, reach=0.3):
    met = np.ones(len(xi), dtype=bool)
    return ENDS.along_rays(piece, xi, met, np.full(len(xi), reach), normals)


def test_derivatives_are_those_of_the_share():
    piece, xi, normals = places()
    at, h = shares(piece, xi, normals), 1e-7
    slope = [shares(piece, xi + s * h, normals).share for s in (1.0, -1.0)]
    smooth = np.abs(slope[0] + slope[1] - 2.0 * at.share) < 1e-11
    assert smooth.mean() > 0.97 and (at.slope[smooth] != 0.0).sum() > 30
    np.testing.assert_allclose((slope[0] - slope[1])[smooth] / (2 * h), at.slope[smooth], atol=1e-7)
    across = np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    turned = [shares(piece, xi, normals + s * h * across).share for s in (1.0, -1.0)]
    smooth = np.abs(turned[0] + turned[1] - 2.0 * at.share) < 1e-11
    found = np.einsum("qi,qi->q", at.turn, across)
    assert smooth.mean() > 0.97 and (found[smooth] != 0.0).sum() > 30
    np.testing.assert_allclose((turned[0] - turned[1])[smooth] / (2 * h), found[smooth], atol=1e-7)


def test_shares_go_over_from_piece_to_piece():
    """At a joint, sharp or not, both sides give the same; at an end nothing is left."""
    for normal in ([0.0, -1.0], [0.3, -1.0], [0.8, -0.6], [-0.9, -0.5]):
        normals = np.tile(np.array(normal) / np.hypot(*normal), (COUNT, 1))
        piece = np.arange(COUNT, dtype=np.int32)
        end = shares(piece, np.ones(COUNT), normals).share
        start = shares(piece, np.zeros(COUNT), normals).share
        np.testing.assert_allclose(end[:-1], start[1:], atol=1e-12)
        assert end[-1] == start[0] == 0.0


def test_what_faces_the_slave_counts_in_full_but_at_ends():
    """Down to the angle that is stated, with gentle corners on both sides."""
    line = filleted(np.array([[3.0, 0.0], [2.0, 0.1], [1.0, 0.0], [0.0, 0.1]]), 0.0, closed=False)
    ends, xi = LineEnds(line), np.array([0.5, 0.01, 0.5, 0.99, 0.5])
    piece = np.array([0, 1, 1, 1, 2], dtype=np.int32)
    for angle in np.arccos(FACING) - 0.11, 0.0:
        normal = np.array([np.sin(angle), -np.cos(angle)])
        found = ends.along_rays(piece, xi, xi > 0.0, np.full(5, 0.1), np.tile(normal, (5, 1)))
        np.testing.assert_array_equal(found.share, 1.0)
        assert not found.slope.any() and not found.turn.any()


def test_rays_that_meet_nothing_have_no_part_in_it():
    piece, xi, normals = places()
    met = np.arange(len(xi)) % 2 == 0
    found = ENDS.along_rays(piece, xi, met, np.full(len(xi), 0.3), normals)
    np.testing.assert_array_equal(found.share[~met], 1.0)
    assert not found.slope[~met].any() and not found.turn[~met].any()
    np.testing.assert_array_equal(found.share[met], shares(piece, xi, normals).share[met])


@pytest.mark.parametrize("cosine", [0.05, 0.25, 0.45])
def test_a_flank_counts_by_how_much_it_is_seen(cosine):
    flank = np.array([0], dtype=np.int32)
    line = LineEnds(filleted(np.array([[0.0, 9.0], [0.0, 0.0], [-9.0, 0.0]]), 0.0, closed=False))
    normal = np.array([[cosine, -np.sqrt(1.0 - cosine**2)]])
    found = line.along_rays(flank, np.array([0.5]), np.ones(1, dtype=bool), np.ones(1), normal)
    np.testing.assert_allclose(found.share, (cosine - 0.05) / 0.4, atol=1e-12)


# -- Control points of a tool that is displaced and turned, and how they change with its unknow

PLANE = RigidMotion(np.array([0.3, -0.2]), np.array([[1.0, 0.5], [0.2, 0.4], [-0.7, 2.0]]), 0.7)


def test_turns_are_counter_clockwise_and_right_handed():
    quarter = PLANE.rotation(0.5 * np.pi)
    np.testing.assert_allclose(quarter @ [1.0, 0.0], [0.0, 1.0], atol=1e-15)
    about_z = RigidMotion(np.zeros(3), np.zeros((4, 3)), 1.0, np.array([0.0, 0.0, 2.0]))
    turned = about_z.rotation(0.5 * np.pi)
    np.testing.assert_allclose(turned @ [1.0, 0.0, 5.0], [0.0, 1.0, 5.0], atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(turned), 1.0, rtol=1e-15)
