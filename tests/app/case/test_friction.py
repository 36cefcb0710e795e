"""Friction laws and films as a case file names them, run through."""

import csv
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tribox.app.case.case import Case, resolved_toml
from tribox.app.case.contact import Contact
from tribox.app.case.film import Film
from tribox.app.case.reading import check_case, load_case

TABLE = 'thickness = [["0 MPa", "60 nm"], ["1 MPa", "20 nm"]]'


def rows(directory: Path) -> list[dict[str, str]]:
    with (directory / "history.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_film_over_the_pressure_reads_back_and_runs(film, case_file, tribox, tmp_path):
    path = case_file(film.replace('thickness = "30 nm"', TABLE))
    case = load_case(path)
    layer = case.contact[0].film
    assert layer.thickness == ((0.0, 60e-9), (1e6, 20e-9)) and layer.thicknesses == (60e-9, 20e-9)
    assert layer.at(0.5e6) == pytest.approx(40e-9)
    assert case.film_conductance == pytest.approx(0.8 / 20e-9)
    assert load_case(case_file(resolved_toml(case), "again.toml")) == case
    done = tribox("run", path, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    last = rows(tmp_path / "out")[-1]
    # The mean pressure is 0.5 MPa; D is its mean weighted with the pressure, which is not even.
    assert 20e-9 < float(last["film_thickness"]) < 42e-9
    pressure = float(last["normal_force"]) / float(last["contact_area"])
    assert float(last["film_thickness"]) == pytest.approx(layer.at(pressure), rel=0.1)


MISTAKES = {
    "pressure falls": ([TABLE.replace("1 MPa", "0 MPa")], "the pressure must increase from row"),
    "negative": ([TABLE.replace("20 nm", "-20 nm")], 'thickness.1.1 = "-20 nm": must be >= 0 m'),
    "zeta alone": (['thickness = "30 nm"', "zeta = 0.1"], "zeta = 0.1: must be 0 without tau_0"),
    "exponent": (['thickness = "30 nm"', 'critical_rate = "1 1/s"'], "thinning_exponent: missing"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_line(name, film, case_file):
    (thickness, *more), said = MISTAKES[name]
    text = film.replace('thickness = "30 nm"', thickness)
    text = text.replace('V_star_at = "10 nm"', "\n".join(['V_star_at = "10 nm"', *more]))
    [line] = check_case(case_file(text))
    assert said in line and "\n" not in line


# -- The film's table: what goes together, and what is said where it does not ----------------------

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


# -- The [[probe]] tables: what goes together, and what is said where it does not ------------------

PROBES = """
[[probe]]
name = "one"
point = ["1 mm", "0.1 mm"]
[[probe]]
name = "some"
line = { from = ["1 mm", "0.1 mm"], to = [1e-3, 3e-4], points = 3 }
[[probe]]
name = "all"
body = "elastomer"
[[probe]]
name = "along"
contact = "elastomer_contact-aluminium_contact"
points = 7
[[probe]]
name = "shape"
surface = "top"
"""


def test_probes_are_read_and_written(block, case_file):
    case = load_case(case_file(block + PROBES))
    assert [probe.kind for probe in case.probe] == ["point", "line", "body", "contact", "surface"]
    assert case.probe[1].line.start == (1e-3, 1e-4)
    again = Case.model_validate(tomllib.loads(resolved_toml(case)))
    assert again == case
    # Without probes a resolved case has room for them.
    plain = resolved_toml(load_case(case_file(block)))
    assert "probe" not in plain
    assert len(Case.model_validate(tomllib.loads(plain + PROBES)).probe) == 5


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ("0.point=[1e-3]", "probe.0.point = [0.001]: must have 2 coordinates in this mesh"),
        ("0.point=[1e-3, 0, 0]", "probe.0.point = [0.001, 0.0, 0.0]: must have 2 coordinates"),
        ('0.point=["1 s", 0]', 'probe.0.point.0 = "1 s": "s" has the wrong dimension'),
        ("0.at=vertex", 'probe.0.at = "vertex": must be "interpolated" or "node"'),
        ("0.body=rubber", 'probe.0.body = "rubber": no such body; there are elastomer, aluminium'),
        ("0.body=elastomr", 'no such body; did you mean "elastomer"?'),
        ("0.points=3", "probe.0.points = 3: goes with contact only"),
        ("0.contact=elastomer_contact-aluminium_contact", "found point, contact"),
        ("1.at=node", 'probe.1.at = "node": goes with point only'),
        ("1.line.points=1", "probe.1.line.points = 1: must be at least 2"),
        ("1.line.to=[1e-3, 1e-4]", "probe.1.line.to = [0.001, 0.0001]: must differ from from"),
        ("1.line.from=[0]", "probe.1.line.from = [0.0]: must have 2 coordinates"),
        ("1.name=one", 'probe.1.name = "one": is what probe.0 is called already'),
        ("2.name=", 'probe.2.name = "": must not be empty'),
        ("3.contact=elastomer_contact-aluminium", 'did you mean "elastomer_contact-aluminium_con'),
        ("3.points=1", "probe.3.points = 1: must be at least 2"),
        ("3.bend=[0, 1]", "probe.3.bend: goes with surface only"),
        ("4.opposite=top", 'probe.4.opposite = "top": must differ from surface'),
        ("4.bend=[2, 1]", "probe.4.bend: must go from a smaller to a larger arc length"),
        ("4.straight=[[0, 2], [1, 3]]", "probe.4.straight: the second piece must begin behind"),
        ("4.body=elastomer", 'probe.4.body = "elastomer": does not go with surface'),
        ("4.point=[0, 0]", "give one of point, line, contact and surface, found point, surface"),
        ("3.body=elastomer", 'probe.3.body = "elastomer": does not go with contact'),
        ("3.pionts=3", 'unknown key "pionts" in probe.3; did you mean "points"?'),
    ],
)
def test_mistakes_are_told_by_their_keys(block, case_file, changes, line):
    problems = check_case(case_file(block + PROBES), [f"probe.{changes}"])
    assert len(problems) == 1
    assert line in problems[0]


def test_a_probe_must_follow_something(block, case_file):
    [problem] = check_case(case_file(block + '[[probe]]\nname = "nothing"\n'))
    assert problem.endswith("probe.0: follows nothing; give point, line, body, contact or surface")


def test_in_space_contacts_have_vertices_only_and_surfaces_no_line(case_file):
    from tests.app.conftest import BOXES

    text = BOXES + PROBES.replace('"0.1 mm"]', '"0.1 mm", 0]').replace("3e-4]", "3e-4, 0]")
    problems = check_case(case_file(text))
    assert len(problems) == 2
    assert "probe.3.points = 7: goes with meshes in the plane" in problems[0]
    assert 'probe.4.surface = "top": goes with meshes in the plane' in problems[1]
