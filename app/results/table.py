"""A table of a results directory as columns of numbers and names, without a library for tables."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from io import StringIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.app.results.directory import TEXT_COLUMNS

Column = NDArray[Any]


class Table:
    """Columns of one length by name, in the order of the file.

    Attributes:
        columns: (n,) each, SI: names are text (of Python), all else floats.
    """

    __slots__ = ("columns",)

    def __init__(self, columns: Mapping[str, Column] | None = None) -> None:
        """Take the columns as they are; without any the table is empty."""
        self.columns: dict[str, Column] = dict(columns or {})

    @classmethod
    def from_csv(cls, text: str) -> Table:
        """The table in a text.

        Raises:
            ValueError: it is none, lines differ in length, or a number is none.
        """
        try:
            header, *rows = [
                row for row in csv.reader(StringIO(text, newline=""), strict=True) if row
            ] or [[]]
        except csv.Error as error:
            raise ValueError(str(error)) from None
        if not header or len(set(header)) < len(header):
            raise ValueError("no header, or a name twice")
        if any(len(row) != len(header) for row in rows):
            raise ValueError("lines of different lengths")
        found = zip(*rows, strict=True) if rows else [()] * len(header)
        return cls({k: column_of(k, v) for k, v in zip(header, found, strict=True)})

    @classmethod
    def from_records(cls, records: Sequence[Mapping[str, Any]]) -> Table:
        """The table whose rows are given by name.

        Raises:
            ValueError: rows differ in their names, or a number is none.
        """
        names = list(records[0]) if records else []
        if any(record.keys() != records[0].keys() for record in records):
            raise ValueError("rows of different columns")
        return cls({name: column_of(name, [r[name] for r in records]) for name in names})

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> Column:
        """A column (n,)."""
        return self.columns[name]

    def rows(self, which: Column | slice) -> Table:
        """Some of the rows.

        ``which``: their numbers (k,), or (n,) whether a row is one of them.
        """
        return Table({name: values[which] for name, values in self.columns.items()})

    def where(self, name: str, *values: object) -> Table:
        """The rows that have one of these values in a column."""
        return self.rows(np.isin(self.columns[name], np.array(values)))

    def parts(self, name: str) -> Iterator[tuple[Any, Table]]:
        """Each value of a column, in the order of its first row, with its rows."""
        for value in dict.fromkeys(self.columns[name].tolist()):
            yield value, self.rows(self.columns[name] == value)

    def records(self) -> list[dict[str, Any]]:
        """Each row by name, in Python's own numbers."""
        rows = zip(*(values.tolist() for values in self.columns.values()), strict=True)
        return [dict(zip(self.columns, row, strict=True)) for row in rows]


def column_of(name: str, values: Iterable[Any]) -> Column:
    """A column (n,) of a table: text where its name says so, else floats.

    What was swept (``value``) is text where it is no number.

    Raises:
        ValueError: a number is missing or is none.
    """
    found = list(values)
    if None in found:
        raise ValueError(f"{name} is missing")
    if name not in TEXT_COLUMNS:
        try:
            numbers = np.array(found, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            numbers = np.empty((0, 0))
        if numbers.ndim == 1:
            return numbers
        if name != "value":
            raise ValueError(f"{name} holds what is no number")
    out = np.empty(len(found), dtype=object)
    out[:] = [str(value) for value in found]
    return out


def joined(first: Table, second: Table) -> Table:
    """The rows of two tables below each other; NaN, or no text, where one has no such column."""
    both, out = (first, second), {}
    for name in dict.fromkeys([*first.columns, *second.columns]):
        nothing = np.array("", dtype=object) if name in TEXT_COLUMNS else np.array(np.nan)
        parts = [one.columns.get(name, np.repeat(nothing, len(one))) for one in both]
        out[name] = np.concatenate(parts)
    return Table(out)
