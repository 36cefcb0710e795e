"""Bodies that nothing holds any more: weak springs keep them, and the run says so."""

import tomllib
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tests.solved import Cuts, built, solved
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.case.toml_files import toml_text
from tribox.app.errors import InputError, SolutionError
from tribox.app.run.run import run_case

UNLOAD = """
bodies.elastomer = { material = "neo-hookean", E = "5 MPa", nu = 0.45 }
bodies.aluminium = { material = "hencky", E = "70 MPa", nu = 0.33 }
stage = [
 { name = "press", duration = "1 s", steps = 2 },
 { name = "unload", duration = "2 s", steps = 4 },
]
[geometry]
kind = "two-blocks"
upper = { width = "2 mm", height = "1 mm", elements = [4, 2] }
lower = { width = "4 mm", height = "1 mm", elements = [6, 2] }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "coulomb", mu = 0.3 }
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "top"
platen = { direction = "y", pressure = [["0 s", "0 MPa"], ["1 s", "1 MPa"], ["2 s", "0 MPa"]] }
"""


def run(tmp_path, **changed):
    """The rows, the log and the final displacement of the upper body's nodes (n, i), m."""
    data = tomllib.loads(UNLOAD)
    for boundary in changed.get("boundaries", ()):
        data["boundary"].append(boundary)
    case = Case.model_validate(data)
    simulation = run_case(case, tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    model = simulation.model
    nodes = np.unique(model.problem.space.dofmap.list[model.named.cells("elastomer")])
    u = model.problem.u.x.array.reshape(-1, model.problem.dim)[nodes]
    return simulation.rows, read_log(tmp_path / "out"), u


@pytest.fixture(scope="module")
def unloaded(tmp_path_factory):
    """The run in which the load goes back to zero."""
    return run(tmp_path_factory.mktemp("unloaded"))


def test_an_unloaded_body_is_stress_free_and_stays_where_it_was(unloaded):
    rows, _, u = unloaded
    pressed = max(row.strain_energy for row in rows)
    assert rows[-1].strain_energy < 1e-9 * pressed
    # Turned and moved as a whole, by less than it was pressed.
    assert np.abs(u - u.mean(axis=0)).max() < 1e-4 * 2e-4
    assert np.abs(u).max() < 2e-4


def test_the_force_of_the_springs_fades(unloaded):
    rows, log, _ = unloaded
    assert "body elastomer floats in 3 steps (first at time 2 s, stage unload)" in log
    assert all(row.normal_force <= 1e-6 * rows[1].normal_force for row in rows[3:])
    assert rows[-1].normal_force < rows[3].normal_force


def test_a_load_that_nothing_balances_is_not_held_by_weak_springs(tmp_path):
    away = {"surface": "elastomer_left", "pressure": [["2 s", "0 Pa"], ["2.5 s", "0.01 MPa"]]}
    with pytest.raises(SolutionError, match="elastomer"):
        run(tmp_path, boundaries=[away])


# -- Contacts that act in some stages only, and friction that changes with time --------------------


def table(block, **contact):
    data = tomllib.loads(block)
    data["geometry"]["upper"]["elements"], data["geometry"]["lower"]["elements"] = [6, 3], [9, 2]
    friction = contact.pop("friction", {})
    data["contact"][0] |= contact
    data["contact"][0]["friction"] |= {"K_T": "2e11 Pa/m"} | friction
    return data


def test_a_constant_factor_is_a_factor_of_coefficient_and_stiffness(block):
    rows = solved(table(block, friction_factor=0.5)).rows
    other = solved(table(block, friction={"mu": 0.1, "K_T": "1e11 Pa/m"})).rows
    for name in ("normal_force", "tangential_force", "dissipation", "interface_energy", "mu"):
        ours, theirs = (np.array([getattr(r, name) for r in one]) for one in (rows, other))
        assert np.abs(ours - theirs).max() < 1e-9 * np.abs(theirs).max(), name


@pytest.mark.parametrize("what", ["friction_factor", "mu"])
def test_sliding_friction_follows_its_program(block, what):
    """T/N is what the program says at each time at which all slides, and the energies balance."""
    program = [["1.4 s", 1.0], ["1.8 s", 0.2]]
    keys = {"friction_factor": program, "friction": {"mu": 0.1}}
    if what == "mu":
        keys = {"friction": {"mu": [[t, 0.1 * f] for t, f in program]}}
    simulation = solved(table(block, **keys))
    for row in simulation.rows[5:]:
        expected = 0.1 * np.interp(row.time, [1.4, 1.8], [1.0, 0.2])
        assert row.mu == pytest.approx(expected, rel=1e-12)
        assert row.stick_fraction < 1e-12
        assert row.friction_coefficient == pytest.approx(expected, rel=1e-9)
    assert all(one.least_dissipation > -1e-9 for one in simulation.state.resultants)
    last = simulation.rows[-1]
    assert abs(last.energy_error) < 0.02 * last.external_work


def test_a_contact_of_later_stages_is_not_there_before(block):
    """The bodies pass through each other; where they then overlap one line says how deep."""
    data = table(block, stages=["slide"])
    with pytest.raises(SolutionError, match=r"stage slide: contact\.0 .* 5e-05 m inside"):
        solved(data)
    data["boundary"][1]["displacement"]["y"] = [["1 s", "0 mm"], ["2 s", "-0.03 mm"]]
    rows = solved(data).rows
    assert all(row.normal_force == 0.0 for row in rows[:3])
    assert rows[-1].normal_force > 0.0


def test_a_contact_that_is_switched_off_lets_go(block):
    data = table(block, stages=["press", "slide"])
    data["stage"].append({"name": "free", "duration": "1 s", "steps": 1})
    simulation = solved(data)
    before, after = simulation.rows[-2:]
    assert before.normal_force > 0.0 and after.normal_force == after.interface_energy == 0.0
    assert after.strain_energy < 1e-9 * before.strain_energy
    assert after.dissipation - before.dissipation == pytest.approx(before.interface_energy)
    assert simulation.model.problem.contacts[0].state.friction.elastic_slip.max() == 0.0


def test_explicit_steps_switch_contacts_too(block):
    data = table(block, stages=["press"])
    del data["contact"][0]["friction"]["K_T"]
    data["solver"] = {"kind": "explicit"}
    for name, density in (("elastomer", "1e4 kg/m^3"), ("aluminium", "2.7e4 kg/m^3")):
        data["bodies"][name] |= {"density": density, "E": "5 MPa", "nu": 0.3}
    data["boundary"][1]["displacement"] = {"x": 0, "y": [["0 s", "0 mm"], ["1 ms", "-0.02 mm"]]}
    data["stage"] = [
        {"name": "press", "duration": "1 ms", "steps": 2},
        {"name": "free", "duration": "0.2 ms", "steps": 1},
    ]
    rows = solved(data).rows
    assert rows[1].normal_force > 0.0 and rows[2].normal_force == 0.0
    assert rows[2].contact_area == 0.0 and rows[2].max_penetration == 0.0


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"stages": ["press", "pull"]}, "no such stage; there are press, slide"),
        ({"stages": ["press", "press"]}, "is in the list twice"),
        ({"stages": []}, "must have at least 1 entry"),
        ({"friction_factor": -1}, "must be >= 0 at all times"),
        ({"friction_factor": [["0 s", 1], ["1 s", -1]]}, "must be >= 0 at all times"),
        ({"friction": {"mu": [["0 s", -0.1]]}}, "must be >= 0 at all times"),
        ({"friction": {"mu": "1 m"}}, '"m" has the wrong dimension'),
        ({"friction": {"law": "frictionless"}, "friction_factor": 2}, "has no effect with law"),
    ],
)
def test_wrong_keys_are_refused(block, keys, line, tmp_path):
    path, data = tmp_path / "case.toml", table(block, **keys)
    if data["contact"][0]["friction"]["law"] == "frictionless":
        data["contact"][0]["friction"] = {"law": "frictionless"}
    path.write_text(toml_text(data))
    with pytest.raises(InputError) as error:
        load_case(path)
    assert line in str(error.value) and "contact.0." in str(error.value)


# -- Bodies that a tool carries along before anything presses on them ------------------------------


def closed_by(clearance: float) -> dict[str, Any]:
    """A block between two plates, of which one comes down by 50 um more than the clearances."""
    stroke = [["0 s", 0.0], ["1 s", -2.0 * clearance - 5e-5]]
    plates = {
        "ram": {"point": [0.0, 1e-3 + clearance], "normal": [0, -1], "displacement": {"y": stroke}},
        "base": {"point": [0.0, -clearance], "normal": [0, 1]},
    }
    rubs = {"law": "coulomb", "mu": 0.2}
    return {
        "geometry": {
            "kind": "blocks",
            "blocks": {"pad": {"x": [0.0, 2e-3], "y": [0.0, 1e-3], "elements": [6, 3]}},
        },
        "bodies": {"pad": {"material": "neo-hookean", "E": "5 MPa", "nu": 0.45}},
        "tools": {name: {"shape": "plane"} | keys for name, keys in plates.items()},
        "contact": [
            {"slave": "pad_top", "master": "ram", "friction": rubs},
            {"slave": "pad_bottom", "master": "base", "friction": rubs},
        ],
        "stage": [{"name": "press", "duration": "1 s", "steps": 35}],
        "solver": {"tolerance": 6e-8},  # twice what springs leave of the forces
    }


class Floats(Cuts):
    """Keeps what floated in each step, too."""

    def step(self, state, row, result) -> None:
        self.floating = [*getattr(self, "floating", []), list(result.floating)]


def test_rounding_does_not_keep_a_tool_from_carrying_a_thin_sheet():
    """Of 1/200 of its length, it bends under less than weak springs bear."""
    forces, seen = [], Floats()
    for below, above in ((2e-5, 3e-5), (0.0, 0.0)):
        data = closed_by(below)
        sheet = {"x": [0.0, 1e-2], "y": [0.0, 5e-5], "elements": [40, 2]}
        data["geometry"]["blocks"]["pad"], data["bodies"]["pad"] = sheet, {"material": "PU-80A"}
        data["tools"]["ram"]["point"][1] = 5e-5 + above
        data["tools"]["ram"]["displacement"]["y"][1][1] = -below - above - 5e-6
        data["stage"][0]["steps"] = 5
        forces.append(solved(data, observer=Floats() if forces else seen).rows[-1].normal_force)
    assert forces[0] == pytest.approx(forces[1], rel=1e-3)
    assert seen.count == 0 and seen.floating == 4 * [["pad"]] + [[]]


def carried(comm, directory):
    """Forces of the last step without and with clearances, iterations, cuts, and what floated."""
    out = []
    for clearance in (0.0, 1e-5):
        seen = Floats()
        simulation = solved(closed_by(clearance), comm, seen)
        forces = [one.normal_force for one in simulation.state.resultants]
        out.append((forces, seen.iterations, seen.count, seen.floating))
    return out


@pytest.mark.mpi(carried, 2)
def test_a_tool_carries_a_free_body_through_its_clearances(on_ranks):
    """What springs it pushes then leaves no trace in the forces of the press."""
    (flush, _, _, at_once), (forces, iterations, cuts, floats) = on_ranks(carried, 1)
    assert forces == pytest.approx(flush, rel=1e-6) and min(forces) > 1.0
    assert cuts == 0 and iterations <= 100
    assert not any(at_once) and floats == 10 * [["pad"]] + 25 * [[]]
    for mine, other in zip(on_ranks(carried, 2), on_ranks(carried, 1), strict=True):
        assert mine[0] == pytest.approx(other[0], rel=1e-8) and mine[2:] == other[2:]


def test_a_round_tool_turns_the_body_that_it_carries_off_its_middle():
    """Weak springs answer it by less than a millionth of the stress that a linear turn leaves."""
    forces, seen = [], Floats()
    for clearance in (2e-5, 0.0):
        data = closed_by(clearance)
        round_tool = {"shape": "circle", "centre": [1.4e-3, 3e-3 + clearance], "radius": 2e-3}
        data["tools"]["ram"] = round_tool | {"displacement": data["tools"]["ram"]["displacement"]}
        simulation = solved(data, observer=Floats() if forces else seen)
        forces.append([row.normal_force for row in simulation.rows])
    floated = len([one for one in seen.floating if one])
    assert seen.count == 0 and 0 < floated < len(forces[0]) - 1 and seen.iterations <= 400
    assert max(forces[0][:floated]) < 1e-6 * forces[0][-1]  # then both tools turn it flat
    assert forces[0][-1] == pytest.approx(forces[1][-1], rel=1e-2)  # it presses elsewhere by then


def test_a_strip_that_tips_over_an_edge_turns_as_a_rigid_body():
    """A punch pushes it down beside a shoulder, and nothing holds its other end."""
    shapes = {
        "base": [[-60, 0], [0, 0], [4, -1.5], [60, -1.5]],
        "ram": [[60, 1], [4.3, 1], [0.3, 2.5], [-60, 2.5]],
    }
    data, seen = closed_by(0.0), Floats()
    data["geometry"]["blocks"]["pad"] = {
        **{"x": [-0.02, 0.024], "y": [0.0, 1e-3], "elements": [44, 2]}
    }
    data["bodies"]["pad"] = {"material": "AA5754-O"}
    for name, points in shapes.items():
        places = [[1e-3 * x, 1e-3 * y] for x, y in points]
        data["tools"][name] = {"shape": "polyline", "points": places, "fillet_radius": 1.5e-3}
    data["tools"]["ram"]["displacement"] = {"y": [["0 s", 0.0], ["1 s", -1.8e-4]]}
    for pair in data["contact"]:
        pair["friction"] = {"law": "frictionless"}
    data["stage"][0]["steps"] = 5
    simulation = built(data, MPI.COMM_SELF)
    with pytest.raises(SolutionError, match="no contact presses on it"):
        simulation.run(seen)
    assert seen.count == 0 and seen.floating == 5 * [["pad"]] and seen.iterations <= 100
    problem = simulation.model.problem
    nodes = np.unique(problem.space.dofmap.list[problem.solids[0].cells])
    start = problem.space.tabulate_dof_coordinates()[nodes, :2]
    place = start + problem.u.x.array.reshape(-1, 2)[nodes]
    start, place = start - start.mean(axis=0), place - place.mean(axis=0)
    left, _, right = np.linalg.svd(start.T @ place)
    # 0.18 mm over the way from the fillet's begin to the punch's, to facets of 1 mm around.
    assert 0.18 / 6.84 < abs((left @ right)[0, 1]) < 0.18 / 4.84
    # The springs' 5 N/m bend its arm of 20 mm by that; a linear turn would stretch it by 9 um.
    assert np.abs(place - start @ left @ right).max() < 5e-7


def test_a_force_that_only_weak_springs_press_is_not_held():
    data = closed_by(1e-4)
    data["tools"]["ram"] |= {"displacement_stages": ["press"], "hold_force": ["y"]}
    data["stage"] = [
        {"name": "press", "duration": "0.3 s", "steps": 2},
        {"name": "hold", "duration": "1 s", "steps": 1},
    ]
    with pytest.raises(SolutionError, match=r"tool ram has no force to hold.*stage press"):
        solved(data)


def test_a_platen_holds_the_force_on_its_own_body_while_a_tool_carries_another():
    data = closed_by(1e-4)
    data["geometry"]["blocks"]["pier"] = {"x": [4e-3, 6e-3], "y": [0, 1e-3], "elements": [2, 2]}
    data["bodies"]["pier"] = data["bodies"]["pad"]
    pressed = {"displacement": [["0 s", 0.0], ["0.5 s", 1e-5]], "displacement_stages": ["press"]}
    data["boundary"] = [
        {"surface": "pier_bottom", "displacement": {"x": 0, "y": 0}},
        {"surface": "pier_top", "platen": {"direction": "y", "hold_force": True} | pressed},
    ]
    data["stage"] = [
        {"name": "press", "duration": "0.5 s", "steps": 4},
        {"name": "hold", "duration": "0.5 s", "steps": 5},
    ]
    data["solver"]["tolerance"] = 1e-7  # in steps of 25 um springs leave twice that of the forces
    seen = Floats()
    problem = solved(data, observer=seen).model.problem
    assert seen.floating[:6] == 6 * [["pad"]] and seen.floating[-1] == []
    assert problem.u.x.array[problem.platens[0].dofs] == pytest.approx(-1e-5, rel=1e-6)
    data["boundary"][1] |= {"platen": {"direction": "y", "force": "1 N"}}
    data["stage"] = data["stage"][:1]  # what only carries one body is no fault of the other
    assert solved(data).rows[-1].time == 0.5


def test_boxes_without_friction_lie_on_each_other_under_their_weight():
    """Nothing holds them aside, and rounding sent them off without end."""
    data = {
        "geometry": {"kind": "blocks", "blocks": {}},
        "bodies": {},
        "contact": [],
        "tools": {"floor": {"shape": "plane", "point": [0, 0, 0], "normal": "y"}},
        "gravity": {"y": [["0 s", 0.0], ["1 s", -9.81]]},
        "stage": [{"name": "rest", "duration": "1 s", "steps": 2}],
    }
    for number, below in enumerate(("floor", "box0_top")):
        name, wide, low = f"box{number}", 5e-3 - number * 1e-3, number * 4e-3
        sides = {"x": [-wide, wide], "y": [low, low + 4e-3], "z": [-wide, wide]}
        elements = {"elements": [4 + number, 2, 5 + number]}
        data["geometry"]["blocks"][name] = sides | elements
        rubber = {"material": "neo-hookean", "E": "5 MPa", "nu": 0.4, "density": 1100}
        data["bodies"][name] = rubber
        pair = {"slave": f"{name}_bottom", "master": below, "friction": {"law": "frictionless"}}
        data["contact"].append(pair)
    seen = Floats()
    forces = [one.normal_force for one in solved(data, observer=seen).state.resultants]
    weights = 1100 * 9.81 * 4e-3 * np.array([1e-2**2 + 8e-3**2, 8e-3**2])
    assert forces == pytest.approx(weights, rel=1e-6)
    assert seen.count == 0 and seen.iterations <= 40 and seen.floating == [[], []]


def test_a_ring_that_nothing_touches_bears_its_pressure():
    """Radial loads move no body of revolution: weak springs hold it, and Lame's ring widens."""
    data = closed_by(1e-4)
    ring = {"x": [5e-3, 1e-2], "y": [0.0, 1e-3], "elements": [20, 2]}
    data["geometry"] |= {"section": "axisymmetric", "blocks": {"pad": ring}}
    data["bodies"]["pad"] = {"material": "neo-hookean", "E": "1 GPa", "nu": 0.3}
    del data["tools"]["ram"]["displacement"]
    data["boundary"] = [{"surface": "pad_left", "pressure": [["0 s", 0.0], ["1 s", "1 MPa"]]}]
    data["stage"][0]["steps"], seen = 2, Floats()
    simulation = solved(data, observer=seen)
    assert seen.floating == 2 * [["pad"]] and seen.count == 0
    widened = simulation.state.motion.of_surface("pad_left", "displacement_x")[-1]
    assert widened == pytest.approx(5e-3 * 1e-3 * (125.0 / 75.0 + 0.3), rel=5e-3)


STRETCHED = """
geometry.kind = "blocks"
geometry.blocks.sheet = { x = [0, 0.06], y = [0, 1e-3], elements = [40, 2] }
bodies.sheet = { material = "AA6016-T4" }
tools.form.shape = "polyline"
tools.form.points = [[-0.02, 0], [0.04, 0], [0.04, -0.06]]
tools.form.fillet_radius = [0.015]
tools.form.continued = [true, true]
[[contact]]
slave = "sheet_bottom"
master = "form"
friction = { law = "coulomb", mu = 0.1 }
[[boundary]]
surface = "sheet_left"
symmetry = true
[[boundary]]
surface = "sheet_right"
displacement.x = [[0, 0], [0.2, 3e-4], [1, -3e-3]]
displacement.y = [[0.2, 0], [1, -0.022]]
[[stage]]
name = "stretch"
duration = 1
steps = 24
[[stage]]
name = "release"
duration = 1
steps = 2
release = ["sheet_right"]
"""


def test_a_stretched_sheet_that_is_let_go_is_held_where_it_was_found():
    """Springs that keep it on its form begin at the state without them; anew they took 32 more."""
    seen = Floats()
    rows = solved(tomllib.loads(STRETCHED), observer=seen).rows
    assert seen.floating[-1] == ["sheet"] and rows[-1].newton_iterations <= 40
    assert rows[-1].normal_force < 1e-5 * max(row.normal_force for row in rows)
