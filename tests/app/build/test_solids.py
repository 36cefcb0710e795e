"""Materials of a case as energies, and what is said of them before a run."""

import pytest
from pydantic import TypeAdapter

from tribox.app.build.solids import notes_on_materials
from tribox.app.case.bodies import Body
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import (
    Backstress,
    JohnsonCook,
    Linear,
    Perzyna,
    Swift,
    Table,
    Voce,
)
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean, Ogden, Yeoh
from tribox.forms.bodies.softening import Mullins
from tribox.forms.bodies.viscous_points import Branch, Viscoelastic

BODY = TypeAdapter(Body)


def made(**keys):
    return BODY.validate_python(keys).material_of()


def test_elastomers():
    assert made(material="neo-hookean", G="1 MPa", K=2e9) == NeoHookean(1e6, 2e9)
    assert made(material="hencky", G="1 MPa", K=2e9) == Hencky(1e6, 2e9)
    assert made(material="mooney-rivlin", C10=2, C01=1, K=9) == MooneyRivlin(2.0, 1.0, 9.0)
    assert made(material="yeoh", C10="1 kPa", C30=2, K=9) == Yeoh(1e3, 0.0, 2.0, 9.0)
    ogden = made(material="ogden", mu=["1 MPa", "-2 kPa"], alpha=[1.3, -2], K="1 GPa")
    assert ogden == Ogden((1e6, -2e3), (1.3, -2.0), 1e9)
    assert ogden.shear_modulus == pytest.approx(0.5 * (1.3e6 + 4e3))


def test_softening_of_the_relaxed_energy():
    table = {"r": 2, "m": "1 kJ/m^3", "beta": 0.1}
    keys = {"material": "neo-hookean", "G": 8, "K": 99, "mullins": table}
    assert made(**keys) == Viscoelastic(NeoHookean(8.0, 99.0), (), Mullins(2.0, 1e3, 0.1))
    both = made(**keys, prony=[[0.25, 3]], moduli="instantaneous")
    assert both.elastic == NeoHookean(6.0, 99.0) and both.branches == (Branch(2.0, 3.0),)
    assert both.softening == Mullins(2.0, 1e3, 0.1) and both.shear_modulus == 8.0


@pytest.mark.parametrize(
    ("table", "law"),
    [
        ({"law": "linear", "yield_stress": "30 MPa"}, Linear(30e6)),
        (
            {"law": "voce", "yield_stress": 3, "saturation_stress": 5, "exponent": 9, "modulus": 1},
            Voce(3.0, 5.0, 9.0, 1.0),
        ),
        ({"law": "swift", "K": "1 kPa", "strain0": 0.01, "n": "20 %"}, Swift(1e3, 0.01, 0.2)),
        ({"law": "table", "points": [[0, 3], ["10 %", "1 kPa"]]}, Table([(0, 3), (0.1, 1e3)])),
    ],
)
def test_metals(table, law):
    metal = made(material="elastoplastic", E=2.6, nu=0.3, hardening=table)
    assert metal == ElastoPlastic(pytest.approx(1.0), pytest.approx(2.6 / 1.2), law)


@pytest.mark.parametrize(
    ("table", "rate"),
    [
        ({"law": "johnson-cook", "C": 0.02, "reference_rate": "1 1/ms"}, JohnsonCook(0.02, 1e3)),
        ({"law": "perzyna", "reference_rate": 40, "exponent": 0.2}, Perzyna(40.0, 0.2)),
    ],
)
def test_rates(table, rate):
    hardening = {"law": "linear", "yield_stress": 1}
    assert made(material="elastoplastic", G=1, K=2, hardening=hardening, rate=table).rate == rate


def test_backstress():
    hardening = {"law": "linear", "yield_stress": 1}
    keys = {"material": "elastoplastic", "G": "30 GPa", "K": "70 GPa", "hardening": hardening}
    assert made(**keys).kinematic == made(**keys, kinematic=[]).kinematic == ()
    metal = made(**keys, kinematic=[["2 GPa", "50"], ["30 MPa", 0]])
    assert metal.kinematic == (Backstress(2e9, 50.0), Backstress(3e7))


def test_an_unstable_energy_is_noted():
    good = BODY.validate_python({"material": "yeoh", "C10": 0.5, "K": 9})
    bad = BODY.validate_python({"material": "yeoh", "C10": 0.5, "C20": -0.2, "C30": 0.01, "K": 9})
    bodies = {"good": good, "bad": bad}
    [note] = notes_on_materials(bodies, {n: b.material_of() for n, b in bodies.items()})
    assert note.startswith("bodies.bad: the yeoh energy")
    assert "uniaxial tension beyond a stretch of 1.46, uniaxial compression beyond" in note
