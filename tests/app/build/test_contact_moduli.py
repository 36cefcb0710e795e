"""Moduli of two bodies in contact, in closed form."""

from __future__ import annotations

import pytest

from app.build.contacts import contact_modulus, penalty_modulus
from forms.bodies.materials import Hencky, NeoHookean, oedometric_modulus, shear_and_bulk
from forms.closed_forms import hertz_line

RUBBER, METAL = (5e6, 0.49), (7e10, 0.33)  # E, ν


def test_contact_modulus_is_that_of_hertz():
    """1/E* = Σ (1 − ν²)/E, of two bodies alike and of two that differ."""
    rubber, metal = NeoHookean(*shear_and_bulk(*RUBBER)), Hencky(*shear_and_bulk(*METAL))
    soft = NeoHookean(*shear_and_bulk(3e6, 0.1))
    for one, other, numbers in (
        (rubber, metal, (RUBBER, METAL)),
        (rubber, rubber, (RUBBER, RUBBER)),
        (soft, rubber, ((3e6, 0.1), RUBBER)),
    ):
        expected = hertz_line.contact_modulus(*numbers)
        assert contact_modulus(one, other) == pytest.approx(expected, rel=1e-12)
        assert contact_modulus(other, one) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("ratio", "expected"), [(0.3, 10.0), (0.49, 10.0), (0.499, 50.1)])
def test_penalty_modulus(ratio, expected):
    """max(10 G, M/10) in units of G, M/G = 2(1 − ν)/(1 − 2ν); point by point M."""
    body = NeoHookean(*shear_and_bulk(2.0 * (1.0 + ratio) * 7.0, ratio))  # G = 7
    assert penalty_modulus(body, "averaged") == pytest.approx(7.0 * expected, rel=1e-9)
    oedometric = 14.0 * (1.0 - ratio) / (1.0 - 2.0 * ratio)
    assert penalty_modulus(body, "pointwise") == pytest.approx(oedometric, rel=1e-9)
    assert oedometric_modulus(body) == pytest.approx(oedometric, rel=1e-9)
