"""The `[bodies.NAME]` tables of a case file: material, mass and formulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from app.case.quantities import Quantity
from app.case.table import Model, Place, Problem

if TYPE_CHECKING:
    from forms.bodies.kinematics import Section

Formulation = Literal["q1", "q1-sri", "q2"]


class BodyVelocity(Model):
    """Velocity of a whole body when the first explicit stage begins."""

    x: Annotated[float, Quantity("m/s")] = Field(default=0.0, description="velocity in x")
    y: Annotated[float, Quantity("m/s")] = Field(default=0.0, description="velocity in y")
    z: Annotated[float, Quantity("m/s")] = Field(
        default=0.0, description="velocity in z; of bodies in space"
    )

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """Keys that do not go with this section; `place` is where this table stands."""
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
        """Mistakes in the material; `place` is where this table stands in the case."""
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
