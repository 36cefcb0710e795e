"""The `[[contact]]` tables of a case file: surfaces, penalty, film and friction law."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    Field,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    create_model,
    field_validator,
)

from app.case.own_law import OwnLawError, load_own_law
from app.case.quantities import Quantity
from app.case.table import Count, Flag, Model, Place, Problem, Text
from app.case.time_tables import NumberOrTable, Row

if TYPE_CHECKING:
    from forms.friction.film import FilmThickness
    from forms.friction.law import FrictionLaw
    from forms.friction.parameters import FrictionMapParameters
    from forms.friction.stribeck import StribeckParameters

DEFAULT_PENALTY_FACTOR = 30.0
_SMOOTHED = ("quadrilateral", "hexahedron")
_PLURAL = {"triangle": "triangles", "tetrahedron": "tetrahedra"}
PRESET_NAMES = ("paper-printed", "paper-swapped", "friction-map")

_FILM_THICKNESS = Quantity("m", gt=0.0, name="film thickness")
_PRESSURE = Quantity("Pa", ge=0.0, name="pressure")
_Rows = tuple[Row, ...]


class Film(Model):
    """The lubricating film of one contact."""

    thickness: Annotated[
        float | _Rows, NumberOrTable(_PRESSURE, Quantity("m", ge=0.0, name="thickness"))
    ] = Field(
        description="film thickness D, or a table [[pressure, thickness], ...] over the contact "
        "pressure, linear between its rows"
    )

    @property
    def thicknesses(self) -> tuple[float, ...]:
        """The thickness, or those of the table's rows, m."""
        if isinstance(self.thickness, tuple):
            return tuple(thickness for _, thickness in self.thickness)
        return (self.thickness,)

    def film(self) -> FilmThickness:
        """What the contact takes."""
        from forms.friction.film import ConstantFilm, FilmTable

        if isinstance(self.thickness, tuple):
            return FilmTable(self.thickness)
        return ConstantFilm(self.thickness)

    def at(self, pressure: float) -> float:
        """Thickness, m, at a contact pressure, Pa."""
        import numpy as np

        return float(self.film().at(np.array([pressure]))[0][0])


class Frictionless(Model):
    """No tangential traction."""

    law: Literal["frictionless"] = Field(description="the friction law")

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """None."""
        return iter(())


class Coulomb(Model):
    """Coulomb friction with an elastic (penalty) stick phase."""

    law: Literal["coulomb"] = Field(description="the friction law")
    mu: Annotated[float, Quantity(ge=0.0)] = Field(description="coefficient of friction")
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
        """What the law takes.

        Raises:
            ValueError: the values do not fit together; the message says how.
        """
        from forms.friction.parameters import FrictionMapParameters

        values = self.model_dump(exclude={"law", "preset"})
        values["film_onset_pressure"] = self.film_onset_pressure or 0.0
        return FrictionMapParameters(**values)

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """What does not fit together, `place` being this table's place in the case."""
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
        elif (thickest := max(film.thicknesses)) > self.D_min and self.eta_b == 0.0:
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
        """What the law takes; `K_T` must be there.

        Raises:
            ValueError: the values do not fit together; the message says how.
        """
        from forms.friction.stribeck import StribeckParameters

        return StribeckParameters(**self.model_dump(exclude={"law"}))

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """What does not fit together, `place` being this table's place in the case."""
        if self.mu_d > self.mu_s:
            yield Problem((*place, "mu_d"), f"must be <= mu_s = {self.mu_s:g}", self.mu_d)


if TYPE_CHECKING:
    _NamesAClass = Model
else:
    # A field called "class" cannot be written as an attribute.
    _NamesAClass = create_model(
        "_NamesAClass",
        __base__=Model,
        **{
            "class": (
                Text,
                Field(description='file and class, "my_law.py:MyLaw", relative to the case file'),
            )
        },
    )


class OwnLaw(_NamesAClass):
    """A friction law of the user's own, written in Python."""

    law: Literal["python"] = Field(description="the friction law")
    parameters: dict[str, Any] = Field(
        default={}, description="what the class is called with, by name, as it stands here"
    )

    @field_validator("class")
    @classmethod
    def _found_from_anywhere(cls, value: str, info: ValidationInfo) -> str:
        """The file from the root on, so that a copy of the case elsewhere finds it too."""
        source = (info.context or {}).get("source")
        file, colon, name = value.rpartition(":")
        return f"{(Path(source or '').parent / file).resolve()}:{name}" if colon else value

    def friction_law(self) -> FrictionLaw:
        """The law that the class makes.

        Raises:
            OwnLawError: there is no such file or class, or it makes no friction law.
        """
        return load_own_law(getattr(self, "class"), self.parameters)

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """Whether the class makes a friction law, `place` being this table's place in the case."""
        try:
            self.friction_law()
        except OwnLawError as error:
            yield Problem((*place, error.key), str(error), getattr(self, error.key))


Friction = Annotated[
    FrictionMap | Coulomb | Stribeck | OwnLaw | Frictionless, Field(discriminator="law")
]


class Contact(Model):
    """One pair of surfaces."""

    slave: Text = Field(description="surface that carries the contact points (the softer body's)")
    master: Text = Field(description="surface the points are projected on")
    quadrature_degree: Count | None = Field(
        default=None,
        description="degree of the quadrature on slave facets; default 9 in the plane (five points "
        "per segment), 5 in space",
    )
    penalty: Annotated[float, Quantity("Pa/m", gt=0.0)] | None = Field(
        default=None, description="normal stiffness K_N (or penalty_factor)"
    )
    penalty_factor: Annotated[float, Quantity(gt=0.0)] | None = Field(
        default_factory=lambda data: (
            DEFAULT_PENALTY_FACTOR if data.get("penalty") is None else None
        ),
        description="K_N = penalty_factor * M/h, with the oedometric modulus M of the softer body "
        f"and the length h of a slave facet; default: {DEFAULT_PENALTY_FACTOR:g}, without penalty",
    )
    smoothing_angle: Annotated[float, Quantity("rad", gt=0.0, le=math.pi)] | None = Field(
        default=None,
        description="smooth the master: its normals become continuous across the sides of facets "
        "whose normals differ by less than this angle; default: the facets as they are. First "
        "order quadrilaterals or hexahedra only",
    )
    film: Film | None = Field(default=None, description="the film; needed by the friction-map law")
    friction: Friction = Field(description="the friction law and its parameters")

    @field_validator("friction", mode="wrap")
    @classmethod
    def _fill_from_preset(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        """Fill keys that are not given from the preset; they stay "not set" by the user."""
        if not isinstance(value, dict) or value.get("preset") not in PRESET_NAMES:
            return handler(value)
        from forms.friction.parameters import with_preset

        given = {key: entry for key, entry in value.items() if key not in ("law", "preset")}
        merged = with_preset(value["preset"], given)
        friction = handler({"law": "friction-map", **value, **merged})
        friction.model_fields_set.difference_update(merged.keys() - given.keys())
        return friction

    @property
    def film_conductance(self) -> float:
        """Largest eta_b/D, Pa s/m, stress of a Newtonian film per speed; 0 where there is none."""
        friction = self.friction
        if not isinstance(friction, FrictionMap) or self.film is None:
            return 0.0
        wet = [D for D in self.film.thicknesses if friction.D_min < D]
        return friction.eta_b / min(wet) if wet else 0.0

    @property
    def film_onset(self) -> float:
        """Pressure from which the film is whole, Pa; 0 where the case does not give it."""
        friction = self.friction
        return friction.film_onset_pressure or 0.0 if isinstance(friction, FrictionMap) else 0.0

    def smoothing_problem(self, cell: str, degree: int) -> str | None:
        """Why the master cannot be smoothed, if it is to be and cannot.

        Args:
            cell: of the mesh.
            degree: of the displacements.
        """
        if self.smoothing_angle is None or (degree == 1 and cell in _SMOOTHED):
            return None
        found = f"on {_PLURAL.get(cell, cell)}" if cell not in _SMOOTHED else 'with "q2"'
        return (
            'needs first-order quadrilaterals or hexahedra (formulation "q1" or "q1-sri"); '
            f"it does not work {found}"
        )

    def problems(self, place: Place) -> Iterator[Problem]:
        """What does not fit together, `place` being this table's place in the case."""
        if self.slave == self.master:
            yield Problem((*place, "master"), "must differ from slave", self.master)
        if self.penalty is not None and self.penalty_factor is not None:
            yield Problem(place, "give either penalty or penalty_factor, not both")
        yield from self.friction.problems((*place, "friction"), self.film)
