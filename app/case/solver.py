"""The `[solver]`, `[output]` and `[sweep]` tables of a case file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    PlainValidator,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
)
from pydantic_core import PydanticCustomError

from tribox.app.case.petsc import option_problems
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import (
    MOST_ENTRIES,
    Count,
    CountOrZero,
    Flag,
    Model,
    Place,
    Problem,
    Text,
    problems_error,
)

_LETTERS = "A-Za-z0-9.+=_%µμ-"
LABEL = re.compile(rf"[{_LETTERS}]*=[{_LETTERS}]*")
"""What the name of a directory looks like that a value of a sweep gets."""
LONGEST_LABEL = 200
"""Bytes of such a name; file systems take 255."""


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


class MassScaling(Model):
    """Mass added so that an explicit step may be longer."""

    kind: Literal["uniform", "limiting"] = Field(
        default="limiting",
        description='"uniform" raises every density by a factor, "limiting" adds mass only to the '
        "elements that would ask for a shorter step than `step`",
    )
    factor: Annotated[float, Quantity(ge=1.0)] | None = Field(
        default=None, description="factor of all densities; with uniform"
    )
    step: Annotated[float, Quantity("s", gt=0.0)] | None = Field(
        default=None,
        description="time step, before step_safety, that the mass has to allow; needed with "
        "limiting, instead of a factor with uniform",
    )

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        if self.kind == "limiting":
            if self.factor is not None:
                reason = 'goes with kind = "uniform" only; limiting elements need step'
                yield Problem((*place, "factor"), reason, self.factor)
            elif self.step is None:
                yield Problem((*place, "step"), 'missing; the step to reach, such as "1e-7 s"')
        elif (self.factor is None) == (self.step is None):
            found = "neither" if self.step is None else "both"
            yield Problem(place, f"give either factor or step, found {found}")


EXPLICIT_KEYS = ("step_safety", "damping", "mass_scaling", "viscous", "kinetic_limit")


class Solver(Model):
    """How the equations are solved."""

    kind: Literal["implicit", "explicit"] = Field(
        default="implicit",
        description="time integration: implicit quasi-static, or explicit dynamic (stages may "
        "choose for themselves)",
    )
    tolerance: Annotated[float, Quantity(gt=0.0, lt=1.0)] = Field(
        default=1e-8,
        description="residual at which a step is solved, relative to the contact force",
    )
    max_iterations: Count = Field(default=25, description="most Newton iterations in one attempt")
    min_step_fraction: Annotated[float, Quantity(gt=0.0, le=1.0)] = Field(
        default=1e-4, description="smallest part of a step that is tried before giving up"
    )
    linear: Literal["auto", "direct", "krylov"] = Field(
        default="auto",
        description="linear solver: MUMPS, or GMRES with algebraic multigrid; auto: by size",
    )
    partition: Literal["contact", "cells"] = Field(
        default="contact",
        description="what ranks share out evenly: cells and slave facets, or cells only",
    )
    petsc: dict[Text, PetscValue] = Field(
        default={},
        description='PETSc options of the implicit solver: name without "-", and a number, true, '
        "false or a word; those that print, name files or run code are refused",
    )

    step_safety: Annotated[float, Quantity(gt=0.0, le=1.0)] = Field(
        default=0.9, description="time step over the stable step; explicit only"
    )
    damping: Annotated[float, Quantity("1/s", ge=0.0)] = Field(
        default=0.0,
        description="c of the mass-proportional damping force c m v; explicit only",
    )
    mass_scaling: MassScaling | None = Field(
        default=None, description="mass added for a longer step; explicit only"
    )
    viscous: Literal["semi-implicit", "bounded"] = Field(
        default="semi-implicit",
        description="the film's viscous stress: solved for at each point, so that it does not "
        "limit the step, or explicit and in the bound of the step; explicit only",
    )
    kinetic_limit: Annotated[float, Quantity(gt=0.0)] = Field(
        default=0.05,
        description="kinetic over strain energy above which a run with scaled mass warns; "
        "explicit only",
    )

    @field_validator("petsc")
    @classmethod
    def _only_allowed(cls, options: dict[str, Any]) -> dict[str, Any]:
        """Options that say how a system is solved, and nothing else."""
        if problems := list(option_problems(options)):
            raise problems_error(problems)
        return options

    @model_serializer(mode="wrap")
    def _without_idle_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out the keys that an implicit run has no use for."""
        idle = () if self.kind == "explicit" else EXPLICIT_KEYS
        return {key: value for key, value in handler(self).items() if key not in idle}

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        if self.kind == "implicit":
            for key in EXPLICIT_KEYS:
                if key in self.model_fields_set:
                    yield Problem((*place, key), 'goes with kind = "explicit" only')
        elif self.mass_scaling is not None:
            yield from self.mass_scaling.problems((*place, "mass_scaling"))


class Output(Model):
    """The files that are written beside the history."""

    fields_every: CountOrZero = Field(
        default=1,
        description="steps between two outputs of the fields; 0 writes them only at the end of "
        "each stage and velocity",
    )
    formats: tuple[Literal["vtu", "adios2"], ...] = Field(
        default=("vtu",),
        min_length=1,
        description='files of the fields: "vtu" is written by the first rank and opens anywhere, '
        '"adios2" by every rank for itself (fields.bp, stress.bp)',
    )
    figures: Flag = Field(default=True, description="whether figures are drawn at the end")
    checkpoint_every: CountOrZero = Field(
        default=0, description="steps between two checkpoints; 0 for none by steps"
    )
    checkpoint_interval: Annotated[float, Quantity("s", gt=0.0)] = Field(
        default=600.0,
        description="time on the clock between two checkpoints; one is written in any case when a "
        "run ends, is stopped or fails",
    )
    checkpoints_kept: CountOrZero = Field(
        default=2, description="checkpoints that are kept, the latest; 0 writes none"
    )


class Sweep(Model):
    """One key of the case, run with several values."""

    key: Text = Field(
        description="dotted key to change, list entries by number, such as contact.0.film.thickness"
    )
    values: tuple[Any, ...] = Field(
        min_length=1,
        max_length=MOST_ENTRIES,
        description="the values, each written as it would be at the key itself",
    )

    @property
    def labels(self) -> tuple[str, ...]:
        """One name for each value, such as "thickness=10nm", usable for a directory.

        Files are called by their names alone where these differ: wherever they are.
        """
        last, texts = self.key.rsplit(".", 1)[-1], [_as_text(value) for value in self.values]
        if self.names_files and len({Path(text).name for text in texts}) == len(texts):
            texts = [Path(text).name for text in texts]
        return tuple(_as_name(f"{last}={text}") for text in texts)

    @property
    def names_files(self) -> bool:
        """Whether the values are names of files: of meshes, or of laws in Python."""
        return self.key.rsplit(".", 1)[-1] in ("mesh", "class")


def _as_text(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return "x".join(map(_as_text, value))
    return str(value)


def _as_name(text: str) -> str:
    """Text without spaces and without what a directory name or a shell would stumble over."""
    spaceless = re.sub(r"(?<=\d)\s+(?=\D)", "", text.strip())
    return re.sub(rf"[^{_LETTERS}]+", "_", spaceless)
