"""Quantities that follow a table in user input: programs over time, values over another quantity.

`Program("Pa")` annotates a pydantic field that may change with time: a quantity, or a table
`[[time, value], ...]`; it becomes a `TimeTable`. `NumberOrTable` is the same over any quantity.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from app.quantities import Quantity, QuantityError, format_quantity, parse_quantity

Row = tuple[float, float]
"""One row of a table: an argument (such as a time) and a value, both SI."""


@dataclass(frozen=True, slots=True)
class TimeTable:
    """A function of time: linear between the given times, held before the first and after the last.

    Attributes:
        times: s, strictly increasing, at least one.
        values: one SI value per time.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.times or len(self.times) != len(self.values):
            raise ValueError("a time table needs one value for each time, and at least one")
        if any(b <= a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError("the times of a time table must increase")
        if not all(map(math.isfinite, self.times + self.values)):
            raise ValueError("the times and values of a time table must be finite")

    @classmethod
    def constant(cls, value: float) -> TimeTable:
        """The same value (SI) at all times."""
        return cls((0.0,), (float(value),))

    def __call__(self, time: float) -> float:
        """Value in SI at `time` in s."""
        return float(np.interp(time, self.times, self.values))

    def integral(self, time: float) -> float:
        """Exact integral from 0 to `time` (s, >= 0), such as the displacement of a velocity."""
        knots = np.array([0.0, *(t for t in self.times if 0.0 < t < time), time])
        heights = np.interp(knots, self.times, self.values)
        return float(np.sum(0.5 * (heights[1:] + heights[:-1]) * np.diff(knots)))


def _parse_rows(rows: Sequence[object], first: Quantity, second: Quantity) -> tuple[Row, ...]:
    """The rows of a table `[[first, second], ...]`, the first column increasing.

    Raises:
        PydanticCustomError: with the place inside the table as context.
    """
    if not rows:
        raise _at((), rows, "a table needs at least one row")
    parsed: list[Row] = []
    for index, row in enumerate(rows):
        if not isinstance(row, list | tuple) or len(row) != 2:
            raise _at((index,), row, f"must be a pair [{first.name}, {second.name}]")
        pair = []
        for column, quantity in enumerate((first, second)):
            try:
                pair.append(quantity.parse(row[column]))
            except QuantityError as error:
                raise _at((index, column), row[column], str(error)) from None
        if parsed and pair[0] <= parsed[-1][0]:
            raise _at((index, 0), row[0], f"the {first.name} must increase from row to row")
        parsed.append((pair[0], pair[1]))
    return tuple(parsed)


def _at(place: tuple[int, ...], found: object, reason: str) -> PydanticCustomError:
    """Error at a place inside a field's value."""
    context = {"reason": reason, "at": place, "found": found}
    return PydanticCustomError("quantity", "{reason}", context)


def _rows_as_text(
    rows: Sequence[Row], first: Quantity, second: Quantity
) -> list[list[str | float]]:
    return [[format_quantity(a, first.unit), format_quantity(b, second.unit)] for a, b in rows]


def _table_schema(unit: str) -> JsonSchemaValue:
    """JSON schema of a quantity or a table of pairs."""
    entry = {"type": ["number", "string"]}
    pair = {"type": "array", "minItems": 2, "maxItems": 2, "items": entry}
    table = {"type": "array", "minItems": 1, "items": pair}
    return {"anyOf": [{"type": "number"}, {"type": "string"}, table], "x-unit": unit or "1"}


_TIME = Quantity("s", name="time")


@dataclass(frozen=True, slots=True)
class Program:
    """Pydantic annotation of a `TimeTable` field: a quantity or a table `[[time, value], ...]`.

    Attributes:
        unit: SI unit of the values.
        word: a word the field accepts too, and keeps as text (such as "driven").
    """

    unit: str
    word: str | None = None

    def parse(self, value: object) -> TimeTable | str:
        """The table of a quantity or of `[[time, value], ...]`, or the accepted word.

        Raises:
            PydanticCustomError: with the place inside the table as context.
        """
        if isinstance(value, TimeTable):
            return value
        if self.word is not None and value == self.word:
            return self.word
        if isinstance(value, list | tuple):
            rows = _parse_rows(value, _TIME, Quantity(self.unit))
            if len(rows) == 1:
                return TimeTable.constant(rows[0][1])
            return TimeTable(tuple(t for t, _ in rows), tuple(v for _, v in rows))
        try:
            return TimeTable.constant(parse_quantity(value, self.unit))
        except QuantityError as error:
            reason = f"{error}, or a table [[time, value], ...]"
            reason += f', or "{self.word}"' if self.word is not None else ""
            raise _at((), value, reason) from None

    def _serialise(self, value: TimeTable | str) -> object:
        if isinstance(value, str):
            return value
        if len(value.times) == 1:
            return format_quantity(value.values[0], self.unit)
        rows = list(zip(value.times, value.values, strict=True))
        return _rows_as_text(rows, _TIME, Quantity(self.unit))

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.parse,
            serialization=core_schema.plain_serializer_function_ser_schema(
                self._serialise, when_used="json"
            ),
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return _table_schema(self.unit)


@dataclass(frozen=True, slots=True)
class NumberOrTable:
    """Pydantic annotation of a plain number, or a table of it over another quantity.

    The field is a float, or the rows `((argument, value), ...)` with increasing arguments.

    Attributes:
        argument: the quantity of the first column.
        value: the quantity of the number, or of the second column.
    """

    argument: Quantity
    value: Quantity

    def parse(self, value: object) -> float | tuple[Row, ...]:
        """The number, or the rows.

        Raises:
            PydanticCustomError: with the place inside the table as context.
        """
        if isinstance(value, list | tuple):
            return _parse_rows(value, self.argument, self.value)
        try:
            return self.value.parse(value)
        except QuantityError as error:
            raise _at((), value, str(error)) from None

    def _serialise(self, value: float | tuple[Row, ...]) -> object:
        if isinstance(value, tuple):
            return _rows_as_text(value, self.argument, self.value)
        return format_quantity(value, self.value.unit)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.parse,
            serialization=core_schema.plain_serializer_function_ser_schema(
                self._serialise, when_used="json"
            ),
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return _table_schema(self.value.unit)
