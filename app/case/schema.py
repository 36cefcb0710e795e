"""The JSON schema of a case file, with which editors complete and check one."""

from __future__ import annotations

from typing import Any

from app.case.case import Case


def json_schema() -> dict[str, Any]:
    """JSON schema of a case file, with unit and meaning in the description of each key."""
    schema = Case.model_json_schema()
    # A preset may supply these; only the program itself can tell.
    map_ = schema["$defs"]["FrictionMap"]
    map_["required"] = [key for key in map_["required"] if key in ("mu_s", "K_T")]
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    _tidy(schema)
    return schema


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
