"""Tables of a case file made from laws and materials that declare their parameters in ``forms``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, get_args, get_type_hints

from pydantic import Field, create_model

from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Flag, Model, Place, Problem
from tribox.app.case.time_tables import NumberOrProgram, NumberOrTable, Rows, TimeTable, value_at
from tribox.forms.parameters import Bounds, Declared, Parameter, Refused, declarations


class DeclaredTable(Model):
    """A table of the case whose keys are the parameters of a class in ``forms``."""

    declared: ClassVar[type[Declared]]

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Keys that come from the declaration."""

    @property
    def changes(self) -> bool:
        """Whether a value follows a program of time."""
        kind = type(self).declared
        return any(isinstance(getattr(self, key), TimeTable) for key in keys_of(kind).values())

    def parameters(self, time: float = 0.0) -> Any:
        """The parameters at a time, s, checked; Refused if the values do not fit together."""
        kind = type(self).declared
        values = {name: value_at(getattr(self, key), time) for name, key in keys_of(kind).items()}
        return kind(**{name: value for name, value in values.items() if value is not None})

    def faults(self, place: Place) -> list[Problem]:
        """Values that do not fit together; ``place`` is where this table stands."""
        return [_problem(place, refused) for refused in type(self).declared.faults(self)]  # type: ignore[arg-type]


def _problem(place: Place, refused: Refused) -> Problem:
    parts = refused.key.split(".") if refused.key else []
    where = (*place, *(int(part) if part.isdigit() else part for part in parts))
    if refused.value is MISSING:
        return Problem(where, refused.reason)
    return Problem(where, refused.reason, refused.value)


def keys_of(kind: type[Declared]) -> dict[str, str]:
    """The key in a case file of each parameter of a class, its own parameters first."""
    mine = list(kind.__annotations__)
    found = {name: declared.key or name for name, declared, _ in declarations(kind)}
    return {name: found[name] for name in sorted(found, key=lambda name: name not in mine)}


def table_of(
    name: str,
    kind: type[Declared],
    base: type[Model] = DeclaredTable,
    tag: Mapping[str, tuple[Any, Any]] = MappingProxyType({}),
    optional: tuple[str, ...] = (),
) -> type[Any]:
    """The table of a class.

    Args:
        name: of the table's class.
        tag: keys beside the class's, which come first, with annotation and field.
    """
    hints = get_type_hints(kind)
    declared = {one: parameter for one, parameter, _ in declarations(kind)}
    defaults = {one.name: one.default for one in fields(kind)}  # type: ignore[arg-type]
    made = {
        key: _field(hints[one], declared[one], None if one in optional else defaults[one])
        for one, key in keys_of(kind).items()
    }
    keys: dict[str, Any] = {**tag, **made}
    table: type[Any] = create_model(
        name,
        __base__=base,
        __module__=__name__,
        __doc__=(kind.__doc__ or "").split("\n\n")[0],
        **keys,
    )
    table.declared = kind
    return table


def _field(hint: Any, declared: Parameter, default: Any) -> tuple[Any, Any]:
    """Annotation and field of a key."""
    many = type(None) in get_args(hint) or default is None or declared.follows is not None
    annotation = _annotation(hint, declared)
    if declared.same_as is not None:
        other = declared.same_as
        return annotation, Field(
            default_factory=lambda data: data.get(other, 0.0), description=declared.meaning
        )
    if many:
        return annotation | None, Field(default=None, description=declared.meaning)
    if default is MISSING and declared.otherwise is not None:
        default = declared.otherwise
    if default is MISSING:
        least = 1 if declared.most is not None else None
        return annotation, Field(
            min_length=least, max_length=declared.most, description=declared.meaning
        )
    return annotation, Field(default=default, description=declared.meaning)


def _annotation(hint: Any, declared: Parameter) -> Any:
    """Of a key that is there."""
    number = _quantity(declared.number)
    parts = get_args(hint) or (hint,)
    if declared.over is not None:
        pairs: Any = tuple[tuple[float, float], ...]
        over = _quantity(declared.over)
        if float not in parts:
            return Annotated[pairs, Rows(over, number)]
        return Annotated[float | pairs, NumberOrTable(over, number)]
    if declared.program:
        return Annotated[float | TimeTable, NumberOrProgram(number.unit, least=number.ge)]
    if hint is bool:
        return Flag
    if float in parts and declared.most is None:
        return Annotated[float, number]
    if declared.most is not None:
        return tuple[Annotated[float, number], ...]
    return hint


def _quantity(bounds: Bounds) -> Quantity:
    return Quantity(**asdict(bounds))
