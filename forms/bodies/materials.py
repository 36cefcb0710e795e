"""Stored energies of the elastomers and of aluminium, per reference volume.

The energies, with stress and moduli, are those of ``forms/native/energies.h``, split into the part
that is integrated at the full number of Gauss points and the volumetric part that selective reduced
integration evaluates at the centre.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self

from tribox.forms.parameters import Declared, Refused, parameter

if TYPE_CHECKING:  # UFL is loaded when forms are made, not when a case file is read
    from tribox.forms.bodies.kinematics import Kinematics
    from tribox.forms.bodies.point_state import MaterialPoints

Expr = Any
MOST_TERMS = 6  # of Ogden's sum
HIGHEST_POWER = 30.0  # of its stretches


class Material(Protocol):
    """What a solid needs of a material."""

    def parameters(self) -> dict[str, float]:
        """Values of the constants in the energy, by name."""
        ...

    def points(self, space: bool) -> MaterialPoints | None:
        """Its points that remember, in the plane or in space; None: it is elastic."""
        ...

    @property
    def elastic(self) -> Material:
        """What it is without them."""
        ...

    @property
    def shear_modulus(self) -> float:
        """G of the undeformed material, Pa."""
        ...

    @property
    def bulk_modulus(self) -> float:
        """K of the undeformed material, Pa."""
        ...


class OwnEnergy(Material, Protocol):
    """A material whose strain energy the C sources do not know, but UFL."""

    def energy(self, k: Kinematics, c: dict[str, Expr]) -> tuple[Expr, Expr]:
        """Strain energy (distortional part, volumetric part), J/m³, of the constants ``c``."""
        ...


class Elastic:
    """What materials have in common whose stress follows from the present deformation alone."""

    __slots__ = ()
    # whether more strain needs more stress, whatever the constants and the strain
    always_stable: ClassVar[bool] = False

    def points(self, space: bool) -> None:
        """None: there is nothing to remember."""
        return None

    @property
    def elastic(self) -> Self:
        """The material itself."""
        return self


def oedometric_modulus(material: Material) -> float:
    """M = K + 4G/3, Pa: stiffness against compression without lateral strain."""
    return material.bulk_modulus + 4.0 / 3.0 * material.shear_modulus


def young_and_poisson(shear: float, bulk: float) -> tuple[float, float]:
    """E, Pa, and ν of an isotropic body with the moduli G and K, Pa."""
    young = 9.0 * bulk * shear / (3.0 * bulk + shear)
    return young, (3.0 * bulk - 2.0 * shear) / (6.0 * bulk + 2.0 * shear)


def contact_shear_modulus(material: Material) -> float:
    """The modulus, Pa, that stands for a body in the default stiffnesses of its contacts.

    An elastic body presses with a share of its shear modulus G: what is a multiple of G lets it
    approach by a small share of its elements. A metal that flows presses with at most its
    indentation hardness H ≈ 3 σ_Y, some hundredth of G. The same multiple of H lets it approach as
    little, at all pressures it can bear, and is no stiffer than its elements are before they yield.
    """
    return min(material.shear_modulus, float(getattr(material, "hardness", math.inf)))


def shear_and_bulk(E: float, nu: float) -> tuple[float, float]:
    """(G, K), Pa, from Young's modulus (Pa) and Poisson's ratio."""
    return E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu))


@dataclass(frozen=True, slots=True)
class NeoHookean(Elastic):
    """W = G/2 (I1 − 3) − G ln J + Λ/2 (ln J)², Λ = K − 2G/3 (Simo & Pister 1984)."""

    always_stable: ClassVar[bool] = True
    shear_modulus: float
    bulk_modulus: float

    def softened(self, share: float) -> Self:
        """The same with a share of its resistance to distortion, and the same K."""
        return replace(self, shear_modulus=share * self.shear_modulus)

    def parameters(self) -> dict[str, float]:
        """G and Λ, Pa."""
        return {"G": self.shear_modulus, "L": self.bulk_modulus - 2.0 / 3.0 * self.shear_modulus}


@dataclass(frozen=True, slots=True)
class MooneyRivlin(Elastic, Declared):
    """W = C10 (Ī1 − 3) + C01 (Ī2 − 3) + K/4 (J² − 1 − 2 ln J), Ī the isochoric invariants.

    Mooney, J. Appl. Phys. 11 (1940) 582; the volumetric function is that of Simo & Taylor,
    Comput. Methods Appl. Mech. Engng 85 (1991) 273.
    """

    C10: float = parameter("constant of the first invariant", "Pa")
    C01: float = parameter("constant of the second invariant", "Pa")
    bulk_modulus: float = parameter("bulk modulus", "Pa", gt=0.0, key="K")

    def faults(self) -> Iterator[Refused]:
        """A shear modulus that is not positive."""
        if self.C10 + self.C01 <= 0.0:
            half = f"C10 + C01 = {self.C10 + self.C01:g} Pa"
            yield Refused("", f"{half}: must be > 0 Pa (half the shear modulus)")

    @property
    def shear_modulus(self) -> float:
        """G = 2 (C10 + C01), Pa."""
        return 2.0 * (self.C10 + self.C01)

    def softened(self, share: float) -> Self:
        """The same with a share of its resistance to distortion, and the same K."""
        return replace(self, C10=share * self.C10, C01=share * self.C01)

    def parameters(self) -> dict[str, float]:
        """C10, C01 and K, Pa."""
        return {"C10": self.C10, "C01": self.C01, "K": self.bulk_modulus}


@dataclass(frozen=True, slots=True)
class Yeoh(Elastic, Declared):
    """W = C10 (Ī1 − 3) + C20 (Ī1 − 3)² + C30 (Ī1 − 3)³ + K/4 (J² − 1 − 2 ln J).

    Yeoh, Rubber Chem. Technol. 66 (1993) 754: the upturn at large strain, and with C20 < 0 the
    softening before it, of filled rubber.
    """

    C10: float = parameter("constant of the first invariant, half the shear modulus", "Pa", gt=0.0)
    C20: float = parameter(
        "constant of its square; negative where the body softens first", "Pa", otherwise=0.0
    )
    C30: float = parameter(
        "constant of its cube; positive where the body stiffens at last", "Pa", otherwise=0.0
    )
    bulk_modulus: float = parameter("bulk modulus", "Pa", gt=0.0, key="K")

    @property
    def shear_modulus(self) -> float:
        """G = 2 C10, Pa."""
        return 2.0 * self.C10

    def softened(self, share: float) -> Self:
        """The same with a share of its resistance to distortion, and the same K."""
        return replace(self, C10=share * self.C10, C20=share * self.C20, C30=share * self.C30)

    def parameters(self) -> dict[str, float]:
        """C10, C20, C30 and K, Pa."""
        return {"C10": self.C10, "C20": self.C20, "C30": self.C30, "K": self.bulk_modulus}


@dataclass(frozen=True, slots=True)
class Ogden(Elastic, Declared):
    """W = Σ_p μ_p/α_p (λ̄₁^α_p + λ̄₂^α_p + λ̄₃^α_p − 3) + K/4 (J² − 1 − 2 ln J).

    Ogden, Proc. R. Soc. Lond. A 326 (1972) 565, with his μ_p, in isochoric principal stretches λ̄. A
    convention that writes 2 μ_i/α_i² instead has μ_i = μ_p α_p/2. Stretches that coincide are
    nothing special: see ``principal_powers.h``.
    """

    mu: tuple[float, ...] = parameter(
        "moduli mu_p of the terms mu_p/alpha_p (sum of stretches to the power alpha_p, less 3), "
        "Ogden's own convention: sum of mu_p alpha_p/2 is the shear modulus",
        "Pa",
        nonzero=True,
        most=MOST_TERMS,
    )
    alpha: tuple[float, ...] = parameter(
        "exponents of the terms, as many as mu",
        ge=-HIGHEST_POWER,
        le=HIGHEST_POWER,
        nonzero=True,
        most=MOST_TERMS,
    )
    bulk_modulus: float = parameter("bulk modulus", "Pa", gt=0.0, key="K")

    def faults(self) -> Iterator[Refused]:
        """Lists of different length, or a shear modulus that is not positive."""
        if len(self.mu) != len(self.alpha):
            reason = f"has {len(self.alpha)} entries and mu {len(self.mu)}: must be as many"
            yield Refused("alpha", reason)
        elif self.shear_modulus <= 0.0:
            found = f"half the sum of mu alpha, is {self.shear_modulus:g} Pa"
            yield Refused("", f"the shear modulus, {found}: must be > 0 Pa")

    @property
    def shear_modulus(self) -> float:
        """G = Σ μ_p α_p/2, Pa."""
        return 0.5 * sum(mu * alpha for mu, alpha in zip(self.mu, self.alpha, strict=True))

    def softened(self, share: float) -> Self:
        """The same with a share of its resistance to distortion, and the same K."""
        return replace(self, mu=tuple(share * mu for mu in self.mu))

    def parameters(self) -> dict[str, float]:
        """mu1, alpha1, mu2, …, and K, Pa."""
        found: dict[str, float] = {}
        for number, (mu, alpha) in enumerate(zip(self.mu, self.alpha, strict=True), start=1):
            found |= {f"mu{number}": mu, f"alpha{number}": alpha}
        return found | {"K": self.bulk_modulus}


@dataclass(frozen=True, slots=True)
class Hencky(Elastic):
    """W = G |dev ln U|² + K/2 (ln J)², the quadratic energy of the logarithmic strain.

    In a plane the logarithmic stretches h₁, h₂ follow from J₂ = exp(h₁ + h₂) and
    y = tr C₂/(2 J₂) = cosh(h₁ − h₂) without eigenvalues: |dev ln U|² = ((h₁ − h₂)² + (ln J₂)²)/2 +
    h₃² − (ln J)²/3. In space, with C̄ = J^(−2/3) C and Z = (C̄ − I)(C̄ + I)⁻¹, dev ln U = artanh Z,
    and artanh(z)² is the series Σ_k (z²)ᵏ/k Σ_{j≤k} 1/(2j − 1). What is left out of it is below
    1e-12 of the sum while each isochoric principal stretch, or its inverse, is at most 1.3; 2e-9 at
    1.5 and 1e-5 at 2.
    """

    always_stable: ClassVar[bool] = True
    shear_modulus: float
    bulk_modulus: float

    def parameters(self) -> dict[str, float]:
        """G and K, Pa."""
        return {"G": self.shear_modulus, "K": self.bulk_modulus}


ENERGIES: Mapping[str, type[Declared]] = MappingProxyType(
    {"mooney-rivlin": MooneyRivlin, "yeoh": Yeoh, "ogden": Ogden}
)
"""Energies that declare their constants, by the names that case files have for them."""
