"""The renderer: what is in front is seen, without teeth where two bodies touch."""

import numpy as np
import pytest

from tribox.app.figures.scenes import EYE, RIGHT, UP, Scene, facets_seen, rendered

SQUARE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]])


def scene(*sheets: np.ndarray) -> Scene:
    position = np.concatenate(sheets)
    polygons = np.arange(len(position)).reshape(len(sheets), -1)
    colours = np.linspace(0.2, 0.9, 3 * len(sheets)).reshape(-1, 3)
    number = np.arange(len(sheets))
    low, high = position.min(axis=0), position.max(axis=0)
    return Scene(position, polygons, colours, number, low, high)


@pytest.mark.parametrize("corners", [3, 4])
def test_each_pixel_shows_the_nearest_facet_at_its_middle(corners):
    """Triangles and parallelograms through each other, against all facets at every tenth pixel."""
    rng = np.random.default_rng(5)
    first, u, v = rng.random((30, 3)), *(0.6 * rng.random((2, 30, 3)) - 0.3)
    sheets = [first, first + u, first + u + v, first + v][:corners]
    made = scene(*np.stack(sheets, axis=1))
    seen = facets_seen(made)
    low, _ = made.window
    height, width = seen.shape
    rows, columns = (g.reshape(-1) for g in np.mgrid[5:height:10, 5:width:10])
    place = low + (np.stack([columns, height - 1 - rows], axis=1) + 0.5) * made.pixel
    axes = np.stack([RIGHT, UP])
    # The second side of a triangle ends where that of a parallelogram begins.
    sides = np.stack([u, v if corners == 4 else u + v], axis=2)
    at = np.linalg.solve(axes @ sides, (place[:, None] - first @ axes.T).transpose(1, 2, 0))
    depth = (first @ EYE)[:, None] + np.einsum("i,fij,fjp->fp", EYE, sides, at)
    most = at.max(axis=1) if corners == 4 else at.sum(axis=1)
    depth[(at.min(axis=1) < 0.0) | (most > 1.0)] = -np.inf
    expected = np.where(np.isfinite(depth.max(axis=0)), depth.argmax(axis=0), -1)
    assert len(set(expected)) > 15
    np.testing.assert_array_equal(seen[rows, columns], expected)


def test_a_plate_of_many_facets_has_no_cracks():
    """Facets from much smaller than a pixel to some pixels, bent so that no side is level."""
    lines = np.linspace(0.0, 1.0, 160) ** 3
    x, z = np.meshgrid(lines, lines)
    nodes = np.stack([x, 0.02 * np.sin(9.0 * x * z), z], axis=-1)
    sides = nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]
    seen = facets_seen(scene(*np.stack(sides, axis=2).reshape(-1, 4, 3))) >= 0
    for line in (*seen, *seen.T):
        [inside] = np.nonzero(line)
        assert len(inside) == 0 or line[inside[0] : inside[-1] + 1].all()


def test_the_picture_is_white_outside_and_shaded_inside():
    made = scene(SQUARE)
    seen = facets_seen(made)
    picture = rendered(made, seen)
    assert picture.shape == (*made.size[::-1], 3)
    assert (picture[seen < 0].min() < 255) and (picture[0, 0] == 255).all()
    inside = picture[seen.shape[0] // 2, seen.shape[1] // 2] / 255.0
    assert (inside <= made.colours[0] + 0.01).all() and inside == pytest.approx(
        made.colours[0], rel=0.4
    )
