"""Moduli of two bodies in contact, in closed form."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.build.contacts import contact_modulus, penalty_modulus
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.equilibrium.supports import bodies_of
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Linear
from tribox.forms.bodies.materials import Hencky, NeoHookean, oedometric_modulus, shear_and_bulk
from tribox.forms.closed_forms import hertz

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
