"""The `[[stage]]` tables of a case file: the parts of a run, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from tribox.app.case.boundary import DRIVEN, Boundary
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import MOST_ENTRIES, Count, Flag, Model, Name, Place, Problem, Text
from tribox.app.case.time_tables import smooth_step, smooth_step_integral
from tribox.app.case.tools import Tool

_STEADY_KEYS = ("slip_step", "min_steps", "max_steps", "steady_tolerance", "film_stress_limit")


class Stage(Model):
    """One part of the run: a duration, or velocities, each kept until the force is steady."""

    name: Name
    """name of the stage in results and messages"""
    duration: Annotated[float, Quantity("s", gt=0.0)] | None = None
    """length of the stage (or velocities)"""
    steps: Count = 10
    """number of equal steps; with duration"""
    velocity: Annotated[float, Quantity("m/s")] | None = None
    """velocity of driven boundaries; with duration"""
    velocities: tuple[Annotated[float, Quantity("m/s", nonzero=True)], ...] = Field(
        default=(), max_length=MOST_ENTRIES
    )
    """velocities of driven boundaries, one after the other, each until the tangential force is
    steady (or duration)"""
    slip_step: Annotated[float, Quantity("m", gt=0.0)] | None = None
    """driven displacement in one step; needed with velocities"""
    min_steps: Count = 5
    """fewest steps at each velocity; with velocities"""
    max_steps: Count = 200
    """most steps at each velocity; with velocities"""
    steady_tolerance: Annotated[float, Quantity(gt=0.0, lt=1.0)] = 1e-4
    """relative change of the tangential force, without known weakening, over the elastic lengths
    and the last eighth of the way slid, below which it is steady; with velocities"""
    film_stress_limit: Annotated[float, Quantity("Pa", gt=0.0)] | None = None
    """velocities at which the film stress eta_b V/D of a contact would exceed this are left out;
    with velocities"""
    rate_dependent: Flag = True
    """whether the film and velocity effects act in this stage"""
    solver: Literal["implicit", "explicit"] | None = None
    """time integration of this stage; default: that of [solver]. Implicit stages come before
    explicit ones"""
    ramp: Annotated[float, Quantity("s", ge=0.0)] = 0.0
    """time in which driven boundaries change smoothly to their new velocity, at the start of the
    stage and of each of its velocities"""
    relax: Flag = False
    """bring the bodies to rest: all velocities are set to zero at each peak of the kinetic energy
    (dynamic relaxation); explicit only"""
    release: tuple[Text, ...] = ()
    """surfaces whose displacements are given up, and tools and contact pairs whose forces are:
    reactions and contact forces are taken off evenly over the stage, and do not come back in the
    rest of the run; with duration"""

    @property
    def is_driven(self) -> bool:
        """Whether driven boundaries move in this stage."""
        return bool(self.velocities) or self.velocity is not None

    def velocities_within(self, film_conductance: float) -> tuple[float, ...]:
        """Velocities, m/s, below the film's stress limit; of the largest eta_b/D, Pa s/m."""
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
        kept = {key: value for key, value in handler(self).items() if key not in idle}
        return {key: value for key, value in kept.items() if key != "release" or value}

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
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
            if self.duration is not None and self.ramp > self.duration:
                reason = f"must be <= duration = {self.duration:g} s"
                yield Problem((*place, "ramp"), reason, self.ramp)
        if self.relax and self.is_driven:
            yield Problem((*place, "relax"), "does not go with a velocity: nothing comes to rest")
        if self.ramp and not self.is_driven:
            yield Problem((*place, "ramp"), "goes with velocity or velocities only", self.ramp)


def stage_problems(
    stages: Sequence[Stage],
    boundaries: Sequence[Boundary],
    place: Place,
    tools: Mapping[str, Tool] | None = None,
) -> Iterator[Problem]:
    """Mistakes in the stages, each by itself and together; without any, in what they drive."""
    found: list[Problem] = []
    names: set[str] = set()
    for index, stage in enumerate(stages):
        found.extend(stage.problems((*place, index)))
        if stage.name in names:
            reason = "two stages have this name"
            found.append(Problem((*place, index, "name"), reason, stage.name))
        names.add(stage.name)
    yield from found or _driving_problems(stages, boundaries, place, tools or {})


def release_problems(
    stages: Sequence[Stage],
    holding: Mapping[str, str],
    acts: Callable[[str, str], bool],
    default: str,
    place: Place,
) -> Iterator[Problem]:
    """Releases of what holds or presses nothing, and where there are no forces.

    ``holding``: what may be released, by name: "surface", "tool", "contact pair", or two of them.
    """
    released: dict[str, str] = {}
    for index, stage in enumerate(stages):
        here = (*place, index, "release")
        if stage.release and index == 0:
            reason = "the first stage has no reactions or contact forces to release"
            yield Problem(here, reason, list(stage.release))
        if stage.release and stage.velocities:
            yield Problem(here, "goes with duration only: reactions are taken off over it")
        if stage.release and solver_of(stage, default) == "explicit":
            yield Problem(here, "goes with implicit stages only", list(stage.release))
        for name in stage.release:
            kind = holding.get(name)
            if kind is None:
                known = ", ".join(holding) or "none"
                reason = (
                    "no boundary holds or moves a surface of this name, and no tool in contact or "
                    f"contact pair has it; there are: {known}"
                )
                yield Problem(here, reason, name)
            elif " and " in kind:
                yield Problem(here, f"is the name of a {kind}; give the pair another name", name)
            elif name in released:
                reason = f"is released in stage {released[name]} already"
                yield Problem(here, reason, name)
            elif index and kind != "surface" and not acts(name, stages[index - 1].name):
                reason = f"does not act in stage {stages[index - 1].name}, the one before"
                yield Problem(here, reason, name)
            released.setdefault(name, stage.name)


def solver_of(stage: Stage, default: str) -> str:
    """Time integration of a stage, `default` being that of [solver]."""
    return stage.solver or default


def order_problems(stages: Sequence[Stage], default: str, place: Place) -> Iterator[Problem]:
    """Implicit stages after explicit ones, and explicit means in implicit stages."""
    last = ""
    for index, stage in enumerate(stages):
        kind = solver_of(stage, default)
        if stage.solver == "explicit" and default == "implicit":
            reason = 'needs solver.kind = "explicit", which may leave stages "implicit"'
            yield Problem((*place, index, "solver"), reason, stage.solver)
            return
        if kind == "implicit" and last == "explicit":
            reason = f'"implicit" cannot follow the explicit stage {stages[index - 1].name}'
            yield Problem((*place, index, "solver"), reason, stage.solver)
        if kind == "implicit" and stage.relax:
            reason = "goes with explicit stages only: an implicit step ends in equilibrium"
            yield Problem((*place, index, "relax"), reason)
        last = kind


def _driving_problems(
    stages: Sequence[Stage], boundaries: Sequence[Boundary], place: Place, tools: Mapping[str, Tool]
) -> Iterator[Problem]:
    """Velocities without a driven boundary, or the other way round."""
    movers: list[Place] = [
        ("boundary", index, *keys)
        for index, boundary in enumerate(boundaries)
        for keys in boundary.driven_keys()
    ]
    movers += [
        ("tools", name, *keys) for name, tool in tools.items() for keys in tool.driven_keys()
    ]
    moving = [index for index, stage in enumerate(stages) if stage.is_driven]
    if moving and not movers:
        key = "velocities" if stages[moving[0]].velocities else "velocity"
        reason = (
            'moves nothing: no boundary has displacement = { x = "driven" } (or y, z), or a '
            "spring, and no tool"
        )
        yield Problem((*place, moving[0], key), reason)
    if movers and not moving:
        reason = "never moves: no stage has velocity or velocities"
        yield Problem(movers[0], reason, DRIVEN)


# -- Load steps: the stretches of a stage with one velocity of the driven boundaries ---------------


@dataclass(frozen=True, slots=True)
class LoadStep:
    """A stretch of a stage with one velocity and one length of step."""

    stage: Stage  # the stage it belongs to
    velocity: float  # m/s, of driven boundaries
    dt: float  # s, the step asked for; in explicit stages the interval between two rows
    steps: int | None  # number of such steps; None: until steady
    before: float = 0.0  # m/s, velocity of driven boundaries when the load step begins

    @property
    def label(self) -> str:
        """Name for messages and results."""
        return (
            f"{self.stage.name} {self.velocity:g} m/s" if self.stage.velocities else self.stage.name
        )

    def travel(self, time: float) -> float:
        """Displacement of driven boundaries after ``time`` (s) of the load step, m.

        The velocity goes from that before to the load step's own, smoothly within ``ramp``.
        """
        ramp = self.stage.ramp
        if ramp <= 0.0:
            return self.velocity * time
        eased = ramp * smooth_step_integral(time / ramp)
        return self.before * time + (self.velocity - self.before) * eased

    def speed(self, time: float) -> float:
        """Velocity of driven boundaries after ``time`` (s) of the load step, m/s."""
        ramp = self.stage.ramp
        if ramp <= 0.0:
            return self.velocity
        return self.before + (self.velocity - self.before) * smooth_step(time / ramp)


def load_steps_of(
    stage: Stage, film_conductance: float = 0.0, before: float = 0.0
) -> Iterator[LoadStep]:
    """The load steps of a stage: one for each velocity, or one for its duration.

    ``film_conductance``: largest eta_b/D, Pa s/m; ``before``: m/s, of the stage before.
    """
    for velocity in stage.velocities_within(film_conductance):
        assert stage.slip_step is not None
        yield LoadStep(stage, velocity, stage.slip_step / abs(velocity), None, before)
        before = velocity
    if not stage.velocities:
        assert stage.duration is not None
        velocity = stage.velocity or 0.0
        yield LoadStep(stage, velocity, stage.duration / stage.steps, stage.steps, before)
