"""Loads of `[[boundary]]` tables with components, elastic foundations, and `[gravity]`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tribox.app.case.motions import COMPONENTS, DRIVEN, Travel
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Model, Place, Problem, Text
from tribox.app.case.time_tables import Program, TimeTable

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section

_Traction = Annotated[TimeTable, Program("Pa")]
_Force = Annotated[TimeTable, Program("N")]
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

    x: _Traction | None = Field(default=None, description="traction in x")
    y: _Traction | None = Field(default=None, description="traction in y")
    z: _Traction | None = Field(default=None, description="traction in z, in 3D")


class Force(_Vector):
    """A total force, which keeps its direction."""

    x: _Force | None = Field(default=None, description="force in x")
    y: _Force | None = Field(default=None, description="force in y")
    z: _Force | None = Field(default=None, description="force in z, in 3D")

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with what the mesh stands for."""
        yield from super().section_problems(section, place)
        if section == "axisymmetric" and self.x is not None:
            reason = "forces across the axis cancel round the ring; give a traction, or y only"
            yield Problem((*place, "x"), reason)


class FoundationBase(Model):
    """Displacement of what an elastic foundation stands on."""

    x: Travel | None = Field(default=None, description='displacement in x, or "driven"')
    y: Travel | None = Field(default=None, description='displacement in y, or "driven"')
    z: Travel | None = Field(default=None, description='displacement in z, in 3D, or "driven"')


class Foundation(Model):
    """Springs all over a surface, per reference area."""

    normal: _Stiffness = Field(
        default=0.0, description="stiffness along the normal of the undeformed surface"
    )
    tangential: _Stiffness = Field(
        default=0.0, description="stiffness across the normal of the undeformed surface"
    )
    base: FoundationBase = Field(
        default=FoundationBase(),
        description="displacement of the springs' other ends; default: they stay",
    )

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

    x: _Acceleration | None = Field(default=None, description="acceleration in x")
    y: _Acceleration | None = Field(default=None, description="acceleration in y")
    z: _Acceleration | None = Field(default=None, description="acceleration in z, in 3D")
    stages: tuple[Text, ...] = Field(
        default=(), description="names of the stages in which it acts; default: all"
    )

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with what the mesh stands for."""
        yield from super().section_problems(section, place)
        if section == "axisymmetric" and self.x is not None:
            yield Problem((*place, "x"), "gravity must point along the axis of symmetry: give y")
