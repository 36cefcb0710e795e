"""The `[contact.friction]` tables of a case file: the friction laws."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from tribox.app.case.film import Film
from tribox.app.case.own_code import NamesAClass, load_own_law
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Flag, Model, Place, Problem
from tribox.app.case.time_tables import NumberOrProgram, NumberOrTable, Row, TimeTable

if TYPE_CHECKING:
    from tribox.forms.friction.guarded_law import GuardedLaw
    from tribox.forms.friction.parameters import FrictionMapParameters
    from tribox.forms.friction.stribeck import StribeckParameters

PRESET_NAMES = ("paper-printed", "paper-swapped", "friction-map")
_FILM_THICKNESS = Quantity("m", gt=0.0, name="film thickness")
_Rows = tuple[Row, ...]


class Frictionless(Model):
    """No tangential traction."""

    law: Literal["frictionless"] = Field(description="the friction law")

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """None."""
        return iter(())


class Coulomb(Model):
    """Coulomb friction with an elastic (penalty) stick phase."""

    law: Literal["coulomb"] = Field(description="the friction law")
    mu: Annotated[float | TimeTable, NumberOrProgram("", least=0.0)] = Field(
        description="coefficient of friction, a number or a program of time"
    )
    K_T: Annotated[float, Quantity("Pa/m", gt=0.0)] | None = Field(
        default=None,
        description="tangential stiffness before slip; default: 10 G/h, with the shear modulus G "
        "of the softer body and the length h of a slave facet",
    )

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """None."""
        return iter(())


class FrictionMap(Model):
    """Friction of a lubricated contact between Coulomb and viscous, by film and velocity."""

    law: Literal["friction-map"] = Field(description="the friction law")
    preset: Literal["paper-printed", "paper-swapped", "friction-map"] | None = Field(
        default=None, description="a named set of values for the keys below that are not given"
    )
    mu_s: Annotated[float, Quantity(ge=0.0)] = Field(description="static coefficient of friction")
    mu_d: Annotated[float, Quantity(ge=0.0)] = Field(
        default_factory=lambda data: data.get("mu_s", 0.0),
        description="dynamic coefficient of friction; default: mu_s",
    )
    A_d: Annotated[float, Quantity("m", ge=0.0)] = Field(
        default=0.0, description="slip at which the fall from mu_s to mu_d starts"
    )
    B: Annotated[float, Quantity("1/m", ge=0.0)] = Field(
        default=0.0, description="rate of the fall from mu_s to mu_d with slip"
    )
    K_T: Annotated[float, Quantity("Pa/m", gt=0.0)] = Field(
        description="tangential stiffness of the asperities"
    )
    eta_b: Annotated[float, Quantity("Pa*s", ge=0.0)] = Field(
        default=0.0, description="bulk viscosity of the film; needed (> 0) where D > D_min"
    )
    D_min: Annotated[float, Quantity("m", ge=0.0)] = Field(
        default=0.0, description="thickness up to which friction is purely Coulomb"
    )
    D_max: Annotated[float, Quantity("m", gt=0.0)] = Field(
        description="thickness from which the film is a Newtonian fluid"
    )
    alpha: (
        Annotated[float | _Rows, NumberOrTable(_FILM_THICKNESS, Quantity(ge=0.0, le=1.0))] | None
    ) = Field(
        default=None,
        description="film fraction below the switching velocity V*, a number or a table "
        "[[thickness, alpha], ...] (this or beta)",
    )
    beta: Annotated[float | _Rows, NumberOrTable(_FILM_THICKNESS, Quantity(gt=0.0))] | None = Field(
        default=None,
        description="exponent of alpha = ((D - D_min)/(D_max - D_min))^beta, a number or a table "
        "[[thickness, beta], ...] (this or alpha)",
    )
    V_star: Annotated[float, Quantity("m/s", gt=0.0)] | None = Field(
        default=None, description="switching velocity V* at the thickness V_star_at (or gamma)"
    )
    V_star_at: Annotated[float, Quantity("m", gt=0.0)] | None = Field(
        default=None, description="thickness at which V_star holds"
    )
    gamma: Annotated[float, Quantity("N/s", gt=0.0)] | None = Field(
        default=None, description="constant of V* = sqrt(gamma D_max/(eta_b D)) (or V_star)"
    )
    transition_width: Annotated[float, Quantity(ge=0.0, lt=1.0)] = Field(
        default=0.03, description="width of the transition at V*, relative to V*"
    )
    flow_rule: Literal["weighted", "literal"] = Field(
        default="weighted", description="friction threshold (1 - alpha) mu p, or mu p as printed"
    )
    reentry: Literal["consistent", "literal"] = Field(
        default="consistent",
        description="what is kept when alpha falls: the traction, or the elastic slip",
    )
    switch: Literal["implicit", "lagged"] = Field(
        default="implicit", description="alpha from the velocity of this step, or of the last one"
    )
    reset_slip_on_opening: Flag = Field(
        default=False, description="whether a point that opens forgets the slip it has made"
    )

    film_onset_pressure: Annotated[float, Quantity("Pa", ge=0.0)] | None = Field(
        default=None,
        description="contact pressure up to which the film's stress grows with the pressure; "
        "0 lets the traction jump where a point opens; default: 1 % of the softer body's shear "
        "modulus or of the highest prescribed pressure, whichever is less",
    )
    tau_0: Annotated[float, Quantity("Pa", ge=0.0)] | None = Field(
        default=None, description="limiting shear stress of the film at no pressure; default: none"
    )
    zeta: Annotated[float, Quantity(ge=0.0)] = Field(
        default=0.0, description="growth of the limiting shear stress with the pressure"
    )
    critical_rate: Annotated[float, Quantity("1/s", gt=0.0)] | None = Field(
        default=None, description="shear rate from which the film thins (Carreau); default: never"
    )
    thinning_exponent: Annotated[float, Quantity(ge=0.0, le=1.0)] | None = Field(
        default=None, description="exponent n of the thinning, needed with critical_rate"
    )
    eta_inf: Annotated[float, Quantity("Pa*s", ge=0.0)] = Field(
        default=0.0, description="viscosity of the film at infinite shear rate, at most eta_b"
    )
    barus: Annotated[float, Quantity("1/Pa", ge=0.0)] = Field(
        default=0.0, description="coefficient a of eta_b exp(a p) (Barus)"
    )

    def parameters(self) -> FrictionMapParameters:
        """The parameters of the law.

        Raises:
            ValueError: the values do not fit together; the message says how.
        """
        from tribox.forms.friction.parameters import FrictionMapParameters

        values = self.model_dump(exclude={"law", "preset"})
        values["film_onset_pressure"] = self.film_onset_pressure or 0.0
        return FrictionMapParameters(**values)

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        found = list(self._problems(place, film))
        if not found:
            try:
                self.parameters()
            except ValueError as error:
                found.append(Problem(place, str(error)))
        yield from found

    def _problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        if self.mu_d > self.mu_s:
            yield Problem((*place, "mu_d"), f"must be <= mu_s = {self.mu_s:g}", self.mu_d)
        if self.D_max <= self.D_min:
            reason = f"must be > D_min = {self.D_min:g} m"
            yield Problem((*place, "D_max"), reason, self.D_max)
        yield from self._alternatives(place)
        if film is None:
            reason = 'missing; law = "friction-map" needs the film thickness, such as "30 nm"'
            yield Problem((*place[:-1], "film", "thickness"), reason)
        elif film.is_unknown and self.eta_b == 0.0:
            reason = 'missing; the viscosity of the oil, such as "0.8 Pa*s"'
            yield Problem((*place, "eta_b"), reason)
        elif (thickest := max(film.thicknesses, default=0.0)) > self.D_min and self.eta_b == 0.0:
            reason = (
                f"a film thicker than D_min ({thickest:g} m > {self.D_min:g} m) needs a "
                'viscosity > 0 Pa*s, such as "0.8 Pa*s"'
            )
            yield Problem((*place, "eta_b"), reason, self.eta_b)

    def _alternatives(self, place: Place) -> Iterator[Problem]:
        if (self.alpha is None) == (self.beta is None):
            found = "neither" if self.alpha is None else "both"
            yield Problem(place, f"give either alpha or beta, found {found}")
        if (self.V_star is None) == (self.gamma is None):
            found = "neither" if self.gamma is None else "both"
            yield Problem(place, f"give either V_star (with V_star_at) or gamma, found {found}")
        if self.V_star is not None and self.V_star_at is None:
            reason = 'missing; the thickness at which V_star holds, such as "10 nm"'
            yield Problem((*place, "V_star_at"), reason)
        if self.V_star is None and self.V_star_at is not None:
            reason = "belongs to V_star, which is not given"
            yield Problem((*place, "V_star_at"), reason, self.V_star_at)


class Stribeck(Model):
    """Coulomb friction that weakens with the velocity."""

    law: Literal["stribeck"] = Field(description="the friction law")
    mu_s: Annotated[float, Quantity(ge=0.0)] = Field(description="coefficient of friction at rest")
    mu_d: Annotated[float, Quantity(ge=0.0)] = Field(
        description="coefficient of friction at high velocity"
    )
    V_s: Annotated[float, Quantity("m/s", gt=0.0)] = Field(
        description="velocity of the fall from mu_s to mu_d"
    )
    delta: Annotated[float, Quantity(gt=0.0)] = Field(
        default=1.0, description="exponent of that fall"
    )
    viscous: Annotated[float, Quantity("Pa*s/m", ge=0.0)] = Field(
        default=0.0, description="viscous stress per velocity"
    )
    K_T: Annotated[float, Quantity("Pa/m", gt=0.0)] | None = Field(
        default=None, description="tangential stiffness before slip; default: as for coulomb"
    )

    def parameters(self) -> StribeckParameters:
        """The parameters of the law; `K_T` must be given.

        Raises:
            ValueError: the values do not fit together; the message says how.
        """
        from tribox.forms.friction.stribeck import StribeckParameters

        return StribeckParameters(**self.model_dump(exclude={"law"}))

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        if self.mu_d > self.mu_s:
            yield Problem((*place, "mu_d"), f"must be <= mu_s = {self.mu_s:g}", self.mu_d)


class OwnLaw(NamesAClass):
    """A friction law of the user's own, written in Python.

    The case only names it: the file is run by :meth:`friction_law`, when a run is built.
    """

    law: Literal["python"] = Field(description="the friction law")

    def friction_law(self, dim: int = 2) -> GuardedLaw:
        """The law that the class makes; this runs the user's code.

        Args:
            dim: space dimensions that it is tried in.

        Raises:
            OwnCodeError: there is no such file or class, or it makes no friction law.
        """
        return load_own_law(self.reference, self.parameters, dim)

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """Whether the file is there, `place` being this table's place in the case."""
        yield from self.file_problems(place)


Friction = Annotated[
    FrictionMap | Coulomb | Stribeck | OwnLaw | Frictionless, Field(discriminator="law")
]
