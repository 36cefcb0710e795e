"""Cases with a body that flows: Hencky's material of a case is made an elastoplastic one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from app.build import solids
from forms.bodies.elastoplastic import ElastoPlastic
from forms.bodies.hardening import Perzyna, Voce
from forms.bodies.materials import Hencky
from tests.app.checkpoint.small_cases import COARSE, STAGES, changed
from tests.app.conftest import BLOCK

YIELD = Voce(yield_stress=0.3e6, saturation_stress=0.6e6, exponent=5.0, modulus=0.2e6)
SOFT_METAL = {"material": "hencky", "E": "50 MPa", "nu": 0.33, "density": 2700}


@contextmanager
def flowing(hardening: Any = YIELD, rated: bool = False) -> Iterator[None]:
    """Context in which bodies of Hencky's material flow."""
    made = solids.material_of
    rate = Perzyna(reference_rate=10.0, exponent=0.5) if rated else None

    def material_of(body: Any) -> Any:
        found = made(body)
        if isinstance(found, Hencky):
            return ElastoPlastic(found.shear_modulus, found.bulk_modulus, hardening, rate)
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solids, "material_of", material_of)
        yield


def soft_block(**keys: Any) -> dict[str, Any]:
    """The small block on a metal so soft that it flows; two underscores for a dot."""
    more = {name.replace("__", "."): value for name, value in keys.items()}
    return changed(BLOCK, COARSE | {"stage": STAGES, "bodies.aluminium": SOFT_METAL} | more)
