"""The `[contact.friction]` tables of a case file: a table for each law of ``forms``, and one more.

Keys, bounds and defaults are declared with the laws (:mod:`tribox.forms.friction.laws`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import Field

from tribox.app.case.declared import DeclaredTable, table_of
from tribox.app.case.film import Film
from tribox.app.case.own_code import NamesAClass, load_own_law
from tribox.app.case.table import Place, Problem
from tribox.forms.friction.laws import LAWS
from tribox.forms.friction.parameters import PRESETS, FrictionMapParameters
from tribox.forms.parameters import Scales, declarations

if TYPE_CHECKING:
    from tribox.forms.friction.law import FrictionLaw

MAP = "friction-map"
_LAW = Field(description="the friction law")


class LawTable(DeclaredTable):
    """The parameters of a friction law of ``forms``."""

    if TYPE_CHECKING:
        law: str

    def friction_law(self, time: float = 0.0, dim: int = 2) -> FrictionLaw:
        """The law of a resolved table at a time, s."""
        return LAWS[self.law].law(self.parameters(time))

    def resolved(self, scales: Scales) -> LawTable:
        """The same with the defaults that follow from bodies and mesh."""
        found = {
            name: declared.follows(scales)
            for name, declared, _ in declarations(type(self).declared)
            if declared.follows is not None and getattr(self, name) is None
        }
        return self.model_copy(update=found) if found else self

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        yield from self.faults(place)
        if not LAWS[self.law].needs_film:
            return
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


class OwnLaw(NamesAClass):
    """A friction law of the user's own; its file is run by :meth:`friction_law` only."""

    law: Literal["python"] = _LAW

    @property
    def changes(self) -> bool:
        """No: nothing of it follows a program of time."""
        return False

    def friction_law(self, time: float = 0.0, dim: int = 2) -> FrictionLaw:
        """The law, for which the user's code is run; OwnCodeError if there is none."""
        return load_own_law(self.reference, self.parameters, dim)

    def resolved(self, scales: Scales) -> OwnLaw:
        """The same: its defaults are its own."""
        return self

    def problems(self, place: Place, film: Film | None) -> Iterator[Problem]:
        """Whether the file is there, `place` being this table's place in the case."""
        yield from self.file_problems(place)


def _tag(law: str) -> dict[str, tuple[Any, Any]]:
    """The keys beside the parameters."""
    keys: dict[str, tuple[Any, Any]] = {"law": (Literal[law], _LAW)}
    if law == MAP:
        presets: Any = Literal[tuple(PRESETS)]
        meaning = "a named set of values for the keys below that are not given"
        keys["preset"] = (presets | None, Field(default=None, description=meaning))
    return keys


def _name(law: str) -> str:
    return "".join(word.capitalize() for word in law.split("-"))


TABLES: dict[str, type[LawTable]] = {
    law: table_of(_name(law), kind.parameters, LawTable, _tag(law)) for law, kind in LAWS.items()
}
"""The table of each law, by its name in a case file."""

if TYPE_CHECKING:
    Friction = LawTable | OwnLaw
else:
    Friction = Annotated[Union[*TABLES.values(), OwnLaw], Field(discriminator="law")]


def friction_table(law: str, **keys: Any) -> LawTable:
    """A table made in Python, of values in SI."""
    return TABLES[law](law=law, **keys)


def map_of(friction: Friction) -> FrictionMapParameters | None:
    """The parameters of the friction map, if it is one, as far as they are known."""
    if friction.law != MAP or not isinstance(friction, LawTable):
        return None
    return friction.parameters()
