"""A strip that was bent and is let go: springback through the release of a surface."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tests.solved import solved as run_data
from tests.tool_cases import block_case, block_mesh, circle
from tribox.app.build.model import body_dofs
from tribox.app.case.case import Case
from tribox.app.results.recorder import force_balance
from tribox.app.run.run import run_case

BENT = """
stage = [
 { name = "bend", duration = "1 s", steps = 8 },
 { name = "let go", duration = "1 s", steps = 4, release = ["strip_right"] },
]
[geometry]
kind = "blocks"
blocks = { strip = { x = ["0 mm", "8 mm"], y = ["0 mm", "1 mm"], elements = [8, 4] } }
[bodies.strip]
material = "elastoplastic"
formulation = "q2"
E = "70 GPa"
nu = 0.33
hardening = { law = "linear", yield_stress = "100 MPa", modulus = "500 MPa" }
[[boundary]]
surface = "strip_left"
platen = { direction = "x", force = 0 }
[[boundary]]
surface = "strip_right"
rotation = { axis = "z", centre = ["8 mm", "0.5 mm"], angle = [["0 s", 0], ["1 s", 0.16]] }
"""


def test_a_strip_let_go_springs_back_elastically_in_few_iterations(tmp_path):
    """In one step and in four to the same shape."""
    left = []
    for steps in (1, 4):
        data, out = tomllib.loads(BENT), tmp_path / f"{steps}"
        data["stage"][1]["steps"] = steps
        run = run_case(Case.model_validate(data), out, quiet=True, comm=MPI.COMM_SELF)
        bent, free = run.rows[7], run.rows[8:]
        assert [row.attempts for row in free] == [1] * steps
        assert all(row.newton_iterations <= 8 for row in free)
        # What springs back gives back most of what was stored, and does not flow.
        assert 0.0 < free[-1].strain_energy < 0.5 * bent.strain_energy
        assert free[-1].plastic_dissipation == pytest.approx(bent.plastic_dissipation, rel=1e-3)
        log = read_log(out)
        assert f"body strip floats in {steps} step" in log
        # It was bent by a moment alone: no force but that of a pair says what rest is small.
        assert force_balance(run) < 1e-6 and "add up to zero only" not in log
        left.append(free[-1].strain_energy)
    assert left[0] == pytest.approx(left[1], rel=1e-3)


# -- tools and pairs ------------------------------------------------------------------------------

DRY = {"law": "coulomb", "mu": 0.3}
GOING = {"displacement": {"y": [["0 s", "0 m"], ["1 s", "-50 um"], ["2 s", "-60 um"]]}}
FORCED = {"force": {"y": [["0 s", "0 N"], ["1 s", "-0.5 N"]]}}


def pressed(mesh, motion, steps, release):
    """A block that a round tool presses and lets go of."""
    stages = [
        {"name": "press", "duration": "1 s", "steps": 2},
        {"name": "let go", "duration": "1 s", "steps": steps, "release": [release]},
        {"name": "after", "duration": "1 s", "steps": 1},
    ]
    contact = [{"name": "pair", "slave": "top", "master": "punch", "friction": DRY}]
    return run_data(
        block_case(mesh, tools={"punch": circle(**motion)}, contact=contact, stage=stages)
    )


@pytest.mark.parametrize(
    ("motion", "release"), [(GOING, "punch"), (FORCED, "punch"), (GOING, "pair")]
)
def test_a_tool_that_lets_go_takes_its_forces_off_evenly(tmp_path, motion, release):
    mesh = block_mesh(tmp_path / "block.msh")
    found = {steps: pressed(mesh, motion, steps, release) for steps in (2, 4)}
    simulation = found[4]
    columns = simulation.state.tools.columns
    punch = np.array([row[4:] for row in simulation.state.tools.rows], dtype=float)
    force, place = (punch[:, columns.index(n) - 4] for n in ("force_y", "displacement_y"))
    on_top = simulation.state.motion.of_surface("top", "force_y")
    assert force[1] > 0.4
    assert on_top[2:6] == pytest.approx(-force[1] * np.array([0.75, 0.5, 0.25, 0.0]), abs=1e-9)
    assert force[2:] == pytest.approx(0.0, abs=1e-12) and on_top[:2] == pytest.approx(0.0)
    # What a force moved stays where it was; a displacement goes on.
    ends = -60e-6 if motion is GOING else place[1]
    assert place[-1] == pytest.approx(ends, rel=1e-9)
    for steps, one in found.items():
        rows = one.rows
        assert [row.attempts for row in rows] == [1] * (3 + steps)
        assert rows[-1].strain_energy < 1e-15 * rows[1].strain_energy
        assert abs(one.state.motion.of_body("block", "displacement_y")[-1]) < 1e-12
        assert one.state.motion.force_balance(["press", "let go"]) < 1e-7
        # The work of friction that is taken off is that of loads: nothing of it is numerical.
        lost = [row.numerical_dissipation for row in rows[1:]]
        assert lost == [lost[0]] * len(lost) != [0.0] * len(lost)
    # Work: all of the strain energy is given back, but for the error of the trapezoidal rule.
    wrong = [abs(one.rows[-1].energy_error - one.rows[1].energy_error) for one in found.values()]
    assert wrong[1] < 0.4 * wrong[0] < 0.04 * simulation.rows[1].strain_energy


def test_what_still_holds_a_node_bears_its_force_when_another_surface_lets_go():
    """A confined block; bottom and top hold all that the side has held, and go on to."""
    block = {"x": [0, 2], "y": [0, 1], "elements": [2, 1]}
    data = {
        "geometry": {"kind": "blocks", "blocks": {"block": block}},
        "bodies": {"block": {"material": "neo-hookean", "E": 10, "nu": 0.3}},
        "contact": [],
        "boundary": [
            {"surface": "block_right", "displacement": {"x": 0}},
            {"surface": "block_bottom", "displacement": {"x": 0, "y": 0}},
            {"surface": "block_top", "displacement": {"x": 0, "y": [[0, 0], [1, -0.1]]}},
        ],
        "stage": [
            {"name": "press", "duration": 1, "steps": 1},
            {"name": "let go", "duration": 1, "steps": 2, "release": ["block_right"]},
        ],
    }
    simulation = run_data(data)
    side = simulation.state.motion.of_surface("block_right", "force_x")
    floor = simulation.state.motion.of_surface("block_bottom", "force_y")
    assert abs(side[0]) > 0.1 * abs(floor[0]) > 0.0
    assert side[1:] == pytest.approx(0.0, abs=1e-12)


def test_two_bodies_that_let_go_of_each_other_spring_back_both():
    """A pair of facets: its forces are at the nodes of both surfaces."""
    blocks = {
        "low": {"x": [0, 4], "y": [0, 1], "elements": [4, 2]},
        "high": {"x": [1, 3], "y": [1, 2], "elements": [3, 2]},
    }
    platen = {"platen": {"direction": "y", "force": [[0, 0], [1, 1]]}, "displacement": {"x": 0}}
    data = {
        "geometry": {"kind": "blocks", "blocks": blocks},
        "bodies": {n: {"material": "neo-hookean", "E": 10, "nu": 0.3} for n in blocks},
        "contact": [{"slave": "high_bottom", "master": "low_top", "friction": DRY}],
        "boundary": [
            {"surface": "low_bottom", "displacement": {"x": 0, "y": 0}},
            {"surface": "high_top", "stages": ["press"], **platen},
            {"surface": "high_top", "stages": ["let go"], "displacement": {"x": 0, "y": 0}},
        ],
        "stage": [
            {"name": "press", "duration": 1, "steps": 1},
            {"name": "let go", "duration": 1, "steps": 2, "release": ["high_bottom-low_top"]},
        ],
    }
    simulation = run_data(data)
    forces = [simulation.state.motion.of_surface(s, "force_y") for s in ("high_bottom", "low_top")]
    assert forces[0] == pytest.approx([0.0, 0.5, 0.0], abs=1e-7)
    assert forces[1] == pytest.approx([0.0, -0.5, 0.0], abs=1e-7)
    assert simulation.rows[-1].strain_energy < 1e-15 * simulation.rows[0].strain_energy


def test_a_strip_springs_back_from_tools_as_from_tools_that_leave_it(tmp_path):
    """Unloading is elastic: the way there does not matter; the release needs no way at all."""
    shapes = []
    for release in ([], ["punch"]):
        data = tomllib.loads(BENT)
        data["bodies"]["strip"]["formulation"] = "q1-sri"
        up = [["1 s", "-1.2 mm"], ["2 s", "-1.2 mm" if release else "0 mm"]]
        punch = {"shape": "circle", "centre": ["7 mm", "3 mm"], "radius": "2 mm"}
        punch["displacement"] = {"y": [["0 s", "0 mm"], *up]}
        contact = {"slave": "strip_top", "master": "punch", "friction": {"law": "frictionless"}}
        clamped = {"surface": "strip_left", "displacement": {"x": 0, "y": 0}}
        data |= {"tools": {"punch": punch}, "contact": [contact], "boundary": [clamped]}
        data["stage"][1]["release"] = release
        data["stage"][0]["steps"] = 6
        # What is left of the forces bends a strip of this length more than they are compared to.
        data["solver"] = data.get("solver", {}) | {"tolerance": 1e-9}
        simulation = run_data(data)
        shapes.append(simulation.stepper.x.array_r[body_dofs(simulation.model, "strip").ravel()])
        assert simulation.rows[5].plastic_dissipation > 0.0
        last = simulation.rows[-1].plastic_dissipation
        assert last == pytest.approx(simulation.rows[5].plastic_dissipation, rel=1e-6)
        assert [row.attempts for row in simulation.rows] == [1] * 10
    left = np.abs(shapes[0]).max()
    assert left > 2e-4
    assert shapes[1] == pytest.approx(shapes[0], abs=1e-7 * left)


def test_a_strip_that_all_its_tools_let_go_of_floats_along_its_plane_of_symmetry():
    """The plane bears what the tools' forces have along its normal; nothing holds it else."""
    strip = {"x": [0, 12], "y": [0, 1], "elements": [12, 2]}
    punch = {"shape": "circle", "centre": [0, 4], "radius": 3}
    punch["displacement"] = {"y": [[0, 0], [1, -1]]}
    data = {
        "geometry": {"kind": "blocks", "blocks": {"strip": strip}},
        "bodies": {"strip": {"material": "neo-hookean", "E": 10, "nu": 0.3}},
        "tools": {"punch": punch, "die": {"shape": "circle", "centre": [8, -2], "radius": 2}},
        "contact": [
            {"slave": "strip_top", "master": "punch", "friction": {"law": "frictionless"}},
            {"slave": "strip_bottom", "master": "die", "friction": {"law": "frictionless"}},
        ],
        "boundary": [{"surface": "strip_left", "symmetry": True}],
        "stage": [
            {"name": "bend", "duration": 1, "steps": 2},
            {"name": "let go", "duration": 1, "steps": 2, "release": ["punch", "die"]},
        ],
    }
    simulation = run_data(data)
    sides = [f"strip_{side}" for side in ("left", "top", "bottom")]
    plane, *tools = (simulation.state.motion.of_surface(side, "force_x")[2] for side in sides)
    # What the tools have pushed sideways the plane bears.
    assert abs(plane) > 0.01 * abs(simulation.state.motion.of_surface(sides[1], "force_y")[2])
    assert plane == pytest.approx(-sum(tools), rel=1e-6)
    rows = simulation.rows
    assert rows[-1].strain_energy < 1e-9 * rows[1].strain_energy
    assert [row.attempts for row in rows[2:]] == [1, 1]
