"""Case files of bodies in space and of revolution: defaults, round trips, and mistakes."""

import re
import tomllib
from pathlib import Path

import pytest
from pydantic import ValidationError

from tribox.app.case.bodies import formulations
from tribox.app.case.case import Case, resolved_toml
from tribox.app.case.reading import check_case, format_problem, load_case, problems_of

COMMON = """
[bodies]
elastomer = { material = "neo-hookean", E = "5 MPa", nu = 0.45 }
aluminium = { material = "hencky", E = "70 GPa", nu = 0.33 }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "coulomb", mu = 0.2 }
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "top"
displacement = { x = "driven" }
platen = { direction = "y", pressure = "1 MPa" }
[[stage]]
name = "slide"
duration = "1 s"
velocity = "1 mm/s"
"""
BOXES = """
[geometry]
kind = "two-boxes"
upper = { width = "1 mm", height = "0.5 mm", depth = "0.6 mm", elements = [4, 2, 3] }
lower = { width = "2 mm", height = "0.5 mm", depth = "1 mm", size = "0.25 mm" }
"""
RINGS = """
[geometry]
kind = "two-blocks"
section = "axisymmetric"
upper = { width = "1 mm", height = "0.5 mm", elements = [4, 2] }
lower = { width = "2 mm", height = "0.5 mm", elements = [4, 2] }
"""


SPHERE = """
[geometry]
kind = "sphere-on-block"
sphere = { radius = "10 mm" }
block = { radius = "8 mm", height = "5 mm" }
contact_width = "2 mm"
contact_size = "0.1 mm"
"""


@pytest.fixture
def boxes(tmp_path: Path) -> Path:
    path = tmp_path / "boxes.toml"
    path.write_text(BOXES + COMMON)
    return path


@pytest.fixture
def rings(tmp_path: Path) -> Path:
    path = tmp_path / "rings.toml"
    path.write_text(RINGS + COMMON)
    return path


def test_defaults_in_space(boxes):
    case = load_case(boxes)
    assert case.geometry.built_section == case.geometry.section_in(3) == "3D"
    assert case.geometry.offset == pytest.approx((0.5e-3, 0.2e-3))
    assert case.geometry.cell == "hexahedron" and case.geometry.slab == 1.0
    assert set(formulations(case.bodies, case.geometry.cell).values()) == {"q1-sri"}
    cut = load_case(boxes, ["geometry.cell=tetrahedron"])
    assert set(formulations(cut.bodies, cut.geometry.cell).values()) == {"q1"}
    one = load_case(boxes, ["bodies.elastomer.formulation=q2"])
    assert set(formulations(one.bodies, one.geometry.cell).values()) == {"q2"}


def test_defaults_of_revolution(rings):
    geometry = load_case(rings).geometry
    assert geometry.built_section == "axisymmetric" and geometry.offset == 0.0
    assert geometry.slab == 1.0
    slab = load_case(rings, ["geometry.section=plane-strain", "geometry.thickness=1 mm"]).geometry
    assert slab.built_section == "plane-strain" and slab.slab == 1e-3 and slab.offset == 5e-4


def test_parts_of_a_sphere_on_a_block(tmp_path):
    path = tmp_path / "sphere.toml"
    path.write_text(SPHERE + COMMON)
    still = 'boundary.1={ surface = "top", displacement = { x = 0, y = "driven" } }'
    whole = load_case(path, [still]).geometry
    assert (whole.cell, whole.built_section) == ("quadrilateral", "axisymmetric")
    held = 'boundary.0={ surface = "elastomer_symmetry_z", displacement = { z = 0 } }'
    half = load_case(path, [still, 'geometry.part="half"', held]).geometry
    assert (half.cell, half.built_section, half.extent) == ("hexahedron", "3D", 0.02)
    for part, said in (("full", "no such surface"), ("axisymmetric", "no such surface")):
        [line, *_] = check_case(path, [still, f"geometry.part={part}", held])
        assert said in line
    shape = half.shape()
    assert (shape.radius, shape.block_radius, shape.block_height) == (10e-3, 8e-3, 5e-3)


def test_direction_shares_the_drive(boxes):
    plain = load_case(boxes).boundary[1].displacement
    assert plain.driven_share("x") == 1.0
    table = '{ x = "driven", z = "driven", direction = [3, 0, -4] }'
    case = load_case(boxes, [f"boundary.1.displacement={table}"])
    moved = case.boundary[1].displacement
    assert (moved.driven_share("x"), moved.driven_share("z")) == pytest.approx((0.6, -0.8))
    assert case.boundary[1].driven_components() == ("x", "z")


SPACE = [
    ("geometry.thickness=1 mm", 'key "thickness" in geometry does not go with kind = "two-boxes"'),
    ("geometry.section=axisymmetric", 'key "section" in geometry does not go with'),
    ("geometry.cell=triangle", 'geometry.cell = "triangle": must be "hexahedron" or "tetrahedron"'),
    ("geometry.upper.elements=[4, 2]", "geometry.upper.elements.2: missing entry"),
    ("geometry.upper.size=1 mm", "geometry.upper: give either elements or size, not both"),
    ('geometry.offset=["0 mm", "2 mm"]', "geometry: offset = 0.002 m in z is not allowed"),
    ("boundary.0.surface=elastomer_frnt", 'did you mean "elastomer_front"?'),
    ("bodies.elastomer.formulation=q1-sri;geometry.cell=tetrahedron",
     'bodies.elastomer.formulation = "q1-sri": "q1-sri" needs quadrilaterals or hexahedra; '
     'use "q1" or "q2" for tetrahedra'),
    ("bodies.elastomer.formulation=q2;bodies.aluminium.formulation=q1",
     'bodies.aluminium.formulation = "q1": bodies.elastomer has "q2", and one displacement'),
    ("boundary.1.displacement.direction=[1, 0]",
     "boundary.1.displacement.direction = [1.0, 0.0]: must have 3 components in this mesh"),
    ("boundary.1.displacement.direction=[0, 0, 0]", "must not be zero in all components"),
    ("boundary.1.displacement.direction=[1, 0, 1]", 'z is not driven: give z = "driven", or 0'),
    ("boundary.0.displacement.direction=[1, 0, 0]", "says where driven components move, and none"),
    ("boundary.0.rotation.angle=1",
     'boundary.0.rotation: "bottom" is already moved in x by boundary.0.displacement.x'),
    ('boundary.0={ surface = "bottom", rotation = { angle = 1, centre = [0, 0] } }',
     "boundary.0.rotation.centre = [0.0, 0.0]: must have 3 coordinates in this mesh"),
    ('boundary.0={ surface = "bottom", rotation = { angle = "1 m" } }',
     'boundary.0.rotation.angle = "1 m": "m" has the wrong dimension'),
]  # fmt: skip
PLANE = [
    ("geometry.thickness=1 mm",
     "geometry.thickness = 0.001: goes with plane strain only: forces are those of the whole"),
    ("geometry.offset=-0.1 mm", "geometry.offset = -0.0001: must be >= 0 m: x is the distance"),
    ("geometry.section=spherical", 'must be "plane-strain" or "axisymmetric"'),
    ("boundary.0.displacement.z=0",
     "boundary.0.displacement.z: there is no z in a mesh in the plane"),
    ("boundary.1.platen.direction=z",
     "boundary.1.platen.direction: there is no z in a mesh in the plane"),
    ('boundary.0={ surface = "bottom", rotation = { angle = 1 } }',
     "boundary.0.rotation: does not go with axial symmetry"),
    ("geometry.section=plane-strain;boundary.0="
     '{ surface = "bottom", rotation = { angle = 1, axis = "x" } }',
     'boundary.0.rotation.axis = "x": the axis of a rotation in the plane is z'),
]  # fmt: skip


ROUND = [
    ("geometry.part=third", 'must be "axisymmetric", "quarter", "half" or "full"'),
    ("geometry.cell=hexahedron", "geometry: cell = 'hexahedron' is not allowed; choose from quad"),
    ("geometry.contact_width=1 cm", "geometry: contact_width = 0.01 m is not allowed; at most"),
    ("geometry.thickness=1 mm", 'does not go with kind = "sphere-on-block"'),
    ("boundary.1.displacement={ x = 0, z = 0 }", "there is no z in a mesh in the plane"),
]


@pytest.mark.parametrize(
    ("text", "overrides", "expected"),
    [(BOXES, *m) for m in SPACE] + [(RINGS, *m) for m in PLANE] + [(SPHERE, *m) for m in ROUND],
    ids=[m[0] for m in SPACE + PLANE + ROUND],
)
def test_a_mistake_gives_one_clear_line(text, overrides, expected, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(text + COMMON)
    lines = check_case(path, overrides.split(";"))
    assert len(lines) >= 1 and expected in lines[0], lines
    assert all("\n" not in line and "pydantic" not in line for line in lines)


# -- The `[geometry]` table of any number of blocks ------------------------------------------------

CASE = """
geometry.kind = "blocks"
geometry.thickness = "10 mm"
geometry.blocks.pad = { x = ["0 mm", "10 mm"], y = ["1 mm", "6 mm"], elements = [10, 5] }
geometry.blocks.strip = { x = ["0 mm", "20 mm"], y = ["0 mm", "1 mm"], size = "0.5 mm" }
bodies.pad = { material = "neo-hookean", E = "5 MPa", nu = 0.45 }
bodies.strip = { material = "hencky", E = "70 GPa", nu = 0.33 }
contact = [{ slave = "pad_bottom", master = "strip_top", friction = { law = "frictionless" } }]
boundary = [
    { surface = "strip_bottom", displacement = { x = 0, y = 0 } },
    { surface = "pad_top", displacement = { x = 0, y = [["0 s", "0 mm"], ["1 s", "-0.1 mm"]] } },
]
stage = [{ name = "press", duration = "1 s", steps = 1 }]
"""


@pytest.mark.parametrize(
    ("blocks", "change", "said"),
    [
        ({"pad": {"z": [0, 1]}}, {}, "geometry.blocks.strip.z: missing: blocks are all"),
        ({"pad": {"x": [1, 0]}}, {}, "geometry.blocks.pad: x must go from a lower"),
        ({"pad": {"y": [0, 1]}}, {}, "geometry: pad and strip overlap; they may touch"),
        ({"pad": {"elements": [10]}}, {}, "geometry.blocks.pad: elements needs 2 numbers"),
        ({}, {"thickness": 0}, r"geometry\.thickness = 0: must be > 0 m"),
        ({"pad": {"size": 1}}, {}, "geometry.blocks.pad: give either elements or size"),
        ({"pad": {"x": [-1, 1]}}, {"section": "axisymmetric"}, "geometry.blocks.pad.x.*>= 0 m"),
        ({}, {"section": "axisymmetric"}, "geometry.thickness.*goes with plane strain only"),
        ({}, {"cell": "hexahedron"}, "geometry: pad: a block in the plane does not go"),
        ({}, {"groups": {"a": ["pad_top"]}}, "geometry: group a: pad_top do not meet; give two"),
        ({}, {"groups": {"a": ["pad_top", "pad_bottom"]}}, "pad_top and pad_bottom do not meet"),
        ({}, {"groups": {"a": ["pad_top", "strip_left"]}}, "do not meet; give two sides of one"),
        ({}, {"groups": {"a": ["pad_tip", "pad_left"]}}, "group a: no such side: pad_tip; there"),
        ({}, {"groups": {"pad": ["pad_top", "pad_left"]}}, "geometry.groups.pad: is the name of"),
    ],
)
def test_mistakes_are_named(blocks, change, said):
    data = tomllib.loads(CASE)
    data["geometry"] |= change
    for name, keys in blocks.items():
        data["geometry"]["blocks"][name] |= keys
    with pytest.raises(ValidationError) as caught:
        Case.model_validate(data)
    lines = [format_problem(p) for p in problems_of(caught.value, Case, data)]
    assert any(re.search(said, line) for line in lines), lines


def test_corners_and_edges_are_groups_for_boundaries():
    """Held at one corner and along one edge, drawn at another: the reactions are there alone."""
    from tests.solved import solved as run

    block = {"x": [0, 2], "y": [0, 1], "z": [0, 1], "elements": [2, 1, 1]}
    soft = {"material": "neo-hookean", "E": 10, "nu": 0.3}
    groups = {
        "edge": ["bar_left", "bar_bottom"],
        "tip": ["bar_front", "bar_right", "bar_top"],
        "heel": ["bar_left", "bar_top", "bar_back"],
    }
    boundary = [
        {"surface": "edge", "displacement": {"x": 0, "y": 0, "z": 0}},
        {"surface": "heel", "displacement": {"x": 0}},
        {"surface": "tip", "force": {"x": 0.1}},
        {"surface": "bar_back", "displacement": {"z": 0}},
    ]
    for flat in (False, True):
        data = {
            "geometry": {"kind": "blocks", "blocks": {"bar": dict(block)}, "groups": dict(groups)},
            "bodies": {"bar": soft},
            "boundary": boundary[: 3 if flat else 4],
            "stage": [{"name": "pull", "duration": 1, "steps": 1}],
        }
        if flat:
            del data["geometry"]["blocks"]["bar"]["z"]
            data["geometry"]["blocks"]["bar"]["elements"] = [2, 1]
            data["geometry"]["groups"] = {
                name: [side for side in sides if side not in ("bar_front", "bar_back")]
                for name, sides in groups.items()
            }
            data["boundary"][0] = {"surface": "edge", "displacement": {"x": 0, "y": 0}}
        case = Case.model_validate(data)
        assert Case.model_validate(tomllib.loads(resolved_toml(case))) == case
        motion = run(data).state.motion
        held = [motion.of_surface(name, "force_x")[-1] for name in ("edge", "heel")]
        assert motion.of_surface("tip", "force_x")[-1] == pytest.approx(0.1)
        assert sum(held) == pytest.approx(-0.1, rel=1e-6)
        assert min(map(abs, held)) > 0.005


def test_a_group_has_no_area():
    data = tomllib.loads(CASE)
    data["geometry"]["groups"] = {"tip": ["strip_right", "strip_top"]}
    data["boundary"].append({"surface": "tip", "pressure": 1.0})
    with pytest.raises(ValidationError, match="is a group of points or edges, which have no area"):
        Case.model_validate(data)
    data["boundary"][-1] = {"surface": "tp", "displacement": {"x": 0}}
    with pytest.raises(ValidationError, match="no such surface"):
        Case.model_validate(data)
