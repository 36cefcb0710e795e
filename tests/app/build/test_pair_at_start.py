"""What is said of the surfaces of a contact once case and mesh are put together."""

import tomllib
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.build.model import build_model
from tribox.app.build.pair_at_start import PairAtStart
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.geometry.surfaces.facets import facet_shape

CASES = Path(__file__).parents[3] / "cases"


ROUND = """
[geometry]
kind = "cylinder-on-block"
contact_width = "1 mm"
contact_size = "{tool}"
growth = 1.4
cylinder = {{ radius = "{radius}" }}
block = {{ width = "12 mm", height = "4 mm", contact_size = "{block}" }}
[bodies.elastomer]
material = "hencky"
E = "70 GPa"
nu = 0.33
[bodies.aluminium]
material = "neo-hookean"
E = "5 MPa"
nu = 0.45
[[contact]]
slave = "aluminium_contact"
master = "elastomer_contact"
friction = {{ law = "frictionless" }}
[[boundary]]
surface = "bottom"
displacement = {{ x = 0, y = 0 }}
[[boundary]]
surface = "top"
displacement = {{ x = 0, y = "-0.01 mm" }}
[[stage]]
name = "press"
duration = "1 s"
"""


@pytest.mark.parametrize(
    ("tool", "block", "smoothing", "said"),
    [
        ("200 um", "25 um", None, "of up to 1.9 degrees, are up to 6.7 facets of the slave"),
        ("140 um", "50 um", None, "of up to 1.4 degrees, are up to 2.5 facets of the slave"),
        ("200 um", "25 um", "30 deg", None),
        ("80 um", "50 um", None, None),
    ],
)
def test_corners_of_a_round_tool_are_noted_where_the_slave_feels_them(tool, block, smoothing, said):
    data = tomllib.loads(ROUND.format(tool=tool, block=block, radius="5 mm"))
    if smoothing:
        data["contact"][0]["smoothing_angle"] = smoothing
    notes = [
        n for n in build_model(Case.model_validate(data), MPI.COMM_SELF).notes if "corner" in n
    ]
    assert len(notes) == (said is not None)
    for note in notes:
        assert said in note


@pytest.mark.parametrize(("fine_at", "ratio"), [(0.5, 1.0), (0.03, 20.0)])
def test_corners_count_by_the_slave_facets_that_reach_them(fine_at, ratio):
    """Chords of 1 m at 0.1 rad, slave facets of 1 m, and one of 0.05 m somewhere on a chord."""
    turned = np.cumsum(0.1 * np.arange(4))
    nodes = np.concatenate([[[0.0, 0.0]], np.cumsum(np.c_[np.cos(turned), -np.sin(turned)], 0)])
    facets = np.stack([np.arange(4), np.arange(1, 5)], axis=1).astype(np.int32)
    ones = partial(np.ones, 4)
    master = SimpleNamespace(facets=facets, position=nodes, sizes=ones, widths=ones)
    surface = SimpleNamespace(
        space=SimpleNamespace(mesh=SimpleNamespace(comm=MPI.COMM_SELF)),
        master=master,
        shape=facet_shape("interval", 1),
        slave=SimpleNamespace(facet_length=np.array([1.0, 0.05, 1.0])),
    )
    at = SimpleNamespace(
        facet=np.array([1, 1, 2]),
        xi=np.array([[0.2], [fine_at], [0.5]]),
        gap=np.zeros(3),
        on_surface=np.ones(3, dtype=bool),
    )
    found = PairAtStart("", SimpleNamespace(smoothing_angle=None), surface, at).corners(0.0)
    assert found.ratio == pytest.approx(ratio)


SWAPPED = (
    "geometry.contact_size=160 um",
    "geometry.growth=2",
    'geometry.block={radius="5 mm", height="5 mm"}',
    'bodies.elastomer={material="hencky", E="70 GPa", nu=0.33}',
    'bodies.aluminium={material="neo-hookean", E="5 MPa", nu=0.45}',
    'contact.0.slave="aluminium_contact"',
    'contact.0.master="elastomer_contact"',
)
MOVED = 'boundary=[{{surface="bottom", displacement={{y=0}}}}, {{surface="top", {0}}}]'
TURNED = MOVED.format('rotation={axis="z", angle=[["0 s", 0], ["1 s", 1]]}')
ASIDE = MOVED.format('displacement={y=0, z=[["0 s", 0], ["1 s", "1 mm"]]}')
DOWN = MOVED.format('displacement={y=[["0 s", 0], ["1 s", "1 mm"]]}')


@pytest.mark.parametrize(
    ("overrides", "cure"),
    [
        ([*SWAPPED, DOWN], None),
        ([*SWAPPED, TURNED], 'wave, and steps may fail; set smoothing_angle = "30 deg"'),
        ([*SWAPPED, ASIDE, 'geometry.cell="tetrahedron"'], "or draw elastomer_contact with short"),
        ([*SWAPPED, TURNED, 'contact.0.smoothing_angle="30 deg"'], None),
        (["geometry.contact_size=160 um", TURNED], None),
    ],
)
def test_a_slave_that_slides_over_a_round_master_in_space_is_noted(overrides, cure):
    """Not one that is pressed on it, nor a smooth master, nor a flat one."""
    case = load_case(CASES / "sphere-on-block.toml", overrides)
    notes = [n for n in build_model(case, MPI.COMM_SELF).notes if "which is round" in n]
    assert len(notes) == (cure is not None)
    for note in notes:
        assert note.startswith("contact.0: aluminium_contact slides on elastomer_contact")
        assert cure in note


ROUND_MASTER = (
    'contact.0.slave="aluminium_contact"',
    'contact.0.master="elastomer_contact"',
    "geometry.contact_size=150 um",
    "geometry.growth=2",
)
SLID = MOVED.format('displacement={y=0, x=[["0 s", 0], ["1 s", "1 mm"]]}')


@pytest.mark.parametrize(
    ("overrides", "noted"),
    [
        (["contact.0.interference=1 um", SLID], True),
        (["contact.0.interference=1 um", TURNED], True),
        (["contact.0.interference=1 um", DOWN], False),
        (["contact.0.interference=4 um", SLID], False),
        (["contact.0.interference=1 um", SLID, 'contact.0.smoothing_angle="30 deg"'], False),
        ([SLID], False),
    ],
)
def test_a_fit_that_slides_over_chords_of_its_size_is_noted(overrides, noted):
    """Facets of 150 um on a radius of 10 mm: arcs stand h²/8R = 0.28 um over them."""
    case = load_case(CASES / "hertz-line.toml", [*ROUND_MASTER, *overrides])
    notes = [n for n in build_model(case, MPI.COMM_SELF).notes if "over its chords" in n]
    assert len(notes) == noted
    for note in notes:
        height = float(note.split(" stand ")[1].split(" m ")[0])
        assert height == pytest.approx(0.281e-6, rel=0.02)


def crossed(bottom):
    """Two squares, one on the other, which begins at a height, m."""
    square = {"x": [0, 1], "elements": [4, 4]}
    data = tomllib.loads(ROUND.format(tool="1 mm", block="1 mm", radius="5 mm"))
    return data | {
        "geometry": {
            "kind": "blocks",
            "blocks": {"aluminium": square | {"y": [0, 1]}, "pad": square | {"y": [bottom, 2]}},
        },
        "bodies": {name: data["bodies"]["aluminium"] for name in ("aluminium", "pad")},
        "contact": [data["contact"][0] | {"slave": "pad_bottom", "master": "aluminium_top"}],
        "boundary": [{"surface": "aluminium_bottom", "displacement": {"x": 0, "y": 0}},
                     {"surface": "pad_top", "displacement": {"x": 0, "y": 0}}],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("bottom", "told", "angle"),
    [(1.0 - 1e-3, True, None), (1.0 - 1e-6, False, None), (1.0 - 1e-3, True, 0.5)],
)
def test_surfaces_that_press_as_they_are_drawn_are_told_of(bottom, told, angle):
    """Cells of second order, as against chords, are no way for a smooth master."""
    data = crossed(bottom)
    data["contact"][0]["smoothing_angle"] = angle
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    notes = [note for note in model.notes if "inside" in note]
    assert len(notes) == told
    for note in notes:
        assert note.startswith("contact.0: pad_bottom starts 0.001 m inside aluminium_top at (")
        assert ", 0.999) m and presses there at once" in note
        assert "chords" not in note


def test_a_graded_slave_counts_by_its_facets_beside_the_master():
    """A block that is meshed finely below a ball alone: K_T = 10 G/h, and no word of coarseness."""
    data = tomllib.loads(ROUND.format(tool="1 mm", block="1 mm", radius="5 mm"))
    data["geometry"] = {
        "kind": "sphere-on-block", "sphere": {"radius": 5e-3},
        "block": {"radius": 20e-3, "height": 10e-3},
        "contact_width": 1e-3, "contact_size": 1e-4, "growth": 1.5,
    }  # fmt: skip
    data["contact"][0]["friction"] = {"law": "coulomb", "mu": 0.3}
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    assert not [note for note in model.notes if "times as long as" in note]
    stick = model.case.contact[0].friction.K_T
    assert stick == pytest.approx(10.0 * 5e6 / (2.0 * 1.45) / 1e-4, rel=0.1)


@pytest.mark.parametrize(
    ("elements", "said"), [([1, 1, 8], "are 8 times as long"), ([8, 1, 1], None), ([4, 1, 1], None)]
)
def test_long_facets_across_those_of_the_master_are_noted(elements, said):
    """Strips on crossed strips, whose areas are alike, and on parallel ones; in space."""
    sizes = {"x": [0, 1], "z": [0, 1]}
    data = crossed(1.0)
    data["geometry"]["blocks"] = {
        "aluminium": sizes | {"y": [0, 1], "elements": elements},
        "pad": sizes | {"y": [1, 2], "elements": [8, 1, 1]},
    }
    notes = build_model(Case.model_validate(data), MPI.COMM_SELF).notes
    notes = [note for note in notes if "whose shape they cannot follow" in note]
    assert len(notes) == (said is not None)
    for note in notes:
        assert said in note and "in one direction" in note


def facing_notes(block, contacts, **tools):
    """What is said of contacts none of whose facets face each other."""
    data = tomllib.loads(block)
    given = data["contact"][0]
    data["contact"] = [given | contact for contact in contacts]
    data["tools"] = {name: tool | {"displacement": {}} for name, tool in tools.items()}
    notes = build_model(Case.model_validate(data), MPI.COMM_SELF).notes
    return [note for note in notes if "faces" in note]


def test_a_slave_across_its_master_is_noted(block):
    """A side of a block, and a flat below it; not where the face it ends at presses there too."""
    side = {"slave": "elastomer_left"}
    [note] = facing_notes(block, [side])
    assert note.startswith("contact.0: no facet of elastomer_left faces aluminium_contact: outward")
    assert "up to 90 degrees apart" in note
    assert not facing_notes(block, [{}, side])


@pytest.mark.parametrize(
    ("tool", "degrees"),
    [
        ({"shape": "plane", "point": ["0 mm", "-5 mm"], "normal": [0, 1]}, "90"),
        ({"shape": "plane", "point": ["-5 mm", "0 mm"], "normal": [1, 5]}, None),
        ({"shape": "plane", "point": ["-5 mm", "0 mm"], "normal": [1, 7]}, "98.1"),
        ({"shape": "polyline", "points": [["-5 mm", "-5 mm"], ["5 mm", "-5 mm"]]}, "90"),
        ({"shape": "polyline", "points": [["-5 mm", "5 mm"], ["-5 mm", "-5 mm"],
                                          ["5 mm", "-5 mm"]]}, None),
        ({"shape": "circle", "centre": ["0 mm", "-8 mm"], "radius": "2 mm"}, None),
    ],
)  # fmt: skip
def test_a_slave_across_a_tool_is_noted(block, tool, degrees):
    """Not where any part of the tool, however far, is opposed to it."""
    notes = facing_notes(block, [{"slave": "elastomer_left", "master": "die"}], die=tool)
    assert len(notes) == (degrees is not None)
    for note in notes:
        assert f"elastomer_left faces die: outward normals are up to {degrees} degrees" in note
