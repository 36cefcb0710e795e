"""The `hardening` and `rate` tables and the `kinematic` list of bodies that flow.

Keys and bounds are declared with the laws (:mod:`tribox.forms.bodies.hardening`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import Field

from tribox.app.case.declared import DeclaredTable, table_of
from tribox.app.case.quantities import Quantity
from tribox.app.case.table import Place, Problem
from tribox.forms.bodies import hardening
from tribox.forms.parameters import Declared


def _union(kinds: Mapping[str, type[Declared]], suffix: str, what: str) -> Any:
    """A table for each law, told apart by its key ``law``."""
    field = Field(description=f"how the yield stress rises with {what}")
    tables = [
        table_of(kind.__name__ + suffix, kind, tag={"law": (Literal[law], field)})
        for law, kind in kinds.items()
    ]
    return Annotated[Union[*tables], Field(discriminator="law")]


if TYPE_CHECKING:
    Hardening = DeclaredTable
    Rate = DeclaredTable
else:
    Hardening = _union(hardening.HARDENING, "Hardening", "plastic strain")
    Rate = _union(hardening.RATES, "Rate", "the rate")

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
    return tuple(hardening.Backstress(c, b) for c, b in branches)
