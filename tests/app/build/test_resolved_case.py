"""A model's case holds every resolved default; written and read it gives the same numbers."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.conftest import BLOCK, FILM
from tribox.app.build.mesh import make_mesh
from tribox.app.build.model import Model, build_model
from tribox.app.case.case import Case, resolved_toml

STRIBECK = {"law": "stribeck", "mu_s": 0.3, "mu_d": 0.2, "V_s": 1e-3}


def built(text: str, friction: dict | None = None, **contact) -> Model:
    data = tomllib.loads(text)
    data["contact"][0] |= contact | ({"friction": friction} if friction else {})
    return build_model(Case.model_validate(data), MPI.COMM_SELF)


def test_every_default_of_mesh_and_bodies_is_resolved():
    model = built(BLOCK)
    [contact], [term] = model.case.contact, model.problem.contacts
    assert contact.quadrature_degree == 9
    assert contact.pressure == "averaged"
    assert contact.penalty is None and contact.penalty_factor == 30.0
    shear, length = 5e6 / (2.0 * 1.45), 1e-4  # of a facet
    assert term.penalty == pytest.approx(np.full(11, 300.0 * shear / length))
    assert contact.friction.K_T == pytest.approx(10.0 * shear / length)
    assert {body.formulation for body in model.case.bodies.values()} == {"q1-sri"}
    assert (model.case.solver.linear, model.case.solver.partition) == ("direct", "contact")
    assert built(BLOCK, STRIBECK).case.contact[0].friction.K_T == contact.friction.K_T


def oedometric(nu: float) -> float:
    """Modulus, Pa, of E = 5 MPa."""
    return 5e6 * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))


@pytest.mark.parametrize(
    ("pressure", "nu", "stiffness"),
    [
        ("averaged", 0.45, 300.0 * 5e6 / 2.9),
        ("averaged", 0.499, 3.0 * oedometric(0.499)),  # M/10 is more than 10 G
        ("pointwise", 0.45, 30.0 * oedometric(0.45)),
    ],
)
def test_the_penalty_follows_the_local_facets(pressure, nu, stiffness, monkeypatch):
    """K = factor · modulus/h with the length h of each facet, on a mesh drawn out along x."""

    def drawn_out(case, comm, *more):
        named = make_mesh(case, comm, *more)
        x = named.mesh.geometry.x[:, 0]
        x += 0.7 / 4e3 * np.sin(4e3 * x)
        return named

    monkeypatch.setattr("tribox.app.build.model.make_mesh", drawn_out)
    data = tomllib.loads(BLOCK)
    data["bodies"]["elastomer"]["nu"] = nu
    data["contact"][0]["pressure"] = pressure
    [term] = build_model(Case.model_validate(data), MPI.COMM_SELF).problem.contacts
    surface = term.surface
    averaged = pressure == "averaged"
    length = surface.vertices.length if averaged else surface.slave.facet_length
    assert length.max() > 2.0 * length.min()
    assert term.penalty * length == pytest.approx(np.full(len(length), stiffness))


def test_the_onset_pressure_is_that_of_the_law():
    model = built(FILM)
    # The platen's 0.5 MPa is less than the shear modulus, 2 (C10 + C01) = 1.844 MPa.
    assert model.film_onset == [pytest.approx(5e3)]
    assert model.case.contact[0].friction.film_onset_pressure == model.film_onset[0]
    assert model.problem.contacts[0].law.parameters.film_onset_pressure == model.film_onset[0]


def test_given_values_stay_as_they_are():
    friction = {"law": "coulomb", "mu": 0.2, "K_T": 1e11}
    [contact] = built(BLOCK, friction, penalty=1e13, quadrature_degree=5).case.contact
    assert (contact.penalty, contact.quadrature_degree, contact.friction.K_T) == (1e13, 5, 1e11)
    data = tomllib.loads(FILM)
    data["contact"][0]["friction"]["film_onset_pressure"] = 0.0
    assert build_model(Case.model_validate(data), MPI.COMM_SELF).film_onset == [0.0]


def test_a_sweep_is_left_out_of_what_is_solved():
    data = tomllib.loads(BLOCK)
    data["sweep"] = {"key": "contact.0.friction.mu", "values": [0.1, 0.3]}
    case = Case.model_validate(data)
    assert build_model(case, MPI.COMM_SELF).case.sweep is None
    assert "# penalty_factor = 30.0" in resolved_toml(case)
    [low, _] = [build_model(single, MPI.COMM_SELF).case for _, single in case.sweep_cases()]
    assert low.contact[0].friction.mu == 0.1 and low.contact[0].friction.K_T is not None
