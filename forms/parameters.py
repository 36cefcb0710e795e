"""Parameters of laws and materials, each declared once: meaning, unit, bounds, default.

A law or material is a frozen dataclass that derives from :class:`Declared`, its fields made by
:func:`parameter`. It checks its values by this declaration and by its ``faults``, and
:func:`tribox.app.case.declared.table_of` makes the keys of a case file from the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from typing import Any, Literal, cast, get_args, get_origin, get_type_hints

SAME_PLACE = "parameter"  # of the declaration in a field's metadata


@dataclass(frozen=True, slots=True)
class Bounds:
    """A number with its unit, and what it may be."""

    unit: str = ""  # SI unit, "" for a plain number
    ge: float | None = None  # smallest value allowed, in `unit`; likewise gt (exclusive), le, lt
    gt: float | None = None  # see ge
    le: float | None = None  # see ge
    lt: float | None = None  # see ge
    nonzero: bool = False  # zero is not allowed
    infinite: bool = False  # infinity is allowed, in Python
    name: str = "value"  # what the quantity is called in messages about tables

    def hold(self, number: float) -> bool:
        """Whether a number keeps them; zero may still be refused by `nonzero`."""
        return (
            (self.ge is None or number >= self.ge)
            and (self.gt is None or number > self.gt)
            and (self.le is None or number <= self.le)
            and (self.lt is None or number < self.lt)
        )

    def bounds(self) -> str:
        """The bounds in words, such as "> 0 m" or ">= 0 and <= 1"."""
        limits = ((">=", self.ge), (">", self.gt), ("<=", self.le), ("<", self.lt))
        parts = [
            f"{sign} {limit:g} {self.unit}".rstrip() for sign, limit in limits if limit is not None
        ]
        return " and ".join(parts)

    def fault(self, value: object) -> str | None:
        """What is wrong with a number; None if it is allowed."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return "must be a number"
        if math.isnan(value) or (math.isinf(value) and not self.infinite):
            return "must be finite"
        if self.nonzero and value == 0.0:
            return "must not be 0"
        return None if self.hold(value) else f"must be {self.bounds()}"


@dataclass(frozen=True, slots=True)
class Scales:
    """What defaults follow from."""

    modulus: float  # Pa, shear modulus of the softer body, or its hardness if it flows
    length: float  # m, of a slave facet
    pressure: float  # Pa, the highest that a boundary prescribes; 0 without one


@dataclass(frozen=True, slots=True)
class Parameter:
    """The declaration of one parameter; see :func:`parameter`."""

    meaning: str
    number: Bounds
    over: Bounds | None = None
    program: bool = False
    same_as: str | None = None
    follows: Callable[[Scales], float] | None = None
    otherwise: float | None = None
    key: str | None = None
    most: int | None = None


def parameter(
    meaning: str,
    unit: str = "",
    *,
    default: Any = MISSING,
    over: Bounds | None = None,
    program: bool = False,
    same_as: str | None = None,
    follows: Callable[[Scales], float] | None = None,
    otherwise: float | None = None,
    key: str | None = None,
    most: int | None = None,
    **bounds: Any,
) -> Any:
    """Declare a field of a law or material: its meaning, for readers of case files, and SI unit.

    ``default``: the value if it is not given; without one it is needed. ``over``: it may be a table
    over this quantity; ``program``: or change with time. A case that does not give it takes
    ``otherwise``, the value of the parameter ``same_as``, or what ``follows`` makes of bodies and
    mesh. ``key``: in the case file, if not the field's name; ``most``: entries of a list; see
    :class:`Bounds`.
    """
    declared = Parameter(
        meaning, Bounds(unit, **bounds), over, program, same_as, follows, otherwise, key, most
    )
    return field(default=default, metadata={SAME_PLACE: declared})


class Refused(ValueError):
    """A value that is not allowed; the message names it and says what is.

    ``key``: with row and column as in "points.0.1", "" if of several; ``reason``: what is allowed.
    """

    def __init__(self, key: str, reason: str, value: object = MISSING) -> None:
        shown = key if value is MISSING else f"{key} = {value!r}"
        super().__init__(f"{shown}: {reason}" if key else reason)
        self.key, self.reason, self.value = key, reason, value


class Declared:
    """A dataclass of parameters that checks them when it is made; Refused if one is wrong."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Check all values, one by one and together."""
        for name, declared, choices in declarations(type(self)):
            value = getattr(self, name)
            if hasattr(value, "tolist"):  # arrays of numpy, which is not imported here
                value = value.tolist()
            if isinstance(value, list):
                value = tuple(tuple(v) if isinstance(v, list) else v for v in value)
                object.__setattr__(self, name, value)
            reason = None if value is None else _fault(value, declared, choices)
            if reason is not None:
                raise Refused(name, reason, value)
        for refused in self.faults():
            raise refused

    def faults(self) -> Iterator[Refused]:
        """What does not fit together, in values that are allowed one by one."""
        return iter(())


Declarations = tuple[tuple[str, Parameter, tuple[Any, ...]], ...]


def declarations(kind: type[Declared]) -> Declarations:
    """(name, declaration, words to choose from if it is a word) of a class's parameters."""
    return _declarations(cast(Hashable, kind))


@cache
def _declarations(kind: Any) -> Declarations:
    hints = get_type_hints(kind)
    return tuple(
        (
            one.name,
            one.metadata[SAME_PLACE],
            get_args(hints[one.name]) if get_origin(hints[one.name]) is Literal else (),
        )
        for one in fields(kind)
        if SAME_PLACE in one.metadata
    )


def _fault(value: Any, declared: Parameter, choices: tuple[Any, ...]) -> str | None:
    """What is wrong with a value of one parameter."""
    if choices:
        return None if value in choices else f"must be {' or '.join(map(repr, choices))}"
    if isinstance(value, bool):
        return None
    if declared.over is None or not isinstance(value, tuple):
        entries = value if isinstance(value, tuple) and declared.most else (value,)
        return next((fault for one in entries if (fault := declared.number.fault(one))), None)
    if not value or any(not isinstance(row, tuple) or len(row) != 2 for row in value):
        return f"must be a table of rows [{declared.over.name}, {declared.number.name}]"
    for before, (first, second) in zip(((-math.inf, 0.0), *value), value, strict=False):
        if (fault := declared.over.fault(first) or declared.number.fault(second)) is not None:
            return fault
        if first <= before[0]:
            return f"the {declared.over.name} must rise from row to row"
    return None


def require(name: str, value: float, **bounds: Any) -> None:
    """Check one number; see :class:`Bounds`; Refused if it is not allowed."""
    if (reason := Bounds(**bounds).fault(value)) is not None:
        raise Refused(name, reason, value)
