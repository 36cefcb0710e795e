"""The `hardening` and `rate` tables and the `kinematic` list of bodies that flow."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Model, Place, Problem
from tribox.app.case.time_tables import Row, Rows

if TYPE_CHECKING:
    from tribox.forms.bodies import hardening

_STRAIN = Quantity(ge=0.0, name="plastic strain")
_STRESS = Quantity("Pa", gt=0.0, name="yield stress")


class LinearHardening(Model):
    """σ_Y = σ₀ + H α."""

    law: Literal["linear"] = Field(description="how the yield stress rises with plastic strain")
    yield_stress: Annotated[float, Quantity("Pa", gt=0.0)] = Field(
        description="yield stress σ₀ before any plastic strain"
    )
    modulus: Annotated[float, Quantity("Pa", ge=0.0)] = Field(
        default=0.0, description="rise H of the yield stress per plastic strain"
    )

    def problems(self, place: Place) -> Iterator[Problem]:
        """None."""
        return iter(())

    def law_of(self) -> hardening.Hardening:
        """The yield stress over the plastic strain."""
        from tribox.forms.bodies.hardening import Linear

        return Linear(self.yield_stress, self.modulus)


class VoceHardening(Model):
    """σ_Y = σ₀ + H α + (σ∞ − σ₀)(1 − e^(−δα))."""

    law: Literal["voce"] = Field(description="how the yield stress rises with plastic strain")
    yield_stress: Annotated[float, Quantity("Pa", gt=0.0)] = Field(
        description="yield stress σ₀ before any plastic strain"
    )
    saturation_stress: Annotated[float, Quantity("Pa", gt=0.0)] = Field(
        description="stress σ∞ that the yield stress tends to, but for H α; at least yield_stress"
    )
    exponent: Annotated[float, Quantity(gt=0.0)] = Field(
        description="rate δ of that in the plastic strain: half way at α = 0.69/δ"
    )
    modulus: Annotated[float, Quantity("Pa", ge=0.0)] = Field(
        default=0.0, description="rise H of the yield stress per plastic strain that stays"
    )

    def problems(self, place: Place) -> Iterator[Problem]:
        """A yield stress that falls."""
        if self.saturation_stress < self.yield_stress:
            reason = f"must be >= yield_stress = {self.yield_stress:g} Pa"
            yield Problem((*place, "saturation_stress"), reason, self.saturation_stress)

    def law_of(self) -> hardening.Hardening:
        """The yield stress over the plastic strain."""
        from tribox.forms.bodies.hardening import Voce

        return Voce(self.yield_stress, self.saturation_stress, self.exponent, self.modulus)


class SwiftHardening(Model):
    """σ_Y = K (ε₀ + α)ⁿ."""

    law: Literal["swift"] = Field(description="how the yield stress rises with plastic strain")
    K: Annotated[float, Quantity("Pa", gt=0.0)] = Field(
        description="strength coefficient K: the yield stress at ε₀ + α = 1"
    )
    strain0: Annotated[float, Quantity(gt=0.0)] = Field(
        description="strain ε₀, by which the body yields first at K ε₀ⁿ"
    )
    n: Annotated[float, Quantity(ge=0.0, le=1.0)] = Field(description="hardening exponent")

    def problems(self, place: Place) -> Iterator[Problem]:
        """None."""
        return iter(())

    def law_of(self) -> hardening.Hardening:
        """The yield stress over the plastic strain."""
        from tribox.forms.bodies.hardening import Swift

        return Swift(self.K, self.strain0, self.n)


class TableHardening(Model):
    """Straight lines between measured points."""

    law: Literal["table"] = Field(description="how the yield stress rises with plastic strain")
    points: Annotated[tuple[Row, ...], Rows(_STRAIN, _STRESS)] = Field(
        description="rows [[plastic strain, yield stress], ...] from strain 0 on; straight between "
        "them, level after the last"
    )

    def problems(self, place: Place) -> Iterator[Problem]:
        """A table that begins late, or falls."""
        first = self.points[0][0]
        if first != 0.0:
            yield Problem((*place, "points", 0, 0), "must be 0: where the body yields first", first)
        for index in range(1, len(self.points)):
            before, stress = self.points[index - 1][1], self.points[index][1]
            if stress < before:
                reason = f"must be >= {before:g} Pa, that of the row before: it may not fall"
                yield Problem((*place, "points", index, 1), reason, stress)

    def law_of(self) -> hardening.Hardening:
        """The yield stress over the plastic strain."""
        from tribox.forms.bodies.hardening import Table

        return Table(self.points)


class JohnsonCookRate(Model):
    """R = 1 + C ln(rate/reference)."""

    law: Literal["johnson-cook"] = Field(description="how the yield stress rises with the rate")
    C: Annotated[float, Quantity(gt=0.0)] = Field(
        description="coefficient of R = 1 + C ln(rate/reference_rate), the factor of the yield "
        "stress above the reference rate"
    )
    reference_rate: Annotated[float, Quantity("1/s", gt=0.0)] = Field(
        default=1.0, description="rate of plastic strain up to which R = 1"
    )

    def law_of(self) -> hardening.RateFactor:
        """The factor of the yield stress."""
        from tribox.forms.bodies.hardening import JohnsonCook

        return JohnsonCook(self.C, self.reference_rate)


class PerzynaRate(Model):
    """R = 1 + (rate/reference)^m."""

    law: Literal["perzyna"] = Field(description="how the yield stress rises with the rate")
    reference_rate: Annotated[float, Quantity("1/s", gt=0.0)] = Field(
        description="rate of plastic strain at which the yield stress is doubled"
    )
    exponent: Annotated[float, Quantity(gt=0.0, le=1.0)] = Field(
        description="m of R = 1 + (rate/reference_rate)^m, the factor of the yield stress"
    )

    def law_of(self) -> hardening.RateFactor:
        """The factor of the yield stress."""
        from tribox.forms.bodies.hardening import Perzyna

        return Perzyna(self.reference_rate, self.exponent)


Hardening = Annotated[
    LinearHardening | VoceHardening | SwiftHardening | TableHardening, Field(discriminator="law")
]
Rate = Annotated[JohnsonCookRate | PerzynaRate, Field(discriminator="law")]

MOST_BRANCHES = 8  # of the backstress: as many as the compiled loop over points has room for
_Branch = tuple[
    Annotated[float, Quantity("Pa", gt=0.0, name="c")], Annotated[float, Quantity(ge=0.0, name="b")]
]
Kinematic = Annotated[tuple[_Branch, ...], Field(max_length=MOST_BRANCHES)]


def kinematic_problems(branches: Kinematic, shear: float, place: Place) -> Iterator[Problem]:
    """Branches that are as stiff as the elastic metal.

    Args:
        branches: c, Pa, and b of each.
        shear: G, Pa.
        place: of the list.
    """
    for number, (c, b) in enumerate(branches):
        if c / max(b, 1.0) > shear:
            reason = f"c/max(b, 1) is {c / max(b, 1.0):.3g} Pa: must be <= {shear:.3g} Pa, the "
            reason += "shear modulus; of metals it is some MPa to some hundred MPa"
            yield Problem((*place, number), reason)


def backstress_of(branches: Kinematic) -> tuple[hardening.Backstress, ...]:
    """The branches of the backstress."""
    from tribox.forms.bodies.hardening import Backstress

    return tuple(Backstress(c, b) for c, b in branches)
