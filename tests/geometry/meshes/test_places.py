"""Points in the cells of a distorted mesh, and how far points outside are from it."""

import numpy as np
import pytest

from tests.grid import grid
from tribox.geometry.meshes.places import nearest_place, nodes_of, places_in, shape_functions

CELLS = ["triangle", "quadrilateral", "tetrahedron", "hexahedron"]


def distorted(cell):
    """Two cells (or so) a side, their inner corner moved."""
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    mesh = grid(cell, (2,) * dim)
    x = mesh.geometry.x
    x[np.all(np.abs(x[:, :dim] - 0.5) < 0.1, axis=1), :dim] += [0.12, -0.07, 0.05][:dim]
    return mesh, np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)


@pytest.mark.parametrize("cell", CELLS)
def test_a_point_is_where_its_shape_functions_say(cell):
    mesh, cells = distorted(cell)
    points = np.random.default_rng(3).uniform(0.0, 1.0, (40, mesh.geometry.dim))
    found = places_in(mesh, cells, points)
    assert np.array_equal(found.point, np.arange(40))  # each in one cell alone
    table = shape_functions(cell, 1, 0, found.xi)[0]
    back = np.einsum("ka,kai->ki", table, nodes_of(mesh, found.cell))
    np.testing.assert_allclose(back, points[found.point], atol=1e-12)


@pytest.mark.parametrize("cell", CELLS)
def test_a_node_is_in_all_cells_around_it_and_a_point_outside_in_none(cell):
    mesh, cells = distorted(cell)
    dim = mesh.geometry.dim
    inner = np.array([0.62, 0.43, 0.55][:dim])
    around = np.abs(nodes_of(mesh, cells) - inner).max(axis=2).min(axis=1) < 1e-9
    points = np.stack([inner, np.full(dim, 1.0 + 1e-4), np.full(dim, 1.0 + 1e-9)])
    found = places_in(mesh, cells, points)
    assert sorted(found.cell[found.point == 0]) == np.flatnonzero(around).tolist()
    assert around.sum() > 1
    assert not np.any(found.point == 1) and np.any(found.point == 2)
    # A body may have no cells on a rank, and a rank no points.
    assert len(places_in(mesh, cells[:0], points).cell) == 0
    assert places_in(mesh, cells, points[:0]).xi.shape == (0, dim)


@pytest.mark.parametrize("cell", CELLS)
def test_distance_of_a_point_outside(cell):
    mesh, cells = distorted(cell)
    point = np.array([1.3, 1.4, 0.3][: mesh.geometry.dim])
    distance, place = nearest_place(mesh, cells, point)
    assert distance == pytest.approx(0.5)
    assert place == pytest.approx([1.0, 1.0, 0.3][: mesh.geometry.dim])
    assert nearest_place(mesh, cells[:0], point)[0] == np.inf
