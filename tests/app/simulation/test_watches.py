"""How far bodies flow: warned of where data end and steps are long, once, and after a restart."""

import json
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import dolfinx
import numpy as np
import pytest

from tests.app.checkpoint.going_on import case_of, run
from tests.app.read_log import read_log
from tests.contact_boxes import PENALTY
from tests.flowing import soft_block
from tests.geometry.surfaces.test_vertices import graded
from tests.grid import grid
from tribox.app.build.mesh_notes import locking_bodies
from tribox.app.case.case import Case
from tribox.app.implicit.stepper import StepResult
from tribox.app.run.run import run_case
from tribox.app.simulation.contact_warnings import FEW, _few_facets
from tribox.app.simulation.failure_diagnosis import most_squeezed
from tribox.app.simulation.pair_probe import PairProbe
from tribox.app.simulation.watches import FlowWatch, Watches
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.geometry.surfaces.surface import ContactSurface


@pytest.mark.parametrize(
    ("end", "steps", "said"),
    [
        (0.02, 2, ["beyond 0.02, where its hardening table ends"]),
        (9.0, 2, []),
        (9.0, 1, ["grew by 0.1", "in one step"]),
    ],
)
def test_it_is_said_once(tmp_path, end, steps, said):
    table = {"law": "table", "points": [[0, 0.3e6], [end, 0.3e6 + 1e6 * end]]}
    deep = {"stage": [{"name": "press", "duration": "1 s", "steps": steps}]}
    if steps == 1:
        deep["boundary.1.displacement"] = {"x": 0, "y": [["0 s", 0], ["1 s", "-0.09 mm"]]}
    keys = deep | {"bodies__aluminium__hardening": table}
    simulation = run(case_of(soft_block(**keys), fields_every=0), tmp_path / "out")
    log = read_log(tmp_path / "out")
    lines = [line for line in log.splitlines() if "equivalent plastic strain" in line]
    assert len(lines) == bool(said) and all(word in lines[0] for word in said)
    watch = FlowWatch(simulation.model.problem)
    watch.restore(watch.snapshot() | {"found": [["table aluminium", "known"]]})
    watch.step(simulation.rows[-1])
    assert list(watch.warnings())[:1] == ["known"]
    assert watch.snapshot()["found"][0] == ["table aluminium", "known"]


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    """A run whose steps leave nothing to say, for watches to be told of others."""
    return run(case_of(soft_block(), fields_every=0), tmp_path_factory.mktemp("said") / "out")


def squeezed(simulation, to: float, everywhere: bool) -> None:
    """Take the upper body's height, or that of its cells at one corner, to a share of it."""
    problem, name = simulation.model.problem, "elastomer"
    place = problem.space.tabulate_dof_coordinates()[:, :2]
    nodes = np.unique(problem.space.dofmap.list[simulation.model.named.cells(name)])
    height = place[nodes, 1]
    low = height.min()
    level = height[height > low + 1e-9].min()
    moved = np.zeros((len(problem.u.x.array) // 2, 2))
    moved[nodes, 1] = (to - 1.0) * (height - low)
    if not everywhere:
        corner = (np.abs(height - level) < 1e-9) & (place[nodes, 0] == place[nodes, 0].min())
        moved[nodes, 1] = np.where(corner, (to - 1.0) * (level - low), 0.0)
    problem.u.x.array[:] = moved.reshape(-1)


@pytest.mark.parametrize(("to", "everywhere"), [(-0.1, False), (0.1, False), (0.15, True)])
def test_collapsed_elements_and_relaxed_steps_are_said_by_stages(pressed, to, everywhere):
    """Once a stage; a foam that is pressed flat all over has not collapsed."""
    watches, row = Watches(pressed.model), pressed.rows[-1]
    squeezed(pressed, to, everywhere)
    for _ in range(2):
        watches.step(row, StepResult(True, 1, 1, 2, [1e-9], relaxed=True), 0.0)
    lines = list(watches.warnings("press"))
    assert sum("relaxed by springs in 2 steps" in line for line in lines) == 1
    found = [line for line in lines if "has nearly collapsed" in line]
    # By hand: J of the bilinear cell, at the Gauss points beside the corner.
    least = to if everywhere else 1.0 - (1.0 - to) * (0.5 + 0.5 / np.sqrt(3.0))
    assert most_squeezed(pressed.model.problem).ratio == pytest.approx(least)
    if least > 0.2 or everywhere:
        assert not found
        return
    [line] = found
    assert "an element of body elastomer at" in line and f"stage {row.stage}" in line
    assert f"volume ratio {least:.2g}" in line


def test_full_integration_of_a_metal_is_said_to_lock():
    named = SimpleNamespace(
        mesh=SimpleNamespace(topology=SimpleNamespace(cell_name=lambda: "quadrilateral"))
    )
    usual = SimpleNamespace(bulk_modulus=2.6, shear_modulus=1.0)
    metal = SimpleNamespace(name="strip", flows=True, reduced=False, material=usual)
    [line] = locking_bodies(named, [metal], 1)
    assert "body strip" in line and "q1-sri" in line
    assert list(locking_bodies(named, [metal], 2)) == []
    metal.material = SimpleNamespace(bulk_modulus=5e3, shear_modulus=1.0)
    [line] = locking_bodies(named, [metal], 2)
    assert "body strip" in line and "quadratic" in line and "q1-sri" in line
    metal.reduced = True
    assert list(locking_bodies(named, [metal], 1)) == []


# -- That a run says so where rounding kept the residual above the tolerance that was asked for ----

CARRIED = {"x": [[0.0, "0 mm"], [1.0, "30 mm"], [2.0, "30.15 mm"]]}


def gel(data: dict) -> None:
    """So soft that its forces drown in what rounding does to the aluminium."""
    data["bodies"]["elastomer"]["E"] = "1 kPa"


def carried(data: dict) -> None:
    """Both blocks travel by 30 mm: that much of the digits of the displacement is lost."""
    down = data["boundary"][1]["displacement"]["y"]
    data["boundary"][1]["displacement"] = {**CARRIED, "y": down}
    data["boundary"][0]["displacement"] = {"x": [*CARRIED["x"][:2], [2.0, "30 mm"]], "y": 0}
    data["solver"] = {"tolerance": 1e-9}


def crowned(data: dict) -> None:
    """A free roll that is nearly flat: gaps are what is left of the 10 m of its radius."""
    layer = {"x": ["-8 mm", "8 mm"], "y": ["-0.1 mm", "0 mm"], "elements": [320, 2]}
    down = {"y": [[0.0, 0.0], [1.0, "-0.45 um"]]}
    turns = {"displacement": down, "rotation": {"moment": 0}}
    roll = {"shape": "circle", "centre": [0, 10], "radius": 10} | turns
    coulomb = {"law": "coulomb", "mu": 0.3}
    data |= {
        "geometry": {"kind": "blocks", "blocks": {"layer": layer}},
        "bodies": {"layer": {"material": "neo-hookean", "E": "5 MPa", "nu": 0.3}},
        "tools": {"roll": roll},
        "contact": [{"slave": "layer_top", "master": "roll", "friction": coulomb}],
        "boundary": [{"surface": "layer_bottom", "displacement": {"x": 0, "y": 0}}],
        "stage": [{"name": "press", "duration": 1, "steps": 2}],
    }


def plain(data: dict) -> None:
    """Nothing of the kind."""


@pytest.mark.parametrize(
    ("change", "cure"),
    [
        (gel, "a lower modulus of aluminium, which is 3e+07 times as stiff"),
        (carried, "letting the other body move, as aluminium has moved far"),
        (crowned, "to place the bodies near the origin (and tools no larger than they need be)"),
        (plain, None),
    ],
    ids=lambda v: getattr(v, "__name__", None),
)
def test_a_residual_that_rounding_keeps_up_is_warned_of_once(block, tmp_path, change, cure):
    data = tomllib.loads(block) | {"output": {"fields_every": 0, "figures": False}}
    change(data)
    case = Case.model_validate(data)
    run_case(case, tmp_path / "out", quiet=True)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    found = [line for line in summary["warnings"] if "rounding" in line]
    share = summary["residual_at_roundoff"]
    if cure is None:
        assert share is None and not found
        return
    [line] = found
    assert case.solver.tolerance < share < 1e-5
    assert f"a residual of {share:.1e} of the contact or reaction force was accepted" in line
    assert f"solver.tolerance = {case.solver.tolerance:g}" in line and cure in line
    assert line in read_log(tmp_path / "out")


# -- What the warnings of a contact go by, pair by pair, against closed forms ----------------------


def trial_of(surface, pressure):
    """Averaged contact with these pressures (v,) at its vertices."""
    gap = -pressure / PENALTY
    at_points = surface.vertices.at_points(pressure)
    count = len(at_points)
    below = SimpleNamespace(facet=np.zeros(count, dtype=np.int32), on_surface=np.ones(count, bool))
    return SimpleNamespace(
        pressure=at_points,
        nodal_pressure=pressure,
        nodal_gap=gap,
        projection=below,
        kinematics=SimpleNamespace(gap=-at_points / PENALTY),
        area_ratio=np.ones(count),
    )


@pytest.mark.parametrize("shape", ["Q4", "hex8"])
@pytest.mark.parametrize("pressed", [1, 2, 4])
def test_the_half_width_is_judged_by_the_facets_at_the_rim(shape, pressed):
    """On a slave whose facets widen along x; its end is no rim, and in space the rim is a line."""
    surface = graded(shape)
    probe = PairProbe(ContactTerm(surface, FrictionlessLaw(), PENALTY))
    x = surface.vertices.position[:, 0]
    ends = np.unique(np.round(x, 12))
    state = probe.measure(trial_of(surface, np.where(x < ends[pressed] - 1e-9, 1.0, 0.0)))
    rim = ends[pressed] - ends[pressed - 1]  # across it; along it facets of space are 0.5 long
    half = ends[pressed] - ends[0]
    assert state.rim == pytest.approx(rim, rel=1e-9)
    # In space points of a face are further from the nearest open vertex than from the rim.
    vertices, points = surface.vertices.position, surface.slave.position
    places = np.concatenate(
        [vertices[x < ends[pressed] - 1e-9], points[points[:, 0] < ends[pressed - 1]]]
    )
    outside = vertices[x > ends[pressed] - 1e-9]
    furthest = np.linalg.norm(places[:, None] - outside[None], axis=2).min(axis=1).max()
    across = {"Q4": 0.0, "hex8": 0.25}[shape]  # half a face along the rim
    assert half * (1.0 - 1e-9) <= furthest <= np.hypot(half, across) * (1.0 + 1e-9)
    assert state.half_width == pytest.approx(max(furthest - 0.5 * rim, 0.5 * rim), rel=1e-9)
    assert state.uncertain == pytest.approx(0.5 * rim / (half - 0.5 * rim), rel=1e-9)


def test_what_presses_all_over_in_the_end_has_no_rim():
    """All points press beside a vertex that does not: the area is as large before and after."""
    surface = graded("Q4")
    probe = PairProbe(ContactTerm(surface, FrictionlessLaw(), PENALTY))
    order = np.argsort(surface.vertices.position[:, 0])
    before = np.ones(len(order))
    before[order[2]] = 0.0
    with_rim = probe.measure(trial_of(surface, before))
    whole = probe.measure(trial_of(surface, np.ones(len(order))))
    assert with_rim.area == whole.area and with_rim.facets < FEW and np.isinf(whole.facets)
    assert whole.is_wider(with_rim) and not with_rim.is_wider(whole)


def test_many_short_facets_within_a_long_one_are_few():
    """Eight of 0.04, and the rim in one of 0.68: from its middle to the end of the slave."""
    mesh = grid("quadrilateral", [9, 1])
    x = mesh.geometry.x[:, 0]
    x[:] = np.where(x < 0.99, 0.36 * x, 1.0)
    space = dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    sides = [
        dolfinx.mesh.locate_entities_boundary(mesh, 1, lambda X, h=h: np.isclose(X[1], h))
        for h in (0.0, 1.0)
    ]
    surface = ContactSurface(space, *sides, 5)
    probe = PairProbe(ContactTerm(surface, FrictionlessLaw(), PENALTY))
    state = probe.measure(trial_of(surface, np.append(np.ones(9), 0.0)))
    assert state.facets == pytest.approx(0.66 / 0.68) and state.facets < FEW
    assert (
        "0.97 slave facets wide from its rim to its middle (0.66 m; those at its rim are 0.68 m "
        "long): its area, and what a film carries, are uncertain by 52 %"
    ) in _few_facets(2, state)
    assert "are uncertain by 103 %" in _few_facets(2, replace(state, uncertain=1.03))
