"""The `[[contact]]` tables of a case file: surfaces, penalty, film and friction law."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import Field, ValidatorFunctionWrapHandler, field_validator

from tribox.app.case.film import Film
from tribox.app.case.friction import Friction, LawTable, friction_table, map_of
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import MOST_ENTRIES, Degree, Flag, Model, Name, Place, Problem, Text
from tribox.app.case.time_tables import NumberOrProgram, Program, TimeTable
from tribox.forms.friction.laws import LAWS
from tribox.forms.friction.parameters import PRESETS, FrictionMapParameters, with_preset

DEFAULT_PENALTY_FACTOR = 30.0
_SMOOTHED = ("quadrilateral", "hexahedron")
_PLURAL = {"triangle": "triangles", "tetrahedron": "tetrahedra"}


DRAWN = "drawn"  # the overlap of a fit is that of the mesh
_MISSING: Any = None  # refused by Contact.problems
# Keys that do not go with tied.
_NOT_TIED = ("film", "friction_factor", "smoothing_angle", "fade_length", "interference")


class Contact(Model):
    """One pair of surfaces."""

    name: Name | None = None
    """what tables and figures call the pair; default SLAVE-MASTER"""
    slave: Text
    """surface that carries the contact points (the softer body's)"""
    master: Text
    """surface the points are projected on"""
    tied: Flag = False
    """bond the surfaces where they lie beside each other undeformed, with their distance: no gap
    opens, nothing slides. Without friction, film and what goes with them"""
    quadrature_degree: Degree | None = None
    """degree of the quadrature on slave facets; default 9 in the plane (five points per segment),
    or 11 (six) unless the slave is ten times softer; 5 in space"""
    pressure: Literal["averaged", "pointwise"] = "averaged"
    """ "averaged": the pressure follows from the mean gap around each vertex of the slave facets;
    "pointwise": from the gap of each quadrature point, as in the paper"""
    penalty: Annotated[float, Quantity("Pa/m", gt=0.0)] | None = None
    """normal stiffness K_N (or penalty_factor)"""
    penalty_factor: Annotated[float, Quantity(gt=0.0)] | None = Field(
        default_factory=lambda data: (
            DEFAULT_PENALTY_FACTOR if data.get("penalty") is None else None
        ),
        description="K_N = penalty_factor * max(10 G, M/10)/h, with shear and oedometric modulus G "
        "and M of the softer body and the local length h of the slave facets; with pointwise "
        f"pressure penalty_factor * M/h; of a softer body that flows penalty_factor * 10 H/h, H "
        f"its hardness; default: {DEFAULT_PENALTY_FACTOR:g}, without penalty",
    )
    smoothing_angle: Annotated[float, Quantity("rad", gt=0.0, le=math.pi)] | None = None
    """smooth the master: its normals become continuous across the sides of facets whose normals
    differ by less than this angle; default: the facets as they are. First order quadrilaterals or
    hexahedra only"""
    fade_length: Annotated[float, Quantity("m", gt=0.0)] | None = None
    """way before an open end of the master over which the pressure fades to zero; default: within a
    facet of the slave. With averaged pressure"""
    stages: tuple[Text, ...] | None = Field(default=None, min_length=1, max_length=MOST_ENTRIES)
    """names of the stages in which the surfaces feel each other; default: all"""
    interference: Annotated[TimeTable | Literal["drawn"], Program("m", word=DRAWN)] | None = None
    """press or shrink fit: how much larger the surfaces are across the contact than they are drawn;
    a number comes on over the first stage in which they touch, a program as it says; less than 0 is
    a clearance, there from the start; "drawn": the surfaces overlap as they are drawn, and what
    overlaps is pushed apart over that stage"""
    friction_factor: Annotated[float | TimeTable, NumberOrProgram("", least=0.0)] = 1.0
    """factor of the friction law's traction and stiffness, a number or a program of time"""
    film: Film | None = None
    """the film; needed by the friction-map law"""
    friction: Friction = Field(
        default_factory=lambda data: (
            friction_table("frictionless") if data.get("tied") else _MISSING
        )
    )
    """the friction law and its parameters; needed unless tied"""

    @field_validator("friction", mode="wrap")
    @classmethod
    def _fill_from_preset(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        """Fill keys that are not given from the preset; they stay "not set" by the user."""
        preset = value.get("preset") if isinstance(value, dict) else None
        if not isinstance(preset, str) or preset not in PRESETS:
            return handler(value)
        given = {key: entry for key, entry in value.items() if key not in ("law", "preset")}
        merged = with_preset(preset, given)
        friction = handler({"law": "friction-map", **value, **merged})
        friction.model_fields_set.difference_update(merged.keys() - given.keys())
        return friction

    @property
    def label(self) -> str:
        """What results call the pair."""
        return f"{self.slave}-{self.master}" if self.name is None else self.name

    @property
    def comes_on(self) -> bool:
        """Whether a fit comes on over a stage: one as it is drawn, or of a number above 0."""
        fit = self.interference
        return fit == DRAWN or (
            isinstance(fit, TimeTable) and len(fit.values) == 1 and fit.values[0] > 0.0
        )

    @property
    def acting_film(self) -> Film | None:
        """The film of a given thickness, where the friction law has a use for it."""
        law = LAWS.get(self.friction.law)  # what is not among them is the user's own
        return self.given_film if law is None or law.takes_film else None

    @property
    def map(self) -> FrictionMapParameters | None:
        """The parameters of the friction map, if that is the law."""
        return map_of(self.friction)

    @property
    def film_conductance(self) -> float:
        """Largest eta_b/D, Pa s/m, stress of a Newtonian film per speed; 0 where there is none."""
        law, film = self.friction, self.given_film
        if film is None or not isinstance(law, LawTable) or not LAWS[law.law].needs_film:
            return 0.0
        wet = [D for D in film.thicknesses if law.D_min < D]
        return float(law.eta_b / min(wet)) if wet else 0.0

    @property
    def film_onset(self) -> float:
        """Pressure from which the film is whole, Pa; 0 where the case does not give it."""
        return 0.0 if self.map is None else self.map.film_onset_pressure

    def acts_in(self, stage: str) -> bool:
        """Whether the surfaces feel each other in a stage."""
        return self.stages is None or stage in self.stages

    def stage_problems(self, place: Place, names: Sequence[str]) -> Iterator[Problem]:
        """Stages that are not those of the case, ``names``."""
        for number, stage in enumerate(self.stages or ()):
            where = (*place, "stages", number)
            if stage not in names:
                yield Problem(where, f"no such stage; there are {', '.join(names)}", stage)
            elif stage in (self.stages or ())[:number]:
                yield Problem(where, "is in the list twice", stage)
        acts = [self.acts_in(name) for name in names]
        if self.tied and acts != sorted(acts, reverse=True):
            reason = (
                "what is tied is tied undeformed: it acts from the first stage on and may only "
                "let go, once"
            )
            yield Problem((*place, "stages"), reason, list(self.stages or ()))

    def smoothing_problem(self, cell: str, degree: int) -> str | None:
        """Why the master cannot be smoothed, if it is to be and cannot."""
        if self.smoothing_angle is None or (degree == 1 and cell in _SMOOTHED):
            return None
        found = f"on {_PLURAL.get(cell, cell)}" if cell not in _SMOOTHED else 'with "q2"'
        return (
            'needs first-order quadrilaterals or hexahedra (formulation "q1" or "q1-sri"); '
            f"it does not work {found}"
        )

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        if self.slave == self.master:
            yield Problem((*place, "master"), "must differ from slave", self.master)
        if self.penalty is not None and self.penalty_factor is not None:
            yield Problem(place, "give either penalty or penalty_factor, not both")
        if self.fade_length is not None and self.pressure == "pointwise":
            reason = 'goes with pressure = "averaged" only'
            yield Problem((*place, "fade_length"), reason, self.fade_length)
        if self.friction is _MISSING:
            reason = "missing; the friction law and its parameters"
            yield Problem((*place, "friction"), reason)
            return
        if self.tied:
            # Keys that do not go with tied
            for key in _NOT_TIED:
                if getattr(self, key) not in (None, 1.0):
                    yield Problem((*place, key), "does not go with tied: nothing slides")
            if self.pressure == "pointwise":
                reason = "does not go with tied, whose jump is averaged around vertices"
                yield Problem((*place, "pressure"), reason, self.pressure)
            if self.friction.law != "frictionless":
                reason = "does not go with tied: nothing slides; leave the table out"
                yield Problem((*place, "friction"), reason)
        elif self.friction_factor != 1.0 and self.friction.law == "frictionless":
            yield Problem((*place, "friction_factor"), 'has no effect with law = "frictionless"')
        film = self.film
        if film is not None:
            yield from film.problems((*place, "film"), self.friction.law)
        if film is not None and film.is_unknown:
            # Keys that do not go with a film that is solved for
            reason = 'does not go with film.model = "reynolds", whose asperities take its place'
            if self.penalty is not None:
                yield Problem((*place, "penalty"), reason)
            elif self.penalty_factor != DEFAULT_PENALTY_FACTOR:
                yield Problem((*place, "penalty_factor"), reason)
            if self.pressure == "pointwise":
                reason = 'film.model = "reynolds" needs "averaged"'
                yield Problem((*place, "pressure"), reason, self.pressure)
            for key in ("fade_length", "interference"):
                if getattr(self, key) is not None:
                    reason = 'does not go with film.model = "reynolds"'
                    yield Problem((*place, key), reason)
        yield from self.friction.problems((*place, "friction"), film)

    @property
    def given_film(self) -> Film | None:
        """The film, where its thickness is an input."""
        return None if self.film is None or self.film.is_unknown else self.film
