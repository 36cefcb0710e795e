"""Quantities that follow a table in user input: programs over time, values over another quantity.

`Program("Pa")` annotates a pydantic field that may change with time: a quantity, a table
`[[time, value], ...]`, or `{ table = [...], ramp = "smooth" }`; it becomes a `TimeTable`.
`NumberOrTable` is a number or a table over any quantity, `Rows` always a table.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError

from tribox.app.case.quantities import (
    Quantity,
    QuantityError,
    Written,
    format_quantity,
    parse_bounded,
    text_schema,
)
from tribox.app.case.table import ABSENT, Model, Place, Problem

Row = tuple[float, float]  # one row of a table: an argument (such as a time) and a value, both SI


RAMPS = ("linear", "smooth")
MOST_ROWS = 100_000


def smooth_step(share: float) -> float:
    """6 s⁵ − 15 s⁴ + 10 s³, s in [0, 1]: from 0 to 1, velocity and acceleration 0 at both ends."""
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


def smooth_step_integral(share: float) -> float:
    """Integral of `smooth_step` from 0 to ``share``: s⁶ − 3 s⁵ + 5/2 s⁴, and s − 1/2 past 1."""
    s = min(max(share, 0.0), 1.0)
    return s**4 * (2.5 + s * (s - 3.0)) + max(share - 1.0, 0.0)


@dataclass(frozen=True, slots=True)
class TimeTable:
    """A function of time through given points, constant before the first and after the last."""

    times: tuple[float, ...]  # s, strictly increasing, at least one
    values: tuple[float, ...]  # one SI value per time
    smooth: bool = False  # between two points, follow `smooth_step` instead of a straight line

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
        if self.smooth and self.times[0] < time < self.times[-1]:
            at = bisect.bisect_right(self.times, time) - 1
            low, rise = self.values[at], self.values[at + 1] - self.values[at]
            share = (time - self.times[at]) / (self.times[at + 1] - self.times[at])
            return low + rise * smooth_step(share)
        return float(np.interp(time, self.times, self.values))

    def integral(self, time: float) -> float:
        """Exact integral from 0 to `time` (s, >= 0), such as the displacement of a velocity."""
        if self.smooth:
            return self._antiderivative(time) - self._antiderivative(0.0)
        knots = np.array([0.0, *(t for t in self.times if 0.0 < t < time), time])
        heights = np.interp(knots, self.times, self.values)
        return float(np.sum(0.5 * (heights[1:] + heights[:-1]) * np.diff(knots)))

    def _antiderivative(self, time: float) -> float:
        """Integral of the smooth function from the first of its times to ``time`` (s)."""
        first, last = self.times[0], self.times[-1]
        total = self.values[0] * min(time - first, 0.0) + self.values[-1] * max(time - last, 0.0)
        for at, (start, end) in enumerate(pairwise(self.times)):
            inside = min(max(time - start, 0.0), end - start)
            rise, share = self.values[at + 1] - self.values[at], inside / (end - start)
            total += self.values[at] * inside + rise * (end - start) * smooth_step_integral(share)
        return total


def _parse_rows(
    rows: Sequence[object], first: Quantity, second: Quantity, rising: bool = True
) -> tuple[Row, ...]:
    """The rows of a table `[[first, second], ...]`; ``rising``: the first column must increase."""
    if not rows:
        raise _at((), rows, "a table needs at least one row")
    if len(rows) > MOST_ROWS:
        raise _at((), ABSENT, f"has {len(rows)} rows; a table has at most {MOST_ROWS}")
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
        if rising and parsed and pair[0] <= parsed[-1][0]:
            raise _at((index, 0), row[0], f"the {first.name} must increase from row to row")
        parsed.append((pair[0], pair[1]))
    return tuple(parsed)


def _at(place: tuple[int | str, ...], found: object, reason: str) -> PydanticCustomError:
    """Error at a place inside a field's value."""
    context = {"reason": reason, "at": place, "found": found}
    return PydanticCustomError("quantity", "{reason}", context)


def _rows_as_text(
    rows: Sequence[Row], first: Quantity, second: Quantity
) -> list[list[str | float]]:
    return [[format_quantity(a, first.unit), format_quantity(b, second.unit)] for a, b in rows]


def _table_schema(argument: str, unit: str) -> JsonSchemaValue:
    """JSON schema of a quantity in ``unit`` or a table of it over an argument with its unit."""
    number, text = {"type": "number"}, text_schema(unit)
    entry = {"anyOf": [number, text_schema(argument), text]}
    pair = {"type": "array", "minItems": 2, "maxItems": 2, "items": entry}
    table = {"type": "array", "minItems": 1, "items": pair}
    return {"anyOf": [number, text, table], "x-unit": unit or "1"}


_TIME = Quantity("s", name="time")


@dataclass(frozen=True, slots=True)
class Program(Written):
    """Pydantic annotation of a `TimeTable` field: a quantity or a table `[[time, value], ...]`."""

    unit: str  # SI unit of the values
    word: str | None = None  # a word the field accepts too, and keeps as text (such as "driven")

    def parse(self, value: object) -> TimeTable | str:
        """The table of a quantity or rows, or the word; PydanticCustomError with place."""
        if isinstance(value, TimeTable):
            return value
        if self.word is not None and value == self.word:
            return self.word
        if isinstance(value, Mapping):
            return self._parse_ramped(value)
        if isinstance(value, list | tuple):
            rows = _parse_rows(value, _TIME, Quantity(self.unit))
            if len(rows) == 1:
                return TimeTable.constant(rows[0][1])
            return TimeTable(tuple(t for t, _ in rows), tuple(v for _, v in rows))
        try:
            return TimeTable.constant(parse_bounded(value, self.unit))
        except QuantityError as error:
            reason = str(error)
            if not reason.endswith("?"):  # "did you mean …?" needs no more
                reason += ", or a table [[time, value], ...]"
                reason += f', or "{self.word}"' if self.word is not None else ""
            if value == DRIVEN:
                reason += "; what moves with the velocity of the stage has displacement = "
                reason += '{ x = "driven" } (or y, z), and a tool that it turns rotation = '
                reason += '{ rim = "driven" }'
            raise _at((), value, reason) from None

    def _parse_ramped(self, value: Mapping[Any, Any]) -> TimeTable:
        """The table of `{ table = [[time, value], ...], ramp = "smooth" }`."""
        for key in value:
            if key not in ("table", "ramp"):
                raise _at((), ABSENT, f'unknown key "{key}"; valid keys: table, ramp')
        rows, ramp = value.get("table"), value.get("ramp", "linear")
        if not isinstance(rows, list | tuple):
            raise _at(("table",), ABSENT if rows is None else rows, "must be [[time, value], ...]")
        if ramp not in RAMPS:
            raise _at(("ramp",), ramp, 'must be "linear" or "smooth"')
        try:
            table = self.parse(rows)
        except PydanticCustomError as error:
            context = error.context or {}
            raise _at(("table", *context["at"]), context["found"], context["reason"]) from None
        assert isinstance(table, TimeTable)
        return replace(table, smooth=ramp == "smooth")

    def serialise(self, value: TimeTable | str) -> object:
        """A quantity, rows, or a table of rows and ramp."""
        if isinstance(value, str):
            return value
        if len(value.times) == 1:
            return format_quantity(value.values[0], self.unit)
        rows = list(zip(value.times, value.values, strict=True))
        text = _rows_as_text(rows, _TIME, Quantity(self.unit))
        return {"table": text, "ramp": "smooth"} if value.smooth else text

    def json_schema(self) -> JsonSchemaValue:
        schema = _table_schema(_TIME.unit, self.unit)
        schema["anyOf"] += [] if self.word is None else [{"const": self.word}]
        ramp = {"enum": list(RAMPS)}
        ramped = {"type": "object", "properties": {"table": schema["anyOf"][2], "ramp": ramp}}
        schema["anyOf"].append({**ramped, "required": ["table"], "additionalProperties": False})
        return schema


@dataclass(frozen=True, slots=True)
class NumberOrProgram(Program):
    """Pydantic annotation of a number, or a `TimeTable` where it changes with time."""

    least: float | None = None  # no value may be below it, SI; None: any may

    def parse(self, value: object) -> float | TimeTable:  # type: ignore[override]
        """The number, or the table of `[[time, value], ...]`."""
        table = Program.parse(self, value)
        assert isinstance(table, TimeTable)
        if self.least is not None and min(table.values) < self.least:
            raise _at((), value, f"must be >= {self.least:g} at all times")
        return table.values[0] if len(table.values) == 1 else table

    def serialise(self, value: float | TimeTable) -> object:  # type: ignore[override]
        """As of a program."""
        table = value if isinstance(value, TimeTable) else TimeTable.constant(value)
        return Program.serialise(self, table)

    def json_schema(self) -> JsonSchemaValue:
        out = Program.json_schema(self)
        if self.least is not None:
            out["anyOf"][0] = {"type": "number", "minimum": self.least}
        return out


def value_at(value: float | TimeTable, time: float) -> float:
    """A number, or what a program has at ``time`` (s)."""
    return value(time) if isinstance(value, TimeTable) else value


@dataclass(frozen=True, slots=True)
class NumberOrTable(Written):
    """Pydantic annotation of a plain number, or a table of it over another quantity.

    The field is a float, or the rows `((argument, value), ...)` with increasing arguments.
    """

    argument: Quantity  # the quantity of the first column
    value: Quantity  # the quantity of the number, or of the second column

    def parse(self, value: object) -> float | tuple[Row, ...]:
        """The number, or the rows."""
        if isinstance(value, list | tuple):
            return _parse_rows(value, self.argument, self.value)
        try:
            return self.value.parse(value)
        except QuantityError as error:
            raise _at((), value, str(error)) from None

    def serialise(self, value: float | tuple[Row, ...]) -> object:
        """A quantity, or rows."""
        if isinstance(value, tuple):
            return _rows_as_text(value, self.argument, self.value)
        return format_quantity(value, self.value.unit)

    def json_schema(self) -> JsonSchemaValue:
        return _table_schema(self.argument.unit, self.value.unit)


@dataclass(frozen=True, slots=True)
class Rows(NumberOrTable):
    """Pydantic annotation of a table of one quantity over another: `((argument, value), ...)`."""

    # whether the arguments must increase; False: they are pairs and no function
    rising: bool = True

    def parse(self, value: object) -> tuple[Row, ...]:
        """The rows."""
        if not isinstance(value, list | tuple):
            pair = f"[{self.argument.name}, {self.value.name}]"
            raise _at((), value, f"must be a table of rows [{pair}, ...]")
        return _parse_rows(value, self.argument, self.value, self.rising)

    def json_schema(self) -> JsonSchemaValue:
        whole = _table_schema(self.argument.unit, self.value.unit)
        return {**whole["anyOf"][2], "x-unit": whole["x-unit"]}


# -- What `[[boundary]]` tables say of motion: displacements, velocities and rotations of surfaces -

COMPONENTS = ("x", "y", "z")
Component = Literal["x", "y", "z"]
DRIVEN = "driven"

Travel = Annotated[TimeTable | Literal["driven"], Program("m", word=DRIVEN)]
_Velocity = Annotated[TimeTable, Program("m/s")]
_Angle = Annotated[TimeTable, Program("rad")]
_Length = Annotated[float, Quantity("m")]
_Weight = Annotated[float, Quantity()]
_TRAVEL = 'displacement in {}, or "driven": moved with the velocity of the stage'


class Displacement(Model):
    """Prescribed components of the displacement."""

    x: Travel | None = Field(default=None, description=_TRAVEL.format("x"))
    y: Travel | None = Field(default=None, description=_TRAVEL.format("y"))
    z: Travel | None = Field(default=None, description=_TRAVEL.format("z, in 3D"))
    direction: tuple[_Weight, ...] | None = None
    """direction [x, y] or [x, y, z] in which the driven components together move with the velocity
    of the stage; default: each moves with it"""

    def driven_components(self) -> tuple[str, ...]:
        """Components that move with the velocity of the stage."""
        return tuple(c for c in COMPONENTS if getattr(self, c) == DRIVEN)

    def driven_share(self, component: str) -> float:
        """Displacement of a driven component over the driven displacement."""
        if self.direction is None:
            return 1.0
        return self.direction[COMPONENTS.index(component)] / math.hypot(*self.direction)

    def problems(self, place: Place) -> Iterator[Problem]:
        """A direction that does not go with what is driven."""
        if self.direction is None:
            return
        here, found = (*place, "direction"), list(self.direction)
        driven = self.driven_components()
        if len(self.direction) not in (2, 3):
            yield Problem(here, "must be two components in the plane, three in space", found)
        elif not any(self.direction):
            yield Problem(here, "must not be zero in all components", found)
        elif not driven:
            reason = 'says where driven components move, and none is: give { x = "driven", ... }'
            yield Problem(here, reason, found)
        else:
            for component, weight in zip(COMPONENTS, self.direction, strict=False):
                if weight and component not in driven:
                    reason = f'{component} is not driven: give {component} = "driven", or 0 here'
                    yield Problem(here, reason, found)
            if len(self.direction) == 2 and "z" in driven:
                yield Problem(here, "has no component z, which is driven", found)


class Velocity(Model):
    """Prescribed components of the velocity; they are integrated in time."""

    x: _Velocity | None = None
    """velocity in x"""
    y: _Velocity | None = None
    """velocity in y"""
    z: _Velocity | None = None
    """velocity in z, in 3D"""


class Rotation(Model):
    """A rigid rotation of a surface; displacements along the axis are left to other keys."""

    angle: _Angle
    """angle, against the clock seen from the axis's arrow head"""
    axis: Component = "z"
    """direction of the axis; in the plane it is z, across the plane"""
    centre: tuple[_Length, ...] | None = None
    """a point on the axis, [x, y] or [x, y, z], undeformed; default: the origin"""

    def decided(self) -> tuple[str, ...]:
        """The two components that a rotation prescribes."""
        return tuple(c for c in COMPONENTS if c != self.axis)

    def problems(self, place: Place) -> Iterator[Problem]:
        """A centre that is no point."""
        if self.centre is not None and len(self.centre) not in (2, 3):
            reason = "must be two coordinates in the plane, three in space"
            yield Problem((*place, "centre"), reason, list(self.centre))
