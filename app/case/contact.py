"""The `[[contact]]` tables of a case file: surfaces, penalty, film and friction law."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, ValidatorFunctionWrapHandler, field_validator

from app.case.film import Film
from app.case.friction import PRESET_NAMES, Friction, FrictionMap
from app.case.quantities import Quantity
from app.case.table import Degree, Model, Name, Place, Problem, Text

DEFAULT_PENALTY_FACTOR = 30.0
_SMOOTHED = ("quadrilateral", "hexahedron")
_PLURAL = {"triangle": "triangles", "tetrahedron": "tetrahedra"}


class Contact(Model):
    """One pair of surfaces."""

    name: Name | None = Field(
        default=None, description="what tables and figures call the pair; default SLAVE-MASTER"
    )
    slave: Text = Field(description="surface that carries the contact points (the softer body's)")
    master: Text = Field(description="surface the points are projected on")
    quadrature_degree: Degree | None = Field(
        default=None,
        description="degree of the quadrature on slave facets; default 9 in the plane (five points "
        "per segment), or 11 (six) unless the slave is ten times softer; 5 in space",
    )
    pressure: Literal["averaged", "pointwise"] = Field(
        default="averaged",
        description='"averaged": the pressure follows from the mean gap around each vertex of the '
        'slave facets; "pointwise": from the gap of each quadrature point, as in the paper',
    )
    penalty: Annotated[float, Quantity("Pa/m", gt=0.0)] | None = Field(
        default=None, description="normal stiffness K_N (or penalty_factor)"
    )
    penalty_factor: Annotated[float, Quantity(gt=0.0)] | None = Field(
        default_factory=lambda data: (
            DEFAULT_PENALTY_FACTOR if data.get("penalty") is None else None
        ),
        description="K_N = penalty_factor * max(10 G, M/10)/h, with shear and oedometric modulus G "
        "and M of the softer body and the local length h of the slave facets; with pointwise "
        f"pressure penalty_factor * M/h; of a softer body that flows penalty_factor * 10 H/h, H "
        f"its hardness; default: {DEFAULT_PENALTY_FACTOR:g}, without penalty",
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
    def label(self) -> str:
        """What results call the pair."""
        return f"{self.slave}-{self.master}" if self.name is None else self.name

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
        """Keys that do not fit together; `place` is where this table stands in the case."""
        if self.slave == self.master:
            yield Problem((*place, "master"), "must differ from slave", self.master)
        if self.penalty is not None and self.penalty_factor is not None:
            yield Problem(place, "give either penalty or penalty_factor, not both")
        yield from self.friction.problems((*place, "friction"), self.film)
