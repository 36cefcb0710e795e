"""What the picture of a case shows beside its mesh."""

import pytest
from mpi4py import MPI

from tribox.app.build.mesh import make_mesh
from tribox.app.case.reading import load_case
from tribox.app.run.mesh_files import marks_of
from tribox.geometry.pictures.plane import draw

PRESSED = """
title = "box under a ball"
[geometry]
kind = "blocks"
[geometry.blocks.pad]
x = ["0 mm", "20 mm"]
y = ["0 mm", "6 mm"]
elements = [4, 2]
[bodies.pad]
material = "neo-hookean"
E = "5 MPa"
nu = 0.45
[tools.ball]
shape = "circle"
centre = ["10 mm", "14 mm"]
radius = "8 mm"
displacement = { y = [["0 s", "0 mm"], ["1 s", "-2 mm"], ["2 s", "1 mm"]], x = 0 }
[[contact]]
name = "touch"
slave = "pad_top"
master = "ball"
friction = { law = "coulomb", mu = 0.3 }
[[boundary]]
surface = "pad_bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "pad_left"
pressure = "1 MPa"
[[boundary]]
surface = "pad_right"
platen = { direction = "x", force = "3 N" }
[[stage]]
name = "press"
duration = "2 s"
steps = 4
"""
IN_SPACE = {
    'y = ["0 mm", "6 mm"]': 'y = ["0 mm", "6 mm"]\nz = ["0 mm", "16 mm"]',
    "[4, 2]": "[4, 2, 2]",
    'shape = "circle"': 'shape = "sphere"',
    '"14 mm"]': '"14 mm", "8 mm"]',
    "x = 0 }\n[[contact]]": "x = 0, z = 0 }\n[[contact]]",
    "{ x = 0, y = 0 }": "{ x = 0, y = 0, z = 0 }",
}


def picture(tmp_path, text):
    path = tmp_path / "case.toml"
    path.write_text(text)
    case = load_case(path)
    named = make_mesh(case, MPI.COMM_SELF)
    marks = marks_of(case, named)
    return marks, draw(named, case.title, marks)


def test_tools_pairs_and_conditions_are_in_the_picture(tmp_path):
    marks, figure = picture(tmp_path, PRESSED)
    [axes] = figure.axes
    assert {t.get_text() for t in axes.texts} == {
        "tool ball: x held, y moved",
        "pad_bottom: x, y held", "pad_left: pressure", "pad_right: platen in x", "pad_top",
    }  # fmt: skip
    assert figure.get_suptitle().endswith("\ntouch: pad_top on ball, coulomb 0.3")
    # The way that the motion begins, down, and not where it ends.
    assert [a.direction for a in marks.arrows["ball"] if a.kind == "moved"] == [(0.0, -1.0)]
    assert [a.kind for a in marks.arrows["pad_bottom"]] == ["held", "held"]
    assert axes.get_ylim()[1] > 7.0, "there is room for the ball above the pad"
    assert {t.get_text() for t in axes.get_legend().get_texts()} >= {"held", "moved", "loaded"}


def test_in_space_there_are_four_views(tmp_path):
    text = PRESSED
    for old, new in IN_SPACE.items():
        assert old in text
        text = text.replace(old, new)
    _, figure = picture(tmp_path, text)
    assert [axes.get_title() for axes in figure.axes] == [
        "", "from behind and below", "from the front", "from above",
    ]  # fmt: skip
    [legend] = figure.legends
    words = {t.get_text() for t in legend.get_texts()}
    assert {"tool ball: x, z held, y moved", "pad_left: 4; pressure"} <= words
    top = figure.axes[0].get_zlim()[1]
    assert top == pytest.approx(22.0, rel=0.05), "the ball is in the picture"
