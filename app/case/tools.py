"""The `[tools.NAME]` tables of a case file: rigid shapes that bodies are pressed on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_serializer, field_validator
from pydantic.json_schema import JsonSchemaValue

from tribox.app.case.boundary import Direction, Spring, named_stage_problems
from tribox.app.case.geometry import Scale
from tribox.app.case.quantities import Quantity, Written, format_quantity, text_schema
from tribox.app.case.table import MOST_ENTRIES, Flag, Model, Place, Problem, Text, size_problems
from tribox.app.case.time_tables import (
    COMPONENTS,
    DRIVEN,
    Component,
    Displacement,
    Program,
    TimeTable,
    Travel,
    Velocity,
)
from tribox.app.case.toml_files import found_file

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section

_Force = Annotated[TimeTable, Program("N")]
_Length = Annotated[float, Quantity("m")]
_Radius = Annotated[float, Quantity("m", gt=0.0)]
_Point = tuple[_Length, ...]
_SLAB = "in plane strain of the slab of the given thickness"
ACROSS = (0.0, 0.0, 1.0)  # the axis z


class _OneOrMany(Written):
    """Pydantic annotation of a length >= 0 or a list of them; a mistake is told once."""

    quantity = Quantity("m", ge=0.0)

    def parse(self, value: object) -> float | tuple[float, ...]:
        """The length or lengths in m."""
        if isinstance(value, list | tuple):
            return tuple(self.quantity.parse(one) for one in value)
        return self.quantity.parse(value)

    def serialise(self, value: float | tuple[float, ...]) -> object:
        """Text of each."""
        if isinstance(value, tuple):
            return [format_quantity(one, "m") for one in value]
        return format_quantity(value, "m")

    def json_schema(self) -> JsonSchemaValue:
        one = [{"type": "number", "minimum": 0.0}, text_schema("m")]
        return {"anyOf": [*one, {"type": "array", "items": {"anyOf": one}}], "x-unit": "m"}


_Direction = Annotated[tuple[float, ...], Direction()]


class ToolForce(Model):
    """Given components of the force that drives a tool."""

    x: _Force | None = Field(default=None, description=f"force in x, {_SLAB}")
    y: _Force | None = Field(default=None, description=f"force in y, {_SLAB}")
    z: _Force | None = None
    """force in z, in 3D"""


class ToolStop(Model):
    """Where blocks take over the force that drives a tool."""

    x: _Length | None = None
    """displacement in x"""
    y: _Length | None = None
    """displacement in y"""
    z: _Length | None = None
    """displacement in z, in 3D"""

    def problems(self, tool: Tool, place: Place) -> Iterator[Problem]:
        """Components that no force drives, or to the other side."""
        for component in COMPONENTS:
            value = getattr(self, component)
            if value is not None and (reason := self._problem(tool, component, value)):
                yield Problem((*place, component), reason, value)

    def _problem(self, tool: Tool, component: str, value: float) -> str | None:
        """Why a tool cannot have a stop at ``value``, m."""
        force: TimeTable | None = getattr(tool.force, component, None)
        moved = getattr(tool.displacement, component, None)
        if force is None or component in tool.hold_force:
            return f"goes with force.{component} only: it is as far as the force moves it"
        low, high = min(force.values), max(force.values)
        if low < 0.0 < high:
            return f"a stop is on one side, but force.{component} turns round"
        if low == high == 0.0:
            return f"force.{component} drives the tool nowhere"
        places = moved.values if isinstance(moved, TimeTable) else (0.0,)
        side = 1.0 if high > 0.0 else -1.0
        if any(side * (at - value) > 0.0 for at in places):
            return "the tool is beyond it before the force moves it there"
        return None


class ToolRotation(Model):
    """Rotation of a tool about an axis that moves with it."""

    angle: Annotated[TimeTable, Program("rad")] | None = None
    """angle, against the clock seen from the arrow head of the axis (or one below)"""
    rate: Annotated[TimeTable, Program("rad/s")] | None = None
    """angular velocity; it is integrated in time"""
    rim: Travel | None = None
    """way of the rim of a round shape, against the clock: the angle times the radius; or "driven":
    the rim moves with the velocity of the stage"""
    clockwise: Flag = False
    """whether rim = "driven" turns the tool with the clock"""
    moment: Annotated[TimeTable, Program("N*m")] | None = Field(
        default=None,
        description=f"moment about the axis that drives the tool, {_SLAB}; 0: it turns freely",
    )
    axis: _Direction | None = None
    """direction of the axis, "x", "y", "z" or [x, y, z]; in the plane it is z; default in 3D: that
    of a cylinder"""
    centre: _Point | None = None
    """a point on the axis at the start; default: the centre of a round shape"""
    inertia: Annotated[float, Quantity("kg*m^2", gt=0.0)] | None = Field(
        default=None,
        description=f"moment of inertia about the axis, {_SLAB}; with moment, explicit only",
    )

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together."""
        keys = ("angle", "rate", "rim", "moment")
        given = [key for key in keys if getattr(self, key) is not None]
        if len(given) != 1:
            found = " and ".join(given) or "none"
            yield Problem(place, f"give one of angle, rate, rim and moment, found {found}")
        if self.clockwise and self.rim != DRIVEN:
            yield Problem((*place, "clockwise"), 'goes with rim = "driven" only', True)
        if self.inertia is not None and self.moment is None:
            yield Problem((*place, "inertia"), "goes with moment only", self.inertia)


class Tool(Model):
    """What all tools have: how they move, and in which stages they act."""

    has_centre: ClassVar[bool] = False
    dims: ClassVar[tuple[int, ...]] = (2, 3)

    displacement: Displacement | None = None
    """given components of the displacement; components that are not given are 0"""
    velocity: Velocity | None = None
    """given components of the velocity; they are integrated in time"""
    force: ToolForce | None = None
    """given components of the force that drives the tool, along the axes; its displacement
    follows"""
    stop: ToolStop | None = None
    """displacement, from the start of the run, at which blocks take over the force that drives a
    component, as beneath a blank holder; implicit only"""
    spring: Spring | None = None
    """spring that draws the tool in one direction; its displacement follows"""
    displacement_stages: tuple[Text, ...] = Field(default=(), max_length=MOST_ENTRIES)
    """names of the stages in which displacement or velocity moves the components that a force
    drives in the others; default: all, and no component has both"""
    hold_force: tuple[Component, ...] = ()
    """components, such as ["y"], that after stages of displacement_stages hold the force that was
    reached at their end, instead of that of force (which is not needed then)"""
    mass: Annotated[float, Quantity("kg", gt=0.0)] | None = Field(
        default=None, description=f"mass of the tool, {_SLAB}; with force or spring, explicit only"
    )
    rotation: ToolRotation | None = None
    """rotation; default: the tool does not turn"""
    stages: tuple[Text, ...] | None = Field(default=None, min_length=1, max_length=MOST_ENTRIES)
    """names of the stages in which the tool touches; default: all"""

    if TYPE_CHECKING:  # a word of its own for each
        shape: str

    def components(self) -> Iterator[tuple[str, str]]:
        """Components (x, y, z) that are given, each with the table that does it."""
        for key in ("displacement", "velocity", "force"):
            table = getattr(self, key)
            for component in COMPONENTS:
                if table is not None and getattr(table, component) is not None:
                    yield component, key
        if self.spring is not None:
            yield self.spring.direction, "spring"

    def acts_in(self, stage: str) -> bool:
        """Whether the tool touches in a stage."""
        return self.stages is None or stage in self.stages

    def is_switched(self, component: str) -> bool:
        """Whether a component is moved in some stages and driven by a force in others."""
        keys = [key for name, key in self.components() if name == component]
        moved = "displacement" in keys or "velocity" in keys
        loaded = "force" in keys or component in self.hold_force
        return bool(self.displacement_stages) and moved and loaded

    def rests(self, component: str) -> bool:
        """Whether nothing moves it along an axis, nor turns it."""
        keys = {key for name, key in self.components() if name == component}
        moves = [getattr(getattr(self, key), component, None) for key in keys]
        if self.rotation is not None:
            moves.append(self.rotation.angle or self.rotation.rate)
        still = all(isinstance(m, TimeTable) and not any(m.values) for m in moves)
        return still and keys <= {"displacement", "velocity"}

    def driven_components(self) -> tuple[str, ...]:
        """Components that move with the velocity of the stage."""
        return () if self.displacement is None else self.displacement.driven_components()

    def driven_keys(self) -> Iterator[tuple[str, str]]:
        """The keys that say "driven"."""
        for component in self.driven_components():
            yield "displacement", component
        if self.spring is not None and self.spring.end == DRIVEN:
            yield "spring", "end"
        if self.rotation is not None and self.rotation.rim == DRIVEN:
            yield "rotation", "rim"

    def positions(self) -> Iterator[tuple[str, Sequence[float]]]:
        """Points and directions of the shape, which have as many numbers as space dimensions."""
        return iter(())

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        seen: dict[str, str] = {}
        for component, key in self.components():
            first = seen.setdefault(component, key)
            if first != key and not (key == "force" and self.displacement_stages):
                reason = f"{first}.{component} is given too; a component is given by one of them"
                if key == "force":
                    reason += ", unless displacement_stages names the stages of the first"
                yield Problem((*place, key, component), reason)
        yield from self._switching_problems(place)
        if self.displacement is not None:
            yield from self.displacement.problems((*place, "displacement"))
        if self.stop is not None:
            yield from self.stop.problems(self, (*place, "stop"))
        if self.mass is not None and self.force is None and self.spring is None:
            yield Problem((*place, "mass"), "goes with force or spring only", self.mass)
        if self.spring is not None and self.spring.mass > 0.0:
            reason = "is that of a surface; give the tool its mass"
            yield Problem((*place, "spring", "mass"), reason, self.spring.mass)
        if self.rotation is not None:
            yield from self.rotation.problems((*place, "rotation"))
            if self.rotation.centre is None and not self.has_centre:
                reason = f'missing; a shape "{self.shape}" has no centre of its own'
                yield Problem((*place, "rotation", "centre"), reason)
            if self.rotation.rim is not None and not self.has_centre:
                reason = f'a shape "{self.shape}" has no rim; give angle, rate or moment'
                yield Problem((*place, "rotation", "rim"), reason)
            for key in ("centre", "axis") if self.rotation.rim is not None else ():
                if key in self.rotation.model_fields_set and hasattr(self, key):
                    reason = f"with rim, a {self.shape} turns about its own {key}"
                    yield Problem((*place, "rotation", key), reason)

    def _switching_problems(self, place: Place) -> Iterator[Problem]:
        """Stages of motion without a component that is moved there only."""
        here, found = (*place, "hold_force"), list(self.hold_force)
        if self.hold_force and not self.displacement_stages:
            reason = "holds what displacement_stages end with, and there are none"
            yield Problem(here, reason, found)
            return
        for component in self.hold_force:
            if not self.is_switched(component):
                yield Problem(
                    here, f"neither displacement.{component} nor velocity is given", found
                )
        if self.displacement_stages and not any(map(self.is_switched, COMPONENTS)):
            reason = (
                "no component has both a force and a displacement or velocity; give the force of "
                "the other stages, or hold_force"
            )
            yield Problem((*place, "displacement_stages"), reason, list(self.displacement_stages))

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with what the mesh stands for."""
        dim = 3 if section == "3D" else 2
        if dim not in self.dims:
            others = 'in space use "cylinder", "sphere" or "mesh"'
            if dim == 2:
                others = 'in the plane use "circle", "polyline" or "mesh"'
            where = "space" if dim == 3 else "the plane"
            yield Problem((*place, "shape"), f"is no shape in {where}; {others}", self.shape)
            return
        for key, numbers in self.positions():
            yield from size_problems(numbers, dim, (*place, key))
        for component, key in self.components():
            if COMPONENTS.index(component) >= dim:
                yield Problem((*place, key, component), "there is no z in a mesh in the plane")
            elif section == "axisymmetric" and component != "y":
                reason = "a tool of revolution moves along the axis, y, only"
                yield Problem((*place, key, component), reason)
        if self.displacement is not None:
            direction = self.displacement.direction
            yield from size_problems(direction, dim, (*place, "displacement", "direction"))
        if self.rotation is not None:
            yield from self._rotation_problems(self.rotation, section, (*place, "rotation"))

    def _rotation_problems(
        self, rotation: ToolRotation, section: Section, place: Place
    ) -> Iterator[Problem]:
        if section == "axisymmetric":
            yield Problem(place, "does not go with axial symmetry")
            return
        dim = 3 if section == "3D" else 2
        yield from size_problems(rotation.centre, dim, (*place, "centre"), "coordinates")
        axis = rotation.axis
        if dim == 3 and axis is None and not isinstance(self, CylinderTool):
            yield Problem((*place, "axis"), 'missing; give "x", "y", "z" or [x, y, z]')
        if dim == 3:
            yield from size_problems(axis, dim, (*place, "axis"))
        if dim == 2 and axis is not None and axis != ACROSS:
            yield Problem((*place, "axis"), "the axis of a rotation in the plane is z", list(axis))


class PlaneTool(Tool):
    """A plane; in the plane a straight line without end."""

    shape: Literal["plane"]
    """a plane"""
    point: _Point
    """a point of the plane, [x, y] or [x, y, z]"""
    normal: _Direction
    """normal out of the tool, towards the body"""

    @field_validator("normal")
    @classmethod
    def _as_the_point(cls, normal: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        """The normal in the plane of its point: a letter has three components."""
        in_plane = len(info.data.get("point", normal)) == 2 and not any(normal[2:])
        return normal[:2] if in_plane else normal

    def positions(self) -> Iterator[tuple[str, Sequence[float]]]:
        yield "point", self.point
        yield "normal", self.normal

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """Besides those of all tools: a plane that is no surface of revolution."""
        yield from super().section_problems(section, place)
        if section == "axisymmetric" and len(self.normal) == 2 and self.normal[1] == 0.0:
            reason = "is radial: use a polyline for a tube"
            yield Problem((*place, "normal"), reason, list(self.normal))


class RoundTool(Tool):
    """A shape with a centre, which it can turn about, and a rim."""

    has_centre: ClassVar[bool] = True

    centre: _Point
    """its centre [x, y] or [x, y, z]"""
    radius: _Radius
    """its radius"""
    inside: Flag = False
    """whether the body is inside it, as in a bore or a socket"""

    def positions(self) -> Iterator[tuple[str, Sequence[float]]]:
        yield "centre", self.centre


class CircleTool(RoundTool):
    """A circle in the plane: a long cylinder, or with axial symmetry a ring or a ball."""

    dims: ClassVar[tuple[int, ...]] = (2,)

    shape: Literal["circle"]
    """a circle, in the plane"""


class CylinderTool(RoundTool):
    """A cylinder in space, without ends."""

    dims: ClassVar[tuple[int, ...]] = (3,)

    shape: Literal["cylinder"]
    """a cylinder, in space"""
    centre: _Point
    """a point [x, y, z] of its axis"""
    axis: _Direction
    """direction of its axis, "x", "y", "z" or [x, y, z]"""

    def positions(self) -> Iterator[tuple[str, Sequence[float]]]:
        yield from super().positions()
        yield "axis", self.axis


class SphereTool(RoundTool):
    """A sphere in space."""

    dims: ClassVar[tuple[int, ...]] = (3,)

    shape: Literal["sphere"]
    """a sphere, in space"""


class PolylineTool(Tool):
    """Straight lines in the plane, with rounded corners."""

    dims: ClassVar[tuple[int, ...]] = (2,)

    shape: Literal["polyline"]
    """straight lines with fillets, in the plane"""
    points: tuple[_Point, ...] = Field(min_length=2, max_length=MOST_ENTRIES)
    """its corners [[x, y], ...] before they are rounded; the body is on the left"""
    fillet_radius: Annotated[float | tuple[float, ...], _OneOrMany()] = 0.0
    """radius of the fillets: one for all corners, or a list of one for each"""
    closed: Flag = False
    """whether the last point is joined to the first"""
    continued: tuple[Flag, Flag] = (False, False)
    """whether the line goes on straight without end before its first point, and behind its last;
    otherwise contact ends there"""

    @property
    def corners(self) -> int:
        """Number of corners that may be rounded."""
        return len(self.points) - (0 if self.closed else 2)

    def positions(self) -> Iterator[tuple[str, Sequence[float]]]:
        for point in self.points:
            yield "points", point

    def problems(self, place: Place) -> Iterator[Problem]:
        """Besides those of all tools: a number of fillets that is not that of the corners."""
        yield from super().problems(place)
        radii = self.fillet_radius
        if isinstance(radii, tuple) and len(radii) != self.corners:
            reason = f"must be one radius, or {self.corners}, one for each corner between two lines"
            yield Problem((*place, "fillet_radius"), reason, list(radii))
        if self.closed and any(self.continued):
            reason = "does not go with a closed line"
            yield Problem((*place, "continued"), reason, list(self.continued))
        if self.closed and len(self.points) < 3:
            yield Problem((*place, "points"), "a closed line needs three points or more")


class MeshTool(Tool):
    """A surface out of a mesh file."""

    shape: Literal["mesh"]
    """a surface of facets out of a mesh file"""
    file: Path
    """gmsh file (.msh), relative to the case file"""
    scale: Scale = 1.0
    """unit of the coordinates in the file, such as "mm", or its size"""
    surface: Text
    """name of the physical group of facets; it need not bound a body. Seen along their order of
    nodes the body is on the left, in space facets run against the clock seen from the body"""
    turned_over: Flag = False
    """whether all facets run the other way round in the file"""
    smoothing_angle: Annotated[float, Quantity("rad", gt=0.0, le=math.pi)] | None = None
    """make normals continuous across sides of facets whose normals differ by less than this angle;
    default: the facets as they are. First-order lines and quadrilaterals"""

    @field_validator("file", mode="before")
    @classmethod
    def _find(cls, value: object, info: ValidationInfo) -> Path:
        return found_file(value, info.context or {}, "a mesh file")

    @field_serializer("file")
    def _as_text(self, value: Path) -> str:
        return str(value)


AnyTool = Annotated[
    PlaneTool | CircleTool | CylinderTool | SphereTool | PolylineTool | MeshTool,
    Field(discriminator="shape"),
]


def tool_problems(
    tools: Mapping[str, Tool], stages: Sequence[str], explicit: bool, section: Section | None
) -> Iterator[Problem]:
    """Mistakes in the tools, each by itself and with the rest of the case."""
    for name, tool in tools.items():
        place: Place = ("tools", name)
        yield from tool.problems(place)
        if section is not None:
            yield from tool.section_problems(section, place)
        # Masses that explicit dynamics needs, and that nothing else does
        turned = tool.rotation is not None and tool.rotation.moment is not None
        inertia = None if tool.rotation is None else tool.rotation.inertia
        parts = (
            (("mass",), tool.force is not None or tool.spring is not None, tool.mass, "kg"),
            (("rotation", "inertia"), turned, inertia, "kg*m^2"),
        )
        for keys, needed, value, unit in parts:
            if explicit and needed and value is None:
                reason = f'missing; explicit dynamics needs it for what a load moves, in "{unit}"'
                yield Problem((*place, *keys), reason)
            if not explicit and needed and value is not None:
                yield Problem((*place, *keys), 'goes with solver.kind = "explicit" only', value)
        for key in ("stages", "displacement_stages"):
            yield from named_stage_problems(getattr(tool, key) or (), stages, (*place, key))
        if explicit and tool.hold_force:
            reason = "does not go with explicit stages; give the force"
            yield Problem((*place, "hold_force"), reason, list(tool.hold_force))
        if explicit and tool.stop is not None:
            reason = "does not go with explicit stages; give a displacement from there on"
            yield Problem((*place, "stop"), reason)
