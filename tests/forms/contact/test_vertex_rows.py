"""Rows of vertices summed over points: against plain sums, and when their places serve again."""

from __future__ import annotations

import numpy as np
import pytest

from tests.forms.contact.test_tangent import STATES, prepared
from tribox.forms.contact.tangent import PairTangent
from tribox.forms.contact.vertex_rows import VertexRows

POINTS, VERTICES, NODES, DIM = 12, 5, 7, 2


def rows_of(needs=None):
    """Groups of three points with the same vertices and nodes; a node may come twice."""
    rng = np.random.default_rng(1)
    key = np.repeat([4, 0, 9, 2], 3)
    vertex = np.repeat(rng.integers(0, VERTICES, (4, 2)), 3, axis=0)
    nodes = np.repeat(rng.integers(0, NODES, (4, 3)), 3, axis=0)
    needs = np.ones(VERTICES, dtype=bool) if needs is None else needs
    points, facet = np.arange(POINTS), key.astype(np.int32)
    made = VertexRows(points, facet, needs, (key, vertex, nodes), (NODES, DIM))
    return made, vertex, nodes


@pytest.mark.parametrize("needed", [[True] * 5, [True, False, True, True, False], [False] * 5])
def test_entries_are_summed_in_the_rows_that_are_needed(needed):
    needs = np.array(needed)
    made, vertex, nodes = rows_of(needs)
    values = np.random.default_rng(2).normal(size=(POINTS, 2, 3, DIM))
    expected = np.zeros((VERTICES, NODES * DIM))
    column = DIM * nodes[:, None, :, None] + np.arange(DIM)
    np.add.at(expected, np.broadcast_arrays(vertex[:, :, None, None], column), values)
    expected[~needs] = 0.0
    for _ in range(2):
        np.testing.assert_allclose(made.matrix(values).toarray(), expected, atol=1e-14)
    assert not made.matrix(values)[~needs].nnz


def test_places_serve_for_the_same_points_facets_and_vertices_only():
    made, _, _ = rows_of()
    points, facet, needs = made.points, made.facet, made.needs
    assert made.fits(points.copy(), facet.copy(), needs.copy())
    assert not made.fits(points + 1, facet, needs)
    assert not made.fits(points, facet[::-1], needs)
    assert not made.fits(points, facet, np.arange(VERTICES) > 0)
    assert not made.fits(points[:-1], facet[:-1], needs)


@pytest.mark.parametrize("shape", ["Q4", "hex8"])
def test_tangent_after_a_way_is_that_of_a_fresh_one(shape):
    """The same points on other master facets, then with other vertices closed."""
    scene, _ = prepared(shape, STATES["slip"], fine=True, degree=5, master=8)
    found = []
    for shift, down, waves in ((0.0, -0.12, 0.0), (0.1, -0.12, 0.0), (0.1, -0.05, 0.02)):
        x = scene.vector([shift, 0.0, down][:: 4 - scene.dim], 0.0, 0.0, waves)
        trial = scene.term.evaluate(x, 1.0)
        fresh = PairTangent(scene.surface, scene.term.rule)
        mine, its = (
            tangent.vertex_coupling(scene.term.state, trial)
            for tangent in (scene.term.linearised, fresh)
        )
        np.testing.assert_array_equal(mine.matrix.toarray(), its.matrix.toarray())
        found.append((trial.kinematics.closed.sum(), trial.projection.facet))
    assert found[0][0] == found[1][0] > found[2][0]
    assert not np.array_equal(found[0][1], found[1][1])
