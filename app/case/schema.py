"""The JSON schema of a case file, with which editors complete and check one."""

from __future__ import annotations

import copy
import re
from typing import Any

from tribox.app.case.case import Case
from tribox.app.case.library import entries

FILE_NAME = "tribox.schema.json"
_DEFS = "#/$defs/"
# Keys that say which of several tables is meant, where another key says it as well:
# {key: (the other key, what it means)}.
_IMPLIED = {"kind": ("mesh", "file"), "law": ("preset", "friction-map")}


def json_schema() -> dict[str, Any]:
    """JSON schema of a case file, with unit and meaning in the description of each key.

    Text with a unit has a pattern. Tables of several kinds are told apart by if and then, so that a
    mistake is found at its key and not at the whole table.
    """
    schema = Case.model_json_schema()
    # A preset may supply these; only the program itself can tell.
    map_ = schema["$defs"]["FrictionMap"]
    map_["required"] = [key for key in map_["required"] if key in ("mu_s", "K_T")]
    _add_library(schema)
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["description"] = "a case file of tribox"
    _tidy(schema)
    texts: dict[str, str] = {}
    _refine(schema, schema["$defs"], texts)
    schema["$defs"] |= {
        name: {"type": "string", "pattern": unit_pattern(unit)} for name, unit in texts.items()
    }
    return schema


def _add_library(schema: dict[str, Any]) -> None:
    """Let `material` be an entry of the library, where no key of its law is needed."""
    bodies = schema["properties"]["bodies"]["additionalProperties"]
    mapping = bodies["discriminator"]["mapping"]
    for name, entry in entries().items():
        law = mapping[entry.keys["material"]].removeprefix(_DEFS)
        of_library = f"{law}FromLibrary"
        if of_library not in schema["$defs"]:
            table = copy.deepcopy(schema["$defs"][law])
            del table["required"]
            table["properties"]["material"] = {"enum": [], "description": "entry of the library"}
            if "hardening" in table["properties"]:  # may be a part of the entry's
                described = table["properties"]["hardening"]["description"]
                table["properties"]["hardening"] = {"type": "object", "description": described}
            schema["$defs"][of_library] = table
        schema["$defs"][of_library]["properties"]["material"]["enum"].append(name)
        mapping[name] = _DEFS + of_library


def _tidy(node: Any) -> None:
    """Take out null, which TOML cannot say, and put units into descriptions."""
    if isinstance(node, list):
        for item in node:
            _tidy(item)
    if not isinstance(node, dict):
        return
    for item in node.values():
        _tidy(item)
    choices = [item for item in node.get("anyOf", []) if item != {"type": "null"}]
    if len(choices) == 1 and len(node["anyOf"]) == 2:
        del node["anyOf"]
        node.update({key: value for key, value in choices[0].items() if key not in node})
    elif choices:
        node["anyOf"] = choices
    if "default" in node and node["default"] is None:
        del node["default"]
    if isinstance(node.get("title"), str) and "$defs" not in node:
        del node["title"]  # Only the key's name once more.
    if "description" in node and node.get("x-unit", "1") != "1":
        node["description"] = f"{node['description']} [{node['x-unit']}]"


def _refine(node: Any, tables: dict[str, Any], texts: dict[str, str]) -> None:
    """Put references to patterns in the place of text with a unit, and conditions in unions."""
    for item in node.values() if isinstance(node, dict) else node:
        if isinstance(item, dict | list):
            _refine(item, tables, texts)
    if not isinstance(node, dict):
        return
    if node.get("type") == "string" and "x-unit" in node:
        # Name of the definition of text with this unit, such as "text_Pa_per_m"
        name = "text_" + re.sub(r"\W+", "_", node["x-unit"].replace("/", "_per_").replace("^", ""))
        texts[name] = "" if node["x-unit"] == "1" else node["x-unit"]
        node.clear()
        node["$ref"] = _DEFS + name
    if "discriminator" in node:
        del node["oneOf"]
        mark = node.pop("discriminator")
        node.update(_told_apart(mark["propertyName"], mark["mapping"], tables))


def _told_apart(mark: str, mapping: dict[str, str], tables: dict[str, Any]) -> dict[str, Any]:
    """Schema of a table that is of the kind that its key ``mark`` says.

    Its own list of keys, which allows anything, is for editors that complete.
    """
    keys: dict[str, Any] = {}
    for reference in mapping.values():
        for key, field in tables[reference.removeprefix(_DEFS)]["properties"].items():
            keys.setdefault(key, {"description": field.get("description", "")})
    keys[mark] = {"enum": list(mapping), "description": keys[mark]["description"]}
    conditions = [
        {
            "if": {"properties": {mark: {"const": kind}}, "required": [mark]},
            "then": {"$ref": reference},
        }
        for kind, reference in mapping.items()
    ]
    told: dict[str, Any] = {"type": "object", "properties": keys, "allOf": conditions}
    other, meant = _IMPLIED.get(mark, ("", ""))
    if meant not in mapping:
        return {**told, "required": [mark]}
    alone = {"required": [other], "not": {"required": [mark]}}
    conditions.append({"if": alone, "then": {"$ref": mapping[meant]}})
    conditions.append({"if": {"not": {"required": [other]}}, "then": {"required": [mark]}})
    return told


# -- Patterns of text such as "30 nm", by which an editor sees that a unit is missing --------------
#
# Of what kind a unit is the program tells: regular expressions cannot reckon with dimensions. No
# pattern refuses what the program accepts. Lookaheads are not used; some editors know none.

_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"


def unit_pattern(unit: str) -> str:
    """Regular expression (ECMAScript, Python, Rust) of a quantity in an SI unit, as text."""
    # Without a blank the unit does not begin with what could be part of the number.
    written = r"(?:\s+\S.*|[^\s0-9.eE+\-].*|[eE][^0-9+\-].*)"
    optional = "" if unit else "?"  # Text without a unit is no quantity that has one.
    return rf"^\s*{_NUMBER}{written}{optional}\s*$"
