"""The film's table: what goes together, and what is said where it does not."""

import numpy as np
import pytest

from tribox.app.case.contact import Contact
from tribox.app.case.film import Film

OIL = {
    "model": "reynolds", "sigma": "0.3 um", "oil": "1.5 g/m^2", "density": "900 kg/m^3",
    "share": "contact", "eta_b": "0.8 Pa*s",
}  # fmt: skip
COULOMB = {"law": "coulomb", "mu": 0.3}
MAP = {
    "law": "friction-map", "mu_s": 0.3, "K_T": 1e11, "eta_b": 0.8, "D_max": 1e-6, "beta": 1.0,
    "V_star": 1.0, "V_star_at": 1e-6,
}  # fmt: skip


def said(film, friction=COULOMB, **contact):
    table = Contact.model_validate(
        {"slave": "a", "master": "b", "film": film, "friction": friction, **contact}
    )
    return [f"{'.'.join(map(str, p.place))}: {p.reason}" for p in table.problems(())]


def without(*keys):
    return {key: value for key, value in OIL.items() if key not in keys}


def test_a_film_that_is_found_has_what_it_needs():
    assert said(OIL) == []
    assert said({**without("eta_b"), "share": "map"}, MAP) == []
    assert said({**without("density"), "oil": "flooded"}) == []


@pytest.mark.parametrize(
    ("film", "friction", "contact", "line"),
    [
        ({"sigma": 1e-7, "thickness": 1e-8}, MAP, {}, 'film.sigma: goes with model = "reynolds"'),
        ({**OIL, "thickness": 1e-8}, COULOMB, {}, "film.thickness: does not go with"),
        (without("share"), COULOMB, {}, 'film.share: missing; needed with model = "reynolds"'),
        (without("oil", "density"), COULOMB, {}, "film.oil: missing"),
        (without("density"), COULOMB, {}, "film.density: missing; needed with a mass of oil"),
        (without("eta_b"), COULOMB, {}, "film.eta_b: missing; the viscosity"),
        ({**OIL, "share": "map"}, COULOMB, {}, 'film.share: "map" needs law = "friction-map"'),
        (OIL, MAP, {}, 'film.share: law = "friction-map" shares the load by itself'),
        ({**OIL, "asperities": "table"}, COULOMB, {}, "film.table: missing"),
        ({**OIL, "sigma": 0.0}, COULOMB, {}, "film.h_max: missing; needed with sigma = 0"),
        ({**OIL, "gamma": 2.0}, COULOMB, {}, "film: gamma = 2.0: must be one of"),
        (OIL, COULOMB, {"pressure": "pointwise"}, 'pressure: film.model = "reynolds" needs'),
        (OIL, COULOMB, {"penalty": 1e10}, "penalty: does not go with film.model"),
        ({}, MAP, {}, "film.thickness: missing"),
    ],
)
def test_what_does_not_fit_is_said_in_one_line(film, friction, contact, line):
    lines = said(film, friction, **contact)
    assert any(one.startswith(line) for one in lines), lines


def test_oil_is_a_thickness_by_its_density():
    film = Film.model_validate(OIL).resolved()
    model = film.unknown(4e6)
    assert model.oil == pytest.approx(1.5e-3 / 900.0)
    assert model.reach == pytest.approx(3e-5)
    assert film.u_0 == pytest.approx(3e-7)
    pressure, _ = model.asperities.pressure(np.zeros(1))
    assert pressure[0] == pytest.approx(0.375 * 4e6)
    again = Film.model_validate(film.model_dump(mode="json", exclude_none=True))
    assert list(again.problems((), "coulomb")) == []
    assert again == film
