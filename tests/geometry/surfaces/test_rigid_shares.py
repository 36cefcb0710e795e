"""How much of a point counts beside ends and sharp corners, and how that changes."""

import numpy as np
import pytest

from tribox.geometry.surfaces.rigid_polyline import FACING, LineEnds, filleted

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
    whole = shares(piece, xi, normals)
    np.testing.assert_array_equal(found.share[met], whole.share[met])


@pytest.mark.parametrize("cosine", [0.05, 0.25, 0.45])
def test_a_flank_counts_by_how_much_it_is_seen(cosine):
    flank = np.array([0], dtype=np.int32)
    line = LineEnds(filleted(np.array([[0.0, 9.0], [0.0, 0.0], [-9.0, 0.0]]), 0.0, closed=False))
    normal = np.array([[cosine, -np.sqrt(1.0 - cosine**2)]])
    found = line.along_rays(flank, np.array([0.5]), np.ones(1, dtype=bool), np.ones(1), normal)
    np.testing.assert_allclose(found.share, (cosine - 0.05) / 0.4, atol=1e-12)
