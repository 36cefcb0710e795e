"""The materials library: entries of ``materials.toml`` as the keys of a `[bodies.NAME]` table.

`material = "AA1050-O"` in a case stands for the strain energy and the constants of that entry; keys
that are given beside it come first. The resolved case writes the numbers out.
"""

from __future__ import annotations

import copy
import difflib
import functools
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidatorFunctionWrapHandler

from tribox.app.case.table import Problem, problems_error
from tribox.app.errors import InputError
from tribox.forms.bodies.materials import ENERGIES

FILE = Path(__file__).with_name("materials.toml")
LAWS = ("neo-hookean", "hencky", *ENERGIES, "elastoplastic", "python")
"""What `material` may be besides an entry."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One material."""

    name: str  # such as "AA1050-O"
    about: str  # what it is, in a few words
    range: str  # where its numbers hold
    keys: dict[str, Any]  # of the `[bodies.NAME]` table, as a case file has them
    sources: dict[str, str]  # where each number is from, by dotted key
    # proof stress and tensile strength that a hardening curve was made from, as text with units;
    # empty where it was not
    strengths: dict[str, str]


@functools.cache
def entries() -> dict[str, Entry]:
    """All materials of the library, by name."""
    data = tomllib.loads(FILE.read_text(encoding="utf-8"))
    texts = data.pop("sources")
    return {
        name: Entry(
            name,
            table["about"],
            table["range"],
            table["keys"],
            {key: " ".join(texts[word] for word in words) for key, words in table["from"].items()},
            table.get("strengths", {}),
        )
        for name, table in data.items()
    }


def from_library(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
    """Validate a `[bodies.NAME]` table, with the keys of a library entry where it names one.

    Only the keys that stand in the table count as given, so that a sweep over the material, or
    over a key that the library has, leaves the others to the entry.
    """
    if not isinstance(value, Mapping):
        return handler(value)
    word, name = value.get("material"), value.get("library")
    if isinstance(word, str) and word not in LAWS:
        if word not in entries():
            raise problems_error([Problem(("material",), _unknown(word), word)])
        name = word
    if not isinstance(word, str | None) or not isinstance(name, str) or name not in entries():
        return handler(value)
    entry = entries()[name]
    law = entry.keys["material"]
    if word in LAWS and word != law:
        reason = f'is of material = "{law}", not "{word}"'
        raise problems_error([Problem(("library",), reason, name)])
    given = {**value, "material": law, "library": name}
    # The given keys, and those of the entry that they leave open
    base: dict[str, Any] = copy.deepcopy(dict(entry.keys))
    pairs = {"G", "K"}, {"E", "nu"}  # a pair of moduli that is given takes the other's place
    for moduli, others in (pairs, pairs[::-1]):
        if moduli & given.keys() and others <= base.keys() and not others & given.keys():
            for key in others:
                del base[key]
    for key, value in given.items():
        inner = base.get(key)
        if isinstance(inner, dict) and isinstance(value, Mapping):
            same = value.get("law", inner.get("law")) == inner.get("law")
            base[key] = {**inner, **value} if same else value
        else:
            base[key] = value
    body = handler(base)
    # Have a table and those in it know only the given keys as set
    body.__pydantic_fields_set__.intersection_update(given)
    for key, value in given.items():
        inner = getattr(body, key, None)
        if isinstance(inner, BaseModel) and isinstance(value, Mapping):
            inner.__pydantic_fields_set__.intersection_update(value)
    return body


def _unknown(word: str) -> str:
    """What may stand in the place of a material that is none."""
    names = [*LAWS, *entries()]
    folded = {name.lower(): name for name in names}
    near = difflib.get_close_matches(word.lower(), folded, n=3, cutoff=0.5)
    laws = ", ".join(f'"{law}"' for law in LAWS)
    if near:
        return "no such material; did you mean " + ", ".join(f'"{folded[n]}"' for n in near) + "?"
    return f"must be one of {laws}, or a name that `tribox materials` lists"


def listing() -> list[str]:
    """One line for each entry: name, what it is, where it holds."""
    width = max(map(len, entries()))
    laws = max(len(entry.keys["material"]) for entry in entries().values())
    return [
        f"{entry.name:{width}}  {entry.keys['material']:{laws}}  {entry.about}; {entry.range}"
        for entry in entries().values()
    ]


def description(name: str) -> list[str]:
    """Lines on one entry: each number with its source; InputError if there is none."""
    if name not in entries():
        raise InputError(f'materials "{name}": {_unknown(name)}')
    entry = entries()[name]
    lines = [f"{entry.name}: {entry.about}", f"  range: {entry.range}"]
    lines += [f"  {key.replace('_', ' ')}: {value}" for key, value in entry.strengths.items()]
    lines.append(f'  material = "{entry.keys["material"]}"')
    for key, source in entry.sources.items():
        value: Any = entry.keys
        for part in key.split("."):
            value = value[part]
        shown = f'"{value}"' if isinstance(value, str) else value
        lines.append(f"  {key} = {shown}: {source}")
    return lines
