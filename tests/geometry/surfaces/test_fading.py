"""What share of a point's piece of surface is over the master, where this ends in the plane."""

import numpy as np

from tests.geometry.surfaces.test_projection import polyline
from tests.geometry.surfaces.test_vertices import graded
from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.projection import FacetSurface

NODES = np.array([[0.0, 0.0], [2.0, 0.0], [3.0, 0.0], [3.5, 0.0]])


def shares(x, piece, nodes=NODES, line=None):
    points = np.stack([np.atleast_1d(x), np.full(np.size(x), 0.1)], axis=1)
    pieces = np.broadcast_to(np.asarray(piece, dtype=float), np.size(x))
    return (line or polyline(nodes)).project(points, nodes, fading=pieces)


def test_a_piece_leaves_as_far_as_its_point_comes_near_the_end():
    """Whole at its length from the end, half at half of it; likewise at the other end."""
    x = np.array([0.05, 0.1, 0.15, 0.2, 0.25, 1.9, 2.0, 2.5, 3.2, 3.3, 3.4, 3.45])
    at = shares(x, 0.2)
    expected = np.minimum(np.minimum(x, 3.5 - x) / 0.2, 1.0)
    np.testing.assert_allclose(at.share, expected, rtol=1e-12)
    near = expected < 1.0 - 1e-9
    sign, length = np.where(x < 1.0, 1.0, -1.0), np.where(x < 1.0, 2.0, 0.5)
    edge = np.abs(expected - 1.0) < 1e-9
    slope = np.where(near, sign * length / 0.2, 0.0)
    np.testing.assert_allclose(at.share_slope[near | ~edge, 0], slope[near | ~edge], rtol=1e-12)


def test_a_piece_longer_than_the_last_facet_takes_all_of_that():
    np.testing.assert_allclose(shares([3.1, 3.3, 2.9], 0.8).share, [0.8, 0.4, 1.0], rtol=1e-12)


def test_of_a_single_facet_the_nearer_end_counts():
    nodes = np.array([[0.0, 0.0], [1.0, 0.0]])
    at = shares([0.1, 0.3, 0.8, 0.95], [0.4, 0.2, 0.4, 0.4], nodes)
    np.testing.assert_allclose(at.share, [0.25, 1.0, 0.5, 0.125], rtol=1e-12)
    np.testing.assert_allclose(at.share_slope[:, 0], [2.5, 0.0, -2.5, -2.5], rtol=1e-12)


def test_lengths_are_those_of_the_undeformed_master():
    """The share depends on ξ alone."""
    at = shares([0.2], 0.2, 2.0 * NODES, polyline(NODES))
    np.testing.assert_allclose(at.share, [0.5], rtol=1e-12)


def test_where_nothing_ends_nothing_fades():
    """Far from the ends, on a closed master, and without pieces."""
    assert shares([2.2, 2.6], 0.2).share is None
    assert polyline(NODES).project(np.array([[0.05, 0.1]]), NODES).share is None
    angle = -np.linspace(0.0, 2.0 * np.pi, 9)[:-1]
    nodes = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    facets = np.stack([np.arange(8), (np.arange(8) + 1) % 8], axis=1)
    closed = FacetSurface(facet_shape("interval", 1), facets, nodes)
    points = 1.05 * 0.5 * (nodes + np.roll(nodes, -1, axis=0))
    assert closed.project(points, nodes, fading=np.full(8, 0.5)).share is None


def test_the_way_of_fading_in_numbers():
    """Gauss' three points at ½ ± √0.15 with pieces 5/18, 8/18, 5/18."""
    slave = graded("Q4").slave
    x, width = np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)]), np.array([5, 8, 5]) / 18
    edge = np.append(0.0, np.cumsum(width))
    expected = 0.5 * np.minimum(x - edge[:-1], edge[1:] - x)
    for facet in range(4):
        here = np.nonzero(slave.facet == facet)[0]
        here = here[np.argsort(slave.xi[here, 0])]
        np.testing.assert_allclose((slave.reach / slave.facet_length)[here], expected, rtol=1e-12)
