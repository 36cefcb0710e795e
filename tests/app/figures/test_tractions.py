"""Arc length of slave surfaces: order, direction, closed ones, several pieces."""

import numpy as np
import pytest

from tribox.app.figures.tractions import arc_of_points, slave_line

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
    facets = np.array([[1, 0], [3, 2], [3, 4]])
    line = slave_line(place, facets, np.zeros(5, dtype=bool))
    assert line.vertices.tolist() == [2, 3, 4, 0, 1]
    assert line.arc.tolist() == [0.0, 1.0, 2.0, 2.0, 3.0]
    arc, values = line.broken(10.0 * place[:, 0])
    assert np.isnan(arc[3]) and np.isnan(values[3])
    assert values[~np.isnan(values)].tolist() == [0.0, 10.0, 20.0, 30.0, 40.0]
    points = np.array([[0.25, 0.0], [3.5, 0.0], [2.0, 0.0]])
    assert arc_of_points(line, place, points).tolist() == [0.25, 2.5, 2.0]
