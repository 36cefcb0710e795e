"""The JSON schema of a case file, with which editors complete and check one."""

from __future__ import annotations

import copy
import functools
import re
from collections import Counter, defaultdict
from collections.abc import Iterable
from decimal import Decimal
from typing import Any

from tribox.app.case.case import Case
from tribox.app.case.library import entries
from tribox.app.case.quantities import QuantityError, _registry, parse_quantity

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
    """Put references to patterns in the place of text with a unit, and conditions in unions.

    Args:
        node: part of the schema, changed in place.
        tables: definitions of the schema.
        texts: receives {definition: unit} of the patterns referred to.
    """
    for item in node.values() if isinstance(node, dict) else node:
        if isinstance(item, dict | list):
            _refine(item, tables, texts)
    if not isinstance(node, dict):
        return
    if node.get("type") == "string" and "x-unit" in node:
        name = text_name(node["x-unit"])
        texts[name] = "" if node["x-unit"] == "1" else node["x-unit"]
        node.clear()
        node["$ref"] = _DEFS + name
    if "discriminator" in node:
        del node["oneOf"]
        mark = node.pop("discriminator")
        node.update(_told_apart(mark["propertyName"], mark["mapping"], tables))


def text_name(unit: str) -> str:
    """Name of the definition of text with this unit, such as "text_Pa_per_m"."""
    return "text_" + re.sub(r"\W+", "_", unit.replace("/", "_per_").replace("^", ""))


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


# -- Patterns of text such as "30 nm", by which an editor sees a unit of the wrong kind ------------
#
# A unit that is one word is right if the unit library understands it as one of the right dimension:
# the pattern holds all these words, as `(prefixes)?(names)s?`. A unit of several words or with an
# operator ("N s/m^2", "mm²") passes unseen, as regular expressions cannot reckon with dimensions.
# No pattern refuses what the program accepts. Lookaheads are not used; some editors know none.

_LETTERS = "A-Za-z_µμ"
_WORD = re.compile(rf"[{_LETTERS}][0-9{_LETTERS}]*")
_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"

Ends = tuple[frozenset[str], frozenset[str]]
"""Prefixes with which a name is a unit, without and with a plural s."""


def unit_pattern(unit: str) -> str:
    """Regular expression (of ECMAScript, Python and Rust) of a quantity given as text.

    Args:
        unit: SI unit of the quantity, "" for a plain number.
    """
    c = f"0-9{_LETTERS}"
    more = rf"(?:[^\s{c}]|\s+\S).*"  # An operator, or another word.
    free = (
        rf"\s+(?:[^\s{c}]|[{c}]+{more}).*",
        rf"(?:[^\s{c}.,]|,[^0-9]).*",
        # Without a blank the unit does not begin with what could be part of the number.
        rf"[A-DF-Za-df-z_µμ][{c}]*{more}",
        rf"[eE][{_LETTERS}][{c}]*{more}",
        r"[eE](?:[^\s+\-" + c + r"]|\s+\S).*",
    )
    words = "|".join(_words(unit))
    known = [rf"\s*(?:{words})"] if words else []
    optional = "" if unit else "?"  # Text without a unit is no quantity that has one.
    return rf"^\s*{_NUMBER}(?:[eE][+-]?[0-9]+)?(?:{'|'.join((*known, *free))}){optional}\s*$"


def _words(unit: str) -> list[str]:
    """Alternatives that match the units of one word of this kind."""
    groups: dict[Ends, list[str]] = defaultdict(list)
    for name, ends in _units_like(unit).items():
        groups[ends].append(name)
    words = []
    for (single, plural), names in groups.items():
        stem = _either(names)
        if single == plural:
            words.append(f"{_either(single)}{stem}s?")
            continue
        words += [f"{_either(single)}{stem}"] if single else []
        words += [f"{_either(plural)}{stem}s"] if plural else []
    return words


def _either(words: Iterable[str]) -> str:
    """Pattern of one of these words; an empty one among them makes it optional."""
    listed = sorted(set(words) - {""})
    optional = "?" if "" in set(words) else ""
    return f"(?:{'|'.join(listed)}){optional}" if listed else ""


def _units_like(unit: str) -> dict[str, Ends]:
    """The names of the unit library of this unit's dimension, and what may stand around them."""
    dimension = _registry().parse_units(unit).dimensionality
    found = {}
    for name, of in _names().items():
        if of == dimension and _converts(name, unit):
            single, plural = (
                frozenset(p for p in _prefixes() if _is_read_as(p, name, end, dimension))
                for end in ("", "s")
            )
            found[name] = (single, plural)
    return found


def _converts(name: str, unit: str) -> bool:
    """Whether a unit is a multiple of this one: those of temperatures and levels are not."""
    try:
        parse_quantity(f"1 {name}", unit)
    except QuantityError:
        # A name that may be read in another way: with some prefixes it may do.
        return _readings()[name] > 1
    return True


def _is_read_as(prefix: str, name: str, end: str, dimension: object) -> bool:
    """Whether the library reads a word as a multiple of units of this dimension.

    "dB" could be a tenth of a byte, and is read as a level.
    """
    word = f"{prefix}{name}{end}"
    if _readings()[word] == 1:
        return True
    read = _library().parse_unit_name(word)[0][1]
    return bool(_names()[read] == dimension and _library()._units[read].is_multiplicative)


@functools.cache
def _library() -> Any:
    """A unit library that has read no text: what it has read before may be names to it later."""
    import pint

    return pint.UnitRegistry(non_int_type=Decimal)


@functools.cache
def _prefixes() -> tuple[str, ...]:
    """The library's prefixes, the empty one among them."""
    return tuple(_library()._prefixes)


@functools.cache
def _names() -> dict[str, object]:
    """Dimension of each name of one word in the unit library."""
    library = _library()
    return {
        name: library.Unit(definition.name).dimensionality
        for name, definition in list(library._units.items())
        if _WORD.fullmatch(name)
    }


@functools.cache
def _readings() -> Counter[str]:
    """In how many ways the words of the unit library can be read as prefix, name and plural."""
    return Counter(p + name + end for name in _names() for p in _prefixes() for end in ("", "s"))
