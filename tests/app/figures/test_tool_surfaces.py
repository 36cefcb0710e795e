"""Rigid tools in pictures: in space before and behind bodies, in frames of animations."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba

from tests.app.figures.test_scenes import SQUARE, scene
from tribox.app.figures import animation
from tribox.app.figures.scenes import EYE, RIGHT, UP
from tribox.app.figures.tool_surfaces import COLOUR, VEIL, veil_of

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
    before, behind = (veil_of(made, halves(SMALL + up * EYE)) for up in (0.3, -0.3))
    area = 0.16 * EYE[1] / made.pixel**2
    # The line round it covers a pixel on each side.
    assert veiled(before) == pytest.approx(area, rel=0.03)
    hidden = 1.0 if corners == 4 else 0.5
    assert veiled(behind) == pytest.approx((1.0 - hidden) * area, rel=0.03, abs=0.001 * area)
    assert before.shape[:2] == (made.size[1], made.size[0])


def test_what_touches_is_seen_on_the_side_of_the_eye():
    """A tool on the very surface of a body: no speckles."""
    made = scene(SQUARE)
    area = 0.16 * EYE[1] / made.pixel**2
    assert veiled(veil_of(made, halves(SMALL))) == pytest.approx(area, rel=0.03)


def test_a_tool_far_larger_than_the_picture_is_cut_off():
    """Its triangles would take a hundred million samples each."""
    made = scene(SQUARE)
    wide = (SQUARE - [0.5, 0.0, 0.5]) * 1e3 + [0.5, 0.0, 0.5] + 0.3 * EYE
    veil = veil_of(made, halves(wide))
    assert np.isclose(veil[..., 3], VEIL).all()
    away = veil_of(made, halves(SQUARE + 50.0 * RIGHT + 3.0 * UP))
    assert not away.any()


def test_frames_in_the_plane_show_tools_where_they_are(strip, monkeypatch):
    """The strip has no tools: lines that stand for one come up from step to step."""
    lines = {s: np.array([[[0.0, 1e-4 * s], [1e-3, 1e-4 * s]]]) for s in range(1, 6)}
    monkeypatch.setattr(animation, "tool_lines", lambda results, step: lines[step])
    states = [animation.read_bodies(strip.fields(s), ["punch", "strip", "die"], "von_mises_stress")
              for s in lines]  # fmt: skip
    scale = animation.common_scale([state.field for state in states])
    figure, draw = animation._in_the_plane(strip, list(lines), states, scale)
    heights = []
    for number in range(5):
        draw(number)
        (drawn,) = [
            one
            for one in figure.axes[0].collections
            if isinstance(one, LineCollection) and np.allclose(one.get_color()[0], to_rgba(COLOUR))
        ]
        heights.append(drawn.get_segments()[0][0][1])
    np.testing.assert_allclose(np.divide(heights, heights[0]), np.arange(1, 6))
