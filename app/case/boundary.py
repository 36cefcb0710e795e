"""The `[[boundary]]` tables of a case file: supports, motions and loads of surfaces."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError

from tribox.app.case.quantities import Quantity, QuantityError, Written
from tribox.app.case.table import Flag, Model, Place, Problem, Text, size_problems
from tribox.app.case.time_tables import (
    COMPONENTS,
    DRIVEN,
    Component,
    Displacement,
    Program,
    Rotation,
    TimeTable,
    Travel,
    Velocity,
)

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section

_Pressure = Annotated[TimeTable, Program("Pa")]
_Force = Annotated[TimeTable, Program("N")]
_Way = Annotated[TimeTable, Program("m")]
_Mass = Annotated[float, Quantity("kg", ge=0.0)]
_MASS = "mass the surface carries beside its own, for the given thickness; explicit only"


class Direction(Written):
    """Pydantic annotation of a direction: "x", "y" or "z", or its components [x, y] or [x, y, z].

    The field is a tuple of two or three components, of a letter three.
    """

    def parse(self, value: object) -> Any:
        """The components; PydanticCustomError if they are none."""
        if isinstance(value, str) and value in COMPONENTS:
            return tuple(float(name == value) for name in COMPONENTS)
        if isinstance(value, str) or not isinstance(value, Sequence):
            raise _no_direction('must be "x", "y" or "z", or components such as [0.6, 0.8]')
        if len(value) not in (2, 3):
            raise _no_direction("must have two components in the plane, three in space")
        try:
            parts = tuple(Quantity().parse(part) for part in value)
        except QuantityError as error:
            raise _no_direction(f"components: {error}") from None
        if not any(parts):
            raise _no_direction("must not be zero in all components")
        return parts

    def serialise(self, value: Any) -> object:
        """The letter, or components."""
        return value if isinstance(value, str) else list(value)

    def json_schema(self) -> JsonSchemaValue:
        components = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 3}
        return {"anyOf": [{"enum": list(COMPONENTS)}, components]}


class Axis(Direction):
    """The same where either sense is meant: the field is the letter of an axis, or components."""

    def parse(self, value: object) -> str | tuple[float, ...]:
        """The letter or components; PydanticCustomError if they are none."""
        parts = Direction.parse(self, value)
        along = [name for name, part in zip(COMPONENTS, parts, strict=False) if part != 0.0]
        return along[0] if len(along) == 1 else parts


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

    direction: Annotated[str | tuple[float, ...], Axis()]
    """direction in which the platen moves: "x", "y", "z", or the components of any other, [x, y] or
    [x, y, z]; either sense of it is the same"""
    pressure: _Pressure | None = None
    """force over reference area, > 0 presses into the body (or force)"""
    force: _Force | None = None
    """total force, > 0 presses into the body (or pressure); in plane strain on the slab of the
    given thickness"""
    displacement: _Way | None = None
    """displacement, > 0 into the body, in the stages of displacement_stages, where it takes the
    place of the force"""
    displacement_stages: tuple[Text, ...] = ()
    """names of the stages in which the displacement is given and not the force"""
    hold_force: Flag = False
    """after stages of displacement_stages, hold the force that was reached at their end, instead of
    going back to pressure or force (which are not needed then)"""
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
        """Stages that are not there, or not implicit."""
        here = (*place, "displacement_stages")
        yield from named_stage_problems(self.displacement_stages, solvers, here)
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

    direction: Component
    """direction in which the surface moves as one"""
    stiffness: Annotated[float, Quantity("N/m", gt=0.0)]
    """of the spring, for the slab of the given thickness"""
    end: Travel
    """displacement of the spring's far end, or "driven": moved with the velocity of the stage"""
    mass: _Mass = Field(default=0.0, description=_MASS)


# -- Loads of `[[boundary]]` tables with components, elastic foundations, and `[gravity]` ----------

_Traction = Annotated[TimeTable, Program("Pa")]
_Acceleration = Annotated[TimeTable, Program("m/s^2")]
_Stiffness = Annotated[float, Quantity("Pa/m", ge=0.0)]
NO_Z = "there is no z in a mesh in the plane"


class _Vector(Model):
    """A load with components."""

    def given(self) -> tuple[str, ...]:
        """The components that are given."""
        return tuple(c for c in COMPONENTS if getattr(self, c) is not None)

    def at(self, time: float, dim: int) -> list[float]:
        """The components at ``time`` (s), those not given being zero."""
        tables = [getattr(self, c) for c in COMPONENTS[:dim]]
        return [0.0 if table is None else table(time) for table in tables]

    def problems(self, place: Place) -> Iterator[Problem]:
        """A load without components."""
        if not self.given():
            yield Problem(place, "has no component; give x, y or, in space, z")

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with what the mesh stands for."""
        if section != "3D" and "z" in self.given():
            yield Problem((*place, "z"), NO_Z)


class Traction(_Vector):
    """Force over reference area, which keeps its direction."""

    x: _Traction | None = None
    """traction in x"""
    y: _Traction | None = None
    """traction in y"""
    z: _Traction | None = None
    """traction in z, in 3D"""


class Force(_Vector):
    """A total force, which keeps its direction."""

    x: _Force | None = None
    """force in x"""
    y: _Force | None = None
    """force in y"""
    z: _Force | None = None
    """force in z, in 3D"""

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with what the mesh stands for."""
        yield from super().section_problems(section, place)
        if section == "axisymmetric" and self.x is not None:
            reason = "forces across the axis cancel round the ring; give a traction, or y only"
            yield Problem((*place, "x"), reason)


class FoundationBase(Model):
    """Displacement of what an elastic foundation stands on."""

    x: Travel | None = None
    """displacement in x, or "driven" """
    y: Travel | None = None
    """displacement in y, or "driven" """
    z: Travel | None = None
    """displacement in z, in 3D, or "driven" """


class Foundation(Model):
    """Springs all over a surface, per reference area."""

    normal: _Stiffness = 0.0
    """stiffness along the normal of the undeformed surface"""
    tangential: _Stiffness = 0.0
    """stiffness across the normal of the undeformed surface"""
    base: FoundationBase = FoundationBase()
    """displacement of the springs' other ends; default: they stay"""

    def driven_components(self) -> tuple[str, ...]:
        """Components of the base that move with the velocity of the stage."""
        return tuple(c for c in COMPONENTS if getattr(self.base, c) == DRIVEN)

    def base_at(self, time: float, driven: float, dim: int) -> list[float]:
        """Displacement of the base, m, at ``time`` (s) and a driven displacement (m)."""
        tables = [getattr(self.base, c) for c in COMPONENTS[:dim]]
        return [
            driven if table == DRIVEN else 0.0 if table is None else table(time) for table in tables
        ]

    def problems(self, place: Place) -> Iterator[Problem]:
        """A foundation without stiffness."""
        if self.normal == 0.0 and self.tangential == 0.0:
            yield Problem(place, 'has no stiffness; give normal, tangential or both, in "Pa/m"')

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with what the mesh stands for."""
        if section != "3D" and self.base.z is not None:
            yield Problem((*place, "base", "z"), NO_Z)
        if section == "axisymmetric" and self.base.x is not None:
            reason = "a base cannot move across the axis of symmetry; give y only"
            yield Problem((*place, "base", "x"), reason)


class Gravity(_Vector):
    """The `[gravity]` table: an acceleration that acts on the mass of all bodies."""

    x: _Acceleration | None = None
    """acceleration in x"""
    y: _Acceleration | None = None
    """acceleration in y"""
    z: _Acceleration | None = None
    """acceleration in z, in 3D"""
    stages: tuple[Text, ...] = ()
    """names of the stages in which it acts; default: all"""

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with what the mesh stands for."""
        yield from super().section_problems(section, place)
        if section == "axisymmetric" and self.x is not None:
            yield Problem((*place, "x"), "gravity must point along the axis of symmetry: give y")


# -- The `[[boundary]]` tables of a case file: supports, motions and loads of surfaces -------------

__all__ = ["COMPONENTS", "DRIVEN", "Boundary", "Platen", "Rotation", "Spring"]
_LOADS = ("pressure", "traction", "force", "foundation")


class Boundary(Model):
    """The supports, motions and loads of one named surface, or group of edges or points."""

    surface: Text
    """name of the surface; for displacement, velocity, rotation, spring and force also of a group
    of points, or in space of edges, of the mesh"""
    displacement: Displacement | None = None
    """prescribed displacement"""
    velocity: Velocity | None = None
    """prescribed velocity"""
    platen: Platen | None = None
    """rigid platen with a given force"""
    spring: Spring | None = None
    """spring that draws the surface, moved as one"""
    pressure: _Pressure | None = None
    """pressure normal to the deformed surface, > 0 presses into the body"""
    traction: Traction | None = None
    """force over reference area, by components; keeps its direction"""
    force: Force | None = None
    """total force by components, spread evenly over the reference area (the length of edges, or the
    points); keeps its direction; in plane strain on the slab of the given thickness"""
    foundation: Foundation | None = None
    """elastic foundation: springs all over the surface"""
    rotation: Rotation | None = None
    """rigid rotation of the surface"""
    symmetry: Flag = False
    """the flat surface is a plane of symmetry: it does not move along its normal, and slides freely
    in itself"""
    stages: tuple[Text, ...] = ()
    """names of the stages in which all of this acts; elsewhere loads are zero and motions free;
    default: all"""

    @property
    def holds(self) -> bool:
        """Whether it prescribes displacements, or ties them to each other."""
        return self.symmetry or any(self.prescribed())

    def acts_in(self, stage: str) -> bool:
        """Whether it acts in the stage of this name."""
        return not self.stages or stage in self.stages

    def meets(self, other: Boundary) -> bool:
        """Whether there is a stage in which both act."""
        return not self.stages or not other.stages or bool({*self.stages} & {*other.stages})

    def prescribed(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Components (x, y, z) that this boundary decides, each with the keys that do it."""
        for key, table in (("displacement", self.displacement), ("velocity", self.velocity)):
            for component in COMPONENTS:
                if table is not None and getattr(table, component) is not None:
                    yield component, (key, component)
        if self.platen is not None:
            for component in direction_components(self.platen.direction):
                yield component, ("platen", "direction")
        if self.rotation is not None:
            for component in self.rotation.decided():
                yield component, ("rotation",)
        if self.spring is not None:
            yield self.spring.direction, ("spring", "direction")

    def driven_components(self) -> tuple[str, ...]:
        """Components that move with the velocity of the stage."""
        return () if self.displacement is None else self.displacement.driven_components()

    def driven_keys(self) -> Iterator[tuple[str, ...]]:
        """The keys that say "driven"."""
        for component in self.driven_components():
            yield "displacement", component
        if self.spring is not None and self.spring.end == DRIVEN:
            yield "spring", "end"
        if self.foundation is not None:
            for component in self.foundation.driven_components():
                yield "foundation", "base", component

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        if not self.holds and all(getattr(self, key) is None for key in _LOADS):
            reason = (
                "does nothing; give displacement, velocity, platen, spring, rotation, symmetry, "
                f"{', '.join(_LOADS[:-1])} or {_LOADS[-1]}"
            )
            yield Problem(place, reason)
        for key in ("platen", "displacement", "rotation", "traction", "force", "foundation"):
            table = getattr(self, key)
            if table is not None:
                yield from table.problems((*place, key))

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with what the mesh stands for."""
        dim = 3 if section == "3D" else 2
        for key in ("traction", "force", "foundation"):
            table = getattr(self, key)
            if table is not None:
                yield from table.section_problems(section, (*place, key))
        yield from self._direction_problems(section, place)
        yield from self._rotation_problems(section, place)
        if dim == 2:
            for component, keys in self.prescribed():
                if component == "z" and keys != ("rotation",):
                    yield Problem((*place, *keys), "there is no z in a mesh in the plane")

    def group_problems(self, place: Place) -> Iterator[Problem]:
        """What cannot be done with points or edges, which have no area."""
        for key in ("platen", "pressure", "traction", "foundation", "symmetry"):
            if getattr(self, key):
                reason = f'"{self.surface}" is a group of points or edges, which have no area'
                yield Problem((*place, key), reason)

    def _direction_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """Directions of another number of components, or across the axis of symmetry."""
        dim = 3 if section == "3D" else 2
        for key in ("displacement", "platen"):
            direction = getattr(getattr(self, key), "direction", None)
            if isinstance(direction, tuple):
                yield from size_problems(direction, dim, (*place, key, "direction"))
        if section == "axisymmetric" and self.platen is not None and self.platen.is_oblique:
            reason = 'is "x" or "y" with axial symmetry: a ring moves along the axis or widens'
            yield Problem((*place, "platen", "direction"), reason, list(self.platen.direction))

    def _rotation_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """Rotations about another axis than there is."""
        rotation, dim = self.rotation, 3 if section == "3D" else 2
        if rotation is None:
            return
        where = (*place, "rotation", "centre")
        yield from size_problems(rotation.centre, dim, where, "coordinates")
        if section == "axisymmetric":
            yield Problem((*place, "rotation"), "does not go with axial symmetry")
        elif dim == 2 and rotation.axis != "z":
            reason = "the axis of a rotation in the plane is z"
            yield Problem((*place, "rotation", "axis"), reason, rotation.axis)


def boundary_problems(
    boundaries: Sequence[Boundary], place: Place, section: Section | None = None
) -> Iterator[Problem]:
    """Mistakes in the boundaries: each by itself, together, and with the mesh if known."""
    decided: dict[tuple[str, str], list[tuple[Boundary, str]]] = {}
    for index, boundary in enumerate(boundaries):
        yield from boundary.problems((*place, index))
        if section is not None:
            yield from boundary.section_problems(section, (*place, index))
        for component, keys in boundary.prescribed():
            here = (*place, index, *keys)
            name = ".".join(map(str, here))
            others = decided.setdefault((boundary.surface, component), [])
            for other, first in others:
                if first != name and boundary.meets(other):
                    reason = f'"{boundary.surface}" is already moved in {component} by {first}'
                    yield Problem(here, reason)
                    break
            others.append((boundary, name))


def control_problems(
    boundaries: Sequence[Boundary], solvers: Mapping[str, str], place: Place
) -> Iterator[Problem]:
    """Mistakes in the stages that boundaries name."""
    for index, boundary in enumerate(boundaries):
        yield from named_stage_problems(boundary.stages, solvers, (*place, index, "stages"))
        if boundary.stages and "explicit" in solvers.values():
            for key in ("platen", "spring"):
                if getattr(boundary, key) is not None:
                    reason = f"with a {key} does not go with explicit stages"
                    yield Problem((*place, index, "stages"), reason, list(boundary.stages))
        if boundary.platen is not None:
            yield from boundary.platen.stage_problems(solvers, (*place, index, "platen"))


def named_stage_problems(
    names: Sequence[str], stages: Collection[str], place: Place
) -> Iterator[Problem]:
    """Names of stages that there are not."""
    for name in names:
        if name not in stages:
            yield Problem(place, f"no stage has this name; there are {', '.join(stages)}", name)
