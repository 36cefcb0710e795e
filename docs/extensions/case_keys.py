"""The reference of the case file: a table for each of its tables, from the program's own schema.

The line ``<!-- tables of the schema -->`` of a page is replaced by them when the site is built;
``./tribox python docs/extensions/case_keys.py`` prints them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tribox.app.case import json_schema

if TYPE_CHECKING:
    from sphinx.application import Sphinx

Node = Mapping[str, Any]
MARK = "<!-- tables of the schema -->"
_PROGRAM = "[program](#quantities-and-units)"
_ARGUMENTS = {"Pa": "pressure", "m": "film thickness", "1": "a plain number"}
_PLAIN = {"string": "text", "integer": "whole number", "boolean": "`true` or `false`"}


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill the page when it is read."""
    app.connect("source-read", _fill)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _fill(app: Sphinx, page: str, source: list[str]) -> None:
    if MARK in source[0]:
        source[0] = source[0].replace(MARK, reference(json_schema()))


@dataclass(frozen=True, slots=True)
class Section:
    """One table of the case file.

    Attributes:
        names: how it is written in a case, ``[contact.film]``, in each place where it may be.
        definition: its name in the schema.
        node: its part of the schema.
        level: how deep it lies in the case, from 0.
        inside: what tells the table around it from others, ``with kind = "file"``.
    """

    names: list[str]
    definition: str
    node: Node
    level: int
    inside: str = ""


def reference(schema: Node) -> str:
    """All tables in Markdown, those on top first, each followed by the ones inside it."""
    sections: dict[str, Section] = {}
    _collect(schema, "", schema, sections)
    top = Section(["The top of the file"], "Case", schema, 0)
    return "\n\n".join(_section(each, sections) for each in (top, *sections.values()))


# -- which tables there are -------------------------------------------------------------------


def _collect(
    node: Node, path: str, schema: Node, found: dict[str, Section], around: str = ""
) -> None:
    """Add the tables that the keys of a table hold, and those in them."""
    for key, value in node.get("properties", {}).items():
        for name, place, table in _tables(value, f"{path}{key}", schema):
            if name in found:
                if place not in found[name].names:
                    found[name].names.append(place)
                continue
            level = path.replace(".NAME", "").count(".")
            found[name] = Section([place], name, table, level, around)
            bare, _, kind = place.partition(" ")
            _collect(table, bare.strip("[]") + ".", schema, found, kind)


def _tables(value: Node, path: str, schema: Node) -> Iterator[tuple[str, str, Node]]:
    """(definition, how it is written, node) of the tables that a key may hold."""
    array = value.get("type") == "array" and "$ref" in value.get("items", {})
    if array:
        value = value["items"]
    elif isinstance(value.get("additionalProperties"), Mapping):
        value, path = value["additionalProperties"], f"{path}.NAME"
    place = f"[[{path}]]" if array else f"[{path}]"
    for kind, name in _kinds(value):
        yield name, place + kind, schema["$defs"][name]


def _kinds(value: Node) -> Iterator[tuple[str, str]]:
    """(what tells it from the others, definition) of the tables that a value may be."""
    if _is_table(value):
        yield "", _name(value["$ref"])
    seen = set()
    for condition in value.get("allOf", []):
        name = _name(condition["then"].get("$ref", ""))
        marks = condition["if"].get("properties", {})
        if name and marks and name not in seen and not name.endswith("FromLibrary"):
            seen.add(name)
            ((key, mark),) = marks.items()
            yield f' with {key} = "{mark["const"]}"', name


def _is_table(value: Node) -> bool:
    return "$ref" in value and not _name(value["$ref"]).startswith("text_")


def _name(ref: str) -> str:
    return ref.rpartition("/")[2]


# -- one table --------------------------------------------------------------------------------


def _section(section: Section, sections: Mapping[str, Section]) -> str:
    first, *others = section.names
    if [each.names[0] for each in sections.values()].count(first) > 1:
        first += f" {section.inside}"
    title = first if section.definition == "Case" else _written(first)
    lines = [f"(keys-{section.definition})=", f"{'#' * min(section.level + 3, 5)} {title}", ""]
    if section.definition != "Case":
        lines += [_sentence(section.node.get("description", "").split("\n\n")[0]), ""]
    if others:
        lines += ["The same keys: " + ", ".join(map(_written, others)) + ".", ""]
    lines += ["| Key | Meaning | Value | Unit | Default |", "|---|---|---|---|---|"]
    needed = section.node.get("required", [])
    keys = section.node["properties"].items()
    for key, value in sorted(keys, key=lambda item: "const" not in item[1]):
        lines.append(_row(key, value, key in needed, sections))
    return "\n".join(lines)


def _written(name: str) -> str:
    """``[geometry] with kind = "file"`` with its parts as code."""
    return " with ".join(f"`{part}`" for part in name.split(" with "))


def _sentence(text: str) -> str:
    if " = " not in text:  # a formula begins with its symbol
        text = text[:1].upper() + text[1:]
    return _plain(text if text.endswith(".") or not text else f"{text}.")


def _row(key: str, value: Node, needed: bool, sections: Mapping[str, Section]) -> str:
    unit = _unit(value)
    meaning = value.get("description", "").removesuffix(f" [{unit}]")
    unit = "–" if unit in ("", "1") else unit.replace("*", "·")
    default = "needed" if needed else _default(value)
    return f"| `{key}` | {_plain(meaning)} | {_value(value, sections)} | {unit} | {default} |"


def _unit(value: Node) -> str:
    """Unit of a value, or of the values in a list or table."""
    if "x-unit" in value:
        return str(value["x-unit"])
    inside = (*value.get("prefixItems", []), value.get("items"), value.get("additionalProperties"))
    return next((_unit(each) for each in inside if isinstance(each, Mapping)), "")


def _plain(text: str) -> str:
    """Text in which Markdown finds nothing to do."""
    return re.sub(r"([\\|*_\[\]<>$#~])", r"\\\1", text)


def _default(value: Node) -> str:
    default = value.get("default")
    if default is None:
        return "–"
    if _is_table(value):
        return "see its keys"
    if default in ([], {}):
        return "none"
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, float | int):
        return _number(default)
    if isinstance(default, list):
        return "`[" + ", ".join(_literal(item) for item in default) + "]`"
    return re.sub(r"^(\d+)\.0 (\w+)$", r"\1 \2", default) if "." in default else f'`"{default}"`'


def _literal(item: object) -> str:
    """As it is written in a case file."""
    return f'"{item}"' if isinstance(item, str) else str(item).lower()


def _number(value: float) -> str:
    """Whole numbers in full, with narrow spaces that do not break."""
    return f"{value:,}".replace(",", "\u202f") if isinstance(value, int) else f"{value:.4g}"


# -- what a key may hold ----------------------------------------------------------------------


def _value(value: Node, sections: Mapping[str, Section]) -> str:
    """What may be written behind the key, in words."""
    options = value.get("anyOf", [value])
    said = dict.fromkeys(_option(option, value, sections) for option in options)
    said.pop("", None)
    return ", or ".join(said) if "enum" in str(options) else " or ".join(said)


def _option(option: Node, value: Node, sections: Mapping[str, Section]) -> str:
    if links := _links(option, sections):
        return links
    if option.get("$ref", "").rpartition("/")[2].startswith("text_"):
        return ""  # the same quantity, as text
    if "const" in option:
        return f"`{_literal(option['const'])}`"
    if "enum" in option:
        return ", ".join(f"`{_literal(item)}`" for item in option["enum"])
    kind = option.get("type")
    if kind == "array":
        return _array(option, value, sections)
    if kind == "object":
        return _object(option, sections)
    if kind == "number":
        what = "number" if value.get("x-unit", "1") == "1" else "quantity"
        return what + _limits(option)
    if option.get("format") == "path":
        return "file"
    return _PLAIN.get(str(kind), "any value") + (_limits(option) if kind == "integer" else "")


def _links(option: Node, sections: Mapping[str, Section]) -> str:
    """Links to the tables that it may be, with what tells them apart."""
    names = [(kind, name) for kind, name in _kinds(option) if name in sections]
    if not names:
        return ""
    if names[0][0] == "":
        return f"[table](#keys-{names[0][1]})"
    kinds = [(kind.partition('"')[2].rstrip('"'), name) for kind, name in names]
    return "table: " + ", ".join(f"[{kind}](#keys-{name})" for kind, name in kinds)


def _object(option: Node, sections: Mapping[str, Section]) -> str:
    if set(option.get("properties", {})) == {"table", "ramp"}:
        return ""  # a program, said already
    inside = option.get("additionalProperties")
    if not isinstance(inside, Mapping):
        return "table of any values"
    if links := _links(inside, sections):
        return links.replace("table", "one table for each NAME", 1)
    return f"table, for each name {_article(_value(inside, sections))}"


def _array(option: Node, value: Node, sections: Mapping[str, Section]) -> str:
    if links := _links(option.get("items", {}), sections):
        return links.replace("table", "array of tables", 1)
    if "prefixItems" in option:
        inside = [_value(item, sections) for item in option["prefixItems"]]
        return f"{len(inside)} entries, each {_article(inside[0])}"
    items = option.get("items", {})
    if items.get("type") == "array" and "prefixItems" in items:
        inside = [_article(_value(item, sections)) for item in items["prefixItems"]]
        return f"list of rows of {' and '.join(inside)}"
    if items.get("type") == "array" and items.get("maxItems") == 2:
        return _rows(items, value)
    if items.get("type") == "array":
        return f"list of lists, each entry {_article(_value(items['items'], sections))}"
    return f"list, each {_article(_value(items, sections))}" if items else "list"


def _article(what: str) -> str:
    return f"a {what}" if what[:1].isalpha() and what != "text" else what


def _rows(items: Node, value: Node) -> str:
    """A table of pairs: over time a program, else over what the first column is."""
    texts = [_name(each.get("$ref", "")) for each in items["items"].get("anyOf", [])]
    units = [text.removeprefix("text_") for text in texts if text.startswith("text_")]
    if units[0] == "s":
        return _PROGRAM
    return f"rows over {_ARGUMENTS[units[0]]}"


def _limits(option: Node) -> str:
    low, high = option.get("minimum"), option.get("maximum")
    above, below = option.get("exclusiveMinimum"), option.get("exclusiveMaximum")
    said = [
        f"{sign} {_number(limit)}"
        for sign, limit in ((">", above), ("≥", low), ("<", below), ("≤", high))
        if limit is not None
    ]
    return (" " + ", ".join(said)) if said else ""


if __name__ == "__main__":
    print(reference(json_schema()))
