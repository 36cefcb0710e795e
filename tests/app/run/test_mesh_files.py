"""What the picture of a case shows beside its mesh."""

from mpi4py import MPI

from tribox.app.build.mesh import make_mesh
from tribox.app.case.reading import load_case
from tribox.app.run.mesh_files import marks_of
from tribox.geometry.pictures.plane import draw

PRESSED = """
title = "box under a ball"
geometry.kind = "blocks"
geometry.blocks = { pad = { x = ["0 mm", "20 mm"], y = ["0 mm", "6 mm"], elements = [4, 2] } }
bodies = { pad = { material = "neo-hookean", E = "5 MPa", nu = 0.45 } }
tools.ball.shape = "circle"
tools.ball.centre = ["10 mm", "14 mm"]
tools.ball.radius = "8 mm"
tools.ball.displacement = { y = [["0 s", "0 mm"], ["1 s", "-2 mm"], ["2 s", "1 mm"]], x = 0 }
boundary = [
    { surface = "pad_bottom", displacement = { x = 0, y = 0 } },
    { surface = "pad_left", pressure = "1 MPa" },
    { surface = "pad_right", platen = { direction = "x", force = "3 N" } },
]
stage = [{ name = "press", duration = "2 s", steps = 4 }]
[[contact]]
name = "touch"
slave = "pad_top"
master = "ball"
friction = { law = "coulomb", mu = 0.3 }
"""


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
