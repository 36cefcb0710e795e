"""The `[contact.film]` table of a case file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError

from tribox.app.case.declared import DeclaredTable, keys_of, table_of
from tribox.app.case.quantities import (
    Quantity,
    QuantityError,
    Written,
    format_quantity,
    text_schema,
)
from tribox.app.case.table import Flag, Place, Problem
from tribox.app.case.time_tables import NumberOrTable, Row, Rows
from tribox.forms.friction.film_rheology import FilmRheology

if TYPE_CHECKING:
    from tribox.forms.contact.asperities import FilmModel
    from tribox.forms.film.roughness import Asperities
    from tribox.forms.friction.film import FilmThickness

_PRESSURE = Quantity("Pa", ge=0.0, name="pressure")
_SEPARATION = Quantity("", name="g/sigma")
FLOODED = "flooded"
REACH = 100.0  # default of h_max, in sigma
SCALE = 0.1  # of E*: the pressure that cavitation is rounded off with

# How oil flows; keys that go with model = "reynolds" only, and those that it needs.
_RHEOLOGY = tuple(keys_of(FilmRheology))
_NEEDED = ("sigma", "oil", "share")
_REYNOLDS = (
    *("sigma", "asperities", "c", "u_0", "K", "table", "oil", "density", "share", "gamma"),
    *("h_max", "steady", "cells", *_RHEOLOGY),
)


class _OilType(Written):
    """Pydantic annotation of oil per area, or the word for more than enough."""

    quantity = Quantity("kg/m^2", gt=0.0)

    def parse(self, value: object) -> float | str:
        """The word, or the mass per area."""
        if value == FLOODED:
            return FLOODED
        try:
            return self.quantity.parse(value)
        except QuantityError as error:
            reason = f'"{FLOODED}", or mass per area: {error}'
            raise PydanticCustomError("quantity", "{reason}", {"reason": reason}) from None

    def serialise(self, value: float | str) -> object:
        """The word, or text."""
        return value if isinstance(value, str) else format_quantity(value, "kg/m^2")

    def json_schema(self) -> JsonSchemaValue:
        number = {"type": "number", "exclusiveMinimum": 0.0}
        return {"anyOf": [{"const": FLOODED}, number, text_schema("kg/m^2")], "x-unit": "kg/m^2"}


if TYPE_CHECKING:
    _Flow = DeclaredTable
else:
    _Flow = table_of("_Flow", FilmRheology, optional=("eta_b",))


class Film(_Flow):
    """The lubricating film of one contact; how its oil flows is declared with the rheology."""

    model: Literal["given", "reynolds"] = "given"
    """ "given": the thickness is an input; "reynolds": thickness and pressure follow from gap,
    speed, oil and roughness"""
    thickness: (
        Annotated[
            float | tuple[Row, ...],
            NumberOrTable(_PRESSURE, Quantity("m", ge=0.0, name="thickness")),
        ]
        | None
    ) = None
    """film thickness D, or a table [[pressure, thickness], ...] over the contact pressure, linear
    between its rows; needed with model = "given" """
    sigma: Annotated[float, Quantity("m", ge=0.0)] | None = None
    """rms roughness of both surfaces together; 0: smooth"""
    asperities: Literal["exponential", "greenwood-tripp", "table"] = "exponential"
    """law of the pressure that asperities carry"""
    c: Annotated[float, Quantity(gt=0.0)] = 0.375
    """exponential: p_a = c E* exp(-g/u_0)"""
    u_0: Annotated[float, Quantity("m", gt=0.0)] | None = None
    """exponential: see c; default: sigma"""
    K: Annotated[float, Quantity(gt=0.0)] | None = None
    """greenwood-tripp: K' of p_a = K' E* F_5/2(g/sigma), needed with it"""
    table: Annotated[tuple[Row, ...], Rows(_SEPARATION, _PRESSURE)] | None = None
    """table: [[g/sigma, p_a], ...], falling to 0 in its last row, needed with it"""
    oil: Annotated[float | str, _OilType()] | None = None
    """oil on the slave at the start, mass per area, or "flooded"; needed with model =
    "reynolds" """
    density: Annotated[float, Quantity("kg/m^3", gt=0.0)] | None = None
    """of the oil; needed with a mass of it"""
    share: Literal["contact", "map"] | None = None
    """ "contact": asperities rub under their own pressure, the film shears; "map": the friction-map
    law is given that pressure and the film; no default, needed with model = "reynolds" """
    gamma: Annotated[float, Quantity(ge=0.0)] = 1.0
    """flow factor of Patir & Cheng for roughness along and across the flow in this ratio: 1/9, 1/6,
    1/3, 1, 3, 6 or 9; 0: none"""
    h_max: Annotated[float, Quantity("m", gt=0.0)] | None = None
    """gap beyond which oil is only kept on the slave; default: 100 sigma"""
    steady: Flag = False
    """each step is the steady state of its speed: nothing is stored"""
    cells: Annotated[int, Field(ge=1, le=16)] = 4
    """cells of the film on each facet of the slave, which resolve its inlet"""

    @property
    def is_unknown(self) -> bool:
        """Whether the film follows from its mass balance."""
        return self.model == "reynolds"

    @property
    def thicknesses(self) -> tuple[float, ...]:
        """The thickness, or those of the table's rows, m; of an unknown film none."""
        if self.thickness is None:
            return ()
        if isinstance(self.thickness, tuple):
            return tuple(thickness for _, thickness in self.thickness)
        return (self.thickness,)

    def film(self) -> FilmThickness:
        """The film as a function of the pressure."""
        from tribox.forms.friction.film import ConstantFilm, FilmTable

        assert self.thickness is not None
        if isinstance(self.thickness, tuple):
            return FilmTable(self.thickness)
        return ConstantFilm(self.thickness)

    def at(self, pressure: float) -> float:
        """Thickness, m, at a contact pressure, Pa."""
        import numpy as np

        return float(self.film().at(np.array([pressure]))[0][0])

    def problems(self, place: Place, law: str) -> Iterator[Problem]:
        """Keys that do not fit together."""
        if not self.is_unknown:
            if self.thickness is None:
                reason = 'missing; the film thickness, such as "30 nm"'
                yield Problem((*place, "thickness"), reason)
            for key in _REYNOLDS:
                if self._differs(key):
                    yield Problem((*place, key), 'goes with model = "reynolds" only')
            return
        if self.thickness is not None:
            reason = 'does not go with model = "reynolds": it is found'
            yield Problem((*place, "thickness"), reason)
        for key in _NEEDED:
            if getattr(self, key) is None:
                yield Problem((*place, key), 'missing; needed with model = "reynolds"')
        yield from self._oil_problems(place)
        yield from self._law_problems(place, law)
        if self.eta_b is not None:
            yield from self.faults(place)
        if all(getattr(self, key) is not None for key in _NEEDED):
            try:
                self.asperity_law(1.0)
                self._rough()
            except ValueError as error:
                yield Problem(place, str(error))

    def _differs(self, key: str) -> bool:
        """Whether a key has another value than its default, which a resolved case may give."""
        return bool(getattr(self, key) != type(self).model_fields[key].default)

    def _oil_problems(self, place: Place) -> Iterator[Problem]:
        if isinstance(self.oil, float) and self.density is None:
            yield Problem((*place, "density"), "missing; needed with a mass of oil")
        if self.oil == FLOODED and self.density is not None:
            yield Problem((*place, "density"), "has no effect where the film is flooded")
        if self.sigma == 0.0 and self.h_max is None:
            yield Problem((*place, "h_max"), "missing; needed with sigma = 0")
        needs = {"greenwood-tripp": "K", "table": "table"}
        for kind, key in needs.items():
            if self.asperities == kind and getattr(self, key) is None:
                yield Problem((*place, key), f'missing; needed with asperities = "{kind}"')
            elif self.asperities != kind and getattr(self, key) is not None:
                yield Problem((*place, key), f'goes with asperities = "{kind}" only')
        for key in ("c", "u_0"):
            if self._differs(key) and self.asperities != "exponential":
                yield Problem((*place, key), 'goes with asperities = "exponential" only')

    def _law_problems(self, place: Place, law: str) -> Iterator[Problem]:
        mapped = law == "friction-map"
        if self.share == "map" and not mapped:
            yield Problem((*place, "share"), f'"map" needs law = "friction-map", not "{law}"')
        if self.share == "contact" and mapped:
            reason = 'law = "friction-map" shares the load by itself: share = "map", or another law'
            yield Problem((*place, "share"), reason)
        if self.share == "contact" and self.eta_b is None:
            reason = 'missing; the viscosity of the oil, such as "0.8 Pa*s"'
            yield Problem((*place, "eta_b"), reason)
        if self.share == "map":
            for key in _RHEOLOGY:
                if self._differs(key):
                    reason = "stands in the friction-map law's table"
                    yield Problem((*place, key), f'with share = "map" it {reason}')

    def resolved(self) -> Film:
        """The same with the defaults that depend on other keys."""
        assert self.sigma is not None
        update: dict[str, float] = {"h_max": self.h_max or REACH * self.sigma}
        if self.asperities == "exponential" and self.sigma > 0.0:
            update["u_0"] = self.u_0 or self.sigma
        return self.model_copy(update=update)

    def _rough(self) -> Any:
        from tribox.forms.film.roughness import RoughGap

        assert self.sigma is not None
        return RoughGap(self.sigma, self.gamma or None)

    def asperity_law(self, modulus: float) -> Asperities:
        """What asperities carry, with E*, Pa, of the pair; ValueError if values do not fit."""
        from tribox.forms.film.roughness import (
            AsperityTable,
            Exponential,
            GreenwoodTripp,
            NoAsperities,
        )

        assert self.sigma is not None
        if self.sigma == 0.0:
            return NoAsperities()
        if self.asperities == "table" and self.table is not None:
            return AsperityTable(self.table, self.sigma)
        if self.asperities == "greenwood-tripp" and self.K is not None:
            return GreenwoodTripp(self.K * modulus, self.sigma)
        return Exponential(self.c * modulus, self.u_0 or self.sigma)

    def rheology(self) -> FilmRheology:
        """Of the oil, as this table says."""
        return self.parameters()

    def unknown(self, modulus: float, rheology: Any = None) -> FilmModel:
        """The film that is solved for.

        Args:
            modulus: Pa, E* of both bodies together.
            rheology: of a map that the friction law is; None: that of this table.
        """
        from tribox.forms.contact.asperities import FilmModel

        assert self.sigma is not None and self.share is not None and self.oil is not None
        if rheology is None:
            rheology = self.rheology()
        mass = self.oil if isinstance(self.oil, float) else None
        return FilmModel(
            rough=self._rough(),
            asperities=self.asperity_law(modulus),
            rheology=rheology,
            share=self.share,
            oil=float("inf") if mass is None or self.density is None else mass / self.density,
            reach=self.h_max or REACH * self.sigma,
            steady=self.steady,
            scale=SCALE * modulus,
            cells=self.cells,
        )
