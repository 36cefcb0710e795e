"""All friction laws by the names that case files have for them.

Only what stands here can be named in a case; a law that is not here does not run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from tribox.forms.friction.coulomb import (
    CoulombLaw,
    CoulombParameters,
    FrictionlessLaw,
    NoParameters,
)
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import FrictionLaw
from tribox.forms.friction.parameters import FrictionMapParameters
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters
from tribox.forms.parameters import Declared


@dataclass(frozen=True, slots=True)
class Kind:
    """A friction law: the class of its parameters, and what makes the law of them."""

    # dataclass that declares and checks them, and says what defaults they want
    parameters: type[Declared]
    law: Callable[[Any], FrictionLaw]  # makes the law
    takes_film: bool = False  # whether it has a use for the thickness of a film
    needs_film: bool = False  # whether it cannot do without


LAWS: Mapping[str, Kind] = MappingProxyType(
    {
        "friction-map": Kind(FrictionMapParameters, FrictionMap, takes_film=True, needs_film=True),
        "coulomb": Kind(CoulombParameters, CoulombLaw),
        "stribeck": Kind(StribeckParameters, StribeckLaw),
        "frictionless": Kind(NoParameters, lambda _: FrictionlessLaw()),
    }
)
