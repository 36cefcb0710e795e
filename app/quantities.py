"""Physical quantities in user input: a number (SI) or text with a unit, and tables over time.

`Quantity("m", ge=0.0)` annotates a pydantic field: `"30 nm"`, `3e-8` and `"3e-8 m"` all become
the float 3e-8. `Program("Pa")` annotates a field that may change with time: a quantity, or a
table `[[time, value], ...]`; it becomes a `TimeTable`.

The unit library takes about 0.2 s to start, so the few dozen spellings that nearly every case
file uses are looked up in a table first, and the library is loaded only for the others. Text is
converted in decimal arithmetic, so "30 nm" is the float nearest to 3e-8 and not 30 times the float
nearest to 1e-9.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, Overflow
from typing import Any

import numpy as np
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

_NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")

# SI unit of a field: {spelling: factor}. Only spellings without ambiguity; everything else goes
# through the unit library, with which a test compares this table.
COMMON_UNITS: dict[str, dict[str, str]] = {
    "m": {"mm": "1e-3", "um": "1e-6", "µm": "1e-6", "μm": "1e-6", "nm": "1e-9"},
    "s": {"ms": "1e-3", "us": "1e-6"},
    "Pa": {"kPa": "1e3", "MPa": "1e6", "GPa": "1e9", "N/m^2": "1", "N/mm^2": "1e6"},
    "N": {"mN": "1e-3", "kN": "1e3"},
    "m/s": {"mm/s": "1e-3", "um/s": "1e-6", "µm/s": "1e-6", "μm/s": "1e-6", "nm/s": "1e-9"},
    "Pa*s": {"Pa s": "1", "mPa*s": "1e-3", "mPa s": "1e-3", "N s/m^2": "1", "N*s/m^2": "1"},
    "Pa/m": {"MPa/mm": "1e9", "N/m^3": "1", "N/mm^3": "1e9"},
    "kg/m^3": {"g/cm^3": "1e3"},
    "1/m": {"1/mm": "1e3", "1/um": "1e6"},
    "N/s": {},
    "": {"%": "1e-2"},
}


Row = tuple[float, float]
"""One row of a table: an argument (such as a time) and a value, both SI."""


class QuantityError(ValueError):
    """A value that is not the quantity asked for; the message says what is."""


@functools.cache
def _registry() -> Any:
    """The unit library, started at the first unit that `COMMON_UNITS` does not hold."""
    import pint

    return pint.UnitRegistry(non_int_type=Decimal)


@functools.cache
def _factor(text: str, unit: str) -> Decimal:
    """Factor that brings the unit written as `text` to the SI unit `unit`.

    Raises:
        QuantityError: `text` is no unit, or one of another dimension.
    """
    if text == unit:
        return Decimal(1)
    if (common := COMMON_UNITS.get(unit, {}).get(text)) is not None:
        return Decimal(common)
    registry = _registry()
    try:
        given = registry.Quantity(Decimal(1), registry.parse_units(text))
    except Exception as error:  # The library fails on odd text in many ways, all the writer's.
        raise QuantityError(f'unknown unit "{text}"; {_expected(unit)}') from error
    try:
        return Decimal(given.to(registry.parse_units(unit)).magnitude)
    except Exception as error:  # Wrong dimension, or an offset unit such as degC.
        raise QuantityError(f'"{text}" has the wrong dimension; {_expected(unit)}') from error


def _expected(unit: str) -> str:
    """What to write for a quantity of this SI unit."""
    if not unit:
        return "must be a plain number (no unit)"
    return f'must be a number (in {unit}) or text with a unit of its kind, as in "1 {unit}"'


def parse_quantity(value: object, unit: str) -> float:
    """Value of a quantity in SI.

    Args:
        value: number (taken as SI) or text "number unit".
        unit: SI unit of the result, such as "m", "Pa*s", or "" for a plain number.

    Returns:
        A finite float in `unit`.

    Raises:
        QuantityError: not a number, unknown unit, wrong dimension, or not finite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise QuantityError(_expected(unit))
    number = float(value) if not isinstance(value, str) else _parse_text(value, unit)
    if not math.isfinite(number):
        raise QuantityError("must be finite")
    return number


def _parse_text(text: str, unit: str) -> float:
    """Float in `unit` of the text "number unit"; text without a unit is SI."""
    match = _NUMBER_AND_UNIT.fullmatch(text)
    if match is None:
        if text.strip().lstrip("+-").lower().split(" ")[0] in ("inf", "infinity", "nan"):
            raise QuantityError("must be finite")
        raise QuantityError(_expected(unit))
    number, written = Decimal(match[1]), match[2]
    try:
        return float(number * _factor(written, unit)) if written else float(number)
    except Overflow as error:
        raise QuantityError("must be finite") from error


def format_quantity(value: float, unit: str) -> str | float:
    """Text that `parse_quantity` reads back to the same float; a plain number without unit."""
    return f"{value!r} {unit}" if unit else value


@dataclass(frozen=True, slots=True)
class Quantity:
    """Pydantic annotation of a float field given as a quantity: `Annotated[float, Quantity("m")]`.

    Attributes:
        unit: SI unit, "" for a plain number.
        ge: smallest value allowed, in `unit`; likewise gt (exclusive), le, lt.
        gt: see ge.
        le: see ge.
        lt: see ge.
        nonzero: zero is not allowed.
        name: what the quantity is called in messages about tables.
    """

    unit: str = ""
    ge: float | None = None
    gt: float | None = None
    le: float | None = None
    lt: float | None = None
    nonzero: bool = False
    name: str = "value"

    def parse(self, value: object) -> float:
        """SI value within the bounds.

        Raises:
            QuantityError: no such quantity, or out of bounds.
        """
        number = parse_quantity(value, self.unit)
        inside = (
            (self.ge is None or number >= self.ge)
            and (self.gt is None or number > self.gt)
            and (self.le is None or number <= self.le)
            and (self.lt is None or number < self.lt)
            and not (self.nonzero and number == 0.0)
        )
        if not inside:
            raise QuantityError(f"must be {self.bounds()}")
        return number

    def bounds(self) -> str:
        """The bounds in words, such as "> 0 m" or ">= 0 and <= 1"."""
        limits = ((">=", self.ge), (">", self.gt), ("<=", self.le), ("<", self.lt))
        parts = [
            f"{sign} {limit:g} {self.unit}".rstrip() for sign, limit in limits if limit is not None
        ]
        return " and ".join([*parts, *(["other than 0"] if self.nonzero else [])])

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        def validate(value: object) -> float:
            try:
                return self.parse(value)
            except QuantityError as error:
                raise PydanticCustomError("quantity", "{reason}", {"reason": str(error)}) from None

        return core_schema.no_info_plain_validator_function(
            validate,
            serialization=core_schema.plain_serializer_function_ser_schema(
                lambda value: format_quantity(value, self.unit), when_used="json"
            ),
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        limits = {
            "minimum": self.ge,
            "exclusiveMinimum": self.gt,
            "maximum": self.le,
            "exclusiveMaximum": self.lt,
        }
        number: dict[str, Any] = {"type": "number"}
        number.update({key: limit for key, limit in limits.items() if limit is not None})
        return {"anyOf": [number, {"type": "string"}], "x-unit": self.unit or "1"}


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

    @property
    def is_constant(self) -> bool:
        """True if the value never changes."""
        return all(value == self.values[0] for value in self.values)

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
