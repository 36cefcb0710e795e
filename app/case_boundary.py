"""The `[[boundary]]` and `[[stage]]` tables of a case file: what is held, pressed and moved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from app.case_model import Count, Flag, Model, Place, Problem, Text
from app.quantities import Quantity
from app.quantity_tables import Program, TimeTable

DRIVEN = "driven"
_STEADY_KEYS = (
    "slip_step",
    "min_steps",
    "max_steps",
    "steady_tolerance",
    "film_stress_limit",
)

_Displacement = Annotated[TimeTable | Literal["driven"], Program("m", word=DRIVEN)]
_Velocity = Annotated[TimeTable, Program("m/s")]
_Pressure = Annotated[TimeTable, Program("Pa")]
_Force = Annotated[TimeTable, Program("N")]


class Displacement(Model):
    """Prescribed components of the displacement."""

    x: _Displacement | None = Field(
        default=None,
        description='displacement in x, or "driven": moved with the velocity of the stage',
    )
    y: _Displacement | None = Field(
        default=None,
        description='displacement in y, or "driven": moved with the velocity of the stage',
    )


class Velocity(Model):
    """Prescribed components of the velocity; they are integrated in time."""

    x: _Velocity | None = Field(default=None, description="velocity in x")
    y: _Velocity | None = Field(default=None, description="velocity in y")


class Platen(Model):
    """A rigid platen glued to the surface in one direction: one displacement, a given force."""

    direction: Literal["x", "y"] = Field(description="direction in which the platen moves")
    pressure: _Pressure | None = Field(
        default=None, description="force over reference area, > 0 presses into the body (or force)"
    )
    force: _Force | None = Field(
        default=None,
        description="total force on the slab of the given thickness, > 0 presses into the body "
        "(or pressure)",
    )


class Boundary(Model):
    """What is done to one named surface."""

    surface: Text = Field(description="name of the surface")
    displacement: Displacement | None = Field(default=None, description="prescribed displacement")
    velocity: Velocity | None = Field(default=None, description="prescribed velocity")
    platen: Platen | None = Field(default=None, description="rigid platen with a given force")
    pressure: _Pressure | None = Field(
        default=None,
        description="pressure normal to the deformed surface, > 0 presses into the body",
    )

    def prescribed(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Components (x, y) that this boundary decides, each with the keys that do it."""
        for key, table in (("displacement", self.displacement), ("velocity", self.velocity)):
            for component in ("x", "y"):
                if table is not None and getattr(table, component) is not None:
                    yield component, (key, component)
        if self.platen is not None:
            yield self.platen.direction, ("platen", "direction")

    def driven_components(self) -> tuple[str, ...]:
        """Components (x, y) that move with the velocity of the stage."""
        table = self.displacement
        return tuple(c for c in ("x", "y") if table is not None and getattr(table, c) == DRIVEN)

    def problems(self, place: Place) -> Iterator[Problem]:
        """What does not fit together, `place` being this table's place in the case."""
        if not any(self.prescribed()) and self.pressure is None:
            reason = "does nothing; give displacement, velocity, platen or pressure"
            yield Problem(place, reason)
        platen = self.platen
        if platen is not None and (platen.pressure is None) == (platen.force is None):
            found = "neither" if platen.force is None else "both"
            yield Problem((*place, "platen"), f"give either pressure or force, found {found}")


def boundary_problems(boundaries: Sequence[Boundary], place: Place) -> Iterator[Problem]:
    """What is wrong with the boundaries, each by itself and together."""
    decided: dict[tuple[str, str], str] = {}
    for index, boundary in enumerate(boundaries):
        yield from boundary.problems((*place, index))
        for component, keys in boundary.prescribed():
            here = (*place, index, *keys)
            name = ".".join(map(str, here))
            first = decided.setdefault((boundary.surface, component), name)
            if first != name:
                reason = f'"{boundary.surface}" is already moved in {component} by {first}'
                yield Problem(here, reason)


class Stage(Model):
    """One part of the run: a duration, or a list of velocities each held until steady."""

    name: Text = Field(description="name of the stage in results and messages")
    duration: Annotated[float, Quantity("s", gt=0.0)] | None = Field(
        default=None, description="length of the stage (or velocities)"
    )
    steps: Count = Field(default=10, description="number of equal steps; with duration")
    velocity: Annotated[float, Quantity("m/s")] | None = Field(
        default=None, description="velocity of driven boundaries; with duration"
    )
    velocities: tuple[Annotated[float, Quantity("m/s", nonzero=True)], ...] = Field(
        default=(),
        description="velocities of driven boundaries, one after the other, each until the "
        "tangential force is steady (or duration)",
    )
    slip_step: Annotated[float, Quantity("m", gt=0.0)] | None = Field(
        default=None, description="driven displacement in one step; needed with velocities"
    )
    min_steps: Count = Field(
        default=5, description="fewest steps at each velocity; with velocities"
    )
    max_steps: Count = Field(
        default=200, description="most steps at each velocity; with velocities"
    )
    steady_tolerance: Annotated[float, Quantity(gt=0.0)] = Field(
        default=1e-4,
        description="relative change of the tangential force per step, over the last 3 steps, "
        "below which it is steady; with velocities",
    )
    film_stress_limit: Annotated[float, Quantity("Pa", gt=0.0)] | None = Field(
        default=None,
        description="velocities at which the film stress eta_b V/D of a contact would exceed this "
        "are left out; with velocities",
    )
    rate_dependent: Flag = Field(
        default=True, description="whether the film and velocity effects act in this stage"
    )

    @property
    def is_driven(self) -> bool:
        """Whether driven boundaries move in this stage."""
        return bool(self.velocities) or self.velocity is not None

    def velocities_within(self, film_conductance: float) -> tuple[float, ...]:
        """The velocities (m/s) that the limit on the film's stress leaves.

        Args:
            film_conductance: Pa s/m, largest eta_b/D of all contacts; 0 without a film.
        """
        if self.film_stress_limit is None:
            return self.velocities
        limit = self.film_stress_limit
        return tuple(v for v in self.velocities if film_conductance * abs(v) <= limit)

    @model_serializer(mode="wrap")
    def _without_idle_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out the keys that mean nothing in this kind of stage."""
        idle = (
            ("duration", "steps", "velocity") if self.velocities else ("velocities", *_STEADY_KEYS)
        )
        return {key: value for key, value in handler(self).items() if key not in idle}

    def problems(self, place: Place) -> Iterator[Problem]:
        """What does not fit together, `place` being this table's place in the case."""
        given = self.model_fields_set
        if "velocities" in given and not self.velocities:
            yield Problem((*place, "velocities"), "must hold at least one velocity", [])
        elif not self.velocities and self.duration is None:
            yield Problem(place, "give either duration (with steps) or velocities (with slip_step)")
        elif self.velocities:
            for key in ("duration", "steps", "velocity"):
                if key in given:
                    reason = "does not go with velocities, whose stages last until steady"
                    yield Problem((*place, key), reason)
            if self.slip_step is None:
                reason = 'missing; velocities need the displacement in one step, such as "0.5 um"'
                yield Problem((*place, "slip_step"), reason)
            if self.max_steps < self.min_steps:
                reason = f"must be >= min_steps = {self.min_steps}"
                yield Problem((*place, "max_steps"), reason, self.max_steps)
        else:
            for key in _STEADY_KEYS:
                if key in given:
                    yield Problem((*place, key), "goes with velocities only, not with duration")


def stage_problems(
    stages: Sequence[Stage], boundaries: Sequence[Boundary], place: Place
) -> Iterator[Problem]:
    """What is wrong with the stages, each by itself and together; else with the boundaries."""
    found: list[Problem] = []
    names: set[str] = set()
    for index, stage in enumerate(stages):
        found.extend(stage.problems((*place, index)))
        if stage.name in names:
            reason = "two stages have this name"
            found.append(Problem((*place, index, "name"), reason, stage.name))
        names.add(stage.name)
    yield from found or _driving_problems(stages, boundaries, place)


def _driving_problems(
    stages: Sequence[Stage], boundaries: Sequence[Boundary], place: Place
) -> Iterator[Problem]:
    """Velocities without a driven boundary, or the other way round."""
    movers = [
        ("boundary", index, "displacement", component)
        for index, boundary in enumerate(boundaries)
        for component in boundary.driven_components()
    ]
    moving = [index for index, stage in enumerate(stages) if stage.is_driven]
    if moving and not movers:
        key = "velocities" if stages[moving[0]].velocities else "velocity"
        reason = 'moves nothing: no boundary has displacement = { x = "driven" } (or y)'
        yield Problem((*place, moving[0], key), reason)
    if movers and not moving:
        reason = "never moves: no stage has velocity or velocities"
        yield Problem(movers[0], reason, DRIVEN)
