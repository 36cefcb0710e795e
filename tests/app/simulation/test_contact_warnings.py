"""Warnings on contacts that are too soft, uneven or coarse: their numbers, where they point."""

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.case.case import Case
from tribox.app.run.run import run_case

CASES = Path(__file__).parents[3] / "cases"

# A stiff cylinder pressed into rubber, whose facets are straight.
ROUND = """
bodies.elastomer = { material = "neo-hookean", E = "70 GPa", nu = 0.3 }
bodies.aluminium = { material = "neo-hookean", E = "10 MPa", nu = 0.49 }
boundary = [
 { surface = "bottom", displacement = { x = 0, y = 0 } },
 { surface = "top", displacement = { x = 0, y = [["0 s", "0 mm"], ["1 s", "-0.05 mm"]] } },
]
stage = [{ name = "press", duration = "1 s", steps = 3 }]
output = { fields_every = 0, figures = false }
[geometry]
kind = "cylinder-on-block"
contact_width = "1.4 mm"
contact_size = "25 um"
growth = 1.6
cylinder = { radius = "5 mm" }
block = { width = "6 mm", height = "3 mm", contact_size = "50 um" }
[[contact]]
slave = "aluminium_contact"
master = "elastomer_contact"
smoothing_angle = "30 deg"
pressure = "averaged"
friction = { law = "frictionless" }
"""


def pressed(
    directory: Path, comm: MPI.Comm = MPI.COMM_SELF, **changes: object
) -> tuple[list[str], dict]:
    """The warnings of a run, and its summary; keys of the contact and the block may be changed."""
    data = tomllib.loads(ROUND)
    block = data["geometry"]["block"]
    block["contact_size"] = changes.pop("size", block["contact_size"])
    data["contact"][0] |= changes
    run_case(Case.model_validate(data), directory / "out", quiet=True, force=True, comm=comm)
    comm.barrier()  # the first rank writes
    summary = json.loads((directory / "out" / "summary.json").read_text())
    lines = [line for line in summary["warnings"] if line.startswith("contact.0")]
    return lines, summary


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, None),
        ({"penalty_factor": 0.3}, "raise the penalty (penalty_factor)"),
        ({"size": "0.25 mm"}, "slave facets wide from its rim to its middle"),
    ],
    ids=["as it should be", "soft", "coarse"],
)
def test_what_is_wrong_with_a_round_contact_is_said(tmp_path, changes, said):
    lines, _ = pressed(tmp_path, **changes)
    lines = [line for line in lines if "whose shape they cannot follow" not in line]
    assert len(lines) == (said is not None), lines
    if said is not None:
        assert said in lines[0]


def test_what_softness_does_under_a_force_is_said(tmp_path):
    """The cylinder's force is given: its pressures are too low, and the contact too wide."""
    platen = {"direction": "y", "force": [[0, 0], [1, 330.0]]}
    found, rows, peaks = [], [], []
    for factor in (0.3, 30.0):
        data = tomllib.loads(ROUND)
        data["contact"][0]["penalty_factor"] = factor
        data["boundary"][1] = {"surface": "top", "displacement": {"x": 0}, "platen": platen}
        run = run_case(Case.model_validate(data), tmp_path / "out", quiet=True, force=True)
        rows.append(run.rows[-1])
        peaks.append(np.max(run.model.problem.committed[0].nodal_pressure))
        warnings = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
        found.append([line for line in warnings if "penetration" in line])
    [line], none = found
    assert not none and "too small" not in line
    said = 0.01 * float(re.search(r"off by about ([\d.]+) % of their peak", line)[1])
    assert said == pytest.approx(1.0 - peaks[0] / peaks[1], rel=0.5)
    assert said < rows[0].contact_area / rows[1].contact_area - 1.0 < 2.2 * said


def comb(comm: MPI.Comm, directory: Path) -> tuple[list[str], float, float]:
    """What is said of the contact point by point."""
    lines, summary = pressed(directory, comm, pressure="pointwise")
    numbers = (summary[f"penetration_over_{what}"][0] for what in ("facet", "approach"))
    return lines, *numbers


@pytest.mark.mpi(comb, 2)
def test_a_comb_of_points_is_not_to_be_pressed_harder(tmp_path, on_ranks):
    """Its sagitta is h²/8R, all of it in the gap of facets of 50 um on a radius of 5 mm."""
    lines, *numbers = comb(MPI.COMM_SELF, tmp_path)
    [line] = lines
    assert 'use pressure = "averaged", or penalty_factor = 1 (now 30), or a finer slave' in line
    found = re.search(r"sagitta of the facets (\S+) m beside a penetration of (\S+) m", line)
    assert found is not None
    sagitta, penetration = map(float, found.groups())
    # The rubber bends too, and the outer points of a facet are within its ends.
    assert 0.5 < sagitta / (5e-5**2 / (8 * 5e-3)) < 1.1 and penetration < sagitta
    on_two, *theirs = on_ranks(comb, 2)
    assert on_two == lines and theirs == pytest.approx(numbers, rel=1e-6)


@pytest.mark.parametrize(
    ("size", "cure", "combed"),
    [
        ("100 um", {}, True),
        ("140 um", {}, True),
        ("140 um", {"smoothing_angle": "30 deg"}, False),
        ("50 um", {}, False),
    ],
)
def test_pressures_that_wave_over_corners_name_what_smooths_them(tmp_path, size, cure, combed):
    """Facets of the cylinder 2 or 2.8 times as long as the slave's, or smooth, or as short."""
    data = tomllib.loads(ROUND)
    data["geometry"]["contact_size"] = size
    del data["contact"][0]["smoothing_angle"]
    data["contact"][0] |= cure
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True)
    warnings = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
    found = [line for line in warnings if "combed pressures" in line]
    assert len(found) == combed
    if combed:
        assert "from vertex to vertex they are off a smooth curve by" in found[0]
        assert 'smooth the master (smoothing_angle = "30 deg")' in found[0]


def test_the_share_of_the_approach_is_the_error_of_the_force(block, tmp_path):
    """Of a block pressed by displacement, with a tenth and with ten times the default penalty."""
    force, share = [], []
    for factor in (3.0, 300.0):
        data = tomllib.loads(block)
        data["contact"][0]["penalty_factor"] = factor
        data["stage"] = data["stage"][:1]
        run = run_case(Case.model_validate(data), tmp_path / "out", quiet=True, force=True)
        summary = json.loads((tmp_path / "out" / "summary.json").read_text())
        force.append(run.rows[-1].normal_force)
        share += summary["penetration_over_approach"]
    assert 1.0 - force[0] / force[1] == pytest.approx(share[0] / (1.0 + share[0]), rel=0.1)
    assert share[1] == pytest.approx(0.01 * share[0], rel=0.1) and share[0] > 0.01


STRIP = """
bodies = { strip = { material = "neo-hookean", G = "0.5 MPa", K = "1.5 GPa" } }
tools.plate.shape = "plane"
tools.plate.point = ["0 mm", "2 mm"]
tools.plate.normal = [0, -1]
tools.plate.displacement = { y = [["0 s", "0 mm"], ["1 s", "-2 um"]] }
contact = [{ slave = "strip_top", master = "plate", friction = { law = "coulomb", mu = 5.0 } }]
boundary = [{ surface = "strip_bottom", displacement = { x = 0, y = 0 } }]
stage = [{ name = "press", duration = "1 s", steps = 1 }]
output = { figures = false }
[geometry]
kind = "blocks"
blocks = { strip = { x = ["-6 mm", "6 mm"], y = ["0 mm", "2 mm"], elements = [24, 8] } }
"""


def test_what_sticks_softly_between_plates_is_said(tmp_path):
    """Rubber that cannot go sideways: nothing slips, and elastic slip takes 6 % of the force."""
    force, found = [], []
    for factor in (1.0, 100.0):
        data = tomllib.loads(STRIP)
        data["contact"][0]["friction"]["K_T"] = factor * 10.0 * 0.5e6 / 0.5e-3
        run = run_case(Case.model_validate(data), tmp_path / "out", quiet=True, force=True)
        summary = json.loads((tmp_path / "out" / "summary.json").read_text())
        force.append(run.rows[-1].normal_force)
        found.append([line for line in summary["warnings"] if "what sticks gives way" in line])
    [line], none = found
    assert line.startswith("contact.0: ") and "raise K_T" in line and not none
    said = float(re.search(r"up to ([\d.]+) % too small", line)[1])
    assert said == pytest.approx(100.0 * (1.0 - force[0] / force[1]), rel=0.15)


BETWEEN_TOOLS = """
geometry.kind = "blocks"
geometry.blocks.low = { x = [0, 4e-3], y = [0, 1e-3], elements = [8, 2] }
geometry.blocks.high = { x = [0, 3e-3], y = [1e-3, 2e-3], elements = [9, 2] }
bodies.low = { material = "neo-hookean", E = "1 MPa", nu = 0.3, density = 1e3 }
bodies.high = { material = "neo-hookean", E = "1 MPa", nu = 0.3, density = 1e3 }
tools.bed = { shape = "plane", point = [0, 0], normal = [0, 1] }
tools.lid.displacement.y = [[0, 0], [1, -1e-4]]
tools.lid.normal = [0, -1]
tools.lid.point = [0, 2e-3]
tools.lid.shape = "plane"
contact = [
    { slave = "low_bottom", master = "bed", friction = { law = "coulomb", mu = 0.3 } },
    { slave = "high_bottom", master = "low_top", friction = { law = "coulomb", mu = 0.3 } },
    { slave = "high_top", master = "lid", friction = { law = "coulomb", mu = 0.3 } },
]
stage = [{ name = "press", duration = 1, steps = 2 }]
output = { fields_every = 0, figures = false }
gravity.y = -9.81
"""


def by_displacement(data):
    """The lid is moved as it is."""


def sprung(data):
    """The end of a stiff spring is moved instead."""
    spring = {"direction": "y", "stiffness": 1e9, "end": [[0, 0], [1, -1e-4]]}
    data["tools"]["lid"] |= {"displacement": {"x": 0}, "spring": spring}


@pytest.mark.parametrize("moved", [by_displacement, sprung])
def test_bodies_that_moved_tools_press_lose_force_though_nothing_else_holds_them(tmp_path, moved):
    force, found = [], []
    for factor in (5.0, 5000.0):
        data = tomllib.loads(BETWEEN_TOOLS)
        for pair in data["contact"]:
            pair["penalty_factor"] = factor
        moved(data)
        run = run_case(Case.model_validate(data), tmp_path / "out", quiet=True, force=True)
        summary = json.loads((tmp_path / "out" / "summary.json").read_text())
        force.append(run.rows[-1].normal_force)
        found.append([line for line in summary["warnings"] if "penetration" in line])
    assert len(found[0]) == 3 and not found[1]
    lost = 100.0 * (1.0 - force[0] / force[1])
    for line in found[0]:
        said = float(re.search(r"about ([\d.]+) % too small", line)[1])
        assert said == pytest.approx(lost, rel=0.15)


def rubbed(data):
    """A force, nearly as large as the normal one, drives the lid along what it presses on."""
    data["tools"]["lid"]["force"] = {"x": [[0, 0], [1, 120.0]]}
    for pair in data["contact"]:
        pair["friction"]["mu"] = 1.5


def explicitly(data):
    """In explicit steps, in which forces do not balance."""
    data["tools"]["lid"]["displacement"]["y"] = [[0, 0], [0.002, -1e-4]]
    data["stage"] = [{"name": "press", "duration": 0.002, "steps": 1}]
    data["solver"] = {"kind": "explicit", "damping": 2e4}


@pytest.mark.parametrize("moved", [rubbed, explicitly])
def test_what_moved_tools_press_loses_force_in_all_of_its_pairs(tmp_path, moved):
    data = tomllib.loads(BETWEEN_TOOLS)
    moved(data)
    for pair in data["contact"]:
        pair["penalty_factor"] = 5.0
    row = run_case(Case.model_validate(data), tmp_path / "out", quiet=True).rows[-1]
    assert moved is explicitly or abs(row.tangential_force) > 0.5 * row.normal_force
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    lines = [line for line in summary["warnings"] if "penetration" in line]
    shares = summary["penetration_over_approach"]
    assert len(lines) == 3 and min(shares) > 0.01
    for line, share in zip(lines, shares, strict=True):
        said = float(re.search(r"about ([\d.]+) % too small", line)[1])
        assert said == pytest.approx(100.0 * share / (1.0 + share), rel=0.05)


def by_force(data):
    """The lid is driven by a force that all three pairs carry."""
    data["tools"]["lid"] |= {"displacement": {"x": 0}, "force": {"y": [[0, 0], [1, -500.0]]}}


def by_weight(data):
    """The lower block lies on the bed by its weight, one of its corners held as drawn."""
    del data["tools"]["lid"], data["geometry"]["blocks"]["high"], data["bodies"]["high"]
    data["contact"] = data["contact"][:1]
    data["geometry"]["groups"] = {"corner": ["low_right", "low_bottom"]}
    data["geometry"]["blocks"]["low"] |= {"x": [0, 2e-2], "elements": [20, 2]}
    data["boundary"] = [{"surface": "corner", "displacement": {"y": 0}}]


def in_a_sleeve(data):
    """A tube is blown into a stiff sleeve, with axial symmetry: both are held in hoops."""
    rings = {"low": {"x": [10.5e-3, 11e-3]}, "high": {"x": [11e-3, 13e-3], "y": [0, 1e-3]}}
    for name, place in rings.items():
        data["geometry"]["blocks"][name] |= place
    data["geometry"]["section"] = "axisymmetric"
    data["bodies"]["high"]["E"] = "1 GPa"
    data["contact"] = [data["contact"][1] | {"slave": "low_right", "master": "high_left"}]
    ends = [f"{name}_{side}" for name in rings for side in ("bottom", "top")]
    data["boundary"] = [{"surface": end, "displacement": {"y": 0}} for end in ends]
    data["boundary"] += [{"surface": "low_left", "pressure": [[0, 0], [1, 1e5]]}]
    del data["tools"], data["gravity"]


def by_a_mandrel(data):
    """The tube is widened by a platen that keeps it round, under the same pressure."""
    in_a_sleeve(data)
    platen = {"direction": "x", "pressure": data["boundary"].pop()["pressure"]}
    data["boundary"] += [{"surface": "low_left", "platen": platen}]


def pressures(run):
    """Those at the vertices of each pair."""
    return [trial.nodal_pressure for trial in run.model.problem.committed]


@pytest.mark.parametrize("loaded", [by_force, by_weight, in_a_sleeve, by_a_mandrel])
def test_what_forces_or_weight_press_loses_none(tmp_path, loaded):
    """What is uneven is flattened, and that is said."""
    force, peaks, found = [], [], []
    for factor in (5.0, 5000.0):
        data = tomllib.loads(BETWEEN_TOOLS)
        loaded(data)
        for pair in data["contact"]:
            pair["penalty_factor"] = factor
        run = run_case(Case.model_validate(data), tmp_path / "out", quiet=True, force=True)
        summary = json.loads((tmp_path / "out" / "summary.json").read_text())
        force.append(run.rows[-1].normal_force)
        peaks.append(pressures(run))
        found.append([line for line in summary["warnings"] if "penetration" in line])
        if factor == 5.0:
            assert max(summary["penetration_over_approach"]) > 0.01
    assert force[0] == pytest.approx(force[1], rel=2e-3)
    assert not found[1] and not [line for line in found[0] if "too small" in line]
    said = {int(line[8]): re.search(r"off by about ([\d.]+) % of", line)[1] for line in found[0]}
    for index, (soft, hard) in enumerate(zip(*peaks, strict=True)):
        off = np.max(np.abs(soft - hard)) / np.max(hard)
        assert 0.2 < 100.0 * off / float(said[index]) < 2.0 if said else off < 0.02


def test_deep_penetration_under_a_force_costs_none_of_it(tmp_path):
    """A column of many facets: deep beside one of them, and next to nothing of the approach."""
    data = tomllib.loads(BETWEEN_TOOLS)
    by_force(data)
    del data["geometry"]["blocks"]["high"], data["bodies"]["high"]
    column = {"x": [0, 2e-4], "y": [0, 1e-3], "elements": [4, 20]}
    data["geometry"]["blocks"]["low"] = column
    data["tools"]["lid"] |= {"point": [0, 1e-3], "force": {"y": [[0, 0], [1, -60.0]]}}
    data["contact"] = [data["contact"][0], data["contact"][2] | {"slave": "low_top"}]
    for pair in data["contact"]:
        pair["penalty_factor"] = 5.0
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert max(summary["penetration_over_approach"]) < 0.01
    lines = [line for line in summary["warnings"] if "penetration" in line]
    assert lines and not [line for line in lines if "too small" in line]


def test_a_force_loses_none_in_explicit_steps(tmp_path):
    data = tomllib.loads(BETWEEN_TOOLS)
    explicitly(data)
    ramp = {"table": [[0, 0], [0.002, -100.0]], "ramp": "smooth"}
    data["tools"]["lid"] |= {"displacement": {"x": 0}, "force": {"y": ramp}, "mass": 1e-3}
    data["solver"]["damping"] = 5e3
    for pair in data["contact"]:
        pair["penalty_factor"] = 5.0
    row = run_case(Case.model_validate(data), tmp_path / "out", quiet=True).rows[-1]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert row.normal_force == pytest.approx(3 * 50.0, rel=0.05)  # the mean of three pairs
    assert min(summary["penetration_over_approach"]) > 0.01
    assert not [line for line in summary["warnings"] if "too small" in line]


def test_a_contact_pressed_by_force_loses_none(block, tmp_path):
    """The same block under a platen: it comes too close, and that is no fault of its forces."""
    data = tomllib.loads(block)
    data["contact"][0]["penalty_factor"] = 5.0
    data["stage"] = data["stage"][:1]
    data["boundary"][1] = {
        "surface": "top",
        "displacement": {"x": 0.0},
        "platen": {"direction": "y", "pressure": [[0.0, 0.0], [1.0, 0.3e6]]},
    }
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["penetration_over_approach"][0] > 0.01
    assert not [line for line in summary["warnings"] if "penetration" in line]


# A pad that hangs over the edge of a sheet, whose facets the edge is between.
OVER_AN_EDGE = """
geometry.kind = "blocks"
geometry.blocks.sheet = { x = ["0 mm", "2 mm"], y = ["0 mm", "0.5 mm"], elements = [8, 2] }
geometry.blocks.pad = { x = ["0 mm", "4 mm"], y = ["0.5 mm", "2.5 mm"], elements = [5, 3] }
bodies.sheet = { material = "neo-hookean", E = "1 GPa", nu = 0.3 }
bodies.pad = { material = "neo-hookean", E = "1 MPa", nu = 0.45 }
contact = [{ slave = "pad_bottom", master = "sheet_top", friction = { law = "frictionless" } }]
boundary = [
    { surface = "sheet_bottom", displacement = { x = 0, y = 0 } },
    { surface = "pad_left", displacement = { x = 0 } },
    { surface = "pad_top", displacement = { x = 0, y = [["0 s", "0 mm"], ["1 s", "-0.3 mm"]] } },
]
stage = [{ name = "press", duration = "1 s", steps = 3 }]
output = { fields_every = 0, figures = false }
"""


# Rubber blocks that are drawn .08 mm inside each other, .4 of a facet of the slave.
DRAWN_INSIDE = """
geometry.kind = "blocks"
geometry.blocks.low = { x = ["0 mm", "2 mm"], y = ["0 mm", "2 mm"], elements = [17, 3] }
geometry.blocks.high = { x = ["0 mm", "2 mm"], y = ["1.92 mm", "3.92 mm"], elements = [10, 3] }
bodies.low = { material = "neo-hookean", E = "1 MPa", nu = 0.3 }
bodies.high = { material = "neo-hookean", E = "1 MPa", nu = 0.3 }
boundary = [
    { surface = "low_bottom", displacement = { x = 0, y = 0 } },
    { surface = "high_top", displacement = { x = 0, y = 0 } },
]
stage = [{ name = "press", duration = "1 s", steps = 3 }]
[[contact]]
slave = "high_bottom"
master = "low_top"
interference = "drawn"
friction = { law = "frictionless" }
[output]
fields_every = 0
figures = false
"""


def test_an_overlap_that_is_still_drawn_is_no_sunk_edge(tmp_path):
    """Two thirds of it are left after the first step, and felt as none."""
    case = Case.model_validate(tomllib.loads(DRAWN_INSIDE))
    row = run_case(case, tmp_path / "out", quiet=True, comm=MPI.COMM_SELF).rows[-1]
    assert row.normal_force > 0.0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [line for line in summary["warnings"] if "sinks" in line] == []


@pytest.fixture(scope="module")
def over_an_edge(tmp_path_factory):
    """Runs the pad, and keeps what it is asked for again; yields its rows and warnings."""
    done = {}

    def run(swapped: bool = False):
        if swapped not in done:
            data = tomllib.loads(OVER_AN_EDGE)
            if swapped:
                data["contact"][0] |= {"slave": "sheet_top", "master": "pad_bottom"}
            directory = tmp_path_factory.mktemp("edge") / "out"
            simulation = run_case(
                Case.model_validate(data), directory, quiet=True, comm=MPI.COMM_SELF
            )
            summary = json.loads((directory / "summary.json").read_text())
            done[swapped] = simulation, [w for w in summary["warnings"] if "sinks" in w]
        return done[swapped]

    return run


def test_an_edge_that_sinks_between_vertices_is_warned_of(over_an_edge):
    """Depth by hand: the end of the sheet below the chord of the pad's facet over it."""
    simulation, [line] = over_an_edge()
    assert "contact.0: a vertex of the master, at (0.002, 0.0005) m, sinks up to" in line
    told, share = map(float, re.search(r"to (\S+) m into .*, (\S+) of its length", line).groups())
    problem = simulation.model.problem
    place = problem.space.tabulate_dof_coordinates()[:, :2]
    moved = place + problem.u.x.array.reshape(-1, 2)
    at = {tuple(p.round(9)): m for p, m in zip(place, moved, strict=True) if p[1] == 5e-4}
    pad = np.unique(problem.space.dofmap.list[simulation.model.named.cells("pad")])
    left, right = (
        moved[n]
        for x in (1.6e-3, 2.4e-3)
        for n in pad
        if np.allclose(place[n], (x, 5e-4), rtol=0, atol=1e-9)
    )
    corner = at[(0.002, 5e-4)]
    along = right - left
    length = np.linalg.norm(along)
    depth = ((corner - left) @ [-along[1], along[0]]) / length
    assert told == pytest.approx(depth, rel=6e-3)
    row = simulation.rows[-1]
    assert share == pytest.approx((depth - row.max_penetration) / length, rel=0.06)
    # What max_penetration tells of is a small part of it.
    assert depth > 5.0 * row.max_penetration


def test_an_edge_of_the_slave_meets_the_facets_with_its_points(over_an_edge):
    assert over_an_edge(swapped=True)[1] == []


def facets_of(comm, directory):
    """What is found of an edge on any number of ranks: in the plane, in space, on long facets."""
    from tests.solved import solved as run_data
    from tribox.app.simulation.surface_faults import SunkVertices

    found = []
    for depth in (None, 1e-3, 8e-3):
        data = tomllib.loads(OVER_AN_EDGE)
        del data["output"]
        data["stage"][0]["steps"] = 1
        if depth:
            for block in data["geometry"]["blocks"].values():
                block["z"] = [0, depth]
                block["elements"] = [block["elements"][0], 2, 1]
        for surface in data["boundary"]:
            surface["displacement"] |= {"z": 0} if depth and "y" in surface["displacement"] else {}
        simulation = run_data(data, comm)
        [term] = simulation.model.problem.contacts
        sunk = SunkVertices.of(term).deepest(term.surface.gather(simulation.stepper.x), 0.0)
        found.append([sunk.share, sunk.depth, *sunk.place])
    return found


@pytest.mark.mpi(facets_of, 2)
def test_the_edge_is_found_on_any_number_of_ranks(on_ranks):
    found = on_ranks(facets_of, 1)
    for one in found:
        assert one[2:4] == pytest.approx([2e-3, 5e-4]) and 0.05 < one[0] < 0.2
    for one, other in zip(on_ranks(facets_of, 2), found, strict=True):
        assert one[:4] == pytest.approx(other[:4], rel=1e-6)


# A plateau presses beside a ridge that is narrower than the facet above it, in whose middle it is.
BESIDE_A_RIDGE = """
geometry.kind = "blocks"
geometry.blocks.pad = { x = ["-2 mm", "2 mm"], y = ["0 mm", "2 mm"], elements = [5, 4] }
bodies.pad = { material = "neo-hookean", E = "1 MPa", nu = 0.3 }
contact = [{ slave = "pad_bottom", master = "die", friction = { law = "frictionless" } }]
boundary = [
    { surface = "pad_top", displacement = { x = 0, y = [["0 s", "0 mm"], ["1 s", "-0.1 mm"]] } },
]
stage = [{ name = "press", duration = "1 s", steps = 2 }]
output = { fields_every = 0, figures = false }
[tools.die]
shape = "polyline"
points = [
    ["-5 mm", "0 mm"], ["-1.3 mm", "0 mm"], ["-1.2 mm", "-0.2 mm"], ["0.7 mm", "-0.2 mm"],
    ["0.8 mm", "0 mm"], ["0.9 mm", "-0.2 mm"], ["5 mm", "-0.2 mm"],
]
"""


def test_a_ridge_in_a_facet_that_nothing_presses_on_is_warned_of(tmp_path):
    """The mean gaps beside it are open, and it goes in nearly as far as the pad goes down."""
    run_case(Case.model_validate(tomllib.loads(BESIDE_A_RIDGE)), tmp_path / "out", quiet=True)
    warnings = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
    [line] = [one for one in warnings if "deeper in the master" in one]
    told = re.search(r"at \(0\.0008, 0\) m as drawn, lies up to (\S+) m", line)
    assert told is not None and 0.07e-3 < float(told[1]) < 0.11e-3


def test_metal_that_passes_a_contact_may_be_pressed_too_hard(tmp_path):
    """As on a flattened roll, a soft contact is longer: the force is too large."""
    force, found = [], []
    for factor in (3.0, 60.0):
        data = tomllib.loads((CASES / "forming" / "strip-rolling.toml").read_text())
        data["geometry"]["blocks"]["strip"]["elements"] = [48, 2]
        data["contact"][0]["penalty_factor"] = factor
        data["stage"][0]["steps"] = 30
        data["stage"][1] |= {"duration": "0.5 s", "steps": 30}
        data["output"] = {"fields_every": 0, "figures": False}
        run = run_case(Case.model_validate(data), tmp_path / "out", quiet=True, force=True)
        force.append(np.mean([row.normal_force for row in run.rows[-15:]]))
        summary = json.loads((tmp_path / "out" / "summary.json").read_text())
        found.append([line for line in summary["warnings"] if "penetration" in line])
    [line], none = found
    assert not none and "as a body flows through the contact" in line
    said = float(re.search(r"may be about ([\d.]+) % too large, or too small", line)[1])
    assert 0.5 < said / (100.0 * (force[0] / force[1] - 1.0)) < 2.0


# Facets of 0.8 mm under a circle of 0.6 mm, which presses in the middle of one.
OVER_A_CIRCLE = """
geometry.kind = "blocks"
geometry.blocks.pad = { x = ["-2 mm", "2 mm"], y = ["0 mm", "2 mm"], elements = [5, 4] }
bodies.pad = { material = "neo-hookean", E = "1 MPa", nu = 0.3 }
tools.punch.shape = "circle"
tools.punch.centre = ["0 mm", "2.6 mm"]
tools.punch.radius = "0.6 mm"
tools.punch.displacement = { x = 0, y = [["0 s", "0 mm"], ["1 s", "-0.4 mm"]] }
contact = [{ slave = "pad_top", master = "punch", friction = { law = "frictionless" } }]
boundary = [{ surface = "pad_bottom", displacement = { x = 0, y = 0 } }]
stage = [{ name = "press", duration = "1 s", steps = 2 }]
output = { fields_every = 0, figures = false }
"""


def test_a_facet_that_cuts_into_a_circle_is_told_of_with_its_place(tmp_path):
    """Deepest by hand: the facet's middle below the lowest point of the circle."""
    case = Case.model_validate(tomllib.loads(OVER_A_CIRCLE))
    run = run_case(case, tmp_path / "out", quiet=True)
    warnings = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
    [line] = [one for one in warnings if "deeper in the master" in one]
    told = re.search(r"at \(0, 0\.002\) m as drawn, lies up to (\S+) m .*, (\S+) of its", line)
    space = run.model.problem.space
    place = space.tabulate_dof_coordinates()
    ends = np.isclose(place[:, 1], 2e-3) & (np.abs(place[:, 0]) < 5e-4)
    middle = 2e-3 + run.model.problem.u.x.array.reshape(-1, 2)[ends, 1].mean()
    depth = middle - 1.6e-3 - run.rows[-1].max_penetration
    assert told is not None and float(told[1]) == pytest.approx(depth, rel=0.01)
    assert float(told[2]) == pytest.approx(depth / 0.8e-3, rel=0.01)
    data = tomllib.loads(OVER_A_CIRCLE.replace("[5, 4]", "[29, 4]"))
    pressed = {"name": "press", "duration": "0.03 s", "steps": 1}
    data["stage"] = [pressed, pressed | {"name": "off", "release": ["punch"]}]  # the pad rises
    run_case(Case.model_validate(data), tmp_path / "off", quiet=True)
    assert "deeper in" not in (tmp_path / "off" / "summary.json").read_text()
