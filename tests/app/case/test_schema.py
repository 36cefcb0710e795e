"""The JSON schema of case files, and the documentation held against it."""

from __future__ import annotations

import re
from pathlib import Path

from app.case.schema import json_schema

ROOT = Path(__file__).parents[3]

DOCUMENTED = {
    "Top level": ("",),
    "`[geometry]`": (
        "BlocksGeometry",
        "CylinderOnBlockGeometry",
        "TwoCylindersGeometry",
        "BoxesGeometry",
        "SphereGeometry",
        "MeshGeometry",
    ),
    "`upper` and `lower`": ("BlockSize", "BoxSize"),
    "`sphere`": ("SphereSize",),
    "`block` under a sphere": ("RoundBlockSize",),
    "`cylinder` and the `upper` and `lower` of two cylinders": ("CylinderSize",),
    "`block`": ("FlatSize",),
    "`[bodies.NAME]`": ("NeoHookeanBody", "HenckyBody", "MooneyRivlinBody"),
    "`[bodies.NAME.velocity]`": ("BodyVelocity",),
    "`[[contact]]`": ("Contact",),
    "`[contact.film]`": ("Film",),
    "`[contact.friction]`": ("FrictionMap", "Coulomb", "Stribeck", "OwnLaw", "Frictionless"),
    "`[[boundary]]`": ("Boundary",),
    "`displacement` and `velocity`": ("Displacement", "Velocity"),
    "`platen`": ("Platen",),
    "`rotation`": ("Rotation",),
    "`spring`": ("Spring",),
    "`[[stage]]`": ("Stage",),
    "`[[probe]]`": ("Probe",),
    "`line`": ("ProbeLine",),
    "`[solver]`": ("Solver",),
    "`mass_scaling`": ("MassScaling",),
    "`[output]`": ("Output",),
    "`[sweep]`": ("Sweep",),
}


def test_schema_describes_every_key():
    schema = json_schema()
    assert set(schema["$defs"]) == {name for names in DOCUMENTED.values() for name in names} - {""}
    for table in (schema, *schema["$defs"].values()):
        assert table["additionalProperties"] is False
        for key, field in table["properties"].items():
            assert field["description"], key
            assert "null" not in str(field)
    thinnest = schema["$defs"]["FrictionMap"]["properties"]["D_min"]
    assert thinnest["anyOf"] == [{"type": "number", "minimum": 0.0}, {"type": "string"}]
    assert thinnest["description"] == "thickness up to which friction is purely Coulomb [m]"
    assert schema["$defs"]["FrictionMap"]["properties"]["transition_width"]["default"] == 0.03
    assert schema["$defs"]["FrictionMap"]["required"] == ["mu_s", "K_T"]


def test_documentation_lists_every_key_with_its_unit():
    text = (ROOT / "docs" / "case-file.md").read_text()
    sections = dict(re.findall(r"^###? (.+?)\n(.*?)(?=^##|\Z)", text, re.M | re.S))
    schema = json_schema()
    for heading, names in DOCUMENTED.items():
        rows = dict(re.findall(r"^\| `(\w+)` \| ([^|]+) \|", sections[heading], re.M))
        fields: dict[str, dict] = {}
        for name in names:
            fields |= (schema["$defs"][name] if name else schema)["properties"]
        assert set(rows) == set(fields), heading
        for key, field in fields.items():
            if (unit := field.get("x-unit", field.get("items", {}).get("x-unit"))) is not None:
                assert unit.replace("1", "–", unit == "1") in rows[key].split(" or "), key


def test_the_python_example_of_the_documentation(monkeypatch, capsys):
    text = (ROOT / "docs" / "case-file.md").read_text()
    [example] = re.findall(r"```python\n(.*?)```", text, re.S)
    monkeypatch.chdir(ROOT)
    exec(example, {})
    assert capsys.readouterr().out.startswith("0.3 17241")
