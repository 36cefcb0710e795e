"""What the `[geometry]` tables of a case file share, and that of a mesh made by the user."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Protocol, Self

from pydantic import BeforeValidator, Field, ValidationInfo, field_serializer, field_validator

from tribox.app.case.quantities import Quantity
from tribox.app.case.table import MOST_ENTRIES, Count, Model, Place, Problem
from tribox.app.case.toml_files import found_file
from tribox.geometry.meshes.drawing import DRAWINGS, STEP, Meshing

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section

Cell = Literal["quadrilateral", "triangle"]
PlaneSection = Literal["plane-strain", "axisymmetric"]
SECTION = (
    'what a mesh in the plane stands for: "plane-strain" (a slab) or "axisymmetric" (x is the '
    "radius, x = 0 the axis; forces and energies are those of the whole body of revolution)"
)
MaxCells = Annotated[
    Count,
    Field(
        description="most cells of the mesh: more are refused before they are made or read, as a "
        "mistake in a size"
    ),
]
MOST_CELLS = 5_000_000
NO_SLAB = "goes with plane strain only: forces are those of the whole body"


_DRAWINGS = "drawings only"
Length = Annotated[float, Quantity("m", gt=0.0)]
Point = Annotated[tuple[Annotated[float, Quantity("m")], ...], Field(min_length=2, max_length=3)]
Spots = Annotated[tuple[Count | Point, ...], Field(min_length=1, max_length=MOST_ENTRIES)]
UNITS = ("m", "mm", "um", "nm", "inch")
"""Units of coordinates that are offered; any other one of length can be given too."""


def _one_of_unit(value: object) -> object:
    """A unit alone, such as "mm", as a quantity: one of it."""
    text = isinstance(value, str) and value.strip()
    return f"1 {text}" if text and text[0].isalpha() else value


def _offer_units(schema: dict[str, Any]) -> None:
    """Let the schema allow the units that are known, without a number."""
    schema["anyOf"].append({"enum": list(UNITS)})


Scale = Annotated[
    float,
    Quantity("m", gt=0.0),
    BeforeValidator(_one_of_unit),
    Field(json_schema_extra=_offer_units),
]


class CountedShape(Protocol):
    """A built-in geometry, which knows its number of cells beforehand."""

    def build(self) -> None:
        """Draw, name and mesh it in the current gmsh model."""
        ...

    def cells(self) -> int:
        """Number of cells of all bodies."""
        ...


class GeneratedGeometry(Model):
    """What all built-in generators have: one body on another, names known beforehand."""

    sizes_by: ClassVar[str] = "contact_size or growth"
    bodies: ClassVar[tuple[str, ...]] = ("elastomer", "aluminium")
    surfaces: ClassVar[tuple[str, ...]] = (
        *("elastomer_contact", "aluminium_contact", "top", "bottom"),
        *("elastomer_left", "elastomer_right", "aluminium_left", "aluminium_right"),
    )

    max_cells: MaxCells = MOST_CELLS

    if TYPE_CHECKING:  # a field of each generator, after those its default depends on
        cell: str

    @property
    def named_bodies(self) -> tuple[str, ...]:
        """The bodies of this mesh."""
        return self.bodies

    @property
    def named_surfaces(self) -> tuple[str, ...]:
        """The surfaces of this mesh."""
        return self.surfaces

    @property
    def named_groups(self) -> tuple[str, ...]:
        """The groups of points and edges of this mesh."""
        return ()

    @property
    def extent(self) -> float:
        """Largest extent of a body, m."""
        raise NotImplementedError

    def shape(self) -> CountedShape:
        """The shape that is meshed; ValueError if it cannot be meshed so; the message says why."""
        raise NotImplementedError

    @property
    def built_section(self) -> Section:
        """What the mesh stands for, known before it is made."""
        raise NotImplementedError

    def section_in(self, dim: int) -> Section:
        """What the mesh stands for, ``dim`` being its dimension."""
        return self.built_section

    def shape_problems(self, place: Place) -> Iterator[Problem]:
        """What keeps the shape from being meshed; `place` is where this table stands."""
        try:
            cells = self.shape().cells()
        except ValueError as error:
            yield Problem(place, str(error))
            return
        if cells > self.max_cells:
            reason = (
                f"the mesh would have {cells:.4g} cells; make it coarser by {self.sizes_by}, or "
                "raise this"
            )
            yield Problem((*place, "max_cells"), reason, self.max_cells)

    def resolved(self, dim: int) -> Self:
        """With the defaults filled in that follow from the mesh: there are none."""
        return self

    @property
    def slab(self) -> float:
        """Thickness of a plane-strain slab, m; 1 otherwise."""
        return 1.0


class PlaneGeometry(GeneratedGeometry):
    """What the generators of plane meshes have."""

    cell: Cell = "quadrilateral"
    """shape of the elements"""
    thickness: Annotated[float, Quantity("m", gt=0.0)] = 1.0
    """thickness of the plane-strain slab for which forces are reported"""

    @property
    def built_section(self) -> Section:
        """Plane strain."""
        return "plane-strain"

    @property
    def slab(self) -> float:
        """Thickness of the slab, m; 1 with axial symmetry."""
        return self.thickness if self.built_section == "plane-strain" else 1.0


class MeshGeometry(Model):
    """A mesh made by the user, with named physical groups for bodies and surfaces."""

    kind: Literal["file"] = "file"
    """may be left out where mesh is given"""
    mesh: Path
    """gmsh file (.msh) or drawing (.geo, .step, .stp), relative to the case file; the names of its
    physical groups are those of bodies and surfaces"""
    size: Length | None = Field(
        default=None, description=f"largest element size; {_DRAWINGS}; default: the drawing's own"
    )
    sizes: dict[str, Length] | None = Field(
        default=None,
        description="element sizes by name: on a surface, growing away from it by a fifth of the "
        f"distance, or all through a body; with size; {_DRAWINGS}",
    )
    order: Literal[1, 2] | None = Field(
        default=None,
        description=f"1: straight cells, 2: curved ones; {_DRAWINGS}; default: the drawing's own",
    )
    cell: Literal["triangle", "quadrilateral", "tetrahedron", "hexahedron"] | None = Field(
        default=None, description=f"shape of the cells; {_DRAWINGS}; default: the drawing's own"
    )
    bodies: dict[str, Spots] | None = Field(
        default=None,
        description="names of volumes (in the plane faces): their numbers, or points in them, "
        f"which tribox mesh shows; {_DRAWINGS}",
    )
    surfaces: dict[str, Spots] | None = Field(
        default=None,
        description=f"names of faces (in the plane curves): likewise, points on them; {_DRAWINGS}",
    )
    meshed: Path | None = None
    """mesh that was made of the drawing and is read instead: in the case.toml of results"""
    scale: Scale | None = None
    """unit of the coordinates in the file, such as "mm", or its size in m; default: m, with a note
    where the mesh is so large that another one is likely"""
    max_cells: MaxCells = MOST_CELLS
    section: PlaneSection | None = Field(
        default=None, description=f"{SECTION}; default: plane-strain"
    )
    thickness: Annotated[float, Quantity("m", gt=0.0)] | None = None
    """thickness of the plane-strain slab for which forces are reported; default 1 m"""

    @property
    def is_drawing(self) -> bool:
        """Whether the mesh is still to be made."""
        return self.mesh.suffix.lower() in DRAWINGS

    @property
    def unit(self) -> float:
        """Length of a unit of the coordinates, m; a STEP file says it itself."""
        return 1.0 if self.scale is None else self.scale

    @property
    def says_unit(self) -> bool:
        """Whether the unit of the coordinates is known."""
        return self.scale is not None or self.mesh.suffix.lower() in STEP

    def meshing(self) -> Meshing:
        """How the drawing is meshed."""

        def spots(parts: dict[str, Spots] | None) -> dict[str, list[int | list[float]]]:
            return {
                name: [s if isinstance(s, int) else [x / self.unit for x in s] for s in some]
                for name, some in (parts or {}).items()
            }

        return Meshing(
            None if self.size is None else self.size / self.unit,
            {name: size / self.unit for name, size in (self.sizes or {}).items()},
            self.order,
            self.cell,
            spots(self.bodies),
            spots(self.surfaces),
            most=self.max_cells,
        )

    @property
    def slab(self) -> float:
        """Thickness of a plane-strain slab, m; 1 otherwise."""
        return 1.0 if self.thickness is None else self.thickness

    @property
    def built_section(self) -> Section | None:
        """What the mesh stands for, as far as the case says."""
        return self.section

    def section_in(self, dim: int) -> Section:
        """What a mesh of dimension ``dim`` stands for; ValueError names a key that does not go."""
        if dim == 3 and self.section is not None:
            raise ValueError(f'section = "{self.section}": the mesh is in 3D; leave it out')
        if dim == 3 and self.thickness is not None:
            raise ValueError(f"thickness = {self.thickness:g} m: {NO_SLAB}")
        return "3D" if dim == 3 else self.section or "plane-strain"

    def resolved(self, dim: int) -> Self:
        """With the defaults filled in that follow from the mesh, ``dim`` being its dimension."""
        section = self.section_in(dim)
        if section == "3D":
            return self
        thickness = self.slab if section == "plane-strain" else None
        return self.model_copy(update={"section": section, "thickness": thickness})

    @field_validator("mesh", "meshed", mode="before")
    @classmethod
    def _find(cls, value: object, info: ValidationInfo) -> Path:
        """See that the file is there, unless the run is over (``past``); its absolute path."""
        return found_file(value, info.context or {}, "a mesh file")

    @field_serializer("mesh", "meshed")
    def _as_text(self, value: Path | None) -> str | None:
        return None if value is None else str(value)

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not go together; no more can be said before the mesh is read."""
        if self.section == "axisymmetric" and self.thickness is not None:
            yield Problem((*place, "thickness"), NO_SLAB, self.thickness)
        for key in ("size", "sizes", "order", "cell", "bodies", "surfaces", "meshed"):
            value = getattr(self, key)
            if value is not None and not self.is_drawing:
                reason = f"goes with a drawing ({', '.join(DRAWINGS)}); {self.mesh.name} is a mesh"
                yield Problem((*place, key), reason)
        if self.meshed is not None and self.meshed.suffix.lower() in DRAWINGS:
            reason = "is a drawing; what was made of one is a mesh"
            yield Problem((*place, "meshed"), reason, self.meshed)
        if self.sizes and self.size is None:
            yield Problem((*place, "size"), "missing; sizes needs the size everywhere else")
        for name, size in (self.sizes or {}).items():
            if self.size is not None and size > self.size:
                reason = f"is larger than size = {self.size:g} m, the largest element size"
                yield Problem((*place, "sizes", name), reason, size)
        if self.mesh.suffix.lower() in STEP and self.scale is not None:
            yield Problem((*place, "scale"), "a STEP file says its unit itself", self.scale)
