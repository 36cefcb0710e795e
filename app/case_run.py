"""The `[solver]`, `[output]` and `[sweep]` tables of a case file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from app.case_model import Count, CountOrZero, Flag, Model, Place, Problem, Text
from app.quantities import Quantity


def _petsc_value(value: object) -> object:
    """A PETSc option's value as it stands."""
    if not isinstance(value, str | int | float):
        raise PydanticCustomError("petsc", "must be text, a number, true or false")
    if isinstance(value, float) and not math.isfinite(value):
        raise PydanticCustomError("petsc", "must be finite")
    return value


PetscValue = Annotated[
    str | int | float | bool,
    PlainValidator(_petsc_value, json_schema_input_type=str | int | float | bool),
]


class Solver(Model):
    """How the equations are solved."""

    kind: Literal["implicit", "explicit"] = Field(
        default="implicit", description='time integration; "explicit" is not available yet'
    )
    tolerance: Annotated[float, Quantity(gt=0.0, lt=1.0)] = Field(
        default=1e-8,
        description="residual at which a step is solved, relative to the contact force",
    )
    max_iterations: Count = Field(default=25, description="most Newton iterations in one step")
    min_step_fraction: Annotated[float, Quantity(gt=0.0, le=1.0)] = Field(
        default=1e-4, description="smallest part of a step that is tried before giving up"
    )
    linear: Literal["auto", "direct", "krylov"] = Field(
        default="auto",
        description="linear solver: MUMPS, or GMRES with algebraic multigrid; auto: by size",
    )
    petsc: dict[Text, PetscValue] = Field(
        default={}, description='PETSc options, passed through: name without "-", and value'
    )

    def problems(self, place: Place) -> Iterator[Problem]:
        """What is not available, `place` being this table's place in the case."""
        if self.kind == "explicit":
            yield Problem((*place, "kind"), 'not available yet; use "implicit"', self.kind)


class Output(Model):
    """What is written beside the history."""

    fields_every: CountOrZero = Field(
        default=1,
        description="steps between two outputs of the fields; 0 writes them only at the end of "
        "each stage and velocity",
    )
    figures: Flag = Field(default=True, description="whether figures are drawn at the end")


class Sweep(Model):
    """One key of the case, run with several values."""

    key: Text = Field(
        description="dotted key to change, list entries by number, such as contact.0.film.thickness"
    )
    values: tuple[Any, ...] = Field(
        min_length=1, description="the values, each written as it would be at the key itself"
    )

    @property
    def labels(self) -> tuple[str, ...]:
        """One name for each value, such as "thickness=10nm", usable for a directory."""
        last = self.key.rsplit(".", 1)[-1]
        return tuple(_as_name(f"{last}={_as_text(value)}") for value in self.values)


def _as_text(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return "x".join(map(_as_text, value))
    return str(value)


def _as_name(text: str) -> str:
    """Text without spaces and without what a directory name or a shell would stumble over."""
    spaceless = re.sub(r"(?<=\d)\s+(?=\D)", "", text.strip())
    return re.sub(r"[^A-Za-z0-9.+=_%µμ-]+", "_", spaceless)
