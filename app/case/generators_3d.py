"""The `[geometry]` tables of the generators of bodies in space."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from tribox.app.case.geometry import GeneratedGeometry
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Elements, Model, Place, Problem

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section
    from tribox.geometry.generators.sphere_on_block import SphereOnBlock
    from tribox.geometry.generators.two_boxes import TwoBoxes

SpaceCell = Literal["hexahedron", "tetrahedron"]
_Length = Annotated[float, Quantity("m", gt=0.0)]
_Position = Annotated[float, Quantity("m")]


class BoxSize(Model):
    """One box of the two-box generator."""

    width: _Length = Field(description="extent in x")
    height: _Length = Field(description="extent in y, upwards")
    depth: _Length = Field(description="extent in z")
    elements: tuple[Elements, Elements, Elements] | None = Field(
        default=None, description="number of elements along x, y and z (this or size)"
    )
    size: _Length | None = Field(
        default=None,
        description="largest element extent in x and z, and in y at the contact side (or elements)",
    )
    grading: Annotated[float, Quantity(gt=0.0)] = Field(
        default=1.0,
        description="element height at the far side over that at the contact side; "
        "above 1 refines towards the contact",
    )


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

    kind: Literal["two-boxes"] = Field(description="which generator makes the mesh")
    cell: SpaceCell = Field(default="hexahedron", description="shape of the elements")
    upper: BoxSize = Field(description='the upper box, body "elastomer"')
    lower: BoxSize = Field(description='the lower box, body "aluminium"')
    offset: tuple[_Position, _Position] = Field(
        default_factory=lambda data: _centred(data),
        description="[x, z] of the upper box's left back corner, from that of the lower box; "
        "default: the boxes are centred",
    )
    gap: Annotated[float, Quantity("m", ge=0.0)] = Field(
        default=0.0, description="distance between the boxes at the start; 0 lets them touch"
    )

    @property
    def built_section(self) -> Section:
        """Bodies in space."""
        return "3D"

    @property
    def extent(self) -> float:
        """Largest width or depth, m."""
        return max(max(box.width, box.depth) for box in (self.lower, self.upper))

    def shape(self) -> TwoBoxes:
        """The shape that the generator meshes.

        Raises:
            ValueError: the boxes cannot be meshed so; the message says why.
        """
        from tribox.geometry.generators.two_boxes import Box, TwoBoxes

        upper, lower = (
            Box(b.width, b.height, b.depth, b.elements, b.size, b.grading)
            for b in (self.upper, self.lower)
        )
        return TwoBoxes(upper, lower, self.offset, self.gap, self.cell, *self.bodies)

    def problems(self, place: Place) -> Iterator[Problem]:
        """Mistakes in the boxes; `place` is where this table stands in the case."""
        found = False
        for name, box in (("upper", self.upper), ("lower", self.lower)):
            if (box.elements is None) == (box.size is None):
                found = True
                reason = "give either elements or size, not both and not neither"
                yield Problem((*place, name), reason)
        if not found:
            yield from self.shape_problems(place)


def _centred(data: dict[str, Any]) -> tuple[float, float]:
    """Offset of a centred upper box; 0 where the boxes themselves are wrong."""
    upper, lower = data.get("upper"), data.get("lower")
    if not isinstance(upper, BoxSize) or not isinstance(lower, BoxSize):
        return 0.0, 0.0
    return 0.5 * (lower.width - upper.width), 0.5 * (lower.depth - upper.depth)


class SphereSize(Model):
    """The hemisphere of the sphere-on-block generator."""

    radius: _Length = Field(description="radius of the sphere")


class RoundBlockSize(Model):
    """The round block under it."""

    radius: _Length = Field(description="radius of the block")
    height: _Length = Field(description="extent in y")


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

    kind: Literal["sphere-on-block"] = Field(description="which generator makes the mesh")
    part: Literal["axisymmetric", "quarter", "half", "full"] = Field(
        default="axisymmetric",
        description='what is meshed: "axisymmetric" the half section x >= 0 in the plane; in space '
        '"quarter" (x, z >= 0), "half" (z >= 0) or "full"',
    )
    cell: Literal["quadrilateral", "triangle", "hexahedron", "tetrahedron"] = Field(
        default_factory=lambda data: (
            "quadrilateral" if data.get("part") == "axisymmetric" else "hexahedron"
        ),
        description="shape of the elements; default: quadrilateral, in space hexahedron",
    )
    sphere: SphereSize = Field(description='the hemisphere above, body "elastomer"')
    block: RoundBlockSize = Field(description='the block below, body "aluminium"')
    contact_width: _Length = Field(
        description="width of the finely meshed zone around the first point of contact; on the "
        "sphere it is the contact surface: the contact must stay within it"
    )
    contact_size: _Length = Field(
        description="largest element width in the contact zone, and height on its surface"
    )
    growth: Annotated[float, Quantity(ge=1.0, le=2.0)] = Field(
        default=1.15, description="size of an element over that of its neighbour nearer the contact"
    )

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
        """The shape that the generator meshes.

        Raises:
            ValueError: the bodies cannot be meshed so; the message says why.
        """
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
