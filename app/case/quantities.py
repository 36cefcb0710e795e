"""Physical quantities in user input: a number (SI) or text with a unit.

`Quantity("m", ge=0.0)` annotates a pydantic field: `"30 nm"`, `3e-8` and `"3e-8 m"` all become
the float 3e-8.

The unit library takes about 0.2 s to start, so the few dozen spellings that nearly every case
file uses are looked up in a table first, and the library is loaded only for the others. Text is
converted in decimal arithmetic, so "30 nm" is the float nearest to 3e-8 and not 30 times the float
nearest to 1e-9.
"""

from __future__ import annotations

import contextlib
import functools
import math
import re
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from tribox.forms.parameters import Bounds

_NUMBER_AND_UNIT = re.compile(
    r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(.*)", re.DOTALL
)
# What units are written with. The unit library passes over some other characters.
_UNIT = re.compile(r"[\w°µμΩ%*/^.()·⋅⁻²³¹⁰⁴-⁹+\- \t\u00a0]*")
# Of a temperature, "K"; a difference is in "kelvin".
CELSIUS, ICE = ("degC", "°C"), Decimal("273.15")
LONGEST = 80  # letters of a quantity; the unit library takes its time over thousands
LARGEST = 1e50
"""Size in SI up to which a key may be; one that may not be 0 is at least as much above it. What is
computed from several of them then stays within the range of numbers."""

# SI unit of a field: {spelling: factor}. Only spellings without ambiguity; everything else goes
# through the unit library, with which a test compares this table.
COMMON_UNITS: dict[str, dict[str, str]] = {
    "m": {"mm": "1e-3", "um": "1e-6", "µm": "1e-6", "μm": "1e-6", "nm": "1e-9"},
    "s": {"ms": "1e-3", "us": "1e-6", "ns": "1e-9"},
    "Pa": {"kPa": "1e3", "MPa": "1e6", "GPa": "1e9", "N/m^2": "1", "N/mm^2": "1e6"},
    "N": {"mN": "1e-3", "kN": "1e3"},
    "m/s": {"mm/s": "1e-3", "um/s": "1e-6", "µm/s": "1e-6", "μm/s": "1e-6", "nm/s": "1e-9"},
    "Pa*s": {"Pa s": "1", "mPa*s": "1e-3", "mPa s": "1e-3", "N s/m^2": "1", "N*s/m^2": "1"},
    "Pa/m": {"MPa/mm": "1e9", "N/m^3": "1", "N/mm^3": "1e9"},
    "kg/m^3": {"g/cm^3": "1e3"},
    "1/m": {"1/mm": "1e3", "1/um": "1e6"},
    "N/s": {},
    "N/m": {"N/mm": "1e3", "kN/m": "1e3", "mN/m": "1e-3"},
    "1/s": {"1/ms": "1e3"},
    "kg": {"g": "1e-3", "mg": "1e-6"},
    "rad": {"deg": "0.01745329251994329576923690768"},
    "": {"%": "1e-2"},
}


class QuantityError(ValueError):
    """A value that is not the quantity asked for; the message says what is."""


@functools.cache
def _registry() -> Any:
    """The unit library, started at the first unit that `COMMON_UNITS` does not hold."""
    import pint

    return pint.UnitRegistry(non_int_type=Decimal)


@functools.cache
def _factor(text: str, unit: str) -> Decimal:
    """Factor that brings the unit written as `text` to the SI unit `unit`."""
    if text == unit:
        return Decimal(1)
    if (common := COMMON_UNITS.get(unit, {}).get(text)) is not None:
        return Decimal(common)
    registry = _registry()
    try:
        if _UNIT.fullmatch(text) is None:
            raise ValueError("characters that no unit has")
        given = registry.Quantity(Decimal(1), registry.parse_units(text))
    except Exception as error:  # The library fails on odd text in many ways, all the writer's.
        hint = _hint(text, unit)
        if re.match(r",\d", text):
            hint = "decimals stand behind a point, as in 0.5"
        raise QuantityError(f'unknown unit "{text}"; {hint}') from error
    try:
        zero = registry.Quantity(Decimal(0), given.units).to(registry.parse_units(unit))
        if zero.magnitude != 0:
            raise ValueError("it counts from another zero")
        return Decimal(given.to(registry.parse_units(unit)).magnitude)
    except Exception as error:  # Wrong dimension, or an offset unit such as degC.
        raise QuantityError(f'"{text}" has the wrong dimension; {_hint(text, unit)}') from error


def _hint(text: str, unit: str) -> str:
    """What to write instead of `text`: what differs from it in capitals or signs, or any unit."""
    for common in (unit, *COMMON_UNITS.get(unit, {})):
        if _letters(common) == _letters(text):
            return f'did you mean "{common}"?'
    # "MN/m2" and "Newton", as others write them.
    for other in (re.sub(r"(?<=[^\W\d_])(-?\d+)", r"^\1", text), text.lower()):
        if other != text:
            with contextlib.suppress(QuantityError):
                _factor(other, unit)
                return f'did you mean "{other}"?'
    return _expected(unit)


def _letters(unit: str) -> str:
    """A unit without capitals, powers, products and blanks, which "N/mm2" and "Pas" leave out."""
    return re.sub(r"[\s^*·.]", "", unit).lower()


def _expected(unit: str) -> str:
    """What to write for a quantity of this SI unit."""
    if not unit:
        return "must be a plain number (no unit)"
    shown = "23 degC" if unit == "K" else f"1 {unit}"
    return f'must be a number (in {unit}) or text with a unit of its kind, as in "{shown}"'


def parse_quantity(value: object, unit: str) -> float:
    """Value of a quantity, a number or text "number unit", in SI; finite.

    QuantityError if it is none, or not of the dimension of ``unit``, "" for a plain number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise QuantityError(_expected(unit))
    try:
        number = _parse_text(value, unit) if isinstance(value, str) else float(value)
    except ArithmeticError:  # 1e9999999, or a whole number of 400 digits.
        number = math.inf
    if not math.isfinite(number):
        raise QuantityError("must be finite")
    return number


def parse_bounded(value: object, unit: str) -> float:
    """As :func:`parse_quantity`, of a size up to `LARGEST`; QuantityError beyond it."""
    number = parse_quantity(value, unit)
    if abs(number) > LARGEST:
        raise QuantityError(f"must be of a size up to {LARGEST:g} {unit}".rstrip())
    return number


def _parse_text(text: str, unit: str) -> float:
    """Float in `unit` of the text "number unit"."""
    if len(text) > LONGEST:
        raise QuantityError(f"has {len(text)} letters; {_expected(unit)}")
    match = _NUMBER_AND_UNIT.fullmatch(text.strip())
    if match is None:
        if text.strip().lstrip("+-").lower().split(" ")[0] in ("inf", "infinity", "nan"):
            raise QuantityError("must be finite")
        raise QuantityError(_expected(unit))
    number, written = Decimal(match[1]), match[2]
    if unit and not written:
        raise QuantityError(f"is text without a unit; {_expected(unit)}")
    if unit == "K" and written in CELSIUS:
        return float(number + ICE)
    return float(number * _factor(written, unit)) if written else float(number)


def split_quantity(value: object) -> tuple[float, str]:
    """Number and unit ("" without) of a quantity as it was written; QuantityError if it is none."""
    if isinstance(value, str) and (match := _NUMBER_AND_UNIT.fullmatch(value.strip())) is not None:
        number, unit = float(match[1]), match[2]
        return parse_quantity(number, ""), unit
    return parse_quantity(value, ""), ""


def format_quantity(value: float, unit: str) -> str | float:
    """Text that `parse_quantity` reads back to the same float; a plain number without unit."""
    value = float(value)  # numpy's own would be written with the name of its type
    return f"{value!r} {unit}" if unit else value


def text_schema(unit: str) -> dict[str, str]:
    """JSON schema of a quantity given as text; `tribox.app.case.schema` puts the pattern in."""
    return {"type": "string", "x-unit": unit or "1"}


class Written:
    """Base of pydantic annotations: how a value is written in a case file, and read from it."""

    __slots__ = ()

    def parse(self, value: Any) -> Any:
        """What stands for it in a case; QuantityError or PydanticCustomError say what may be."""
        raise NotImplementedError

    def serialise(self, value: Any) -> object:
        """What `parse` reads back to the same."""
        raise NotImplementedError

    def json_schema(self) -> JsonSchemaValue:
        """JSON schema of how it is written."""
        raise NotImplementedError

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return self.json_schema()

    def _validate(self, value: object) -> Any:
        try:
            return self.parse(value)
        except QuantityError as error:
            raise PydanticCustomError("quantity", "{reason}", {"reason": str(error)}) from None

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self._validate,
            serialization=core_schema.plain_serializer_function_ser_schema(
                self.serialise, when_used="json"
            ),
        )


@dataclass(frozen=True, slots=True)
class Quantity(Bounds, Written):
    """Pydantic annotation of a float field: `Annotated[float, Quantity("m", gt=0.0)]`."""

    def parse(self, value: object) -> float:
        """SI value within the bounds; QuantityError if no such quantity, or out of bounds."""
        number = parse_bounded(value, self.unit)
        if self.nonzero and number == 0.0:
            raise QuantityError("must not be 0")
        if 0.0 < abs(number) < 1.0 / LARGEST and (self.nonzero or self.gt == 0.0):
            least = f"{1.0 / LARGEST:g} {self.unit}".rstrip()
            raise QuantityError(f"must be of a size from {least} on")
        if not self.hold(number):
            raise QuantityError(f"must be {self.bounds()}")
        return number

    def serialise(self, value: float) -> object:
        """Text that reads back to the same."""
        return format_quantity(value, self.unit)

    def json_schema(self) -> JsonSchemaValue:
        limits = {
            "minimum": self.ge,
            "exclusiveMinimum": self.gt,
            "maximum": self.le,
            "exclusiveMaximum": self.lt,
        }
        number: dict[str, Any] = {"type": "number"}
        number.update({key: limit for key, limit in limits.items() if limit is not None})
        return {"anyOf": [number, text_schema(self.unit)], "x-unit": self.unit or "1"}
