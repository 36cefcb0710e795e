"""The `[bodies.NAME]` tables of a case file: material, mass and formulation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import Field, WrapValidator

from tribox.app.case.declared import DeclaredTable, table_of
from tribox.app.case.library import from_library
from tribox.app.case.own_code import NamesAClass, load_own_material
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Model, Name, Place, Problem
from tribox.app.case.time_tables import Row, Rows
from tribox.forms.bodies import hardening
from tribox.forms.bodies.materials import ENERGIES, Hencky, Material, NeoHookean
from tribox.forms.parameters import Declared

if TYPE_CHECKING:
    from tribox.forms.bodies.kinematics import Section
    from tribox.forms.bodies.softening import Mullins


def _union(kinds: Mapping[str, type[Declared]], suffix: str, what: str) -> Any:
    """A table for each law, told apart by its key ``law``."""
    field = Field(description=f"how the yield stress rises with {what}")
    tables = [
        table_of(kind.__name__ + suffix, kind, tag={"law": (Literal[law], field)})
        for law, kind in kinds.items()
    ]
    return Annotated[Union[*tables], Field(discriminator="law")]


if TYPE_CHECKING:
    Hardening = DeclaredTable
    Rate = DeclaredTable
else:
    Hardening = _union(hardening.HARDENING, "Hardening", "plastic strain")
    Rate = _union(hardening.RATES, "Rate", "the rate")

MOST_BRANCHES = 8  # of the backstress: as many as the compiled loop over points has room for
_Branch = tuple[
    Annotated[float, Quantity("Pa", gt=0.0, name="c")], Annotated[float, Quantity(ge=0.0, name="b")]
]
Kinematic = Annotated[tuple[_Branch, ...], Field(max_length=MOST_BRANCHES)]


Formulation = Literal["q1", "q1-sri", "q2"]
GAS_CONSTANT = 8.31446261815324  # J/(mol K)
WLF_RANGE = 50.0, 150.0  # K above T_ref - C2 that the law describes: from the glass to 100 K on
MOST_DECADES = 30  # by which a temperature may shift relaxation times
_ENERGY = Field(description="strain energy of the body")
_SHARE = Quantity(gt=0.0, lt=1.0, name="share")
_TIME = Quantity("s", gt=0.0, name="relaxation time")


class BodyVelocity(Model):
    """Velocity of a whole body when the first explicit stage begins."""

    x: Annotated[float, Quantity("m/s")] = 0.0
    """velocity in x"""
    y: Annotated[float, Quantity("m/s")] = 0.0
    """velocity in y"""
    z: Annotated[float, Quantity("m/s")] = 0.0
    """velocity in z; of bodies in space"""

    def section_problems(self, section: Section, place: Place) -> Iterator[Problem]:
        """Keys that do not go with this section; `place` is where this table stands."""
        if section != "3D" and self.z != 0.0:
            yield Problem((*place, "z"), "there is no z in a mesh in the plane", self.z)
        if section == "axisymmetric" and self.x != 0.0:
            reason = "a body of revolution cannot be thrown off its axis: give y only"
            yield Problem((*place, "x"), reason, self.x)


class _Body(Model):
    """What the bodies of every material have."""

    material: str
    """strain energy of the body"""
    library: Name | None = None
    """entry of the materials library from which the keys come that are not given; material = NAME
    of an entry sets it"""
    density: Annotated[float, Quantity("kg/m^3", gt=0.0)] | None = None
    """mass per reference volume; needed by explicit dynamics"""
    velocity: BodyVelocity | None = None
    """velocity with which the body enters the first explicit stage; explicit only"""
    formulation: Formulation | None = None
    """displacement and integration of the elements: "q1-sri" first order, selective reduced; "q1"
    first order, full; "q2" second order, full (all bodies then); default: "q1-sri" for
    quadrilaterals and hexahedra, "q1" for triangles and tetrahedra"""

    def problems(self, place: Place) -> Iterator[Problem]:
        """Mistakes in the material; `place` is where this table stands in the case."""
        return iter(())

    def material_of(self, runs_code: bool = True) -> Material:
        """Strain energy and what it remembers; OwnCodeError if one in Python cannot be used."""
        raise NotImplementedError

    @property
    def called(self) -> str:
        """The material in words."""
        return self.material

    def formulation_for(self, cell: str) -> Formulation:
        """The formulation for such elements; ValueError if "q1-sri" does not go with them."""
        simplex = {"triangle": "triangles", "tetrahedron": "tetrahedra"}.get(cell)
        if simplex is not None and self.formulation == "q1-sri":
            needs = '"q1-sri" needs quadrilaterals or hexahedra'
            raise ValueError(f'{needs}; use "q1" or "q2" for {simplex}')
        return self.formulation or ("q1-sri" if simplex is None else "q1")


class _Isotropic(_Body):
    """Two elastic constants: E and nu, or G and K."""

    E: Annotated[float, Quantity("Pa", gt=0.0)] | None = None
    """Young's modulus"""
    nu: Annotated[float, Quantity(gt=-1.0, lt=0.5)] | None = None
    """Poisson's ratio"""
    G: Annotated[float, Quantity("Pa", gt=0.0)] | None = None
    """shear modulus (with K, instead of E and nu)"""
    K: Annotated[float, Quantity("Pa", gt=0.0)] | None = None
    """bulk modulus (with G, instead of E and nu)"""

    def problems(self, place: Place) -> Iterator[Problem]:
        """A pair of constants that is missing or not one of the two."""
        yield from super().problems(place)
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


class _Shift(Model):
    """What multiplies all relaxation times by a_T at a temperature that is not theirs."""

    reference: Annotated[float, Quantity("K", gt=0.0)]
    """temperature T_ref that prony holds at"""
    temperature: Annotated[float, Quantity("K", gt=0.0)]
    """temperature T of the body, all through the run"""

    @property
    def log_factor(self) -> float:
        """The natural logarithm of a_T."""
        raise NotImplementedError

    def problems(self, place: Place) -> Iterator[Problem]:
        """A factor beyond all use."""
        decades = self.log_factor / math.log(10.0)
        if abs(decades) > MOST_DECADES:
            reason = f"shifts the relaxation times by {decades:.3g} decades: more than"
            yield Problem(place, f"{reason} {MOST_DECADES}")

    def notes(self) -> Iterator[str]:
        """What may surprise; nothing where it is not known where the law ends."""
        return iter(())


class WlfShift(_Shift):
    """log₁₀ a_T = −C1 (T − T_ref)/(C2 + T − T_ref)."""

    law: Literal["wlf"]
    """how relaxation times follow the temperature"""
    C1: Annotated[float, Quantity(gt=0.0)]
    """constant of log10(a_T) = -C1 (T - T_ref)/(C2 + T - T_ref), by which all relaxation times are
    multiplied (Williams, Landel & Ferry)"""
    C2: Annotated[float, Quantity("kelvin", gt=0.0)]
    """constant of it, a difference of temperatures"""

    def problems(self, place: Place) -> Iterator[Problem]:
        """A temperature below the range of the law, or a factor beyond all use."""
        if self.above <= 0.0:
            least = self.reference - self.C2
            yield Problem((*place, "temperature"), f"must be > {least:g} K, reference - C2")
        else:
            yield from super().problems(place)

    @property
    def above(self) -> float:
        """The temperature over the one where all relaxation ends, T_ref - C2, K."""
        return self.C2 + self.temperature - self.reference

    @property
    def log_factor(self) -> float:
        """The natural logarithm of a_T."""
        return -math.log(10.0) * self.C1 * (self.temperature - self.reference) / self.above

    def notes(self) -> Iterator[str]:
        """A temperature that is not the law's."""
        low, high = WLF_RANGE
        if not low <= self.above <= high:
            yield (
                f"{self.above:.4g} K above reference - C2, where the law of Williams, Landel & "
                f"Ferry is extrapolated: it holds from some {low:g} K (the glass) to {high:g} K"
            )


class ArrheniusShift(_Shift):
    """ln a_T = E/R (1/T − 1/T_ref)."""

    law: Literal["arrhenius"]
    """how relaxation times follow the temperature"""
    energy: Annotated[float, Quantity("J/mol", gt=0.0)]
    """activation energy E of ln(a_T) = E/R (1/T - 1/T_ref), by which all relaxation times are
    multiplied"""

    @property
    def log_factor(self) -> float:
        """The natural logarithm of a_T."""
        return self.energy / GAS_CONSTANT * (1.0 / self.temperature - 1.0 / self.reference)


Shift = Annotated[WlfShift | ArrheniusShift, Field(discriminator="law")]


class MullinsTable(Model):
    """η = 1 − erf((W_m − W)/(m + beta W_m))/r, the share of the stress that is left."""

    r: Annotated[float, Quantity(gt=1.0)]
    """1/r is the largest share of the stress that is lost"""
    m: Annotated[float, Quantity("Pa", gt=0.0)]
    """strain energy (J/m^3 = Pa) from whose order on the body softens"""
    beta: Annotated[float, Quantity(ge=0.0)] = 0.0
    """share of the largest energy that is added to m"""

    def law_of(self) -> Mullins:
        """The softening."""
        from tribox.forms.bodies.softening import Mullins

        return Mullins(self.r, self.m, self.beta)


class Elastomer(_Body):
    """What bodies have whose resistance to distortion may relax, or soften."""

    mullins: MullinsTable | None = None
    """softening by the largest load that a point has had (Mullins; Ogden & Roxburgh): below its
    largest energy W_m its stress is less"""

    prony: Annotated[tuple[Row, ...], Rows(_SHARE, _TIME, rising=False)] | None = None
    """rows [[share, relaxation time], ...] of Maxwell branches, shares of the instantaneous shear
    modulus; the bulk modulus does not relax"""
    moduli: Literal["instantaneous", "long-term"] | None = None
    """what the other constants are those of: "long-term", of the body when all branches are relaxed
    (the default), or "instantaneous", of a sudden deformation; with prony"""
    shift: Shift | None = None
    """factor of the relaxation times for the temperature of the run; with prony"""

    def problems(self, place: Place) -> Iterator[Problem]:
        """Shares that leave nothing, or keys that need branches."""
        yield from super().problems(place)
        if self.prony is None:
            for key in ("moduli", "shift"):
                if key in self.model_fields_set and getattr(self, key) is not None:
                    yield Problem((*place, key), "needs prony: there are no branches without it")
            return
        total = sum(share for share, _ in self.prony)
        if total >= 1.0:
            reason = (
                f"the shares sum up to {total:.6g}: must be < 1, what is left is the share of the "
                "long-term modulus"
            )
            yield Problem((*place, "prony"), reason)
        if self.shift is not None:
            yield from self.shift.problems((*place, "shift"))

    def branch_times(self) -> tuple[float, ...]:
        """Relaxation times at the temperature of the run, s."""
        factor = math.exp(self.shift.log_factor) if self.shift is not None else 1.0
        return tuple(factor * time for _, time in self.prony or ())

    def elastic_material(self, runs_code: bool) -> Any:
        """The energy of its constants alone."""
        raise NotImplementedError

    @property
    def _share_left(self) -> float:
        return 1.0 - sum(part for part, _ in self.prony or ())

    def relaxed_material(self, runs_code: bool) -> Any:
        """The energy when all branches are relaxed."""
        given = self.elastic_material(runs_code)
        return given.softened(self._share_left) if self.moduli == "instantaneous" else given

    def material_of(self, runs_code: bool = True) -> Material:
        """The energy with the branches of the body and its softening, if there are any."""
        relaxed = self.relaxed_material(runs_code)
        if self.prony is None and self.mullins is None:
            return relaxed
        from tribox.forms.bodies.viscous_points import Branch, Viscoelastic

        softening = self.mullins.law_of() if self.mullins is not None else None
        whole = relaxed.shear_modulus / self._share_left
        pairs = zip(self.prony or (), self.branch_times(), strict=True)
        branches = tuple(Branch(part * whole, time) for (part, _), time in pairs)
        return Viscoelastic(relaxed, branches, softening)


class _DeclaredBody(DeclaredTable, Elastomer):
    """An elastomer whose energy declares its constants."""

    def problems(self, place: Place) -> Iterator[Problem]:
        """Constants that do not fit together, and what elastomers have."""
        yield from super().problems(place)
        yield from self.faults(place)

    def elastic_material(self, runs_code: bool) -> Any:
        return self.parameters()

    @property
    def shear_modulus(self) -> float:
        """G, Pa."""
        return self.elastic_material(False).shear_modulus

    @property
    def bulk_modulus(self) -> float:
        """K, Pa."""
        return float(self.K)


class NeoHookeanBody(_Isotropic, Elastomer):
    """W = G/2 (I1 − 3) − G ln J + Λ/2 (ln J)², Λ = K − 2G/3."""

    material: Literal["neo-hookean"] = _ENERGY

    def elastic_material(self, runs_code: bool) -> Any:
        return NeoHookean(self.shear_modulus, self.bulk_modulus)


class HenckyBody(_Isotropic):
    """W = G |dev ln U|² + K/2 (ln J)²."""

    material: Literal["hencky"] = _ENERGY

    def material_of(self, runs_code: bool = True) -> Material:
        return Hencky(self.shear_modulus, self.bulk_modulus)


class ElastoPlasticBody(_Isotropic):
    """Hencky's energy of the elastic part, von Mises' yield stress, hardening both ways."""

    material: Literal["elastoplastic"] = _ENERGY
    hardening: Hardening
    """yield stress over the plastic strain"""
    kinematic: Kinematic = ()
    """branches [c, b] of the backstress, which yielding is around: at small strain X' = 2/3 c ep' -
    b X alpha', so that X tends to c/b; b = 0: linear"""
    rate: Rate | None = None
    """factor of the yield stress for the rate of plastic strain"""

    def problems(self, place: Place) -> Iterator[Problem]:
        """A pair of elastic constants that is none, a yield stress that falls, a stiff branch."""
        problems = list(super().problems(place))
        yield from problems
        yield from self.hardening.faults((*place, "hardening"))
        if not problems:
            # Branches that are as stiff as the elastic metal
            shear = self.shear_modulus
            for number, (c, b) in enumerate(self.kinematic):
                if (stiffness := c / max(b, 1.0)) > shear:
                    reason = f"c/max(b, 1) is {stiffness:.3g} Pa: must be <= {shear:.3g} Pa, the "
                    reason += "shear modulus; of metals it is some MPa to some hundred MPa"
                    yield Problem((*place, "kinematic", number), reason)

    def material_of(self, runs_code: bool = True) -> Material:
        from tribox.forms.bodies.elastoplastic import ElastoPlastic

        rate = self.rate.parameters() if self.rate is not None else None
        back = tuple(hardening.Backstress(c, b) for c, b in self.kinematic)
        return ElastoPlastic(
            self.shear_modulus, self.bulk_modulus, self.hardening.parameters(), rate, back
        )


class OwnBody(_Isotropic, Elastomer, NamesAClass):
    """A strain energy of the user's own, written in Python; E and nu, or G and K, are its at rest.

    The case only names it: the file is run when a run is built.
    """

    material: Literal["python"] = _ENERGY

    @property
    def called(self) -> str:
        """File and class."""
        return f"{self.file.name}:{self.reference.rpartition(':')[2]}"

    def elastic_material(self, runs_code: bool) -> Any:
        """See the base class; an OwnCodeError where the class makes none."""
        moduli = self.shear_modulus, self.bulk_modulus
        if not runs_code:
            return NeoHookean(*moduli)
        return load_own_material(self.reference, self.parameters, *moduli)


if TYPE_CHECKING:
    Body = NeoHookeanBody | HenckyBody | ElastoPlasticBody | OwnBody | _DeclaredBody
else:
    _declared = [
        table_of(
            f"{kind.__name__}Body", kind, _DeclaredBody, {"material": (Literal[name], _ENERGY)}
        )
        for name, kind in ENERGIES.items()
    ]
    Body = Annotated[
        Union[NeoHookeanBody, HenckyBody, *_declared, ElastoPlasticBody, OwnBody],
        Field(discriminator="material"),
        WrapValidator(from_library),
    ]


def formulations(bodies: Mapping[str, Body], cell: str) -> dict[str, Formulation]:
    """The formulation of each body; "q2" of one is of all; ValueError of `formulation_problems`."""
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
