"""Materials of a case as energies, and what is said of them before a run."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI
from pydantic import TypeAdapter

from benchmarks.verify import hertz
from tribox.app.build.contacts import contact_modulus, penalty_modulus
from tribox.app.build.model import build_model, notes_on_materials
from tribox.app.case.bodies import Body
from tribox.app.case.case import Case
from tribox.app.equilibrium.supports import bodies_of
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
from tribox.forms.bodies.materials import (
    Hencky,
    MooneyRivlin,
    NeoHookean,
    Ogden,
    Yeoh,
    oedometric_modulus,
    shear_and_bulk,
)
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


# -- Moduli of two bodies in contact, in closed form -----------------------------------------------

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
        expected = hertz.contact_modulus(*numbers)
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


@pytest.mark.parametrize("pressure", ["averaged", "pointwise"])
def test_penalty_of_a_body_that_flows_knows_nothing_of_its_bulk(pressure):
    """10 H with the hardness H = 3 σ_Y(0.2), below the elastic modulus that it had otherwise."""
    for bulk in (68e9, 680e9):
        metal = ElastoPlastic(26e9, bulk, Linear(30e6, 200e6))
        assert penalty_modulus(metal, pressure) == pytest.approx(2.1e9)
        assert penalty_modulus(metal.elastic, pressure) > 60e9


@pytest.mark.parametrize("pressure", ["averaged", "pointwise"])
@pytest.mark.parametrize("turned", [False, True])
def test_default_penalty_goes_by_the_softer_body(block, pressure, turned):
    """Whichever is the slave."""
    data = tomllib.loads(block)
    contact = data["contact"][0] | {"pressure": pressure}
    if turned:
        contact |= {"slave": contact["master"], "master": contact["slave"]}
    data["contact"] = [contact]
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    [term] = model.problem.contacts
    soft = min((s.material for s in model.problem.solids), key=oedometric_modulus)
    surface = term.surface
    length = surface.vertices.length if pressure == "averaged" else surface.slave.facet_length
    expected = 30.0 * penalty_modulus(soft, pressure) / length
    np.testing.assert_allclose(term.penalty, expected, rtol=1e-12)
    both = [s.material for s in model.problem.solids]
    assert term.modulus == pytest.approx(contact_modulus(*both), rel=1e-12)


def test_the_softer_body_is_the_one_that_shears_more_easily(block):
    """Nearly incompressible rubber on a plastic of 3 GPa, whose oedometric modulus is the lower."""
    data = tomllib.loads(block)
    data["bodies"]["elastomer"] = {"material": "neo-hookean", "E": 3e6, "nu": 0.4999}
    data["bodies"]["aluminium"] = {"material": "hencky", "E": 3e9, "nu": 0.3}
    data["contact"][0]["friction"] = {"law": "coulomb", "mu": 0.2}
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    rubber, plastic = (solid.material for solid in model.problem.solids)
    assert oedometric_modulus(rubber) > oedometric_modulus(plastic)
    [term] = model.problem.contacts
    assert bodies_of(model.problem, term).softer.material is rubber
    expected = 10.0 * rubber.shear_modulus / term.surface.facet_length
    assert model.case.contact[0].friction.K_T == pytest.approx(expected, rel=1e-12)
    assert model.notes == []
