"""Stored energies of the elastomers and of aluminium, per reference volume.

A material implements its strain energy only, split into the part that is integrated at the full
number of Gauss points and the volumetric part that selective reduced integration evaluates at the
centre. Parameters enter the forms as constants, so another value compiles nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import ufl

from forms.kinematics import Kinematics

Expr = Any


class Material(Protocol):
    """What a solid asks of a material."""

    def parameters(self) -> dict[str, float]:
        """Values of the constants in the energy, by name."""
        ...

    def energy(self, k: Kinematics, c: dict[str, Expr]) -> tuple[Expr, Expr]:
        """Strain energy (distortional part, volumetric part), J/m³, of the constants ``c``."""
        ...

    @property
    def shear_modulus(self) -> float:
        """G of the undeformed material, Pa."""
        ...

    @property
    def bulk_modulus(self) -> float:
        """K of the undeformed material, Pa."""
        ...


def oedometric_modulus(material: Material) -> float:
    """M = K + 4G/3, Pa: stiffness against compression without lateral strain."""
    return material.bulk_modulus + 4.0 / 3.0 * material.shear_modulus


def shear_and_bulk(E: float, nu: float) -> tuple[float, float]:
    """(G, K), Pa, from Young's modulus (Pa) and Poisson's ratio."""
    return E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu))


@dataclass(frozen=True, slots=True)
class NeoHookean:
    """W = G/2 (I1 − 3) − G ln J + Λ/2 (ln J)², Λ = K − 2G/3 (Simo & Pister 1984)."""

    shear_modulus: float
    bulk_modulus: float

    def parameters(self) -> dict[str, float]:
        """G and Λ, Pa."""
        return {"G": self.shear_modulus, "L": self.bulk_modulus - 2.0 / 3.0 * self.shear_modulus}

    def energy(self, k: Kinematics, c: dict[str, Expr]) -> tuple[Expr, Expr]:
        """See the class; the term in Λ is the volumetric part."""
        log_j = ufl.ln(k.J)
        return 0.5 * c["G"] * (k.I1 - 3.0) - c["G"] * log_j, 0.5 * c["L"] * log_j**2


@dataclass(frozen=True, slots=True)
class MooneyRivlin:
    """W = C10 (Ī1 − 3) + C01 (Ī2 − 3) + K/4 (J² − 1 − 2 ln J), Ī the isochoric invariants.

    Mooney, J. Appl. Phys. 11 (1940) 582; the volumetric function is that of Simo & Taylor,
    Comput. Methods Appl. Mech. Engng 85 (1991) 273.
    """

    C10: float
    C01: float
    bulk_modulus: float

    @property
    def shear_modulus(self) -> float:
        """G = 2 (C10 + C01), Pa."""
        return 2.0 * (self.C10 + self.C01)

    def parameters(self) -> dict[str, float]:
        """C10, C01 and K, Pa."""
        return {"C10": self.C10, "C01": self.C01, "K": self.bulk_modulus}

    def energy(self, k: Kinematics, c: dict[str, Expr]) -> tuple[Expr, Expr]:
        """See the class."""
        i1 = k.J ** (-2.0 / 3.0) * k.I1
        i2 = k.J ** (-4.0 / 3.0) * k.I2
        distortion = c["C10"] * (i1 - 3.0) + c["C01"] * (i2 - 3.0)
        return distortion, 0.25 * c["K"] * (k.J**2 - 1.0 - 2.0 * ufl.ln(k.J))


@dataclass(frozen=True, slots=True)
class Hencky:
    """W = G |dev ln U|² + K/2 (ln J)², the quadratic energy of the logarithmic strain.

    The in-plane logarithmic stretches h₁, h₂ follow from J₂ = exp(h₁ + h₂) and
    y = tr C₂/(2 J₂) = cosh(h₁ − h₂) without eigenvalues: |dev ln U|² = ((h₁ − h₂)² + (ln J₂)²)/2 +
    h₃² − (ln J)²/3.
    """

    shear_modulus: float
    bulk_modulus: float

    def parameters(self) -> dict[str, float]:
        """G and K, Pa."""
        return {"G": self.shear_modulus, "K": self.bulk_modulus}

    def energy(self, k: Kinematics, c: dict[str, Expr]) -> tuple[Expr, Expr]:
        """See the class."""
        log_j, plane_log_j = ufl.ln(k.J), ufl.ln(k.plane_J)
        excess = k.plane_I1 / (2.0 * k.plane_J) - 1.0
        in_plane = 0.5 * (_squared_arcosh(excess) + plane_log_j**2)
        distortion = c["G"] * (in_plane + ufl.ln(k.stretch) ** 2 - log_j**2 / 3.0)
        return distortion, 0.5 * c["K"] * log_j**2


def _squared_arcosh(x: Expr) -> Expr:
    """arcosh(1 + x)², analytic at x = 0 where arcosh itself is not.

    Below x = 0.02 the Taylor series 2x − x²/3 + 4x³/45 − x⁴/35 + 16x⁵/1575 − 8x⁶/2079 is used (the
    terms left out are below 1e-13 of the sum there); the other branch sees 0.02 instead, so
    that neither ever divides by zero.
    """
    series = x * (
        2.0 + x * (-1 / 3 + x * (4 / 45 + x * (-1 / 35 + x * (16 / 1575 + x * (-8 / 2079)))))
    )
    large = ufl.conditional(ufl.gt(x, 0.02), x, 0.02)
    exact = ufl.ln(1.0 + large + ufl.sqrt(large * (large + 2.0))) ** 2
    return ufl.conditional(ufl.gt(x, 0.02), exact, series)
