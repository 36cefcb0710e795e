"""The `[geometry]` table of the generator of any number of rectangles or boxes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from tribox.app.case.geometry import NO_SLAB, SECTION, GeneratedGeometry, PlaneSection
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Elements, Model, Name, Place, Problem, Text

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section
    from tribox.geometry.generators.blocks import Blocks, PlacedBlock

_Position = Annotated[float, Quantity("m")]
_Span = tuple[_Position, _Position]
_Cell = Literal["quadrilateral", "triangle", "hexahedron", "tetrahedron"]
_Grading = Annotated[float, Quantity(gt=0.0)]


class PlacedBlockSize(Model):
    """One rectangle or box: where it lies, and how finely it is meshed."""

    x: _Span = Field(description="from and to in x; with axial symmetry x is the radius")
    y: _Span = Field(description="from and to in y")
    z: _Span | None = Field(default=None, description="from and to in z, of boxes in space")
    elements: tuple[Elements, ...] | None = Field(
        default=None, description="number of elements along x and y (and z), this or size"
    )
    size: Annotated[float, Quantity("m", gt=0.0)] | None = Field(
        default=None, description="largest extent of the smallest elements (or elements)"
    )
    grading: tuple[_Grading, ...] | None = Field(
        default=None,
        description="along x and y (and z), extent of the last element over that of the first; "
        "default: all are alike",
    )

    @property
    def spans(self) -> list[_Span]:
        """From and to along each axis, m."""
        return [span for span in (self.x, self.y, self.z) if span is not None]

    def block(self, name: str) -> PlacedBlock:
        """The block as the generator takes it.

        Raises:
            ValueError: it cannot be meshed so; the message says why.
        """
        from tribox.geometry.generators.blocks import PlacedBlock

        low, high = zip(*self.spans, strict=True)
        return PlacedBlock(name, low, high, self.elements, self.size, self.grading or ())


def _usual_cell(data: dict[str, Any]) -> _Cell:
    """Quadrilaterals, or hexahedra where a block has an extent in z."""
    blocks = (data.get("blocks") or {}).values()
    return "hexahedron" if any(block.z is not None for block in blocks) else "quadrilateral"


class PlacedBlocksGeometry(GeneratedGeometry):
    """Rectangles in the plane, or boxes in space, each a body with a name of its own."""

    sizes_by: ClassVar[str] = "elements or size of the blocks"

    kind: Literal["blocks"] = Field(description="which generator makes the mesh")
    blocks: dict[Name, PlacedBlockSize] = Field(
        min_length=1,
        description="one table [geometry.blocks.NAME] for each body; its sides are the surfaces "
        "NAME_left, NAME_right, NAME_bottom, NAME_top (and NAME_back, NAME_front)",
    )
    groups: dict[Name, tuple[Text, ...]] = Field(
        default={},
        description="points and edges with names of their own, for [[boundary]]: each is where the "
        "sides of one block meet that it lists, two in the plane, two (an edge) or three in space",
    )
    thickness: Annotated[float, Quantity("m", gt=0.0)] = Field(
        default=1.0, description="thickness of the plane-strain slab for which forces are reported"
    )
    section: PlaneSection = Field(
        default="plane-strain", description=f"{SECTION}; of blocks in the plane"
    )
    cell: _Cell = Field(
        default_factory=lambda data: _usual_cell(data),
        description="shape of the elements; default: quadrilateral, in space hexahedron",
    )

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
        """The shape that the generator meshes.

        Raises:
            ValueError: the blocks cannot be meshed so; the message says why.
        """
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
