"""Metals: elastic in the logarithmic strain, plastic by von Mises, hardening both ways.

The strain energy is that of Hencky; what flows is computed at material points with a memory, see
:mod:`tribox.forms.bodies.plastic_points`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from tribox.forms.bodies.hardening import Backstress, Hardening, Linear, RateFactor
from tribox.forms.bodies.kinematics import Kinematics
from tribox.forms.bodies.materials import Hencky
from tribox.forms.bodies.plastic_points import PlasticPoints

NEVER = 1e300  # Pa, yield stress of a material that stays elastic


@dataclass(frozen=True, slots=True)
class ElastoPlastic:
    """Finite J2 plasticity with F = Fᵉ Fᵖ and Hencky's energy of Fᵉ.

    Attributes:
        shear_modulus: G, Pa.
        bulk_modulus: K, Pa.
        hardening: yield stress over the equivalent plastic strain.
        rate: factor of the yield stress for the rate of that strain; None: independent of rate.
        kinematic: branches of the backstress, around whose sum the metal yields; none: around 0.
    """

    shear_modulus: float
    bulk_modulus: float
    hardening: Hardening
    rate: RateFactor | None = None
    kinematic: tuple[Backstress, ...] = ()

    def points(self, space: bool) -> PlasticPoints:
        """What flows, and remembers how far it has."""
        return PlasticPoints(self, space)

    def unyielding(self) -> ElastoPlastic:
        """The same, which never flows."""
        return replace(self, hardening=Linear(NEVER, 0.0), rate=None)

    @property
    def elastic(self) -> Hencky:
        """The same body without plastic flow."""
        return Hencky(self.shear_modulus, self.bulk_modulus)

    def parameters(self) -> dict[str, float]:
        """G and K, Pa."""
        return self.elastic.parameters()

    def energy(self, k: Kinematics, c: dict[str, Any]) -> tuple[Any, Any]:
        """Strain energy of an elastic deformation, see Hencky."""
        return self.elastic.energy(k, c)
