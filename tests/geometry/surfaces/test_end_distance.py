"""Distances from the open end of a surface, and the share that counts there."""

import numpy as np
import pytest

from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.projection import EndDistance

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
    is_open = np.isin(np.arange(8), [0, 7])
    end = EndDistance.measured(CHAIN, facets, nodes, is_open, 2.5)
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
