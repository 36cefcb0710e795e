"""Rigid tools in pictures: in space before and behind bodies, in frames of animations."""

import numpy as np
import pytest

from tests.app.figures.test_scenes import SQUARE, scene
from tribox.app.figures.scenes import STANDARD, VEIL, veil_of

SMALL = (SQUARE - 0.5) * [0.4, 0.0, 0.4] + [0.5, 0.0, 0.5]


def halves(square):
    """The two triangles of a square."""
    return square[[[0, 1, 2], [0, 2, 3]]]


def veiled(veil):
    """Number of pixels that show a tool."""
    return int(np.isclose(veil[..., 3], VEIL).sum())


@pytest.mark.parametrize("corners", [3, 4])
def test_a_tool_veils_what_is_behind_it_and_is_hidden_by_what_is_before(corners):
    made = scene(SQUARE[:corners])
    before, behind = (veil_of(made, halves(SMALL + up * STANDARD.eye)) for up in (0.3, -0.3))
    area = 0.16 * STANDARD.eye[1] / made.pixel**2
    # The line round it covers a pixel on each side.
    assert veiled(before) == pytest.approx(area, rel=0.03)
    hidden = 1.0 if corners == 4 else 0.5
    assert veiled(behind) == pytest.approx((1.0 - hidden) * area, rel=0.03, abs=0.001 * area)
    assert before.shape[:2] == (made.size[1], made.size[0])
