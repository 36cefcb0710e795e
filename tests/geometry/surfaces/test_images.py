"""Images of a surface beyond planes of symmetry, and where there is none."""

import numpy as np
import pytest

from tests.geometry.surfaces.test_smoothing import SMOOTHING_ANGLE, places
from tribox.geometry.surfaces.facets import facet_shape
from tribox.geometry.surfaces.images import images_beyond, planes_of_symmetry
from tribox.geometry.surfaces.smoothing import smooth_patches


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("axis", [0, 1])
def test_half_a_line_with_its_image_is_half_of_the_whole(axis, flipped):
    """An arc from a plane of symmetry on, whichever way it is run through, moved as it may."""
    angle = np.linspace(-0.9, 0.9, 13)
    whole = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    whole[:, 1] += 0.1 * np.cos(3.0 * angle)
    half, count = whole[6:], 6
    if axis == 1:
        whole, half = whole[:, ::-1] * [1.0, 1.0], half[:, ::-1]
    chain = np.stack([np.arange(12), np.arange(1, 13)], axis=1).astype(np.int32)
    turn = slice(None, None, -1 if flipped else 1)
    facets, own = chain[:, turn], chain[:count, turn]
    held = np.zeros(half.shape, dtype=bool)
    held[0, axis] = True
    images = images_beyond(facet_shape("interval", 1), own, half, held, SMOOTHING_ANGLE)
    every = np.concatenate([half, images.position])
    np.testing.assert_allclose(images.position, whole[[5]], atol=1e-15)
    shape = facet_shape("interval", 1)
    xi = np.linspace(0.0, 1.0, 7)[:, None]
    for moved in (1.0, 1.3):
        now = every * [1.0, moved] if axis == 0 else every * [moved, 1.0]
        full = whole * [1.0, moved] if axis == 0 else whole * [moved, 1.0]
        mine = smooth_patches(shape, own, every, SMOOTHING_ANGLE, images=images)
        other = smooth_patches(shape, facets, whole, SMOOTHING_ANGLE)
        np.testing.assert_allclose(places(mine, now, xi), places(other, full, xi)[6:], atol=1e-14)


@pytest.mark.parametrize(("slope", "count"), [(0.0, 1), (0.2, 1), (0.3, 0), (5.0, 0)])
def test_no_image_where_line_and_image_meet_sharply(slope, count):
    """30 degrees between both are 15 on each side, a slope of 0.27."""
    nodes = np.array([[0.0, 0.0], [1.0, slope], [2.0, 2.0 * slope]])
    held = np.array([[True, False], [False, False], [False, False]])
    chain = np.array([[0, 1], [1, 2]], dtype=np.int32)
    assert (
        len(images_beyond(facet_shape("interval", 1), chain, nodes, held, SMOOTHING_ANGLE).of)
        == count
    )


def test_no_image_of_a_clamped_end_nor_at_a_corner_that_points_inwards():
    """Neither is a plane of symmetry; images there would lie on facets of the surface."""
    nodes, chain = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0, 1]], dtype=np.int32)
    clamped = np.array([[True, True], [False, False]])
    line = facet_shape("interval", 1), chain, nodes
    assert not len(images_beyond(*line, clamped, SMOOTHING_ANGLE).of)
    # An L of three squares: x = 1 ends one of them only, at a corner of all three.
    at = np.stack(np.meshgrid(*[np.arange(3.0)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    nodes = np.column_stack([at, np.zeros(9)])
    squares = np.array([[a, a + 3, a + 1, a + 4] for a in (0, 1, 3)], dtype=np.int32)
    planes = planes_of_symmetry(
        facet_shape("quadrilateral", 1), squares, nodes, np.eye(3, dtype=bool)[[0] * 9]
    )
    assert [(axis, nodes[on, :2].tolist()) for axis, on in planes] == [
        (0, [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0]]),
        (0, [[1.0, 2.0]]),
        (0, [[2.0, 0.0], [2.0, 1.0]]),
    ]
