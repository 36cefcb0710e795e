"""Polygons of bodies, and the numbers they are coloured by."""

import meshio
import numpy as np
import pytest

from tests.app.figures.made_results import CELLS, strip_fields
from tribox.app.errors import InputError
from tribox.app.figures.body_shapes import read_bodies
from tribox.app.figures.tractions import arc_of_points, slave_line


def test_every_body_is_there_with_its_outline():
    bodies = read_bodies(strip_fields(4), ["punch", "strip", "die"], "von_mises_stress")
    assert np.bincount(bodies.body).tolist() == list(CELLS)
    assert np.bincount(bodies.edge_body).tolist() == [2 * (4 + 2), 2 * (8 + 1), 2 * (6 + 2)]
    np.testing.assert_allclose(bodies.field.values, 4e6 * (1 + bodies.body))
    moved = bodies.position - bodies.reference
    assert moved[:15, 0] == pytest.approx(2e-4) and not moved[15:].any()


def brick(kind: str) -> meshio.Mesh:
    """Two hexahedra on each other, or one of degree 2, or two tetrahedra with a common side."""
    grid = np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0, 2.0], indexing="ij"), axis=-1)
    points = grid.reshape(-1, 3)
    cells = {
        "hexahedron": [[0, 6, 9, 3, 1, 7, 10, 4], [1, 7, 10, 4, 2, 8, 11, 5]],
        "hexahedron27": [[0, 6, 9, 3, 1, 7, 10, 4, *[2] * 19]],
        "tetra": [[0, 6, 9, 1], [1, 6, 9, 10]],
    }[kind]
    data = {"body": [np.zeros(len(cells))], "v": [np.arange(len(cells)) + 1.0]}
    moved = {"displacement": np.zeros_like(points)}
    return meshio.Mesh(points, [(kind, np.array(cells))], point_data=moved, cell_data=data)


@pytest.mark.parametrize(
    ("kind", "sides", "corners"), [("hexahedron", 10, 4), ("hexahedron27", 6, 4), ("tetra", 6, 3)]
)
def test_in_space_only_outer_facets_are_drawn(kind, sides, corners):
    bodies = read_bodies(brick(kind), ["brick"], "v")
    assert bodies.polygons.shape == (sides, corners)
    cells = len(brick(kind).cells[0].data)
    assert bodies.field.values.tolist() == sorted([1.0, 2.0][:cells] * (sides // cells))


def test_a_field_of_nodes_vectors_and_tensors():
    mesh = strip_fields(5)
    names = ["punch", "strip", "die"]
    length = read_bodies(mesh, names, "displacement").field
    across = read_bodies(mesh, names, "displacement_x").field
    np.testing.assert_allclose(length.values, across.values)
    assert length.values[0] == pytest.approx(3e-4) and length.unit == "m"
    shear = read_bodies(mesh, names, "cauchy_stress_xy").field
    np.testing.assert_allclose(
        shear.values, read_bodies(mesh, names, "von_mises_stress").field.values
    )
    for wrong, said in (("strain", "there are body"), ("cauchy_stress", "a tensor")):
        with pytest.raises(InputError, match=said):
            read_bodies(mesh, names, wrong)
    with pytest.raises(InputError, match="there are x, y"):
        read_bodies(mesh, names, "displacement_xy")


# -- Arc length of slave surfaces: order, direction, closed ones, several pieces -------------------

CLOSED, OPEN = True, False


def shuffled(count: int, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Facets of a chain of nodes, in no order, and the new number of each old node."""
    rng = np.random.default_rng(3)
    number = rng.permutation(count)
    ends = np.arange(count if closed else count - 1)
    facets = np.stack([number[ends], number[(ends + 1) % count]], axis=1)
    flipped = rng.random(len(facets)) < 0.5
    facets[flipped] = facets[flipped, ::-1]
    return facets[rng.permutation(len(facets))], number


@pytest.mark.parametrize("middle", [0.0, 1.0, 3.0, 5.5])
def test_a_ring_is_cut_opposite_to_what_is_pressed(middle):
    """A roller's contact stays in one piece, wherever on the roller it is."""
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    facets, number = shuffled(60, CLOSED)
    place, pressed = np.empty((60, 2)), np.empty(60, dtype=bool)
    place[number] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    pressed[number] = np.cos(angle - middle) > 0.8
    line = slave_line(place, facets, pressed)
    assert len(line.vertices) == 61 and line.vertices[0] == line.vertices[-1]
    at = np.flatnonzero(pressed[line.vertices])
    assert (np.diff(at) == 1).all()
    assert abs(0.5 * (at[0] + at[-1]) - 30) <= 1
    turn = np.cross(np.append(place[line.vertices[0]], 0), np.append(place[line.vertices[1]], 0))
    assert turn[2] > 0.0  # against the clock


def test_pieces_follow_one_another_with_a_gap_between_them():
    place = np.array([[3.0, 0.0], [4.0, 0.0], [0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    line = slave_line(place, np.array([[1, 0], [3, 2], [3, 4]]), np.zeros(5, dtype=bool))
    assert line.vertices.tolist() == [2, 3, 4, 0, 1]
    assert line.arc.tolist() == [0.0, 1.0, 2.0, 2.0, 3.0]
    arc, values = line.broken(10.0 * place[:, 0])
    assert np.isnan(arc[3]) and np.isnan(values[3])
    assert values[~np.isnan(values)].tolist() == [0.0, 10.0, 20.0, 30.0, 40.0]
    points = np.array([[0.25, 0.0], [3.5, 0.0], [2.0, 0.0]])
    assert arc_of_points(line, place, points).tolist() == [0.25, 2.5, 2.0]
