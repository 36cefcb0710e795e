"""The case of a run as tables of keys, values and meanings; what was given is marked."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import Any

from pydantic import BaseModel

from tribox.app.case.case import Case
from tribox.app.figures.units import fitting

_TITLES = {"geometry": "Geometry", "solver": "Solver", "output": "Output", "sweep": "Sweep"}
_NAMED = {
    "contact": ("Contact", lambda table: f"{table['slave']} on {table['master']}"),
    "boundary": ("Boundary", lambda table: table["surface"]),
    "stage": ("Stage", lambda table: table["name"]),
    "probe": ("Probe", lambda table: table.get("name", "")),
}


_RAISED = {"^2": "²", "^3": "³", "*": " "}
_QUANTITY = re.compile(r"([+-]?[0-9.]+(?:[eE][+-]?[0-9]+)?)(?: (.*))?")


@dataclass(frozen=True, slots=True)
class Input:
    """One key of a case.

    Attributes:
        key: within its table, such as "film.thickness"; value: with its unit.
        given: whether the case file gave it; meaning: what the key is.
    """

    key: str
    value: str
    given: bool
    meaning: str


@dataclass(frozen=True, slots=True)
class InputTable:
    """One table of a case: its title and its keys, those that were given first."""

    title: str
    inputs: Sequence[Input]

    @property
    def resolved(self) -> int:
        """Number of keys that were not given."""
        return sum(not one.given for one in self.inputs)


def input_tables(case: Case, given: Sequence[str] | None) -> list[InputTable]:
    """The tables of a case, in the order of a case file.

    Args:
        case: resolved, as it was run.
        given: dotted keys of what the case file gave; None: not known, all count as given.
    """
    known = None if given is None else frozenset(given)
    data = case.model_dump(mode="json", exclude_none=True, exclude={"title"})
    tables = []
    for name, value in data.items():
        for title, path, entries in _tables(name, value):
            found = [_input(case, path, key, entry, known) for key, entry in _flat(entries)]
            ordered = sorted(found, key=lambda one: not one.given)
            if ordered:
                tables.append(InputTable(title, ordered))
    return tables


def _tables(name: str, value: Any) -> Iterator[tuple[str, tuple[str | int, ...], Any]]:
    """(title, path, entries) of a key at the top of a case."""
    if name == "bodies":
        for body, entries in value.items():
            yield f"Body {body}", (name, body), entries
    elif name == "tools":
        for tool, entries in value.items():
            yield f"Tool {tool}", (name, tool), entries
    elif isinstance(value, list):
        word, called = _NAMED.get(name, (name, lambda table: table.get("name", "")))
        for index, entries in enumerate(value):
            yield f"{word} {index}: {called(entries)}".rstrip(": "), (name, index), entries
    else:
        yield _TITLES.get(name, name), (name,), value


def _flat(entries: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """(dotted key, value) of nested tables."""
    for key, value in entries.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value


def _input(
    case: Case, path: tuple[str | int, ...], key: str, value: Any, known: frozenset[str] | None
) -> Input:
    whole = ".".join(map(str, (*path, key)))
    given = known is None or whole in known
    return Input(key, value_text(value), given, _meaning(case, (*path, *key.split("."))))


def value_text(value: Any) -> str:
    """A value of a case as text: quantities readable, tables over time as pairs."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return "; ".join(" → ".join(map(value_text, row)) for row in value)
    if isinstance(value, list):
        return ", ".join(map(value_text, value))
    return readable(str(value))


def _meaning(case: Case, path: Sequence[str | int]) -> str:
    """The description of a key; empty where the case's tables do not know it."""
    here: Any = case
    meaning = ""
    for part in path:
        if isinstance(here, BaseModel):
            fields = type(here).model_fields
            name = next((n for n, f in fields.items() if part in (n, f.alias)), None)
            if name is None:
                return meaning
            meaning = fields[name].description or ""
            here = getattr(here, name)
        elif isinstance(here, Mapping):
            here = here.get(part)
        elif isinstance(here, Sequence) and isinstance(part, int):
            here = here[part]
        else:
            break
    return meaning


def readable(text: str) -> str:
    """A quantity as a resolved case holds it, such as "3e-08 m", exactly, but as "30 nm"."""
    match = _QUANTITY.fullmatch(text)
    if match is None:
        return text
    try:
        number = Decimal(match[1])
    except InvalidOperation:
        return text
    unit = match[2] or ""
    for old, new in _RAISED.items():
        unit = unit.replace(old, new)
    if not 0.1 <= abs(number) < 1000:
        fit = fitting([float(number)], unit)
        number, unit = number.scaleb(-fit.power), fit.name
    return f"{_plain(number)} {unit}".rstrip()


def _plain(number: Decimal) -> str:
    """A number without needless zeros; with a power of ten where it is long."""
    number = number.normalize()
    if number == 0 or -5 < number.adjusted() < 6:
        return f"{number:f}"
    return f"{number:e}".replace("e+", "e")
