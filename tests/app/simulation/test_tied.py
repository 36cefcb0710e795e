"""Bonded bodies of meshes that do not match."""

import json
import tomllib

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tests.solved import solved
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.case.toml_files import toml_text
from tribox.app.equilibrium.supports import free_bodies
from tribox.app.errors import InputError
from tribox.app.results.contact_points import contact_nodes
from tribox.app.run.run import run_case


def tied(block, **contact):
    """Two blocks of equal width without lateral strain, the upper one bonded and pulled up."""
    data = tomllib.loads(block)
    data["geometry"]["upper"] = {"width": "1.0 mm", "height": "0.5 mm", "elements": [5, 3]}
    data["geometry"]["lower"] = {"width": "1.0 mm", "height": "0.5 mm", "elements": [7, 2]}
    for name in data["bodies"]:
        data["bodies"][name] |= {"nu": 0.0, "formulation": "q1"}
    data["bodies"]["aluminium"]["E"] = "20 MPa"
    del data["contact"][0]["friction"]
    data["contact"][0] |= {"tied": True} | contact
    data["boundary"][1]["displacement"] = {"x": 0, "y": [["0 s", "0 mm"], ["1 s", "0.1 mm"]]}
    data["stage"] = data["stage"][:1]
    data["solver"] = {"tolerance": 1e-11}
    return data


def test_a_uniform_tension_passes_through_meshes_that_do_not_match(block):
    """The patch test: one stress everywhere, that of two bars and the penalty in a row."""
    simulation = solved(tied(block))
    model = simulation.model
    values = contact_nodes(model)
    stress = -values["pressure"]
    assert np.ptp(stress) < 1e-8 * stress.mean()
    assert np.abs(values["tangential_traction"]).max() == 0.0
    (row,) = [r for r in simulation.state.last_of_pairs()]
    assert -row["normal_force"] == pytest.approx(stress.mean() * 1e-3 * 1e-3, rel=1e-9)
    assert row["contact_area"] == pytest.approx(1e-6, rel=1e-9)
    assert row["stick_fraction"] == row["friction_force"] == 0.0
    assert row["normal_resultant"] == pytest.approx(row["normal_force"], rel=1e-9)
    # Neo-Hooke without lateral strain and ν = 0: P = G (λ − 1/λ); bars and penalty carry the same.
    K = float(np.mean(model.problem.contacts[0].penalty))

    def length(p):
        stretch = [p / (2 * G) + np.sqrt(1 + (p / (2 * G)) ** 2) for G in (2.5e6, 10e6)]
        return 0.5e-3 * (sum(stretch) - 2.0) + p / K

    assert length(stress.mean()) == pytest.approx(0.1e-3, rel=1e-9)
    last = simulation.rows[-1]
    assert abs(last.energy_error) < 5e-3 * last.external_work
    assert last.normal_force == last.contact_area == 0.0  # the sums are those of friction


def test_in_space_it_passes_nearly_uniform(block):
    """The parts of the facets leave an error of the integrals: 6e-4 on three by four facets."""
    data = tied(block)
    data["geometry"] = {"kind": "two-boxes"}
    for name, elements in (("upper", [3, 2, 3]), ("lower", [4, 2, 5])):
        sides = dict.fromkeys(("width", "depth"), "1 mm")
        data["geometry"][name] = sides | {"height": "0.5 mm", "elements": elements}
    for boundary in data["boundary"]:
        boundary["displacement"]["z"] = 0
    simulation = solved(data)
    stress = -contact_nodes(simulation.model)["pressure"]
    assert stress.mean() > 0.0 and np.ptp(stress) < 2e-3 * stress.mean()
    assert [row.newton_iterations for row in simulation.rows][1:] < [3, 3]


def test_shear_is_carried_and_a_whole_that_turns_feels_nothing(block):
    data = tied(block)
    data["boundary"][1]["displacement"] = {"x": [["0 s", "0 mm"], ["1 s", "0.05 mm"]], "y": 0}
    sheared = solved(data)
    force = sheared.state.last_of_pairs()[0]["force_x"]
    bottom = sheared.model.problem.prescribed[0]
    assert bottom.dofs[0] % 2 == 0  # along x
    reaction = sheared.model.problem.reaction(bottom) * 1e-3
    assert force < 0.0 and force == pytest.approx(reaction, rel=1e-6)

    whole = tied(block)
    whole["boundary"] = [
        {"surface": s, "rotation": {"angle": [["0 s", 0], ["1 s", "30 deg"]], "centre": [0, 0]}}
        for s in ("bottom", "top")
    ]
    whole["stage"][0]["steps"] = 6
    turned = solved(whole)
    assert turned.rows[-1].strain_energy < 1e-10 * sheared.rows[-1].strain_energy
    force = turned.model.problem.committed[0].pull
    assert np.abs(force).max() < 1e-9 * 5e6


def test_a_body_that_is_only_tied_is_supported(block):
    data = tied(block)
    data["boundary"][1] = {"surface": "top", "pressure": "-0.1 MPa"}
    simulation = solved(data)
    row = simulation.state.last_of_pairs()[0]
    assert row["normal_force"] == pytest.approx(-0.1, rel=0.05)
    assert not [n for n in simulation.model.notes if "only contact holds" in n]


def test_what_is_tied_to_a_supported_body_does_not_float_until_the_tie_lets_go(block, tmp_path):
    data = tied(block, stages=["press", "unload"])
    steps = [["0 s", "0 MPa"], ["1 s", "0.1 MPa"], ["2 s", "0 MPa"]]
    data["boundary"][1] = {"surface": "top", "platen": {"direction": "y", "pressure": steps}}
    data["stage"] = [
        {"name": name, "duration": "1 s", "steps": 1} for name in ("press", "unload", "apart")
    ]
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    (line,) = [s for s in read_log(tmp_path / "out").splitlines() if "floats" in s]
    assert "elastomer floats in 1 steps" in line and "stage apart" in line


def test_a_tie_that_costs_more_than_a_hundredth_of_the_force_says_so(block, tmp_path):
    """Bars of 5 and 20 MPa in a row with the penalty: what it gives way by is known."""
    data = tied(block, penalty="1e12 Pa/m")
    data["boundary"][1]["displacement"]["y"] = [["0 s", "0 mm"], ["1 s", "0.01 mm"]]
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["penetration_over_approach"] == [pytest.approx(1e-12 / 1.25e-10, rel=0.02)]
    assert not [line for line in summary["warnings"] if "gives way" in line]
    data["contact"][0]["penalty"] = "3e11 Pa/m"
    run_case(Case.model_validate(data), tmp_path / "soft", quiet=True, comm=MPI.COMM_SELF)
    soft = json.loads((tmp_path / "soft" / "summary.json").read_text())
    assert soft["penetration_over_approach"] == [pytest.approx(1e-12 / 0.375e-10, rel=0.02)]
    assert [line for line in soft["warnings"] if "gives way by 0.026 of the deform" in line]


def test_a_tie_lets_go_in_a_later_stage(block):
    data = tied(block, stages=["press"])
    data["stage"].append({"name": "free", "duration": "1 s", "steps": 1})
    rows = solved(data).rows
    assert rows[-1].strain_energy < 1e-12 * rows[-2].strain_energy
    assert rows[-1].dissipation == pytest.approx(rows[-2].interface_energy)


def test_explicit_steps_come_to_the_same_force(block):
    data = tied(block, penalty_factor=3)  # which does not shorten explicit steps
    data["boundary"][1]["displacement"]["y"] = {
        "table": [["0 s", "0 mm"], ["0.4 ms", "0.05 mm"]],
        "ramp": "smooth",
    }
    for body in data["bodies"].values():
        body["density"] = "1000 kg/m^3"
    data["stage"] = [{"name": "press", "duration": "0.4 ms", "steps": 2}]
    implicit = solved(data).state.last_of_pairs()[0]
    data["solver"] = {"kind": "explicit"}
    data["stage"].append({"name": "rest", "duration": "0.3 ms", "steps": 1, "relax": True})
    explicit = solved(data)
    found = explicit.model.problem.committed[0]
    force = explicit.model.problem.contacts[0].surface.slave.weight @ found.pressure * 1e-3
    assert force == pytest.approx(implicit["normal_force"], rel=0.02)
    last = explicit.rows[-1]
    assert abs(last.energy_error) < 0.01 * last.external_work


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"friction": {"law": "coulomb", "mu": 0.1}}, "friction: does not go with tied"),
        ({"film": {"thickness": "1 nm"}}, "film: does not go with tied"),
        ({"friction_factor": 2}, "friction_factor: does not go with tied"),
        ({"smoothing_angle": "30 deg"}, "smoothing_angle: does not go"),
        ({"pressure": "pointwise"}, 'pressure = "pointwise": does not go with tied'),
        ({"tied": False}, "friction: missing; the friction law"),
        ({"tied": 1}, "tied = 1: must be true or false"),
    ],
)
def test_wrong_keys_are_refused(block, keys, line, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(toml_text(tied(block, **keys)))
    with pytest.raises(InputError) as error:
        load_case(path)
    assert line in str(error.value) and "\n" not in str(error.value)


def test_what_is_tied_acts_from_the_start(block, tmp_path):
    data = tied(block, stages=["free"])
    data["stage"].append({"name": "free", "duration": "1 s", "steps": 1})
    path = tmp_path / "case.toml"
    path.write_text(toml_text(data))
    with pytest.raises(InputError, match="acts from the first stage on"):
        load_case(path)


def test_surfaces_that_are_apart_are_not_tied(block):
    data = tied(block)
    data["geometry"]["gap"] = "0.2 mm"
    with pytest.raises(InputError, match=r"contact\.0: no point of the slave lies beside"):
        build_model(Case.model_validate(data), MPI.COMM_SELF)


# -- to a tool ------------------------------------------------------------------------------------

GRIP = {"plane": [0, -1], "rings": [0, -1], "space": [0, -1, 0]}


def gripped(kind, tools=None, boundary=(), **tables):
    """A bar on its fixed lower end, its upper end tied to a tool."""
    spans = {"x": [0, "1 mm"], "y": [0, "3 mm"], "elements": [3, 4]}
    if kind == "space":
        spans |= {"z": [0, "1 mm"], "elements": [2, 3, 2]}
    normal = GRIP[kind]
    still = dict.fromkeys("xyz"[: len(normal)], 0)
    shape = {"shape": "plane", "point": [0, "3 mm", 0][: len(normal)], "normal": normal}
    bar = {"material": "neo-hookean", "E": "5 MPa", "nu": 0.4, "formulation": "q1"}
    return {
        "geometry": {"kind": "blocks", "blocks": {"bar": spans}}
        | ({"section": "axisymmetric"} if kind == "rings" else {}),
        "bodies": {"bar": bar},
        "tools": {} if tools is None else {"grip": shape | tools},
        "contact": []
        if tools is None
        else [{"slave": "bar_top", "master": "grip", "tied": True, "penalty_factor": 1e3}],
        "boundary": [{"surface": "bar_bottom", "displacement": still}, *boundary],
        "stage": [{"name": "pull", "duration": "1 s", "steps": 2}],
        "solver": {"tolerance": 1e-10},
        **tables,
    }


def of_tool(simulation, name):
    tools = simulation.state.tools
    return np.array([row[tools.columns.index(name)] for row in tools.rows])


PULL = [["0 s", 0], ["1 s", "0.3 mm"]]


@pytest.mark.parametrize("kind", list(GRIP))
def test_a_gripped_end_is_a_clamped_one_by_displacement_and_by_force(kind):
    still = dict.fromkeys("xyz"[: len(GRIP[kind])], 0)
    clamped = solved(
        gripped(kind, boundary=[{"surface": "bar_top", "displacement": still | {"y": PULL}}])
    )
    moved = solved(gripped(kind, {"displacement": {"y": PULL}}))
    pulled = of_tool(moved, "driving_force_y")
    assert pulled[-1] == pytest.approx(
        clamped.state.motion.of_surface("bar_top", "force_y")[-1], rel=2e-3
    )
    assert of_tool(moved, "force_y") == pytest.approx(-pulled, rel=1e-9)
    assert moved.state.last_of_pairs()[0]["normal_force"] == pytest.approx(-pulled[-1], rel=1e-9)
    loaded = solved(gripped(kind, {"force": {"y": [["0 s", 0], ["1 s", float(pulled[-1])]]}}))
    assert of_tool(loaded, "displacement_y")[-1] == pytest.approx(0.3e-3, rel=1e-7)
    assert [row.attempts for row in loaded.rows] == [1, 1] and not loaded.model.notes
    assert loaded.rows[-1].newton_iterations <= 5
    assert loaded.rows[-1].strain_energy == pytest.approx(clamped.rows[-1].strain_energy, rel=2e-3)


TURN = {"angle": [["0 s", 0], ["1 s", 0.9]]}


def turned(comm, directory):
    data = gripped(
        "plane", {"rotation": TURN | {"centre": [0.5e-3, 3e-3]}}, solver={"tolerance": 1e-11}
    )
    low = {"shape": "plane", "point": [0, 0], "normal": [0, 1]}
    low |= {"rotation": {"angle": 0, "centre": [0.5e-3, 0]}}
    data["tools"] = {"low": low, **data["tools"]}
    data["contact"].append(data["contact"][0] | {"slave": "bar_bottom", "master": "low"})
    data["boundary"] = [{"surface": "bar_left", "pressure": 0}]
    simulation = solved(data, comm)
    assert not simulation.model.notes
    last = simulation.state.tools.last()
    force = ("force_x", "force_y", "moment_z")
    driving = ("driving_force_x", "driving_force_y", "driving_moment")
    return (
        [row.newton_iterations for row in simulation.rows],
        [last["grip"][name] for name in force],
        [last["grip"][name] for name in driving],
        [last["low"][name] for name in force],
    )


@pytest.mark.mpi(turned, 3)
def test_a_grip_that_turns_a_bar_balances_force_and_moment(on_ranks):
    """A bar held by two grips, one turned by 50 degrees: its own moments on both add up to zero."""
    one, three = (on_ranks(turned, count) for count in (1, 3))
    for here, there in zip(one[1:], three[1:], strict=True):
        assert there == pytest.approx(here, rel=1e-8)
    iterations, (force_x, force_y, moment), driving, left = one
    assert max(iterations) <= 6
    assert driving == pytest.approx([-force_x, -force_y, -moment], rel=1e-9)
    # About the lower grip's centre: the upper one is 3 mm above it.
    assert left[0] == pytest.approx(-force_x, rel=1e-8)
    assert left[2] == pytest.approx(-(moment - 3e-3 * force_x), rel=1e-6)
    assert abs(moment) > 1e-3


@pytest.mark.parametrize("way", ["stages", "release"])
def test_a_grip_that_lets_go_frees_the_bar(way):
    data = gripped("plane", {"displacement": {"y": PULL}})
    data["stage"].append({"name": "free", "duration": "1 s", "steps": 2})
    if way == "stages":
        data["tools"]["grip"]["stages"] = ["pull"]
    else:
        data["stage"][1]["release"] = ["grip"]
    simulation = solved(data)
    rows = simulation.rows
    share = rows[2].strain_energy / rows[1].strain_energy
    assert share == pytest.approx(0.0 if way == "stages" else 0.25, abs=0.03)
    assert rows[-1].strain_energy < 1e-12 * rows[1].strain_energy
    assert of_tool(simulation, "force_y")[2:] == pytest.approx(0.0, abs=1e-12)
    assert of_tool(simulation, "displacement_y")[-1] == pytest.approx(0.3e-3)


def test_a_bar_that_only_a_grip_holds_is_held():
    """Along what drives the tool nothing holds both, and no load acts."""
    data = gripped("plane", {})
    data["boundary"] = [{"surface": "bar_bottom", "pressure": [["0 s", 0], ["1 s", "-1 MPa"]]}]
    held = solved(data)
    assert not any("contact" in n for n in held.model.notes) and not free_bodies(held.model.problem)
    assert of_tool(held, "force_y")[-1] == pytest.approx(-1e6 * 1e-3, rel=0.3)
    data = gripped("plane", {"force": {"y": 0}})
    data["boundary"] = [{"surface": "bar_bottom", "displacement": {"x": 0}}]
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    assert [body.name for body in free_bodies(model.problem)] == ["bar"]
    assert [note for note in model.notes if "only contact holds" in note]


def test_what_a_bond_carries_is_said(block, tmp_path):
    case = Case.model_validate(tied(block) | {"output": {"figures": False}})
    simulation = run_case(case, tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    [pair] = simulation.state.last_of_pairs()
    log = (tmp_path / "out" / "log.txt").read_text(encoding="utf-8")
    assert f"tied, force on the slave (0, {pair['force_y']:.5g}) N" in log or (
        f", {pair['force_y']:.5g}) N" in log
    )
    assert "N 0 N" not in log
