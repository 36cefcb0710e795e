"""Cases with a body that flows."""

from typing import Any

from tests.app.checkpoint.small_cases import COARSE, STAGES, changed
from tests.app.conftest import BLOCK

SOFT_METAL = {
    "material": "elastoplastic", "E": "50 MPa", "nu": 0.33, "density": 2700,
    "hardening": {"law": "voce", "yield_stress": "0.3 MPa", "saturation_stress": "0.6 MPa",
     "exponent": 5.0, "modulus": "0.2 MPa"},
}  # fmt: skip
RATE = {"law": "perzyna", "reference_rate": "10 1/s", "exponent": 0.5}


def soft_block(rated: bool = False, **keys: Any) -> dict[str, Any]:
    """The small block on a metal so soft that it flows; two underscores for a dot."""
    metal = SOFT_METAL | ({"rate": RATE} if rated else {})
    more = {name.replace("__", "."): value for name, value in keys.items()}
    return changed(BLOCK, COARSE | {"stage": STAGES, "bodies.aluminium": metal} | more)
