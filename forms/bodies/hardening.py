"""Yield stress of metals over the equivalent plastic strain, factors for its rate, backstress.

True (Cauchy, Kirchhoff) stress over logarithmic plastic strain, as measured in a tension or
compression test. All laws harden or stay level: a yield stress that falls with strain localises
in bands as wide as the mesh, and is refused. Functions take and give arrays of any shape.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tribox.forms.parameters import Bounds, Declared, Refused, declarations, parameter

Floats = NDArray[np.float64]


class _Law(Declared):
    """A law that ``plastic_points.c`` knows, by its ``number`` there."""

    __slots__ = ()
    number: ClassVar[int]

    def numbers(self) -> Floats:
        """Its parameters as the C source has them."""
        return np.array([getattr(self, name) for name, _, _ in declarations(type(self))])


class Hardening(_Law):
    """Yield stress as a function of the equivalent plastic strain α."""

    __slots__ = ()

    def stress(self, alpha: Floats) -> Floats:
        """σ_Y(α), Pa."""
        raise NotImplementedError

    def slope(self, alpha: Floats) -> Floats:
        """dσ_Y/dα, Pa, not negative."""
        raise NotImplementedError

    @property
    def largest_strain(self) -> float:
        """The largest α that the law has data for; infinite if it is a formula."""
        return math.inf


class RateFactor(_Law):
    """Factor R of the yield stress as a function of the rate of α; R(0) = 1."""

    __slots__ = ()

    def factor(self, rate: Floats) -> Floats:
        """R, at least 1, not falling; ``rate`` in 1/s, not negative."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class Linear(Hardening):
    """σ_Y = σ₀ + H α; perfectly plastic with H = 0."""

    number: ClassVar[int] = 0
    yield_stress: float = parameter("yield stress σ₀ before any plastic strain", "Pa", gt=0.0)
    modulus: float = parameter(
        "rise H of the yield stress per plastic strain", "Pa", ge=0.0, default=0.0
    )

    def stress(self, alpha: Floats) -> Floats:
        """σ_Y(α), Pa."""
        return self.yield_stress + self.modulus * np.asarray(alpha, dtype=np.float64)

    def slope(self, alpha: Floats) -> Floats:
        """H, Pa."""
        return np.full_like(np.asarray(alpha, dtype=np.float64), self.modulus)


@dataclass(frozen=True, slots=True)
class Voce(Hardening):
    """σ_Y = σ₀ + H α + (σ∞ − σ₀)(1 − e^(−δα)) (Voce, J. Inst. Metals 74 (1948) 537; H: Simo)."""

    number: ClassVar[int] = 1
    yield_stress: float = parameter("yield stress σ₀ before any plastic strain", "Pa", gt=0.0)
    saturation_stress: float = parameter(
        "stress σ∞ that the yield stress tends to, but for H α; at least yield_stress", "Pa", gt=0.0
    )
    exponent: float = parameter(
        "rate δ of that in the plastic strain: half way at α = 0.69/δ", gt=0.0
    )
    modulus: float = parameter(
        "rise H of the yield stress per plastic strain that stays", "Pa", ge=0.0, default=0.0
    )

    def faults(self) -> Iterator[Refused]:
        """A yield stress that falls."""
        if self.saturation_stress < self.yield_stress:
            reason = f"must be >= yield_stress = {self.yield_stress:g} Pa"
            yield Refused("saturation_stress", reason, self.saturation_stress)

    def stress(self, alpha: Floats) -> Floats:
        """σ_Y(α), Pa."""
        gain = self.saturation_stress - self.yield_stress
        linear = self.yield_stress + self.modulus * np.asarray(alpha, dtype=np.float64)
        risen: Floats = gain * np.expm1(-self.exponent * alpha)
        return np.asarray(linear - risen)

    def slope(self, alpha: Floats) -> Floats:
        """dσ_Y/dα, Pa."""
        gain = self.saturation_stress - self.yield_stress
        return np.asarray(self.modulus + gain * self.exponent * np.exp(-self.exponent * alpha))


@dataclass(frozen=True, slots=True)
class Swift(Hardening):
    """σ_Y = K (ε₀ + α)ⁿ (Swift, J. Mech. Phys. Solids 1 (1952) 1)."""

    number: ClassVar[int] = 2
    K: float = parameter("strength coefficient K: the yield stress at ε₀ + α = 1", "Pa", gt=0.0)
    strain0: float = parameter("strain ε₀, by which the body yields first at K ε₀ⁿ", gt=0.0)
    n: float = parameter("hardening exponent", ge=0.0, le=1.0)

    def stress(self, alpha: Floats) -> Floats:
        """σ_Y(α), Pa."""
        return np.asarray(self.K * (self.strain0 + alpha) ** self.n)

    def slope(self, alpha: Floats) -> Floats:
        """dσ_Y/dα, Pa."""
        return np.asarray(self.n * self.K * (self.strain0 + alpha) ** (self.n - 1.0))


@dataclass(frozen=True, slots=True)
class Table(Hardening):
    """Straight lines between points (α, σ_Y), the first at α = 0; level beyond the last point.

    A table ends where its test ended. Beyond, the stress stays the last one: forces are not
    overestimated, and tables made for Abaqus keep their meaning (classical metal plasticity, by
    default). Whoever wants the last slope to go on adds a point. ``largest_strain`` lets callers
    say that a run went beyond. At a point the slope is that of the line after it.
    """

    number: ClassVar[int] = 3
    points: tuple[tuple[float, float], ...] = parameter(
        "rows [[plastic strain, yield stress], ...] from strain 0 on; straight between them, level "
        "after the last",
        "Pa",
        gt=0.0,
        name="yield stress",
        over=Bounds(ge=0.0, name="plastic strain"),
    )

    def faults(self) -> Iterator[Refused]:
        """A table that begins late, or falls."""
        if self.points[0][0] != 0.0:
            reason = "must be 0: where the body yields first"
            yield Refused("points.0.0", reason, self.points[0][0])
        for row, ((_, before), (_, stress)) in enumerate(pairwise(self.points), start=1):
            if stress < before:
                reason = f"must be >= {before:g} Pa, that of the row before: it may not fall"
                yield Refused(f"points.{row}.1", reason, stress)

    def stress(self, alpha: Floats) -> Floats:
        """σ_Y(α), Pa."""
        strains, stresses = np.array(self.points).T
        return np.asarray(np.interp(alpha, strains, stresses))

    def slope(self, alpha: Floats) -> Floats:
        """dσ_Y/dα, Pa."""
        strains, stresses = np.array(self.points).T
        slopes = np.append(np.diff(stresses) / np.diff(strains), 0.0)
        segment = np.searchsorted(strains, alpha, side="right") - 1
        return np.asarray(slopes[np.maximum(segment, 0)])

    @property
    def largest_strain(self) -> float:
        """That of the last point."""
        return self.points[-1][0]

    def numbers(self) -> Floats:
        """The strains, then the stresses."""
        return np.ascontiguousarray(np.array(self.points).T).reshape(-1)


@dataclass(frozen=True, slots=True)
class Backstress(Declared):
    """One branch of kinematic hardening: at small strain Ẋ = ⅔ c ε̇ᵖ − b X α̇.

    Armstrong & Frederick, CEGB report RD/B/N731 (1966); several branches add up: Chaboche, Int. J.
    Plasticity 2 (1986) 149. Pulled from its virgin state, the branch adds (c/b)(1 − e^(−bα)) to
    the stress, c α with b = 0, and takes the same from the yield stress against that direction.
    """

    modulus: float = parameter("c", "Pa", gt=0.0)
    recovery: float = parameter("b", ge=0.0, default=0.0)

    def pulled(self, alpha: float) -> float:
        """What it adds to the stress, Pa, in a pull to α from the virgin state."""
        b = self.recovery
        return self.modulus * (-math.expm1(-b * alpha) / b if b > 0.0 else alpha)


@dataclass(frozen=True, slots=True)
class JohnsonCook(RateFactor):
    """R = 1 + C ln(rate/reference) above the reference rate (1/s), 1 below it.

    Johnson & Cook, Proc. 7th Int. Symp. on Ballistics (1983) 541: the factor for the rate alone.
    """

    number: ClassVar[int] = 1
    C: float = parameter(
        "coefficient of R = 1 + C ln(rate/reference_rate), the factor of the yield stress above "
        "the reference rate",
        gt=0.0,
    )
    reference_rate: float = parameter(
        "rate of plastic strain up to which R = 1", "1/s", gt=0.0, default=1.0
    )

    def factor(self, rate: Floats) -> Floats:
        """R at a rate, 1/s."""
        faster: Floats = np.maximum(rate / self.reference_rate, 1.0)
        return np.asarray(1.0 + self.C * np.log(faster))


@dataclass(frozen=True, slots=True)
class Perzyna(RateFactor):
    """R = 1 + (rate/reference)^m, the rate in 1/s.

    The overstress model rate = reference · (σ/σ_Y − 1)^(1/m) (Perzyna, Adv. Appl. Mech. 9 (1966)
    243) solved for σ; with m = 1/p and D the reference rate it is Cowper and Symonds' factor.
    """

    number: ClassVar[int] = 2
    reference_rate: float = parameter(
        "rate of plastic strain at which the yield stress is doubled", "1/s", gt=0.0
    )
    exponent: float = parameter(
        "m of R = 1 + (rate/reference_rate)^m, the factor of the yield stress", gt=0.0, le=1.0
    )

    def factor(self, rate: Floats) -> Floats:
        """R at a rate, 1/s."""
        return np.asarray(1.0 + (rate / self.reference_rate) ** self.exponent)


HARDENING: Mapping[str, type[Declared]] = MappingProxyType(
    {"linear": Linear, "voce": Voce, "swift": Swift, "table": Table}
)
RATES: Mapping[str, type[Declared]] = MappingProxyType(
    {"johnson-cook": JohnsonCook, "perzyna": Perzyna}
)
"""The laws by the names that case files have for them."""
