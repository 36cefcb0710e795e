"""What is said of contact that reaches the end of a surface, or runs past it."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tests.solved import Cuts
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.case.toml_files import toml_text
from tribox.app.errors import InputError, SolutionError
from tribox.app.results import read
from tribox.app.run.run import run_case
from tribox.app.simulation.simulation import Simulation
from tribox.forms.contact.pressure import nodal_pressure
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.surface import ContactSurface


@pytest.mark.parametrize(
    ("offset", "width", "sliding", "end"),
    [
        ("0.1 mm", "1.5 mm", "0.15 mm", None),
        ("0.1 mm", "1.2 mm", "0.3 mm", "(0.0012, 0) m"),
        ("0.1 mm", "1.2 mm", "-0.3 mm", "(0, 0) m"),
        # Longer than the master from the start: what hangs over has never been above it.
        ("-0.1 mm", "0.8 mm", "0 mm", None),
        # Pressed, it has spread over the left end too.
        ("-0.1 mm", "0.8 mm", "0.15 mm", "(0, 0) m and (0.0008, 0) m"),
    ],
)
def test_only_points_that_were_above_the_master_run_past_its_end(
    tmp_path, block, offset, width, sliding, end
):
    data = tomllib.loads(block)
    data["geometry"]["lower"]["width"] = width
    data["geometry"]["offset"] = offset
    data["boundary"][1]["displacement"]["x"] = [["1 s", "0 mm"], ["2 s", sliding]]
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    log = read_log(tmp_path / "out")
    past = [line for line in log.splitlines() if "runs past the end of" in line]
    assert len(past) == (end is not None)
    for line in past:
        assert f"elastomer_contact runs past the end of aluminium_contact at {end}, unde" in line
        assert "stage slide)" in line


# A rubber cylinder, or ball, whose contact outgrows the surfaces that are named.
ROUND = """
bodies.elastomer = { material = "neo-hookean", E = "10 MPa", nu = 0.45 }
bodies.aluminium = { material = "neo-hookean", E = "10 GPa", nu = 0.3 }
boundary = [
 { surface = "bottom", displacement = { x = 0, y = 0 } },
 { surface = "top", displacement = { x = 0, y = [["0 s", "0 mm"], ["1 s", "-0.5 mm"]] } },
]
stage = [{ name = "press", duration = "1 s", steps = 2 }]
output = { fields_every = 0, figures = false }
[geometry]
kind = "cylinder-on-block"
contact_width = "3 mm"
contact_size = "0.25 mm"
growth = 1.8
cylinder = { radius = "10 mm" }
block = { width = "16 mm", height = "6 mm" }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
smoothing_angle = "30 deg"
friction = { law = "frictionless" }
"""
REACHED = r"contact reaches the end of (\w+) at (.*), undeformed, .*: (\S+) Pa there, (\S+) % of"


def outgrown(
    comm: MPI.Comm, directory: Path, **changes: dict
) -> tuple[list[tuple[str, ...]], ContactSurface, ContactTrial]:
    """What is said of ends that the contact reaches, and where it is; tables may be changed."""
    data = tomllib.loads(ROUND)
    data["boundary"][1]["displacement"]["y"][1][1] = changes.pop("depth", "-0.5 mm")
    data["contact"][0] |= changes.pop("contact", {})
    data["geometry"] |= changes.pop("geometry", {})
    data |= changes
    run = run_case(Case.model_validate(data), directory / "out", quiet=True, force=True, comm=comm)
    comm.barrier()  # the first rank writes
    found = re.findall(REACHED, read_log(directory / "out"))
    problem = run.model.problem
    return found, problem.contacts[0].surface, problem.committed[0]


ENOUGH = {"cylinder": {"radius": "10 mm", "contact_width": "5 mm"}}


@pytest.mark.parametrize(
    ("geometry", "surface", "where", "pressure"),
    [
        ({}, "elastomer_contact", "(-0.0015, 0.0001131) m and (0.0015, 0.0001131) m", "averaged"),
        (ENOUGH, "aluminium_contact", "(-0.0015, 0) m and (0.0015, 0) m", "averaged"),
        (ENOUGH, "aluminium_contact", "(-0.0015, 0) m and (0.0015, 0) m", "pointwise"),
    ],
    ids=["slave", "master", "pointwise"],
)
def test_contact_that_outgrows_a_surface_is_told(tmp_path, geometry, surface, where, pressure):
    """With the pressure at the end as it is shown, and its share of the mean one."""
    contact = {"pressure": pressure}
    [(*place, most, share)], pair, trial = outgrown(
        MPI.COMM_SELF, tmp_path, geometry=geometry, contact=contact
    )
    assert place == [surface, where]
    shown = nodal_pressure(pair, trial.pressure)
    mean = pair.slave.weight @ trial.pressure / (pair.slave.weight @ (trial.pressure > 0.0))
    assert 0.5 * shown.max() < float(most) < 1.01 * shown.max()
    assert float(share) == pytest.approx(100.0 * float(most) / mean, rel=0.01)


@pytest.mark.parametrize("geometry", [{}, ENOUGH], ids=["slave", "master"])
def test_contact_within_its_surfaces_reaches_no_end(tmp_path, geometry):
    """A half-width of 1.2 mm on surfaces that reach 1.5 mm and more to either side."""
    found, pair, trial = outgrown(MPI.COMM_SELF, tmp_path, geometry=geometry, depth="-0.16 mm")
    assert not found
    pressed = pair.slave.position[trial.pressure > 0.0, 0]
    assert 1e-3 < pressed.max() < 1.5e-3


def test_corners_of_a_body_are_no_ends(tmp_path, block):
    """A block pressed over all its width, and one that hangs over the edge of the other."""
    for offset in ("0.5 mm", "1.5 mm"):
        data = tomllib.loads(block)
        data["geometry"]["offset"] = offset
        data["stage"] = data["stage"][:1]
        run_case(Case.model_validate(data), tmp_path / "out", quiet=True, force=True)
        assert "reaches the end" not in read_log(tmp_path / "out")


def ball(comm: MPI.Comm, directory: Path) -> list[tuple[str, ...]]:
    """A quarter of a ball, of whose surface and the block's too little is named."""
    radius, size = {"radius": "10 mm"}, {"radius": "8 mm", "height": "6 mm"}
    data = tomllib.loads(ROUND)
    data["geometry"] |= {"kind": "sphere-on-block", "part": "quarter", "contact_size": "0.5 mm"}
    del data["geometry"]["cylinder"]
    data["geometry"] |= {"sphere": radius, "block": size, "contact_width": "2 mm"}
    data["boundary"] = data["boundary"][:2]
    data["boundary"][1]["displacement"]["y"][1][1] = "-0.25 mm"
    for one in data["boundary"]:
        one["displacement"]["z"] = 0
    data["boundary"] += [
        {"surface": f"{body}_symmetry_{axis}", "displacement": {axis: 0}}
        for body in ("elastomer", "aluminium")
        for axis in "xz"
    ]
    found = []
    for slave, master in (("elastomer", "aluminium"), ("aluminium", "elastomer")):
        names = {"slave": f"{slave}_contact", "master": f"{master}_contact"}
        data["contact"][0] |= names
        data["bodies"][slave]["E"], data["bodies"][master]["E"] = "10 MPa", "10 GPa"
        run_case(Case.model_validate(data), directory / "out", quiet=True, force=True, comm=comm)
        comm.barrier()  # the first rank writes
        found += re.findall(REACHED, read_log(directory / "out"))
    return found


@pytest.mark.mpi(ball, 2)
def test_ends_in_space_are_told_on_any_number_of_ranks(tmp_path, on_ranks):
    """Planes of symmetry are none; slave first, then master."""
    slave, master = found = ball(MPI.COMM_SELF, tmp_path)
    assert slave[:2] == ("elastomer_contact", "(0.001, 0.0001005, 0.001) m")
    assert master[0] == "elastomer_contact" and "0.001, 5.0" in master[1]
    assert on_ranks(ball, 2) == [list(one) for one in found]


def test_a_step_that_fails_tells_of_ends_that_were_reached(tmp_path):
    solver = {"max_iterations": 4, "min_step_fraction": 0.6}
    stage = [{"name": "press", "duration": 1.0, "steps": 2}]
    with pytest.raises(SolutionError) as caught:
        outgrown(MPI.COMM_SELF, tmp_path, depth="-3 mm", solver=solver, stage=stage)
    assert re.search(REACHED, str(caught.value)), caught.value
    assert re.search(r"a surface \w+_contact that reaches further there", str(caught.value))


# A round tool that slides along a rubber strip, whose facets are .5 mm long, by 2.5 mm.
ROLLED = """
geometry.kind = "blocks"
geometry.thickness = "1 mm"
geometry.blocks = { strip = { x = ["0 mm", "14 mm"], y = ["0 mm", "2 mm"], elements = [28, 2] } }
bodies = { strip = { material = "neo-hookean", E = "5 MPa", nu = 0.45 } }
tools.roll.shape = "circle"
tools.roll.centre = ["5 mm", "12 mm"]
tools.roll.radius = "10 mm"
tools.roll.displacement = { x = "driven", y = [["0 s", "0 mm"], ["1 s", "-0.2 mm"]] }
boundary = [{ surface = "strip_bottom", displacement = { x = 0, y = 0 } }]
stage = [
    { name = "press", duration = "1 s", steps = 2, rate_dependent = false },
    { name = "slide", velocity = "5 mm/s", duration = "0.5 s", steps = 1 },
]
output = { figures = false }
[[contact]]
slave = "strip_top"
master = "roll"
film = { thickness = "180 nm" }
friction.law = "friction-map"
friction.mu_s = 0.2
friction.alpha = 0.99
friction.eta_b = "0.8 Pa*s"
friction.D_max = "250 nm"
friction.V_star = "0.1 mm/s"
friction.V_star_at = "30 nm"
friction.K_T = 100000000000.0
"""


def rolled(directory: Path, steps: int, **contact: object) -> tuple[float, list[str]]:
    """Friction at the end, N, and what is said of long steps."""
    data = tomllib.loads(ROLLED)
    data["contact"][0] |= contact
    data["stage"][1]["steps"] = steps
    run_case(Case.model_validate(data), directory / "out", quiet=True, force=True)
    log = read_log(directory / "out")
    found = [line for line in log.splitlines() if "facets of the slave, and" in line]
    return float(read(directory / "out").history["friction_force"].iloc[-1]), found


def test_steps_of_many_facets_are_told_where_the_film_of_new_points_lacks(tmp_path):
    exact, silent = rolled(tmp_path, 10)
    assert silent == []
    force, [line] = rolled(tmp_path, 1)
    told = re.search(
        r"slides 5.\d facets .* at least (\S+)% too low \(time 1.5 s, st.* 0.0005 m", line
    )
    assert told, line
    assert 0.5 < float(told[1]) < 100.0 * (1.0 - force / exact) < 10.0
    dry = {"law": "coulomb", "mu": 0.3}
    assert rolled(tmp_path, 1, friction=dry, film=None)[1] == []


# A rubber block on a round tool, which ends within the contact or behind it.
ON_TOOL = """
bodies = { block = { material = "neo-hookean", E = "5 MPa", nu = 0.45 } }
contact = [{ slave = "block_bottom", master = "die", friction = { law = "frictionless" } }]
boundary = [
 { surface = "block_top", displacement = { x = 0, y = [["0 s", "0 mm"], ["1 s", "-0.4 mm"]] } },
]
stage = [{ name = "press", duration = "1 s", steps = 2 }]
output = { fields_every = 0, figures = false }
tools = { die = { shape = "polyline" } }
[geometry]
kind = "blocks"
blocks = { block = { x = ["-6 mm", "6 mm"], y = ["0 mm", "4 mm"], elements = [24, 6] } }
"""


@pytest.mark.parametrize(("half", "told"), [(3.0, True), (18.0, False), (0.0, False)])
def test_a_round_tool_that_ends_within_the_contact_is_told(tmp_path, half, told):
    """Chords of an arc up to ± ``half`` degrees; 0: a flat, which ends in edges."""
    data = tomllib.loads(ON_TOOL)
    angles = np.radians(np.linspace(-half, half, 13))
    arc = np.stack([20.0 * np.sin(angles), 20.0 * np.cos(angles) - 20.0], axis=1) * 1e-3
    data["tools"]["die"]["points"] = arc.tolist() if half else [[-3e-3, 0.0], [3e-3, 0.0]]
    run = run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    lines = re.findall(REACHED, read_log(tmp_path / "out"))
    assert len(lines) == told
    for name, where, most, share in lines:
        assert name == "die" and "(-0.001047, " in where and "(0.001047, " in where
        [trial], [term] = run.model.problem.committed, run.model.problem.contacts
        shown = nodal_pressure(term.surface, trial.pressure)
        assert 0.5 * shown.max() < float(most) < 1.01 * shown.max()
        assert float(share) > 50.0


# -- A pressed block that slides off a shorter one over its end, until nothing touches -------------


def data_of(block, **contact):
    data = tomllib.loads(block)
    data["geometry"]["lower"] = {"width": "1.2 mm", "height": "0.5 mm", "elements": [18, 4]}
    data["geometry"]["upper"] = {"width": "1.0 mm", "height": "0.5 mm", "elements": [10, 4]}
    data["geometry"]["offset"] = "0.1 mm"
    data["contact"][0] |= contact
    data["boundary"][1]["displacement"] = {
        "x": [["1 s", "0 mm"], ["2 s", "1.3 mm"]],
        "y": [["0 s", "0 mm"], ["1 s", "-0.03 mm"]],
    }
    data["stage"][1]["steps"] = 40
    return data


def drawn_off(block, **contact):
    case = Case.model_validate(data_of(block, **contact))
    simulation, cuts = Simulation(build_model(case, MPI.COMM_SELF)), Cuts()
    simulation.run(cuts)
    return simulation.rows, cuts.count


def test_it_leaves_without_a_cut_and_without_a_jolt(block):
    """T/N = μ as soon as all slides; N falls in proportion to what is left; energies close."""
    rows, cuts = drawn_off(block, fade_length="0.15 mm")
    assert cuts == 0
    last = rows[-1]
    assert last.normal_force == last.contact_area == last.interface_energy == 0.0
    assert last.strain_energy < 1e-6 * max(row.strain_energy for row in rows)
    sliding = [row for row in rows[8:] if row.normal_force > 0.0]
    assert len(sliding) > 20
    assert all(abs(row.friction_coefficient - 0.2) < 1e-6 for row in sliding)
    force = np.array([row.normal_force for row in rows[3:]])
    assert np.all(np.diff(force) <= 1e-3 * force[0])
    assert np.abs(np.diff(force)).max() < 0.06 * force[0]
    assert abs(last.energy_error) < 0.01 * last.external_work


def test_what_is_lost_is_what_pressing_has_stored(block):
    """Without friction nothing else can dissipate it."""
    rows, cuts = drawn_off(block, fade_length="0.15 mm", friction={"law": "frictionless"})
    pressed, last = rows[2], rows[-1]
    assert cuts == 0
    assert last.external_work == pytest.approx(pressed.external_work, rel=0.01)
    assert last.dissipation == pytest.approx(pressed.strain_energy, rel=0.07)


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"fade_length": "0 mm"}, 'fade_length = "0 mm": must be > 0 m'),
        ({"fade_length": "1 mm", "pressure": "pointwise"}, "fade_length = 0.001: goes with"),
        ({"fade_length": "1 s"}, '"s" has the wrong dimension'),
    ],
)
def test_wrong_lengths_are_refused(block, keys, line, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(toml_text(data_of(block, **keys)))
    with pytest.raises(InputError) as error:
        load_case(path)
    assert line in str(error.value) and "\n" not in str(error.value)


def test_a_master_that_would_fade_everywhere_is_refused(block):
    case = Case.model_validate(data_of(block, fade_length="0.7 mm"))
    with pytest.raises(InputError, match=r"contact\.0: fade_length = 0\.0007 m: no part of the"):
        build_model(case, MPI.COMM_SELF)


# -- smooth masters that end ----------------------------------------------------------------------

# Both blocks held sideways: uniaxial strain, but for how a smooth master hands on its end's load.
FLAT = """
boundary = [
 { surface = "bottom", symmetry = true }, { surface = "elastomer_left", symmetry = true },
 { surface = "aluminium_left", symmetry = true }, { surface = "elastomer_right", symmetry = true },
 { surface = "aluminium_right", symmetry = true },
 { surface = "top", pressure = [["0 s", "0 MPa"], ["1 s", "1 MPa"]] },
]
stage = [{ name = "press", duration = "1 s", steps = 1 }]
output = { figures = false }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "frictionless" }
[bodies]
elastomer = { material = "hencky", E = "70 GPa", nu = 0.3 }
aluminium = { material = "hencky", E = "70 GPa", nu = 0.3 }
[geometry]
kind = "two-blocks"
upper = { width = "10 mm", height = "5 mm", elements = [20, 4] }
lower = { width = "10 mm", height = "5 mm", elements = [20, 4] }
"""


@pytest.mark.parametrize(
    ("elements", "held"), [(20, True), (7, True), (27, True), (7, False), (20, False)]
)
def test_a_smooth_master_that_ends_below_its_slave(tmp_path, elements, held):
    """At planes of symmetry it passes the patch test as inside; at free ends that is told."""
    data = tomllib.loads(FLAT)
    data["contact"][0]["smoothing_angle"] = "30 deg"
    data["geometry"]["lower"]["elements"][0] = elements
    if not held:  # a distance that stays the same, as a wall beside the block has
        still = [["0 s", "1 nm"]]
        for boundary in data["boundary"]:
            if boundary["surface"].startswith("aluminium_"):
                boundary |= {"symmetry": False, "displacement": {"x": still}}
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    result = read(tmp_path / "out")
    surface = result.contact()
    pressure = surface.point_data["pressure"][np.argsort(surface.points[:, 0])] / 1e6 - 1.0
    inside = np.abs(pressure[3:-3]).max() if elements != 20 else 1e-10
    ends = np.abs(pressure[[0, 1, -2, -1]]).max()
    assert ends <= 1.5 * inside if held else ends > 0.04
    assert result.history.normal_force.iloc[-1] == pytest.approx(1e4, rel=1e-4)
    told = "smoothing hands on too little" in read_log(tmp_path / "out").replace("\n", " ")
    assert told != held


@pytest.mark.parametrize("elements", [20, 27])
def test_a_smooth_master_on_the_axis_of_revolution(tmp_path, elements):
    """No vertex lacks more than 1/62 of its load, of which as stiff a body takes a half."""
    data = tomllib.loads(FLAT)
    data["boundary"] = [b for b in data["boundary"] if not b["surface"].endswith("_left")]
    data["geometry"] = {
        "kind": "blocks",
        "section": "axisymmetric",
        "blocks": {
            "aluminium": {"x": [0.0, 0.01], "y": [0.0, 0.005], "elements": [elements, 4]},
            "elastomer": {"x": [0.0, 0.01], "y": [0.005, 0.01], "elements": [20, 4]},
        },
    }
    data["boundary"][0]["surface"], data["boundary"][-1]["surface"] = (
        "aluminium_bottom",
        "elastomer_top",
    )
    names = {"slave": "elastomer_bottom", "master": "aluminium_top"}
    data["contact"][0] |= names | {"smoothing_angle": "30 deg"}
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    surface = read(tmp_path / "out").contact()
    pressure = surface.point_data["pressure"][np.argsort(surface.points[:, 0])] / 1e6 - 1.0
    assert np.abs(pressure).max() < 0.01
    assert elements != 20 or np.abs(pressure[7:]).max() < 3e-3
    assert "smoothing hands on too little" not in read_log(tmp_path / "out").replace("\n", " ")
