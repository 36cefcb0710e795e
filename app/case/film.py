"""The `[contact.film]` table of a case file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Model
from tribox.app.case.time_tables import NumberOrTable, Row

if TYPE_CHECKING:
    from tribox.forms.friction.film import FilmThickness

_PRESSURE = Quantity("Pa", ge=0.0, name="pressure")


class Film(Model):
    """The lubricating film of one contact."""

    thickness: Annotated[
        float | tuple[Row, ...], NumberOrTable(_PRESSURE, Quantity("m", ge=0.0, name="thickness"))
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
        """The film as a function of the pressure."""
        from tribox.forms.friction.film import ConstantFilm, FilmTable

        if isinstance(self.thickness, tuple):
            return FilmTable(self.thickness)
        return ConstantFilm(self.thickness)

    def at(self, pressure: float) -> float:
        """Thickness, m, at a contact pressure, Pa."""
        import numpy as np

        return float(self.film().at(np.array([pressure]))[0][0])
