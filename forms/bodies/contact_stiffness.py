"""What the default stiffnesses of a contact are made from."""

from __future__ import annotations

import numpy as np

from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.materials import Material

# Pressure that a body which flows can bear under a tool, over its yield stress: D. Tabor, The
# Hardness of Metals, Oxford 1951. The yield stress is taken at a plastic strain of forming.
HARDNESS = 3.0
FORMED = 0.2


def contact_shear_modulus(material: Material) -> float:
    """The modulus, Pa, that stands for a body in the default stiffnesses of its contacts.

    An elastic body presses with a share of its shear modulus G: what is a multiple of G lets it
    approach by a small share of its elements. A metal that flows presses with at most its
    indentation hardness H ≈ 3 σ_Y, some hundredth of G. The same multiple of H lets it approach as
    little, at all pressures it can bear, and is no stiffer than its elements are before they yield.
    """
    if not isinstance(material, ElastoPlastic):
        return material.shear_modulus
    yield_stress = float(material.hardening.stress(np.array(FORMED)))
    yield_stress += sum(branch.pulled(FORMED) for branch in material.kinematic)
    return min(material.shear_modulus, HARDNESS * yield_stress)
