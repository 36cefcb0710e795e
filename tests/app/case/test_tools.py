"""The [tools.NAME] tables: what is read, and one line for each mistake."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI
from pydantic import ValidationError

from tests.tool_cases import block_case, block_mesh, case_of, circle, plane
from tribox.app.build.model import build_model
from tribox.app.build.tools import facets_of
from tribox.app.case.case import Case, resolved_toml
from tribox.app.case.tools import MeshTool
from tribox.app.case.validation import format_problem, problems_of
from tribox.app.errors import InputError

BLOCK = (Path(__file__).parents[3] / "cases" / "block-slide.toml").read_text()
ROUND = circle(displacement={"y": [["0 s", "0 m"], ["1 s", "-50 um"]]})
LINE = {"shape": "polyline", "points": [[0, 1], [1, 1], [1, 2]]}

HOLLOW = {
    "shape": "polyline",
    "points": [[-1, 1], [-1, 1e-3], [1e-3, 1e-3], [1e-3, 1]],
    "fillet_radius": 5e-5,
}
ABOVE = {"shape": "polyline", "points": [[-1, 1e-3], [1, 1e-3]]}  # from left to right


def mistakes(tools, contact=None, **more):
    """Lines on a case of two blocks with these tools; its contacts stay if none is given."""
    data = tomllib.loads(BLOCK) | {"tools": tools} | more
    if contact is not None:
        data["contact"] = [contact]
    try:
        Case.model_validate(data, context={"source": Path("cases/x.toml")})
    except ValidationError as error:
        return [format_problem(problem) for problem in problems_of(error, Case, data)]
    return []


def on_punch(**changed):
    return {"punch": ROUND | changed}


@pytest.mark.parametrize(
    ("tools", "line"),
    [
        (on_punch(radius="0 mm"), 'tools.punch.radius = "0 mm": must be > 0 m'),
        (on_punch(radius="3 s"), 'tools.punch.radius = "3 s": "s" has the wrong dimension'),
        (on_punch(radious=1), 'unknown key "radious" in tools.punch; did you mean "radius"?'),
        (on_punch(point=[0, 0]), 'key "point" in tools.punch does not go with shape = "circle"'),
        (on_punch(shape="cone"), 'tools.punch.shape = "cone": must be one of "plane", "circle"'),
        ({"punch": {"centre": [0, 0]}}, "tools.punch.shape: missing; one of"),
        (on_punch(centre=[0, 0, 0]), "tools.punch.centre = [0.0, 0.0, 0.0]: must have 2 comp"),
        (on_punch(shape="sphere"), 'tools.punch.shape = "sphere": is no shape in the plane'),
        (on_punch(inside="yes"), 'tools.punch.inside = "yes": must be true or false'),
        (on_punch(force={"y": "1 N"}), "tools.punch.force.y: displacement.y is given too"),
        (on_punch(velocity={"y": "1 m/s"}), "tools.punch.velocity.y: displacement.y is given too"),
        (on_punch(force={"z": "1 N"}), "tools.punch.force.z: there is no z in a mesh in the plane"),
        (on_punch(force={"x": "1 m"}), "tools.punch.force.x"),
        (on_punch(mass="1 kg"), "tools.punch.mass = 1.0: goes with force or spring only"),
        (on_punch(force={"x": 1}, mass="1 kg"),
         'tools.punch.mass = 1.0: goes with solver.kind = "'),
        (on_punch(displacement={"x": "driven"}), "tools.punch.displacement.x = "),
        (on_punch(stages=["pres"]), 'tools.punch.stages = "pres": no stage has this name; there'),
        (on_punch(stages=[]), "tools.punch.stages"),
        (on_punch(displacement_stages=["pres"], force={"y": 0}),
         'tools.punch.displacement_stages = "pres": no stage has this name; there'),
        (on_punch(displacement_stages=["press"]),
         "no component has both a force and a displacement or velocity; give the force"),
        (on_punch(spring={"direction": "y", "stiffness": 1, "end": 0}),
         "tools.punch.spring.y: displacement.y is given too"),
        (on_punch(spring={"direction": "x", "stiffness": 1, "end": 0, "mass": 1}),
         "tools.punch.spring.mass = 1.0: is that of a surface; give the tool its mass"),
        (on_punch(spring={"direction": "x", "stiffness": 1, "end": "driven"}),
         'tools.punch.spring.end = "driven": never moves: no stage has velocity'),
        (on_punch(hold_force=["y"]), 'hold_force = ["y"]: holds what displacement_stages end with'),
        (on_punch(displacement_stages=["press"], force={"y": 0}, hold_force=["x"]),
         'tools.punch.hold_force = ["x"]: neither displacement.x nor velocity is given'),
        (on_punch(stop={"y": 0}), "tools.punch.stop.y = 0.0: goes with force.y only: it is as far"),
        (on_punch(force={"x": [[0, -1], [1, 1]]}, stop={"x": 0}),
         "tools.punch.stop.x = 0.0: a stop is on one side, but force.x turns round"),
        (on_punch(force={"x": 0}, stop={"x": 0}), "force.x drives the tool nowhere"),
        (on_punch(force={"x": -1}, stop={"x": 1}), "the tool is beyond it before the force moves"),
        (on_punch(rotation={}),
         "tools.punch.rotation: give one of angle, rate, rim and moment, found n"),
        (on_punch(rotation={"angle": 1, "rate": 1}), "found angle and rate"),
        (on_punch(rotation={"rim": 1, "clockwise": True}), 'goes with rim = "driven" only'),
        (on_punch(rotation={"rim": 1, "centre": [0, 0]}), "with rim, a circle turns about its own"),
        ({"die": LINE | {"rotation": {"rim": 1, "centre": [0, 0]}}}, '"polyline" has no rim; give'),
        (on_punch(rotation={"rim": "driven"}), 'rotation.rim = "driven": never moves: no stage'),
        (on_punch(rotation={"angle": 1, "inertia": 1}), "inertia = 1.0: goes with moment only"),
        (on_punch(rotation={"rate": 1, "axis": "x"}), "the axis of a rotation in the plane is z"),
        (on_punch(rotation={"rate": 1, "centre": [0]}), "must have 2 coordinates in this mesh"),
        (on_punch(rotation={"rate": 1, "axis": "w"}), 'must be "x", "y" or "z", or components'),
        ({"top": ROUND}, "tools.top: a surface of the mesh has this name already"),
        ({"die": plane(normal=[0, 0])}, "tools.die.normal = [0, 0]: must not be zero"),
        ({"die": plane(normal="z")}, "tools.die.normal = [0.0, 0.0, 1.0]: must have 2 comp"),
        ({"die": plane(rotation={"rate": 1})}, "tools.die.rotation.centre: missing; a shape "),
        ({"die": LINE | {"fillet_radius": "-1 mm"}}, "tools.die.fillet_radius = "),
        ({"die": LINE | {"fillet_radius": [1, 2]}}, "must be one radius, or 1, one for each"),
        ({"die": LINE | {"points": [[0, 1]]}}, "tools.die.points"),
        ({"die": LINE | {"points": [[0, 0], [1, 1]], "closed": True}}, "needs three points"),
        ({"die": LINE | {"closed": True, "continued": [True, False]}}, "not go with a closed line"),
        ({"die": {"shape": "mesh", "file": "no.msh", "surface": "a"}}, "die.file"),
        ({"die": {"shape": "mesh", "surface": "a"}}, "tools.die.file: missing"),
    ],
)  # fmt: skip
def test_each_mistake_is_one_line(tools, line):
    found = mistakes(tools)
    assert len(found) == 1, found
    assert line in found[0]


@pytest.mark.parametrize(
    ("contact", "line"),
    [
        ({"slave": "top", "master": "pnch"},
         'contact.0.master = "pnch": no such surface or tool; d'),
        ({"slave": "punch", "master": "top"},
         'contact.0.slave = "punch": is a tool; a tool is the'),
        ({"slave": "top", "master": "punch", "smoothing_angle": "9 deg"},
         "tools are smooth as they are"),
    ],
)  # fmt: skip
def test_a_contact_names_a_tool_as_its_master(contact, line):
    found = mistakes(on_punch(), {"friction": {"law": "frictionless"}} | contact)
    assert len(found) == 1, found
    assert line in found[0]


def test_a_boundary_of_a_tool_is_told_where_its_motion_stands():
    boundary = [{"surface": name, "displacement": {"y": 0}} for name in ("bottom", "punch")]
    [line] = mistakes({"punch": ROUND}, boundary=boundary)
    assert line == 'boundary.1.surface = "punch": is a tool; what moves it stands in [tools.punch]'


@pytest.mark.parametrize(
    ("stages", "tools", "line"),
    [
        ([["idle"]], {"idle": ROUND}, "no boundary holds or moves a surface of this name, and no "),
        ([["press_on"]], {},
         'stage.1.release = "press_on": is the name of a surface and a contact'),
        ([["punch"], ["punch"]], {}, 'stage.2.release = "punch": is released in stage b already'),
        ([["pair"]], {"punch": ROUND | {"stages": ["b"]}},
         "does not act in stage a, the one before"),
    ],
)  # fmt: skip
def test_only_what_presses_is_released(stages, tools, line):
    stages = [[], *stages]
    names = [{"name": "abc"[k], "duration": 1, "release": r} for k, r in enumerate(stages)]
    boundary = [{"surface": "bottom", "displacement": {"x": 0, "y": 0}}]
    name = "pair"
    if stages == [[], ["press_on"]]:
        name, boundary = "press_on", [*boundary, {"surface": "press_on", "symmetry": True}]
    contact = {"name": name, "slave": "top", "master": "punch", "friction": {"law": "frictionless"}}
    data = block_case(Path("none.msh"), tools={"punch": ROUND} | tools, stage=names)
    data |= {"geometry": tomllib.loads(BLOCK)["geometry"], "contact": [contact]}
    data["boundary"] = boundary
    data["bodies"] = tomllib.loads(BLOCK)["bodies"]
    found = []
    try:
        Case.model_validate(data, context={"source": Path("cases/x.toml")})
    except ValidationError as error:
        found = [format_problem(problem) for problem in problems_of(error, Case, data)]
    assert any(line in one for one in found), found


def test_a_tool_that_grips_does_so_from_the_first_stage_on():
    tied = {"slave": "top", "master": "punch", "tied": True}
    data = tomllib.loads(BLOCK) | {"tools": on_punch(), "contact": [tied]}
    names = [stage["name"] for stage in data["stage"]]
    Case.model_validate(data)
    data["tools"]["punch"]["stages"] = names[:1]
    Case.model_validate(data)
    data["tools"]["punch"]["stages"] = names[1:]
    with pytest.raises(ValidationError, match=r"tools\.punch\.stages.*from the first stage on"):
        Case.model_validate(data)


def test_explicit_dynamics_needs_the_masses_of_what_loads_move():
    data = tomllib.loads(BLOCK)
    bodies = {name: body | {"density": 1000} for name, body in data["bodies"].items()}
    rolled = circle(force={"y": "1 N"}, rotation={"moment": 0}, stop={"y": 1})
    found = mistakes({"punch": rolled}, bodies=bodies, solver={"kind": "explicit"})
    assert [line.partition(":")[0] for line in found] == [
        "tools.punch.mass",
        "tools.punch.rotation.inertia",
        "tools.punch.stop",
    ]


def test_with_axial_symmetry_a_tool_moves_along_the_axis(tmp_path):
    mesh = block_mesh(tmp_path / "block.msh")
    geometry = {"mesh": str(mesh), "section": "axisymmetric"}
    turned = circle(displacement={"x": "1 mm"}, rotation={"rate": 1})
    data = block_case(mesh, geometry=geometry, tools={"punch": turned})
    data["boundary"] = [{"surface": "bottom", "displacement": {"y": 0}}]
    with pytest.raises(ValidationError) as caught:
        case_of(data)
    lines = [format_problem(p) for p in problems_of(caught.value, Case, data)]
    assert len(lines) == 2
    assert "tools.punch.displacement.x: a tool of revolution moves along the axis" in lines[0]
    assert "tools.punch.rotation: does not go with axial symmetry" in lines[1]


def test_what_tools_alone_hold_needs_no_boundary(tmp_path):
    data = block_case(block_mesh(tmp_path / "block.msh"), tools={"punch": ROUND})
    del data["boundary"]
    case = case_of(data)
    assert case.boundary == ()
    assert Case.model_validate(tomllib.loads(resolved_toml(case))) == case
    del data["tools"], data["contact"]
    with pytest.raises(ValidationError) as caught:
        case_of(data)
    lines = [format_problem(p) for p in problems_of(caught.value, Case, data)]
    assert lines == ["boundary: missing; nothing holds, moves or loads the bodies"]


def test_the_resolved_case_reads_back_to_the_same(tmp_path):
    mesh = block_mesh(tmp_path / "block.msh")
    tools = {
        "punch": circle(force={"y": [["0 s", "0 N"], ["1 s", "-1 N"]]}, rotation={"moment": 0}),
        "die": LINE | {"fillet_radius": ["1 mm"], "stages": ["press"]},
        "own": {"shape": "mesh", "file": str(mesh), "surface": "top", "scale": "mm"},
    }
    case = case_of(block_case(mesh, tools=tools))
    assert Case.model_validate(tomllib.loads(resolved_toml(case))) == case
    assert "tools" not in tomllib.loads(resolved_toml(Case.model_validate(tomllib.loads(BLOCK))))
    moved = resolved_toml(case, {mesh: "inputs/block.msh"})
    assert tomllib.loads(moved)["tools"]["own"]["file"] == "inputs/block.msh"


@pytest.mark.parametrize(
    ("tools", "line"),
    [
        ({"bottom": ROUND, "punch": ROUND}, "tools.bottom: a surface of the mesh has this name"),
        (on_punch(centre=[0, 0, 0]), "tools.punch.centre = [0.0, 0.0, 0.0]: must have 2"),
        (on_punch(centre=[2e-3, 2e-3]), "contact.0: top starts 0.001 m inside punch"),
        ({"punch": {"shape": "mesh", "file": "", "surface": "tpo"}}, "did you mean 'top'?"),
        ({"punch": plane(normal=[0, 1])}, "contact.0: top and punch face the same way"),
        ({"punch": plane(normal="y")}, "its normal points out of it, towards the body"),
        (on_punch(inside=True), "inside = true is for a body inside it"),
        (on_punch(centre=[2e-3, -3e-3], inside=True), "contact.0: top starts 0.0"),
        ({"punch": ABOVE}, "going along it, the body is on the left"),
        (
            {"punch": HOLLOW},
            "; move it off, unless punch is the wrong way round: going along it",
        ),
        (
            {"punch": {"shape": "mesh", "file": "", "surface": "top", "turned_over": True}},
            "turned_over = true turns it over",
        ),
    ],
)
def test_what_the_mesh_shows_is_one_line_too(tmp_path, tools, line):
    mesh = block_mesh(tmp_path / "block.msh")
    for tool in tools.values():
        if "file" in tool:
            tool["file"] = str(mesh)
    with pytest.raises(InputError) as caught:
        build_model(case_of(block_case(mesh, tools=tools)), MPI.COMM_SELF)
    assert len(caught.value.lines) == 1
    assert line in caught.value.lines[0]


def test_notes_name_tools_that_nothing_touches_and_facets_too_long(tmp_path):
    mesh = block_mesh(tmp_path / "block.msh")
    small = circle(5e-4, displacement={"y": [["0 s", "0 m"], ["1 s", "-1 um"]]})
    tools = {"punch": small, "idle": plane(point=[0, -1e-3], normal=[0, 1])}
    notes = build_model(case_of(block_case(mesh, tools=tools)), MPI.COMM_SELF).notes
    assert any(note.startswith("tools.idle: is in no contact") for note in notes)
    assert any("times as long as the smallest radius of punch" in note for note in notes)


@pytest.mark.parametrize(
    ("tool", "cells", "said"),
    [
        (circle(2e-4), (40, 8), False),  # fine in the middle only
        (circle(2e-4), (20, 8), True),
        (circle(2e-4, centre=[1e-4, 1.2e-3]), (40, 8), True),  # over the end of the block
        (plane(), (4, 2), False),
        (
            {
                "shape": "polyline",
                "points": [[5e-3, 1e-3], [2e-3, 1e-3], [2e-3, 3e-3]],
                "fillet_radius": 2e-4,
            },
            (20, 8),
            True,
        ),
    ],
)
def test_only_facets_near_a_tool_need_to_follow_it(tmp_path, tool, cells, said):
    mesh = block_mesh(tmp_path / "block.msh", cells, grading=2.0)
    notes = build_model(case_of(block_case(mesh, tools={"punch": tool})), MPI.COMM_SELF).notes
    assert any("times as long as the smallest radius of punch" in note for note in notes) is said


def test_facets_of_a_file_are_turned_over_and_scaled(tmp_path):
    mesh = block_mesh(tmp_path / "block.msh", (4, 2))
    table = MeshTool(shape="mesh", file=mesh, surface="top", scale="mm", turned_over=True)
    nodes, facets = facets_of(table, 2)
    plain = facets_of(table.model_copy(update={"turned_over": False}), 2)[1]
    np.testing.assert_array_equal(facets, plain[:, ::-1])
    used = nodes[np.unique(facets)]
    assert used[:, 0].max() == pytest.approx(4e-6) and np.ptp(used[:, 1]) == 0.0
