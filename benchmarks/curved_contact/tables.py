"""Which rows are asked for, and tables of what was found, as text and as Markdown."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

Row = Mapping[str, Any]


def chosen(base: Any, axes: Mapping[str, Sequence[Any]], given: Mapping[str, str]) -> list[Any]:
    """The setups to be run: a product over given values, or each axis by itself from the base.

    ``given``: "value,value" by field; any field may be given.

    Raises:
        ValueError: there is no such field, or a value is of another kind than the base's.
    """
    if given:
        values = {
            name: [_read(base, name, v) for v in text.split(",")] for name, text in given.items()
        }
        return [
            replace(base, **dict(zip(values, some, strict=True)))
            for some in itertools.product(*values.values())
        ]
    out = [base]
    for name, some in axes.items():
        out += [s for value in some if (s := replace(base, **{name: value})) not in out]
    return out


def _read(base: Any, name: str, text: str) -> Any:
    present = getattr(base, name, None)
    if present is None:
        raise ValueError(f"no axis {name!r}; choose from {', '.join(base.__dataclass_fields__)}")
    if isinstance(present, bool):
        if text not in ("yes", "no"):
            raise ValueError(f"{name}: yes or no, found {text!r}")
        return text == "yes"
    return type(present)(text)


def cell(value: Any) -> str:
    """One entry of a table."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.5g}"
    return str(value)


def columns(rows: Sequence[Row]) -> list[str]:
    """Names of all columns, in the order in which they first stand."""
    return list(dict.fromkeys(name for row in rows for name in row))


def markdown(rows: Sequence[Row]) -> Iterator[str]:
    """Lines of a table."""
    names = columns(rows)
    yield "| " + " | ".join(name.replace("|", "/") for name in names) + " |"
    yield "|---" * len(names) + "|"
    for row in rows:
        yield "| " + " | ".join(cell(row.get(name, "")).replace("|", "/") for name in names) + " |"


def line(row: Row) -> str:
    """One row as text, each value beside its name: rows are printed as they come."""
    return "  ".join(f"{name} {cell(value)}" for name, value in row.items())
