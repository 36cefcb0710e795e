"""The `[geometry]` table of any number of blocks."""

from __future__ import annotations

import re
import tomllib

import pytest
from pydantic import ValidationError

from tribox.app.case.case import Case, resolved_toml
from tribox.app.case.validation import format_problem, problems_of

CASE = """
[geometry]
kind = "blocks"
thickness = "10 mm"
[geometry.blocks.pad]
x = ["0 mm", "10 mm"]
y = ["1 mm", "6 mm"]
elements = [10, 5]
[geometry.blocks.strip]
x = ["0 mm", "20 mm"]
y = ["0 mm", "1 mm"]
size = "0.5 mm"
[bodies]
pad = { material = "neo-hookean", E = "5 MPa", nu = 0.45 }
strip = { material = "hencky", E = "70 GPa", nu = 0.33 }
[[contact]]
slave = "pad_bottom"
master = "strip_top"
friction = { law = "frictionless" }
[[boundary]]
surface = "strip_bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "pad_top"
displacement = { x = 0, y = [["0 s", "0 mm"], ["1 s", "-0.1 mm"]] }
[[stage]]
name = "press"
duration = "1 s"
steps = 1
"""


def test_it_reads_back_to_the_same_case():
    case = Case.model_validate(tomllib.loads(CASE))
    assert case.geometry.cell == "quadrilateral" and case.geometry.slab == pytest.approx(0.01)
    assert case.geometry.shape().cells() == 50 + 80
    assert Case.model_validate(tomllib.loads(resolved_toml(case))) == case


@pytest.mark.parametrize(
    ("blocks", "change", "said"),
    [
        ({"pad": {"z": [0, 1]}}, {}, "geometry.blocks.strip.z: missing: blocks are all"),
        ({"pad": {"x": [1, 0]}}, {}, "geometry.blocks.pad: x must go from a lower"),
        ({"pad": {"y": [0, 1]}}, {}, "geometry: pad and strip overlap; they may touch"),
        ({"pad": {"elements": [10]}}, {}, "geometry.blocks.pad: elements needs 2 numbers"),
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


def test_an_unknown_body_is_named_with_those_there_are():
    data = tomllib.loads(CASE)
    data["bodies"]["stripe"] = data["bodies"].pop("strip")
    with pytest.raises(ValidationError) as caught:
        Case.model_validate(data)
    assert "strip" in str(caught.value)


def test_corners_and_edges_are_groups_for_boundaries():
    """Held at one corner and along one edge, drawn at another: the reactions are there alone."""
    from tests.tool_cases import run

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
