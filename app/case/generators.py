"""The `[geometry]` tables of the generators of meshes in the plane."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from tribox.app.case.geometry import NO_SLAB, SECTION, PlaneGeometry, PlaneSection
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Elements, Model, Place, Problem

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section
    from tribox.geometry.generators.cylinders import FlatBlock, HalfCylinder, LineContact
    from tribox.geometry.generators.two_blocks import TwoBlocks


class BlockSize(Model):
    """One block of the two-block generator."""

    width: Annotated[float, Quantity("m", gt=0.0)] = Field(description="extent in x")
    height: Annotated[float, Quantity("m", gt=0.0)] = Field(description="extent in y")
    elements: tuple[Elements, Elements] | None = Field(
        default=None, description="number of elements along x and y (this or size)"
    )
    size: Annotated[float, Quantity("m", gt=0.0)] | None = Field(
        default=None,
        description="largest element width, and height at the contact side (or elements)",
    )
    grading: Annotated[float, Quantity(gt=0.0)] = Field(
        default=1.0,
        description="element height at the far side over that at the contact side; "
        "above 1 refines towards the contact",
    )


class BlocksGeometry(PlaneGeometry):
    """Two rectangular blocks, one on the other, meshed by the built-in generator."""

    sizes_by: ClassVar[str] = "elements or size of upper and lower"

    kind: Literal["two-blocks"] = Field(description="which generator makes the mesh")
    section: PlaneSection = Field(default="plane-strain", description=SECTION)
    upper: BlockSize = Field(description='the upper block, body "elastomer"')
    lower: BlockSize = Field(description='the lower block, body "aluminium"')
    offset: Annotated[float, Quantity("m")] = Field(
        default_factory=lambda data: _centred(data),
        description="x of the upper block's left side, from the lower block's left side; "
        "default: the blocks are centred, with axial symmetry 0",
    )
    gap: Annotated[float, Quantity("m", ge=0.0)] = Field(
        default=0.0,
        description="distance between the blocks at the start; 0 lets them touch exactly",
    )

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
        """The shape that the generator meshes.

        Raises:
            ValueError: the blocks cannot be meshed so; the message says why.
        """
        from tribox.geometry.generators.two_blocks import Block, TwoBlocks

        upper, lower = (
            Block(b.width, b.height, b.elements, b.size, b.grading)
            for b in (self.upper, self.lower)
        )
        return TwoBlocks(upper, lower, self.offset, self.gap, self.cell, *self.bodies)

    def problems(self, place: Place) -> Iterator[Problem]:
        """Mistakes in the blocks; `place` is where this table stands in the case."""
        found = False
        for name, block in (("upper", self.upper), ("lower", self.lower)):
            if (block.elements is None) == (block.size is None):
                found = True
                reason = "give either elements or size, not both and not neither"
                yield Problem((*place, name), reason)
        low, high = -self.upper.width, self.lower.width
        if not low < self.offset < high:
            found = True
            reason = f"must lie between {low:g} m and {high:g} m, where the blocks overlap"
            yield Problem((*place, "offset"), reason, self.offset)
        if self.section == "axisymmetric":
            if "thickness" in self.model_fields_set:
                yield Problem((*place, "thickness"), NO_SLAB, self.thickness)
            if self.offset < 0.0:
                found = True
                reason = "must be >= 0 m: x is the distance from the axis of symmetry"
                yield Problem((*place, "offset"), reason, self.offset)
        if not found:
            yield from self.shape_problems(place)


def _centred(data: dict[str, Any]) -> float:
    """Offset of a centred upper block; 0 on the axis, or where the blocks themselves are wrong."""
    upper, lower = data.get("upper"), data.get("lower")
    if data.get("section") == "axisymmetric":
        return 0.0
    if not isinstance(upper, BlockSize) or not isinstance(lower, BlockSize):
        return 0.0
    return 0.5 * (lower.width - upper.width)


_Width = Annotated[float, Quantity("m", gt=0.0)]


class _ZoneSize(Model):
    """How finely one body of a line contact is meshed, where it differs from the other."""

    contact_width: _Width | None = Field(
        default=None, description="width of this body's contact zone; default: geometry's"
    )
    contact_size: _Width | None = Field(
        default=None, description="element width in this body's contact zone; default: geometry's"
    )


class CylinderSize(_ZoneSize):
    """A cylinder, cut in half, of the line-contact generators."""

    radius: _Width = Field(description="radius; the flat side of the half is the far side")


class FlatSize(_ZoneSize):
    """The block under a cylinder."""

    width: _Width = Field(description="extent in x")
    height: _Width = Field(description="extent in y")


class _LineGeometry(PlaneGeometry):
    """What the two line-contact generators share."""

    contact_width: _Width = Field(
        description="width of the finely meshed contact zone around the first line of contact, "
        "which is the contact surface: the contact must stay within it"
    )
    contact_size: _Width = Field(
        description="largest element width in the contact zone, and height on its surface"
    )
    growth: Annotated[float, Quantity(ge=1.0, le=2.0)] = Field(
        default=1.15, description="size of an element over that of its neighbour nearer the contact"
    )

    def sizes(self) -> tuple[tuple[str, CylinderSize], tuple[str, CylinderSize | FlatSize]]:
        """The upper and the lower body, each with its key."""
        raise NotImplementedError

    @property
    def extent(self) -> float:
        """The larger body's width, m."""
        return max(_width(size) for _, size in self.sizes())

    def body(self, size: CylinderSize | FlatSize) -> HalfCylinder | FlatBlock:
        """One body as the generator takes it.

        Raises:
            ValueError: it cannot be meshed so; the message says why.
        """
        from tribox.geometry.generators.cylinders import FlatBlock, HalfCylinder

        zone = (size.contact_width or self.contact_width, size.contact_size or self.contact_size)
        if isinstance(size, CylinderSize):
            return HalfCylinder(size.radius, *zone)
        return FlatBlock(size.width, size.height, *zone)

    def shape(self) -> LineContact:
        """The shape that the generator meshes.

        Raises:
            ValueError: the bodies cannot be meshed so; the message says why.
        """
        from tribox.geometry.generators.cylinders import LineContact

        upper, lower = (self.body(size) for _, size in self.sizes())
        return LineContact(upper, lower, self.growth, self.cell, *self.bodies)

    def problems(self, place: Place) -> Iterator[Problem]:
        """Mistakes in the bodies; `place` is where this table stands in the case."""
        wrong = False
        for name, size in self.sizes():
            try:
                self.body(size)
            except ValueError as error:
                wrong = True
                yield Problem((*place, name), str(error))
        if not wrong:
            yield from self.shape_problems(place)


def _width(size: CylinderSize | FlatSize) -> float:
    return 2.0 * size.radius if isinstance(size, CylinderSize) else size.width


class CylinderOnBlockGeometry(_LineGeometry):
    """A half cylinder on a block, touching at x = y = 0."""

    kind: Literal["cylinder-on-block"] = Field(description="which generator makes the mesh")
    cylinder: CylinderSize = Field(description='the half cylinder above, body "elastomer"')
    block: FlatSize = Field(description='the block below, body "aluminium"')

    def sizes(self) -> tuple[tuple[str, CylinderSize], tuple[str, FlatSize]]:
        """The cylinder and the block."""
        return ("cylinder", self.cylinder), ("block", self.block)


class TwoCylindersGeometry(_LineGeometry):
    """A half cylinder on another with a parallel axis, touching at x = y = 0."""

    kind: Literal["two-cylinders"] = Field(description="which generator makes the mesh")
    upper: CylinderSize = Field(description='the half cylinder above, body "elastomer"')
    lower: CylinderSize = Field(description='the half cylinder below, body "aluminium"')

    def sizes(self) -> tuple[tuple[str, CylinderSize], tuple[str, CylinderSize]]:
        """The upper and the lower cylinder."""
        return ("upper", self.upper), ("lower", self.lower)
