"""The `[geometry]` and `[bodies.NAME]` tables of a case file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    field_serializer,
    field_validator,
    model_serializer,
)
from pydantic_core import PydanticCustomError

from app.case.quantities import Quantity
from app.case.table import Count, Model, Place, Problem

if TYPE_CHECKING:
    from forms.bodies.kinematics import Section
    from geometry.generators.cylinders import FlatBlock, HalfCylinder, LineContact
    from geometry.generators.two_blocks import TwoBlocks
    from geometry.meshes.gmsh_model import Shape

Cell = Literal["quadrilateral", "triangle"]
Formulation = Literal["q1", "q1-sri", "q2"]
PlaneSection = Literal["plane-strain", "axisymmetric"]
_SECTION = (
    'what a mesh in the plane stands for: "plane-strain" (a slab) or "axisymmetric" (x is the '
    "radius, x = 0 the axis; forces and energies are those of the whole body of revolution)"
)
_NO_SLAB = "goes with plane strain only: forces are those of the whole body"


class GeneratedGeometry(Model):
    """What all built-in generators have: one body on another, names known beforehand."""

    bodies: ClassVar[tuple[str, ...]] = ("elastomer", "aluminium")
    surfaces: ClassVar[tuple[str, ...]] = (
        "elastomer_contact",
        "aluminium_contact",
        "top",
        "bottom",
        "elastomer_left",
        "elastomer_right",
        "aluminium_left",
        "aluminium_right",
    )

    if TYPE_CHECKING:  # a field of each generator, after those its default depends on
        cell: str

    @property
    def named_surfaces(self) -> tuple[str, ...]:
        """The surfaces of this mesh."""
        return self.surfaces

    @property
    def extent(self) -> float:
        """Largest extent of a body, m."""
        raise NotImplementedError

    def shape(self) -> Shape:
        """What is meshed.

        Raises:
            ValueError: it cannot be meshed so; the message says why.
        """
        raise NotImplementedError

    @property
    def built_section(self) -> Section:
        """What the mesh stands for, known before it is made."""
        raise NotImplementedError

    def section_in(self, dim: int) -> Section:
        """What the mesh stands for, ``dim`` being its dimension."""
        return self.built_section

    def resolved(self, dim: int) -> Self:
        """With the defaults filled in that follow from the mesh: there are none."""
        return self

    @property
    def slab(self) -> float:
        """Thickness of a plane-strain slab, m; 1 otherwise."""
        return 1.0


class PlaneGeometry(GeneratedGeometry):
    """What the generators of plane meshes have."""

    cell: Cell = Field(default="quadrilateral", description="shape of the elements")
    thickness: Annotated[float, Quantity("m", gt=0.0)] = Field(
        default=1.0, description="thickness of the plane-strain slab for which forces are reported"
    )

    @property
    def built_section(self) -> Section:
        """Plane strain."""
        return "plane-strain"

    @property
    def slab(self) -> float:
        """Thickness of the slab, m; 1 with axial symmetry."""
        return self.thickness if self.built_section == "plane-strain" else 1.0


class BlockSize(Model):
    """One block of the two-block generator."""

    width: Annotated[float, Quantity("m", gt=0.0)] = Field(description="extent in x")
    height: Annotated[float, Quantity("m", gt=0.0)] = Field(description="extent in y")
    elements: tuple[Count, Count] | None = Field(
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

    kind: Literal["two-blocks"] = Field(description="which generator makes the mesh")
    section: PlaneSection = Field(default="plane-strain", description=_SECTION)
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
        """What the generator takes.

        Raises:
            ValueError: the blocks cannot be meshed so; the message says why.
        """
        from geometry.generators.two_blocks import Block, TwoBlocks

        upper, lower = (
            Block(b.width, b.height, b.elements, b.size, b.grading)
            for b in (self.upper, self.lower)
        )
        return TwoBlocks(upper, lower, self.offset, self.gap, self.cell, *self.bodies)

    def problems(self, place: Place) -> Iterator[Problem]:
        """What is wrong with the blocks, `place` being this table's place in the case."""
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
                yield Problem((*place, "thickness"), _NO_SLAB, self.thickness)
            if self.offset < 0.0:
                found = True
                reason = "must be >= 0 m: x is the distance from the axis of symmetry"
                yield Problem((*place, "offset"), reason, self.offset)
        if not found:
            try:
                self.shape()
            except ValueError as error:
                yield Problem(place, str(error))


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
        from geometry.generators.cylinders import FlatBlock, HalfCylinder

        zone = (size.contact_width or self.contact_width, size.contact_size or self.contact_size)
        if isinstance(size, CylinderSize):
            return HalfCylinder(size.radius, *zone)
        return FlatBlock(size.width, size.height, *zone)

    def shape(self) -> LineContact:
        """What the generator takes.

        Raises:
            ValueError: the bodies cannot be meshed so; the message says why.
        """
        from geometry.generators.cylinders import LineContact

        upper, lower = (self.body(size) for _, size in self.sizes())
        return LineContact(upper, lower, self.growth, self.cell, *self.bodies)

    def problems(self, place: Place) -> Iterator[Problem]:
        """What is wrong with the bodies, `place` being this table's place in the case."""
        wrong = False
        for name, size in self.sizes():
            try:
                self.body(size)
            except ValueError as error:
                wrong = True
                yield Problem((*place, name), str(error))
        if not wrong:
            try:
                self.shape()
            except ValueError as error:
                yield Problem(place, str(error))


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


class MeshGeometry(Model):
    """A mesh made by the user, with named physical groups for bodies and surfaces."""

    kind: Literal["file"] = Field(default="file", description="may be left out where mesh is given")
    mesh: Path = Field(
        description="gmsh file (.msh), relative to the case file; the names of its physical "
        "groups are those of bodies and surfaces"
    )
    section: PlaneSection | None = Field(
        default=None, description=f"{_SECTION}; default: plane-strain"
    )
    thickness: Annotated[float, Quantity("m", gt=0.0)] | None = Field(
        default=None,
        description="thickness of the plane-strain slab for which forces are reported; default 1 m",
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
        """What the mesh stands for, ``dim`` being its dimension.

        Raises:
            ValueError: a key does not go with it; the message names it.
        """
        if dim == 3 and self.section is not None:
            raise ValueError(f'section = "{self.section}": the mesh is in 3D; leave it out')
        if dim == 3 and self.thickness is not None:
            raise ValueError(f"thickness = {self.thickness:g} m: {_NO_SLAB}")
        return "3D" if dim == 3 else self.section or "plane-strain"

    def resolved(self, dim: int) -> Self:
        """With the defaults filled in that follow from the mesh, ``dim`` being its dimension."""
        section = self.section_in(dim)
        if section == "3D":
            return self
        thickness = self.slab if section == "plane-strain" else None
        return self.model_copy(update={"section": section, "thickness": thickness})

    @field_validator("mesh", mode="before")
    @classmethod
    def _find(cls, value: object, info: ValidationInfo) -> Path:
        """Make the path absolute, seen from the case file, and see that it is there."""
        if not isinstance(value, str | Path) or not str(value):
            raise PydanticCustomError("path", "must be the name of a mesh file, in quotes")
        source = (info.context or {}).get("source")
        path = (Path(source or "").parent / value).resolve()
        if not path.is_file():
            raise PydanticCustomError("path", "no such file ({path})", {"path": str(path)})
        return path

    @field_serializer("mesh")
    def _as_text(self, value: Path) -> str:
        return str(value)

    def problems(self, place: Place) -> Iterator[Problem]:
        """A slab without plane strain; no more can be said before the mesh is read."""
        if self.section == "axisymmetric" and self.thickness is not None:
            yield Problem((*place, "thickness"), _NO_SLAB, self.thickness)


class BodyVelocity(Model):
    """Velocity of a whole body when the first explicit stage begins."""

    x: Annotated[float, Quantity("m/s")] = Field(default=0.0, description="velocity in x")
    y: Annotated[float, Quantity("m/s")] = Field(default=0.0, description="velocity in y")
    z: Annotated[float, Quantity("m/s")] = Field(
        default=0.0, description="velocity in z; of bodies in space"
    )

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """What does not go with bodies of this section, `place` being this table's place."""
        if section != "3D" and self.z != 0.0:
            yield Problem((*place, "z"), "there is no z in a mesh in the plane", self.z)
        if section == "axisymmetric" and self.x != 0.0:
            reason = "a body of revolution cannot be thrown off its axis: give y only"
            yield Problem((*place, "x"), reason, self.x)


class _Body(Model):
    """What the bodies of every material have."""

    material: str = Field(description="strain energy of the body")
    density: Annotated[float, Quantity("kg/m^3", gt=0.0)] | None = Field(
        default=None, description="mass per reference volume; needed by explicit dynamics"
    )
    velocity: BodyVelocity | None = Field(
        default=None,
        description="velocity with which the body enters the first explicit stage; explicit only",
    )
    formulation: Formulation | None = Field(
        default=None,
        description='displacement and integration of the elements: "q1-sri" first order, selective '
        'reduced; "q1" first order, full; "q2" second order, full (all bodies then); default: '
        '"q1-sri" for quadrilaterals and hexahedra, "q1" for triangles and tetrahedra',
    )

    def problems(self, place: Place) -> Iterator[Problem]:
        """What is wrong with the material, `place` being this table's place in the case."""
        return iter(())

    def formulation_for(self, cell: str) -> Formulation:
        """The formulation for elements of this shape, of this body by itself.

        Raises:
            ValueError: selective reduced integration was asked for on triangles or tetrahedra.
        """
        simplex = {"triangle": "triangles", "tetrahedron": "tetrahedra"}.get(cell)
        if simplex is not None and self.formulation == "q1-sri":
            needs = '"q1-sri" needs quadrilaterals or hexahedra'
            raise ValueError(f'{needs}; use "q1" or "q2" for {simplex}')
        return self.formulation or ("q1-sri" if simplex is None else "q1")


class _Isotropic(_Body):
    """Two elastic constants: E and nu, or G and K."""

    E: Annotated[float, Quantity("Pa", gt=0.0)] | None = Field(
        default=None, description="Young's modulus"
    )
    nu: Annotated[float, Quantity(gt=-1.0, lt=0.5)] | None = Field(
        default=None, description="Poisson's ratio"
    )
    G: Annotated[float, Quantity("Pa", gt=0.0)] | None = Field(
        default=None, description="shear modulus (with K, instead of E and nu)"
    )
    K: Annotated[float, Quantity("Pa", gt=0.0)] | None = Field(
        default=None, description="bulk modulus (with G, instead of E and nu)"
    )

    def problems(self, place: Place) -> Iterator[Problem]:
        """A pair of constants that is missing or not one of the two."""
        given = {key for key in ("E", "nu", "G", "K") if getattr(self, key) is not None}
        if given not in ({"E", "nu"}, {"G", "K"}):
            listed = " and ".join(sorted(given)) or "none of them"
            yield Problem(place, f"give E and nu, or G and K; found {listed}")

    @property
    def shear_modulus(self) -> float:
        """G, Pa."""
        if self.G is not None:
            return self.G
        assert self.E is not None and self.nu is not None
        return self.E / (2.0 * (1.0 + self.nu))

    @property
    def bulk_modulus(self) -> float:
        """K, Pa."""
        if self.K is not None:
            return self.K
        assert self.E is not None and self.nu is not None
        return self.E / (3.0 * (1.0 - 2.0 * self.nu))


class NeoHookeanBody(_Isotropic):
    """W = G/2 (I1 − 3) − G ln J + Λ/2 (ln J)², Λ = K − 2G/3."""

    material: Literal["neo-hookean"] = Field(description="strain energy of the body")


class HenckyBody(_Isotropic):
    """W = G |dev ln U|² + K/2 (ln J)²."""

    material: Literal["hencky"] = Field(description="strain energy of the body")


class MooneyRivlinBody(_Body):
    """W = C10 (Ī1 − 3) + C01 (Ī2 − 3) + a volumetric part in K."""

    material: Literal["mooney-rivlin"] = Field(description="strain energy of the body")
    C10: Annotated[float, Quantity("Pa")] = Field(description="constant of the first invariant")
    C01: Annotated[float, Quantity("Pa")] = Field(description="constant of the second invariant")
    K: Annotated[float, Quantity("Pa", gt=0.0)] = Field(description="bulk modulus")

    def problems(self, place: Place) -> Iterator[Problem]:
        """A shear modulus that is not positive."""
        if self.shear_modulus <= 0.0:
            found = self.C10 + self.C01
            yield Problem(
                place, f"C10 + C01 = {found:g} Pa: must be > 0 Pa (half the shear modulus)"
            )

    @property
    def shear_modulus(self) -> float:
        """G = 2 (C10 + C01), Pa."""
        return 2.0 * (self.C10 + self.C01)

    @property
    def bulk_modulus(self) -> float:
        """K, Pa."""
        return self.K


Body = Annotated[NeoHookeanBody | HenckyBody | MooneyRivlinBody, Field(discriminator="material")]


def formulations(bodies: Mapping[str, Body], cell: str) -> dict[str, Formulation]:
    """The formulation of each body for elements of this shape; "q2" of one is that of all.

    Raises:
        ValueError: see `formulation_problems`.
    """
    for _, reason in formulation_problems(bodies, cell):
        raise ValueError(reason)
    if any(body.formulation == "q2" for body in bodies.values()):
        return dict.fromkeys(bodies, "q2")
    return {name: body.formulation_for(cell) for name, body in bodies.items()}


def formulation_problems(bodies: Mapping[str, Body], cell: str) -> Iterator[tuple[str, str]]:
    """(body, reason) wherever a formulation does not go with the elements or another body's."""
    second = [name for name, body in bodies.items() if body.formulation == "q2"]
    for name, body in bodies.items():
        try:
            body.formulation_for(cell)
        except ValueError as error:
            yield name, str(error)
            continue
        if second and body.formulation not in (None, "q2"):
            yield (
                name,
                f'bodies.{second[0]} has "q2", and one displacement of one order serves all '
                'bodies; give all of them "q2", or none',
            )
