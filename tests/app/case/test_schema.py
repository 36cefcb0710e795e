"""The JSON schema of case files, and the documentation held against it."""

import importlib.util
import re
import sys
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from tribox.app.case.friction import TABLES
from tribox.app.case.schema import json_schema
from tribox.app.case.table import meanings
from tribox.app.case.tools import CylinderTool

ROOT = Path(__file__).parents[3]

KEYS = ROOT / "docs" / "extensions" / "case_keys.py"


@pytest.fixture(scope="module")
def schema():
    return json_schema()


def test_schema_describes_every_key(schema):
    Draft202012Validator.check_schema(schema)
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


def mistakes(schema, value):
    """Places of the mistakes in a value; a key that is missing or unknown is a place, too."""
    for error in Draft202012Validator(schema).iter_errors(value):
        place, given = tuple(error.absolute_path), error.instance
        if error.validator == "required":
            yield from ((*place, key) for key in error.validator_value if key not in given)
        elif error.validator == "additionalProperties":
            yield from ((*place, k) for k in given if k not in error.schema.get("properties", ()))
        else:
            yield place


@pytest.mark.parametrize("path", sorted((ROOT / "cases").glob("*.toml")), ids=lambda p: p.stem)
def test_shipped_cases_keep_to_the_schema(path, schema):
    assert list(mistakes(schema, tomllib.loads(path.read_text()))) == []


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
    assert list(mistakes(schema, tomllib.loads(block))) == []
    found = mistakes(schema, tomllib.loads(block.replace(old, new, 1)))
    assert {".".join(map(str, keys)) for keys in found} == place


def test_an_entry_of_the_library_needs_no_constants(block, schema):
    case = tomllib.loads(block)
    case["bodies"]["aluminium"] = {"material": "AA1050-O", "hardening": {"n": 0.3}}
    assert list(mistakes(schema, case)) == []
    case["bodies"]["aluminium"] = {"material": "elastoplastic", "E": 7e10, "nu": 0.3}
    assert list(mistakes(schema, case)) == [("bodies", "aluminium", "hardening")]
    case["bodies"]["aluminium"] = {"material": "AA1050-O", "C10": 1.0}
    assert list(mistakes(schema, case)) == [("bodies", "aluminium", "C10")]


def test_a_preset_and_a_mesh_need_no_kind(block, film, schema):
    case = tomllib.loads(film.replace('law = "friction-map"\n', ""))
    assert case["contact"][0]["friction"]["preset"] == "friction-map"
    case["geometry"] = {"mesh": "my.msh"}
    assert list(mistakes(schema, case)) == []
    case["geometry"]["section"] = "flat"
    assert list(mistakes(schema, case)) == [("geometry", "section")]


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


def test_what_keys_mean_stands_below_them_in_the_table_that_declares_them_last():
    assert meanings(CylinderTool)["centre"] == "a point [x, y, z] of its axis"  # not RoundTool's
    assert meanings(CylinderTool)["radius"] == "its radius"
    assert meanings(TABLES["coulomb"])["mu"]  # of a declaration, which has no source
