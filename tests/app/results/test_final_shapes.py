"""What is said of bent lines in the end: angle, springback, and whether they are one bend."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from tribox.app.results.point_probes import ShapeTable, shape_of
from tribox.app.results.probes import final_shapes, shape_line


@pytest.mark.parametrize(
    ("pressing", "angles", "springback"),
    [
        ([5.0, 9.0, 0.0], [0.4, 0.9, 0.7], 0.2),
        ([5.0, 9.0, 0.0], [0.4, 0.7, 0.9], -0.2),  # coined: it closes further when let go
        ([9.0, 1e-8, 0.0], [0.7, 0.9, 0.9], -0.2),  # and held
        ([5.0, 9.0, 9.0], [0.4, 0.7, 0.9], 0.0),  # bent on
        ([0.0, 0.0, 0.0], [0.4, 0.9, 0.7], 0.2),  # by moments, without a contact
        ([9.0], [0.9], None),
    ],
)
def test_springback_is_what_a_bend_opens_by_when_tools_let_go(
    tmp_path, pressing, angles, springback
):
    rows = [f"{step},{step},s,bend,{angle}" for step, angle in enumerate(angles, 1)]
    text = "\n".join(["step,time,stage,probe,bend_angle", *rows, ""])
    (tmp_path / "shape_probes.csv").write_text(text)
    found = final_shapes(tmp_path, dict(enumerate(pressing, 1)))["bend"]["springback"]
    assert found == (None if springback is None else pytest.approx(springback))


def bent_line(degrees, straight=()):
    """Shape of a flat line of eight pieces of 1 m whose pieces are turned by degrees each."""
    turned = np.radians(degrees)
    steps = np.c_[np.cos(turned), np.sin(turned)]
    places = [np.concatenate([[[0.0, 0.0]], np.cumsum(s, axis=0)]) for s in (steps, steps**0)]
    flat = places[1] * [1.0, 0.0]
    way = np.arange(9.0)
    pieces = np.array([(way >= a) & (way <= b) for a, b in straight]).reshape(len(straight), 9)
    line = SimpleNamespace(
        probe=SimpleNamespace(name="line"), place=flat, way=way, straight=pieces,
        bend=np.ones(9, dtype=bool),
    )  # fmt: skip
    numbers = shape_of(line, places[0], flat[:0])
    shape = dict(zip(ShapeTable.columns, ("line", *numbers), strict=True))
    return {key: None if value != value else value for key, value in shape.items()}


HAT = [0, 0, 60, 60, 60, 60, 0, 0]


@pytest.mark.parametrize(
    ("degrees", "straight", "angle", "most", "said"),
    [
        (HAT, (), 0.0, 60.0, r"to and fro, by up to 60 deg between two places and by \S+ deg from"),
        (HAT, ((0, 2), (3, 5)), 60.0, 60.0, r"by 60 deg, springback 3 deg, radius \S+ m of a"),
        ([0, 10, 20, 30, 40, 50, 60, 70], (), 80.0, 80.0, r"by 80 deg, .* 3 deg, radius \S+ m$"),
        ([0.0, 0.0, 0.4, 0.4, 0.0, 0.0, 0.0, 0.0], (), 0.0, 0.4, "by .* deg, springback 3 deg, "),
    ],
)
def test_the_angle_of_a_line_that_is_bent_to_and_fro_is_not_said_to_be_one_bend(
    degrees, straight, angle, most, said
):
    """A flange, a wall and a flat: from end to end nothing has turned."""
    shape = bent_line(degrees, straight)
    assert np.degrees(shape["bend_angle"]) == pytest.approx(angle, abs=1e-9)
    assert np.degrees(shape["largest_turn"]) == pytest.approx(most, rel=1e-9)
    line = shape_line("line", shape | {"springback": np.radians(3.0)})
    assert re.match(f"probe line: bent {said}", line)
