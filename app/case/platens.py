"""Surfaces that move as one in `[[boundary]]` tables: platens, and springs that draw them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

from tribox.app.case.quantities import Quantity, QuantityError, Written
from tribox.app.case.table import Flag, Model, Place, Problem, Text
from tribox.app.case.time_tables import COMPONENTS, Component, Program, TimeTable, Travel

_Pressure = Annotated[TimeTable, Program("Pa")]
_Force = Annotated[TimeTable, Program("N")]
_Way = Annotated[TimeTable, Program("m")]
_Mass = Annotated[float, Quantity("kg", ge=0.0)]
_MASS = "mass the surface carries beside its own, for the given thickness; explicit only"


@dataclass(frozen=True, slots=True)
class AnyDirection(Written):
    """Pydantic annotation of a direction: "x", "y" or "z", or its components [x, y] or [x, y, z].

    The field is the letter, or the components as given. Components along an axis become its letter.
    """

    def parse(self, value: object) -> str | tuple[float, ...]:
        """The direction.

        Raises:
            PydanticCustomError: it is none.
        """
        if isinstance(value, str) and value in COMPONENTS:
            return value
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise _no_direction('must be "x", "y" or "z", or components such as [0.6, 0.8]')
        if len(value) not in (2, 3):
            raise _no_direction("must have two components in the plane, three in space")
        try:
            parts = tuple(Quantity().parse(part) for part in value)
        except QuantityError as error:
            raise _no_direction(f"components: {error}") from None
        along = [name for name, part in zip(COMPONENTS, parts, strict=False) if part != 0.0]
        if not along:
            raise _no_direction("must not be zero in all components")
        return along[0] if len(along) == 1 else parts

    def serialise(self, value: str | tuple[float, ...]) -> object:
        """The name, or components."""
        return value if isinstance(value, str) else list(value)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        components = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 3}
        return {"anyOf": [{"enum": list(COMPONENTS)}, components]}


def _no_direction(reason: str) -> PydanticCustomError:
    return PydanticCustomError("direction", "{reason}", {"reason": reason})


def direction_components(direction: str | tuple[float, ...]) -> tuple[str, ...]:
    """The components (x, y, z) that a direction has a part in."""
    if isinstance(direction, str):
        return (direction,)
    return tuple(c for c, part in zip(COMPONENTS, direction, strict=False) if part != 0.0)


def unit_vector(direction: str | tuple[float, ...], dim: int) -> tuple[float, ...]:
    """A direction as a vector of length one in ``dim`` dimensions."""
    if isinstance(direction, str):
        return tuple(float(name == direction) for name in COMPONENTS[:dim])
    length = math.hypot(*direction)
    return tuple(part / length for part in direction)


class Platen(Model):
    """A rigid platen glued to the surface in one direction: one displacement, a given force.

    In some stages its displacement may be given instead, and the force follows.
    """

    direction: Annotated[str | tuple[float, ...], AnyDirection()] = Field(
        description='direction in which the platen moves: "x", "y", "z", or the components of any '
        "other, [x, y] or [x, y, z]; either sense of it is the same"
    )
    pressure: _Pressure | None = Field(
        default=None, description="force over reference area, > 0 presses into the body (or force)"
    )
    force: _Force | None = Field(
        default=None,
        description="total force, > 0 presses into the body (or pressure); in plane strain on the "
        "slab of the given thickness",
    )
    displacement: _Way | None = Field(
        default=None,
        description="displacement, > 0 into the body, in the stages of displacement_stages, where "
        "it takes the place of the force",
    )
    displacement_stages: tuple[Text, ...] = Field(
        default=(),
        description="names of the stages in which the displacement is given and not the force",
    )
    hold_force: Flag = Field(
        default=False,
        description="after stages of displacement_stages, hold the force that was reached at their "
        "end, instead of going back to pressure or force (which are not needed then)",
    )
    mass: _Mass = Field(default=0.0, description=_MASS)

    @property
    def is_oblique(self) -> bool:
        """Whether it moves along no axis."""
        return not isinstance(self.direction, str)

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        neither = self.pressure is None and self.force is None
        if self.hold_force and not self.displacement_stages:
            reason = "holds what displacement_stages end with, and there are none"
            yield Problem((*place, "hold_force"), reason, True)
        if (self.pressure is None) == (self.force is None) and not (neither and self.hold_force):
            found = "neither" if self.force is None else "both"
            yield Problem(place, f"give either pressure or force, found {found}")
        if self.displacement is not None and not self.displacement_stages:
            reason = 'missing; displacement acts in the stages named here, such as ["press"]'
            yield Problem((*place, "displacement_stages"), reason)
        if self.displacement is None and self.displacement_stages:
            reason = "missing; displacement_stages says where it takes the place of the force"
            yield Problem((*place, "displacement"), reason)

    def stage_problems(self, solvers: Mapping[str, str], place: Place) -> Iterator[Problem]:
        """Stages that are not there, or not implicit.

        Args:
            solvers: time integration of each stage by its name.
            place: where this table stands in the case.
        """
        here = (*place, "displacement_stages")
        for name in self.displacement_stages:
            if name not in solvers:
                reason = f"no stage has this name; there are {', '.join(solvers)}"
                yield Problem(here, reason, name)
        if "explicit" not in solvers.values():
            return
        if self.displacement_stages:
            reason = "does not go with explicit stages; a platen's force is given in all of them"
            yield Problem(here, reason, list(self.displacement_stages))
        if self.is_oblique:
            reason = 'does not go with explicit stages unless it is "x", "y" or "z"'
            yield Problem((*place, "direction"), reason, list(self.direction))


class Spring(Model):
    """A surface moved as one in one direction, drawn by a spring whose far end is moved."""

    direction: Component = Field(description="direction in which the surface moves as one")
    stiffness: Annotated[float, Quantity("N/m", gt=0.0)] = Field(
        description="of the spring, for the slab of the given thickness"
    )
    end: Travel = Field(
        description='displacement of the spring\'s far end, or "driven": moved with the velocity '
        "of the stage"
    )
    mass: _Mass = Field(default=0.0, description=_MASS)
