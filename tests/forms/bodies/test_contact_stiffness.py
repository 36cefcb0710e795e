"""The modulus that stands for a body in the stiffnesses of its contacts."""

import pytest

from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Linear
from tribox.forms.bodies.materials import Hencky, contact_shear_modulus


def test_elastic_bodies_have_their_shear_modulus():
    assert contact_shear_modulus(Hencky(26e9, 68e9)) == 26e9


def test_a_metal_has_its_hardness():
    """3 (σ₀ + 0.2 H), whatever its elastic constants; one that does not yield has G."""
    law = Linear(30e6, 200e6)
    for shear in (26e9, 80e9):
        found = contact_shear_modulus(ElastoPlastic(shear, 68e9, law))
        assert found == pytest.approx(3.0 * (30e6 + 40e6))
    assert contact_shear_modulus(ElastoPlastic(26e9, 68e9, Linear(20e9))) == 26e9
