"""The `[geometry]` tables of the built-in generators of meshes, in the plane and in space."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from tribox.app.case.geometry import (
    NO_SLAB,
    SECTION,
    GeneratedGeometry,
    PlaneGeometry,
    PlaneSection,
)
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Elements, Model, Name, Place, Problem, Text

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section
    from tribox.geometry.generators.blocks import Blocks, PlacedBlock
    from tribox.geometry.generators.cylinders import FlatBlock, HalfCylinder, LineContact
    from tribox.geometry.generators.sphere_on_block import SphereOnBlock
    from tribox.geometry.generators.two_blocks import TwoBlocks


_Length = Annotated[float, Quantity("m", gt=0.0)]


class _Graded(Model):
    """What a block and a box of two have."""

    width: _Length
    """extent in x"""
    height: _Length
    """extent in y, upwards"""
    size: _Length | None = None
    """largest element width (and depth), and height where they are least high (or elements)"""
    grading: Annotated[float, Quantity(gt=0.0)] = 1.0
    """element height at the far side over that at the contact side; above 1 refines towards the
    contact"""


class BlockSize(_Graded):
    """One block of the two-block generator."""

    elements: tuple[Elements, Elements] | None = None
    """number of elements along x and y (this or size)"""


class BlocksGeometry(PlaneGeometry):
    """Two rectangular blocks, one on the other, meshed by the built-in generator."""

    sizes_by: ClassVar[str] = "elements or size of upper and lower"

    kind: Literal["two-blocks"]
    """which generator makes the mesh"""
    section: PlaneSection = Field(default="plane-strain", description=SECTION)
    upper: BlockSize
    """the upper block, body "elastomer" """
    lower: BlockSize
    """the lower block, body "aluminium" """
    offset: Annotated[float, Quantity("m")] = Field(default_factory=lambda data: _centred(data))
    """x of the upper block's left side, from the lower block's left side; default: the blocks are
    centred, with axial symmetry 0"""
    gap: Annotated[float, Quantity("m", ge=0.0)] = 0.0
    """distance between the blocks at the start; 0 lets them touch exactly"""

    @property
    def built_section(self) -> Section:
        """As the case says."""
        return self.section

    @model_serializer(mode="wrap")
    def _without_slab(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out the thickness where there is no slab."""
        idle = ("thickness",) if self.section == "axisymmetric" else ()
        return {key: value for key, value in handler(self).items() if key not in idle}

    @property
    def extent(self) -> float:
        """The wider block's width, m."""
        return max(self.lower.width, self.upper.width)

    def shape(self) -> TwoBlocks:
        from tribox.geometry.generators.two_blocks import Block, TwoBlocks

        upper, lower = (
            Block(b.width, b.height, b.elements, b.size, b.grading)
            for b in (self.upper, self.lower)
        )
        return TwoBlocks(upper, lower, self.offset, self.gap, self.cell, *self.bodies)

    def problems(self, place: Place) -> Iterator[Problem]:
        """Mistakes in the blocks; `place` is where this table stands in the case."""
        found = list(_size_problems(self, place))
        low, high = -self.upper.width, self.lower.width
        if not low < self.offset < high:
            reason = f"must lie between {low:g} m and {high:g} m, where the blocks overlap"
            found.append(Problem((*place, "offset"), reason, self.offset))
        if self.section == "axisymmetric" and self.offset < 0.0:
            reason = "must be >= 0 m: x is the distance from the axis of symmetry"
            found.append(Problem((*place, "offset"), reason, self.offset))
        yield from found or self.shape_problems(place)
        if self.section == "axisymmetric" and "thickness" in self.model_fields_set:
            yield Problem((*place, "thickness"), NO_SLAB, self.thickness)


def _size_problems(geometry: BlocksGeometry | BoxesGeometry, place: Place) -> Iterator[Problem]:
    """Bodies whose elements are not said, or twice."""
    for name, body in (("upper", geometry.upper), ("lower", geometry.lower)):
        if (body.elements is None) == (body.size is None):
            reason = "give either elements or size, not both and not neither"
            yield Problem((*place, name), reason)


def _centred(data: dict[str, Any]) -> float:
    """Offset of a centred upper block; 0 on the axis, or where the blocks themselves are wrong."""
    upper, lower = data.get("upper"), data.get("lower")
    if data.get("section") == "axisymmetric":
        return 0.0
    if not isinstance(upper, BlockSize) or not isinstance(lower, BlockSize):
        return 0.0
    return 0.5 * (lower.width - upper.width)


class _ZoneSize(Model):
    """How finely one body of a line contact is meshed, where it differs from the other."""

    contact_width: _Length | None = None
    """width of this body's contact zone; default: geometry's"""
    contact_size: _Length | None = None
    """element width in this body's contact zone; default: geometry's"""


class CylinderSize(_ZoneSize):
    """A cylinder, cut in half, of the line-contact generators."""

    radius: _Length
    """radius; the flat side of the half is the far side"""


class FlatSize(_ZoneSize):
    """The block under a cylinder."""

    width: _Length
    """extent in x"""
    height: _Length
    """extent in y"""


class _LineGeometry(PlaneGeometry):
    """What the two line-contact generators share."""

    contact_width: _Length
    """width of the finely meshed contact zone around the first line of contact, which is the
    contact surface: the contact must stay within it"""
    contact_size: _Length
    """largest element width in the contact zone, and height on its surface"""
    growth: Annotated[float, Quantity(ge=1.0, le=2.0)] = 1.15
    """size of an element over that of its neighbour nearer the contact"""

    def sizes(self) -> tuple[tuple[str, CylinderSize], tuple[str, CylinderSize | FlatSize]]:
        """The upper and the lower body, each with its key."""
        raise NotImplementedError

    @property
    def extent(self) -> float:
        """The larger body's width, m."""
        return max(_width(size) for _, size in self.sizes())

    def body(self, size: CylinderSize | FlatSize) -> HalfCylinder | FlatBlock:
        """One body as the generator takes it; ValueError says why it cannot be meshed so."""
        from tribox.geometry.generators.cylinders import FlatBlock, HalfCylinder

        zone = (size.contact_width or self.contact_width, size.contact_size or self.contact_size)
        if isinstance(size, CylinderSize):
            return HalfCylinder(size.radius, *zone)
        return FlatBlock(size.width, size.height, *zone)

    def shape(self) -> LineContact:
        from tribox.geometry.generators.cylinders import LineContact

        upper, lower = (self.body(size) for _, size in self.sizes())
        return LineContact(upper, lower, self.growth, self.cell, *self.bodies)

    def problems(self, place: Place) -> Iterator[Problem]:
        """Mistakes in the bodies; `place` is where this table stands in the case."""
        wrong = []
        for name, size in self.sizes():
            try:
                self.body(size)
            except ValueError as error:
                wrong.append(Problem((*place, name), str(error)))
        yield from wrong or self.shape_problems(place)


def _width(size: CylinderSize | FlatSize) -> float:
    return 2.0 * size.radius if isinstance(size, CylinderSize) else size.width


class CylinderOnBlockGeometry(_LineGeometry):
    """A half cylinder on a block, touching at x = y = 0."""

    kind: Literal["cylinder-on-block"]
    """which generator makes the mesh"""
    cylinder: CylinderSize
    """the half cylinder above, body "elastomer" """
    block: FlatSize
    """the block below, body "aluminium" """

    def sizes(self) -> tuple[tuple[str, CylinderSize], tuple[str, FlatSize]]:
        """The cylinder and the block."""
        return ("cylinder", self.cylinder), ("block", self.block)


class TwoCylindersGeometry(_LineGeometry):
    """A half cylinder on another with a parallel axis, touching at x = y = 0."""

    kind: Literal["two-cylinders"]
    """which generator makes the mesh"""
    upper: CylinderSize
    """the half cylinder above, body "elastomer" """
    lower: CylinderSize
    """the half cylinder below, body "aluminium" """

    def sizes(self) -> tuple[tuple[str, CylinderSize], tuple[str, CylinderSize]]:
        """The upper and the lower cylinder."""
        return ("upper", self.upper), ("lower", self.lower)


# -- The `[geometry]` tables of the generators of bodies in space ----------------------------------

SpaceCell = Literal["hexahedron", "tetrahedron"]
_Position = Annotated[float, Quantity("m")]


class BoxSize(_Graded):
    """One box of the two-box generator."""

    depth: _Length
    """extent in z"""
    elements: tuple[Elements, Elements, Elements] | None = None
    """number of elements along x, y and z (this or size)"""


class BoxesGeometry(GeneratedGeometry):
    """Two boxes in space, one on the other."""

    sizes_by: ClassVar[str] = "elements or size of upper and lower"
    surfaces: ClassVar[tuple[str, ...]] = (
        *GeneratedGeometry.surfaces,
        "elastomer_front",
        "elastomer_back",
        "aluminium_front",
        "aluminium_back",
    )

    kind: Literal["two-boxes"]
    """which generator makes the mesh"""
    cell: SpaceCell = "hexahedron"
    """shape of the elements"""
    upper: BoxSize
    """the upper box, body "elastomer" """
    lower: BoxSize
    """the lower box, body "aluminium" """
    offset: tuple[_Position, _Position] = Field(default_factory=lambda data: _centred_box(data))
    """[x, z] of the upper box's left back corner, from that of the lower box; default: the boxes
    are centred"""
    gap: Annotated[float, Quantity("m", ge=0.0)] = 0.0
    """distance between the boxes at the start; 0 lets them touch"""

    @property
    def built_section(self) -> Section:
        """Bodies in space."""
        return "3D"

    @property
    def extent(self) -> float:
        """Largest width or depth, m."""
        return max(max(box.width, box.depth) for box in (self.lower, self.upper))

    def shape(self) -> TwoBlocks:
        from tribox.geometry.generators.two_blocks import Box, TwoBlocks

        upper, lower = (
            Box(b.width, b.height, b.depth, b.elements, b.size, b.grading)
            for b in (self.upper, self.lower)
        )
        return TwoBlocks(upper, lower, self.offset, self.gap, self.cell, *self.bodies)

    def problems(self, place: Place) -> Iterator[Problem]:
        """Mistakes in the boxes; `place` is where this table stands in the case."""
        yield from list(_size_problems(self, place)) or self.shape_problems(place)


def _centred_box(data: dict[str, Any]) -> tuple[float, float]:
    """Offset of a centred upper box; 0 where the boxes themselves are wrong."""
    upper, lower = data.get("upper"), data.get("lower")
    if not isinstance(upper, BoxSize) or not isinstance(lower, BoxSize):
        return 0.0, 0.0
    return 0.5 * (lower.width - upper.width), 0.5 * (lower.depth - upper.depth)


class SphereSize(Model):
    """The hemisphere of the sphere-on-block generator."""

    radius: _Length
    """radius of the sphere"""


class RoundBlockSize(Model):
    """The round block under it."""

    radius: _Length
    """radius of the block"""
    height: _Length
    """extent in y"""


class SphereGeometry(GeneratedGeometry):
    """A hemisphere, round side down, on a round block, touching at the origin; y is the axis."""

    surfaces: ClassVar[tuple[str, ...]] = (
        "elastomer_contact",
        "aluminium_contact",
        "top",
        "bottom",
        "elastomer_side",
        "aluminium_side",
    )

    kind: Literal["sphere-on-block"]
    """which generator makes the mesh"""
    part: Literal["axisymmetric", "quarter", "half", "full"] = "axisymmetric"
    """what is meshed: "axisymmetric" the half section x >= 0 in the plane; in space "quarter" (x, z
    >= 0), "half" (z >= 0) or "full" """
    cell: Literal["quadrilateral", "triangle", "hexahedron", "tetrahedron"] = Field(
        default_factory=lambda data: (
            "quadrilateral" if data.get("part") == "axisymmetric" else "hexahedron"
        )
    )
    """shape of the elements; default: quadrilateral, in space hexahedron"""
    sphere: SphereSize
    """the hemisphere above, body "elastomer" """
    block: RoundBlockSize
    """the block below, body "aluminium" """
    contact_width: _Length
    """width of the finely meshed zone around the first point of contact; on the sphere it is the
    contact surface: the contact must stay within it"""
    contact_size: _Length
    """largest element width in the contact zone, and height on its surface"""
    growth: Annotated[float, Quantity(ge=1.0, le=2.0)] = 1.15
    """size of an element over that of its neighbour nearer the contact"""

    @property
    def built_section(self) -> Section:
        """Bodies of revolution by their section, or in space."""
        return "axisymmetric" if self.part == "axisymmetric" else "3D"

    @property
    def named_surfaces(self) -> tuple[str, ...]:
        """The surfaces, with those on which this part is cut out of the whole."""
        planes = {"quarter": ("x", "z"), "half": ("z",)}.get(self.part, ())
        cuts = tuple(f"{body}_symmetry_{axis}" for body in self.bodies for axis in planes)
        return (*self.surfaces, *cuts)

    @property
    def extent(self) -> float:
        """The larger body's width, m."""
        return 2.0 * max(self.sphere.radius, self.block.radius)

    def shape(self) -> SphereOnBlock:
        from tribox.geometry.generators.sphere_on_block import SphereOnBlock

        return SphereOnBlock(
            self.sphere.radius,
            self.block.radius,
            self.block.height,
            self.contact_width,
            self.contact_size,
            self.growth,
            self.part,
            self.cell,
            *self.bodies,
        )

    def problems(self, place: Place) -> Iterator[Problem]:
        """Mistakes in the bodies; `place` is where this table stands in the case."""
        yield from self.shape_problems(place)


# -- The `[geometry]` table of the generator of any number of rectangles or boxes ------------------

_Span = tuple[_Position, _Position]
_Cell = Literal["quadrilateral", "triangle", "hexahedron", "tetrahedron"]
_Grading = Annotated[float, Quantity(gt=0.0)]


class PlacedBlockSize(Model):
    """One rectangle or box: where it lies, and how finely it is meshed."""

    x: _Span
    """from and to in x; with axial symmetry x is the radius"""
    y: _Span
    """from and to in y"""
    z: _Span | None = None
    """from and to in z, of boxes in space"""
    elements: tuple[Elements, ...] | None = None
    """number of elements along x and y (and z), this or size"""
    size: _Length | None = None
    """largest extent of the smallest elements (or elements)"""
    grading: tuple[_Grading, ...] | None = None
    """along x and y (and z), extent of the last element over that of the first; default: all are
    alike"""

    @property
    def spans(self) -> list[_Span]:
        """From and to along each axis, m."""
        return [span for span in (self.x, self.y, self.z) if span is not None]

    def block(self, name: str) -> PlacedBlock:
        """The block as the generator takes it; ValueError says why it cannot be meshed so."""
        from tribox.geometry.generators.blocks import PlacedBlock

        low, high = zip(*self.spans, strict=True)
        return PlacedBlock(name, low, high, self.elements, self.size, self.grading or ())


class PlacedBlocksGeometry(GeneratedGeometry):
    """Rectangles in the plane, or boxes in space, each a body with a name of its own."""

    sizes_by: ClassVar[str] = "elements or size of the blocks"

    kind: Literal["blocks"]
    """which generator makes the mesh"""
    blocks: dict[Name, PlacedBlockSize] = Field(min_length=1)
    """one table [geometry.blocks.NAME] for each body; its sides are the surfaces NAME_left,
    NAME_right, NAME_bottom, NAME_top (and NAME_back, NAME_front)"""
    groups: dict[Name, tuple[Text, ...]] = Field(default={})
    """points and edges with names of their own, for [[boundary]]: each is where the sides of one
    block meet that it lists, two in the plane, two (an edge) or three in space"""
    thickness: Annotated[float, Quantity("m", gt=0.0)] = 1.0
    """thickness of the plane-strain slab for which forces are reported"""
    section: PlaneSection = Field(
        default="plane-strain", description=f"{SECTION}; of blocks in the plane"
    )
    cell: _Cell = Field(
        default_factory=lambda data: (
            "hexahedron"
            if any(block.z is not None for block in (data.get("blocks") or {}).values())
            else "quadrilateral"
        )
    )
    """shape of the elements; default: quadrilateral, in space hexahedron"""

    @property
    def _in_space(self) -> bool:
        return all(block.z is not None for block in self.blocks.values())

    @property
    def named_bodies(self) -> tuple[str, ...]:
        """The names of the blocks."""
        return tuple(self.blocks)

    @property
    def named_surfaces(self) -> tuple[str, ...]:
        """The sides of all blocks."""
        from tribox.geometry.generators.blocks import SIDES

        sides = [side for pair in SIDES[: 3 if self._in_space else 2] for side in pair]
        return tuple(f"{name}_{side}" for name in self.blocks for side in sides)

    @property
    def named_groups(self) -> tuple[str, ...]:
        """The points and edges that have names."""
        return tuple(self.groups)

    @property
    def built_section(self) -> Section:
        """As the case says; boxes are in space."""
        return "3D" if self._in_space else self.section

    @property
    def slab(self) -> float:
        """Thickness of the slab, m; 1 without one."""
        return self.thickness if self.built_section == "plane-strain" else 1.0

    @property
    def extent(self) -> float:
        """Largest extent of a block, m."""
        return max(b - a for block in self.blocks.values() for a, b in block.spans)

    @model_serializer(mode="wrap")
    def _without_idle_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out what means nothing for this section."""
        idle = {"3D": ("section", "thickness"), "axisymmetric": ("thickness",)}
        found = (*idle.get(self.built_section, ()), *(["groups"] * (not self.groups)))
        return {key: value for key, value in handler(self).items() if key not in found}

    def shape(self) -> Blocks:
        from tribox.geometry.generators.blocks import Blocks

        blocks = tuple(b.block(name) for name, b in self.blocks.items())
        return Blocks(blocks, self.cell, dict(self.groups))

    def problems(self, place: Place) -> Iterator[Problem]:
        """Mistakes in the blocks; `place` is where this table stands in the case."""
        flat = [name for name, block in self.blocks.items() if block.z is None]
        if flat and len(flat) < len(self.blocks):
            reason = f"missing: blocks are all in the plane or all in space, and {flat[0]} has no z"
            yield Problem((*place, "blocks", flat[0], "z"), reason)
            return
        given = self.model_fields_set
        if not flat:
            for key in {"section", "thickness"} & given:
                yield Problem((*place, key), "does not go with blocks in space")
        elif self.section == "axisymmetric":
            if "thickness" in given:
                yield Problem((*place, "thickness"), NO_SLAB, self.thickness)
            for name, block in self.blocks.items():
                if block.x[0] < 0.0:
                    reason = "must be >= 0 m: x is the distance from the axis of symmetry"
                    yield Problem((*place, "blocks", name, "x"), reason, list(block.x))
        wrong = False
        for name, block in self.blocks.items():
            try:
                block.block(name)
            except ValueError as error:
                wrong = True
                text = str(error).removeprefix(f"{name}: ")
                yield Problem((*place, "blocks", name), text)
        taken = (*self.named_bodies, *self.named_surfaces)
        for name in self.groups:
            if name in taken:
                wrong = True
                reason = "is the name of a block or of one of its sides already"
                yield Problem((*place, "groups", name), reason)
        if not wrong:
            yield from self.shape_problems(place)
