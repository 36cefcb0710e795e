"""Figures at the end of a run: drawn from its files, and never the end of it."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tribox.app.build.mesh import make_mesh
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.errors import Interrupted
from tribox.app.figures import run_figures
from tribox.app.figures.mesh_picture import draw
from tribox.app.results import Results
from tribox.app.run.mesh_files import marks_of
from tribox.app.run.run import run_case
from tribox.app.simulation.run_state import Observer


def small(block: str) -> Case:
    data = tomllib.loads(block)
    data["stage"] = [{"name": "press", "duration": "1 s", "steps": 2}]
    return Case.model_validate(data | {"output": {"figures": True, "fields_every": 1}})


def test_a_figure_that_cannot_be_drawn_is_a_warning(block, tmp_path, monkeypatch):
    def fails(results: Results, field: str = "") -> None:
        assert results.summary["status"] == "done" and len(results.history) == 2
        raise ValueError("no such colour")

    monkeypatch.setattr(run_figures, "draw_figures", fails)
    simulation = run_case(small(block), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    assert len(simulation.rows) == 2
    log = read_log(tmp_path / "out")
    assert "warning: the figures could not be drawn: ValueError('no such colour')" in log


def test_an_interrupted_run_has_figures(block, tmp_path, monkeypatch):
    from tribox.app.run import progress

    def stop(self, state, row, result) -> None:
        raise Interrupted

    monkeypatch.setattr(progress.Together, "step", stop)
    with pytest.raises(KeyboardInterrupt):
        run_case(small(block), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    assert {path.name for path in (tmp_path / "out" / "figures").iterdir()} >= {
        "deformed.png", "history.png",
    }  # fmt: skip
    assert issubclass(progress.Together, Observer)


# -- What the picture of a case shows beside its mesh ----------------------------------------------

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


# -- What a run loads: libraries that it does not need take longer than the run of a small case ----

ROOT = Path(__file__).parents[3]
NOT_NEEDED = (
    *("pandas", "gmsh", "pyvista", "pint", "jinja2", "numba", "IPython"),
    *("matplotlib.pyplot", "matplotlib.animation", "mpl_toolkits.axes_grid1"),
    *("scipy.optimize", "scipy.integrate", "scipy.interpolate", "scipy.stats", "scipy.cluster"),
)  # fmt: skip
# Runs the program as `python3 -m tribox` does, and tells what has been loaded by then.
SCRIPT = f"""
import json, runpy, sys
sys.argv = ["tribox", *sys.argv[1:]]
try:
    runpy.run_module("tribox", run_name="__main__", alter_sys=True)
except SystemExit as end:
    assert not end.code, end.code
found = [name for name in {NOT_NEEDED!r} if name in sys.modules]
for_figures = ("matplotlib.figure", "meshio", "rich")
print(json.dumps([found, [name in sys.modules for name in for_figures]]), file=sys.stderr)
"""


@pytest.mark.parametrize("figures", [True, False])
def test_a_run_loads_what_it_needs(case_file, block, tmp_path, figures):
    out, asked = tmp_path / "out", f"output.figures={str(figures).lower()}"
    words = ["run", str(case_file(block)), "--out", str(out), "--set", asked]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *words], capture_output=True, text=True, cwd=ROOT
    )
    found, drew = json.loads(done.stderr.splitlines()[-1])
    assert found == []
    assert drew[0] == figures == (out / "figures" / "deformed.png").is_file()
    assert figures or not any(drew)
    kernels = json.loads((out / "summary.json").read_text())["kernels"]
    assert {"closest_points", "plane_contact"} & kernels.keys()
    assert all(re.fullmatch("[0-9a-f]{24}", key) for key in kernels.values())


def test_little_is_loaded_before_signals_are_obeyed():
    script = (
        "import sys; import tribox.__main__, tribox.app.run.process; "
        "print(*{'ctypes', 'pathlib', 'typing'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-S", "-c", script], cwd=ROOT / "src", capture_output=True, text=True
    )
    assert (done.stdout, done.stderr) == ("\n", "")
