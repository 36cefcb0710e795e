"""The renderer: what is in front is seen, without teeth where two bodies touch."""

import numpy as np
import pytest

from tribox.app.figures.scenes import OBLIQUE, Camera, Scene, camera_at, facets_seen

SQUARE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.0, 1.0]])


def scene(*sheets: np.ndarray, camera: Camera = camera_at(OBLIQUE)) -> Scene:
    position = np.concatenate(sheets)
    polygons = np.arange(len(position)).reshape(len(sheets), -1)
    colours = np.linspace(0.2, 0.9, 3 * len(sheets)).reshape(-1, 3)
    number = np.arange(len(sheets))
    low, high = position.min(axis=0), position.max(axis=0)
    return Scene(position, polygons, colours, number, low, high, camera)


CAMERAS = [camera_at(OBLIQUE), camera_at((-0.2, 0.3, -0.4), 2), camera_at((0.0, 0.0, 1.0))]


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("corners", [3, 4])
def test_each_pixel_shows_the_nearest_facet_at_its_middle(corners, camera):
    """Triangles and parallelograms through each other, against all facets at every tenth pixel."""
    rng = np.random.default_rng(5)
    first, u, v = rng.random((30, 3)), *(0.6 * rng.random((2, 30, 3)) - 0.3)
    sheets = [first, first + u, first + u + v, first + v][:corners]
    made = scene(*np.stack(sheets, axis=1), camera=camera)
    seen = facets_seen(made)
    low, _ = made.window
    height, width = seen.shape
    rows, columns = (g.reshape(-1) for g in np.mgrid[5:height:10, 5:width:10])
    place = low + (np.stack([columns, height - 1 - rows], axis=1) + 0.5) * made.pixel
    axes = np.stack([camera.right, camera.up])
    # The second side of a triangle ends where that of a parallelogram begins.
    sides = np.stack([u, v if corners == 4 else u + v], axis=2)
    at = np.linalg.solve(axes @ sides, (place[:, None] - first @ axes.T).transpose(1, 2, 0))
    depth = (first @ camera.eye)[:, None] + np.einsum("i,fij,fjp->fp", camera.eye, sides, at)
    most = at.max(axis=1) if corners == 4 else at.sum(axis=1)
    depth[(at.min(axis=1) < 0.0) | (most > 1.0)] = -np.inf
    expected = np.where(np.isfinite(depth.max(axis=0)), depth.argmax(axis=0), -1)
    assert len(set(expected)) > 15
    np.testing.assert_array_equal(seen[rows, columns], expected)


def test_cameras_see_what_points_upwards_upwards():
    """Right-handed unit vectors; from above y or z is towards the eye and x to the right."""
    for upwards in (1, 2):
        for eye in (OBLIQUE, (-0.3, -0.8, -0.4), (0.0, 1.0, 0.0)):
            camera = camera_at(eye, upwards)
            whole = np.stack([camera.right, camera.up, camera.eye])
            np.testing.assert_allclose(whole @ whole.T, np.eye(3), atol=1e-15)
            assert np.linalg.det(whole) > 0.0
            assert camera.up[upwards] > 0.0 == pytest.approx(camera.right[upwards])
        above = camera_at((0.0, 0.0, 1.0), upwards)
        np.testing.assert_array_equal(above.eye, np.eye(3)[upwards])
        np.testing.assert_array_equal(above.right, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(camera_at(OBLIQUE).eye, [0.4349, 0.3749, 0.8188], atol=1e-4)
