"""The JSON schema of case files, and the documentation held against it."""

from __future__ import annotations

import importlib.util
import math
import re
import sys
import tomllib
from pathlib import Path

import pytest

from tribox.app.case.schema import json_schema

ROOT = Path(__file__).parents[3]

KEYS = ROOT / "docs" / "extensions" / "case_keys.py"


@pytest.fixture(scope="module")
def schema():
    return json_schema()


def test_schema_describes_every_key(schema):
    tables = {name: table for name, table in schema["$defs"].items() if "properties" in table}
    for table in (schema, *tables.values()):
        assert table["additionalProperties"] is False
        for key, field in table["properties"].items():
            assert field["description"], key
            assert "null" not in str(field)
    thinnest = tables["FrictionMap"]["properties"]["D_min"]
    length = {"$ref": "#/$defs/text_m"}
    assert thinnest["anyOf"] == [{"type": "number", "minimum": 0.0}, length]
    assert thinnest["description"] == "thickness up to which friction is purely Coulomb [m]"
    assert tables["FrictionMap"]["properties"]["transition_width"]["default"] == 0.03
    assert tables["FrictionMap"]["required"] == ["mu_s", "K_T"]


def mistakes(node, value, schema, place=()):
    """Places of the mistakes in a value, by as much of JSON schema as is used here."""
    for word in node:
        assert word in UNDERSTOOD or word in IGNORED, word
    if "$ref" in node:
        yield from mistakes(schema["$defs"][node["$ref"].split("/")[-1]], value, schema, place)
    for part in node.get("allOf", ()):
        yield from mistakes(part, value, schema, place)
    if "anyOf" in node and all(any(mistakes(n, value, schema)) for n in node["anyOf"]):
        yield place or "anyOf"
    if "not" in node and not any(mistakes(node["not"], value, schema)):
        yield place or "not"
    if "if" in node and not any(mistakes(node["if"], value, schema)):
        yield from mistakes(node["then"], value, schema, place)
    wrong = [
        not isinstance(value, KINDS[node.get("type", "any")]),
        isinstance(value, bool) and node.get("type") in ("number", "integer"),
        value not in node.get("enum", [value]),
        value != node.get("const", value),
        isinstance(value, str) and not re.search(node.get("pattern", ""), value),
        isinstance(value, str | list) and len(value) < node.get("minLength", 0),
        isinstance(value, str) and len(value) > node.get("maxLength", math.inf),
    ]
    if isinstance(value, int | float):
        wrong += [
            value < node.get("minimum", value),
            value > node.get("maximum", value),
            value <= node.get("exclusiveMinimum", -math.inf),
            value >= node.get("exclusiveMaximum", math.inf),
        ]
    if any(wrong):
        yield place or "value"
    if isinstance(value, list):
        if not node.get("minItems", 0) <= len(value) <= node.get("maxItems", math.inf):
            yield place or "items"
        columns = node.get("prefixItems", [])
        for index, item in enumerate(value):
            kind = columns[index] if index < len(columns) else node.get("items", {})
            yield from mistakes(kind, item, schema, (*place, index))
    if isinstance(value, dict):
        keys, others = node.get("properties", {}), node.get("additionalProperties", {})
        yield from ((*place, key) for key in node.get("required", ()) if key not in value)
        for key in value if "propertyNames" in node else ():
            yield from mistakes(node["propertyNames"], key, schema, (*place, key))
        for key, item in value.items():
            if key in keys:
                yield from mistakes(keys[key], item, schema, (*place, key))
            elif others is False:
                yield (*place, key)
            else:
                yield from mistakes(others, item, schema, (*place, key))


UNDERSTOOD = {
    *("$ref", "allOf", "anyOf", "not", "if", "then", "type", "enum", "const", "pattern"),
    *(
        "minLength",
        "maxLength",
        "minimum",
        "maximum",
        "exclusiveMinimum",
        "exclusiveMaximum",
        "minItems",
    ),
    *("maxItems", "items", "prefixItems", "properties", "additionalProperties", "required"),
    "propertyNames",
}
IGNORED = {
    *("$schema", "$defs", "title", "description", "default", "x-unit", "format"),
    "minProperties",
}
KINDS = {
    **{"any": object, "object": dict, "array": list, "string": str, "boolean": bool},
    **{"number": int | float, "integer": int},
}


@pytest.mark.parametrize("path", sorted((ROOT / "cases").glob("*.toml")), ids=lambda p: p.stem)
def test_shipped_cases_keep_to_the_schema(path, schema):
    assert list(mistakes(schema, tomllib.loads(path.read_text()), schema)) == []


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("mu = 0.2", "nu = 0.2", {"contact.0.friction.nu", "contact.0.friction.mu"}),
        ("mu = 0.2", "mu = -0.2", {"contact.0.friction.mu"}),
        ('law = "coulomb"', 'law = "coulomp"', {"contact.0.friction.law"}),
        ('law = "coulomb"', "", {"contact.0.friction.law"}),
        ('kind = "two-blocks"', "", {"geometry.kind"}),
        ('thickness = "1 mm"', 'thickness = "1"', {"geometry.thickness"}),
        ('width = "1.0 mm"', 'width = "mm"', {"geometry.upper.width"}),
        ('E = "5 MPa"', 'E = "five MPa"', {"bodies.elastomer.E"}),
        ('material = "neo-hookean"', 'material = "neo"', {"bodies.elastomer.material"}),
        ("steps = 3", "steps = 3.5", {"stage.0.steps"}),
        ('[["1 s", "0 mm"]', '[["1 s", "0"]', {"boundary.1.displacement.x"}),
        ('[["1 s", "0 mm"]', '[["1 s", 0, 0]', {"boundary.1.displacement.x"}),
    ],
)
def test_a_mistake_is_found_at_its_key(block, old, new, place, schema):
    assert list(mistakes(schema, tomllib.loads(block), schema)) == []
    found = mistakes(schema, tomllib.loads(block.replace(old, new, 1)), schema)
    assert {".".join(map(str, keys)) for keys in found} == place


def test_an_entry_of_the_library_needs_no_constants(block, schema):
    case = tomllib.loads(block)
    case["bodies"]["aluminium"] = {"material": "AA1050-O", "hardening": {"n": 0.3}}
    assert list(mistakes(schema, case, schema)) == []
    case["bodies"]["aluminium"] = {"material": "elastoplastic", "E": 7e10, "nu": 0.3}
    assert list(mistakes(schema, case, schema)) == [("bodies", "aluminium", "hardening")]
    case["bodies"]["aluminium"] = {"material": "AA1050-O", "C10": 1.0}
    assert list(mistakes(schema, case, schema)) == [("bodies", "aluminium", "C10")]


def test_a_preset_and_a_mesh_need_no_kind(block, film, schema):
    case = tomllib.loads(film.replace('law = "friction-map"\n', ""))
    assert case["contact"][0]["friction"]["preset"] == "friction-map"
    case["geometry"] = {"mesh": "my.msh"}
    assert list(mistakes(schema, case, schema)) == []
    case["geometry"]["section"] = "flat"
    assert list(mistakes(schema, case, schema)) == [("geometry", "section")]


@pytest.fixture(scope="module")
def listed(schema):
    """Rows of the list of keys, by table: the unit of each key."""
    spec = importlib.util.spec_from_file_location("case_keys", KEYS)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # which its dataclass looks itself up in
    spec.loader.exec_module(module)
    text = module.reference(schema)
    parts = re.findall(r"^\(keys-(\w+)\)=\n(.*?)(?=^\(keys-|\Z)", text, re.M | re.S)
    row = re.compile(r"^\| `(\w+)` \|.*\| ([^|]+) \| [^|]+ \|$", re.M)
    return {name: dict(row.findall(part)) for name, part in parts}


def test_the_list_of_keys_has_every_key_with_its_unit(schema, listed):
    tables = {"Case": schema}
    tables |= {name: table for name, table in schema["$defs"].items() if "properties" in table}
    tables = {n: table for n, table in tables.items() if not n.endswith("FromLibrary")}
    assert set(listed) == set(tables)
    for name, table in tables.items():
        assert set(listed[name]) == set(table["properties"]), name
        for key, field in table["properties"].items():
            if (unit := field.get("x-unit", field.get("items", {}).get("x-unit"))) is not None:
                assert listed[name][key] == ("–" if unit == "1" else unit.replace("*", "·")), key


def test_the_page_of_the_case_file_tells_of_every_table_and_has_the_list(schema):
    text = (ROOT / "docs" / "case-file.md").read_text()
    told = set(re.findall(r"^## `\[+(\w+)", text, re.M))
    assert told == set(schema["properties"]) - {"title"}
    assert text.count("<!-- tables of the schema -->") == 1
