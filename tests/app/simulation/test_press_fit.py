"""Press and shrink fits: Lamé's rings, the overlap drawn and not, energy and friction."""

import copy
import math
import re

import numpy as np
import pytest
from pydantic import ValidationError

from tests.app.checkpoint.going_on import as_killed, case_of, numbers, unlike
from tests.app.checkpoint.going_on import run as run_into
from tests.mesh_file import write_mesh
from tests.solved import built
from tests.solved import solved as run_in_memory
from tribox.app.case.case import Case
from tribox.app.errors import InputError

BORE, INNER, OUTER, HIGH = 10e-3, 5e-3, 15e-3, 2e-3  # m
OVERLAP, MU = 10e-6, 0.2
HUB, SHAFT = (70e9, 0.33), (210e9, 0.3)  # Pa, –
RINGS = {
    "geometry": {"kind": "blocks", "section": "axisymmetric",
     "blocks": {"hub": {"x": [BORE, OUTER], "y": [0, HIGH], "elements": [10, 4]},
     "shaft": {"x": [INNER, BORE], "y": [0, HIGH], "elements": [10, 5]}}},
    "bodies": {"hub": {"material": "neo-hookean", "E": HUB[0], "nu": HUB[1]},
     "shaft": {"material": "neo-hookean", "E": SHAFT[0], "nu": SHAFT[1]}},
    "contact": [{"slave": "hub_left", "master": "shaft_right", "interference": OVERLAP,
     "friction": {"law": "frictionless"}}],
    "boundary": [{"surface": f"{body}_{side}", "symmetry": True} for body in ("hub", "shaft")
     for side in ("bottom", "top")],
    "stage": [{"name": "fit", "duration": 1.0, "steps": 2}],
}  # fmt: skip


def lame() -> float:
    r"""Pressure, Pa, of two rings in plane strain, one larger than the other's bore by δ.

    .. math:: \frac{\delta}{p b} = \frac{1}{E_o'} \left(\frac{c^2 + b^2}{c^2 - b^2} + \nu_o'\right)
       + \frac{1}{E_i'} \left(\frac{b^2 + a^2}{b^2 - a^2} - \nu_i'\right), \quad
       E' = \frac{E}{1 - \nu^2}, \nu' = \frac{\nu}{1 - \nu}

    (Lamé 1852).
    """
    compliance = 0.0
    for (modulus, nu), (small, large), sign in (
        (HUB, (BORE, OUTER), 1.0),
        (SHAFT, (INNER, BORE), -1.0),
    ):
        squares = (large**2 + small**2) / (large**2 - small**2)
        compliance += (1.0 - nu**2) / modulus * (squares + sign * nu / (1.0 - nu))
    return OVERLAP / (BORE * compliance)


AREA = 2.0 * math.pi * BORE * HIGH  # m²


def changed(**contact):
    data = copy.deepcopy(RINGS)
    data["contact"][0].update(contact)
    return data


def drawn():
    data = changed(interference="drawn")
    data["geometry"]["blocks"]["shaft"]["x"] = [INNER, BORE + OVERLAP]
    return data


@pytest.mark.parametrize(
    "data",
    [
        RINGS,
        changed(slave="shaft_right", master="hub_left"),
        changed(pressure="pointwise"),
        changed(interference=[[0.0, 0.0], [0.3, 2 * OVERLAP], [1.0, OVERLAP]]),
        drawn(),
    ],
    ids=["offset", "swapped", "pointwise", "program", "drawn"],
)
def test_rings_press_as_lames_do(data):
    row = run_in_memory(data).state.rows[-1]
    assert row.normal_force == pytest.approx(lame() * AREA, rel=1e-3)
    # What shrinks does the work; ½ p δ A is what the rings store, whatever way led there.
    assert row.external_work == pytest.approx(0.5 * lame() * OVERLAP * AREA, rel=1e-3)
    assert abs(row.energy_error) < 1e-3 * row.external_work


@pytest.mark.parametrize("pressure", ["averaged", "pointwise"])
def test_a_fit_on_a_part_of_the_slave_does_the_work_of_that_part(pressure):
    """A shaft longer than the hub; facets that lie half below the hub, half beside it."""
    data = changed(slave="shaft_right", master="hub_left", pressure=pressure)
    data["geometry"]["blocks"]["shaft"] |= {"y": [-HIGH, 2 * HIGH], "elements": [10, 14]}
    rows = run_in_memory(data).state.rows
    assert abs(rows[-1].energy_error) < 1e-3 * rows[-1].external_work
    # twice the force, four times the work
    assert rows[-1].external_work == pytest.approx(4.0 * rows[0].external_work, rel=1e-2)


def test_a_clearance_has_to_be_closed_first():
    """Half of the pressure on the hub closes the gap, the other presses."""
    data = changed(interference=-1e-6)
    assert run_in_memory(data).state.rows[-1].normal_force == 0.0
    loads = {"surface": "hub_right", "pressure": [[0.0, 0.0], [1.0, "40 MPa"]]}
    forces = {}
    for clearance in (0.0, -1e-6):
        data = changed(interference=[[0.0, clearance]])
        data["boundary"].append(loads)
        forces[clearance] = run_in_memory(data).state.rows[-1].normal_force
    # Linear: the clearance takes what an overlap of its size gives.
    lost = forces[0.0] - forces[-1e-6]
    assert lost == pytest.approx(0.1 * lame() * AREA, rel=3e-3)


def pushed_out():
    data = changed(friction={"law": "coulomb", "mu": MU})
    way = {"y": [[1.0, 0.0], [2.0, "10 um"]]}
    data["boundary"][2:] = [
        {"surface": f"shaft_{side}", "displacement": way} for side in ("bottom", "top")
    ]
    data["stage"].append({"name": "push", "duration": 1.0, "steps": 4})
    return data


def test_a_fit_is_pushed_out_by_its_friction_and_goes_on_from_a_checkpoint(tmp_path):
    case = case_of(pushed_out())
    reference = tmp_path / "done"
    row = run_into(case, reference).state.rows[-1]
    assert row.friction_force == pytest.approx(MU * row.normal_force, rel=1e-6)
    assert row.normal_force == pytest.approx(lame() * AREA, rel=0.02)  # 0.5 % of the way has left
    written = numbers(reference)
    directory = as_killed(reference, tmp_path / "out", written[1])  # in the middle of the fit
    run_into(case, directory, resume=True)
    assert unlike(reference, directory) == []


def ring_mesh(path, around=144, layers=3, square=False):
    """A ring of quadrilaterals between the radii BORE and OUTER, as a gmsh file; or a frame."""
    turns = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    radii = np.linspace(BORE, OUTER, layers + 1)
    ways = [(math.cos(t), math.sin(t)) for t in turns]
    far = [max(abs(x), abs(y)) if square else 1.0 for x, y in ways]
    nodes = [(r * x / f, r * y / f) for r in radii for (x, y), f in zip(ways, far, strict=True)]

    def at(i, j):
        return 1 + i % around + around * j

    lines = [(1, at(i + 1, 0), at(i, 0)) for i in range(around)]
    lines += [(2, at(i, layers), at(i + 1, layers)) for i in range(around)]
    rows = [f"1 2 {tag} {tag} {i} {j}" for tag, i, j in lines]
    rows += [
        f"3 2 3 3 {at(i, j)} {at(i, j + 1)} {at(i + 1, j + 1)} {at(i + 1, j)}"
        for j in range(layers)
        for i in range(around)
    ]
    names = ['1 1 "bore"', '1 2 "outside"', '2 3 "ring"']
    return write_mesh(path, names, nodes, rows)


def test_a_rigid_shaft_carries_the_torque_of_its_friction(tmp_path):
    r"""A shaft in the plane turns in a ring that is held outside: :math:`M = \mu p\, 2\pi R^2`."""
    modulus, nu, larger = 10e6, 0.3, 50e-6
    shaft = {"shape": "circle", "centre": [0, 0], "radius": BORE}
    shaft["rotation"] = {"angle": [[1.0, 0.0], [2.0, 0.02]]}
    pair = {"slave": "bore", "master": "shaft", "interference": larger}
    data = {
        "geometry": {"mesh": str(ring_mesh(tmp_path / "ring.msh")), "thickness": HIGH},
        "bodies": {"ring": {"material": "neo-hookean", "E": modulus, "nu": nu}},
        "tools": {"shaft": shaft},
        "contact": [pair | {"friction": {"law": "coulomb", "mu": MU}}],
        "boundary": [{"surface": "outside", "displacement": {"x": 0, "y": 0}}],
        "stage": [
            {"name": "fit", "duration": 1.0, "steps": 2},
            {"name": "turn", "duration": 1.0, "steps": 2},
        ],
    }
    simulation = run_in_memory(data)
    [note] = [line for line in simulation.model.notes if "drawn beside each other" in line]
    assert "1.5e-06 m" in note or "1.6e-06 m" in note
    row, tools = simulation.state.rows[-1], simulation.state.tools
    moment = dict(zip(tools.columns, tools.rows[-1], strict=True))["moment_z"]
    assert abs(moment) == pytest.approx(MU * row.normal_force * BORE, rel=1e-2)
    # u = B/r - B r/c^2 in a ring that is held at c; p = B (2 (lambda + G)/c^2 + 2 G/b^2).
    shear, lam = modulus / 2 / (1 + nu), modulus * nu / (1 + nu) / (1 - 2 * nu)
    share = larger / (1 / BORE - BORE / OUTER**2)
    pressure = share * (2 * (lam + shear) / OUTER**2 + 2 * shear / BORE**2)
    # The chords of the bore reach into the shaft by 2/3 of their sagitta, 1.6 um, in the mean.
    assert row.normal_force == pytest.approx(pressure * AREA * (1.0 + 1.6 / 50.0), rel=0.015)


@pytest.mark.parametrize(
    ("slave", "clearance", "aside", "said"),
    [
        ("bore", 10e-6, 0.0, "of which chords take 16 %"),
        ("bore", 10e-6, 5e-6, "of which chords take 16 %"),
        ("outside", 10e-6, 0.0, "to which chords add 24 %"),
        ("bore", 100e-6, 0.0, None),
        ("bore", 0.0, 0.0, "fit but for 0 m, of which chords take 1.6e-06 m"),
    ],
)
def test_chords_that_change_a_clearance_are_noted(tmp_path, slave, clearance, aside, said):
    """A chord h stands h²/12R beside its arc in the mean, wherever in the play the tool is."""
    inside = slave == "outside"
    radius = OUTER + clearance if inside else BORE - clearance
    tool = {"shape": "circle", "centre": [aside, 0], "radius": radius, "inside": inside}
    other = "bore" if inside else "outside"
    data = {
        "geometry": {"mesh": str(ring_mesh(tmp_path / "ring.msh")), "thickness": HIGH},
        "bodies": {"ring": {"material": "neo-hookean", "E": 10e6, "nu": 0.3}},
        "tools": {"tool": tool},
        "contact": [{"slave": slave, "master": "tool", "friction": {"law": "frictionless"}}],
        "boundary": [{"surface": other, "displacement": {"x": 0, "y": 0}}],
        "stage": [{"name": "press", "duration": 1.0, "steps": 2}],
    }
    notes = [line for line in built(data).model.notes if "are round and fit but" in line]
    assert len(notes) == (said is not None)
    for note in notes:
        assert f"fit but for {clearance:.2g} m" in note and said in note


def sleeves_mesh(path, inner, outer):
    """Two sleeves in space, about a skew axis, drawn with so many chords, as a gmsh file."""
    nodes, rows = [], []
    axes = np.linalg.qr(np.array([[1.0, 2.0, 3.0], [0.3, 1.0, -1.0], [2.0, -1.0, 0.1]]))[0]
    for body, (around, radii) in enumerate(((inner, (INNER, BORE)), (outer, (BORE, OUTER)))):
        turns = 2.0 * np.pi * np.arange(around) / around + 0.05 * body
        first, layer = len(nodes) + 1, 2 * around
        nodes += [
            axes @ (r * math.cos(t), r * math.sin(t), z)
            for z in (0, HIGH)
            for r in radii
            for t in turns
        ]
        ring = 1 - body  # the outside of the inner one, the inside of the outer one
        for k in range(around):
            a, b = first + k, first + (k + 1) % around
            side = [n + ring * around for n in (a, b)]
            below = [a, b, b + around, a + around]
            side += [n + layer for n in side[::-1]]
            rows.append(f"3 2 {body + 1} {body + 1} {' '.join(map(str, side))}")
            corners = [*below, *(n + layer for n in below)]
            rows.append(f"5 2 {body + 3} {body + 3} {' '.join(map(str, corners))}")
    names = ['2 1 "outside"', '2 2 "inside"', '3 3 "inner"', '3 4 "outer"']
    return write_mesh(path, names, nodes, rows)


@pytest.mark.parametrize(
    ("inner", "outer", "smooth"), [(24, 34, False), (24, 34, True), (40, 30, True)]
)
def test_chords_of_sleeves_in_space_are_noted(tmp_path, inner, outer, smooth):
    """A smooth master has no chords, and lies beside those of the slave."""
    material = {"material": "neo-hookean", "E": 10e6, "nu": 0.3}
    contact = {"slave": "outside", "master": "inside", "friction": {"law": "frictionless"}}
    data = {
        "geometry": {"mesh": str(sleeves_mesh(tmp_path / "sleeves.msh", inner, outer))},
        "bodies": {"inner": material, "outer": material},
        "contact": [contact | ({"smoothing_angle": "30 deg"} if smooth else {})],
        "boundary": [{"surface": "outside", "pressure": [[0.0, 0.0], [1.0, 1e3]]}],
        "stage": [{"name": "press", "duration": 1.0, "steps": 2}],
    }
    [note] = [line for line in built(data).model.notes if "are round and fit but" in line]
    squares = [(2.0 * BORE * math.sin(math.pi / n)) ** 2 for n in (inner, outer)]
    off = (squares[0] - (0.0 if smooth else squares[1])) / (12.0 * BORE)
    word, size = re.search(r"which chords (\w+) ([-0-9.e]+) m:", note).groups()
    assert word == ("add" if off > 0.0 else "take")
    assert float(size) == pytest.approx(abs(off), rel=0.03)


def test_flats_that_fit_each_other_are_not_round(tmp_path):
    """A bar in a frame: with play all round, its gap is that of round parts."""
    half = BORE - 1e-5
    corners = [[-half, -half], [-half, half], [half, half], [half, -half], [-half, -half]]
    data = {
        "geometry": {"mesh": str(ring_mesh(tmp_path / "frame.msh", square=True))},
        "bodies": {"ring": {"material": "neo-hookean", "E": 10e6, "nu": 0.3}},
        "tools": {"bar": {"shape": "polyline", "points": corners}},
        "contact": [{"slave": "bore", "master": "bar", "friction": {"law": "frictionless"}}],
        "boundary": [{"surface": "outside", "displacement": {"x": 0, "y": 0}}],
        "stage": [{"name": "press", "duration": 1.0, "steps": 2}],
    }
    assert not [line for line in built(data).model.notes if "are round" in line]


def test_a_cord_that_touches_along_a_line_is_drawn_beside_its_plate():
    """As an O-ring in its groove; one that is drawn away from it is not."""

    def said(plate):
        data = {
            "geometry": {"kind": "cylinder-on-block", "contact_width": 2e-3, "contact_size": 1e-4,
             "cylinder": {"radius": 3e-3}, "block": {"width": 5e-3, "height": 1e-3}},
            "bodies": {name: {"material": "neo-hookean", "E": 5e6, "nu": 0.45}
             for name in ("elastomer", "aluminium")},
            "tools": {"plate": {"shape": "plane", "point": [0, plate], "normal": [0, 1]}},
            "contact": [{"slave": "elastomer_contact", "master": "plate", "interference": 1e-4,
             "friction": {"law": "frictionless"}}],
            "boundary": [{"surface": name, "displacement": {"x": 0, "y": 0}}
             for name in ("top", "bottom")],
            "stage": [{"name": "fit", "duration": 1.0, "steps": 2}],
        }  # fmt: skip
        notes = built(data).model.notes
        return [line for line in notes if "drawn beside each other" in line]

    assert said(0.0) == []
    [note] = said(-1e-5)
    # By hand: the first facet rises by h²/2R, in its mean by h²/4R = 0.8 um.
    assert "in the mean 1.1e-05 m apart, 11 % of the interference" in note


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"interference": "3 s"}, "interference"),
        ({"tied": True}, "does not go with tied"),
        ({"stages": ["later"]}, "let"),
    ],
)
def test_fits_that_make_no_sense_are_refused(change, said):
    data = drawn()
    data["contact"][0].update(change)
    if "tied" in change:
        del data["contact"][0]["friction"]
    data["stage"].append({"name": "later", "duration": 1.0})
    with pytest.raises(ValidationError, match=said):
        Case.model_validate(data)


def test_a_drawn_overlap_is_refused_without_the_key():
    data = drawn()
    del data["contact"][0]["interference"]
    with pytest.raises(InputError, match='interference = "drawn"'):
        run_in_memory(data)


def facts(comm, directory):
    """Forces and work of the fit; collective."""
    row = run_in_memory(RINGS, comm).state.rows[-1]
    return [row.normal_force, row.external_work, row.interface_energy]


@pytest.mark.mpi(facts, 2)
def test_ranks_agree(on_ranks):
    assert on_ranks(facts, 2) == pytest.approx(on_ranks(facts, 1), rel=1e-8)
