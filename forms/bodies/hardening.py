"""Yield stress of metals over the equivalent plastic strain, factors for its rate, backstress.

True (Cauchy, Kirchhoff) stress over logarithmic plastic strain, as measured in a tension or
compression test. All laws harden or stay level: a yield stress that falls with strain localises
in bands as wide as the mesh, and is refused. Functions take and give arrays of any shape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Hardening(Protocol):
    """Yield stress as a function of the equivalent plastic strain α."""

    def stress(self, alpha: Floats) -> Floats:
        """σ_Y(α), Pa."""
        ...

    def slope(self, alpha: Floats) -> Floats:
        """dσ_Y/dα, Pa, not negative."""
        ...

    @property
    def largest_strain(self) -> float:
        """The largest α that the law has data for; infinite if it is a formula."""
        ...


class RateFactor(Protocol):
    """Factor R of the yield stress as a function of the rate of α; R(0) = 1."""

    def factor(self, rate: Floats) -> Floats:
        """R, at least 1, not falling; ``rate`` in 1/s, not negative."""
        ...

    def slope(self, rate: Floats) -> Floats:
        """dR/d(rate), s; may be infinite at rate 0."""
        ...

    def rate(self, factor: Floats) -> Floats:
        """A rate, 1/s, at which R is ``factor`` > 1; infinite beyond all numbers."""
        ...


class Metal(Protocol):
    """What points that flow need of their material."""

    @property
    def shear_modulus(self) -> float:
        """G, Pa."""
        ...

    @property
    def bulk_modulus(self) -> float:
        """K, Pa."""
        ...

    @property
    def hardening(self) -> Hardening:
        """The yield stress."""
        ...

    @property
    def rate(self) -> RateFactor | None:
        """Factor of the yield stress for the rate; None: independent of rate."""
        ...

    @property
    def kinematic(self) -> tuple[Backstress, ...]:
        """Branches of the backstress; none: it is isotropic."""
        ...

    def unyielding(self) -> Metal:
        """The same, which never flows."""
        ...


@dataclass(frozen=True, slots=True)
class Linear:
    """σ_Y = σ₀ + H α; perfectly plastic with H = 0."""

    yield_stress: float
    modulus: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters; ValueError says which and why."""
        _positive("yield_stress", self.yield_stress)
        _not_negative("modulus", self.modulus)

    def stress(self, alpha: Floats) -> Floats:
        """σ_Y(α), Pa."""
        return self.yield_stress + self.modulus * np.asarray(alpha, dtype=np.float64)

    def slope(self, alpha: Floats) -> Floats:
        """H, Pa."""
        return np.full_like(np.asarray(alpha, dtype=np.float64), self.modulus)

    @property
    def largest_strain(self) -> float:
        """Infinite: a formula."""
        return math.inf


@dataclass(frozen=True, slots=True)
class Voce:
    """σ_Y = σ₀ + H α + (σ∞ − σ₀)(1 − e^(−δα)) (Voce, J. Inst. Metals 74 (1948) 537; H: Simo)."""

    yield_stress: float
    saturation_stress: float
    exponent: float
    modulus: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters; ValueError says which and why."""
        _positive("yield_stress", self.yield_stress)
        _positive("exponent", self.exponent)
        _not_negative("modulus", self.modulus)
        _positive("saturation_stress", self.saturation_stress)
        if self.saturation_stress < self.yield_stress:
            raise ValueError(
                f"saturation_stress is {self.saturation_stress:g}, below the yield_stress "
                f"{self.yield_stress:g}: the yield stress would fall with strain"
            )

    def stress(self, alpha: Floats) -> Floats:
        """σ_Y(α), Pa."""
        gain = self.saturation_stress - self.yield_stress
        linear = self.yield_stress + self.modulus * np.asarray(alpha, dtype=np.float64)
        return np.asarray(linear - gain * np.expm1(-self.exponent * alpha))

    def slope(self, alpha: Floats) -> Floats:
        """dσ_Y/dα, Pa."""
        gain = self.saturation_stress - self.yield_stress
        return np.asarray(self.modulus + gain * self.exponent * np.exp(-self.exponent * alpha))

    @property
    def largest_strain(self) -> float:
        """Infinite: a formula."""
        return math.inf


@dataclass(frozen=True, slots=True)
class Swift:
    """σ_Y = K (ε₀ + α)ⁿ (Swift, J. Mech. Phys. Solids 1 (1952) 1), 0 ≤ n ≤ 1."""

    K: float
    strain0: float
    n: float

    def __post_init__(self) -> None:
        """Check the parameters; ValueError says which and why."""
        _positive("K", self.K)
        _positive("strain0", self.strain0)
        _not_negative("n", self.n)
        if self.n > 1.0:
            raise ValueError(f"n is {self.n:g}; allowed is 0 to 1")

    def stress(self, alpha: Floats) -> Floats:
        """σ_Y(α), Pa."""
        return np.asarray(self.K * (self.strain0 + alpha) ** self.n)

    def slope(self, alpha: Floats) -> Floats:
        """dσ_Y/dα, Pa."""
        return np.asarray(self.n * self.K * (self.strain0 + alpha) ** (self.n - 1.0))

    @property
    def largest_strain(self) -> float:
        """Infinite: a formula."""
        return math.inf


@dataclass(frozen=True, slots=True)
class Table:
    """Straight lines between points (α, σ_Y), the first at α = 0; level beyond the last point.

    A table ends where its test ended. Beyond, the stress stays the last one: forces are not
    overestimated, and tables made for Abaqus keep their meaning (classical metal plasticity, by
    default). Whoever wants the last slope to go on adds a point. ``largest_strain`` lets callers
    say that a run went beyond. At a point the slope is that of the line after it.
    """

    points: tuple[tuple[float, float], ...]

    def __init__(self, points: Sequence[Sequence[float]]) -> None:
        """Take and check the points.

        Args:
            points: pairs of equivalent plastic strain and yield stress (Pa), by rising strain.

        Raises:
            ValueError: says what is wrong with which point.
        """
        for number, point in enumerate(points, start=1):
            if len(point) != 2:
                raise ValueError(f"point {number} has {len(point)} numbers; a strain and a stress")
        pairs = tuple((float(strain), float(stress)) for strain, stress in points)
        object.__setattr__(self, "points", pairs)
        self._check()

    def _check(self) -> None:
        if not self.points:
            raise ValueError("points is empty; at least one is needed, at plastic strain 0")
        if self.points[0][0] != 0.0:
            raise ValueError(f"the first point is at plastic strain {self.points[0][0]:g}, not 0")
        last = (-1.0, 0.0)
        for number, (strain, stress) in enumerate(self.points, start=1):
            _positive(f"the stress of point {number}", stress)
            _not_negative(f"the plastic strain of point {number}", strain)
            if strain <= last[0]:
                raise ValueError(f"the plastic strain of point {number}, {strain:g}, does not rise")
            if stress < last[1]:
                raise ValueError(
                    f"the stress of point {number}, {stress:g}, is below the one before, "
                    f"{last[1]:g}: the yield stress would fall with strain"
                )
            last = (strain, stress)

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


@dataclass(frozen=True, slots=True)
class Backstress:
    """One branch of kinematic hardening: at small strain Ẋ = ⅔ c ε̇ᵖ − b X α̇.

    Armstrong & Frederick, CEGB report RD/B/N731 (1966); several branches add up: Chaboche, Int. J.
    Plasticity 2 (1986) 149. Pulled from its virgin state, the branch adds (c/b)(1 − e^(−bα)) to
    the stress, c α with b = 0, and takes the same from the yield stress against that direction.
    """

    modulus: float
    recovery: float = 0.0

    def __post_init__(self) -> None:
        """Check c and b; ValueError says which and why."""
        _positive("modulus", self.modulus)
        _not_negative("recovery", self.recovery)

    def pulled(self, alpha: float) -> float:
        """What it adds to the stress, Pa, in a pull to α from the virgin state."""
        b = self.recovery
        return self.modulus * (-math.expm1(-b * alpha) / b if b > 0.0 else alpha)


@dataclass(frozen=True, slots=True)
class JohnsonCook:
    """R = 1 + C ln(rate/reference) above the reference rate (1/s), 1 below it.

    Johnson & Cook, Proc. 7th Int. Symp. on Ballistics (1983) 541: the factor for the rate alone.
    """

    C: float
    reference_rate: float = 1.0

    def __post_init__(self) -> None:
        """Check the parameters; ValueError says which and why."""
        _positive("C", self.C)
        _positive("reference_rate", self.reference_rate)

    def factor(self, rate: Floats) -> Floats:
        """R at a rate, 1/s."""
        return np.asarray(1.0 + self.C * np.log(np.maximum(rate / self.reference_rate, 1.0)))

    def slope(self, rate: Floats) -> Floats:
        """dR/d(rate), s."""
        above = np.asarray(rate) >= self.reference_rate
        return np.where(above, self.C / np.maximum(rate, self.reference_rate), 0.0)

    def rate(self, factor: Floats) -> Floats:
        """The rate, 1/s, of a factor R > 1."""
        with np.errstate(over="ignore"):
            return np.asarray(self.reference_rate * np.exp((factor - 1.0) / self.C))


@dataclass(frozen=True, slots=True)
class Perzyna:
    """R = 1 + (rate/reference)^m, the rate in 1/s, 0 < m ≤ 1.

    The overstress model rate = reference · (σ/σ_Y − 1)^(1/m) (Perzyna, Adv. Appl. Mech. 9 (1966)
    243) solved for σ; with m = 1/p and D the reference rate it is Cowper and Symonds' factor.
    """

    reference_rate: float
    exponent: float

    def __post_init__(self) -> None:
        """Check the parameters; ValueError says which and why."""
        _positive("reference_rate", self.reference_rate)
        _positive("exponent", self.exponent)
        if self.exponent > 1.0:
            raise ValueError(f"exponent is {self.exponent:g}; allowed is above 0, at most 1")

    def factor(self, rate: Floats) -> Floats:
        """R at a rate, 1/s."""
        return np.asarray(1.0 + (rate / self.reference_rate) ** self.exponent)

    def slope(self, rate: Floats) -> Floats:
        """dR/d(rate), s; infinite at rate 0 where m < 1."""
        m, D = self.exponent, self.reference_rate
        with np.errstate(divide="ignore", over="ignore"):
            return np.asarray(m / D * (rate / D) ** (m - 1.0))

    def rate(self, factor: Floats) -> Floats:
        """The rate, 1/s, of a factor R > 1."""
        with np.errstate(over="ignore", under="ignore"):
            return np.asarray(self.reference_rate * (factor - 1.0) ** (1.0 / self.exponent))


def _positive(name: str, value: Any) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{name} is {value:g}; it must be above 0")


def _not_negative(name: str, value: Any) -> None:
    if not (math.isfinite(value) and value >= 0.0):
        raise ValueError(f"{name} is {value:g}; it must be at least 0")
