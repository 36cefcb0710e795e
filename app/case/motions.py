"""What `[[boundary]]` tables say of motion: displacements, velocities and rotations of surfaces."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Model, Place, Problem
from tribox.app.case.time_tables import Program, TimeTable

COMPONENTS = ("x", "y", "z")
Component = Literal["x", "y", "z"]
DRIVEN = "driven"

Travel = Annotated[TimeTable | Literal["driven"], Program("m", word=DRIVEN)]
_Velocity = Annotated[TimeTable, Program("m/s")]
_Angle = Annotated[TimeTable, Program("rad")]
_Length = Annotated[float, Quantity("m")]
_Weight = Annotated[float, Quantity()]


class Displacement(Model):
    """Prescribed components of the displacement."""

    x: Travel | None = Field(
        default=None,
        description='displacement in x, or "driven": moved with the velocity of the stage',
    )
    y: Travel | None = Field(
        default=None,
        description='displacement in y, or "driven": moved with the velocity of the stage',
    )
    z: Travel | None = Field(
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
