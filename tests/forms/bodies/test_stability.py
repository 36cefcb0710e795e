"""Where energies of elastomers lose their stability, against conditions by hand."""

import pytest
from scipy.optimize import brentq

from tribox.forms.bodies.materials import MooneyRivlin, NeoHookean, Ogden, Yeoh
from tribox.forms.bodies.stability import stability_limits

TRELOAR = Ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0), 1000.0)


@pytest.mark.parametrize(
    "material",
    [
        NeoHookean(1.0, 1000.0),
        MooneyRivlin(0.4, 0.1, 1000.0),
        Yeoh(0.5, -0.01, 0.001, 1.0),
        TRELOAR,
    ],
    ids=lambda m: type(m).__name__,
)
def test_stable(material):
    assert stability_limits(material) == {}


def determinant(C10, C01, stretches):
    """Of ∂²W/∂ε_a∂ε_b of an incompressible Mooney–Rivlin body, over 16."""
    a = [C10 * s**2 + C01 * s**-2.0 for s in stretches]
    return (a[0] + a[2]) * (a[1] + a[2]) - a[2] ** 2


@pytest.mark.parametrize("C01", [-0.15, -0.25])
def test_mooney_rivlin_with_a_negative_constant(C01):
    found = stability_limits(MooneyRivlin(0.5, C01, 1000.0))
    ways = {
        "uniaxial tension": lambda s: (s, s**-0.5, s**-0.5),
        "uniaxial compression": lambda s: (1.0 / s, s**0.5, s**0.5),
        "planar tension": lambda s: (s, 1.0, 1.0 / s),
    }
    expected = {}
    for name, way in ways.items():
        if determinant(0.5, C01, way(2.0)) < 0.0:
            root = brentq(lambda s, w=way: determinant(0.5, C01, w(s)), 1.0, 2.0)
            expected[name] = 1.0 / root if "compression" in name else root
    assert expected and found == pytest.approx(expected, rel=3e-3)


def test_units_do_not_matter():
    small, large = (Yeoh(0.5 * s, -0.2 * s, 0.01 * s, s) for s in (1.0, 1e6))
    assert stability_limits(small) == stability_limits(large) != {}
