"""The `[[boundary]]` tables of a case file: supports, motions and loads of surfaces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from app.case.quantities import Quantity
from app.case.table import Model, Place, Problem, Text
from app.case.time_tables import Program, TimeTable

if TYPE_CHECKING:
    from forms.bodies.kinematics import Section

COMPONENTS = ("x", "y", "z")
Component = Literal["x", "y", "z"]
DRIVEN = "driven"

_Displacement = Annotated[TimeTable | Literal["driven"], Program("m", word=DRIVEN)]
_Velocity = Annotated[TimeTable, Program("m/s")]
_Pressure = Annotated[TimeTable, Program("Pa")]
_Force = Annotated[TimeTable, Program("N")]
_Angle = Annotated[TimeTable, Program("rad")]
_Travel = Annotated[TimeTable, Program("m")]
_Length = Annotated[float, Quantity("m")]
_Weight = Annotated[float, Quantity()]
_Mass = Annotated[float, Quantity("kg", ge=0.0)]
_MASS = "mass the surface carries beside its own, for the given thickness; explicit only"


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
    z: _Displacement | None = Field(
        default=None,
        description='displacement in z, in 3D, or "driven": moved with the velocity of the stage',
    )
    direction: tuple[_Weight, ...] | None = Field(
        default=None,
        description="direction [x, y] or [x, y, z] in which the driven components together move "
        "with the velocity of the stage; default: each moves with it",
    )

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

    x: _Velocity | None = Field(default=None, description="velocity in x")
    y: _Velocity | None = Field(default=None, description="velocity in y")
    z: _Velocity | None = Field(default=None, description="velocity in z, in 3D")


class Platen(Model):
    """A rigid platen glued to the surface in one direction: one displacement, a given force.

    In some stages its displacement may be given instead, and the force follows.
    """

    direction: Component = Field(description="direction in which the platen moves")
    pressure: _Pressure | None = Field(
        default=None, description="force over reference area, > 0 presses into the body (or force)"
    )
    force: _Force | None = Field(
        default=None,
        description="total force, > 0 presses into the body (or pressure); in plane strain on the "
        "slab of the given thickness",
    )
    displacement: _Travel | None = Field(
        default=None,
        description="displacement, > 0 into the body, in the stages of displacement_stages, where "
        "it takes the place of the force",
    )
    displacement_stages: tuple[Text, ...] = Field(
        default=(),
        description="names of the stages in which the displacement is given and not the force",
    )
    mass: _Mass = Field(default=0.0, description=_MASS)

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        if (self.pressure is None) == (self.force is None):
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
        if self.displacement_stages and "explicit" in solvers.values():
            reason = "does not go with explicit stages; a platen's force is given in all of them"
            yield Problem(here, reason, list(self.displacement_stages))


class Spring(Model):
    """A surface moved as one in one direction, drawn by a spring whose far end is moved."""

    direction: Component = Field(description="direction in which the surface moves as one")
    stiffness: Annotated[float, Quantity("N/m", gt=0.0)] = Field(
        description="of the spring, for the slab of the given thickness"
    )
    end: _Displacement = Field(
        description='displacement of the spring\'s far end, or "driven": moved with the velocity '
        "of the stage"
    )
    mass: _Mass = Field(default=0.0, description=_MASS)


class Rotation(Model):
    """A rigid rotation of a surface; displacements along the axis are left to other keys."""

    angle: _Angle = Field(description="angle, against the clock seen from the axis's arrow head")
    axis: Component = Field(
        default="z", description="direction of the axis; in the plane it is z, across the plane"
    )
    centre: tuple[_Length, ...] | None = Field(
        default=None,
        description="a point on the axis, [x, y] or [x, y, z], undeformed; default: the origin",
    )

    def decided(self) -> tuple[str, ...]:
        """The two components that a rotation prescribes."""
        return tuple(c for c in COMPONENTS if c != self.axis)

    def problems(self, place: Place) -> Iterator[Problem]:
        """A centre that is no point."""
        if self.centre is not None and len(self.centre) not in (2, 3):
            reason = "must be two coordinates in the plane, three in space"
            yield Problem((*place, "centre"), reason, list(self.centre))


class Boundary(Model):
    """The supports, motions and loads of one named surface."""

    surface: Text = Field(description="name of the surface")
    displacement: Displacement | None = Field(default=None, description="prescribed displacement")
    velocity: Velocity | None = Field(default=None, description="prescribed velocity")
    platen: Platen | None = Field(default=None, description="rigid platen with a given force")
    spring: Spring | None = Field(
        default=None, description="spring that draws the surface, moved as one"
    )
    pressure: _Pressure | None = Field(
        default=None,
        description="pressure normal to the deformed surface, > 0 presses into the body",
    )

    rotation: Rotation | None = Field(default=None, description="rigid rotation of the surface")

    def prescribed(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Components (x, y, z) that this boundary decides, each with the keys that do it."""
        for key, table in (("displacement", self.displacement), ("velocity", self.velocity)):
            for component in COMPONENTS:
                if table is not None and getattr(table, component) is not None:
                    yield component, (key, component)
        if self.platen is not None:
            yield self.platen.direction, ("platen", "direction")
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

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        if not any(self.prescribed()) and self.pressure is None:
            reason = (
                "does nothing; give displacement, velocity, platen, spring, rotation or pressure"
            )
            yield Problem(place, reason)
        if self.platen is not None:
            yield from self.platen.problems((*place, "platen"))
        if self.displacement is not None:
            yield from self.displacement.problems((*place, "displacement"))
        if self.rotation is not None:
            yield from self.rotation.problems((*place, "rotation"))

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with what the mesh stands for."""
        dim = 3 if section == "3D" else 2
        rotation = self.rotation
        direction = None if self.displacement is None else self.displacement.direction
        if dim == 2:
            for component, keys in self.prescribed():
                if component == "z" and keys != ("rotation",):
                    yield Problem((*place, *keys), "there is no z in a mesh in the plane")
        if direction is not None and len(direction) != dim:
            reason = f"must have {dim} components in this mesh"
            yield Problem((*place, "displacement", "direction"), reason, list(direction))
        if rotation is None:
            return
        if rotation.centre is not None and len(rotation.centre) != dim:
            reason = f"must have {dim} coordinates in this mesh"
            yield Problem((*place, "rotation", "centre"), reason, list(rotation.centre))
        if section == "axisymmetric":
            yield Problem((*place, "rotation"), "does not go with axial symmetry")
        elif dim == 2 and rotation.axis != "z":
            reason = "the axis of a rotation in the plane is z"
            yield Problem((*place, "rotation", "axis"), reason, rotation.axis)


def boundary_problems(
    boundaries: Sequence[Boundary], place: Place, section: Section | None = None
) -> Iterator[Problem]:
    """Mistakes in the boundaries: each by itself, together, and with the mesh if known."""
    decided: dict[tuple[str, str], str] = {}
    for index, boundary in enumerate(boundaries):
        yield from boundary.problems((*place, index))
        if section is not None:
            yield from boundary.section_problems(section, (*place, index))
        for component, keys in boundary.prescribed():
            here = (*place, index, *keys)
            name = ".".join(map(str, here))
            first = decided.setdefault((boundary.surface, component), name)
            if first != name:
                reason = f'"{boundary.surface}" is already moved in {component} by {first}'
                yield Problem(here, reason)


def control_problems(
    boundaries: Sequence[Boundary], solvers: Mapping[str, str], place: Place
) -> Iterator[Problem]:
    """Mistakes in the stages that platens name.

    Args:
        boundaries: all of them.
        solvers: time integration of each stage by its name.
        place: where the boundaries stand in the case.
    """
    for index, boundary in enumerate(boundaries):
        if boundary.platen is not None:
            yield from boundary.platen.stage_problems(solvers, (*place, index, "platen"))
