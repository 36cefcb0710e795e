"""Notes on cases that are correct and may still surprise."""

import tomllib

import pytest

from tribox.app.build.case_notes import highest_pressure, notes_on
from tribox.app.case.case import Case


def case(text: str, friction: dict | None = None, **tables) -> Case:
    data = tomllib.loads(text)
    data["contact"][0]["friction"] |= friction or {}
    return Case.model_validate(data | tables)


def test_nothing_is_said_of_harmless_cases(block, film):
    assert notes_on(case(block)) == []
    assert notes_on(case(film)) == []


def test_a_loose_tolerance_is_told_and_a_usual_one_is_not(block):
    assert notes_on(case(block, solver={"tolerance": 1e-3})) == []
    [note] = notes_on(case(block, solver={"tolerance": 0.999}))
    assert note.startswith("solver.tolerance = 0.999: forces may be wrong by about as much")


def test_programs_that_the_run_leaves_before_their_end_are_noted(block):
    boundary, stage = tomllib.loads(block)["boundary"], [{"name": "press", "duration": 2.0}]
    boundary[1]["displacement"]["x"] = [["0 s", "0 mm"], ["10 s", "1 mm"]]
    boundary[1]["displacement"]["y"] = [["1 s", "-1 mm"], ["10 s", "-1 mm"]]  # level
    [note] = notes_on(case(block, boundary=boundary, stage=stage))
    assert note == (
        "boundary.1.displacement.x: goes on to 0.001 at 10 s, but the stages end at 2 s, "
        "where it is 0.0002"
    )
    assert notes_on(case(block, boundary=boundary, stage=[stage[0] | {"duration": 10.0}])) == []


def of_two_answers(notes: list[str]) -> list[str]:
    """The notes on steps that the law alone would answer in two ways."""
    return [note for note in notes if "stick and slip can coexist" in note]


def test_weakening_that_is_steeper_than_the_layer(film):
    # p (mu_s - mu_d) B against G/height = 1.844 MPa / 0.1 mm
    limit = 1.844e6 / 1e-4 / (0.5e6 * 0.02)
    assert notes_on(case(film, {"B": 0.99 * limit})) == []
    [note] = notes_on(case(film, {"B": 1.01 * limit}))
    assert "steeper than the upper block's shear stiffness" in note


def test_a_dynamic_coefficient_without_a_rate_has_no_effect(film):
    [note] = notes_on(case(film, {"B": 0.0}))
    assert "mu_d = 0.1 has no effect while B = 0" in note


def test_tension_wet_contacts_and_thick_films_are_noted(film):
    boundary = tomllib.loads(film)["boundary"]
    boundary[1]["platen"]["pressure"] = "-1 Pa"
    [note] = notes_on(case(film, boundary=boundary))
    assert note.startswith("boundary.1.platen.pressure: falls to -1 Pa")
    boundary = [*tomllib.loads(film)["boundary"], {"surface": "elastomer_contact"}]
    boundary[-1]["pressure"] = "1 bar"
    [note] = notes_on(case(film, boundary=boundary))
    assert "pressure: acts on elastomer_contact where it touches too" in note
    boundary[-1]["surface"] = "elastomer_left"
    assert notes_on(case(film, boundary=boundary)) == []
    data = tomllib.loads(film)
    data["contact"][0]["film"]["thickness"] = "100 mm"
    assert any("thin films" in note for note in notes_on(Case.model_validate(data)))


def test_a_modulus_without_its_unit_is_noted(block):
    bodies = tomllib.loads(block)["bodies"]
    soft = {"material": "neo-hookean", "E": 3, "nu": 0.49}
    [note] = notes_on(case(block, bodies=bodies | {"elastomer": soft}))
    assert note.startswith("bodies.elastomer: a shear modulus of 1.01 Pa is below that of gels")
    assert notes_on(case(block, bodies=bodies | {"elastomer": soft | {"E": "3 kPa"}})) == []


def test_weakening_that_is_too_steep_for_the_pressure(film):
    # Sufficient: (1 - alpha) K_T > (1 - alpha) p (mu_s - mu_d) B, here 1e12 > 0.5e6 0.02 B.
    limit = 1e12 / (0.5e6 * 0.02)
    assert of_two_answers(notes_on(case(film, {"B": 0.9 * limit}))) == []
    [note] = of_two_answers(notes_on(case(film, {"B": 1.1 * limit})))
    assert note.startswith("contact.0: ") and "\n" not in note


def test_weakening_is_judged_at_the_highest_pressure(film):
    boundary = tomllib.loads(film)["boundary"]
    boundary[1]["platen"]["pressure"] = [["0 s", "0 Pa"], ["1 s", "2 MPa"], ["2 s", "1 MPa"]]
    steep = {"B": 0.4e8}
    assert highest_pressure(case(film, boundary=boundary)) == 2e6
    assert of_two_answers(notes_on(case(film, steep))) == []
    assert len(of_two_answers(notes_on(case(film, steep, boundary=boundary)))) == 1


def test_threshold_speed_below_all_that_is_resolved(film):
    data = tomllib.loads(film)
    for key in ("V_star", "V_star_at"):
        del data["contact"][0]["friction"][key]
    data["contact"][0]["friction"]["gamma"] = "4e-25 N/s"
    [note] = notes_on(Case.model_validate(data))
    # sqrt(4e-25 x 250e-9 / (0.8 x 30e-9)) = 2.0e-12 m/s
    assert note.startswith("contact.0: ") and "V* = 2e-12 m/s" in note


@pytest.mark.parametrize("rate_dependent", [True, False])
def test_speeds_count_only_where_rates_do(film, rate_dependent):
    data = tomllib.loads(film)
    friction = data["contact"][0]["friction"]
    del friction["V_star"], friction["V_star_at"]
    friction["gamma"] = "4e-25 N/s"
    data["stage"][1]["rate_dependent"] = rate_dependent
    assert len(notes_on(Case.model_validate(data))) == rate_dependent


def test_bodies_that_come_to_rest_pass_every_threshold_speed(film):
    slow = {"V_star": "0.01 um/s", "V_star_at": "10 nm"}
    stages = tomllib.loads(film)["stage"]
    [note] = notes_on(case(film, slow))
    assert "below every speed" in note
    hold = {"name": "hold", "duration": "1 s", "steps": 2}
    assert notes_on(case(film, slow, stage=[*stages, hold])) == []
    [note] = notes_on(case(film, slow, stage=[*stages, hold | {"rate_dependent": False}]))
    assert "below every speed" in note


def test_a_stop_with_the_film_fraction_of_the_step_before_is_told(film):
    stages = tomllib.loads(film)["stage"]
    hold = {"name": "hold", "duration": "1 s", "steps": 2}
    assert notes_on(case(film, {"switch": "lagged"})) == []
    assert notes_on(case(film, stage=[*stages, hold])) == []
    [note] = notes_on(case(film, {"switch": "lagged"}, stage=[*stages, hold]))
    # 0.8 Pa s/(30 nm 1e12 Pa/m)
    assert 'switch = "lagged"' in note and "comes to rest" in note and "= 2.7e-05 s" in note


def test_what_the_law_takes_by_itself_is_told_where_it_matters(film):
    """The fixture gives alpha as a number, and the preset's viscosity: nothing to tell of."""
    data = tomllib.loads(film)
    friction = data["contact"][0]["friction"]
    del friction["alpha"]
    assert notes_on(Case.model_validate(data)) == []
    data["contact"][0]["film"]["thickness"] = [["0 MPa", "30 nm"], ["1 MPa", "10 nm"]]
    [note] = notes_on(Case.model_validate(data))
    assert note.startswith("contact.0: the table of alpha has no row")
    assert "0.5179 at D = 2e-08 m (interpolated)" in note
    data["contact"][0]["film"]["thickness"] = "30 nm"
    friction["eta_b"] = "0.4 Pa*s"
    [note] = notes_on(Case.model_validate(data))
    assert note.startswith("contact.0: V_star is given directly and does not move with eta_b")
    del friction["preset"]
    friction |= {"law": "friction-map", "alpha": 0.5, "D_max": "250 nm"}
    assert notes_on(Case.model_validate(data)) == []
