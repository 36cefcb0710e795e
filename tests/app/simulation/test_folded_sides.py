"""What is said of sides that fold over the end of a slave into its master."""

import re
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.checkpoint.small_cases import changed
from tests.app.conftest import BOXES
from tests.app.read_log import read_log
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.run.run import run_case
from tribox.app.simulation.surface_ends import FoldedSides

# A billet that sticks to the die and rolls over onto it with its side.
BILLET = """
contact = [{ slave = "billet_top", master = "die", friction = { law = "coulomb", mu = 0.6 } }]
boundary = [
 { surface = "billet_bottom", symmetry = true },
 { surface = "billet_left", symmetry = true },
]
stage = [{ name = "upset", duration = "1 s", steps = 8 }]
output = { fields_every = 0, figures = false }
[bodies.billet]
material = "elastoplastic"
E = "70 GPa"
nu = 0.33
hardening = { law = "linear", yield_stress = "100 MPa", modulus = "0 MPa" }
[geometry]
kind = "blocks"
blocks.billet = { x = ["0 mm", "10 mm"], y = ["0 mm", "5 mm"], elements = [8, 8] }
[tools.die]
shape = "plane"
point = ["0 mm", "5 mm"]
normal = [0, -1]
displacement = { y = [["0 s", "0 mm"], ["1 s", "-1 mm"]] }
"""
SIDE = {"slave": "billet_right", "master": "die", "friction": {"law": "frictionless"}}
TOLD = r"(\w+) goes through die beyond the end of billet_top, (\S+) m deep at \(0.01, (\S+)\) m"


# In a stage before, and not any more.
BEFORE = SIDE | {"stages": ["before"]}


@pytest.mark.parametrize("more", [{}, SIDE, BEFORE], ids=["unfelt", "felt", "felt before"])
def test_a_side_that_folds_onto_a_die_is_told_unless_a_contact_keeps_it_out(tmp_path, more):
    data = tomllib.loads(BILLET)
    data["contact"] += [more] if more else []
    if more is BEFORE:
        data["stage"].insert(0, {"name": "before", "duration": "0.01 s", "steps": 1})
    case = Case.model_validate(data)
    run = run_case(case, tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    found = re.findall(TOLD, read_log(tmp_path / "out"))
    assert len(found) == (more is not SIDE)
    assert "never pressed" not in read_log(tmp_path / "out")  # what is drawn as a precaution
    problem = run.model.problem
    moved = problem.space.tabulate_dof_coordinates()[:, :2]
    moved = moved + problem.u.x.array.reshape(-1, 2)[: len(moved)]
    for side, depth, place in found:
        assert side == "billet_right"
        assert float(depth) == pytest.approx(moved[:, 1].max() - 0.004, rel=0.01)
        assert float(place) < 0.005


OPEN = {"shape": "polyline", "points": [["20 mm", "5 mm"], ["-20 mm", "5 mm"]]}


def look(watch, problem):
    """At a converged step whose contacts have sunk nowhere."""
    open_ = SimpleNamespace(closed=np.zeros(1, dtype=bool), gap=np.ones(1))
    trial = SimpleNamespace(normal_contact=SimpleNamespace(gap=None), kinematics=open_)
    problem.committed = [trial for _ in problem.contacts]
    watch.step(SimpleNamespace(when="time 1 s, stage upset"))


@pytest.mark.parametrize(
    ("way", "deep"),
    [
        ([(0.0, 0.0), (0.0, 1.0)], 1.0),  # through the line
        ([(0.0, 0.0), (40.0, 0.0), (40.0, 6.0), (5.0, 6.0)], 0.0),  # round its end
        ([(0.0, 0.0), (0.0, 0.03)], 0.0),  # not by more than contacts yield
    ],
)
def test_what_goes_round_the_end_of_a_tool_has_not_gone_through_it(way, deep):
    """A billet without contact below an open line: its top, but for the slave, is what is seen."""
    data = tomllib.loads(BILLET)
    data["contact"][0]["slave"] = "billet_right"
    data["tools"]["die"] = OPEN
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    watch, problem = FoldedSides(model), model.problem
    billet = np.unique(problem.space.dofmap.list[problem.solids[0].cells])  # not the tool's block
    for x, y in way:
        problem.u.x.array.reshape(-1, 2)[billet] = np.array([x, y]) * 1e-3
        look(watch, problem)
    said = list(watch.warnings())
    assert len(said) == (deep > 0.0)
    for line in said:
        assert (
            f"billet_top goes through die beyond the end of billet_right, {deep / 1e3:.3g}" in line
        )
    # Where the slave is told to be too short, what goes on behind it under a name is told too.
    assert list(watch.warnings({0})) == said


def pushed_in(comm, directory):
    """What is said of a box in space whose bottom, of no contact, goes through the other's top."""
    model = build_model(
        Case.model_validate(changed(BOXES, {"contact.0.slave": "elastomer_front"})), comm
    )
    watch, problem = FoldedSides(model), model.problem
    body = np.unique(problem.space.dofmap.list[problem.solids[0].cells])
    for way in ((0.0, 0.0, 0.0), (0.1, -0.05, 0.0), (0.3, -0.05, 0.0)):  # further than is at hand
        problem.u.x.array.reshape(-1, 3)[body] = 1e-3 * np.array(way)
        look(watch, problem)
    return list(watch.warnings())


@pytest.mark.mpi(pushed_in, 2)
def test_what_goes_through_a_mesh_in_space_is_seen_on_any_ranks(on_ranks):
    said = pushed_in(MPI.COMM_SELF, None)
    assert len(said) == 1
    assert (
        "elastomer_contact goes through aluminium_contact beyond the end of elastomer_front, 5e-05"
        in said[0]
    )
    assert on_ranks(pushed_in, 2) == said


def test_what_was_seen_is_kept():
    data = tomllib.loads(BILLET)
    models = [build_model(Case.model_validate(data), MPI.COMM_SELF) for _ in range(2)]
    watch, later = (FoldedSides(model) for model in models)
    problem = models[0].problem
    billet = np.unique(problem.space.dofmap.list[problem.solids[0].cells])
    problem.u.x.array.reshape(-1, 2)[billet, 1] = 1e-3
    look(watch, problem)
    later.restore(watch.snapshot())
    said = list(watch.warnings())
    assert len(said) == 1 and list(later.warnings()) == said
    # It has been seen before, at no time since: a node that is inside now may have gone round.
    problem = models[1].problem
    problem.u.x.array.reshape(-1, 2)[billet, 1] = 2e-3
    look(later, problem)
    assert list(later.warnings()) == said
