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
