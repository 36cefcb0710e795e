"""The friction map at material points, against closed forms and what the law promises."""

import csv
import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tribox import load_case
from tribox.app.case.case import Case
from tribox.app.errors import InputError
from tribox.app.friction_map import line_contact, run_map
from tribox.app.friction_map.line_contact import (
    Curve,
    LineContact,
    compute,
    draw,
    film_map,
    reached,
)
from tribox.app.friction_map.material_tests import Phase, compute_map, follow, slide_at_speeds
from tribox.app.friction_map.setup import law_notes, map_setup
from tribox.app.results.directory import check_free
from tribox.forms.closed_forms import effective_viscosity, threshold_speed
from tribox.forms.film.roughness import Exponential, RoughGap
from tribox.forms.friction.film_rheology import FilmRheology
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import Regime
from tribox.forms.friction.parameters import FrictionMapParameters, with_preset

CASES = Path(__file__).parents[3] / "cases"
OVER_SLIP = ("slip_weakening", "start_stop", "velocity_jump")
TABLES = ("friction_map", "load_map", *OVER_SLIP)
FILES = {*(f"{name}.csv" for name in TABLES), "summary.json", "figures"}
PICTURES = ("friction_map_thickness", "friction_map_load", "effective_viscosity", "stribeck")
FIGURES = {f"{name}.png" for name in (*PICTURES, *OVER_SLIP)}


def law(**changes):
    own = {"mu_s": 0.12, "mu_d": 0.10, "A_d": 1e-6, "B": 1e6, "K_T": 1e12}
    own |= {"V_star": 1e-3, "V_star_at": 10e-9} | changes
    return FrictionMap(FrictionMapParameters(**with_preset("friction-map", own)))


@pytest.fixture(scope="module")
def built_in():
    setup = map_setup(None)
    return setup, compute_map(setup)


def test_steady_sliding_takes_the_weakening_into_account():
    p = np.full(3, 3e6)
    steady = slide_at_speeds(law(), np.array([1e-5]), p, np.array([0.0, 30e-9, 250e-9]))
    assert steady.steady.all()
    assert steady.mu[0, :2] == pytest.approx(0.10, rel=1e-3)
    expected = [0.1 * 3e6, (1 - 0.9967) * 0.1 * 3e6 + 0.9967 * 0.8 * 1e-5 / 30e-9, 320e-7 / 1e-6]
    assert steady.traction[0] == pytest.approx(expected, rel=1e-3)
    assert list(steady.regime[0]) == [Regime.SLIP, Regime.MIXED, Regime.VISCOUS]


def test_a_point_that_still_sticks_is_not_called_steady():
    dry, speed = np.array([0.0]), np.array([1e-5])
    steady = slide_at_speeds(law(), speed, np.array([3e6]), dry, most_slip=1e-7, least_slip=1e-9)
    assert not steady.steady.any()


def test_programs_add_up_slip_and_time_and_book_the_work():
    phases = [
        Phase("go", 2.0, 40, 1e-6, 3e6, 0.0),
        Phase("rest", 1.0, 2, 0.0, 3e6, 0.0),
        Phase("back", 1.0, 20, -1e-6, 3e6, 0.0),
    ]
    track = follow(law(mu_d=0.12), phases, 1)
    assert track.time[-1] == pytest.approx(4.0)
    assert track.slip[-1, 0] == pytest.approx(1e-6)
    assert track.phase[39:43] == ("go", "rest", "rest", "back")
    # Rest keeps the elastic traction; the way back first takes 2 mu p/K_T to turn it around.
    limit = 0.12 * 3e6
    assert track.traction[41, 0] == pytest.approx(limit)
    assert track.traction[-1, 0] == pytest.approx(-limit)
    assert track.slip_path[-1, 0] == pytest.approx(2e-6 - 0.36e-6 + 1e-6 - 0.72e-6)
    work = float(np.sum(track.traction[:, 0] * np.diff(np.r_[0.0, track.slip[:, 0]])))
    stored = 0.5 * limit**2 / 1e12
    assert float(track.dissipated.sum()) == pytest.approx(work - stored, rel=1e-12)


def test_map_is_the_closed_form_outside_the_transition(built_in):
    setup, result = built_in
    assert setup.films == (0.0, 10e-9, 30e-9, 180e-9, 250e-9)
    for curve in (*result.by_film, *result.by_load):
        assert curve.steady.all()
        assert np.isfinite(curve.exact).sum() >= len(curve.speed) - 1
        assert curve.deviation < 1e-12


def test_map_shows_what_the_paper_claims(built_in):
    _, result = built_in
    dry, thin, middle, thick, fluid = result.by_film
    slow = 0
    eta = 0.8
    assert thin.traction[slow] / dry.traction[slow] == pytest.approx(1.0 - 0.039, rel=1e-3)
    assert thin.viscosity[slow] > middle.viscosity[slow] > thick.viscosity[slow] > eta
    for curve in (thin, middle, thick):
        assert curve.viscosity[-1] == pytest.approx(eta, rel=1e-12)
    assert fluid.viscosity == pytest.approx(eta, rel=1e-12)


def test_friction_is_proportional_to_the_load_below_the_threshold_only(built_in):
    setup, result = built_in
    first, last = result.by_load[0], result.by_load[-1]
    ratio = last.traction / first.traction
    assert ratio[0] == pytest.approx(setup.loads[-1] / setup.loads[0], rel=1e-3)
    assert ratio[-1] == pytest.approx(1.0, rel=1e-12)


def test_weakening_starts_at_the_static_and_ends_at_the_dynamic_coefficient(built_in):
    setup, result = built_in
    p, track = setup.parameters, result.weakening
    friction = track.traction[:, 0] / setup.pressure
    assert friction.max() == pytest.approx(p.mu_s, rel=1e-3)
    assert friction[-1] == pytest.approx(p.mu_d, abs=0.06 * (p.mu_s - p.mu_d))
    slipping = track.slip_path[:, 0] > 0.0
    expected = p.friction.coefficient(track.slip_path[slipping, 0])
    assert friction[slipping] == pytest.approx(expected, rel=1e-12)


def test_a_stop_ends_the_film_stress_and_keeps_the_friction(built_in):
    _, result = built_in
    rest = np.array([name == "rest" for name in result.start_stop.phase])
    traction = result.start_stop.traction[rest][-1]
    before = result.start_stop.traction[np.argmax(rest) - 1]
    assert traction[-1] == 0.0  # D_max: nothing but film
    assert 0.0 < traction[1] < before[1]
    assert traction[0] == pytest.approx(before[0], rel=1e-2)


def test_a_jump_over_the_threshold_leaves_the_film_alone(built_in):
    setup, result = built_in
    track = result.jump
    fast = [i for i, name in enumerate(track.phase) if name == "fast"]
    speed, D = track.speed[fast[0], 0], np.array(result.films)
    assert speed > threshold_speed(D[:-1], setup.parameters).max()
    assert track.alpha[fast] == pytest.approx(1.0)
    assert track.traction[fast[-1]] == pytest.approx(setup.parameters.eta_b * speed / D, rel=1e-12)
    assert (track.dissipated >= -1e-15).all()


def test_a_case_decides_films_pressure_and_parameters():
    override = "contact.0.friction.flow_rule=literal"
    setup = map_setup(CASES / "sfa.toml", [override])
    assert setup.films == (0.0, 10e-9, 30e-9, 180e-9, 250e-9)
    assert (setup.pressure, setup.film) == (3e6, 10e-9)
    result = compute_map(setup)
    # The literal rule has the wrong order: a thicker film resists more.
    slow = [curve.viscosity[0] for curve in result.by_film[1:4]]
    assert slow[0] < slow[1] < slow[2]
    curve = result.by_film[3]
    exact = effective_viscosity(curve.speed, 180e-9, 3e6, curve.mu, setup.parameters)
    assert curve.viscosity[:20] == pytest.approx(exact[:20], rel=1e-9)


def test_the_printed_gamma_is_told(tmp_path):
    override = ["contact.0.friction.preset=paper-printed", "contact.0.friction.gamma=4e-25 N/s"]
    text = (CASES / "sfa.toml").read_text(encoding="utf-8")
    text = text.replace('V_star = "1 mm/s"\n', "").replace('V_star_at = "10 nm"\n', "")
    case = tmp_path / "printed.toml"
    case.write_text(text, encoding="utf-8")
    notes = law_notes(map_setup(case, override))
    assert any("below every speed of the map" in note for note in notes)


def test_a_given_gamma_replaces_the_assumed_threshold_speed_and_the_title_says_so():
    # As printed: V* lies eleven decades below the speeds of any machine, and all is the film's.
    keys = ["contact.0.friction.preset=paper-printed", "contact.0.friction.gamma=4e-25 N/s"]
    setup = map_setup(None, keys)
    assert setup.title == "built-in parameters with preset=paper-printed, gamma=4e-25 N/s"
    assert setup.parameters.V_star is None
    stars = threshold_speed(np.array([10e-9, 30e-9, 180e-9]), setup.parameters)
    assert stars == pytest.approx([3.5e-12, 2.0e-12, 8.3e-13], rel=0.02)
    viscosity = [c.viscosity for c in compute_map(setup).by_film if c.film > 0.0]
    assert np.concatenate(viscosity) == pytest.approx(0.8, rel=1e-9)
    with pytest.raises(InputError, match="either V_star"):
        map_setup(None, [*keys, "contact.0.friction.V_star=1 mm/s"])


def test_files_and_the_rules_of_results_directories(tmp_path):
    directory = tmp_path / "map"
    assert run_map(None, [], directory, False) == directory
    assert {path.name for path in directory.iterdir()} == FILES
    assert {path.name for path in (directory / "figures").iterdir()} == FIGURES
    summary = json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    assert summary["largest_deviation_from_closed_form"] < 1e-12
    assert summary["points_not_steady"] == 0
    with (directory / "friction_map.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 5 * 57
    slow = next(row for row in rows if row["thickness [m]"] == "1e-08")
    assert float(slow["effective_viscosity [Pa*s]"]) == pytest.approx(2.883e5, rel=1e-3)
    with pytest.raises(InputError, match="--force"):
        run_map(None, [], directory, False)
    (directory / "case.toml").write_text("old", encoding="utf-8")
    check_free(directory, force=True)
    (directory / "notes.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"notes\.txt"):
        run_map(None, [], directory, True)


@pytest.mark.parametrize(
    ("case", "overrides", "words"),
    [
        ("block-slide.toml", [], ["block-slide.toml", "coulomb", "friction-map"]),
        (None, ["contact.0.friction.mu_s=-1"], ["contact.0.friction.mu_s", ">= 0"]),
        (None, ["contact.0.friction.mu=0.1"], ["contact.0", '"mu" in friction']),
        (None, ["stage.0.duration=1 s"], ["without a case", "contact.0.friction"]),
        (None, ["nonsense"], ["nonsense"]),
        ("no-such.toml", [], ["no such file"]),
    ],
)
def test_wrong_input_is_one_line(tmp_path, case, overrides, words):
    with pytest.raises(InputError) as caught:
        run_map(CASES / case if case else None, overrides, tmp_path / "out", False)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
    assert not (tmp_path / "out").exists()


def test_a_map_tells_what_the_law_takes_by_itself():
    """Built in, D = 10, 30, 180 and 250 nm have rows, or need none; 60 nm has none."""
    assert len(law_notes(map_setup(None))) == 1  # that there is no case
    changed = ["contact.0.film.thickness=60 nm", "contact.0.friction.eta_b=1.6 Pa*s"]
    notes = law_notes(map_setup(None, changed))
    assert any("0.9973 at D = 6e-08 m (interpolated)" in note for note in notes)
    assert any("V_star is given directly" in note for note in notes)


# -- films that are found --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def soft():
    """The line contact of the shipped case, with few speeds."""
    setup = film_map(load_case(CASES / "film" / "soft-line.toml"))
    return replace(setup, loads=setup.loads[1:2], speeds=(1e-5, 1e-4, 1e-3, 1e-2))


def line(modulus, force, rough, oil):
    """A line contact of 10 mm radius; its asperities have the modulus of the bodies."""
    none, dry = np.zeros(0), Exponential(0.375 * modulus, rough.sigma)
    return LineContact(0.01, modulus, 0.3, none, none, rough, dry, oil).on(force)


def test_a_hard_contact_whose_oil_thickens_has_the_film_of_dowsons_regressions():
    """Least film of D. Dowson & G. Higginson, middle one of D. Dowson & S. Toyoda; a p is 3.5."""
    modulus, force, speed, eta, barus = 115.4e9, 3e4, 1.0, 0.04, 1e-8
    U, G, W = (x / (2e-2 * modulus) for x in (0.5 * eta * speed, 4e-2 * barus * modulus**2, force))
    least, middle = (
        0.01 * c * U**u * G**g * W**w
        for c, u, g, w in ((2.65, 0.7, 0.54, -0.13), (3.06, 0.69, 0.56, -0.1))
    )
    contact = line(
        modulus, force, RoughGap(least / 12.0, None), FilmRheology(eta_b=eta, barus=barus)
    )
    at, before = contact.dry(force), 1e-6
    for now in np.geomspace(1e-6, speed, 20):
        at, before = reached(contact, force, np.inf, (before, now), at), now
    assert at.film[at.pressure > 0.01 * at.pressure.max()].min() == pytest.approx(least, rel=0.1)
    assert np.interp(0.0, contact.place, at.film) == pytest.approx(middle, rel=0.1)
    assert at.dry < 0.01 and barus * at.pressure.max() > 3.0


def test_a_smooth_soft_contact_has_the_film_of_the_half_plane():
    """Three values of g = W'/√U, with the films h W'/(U R) that others computed."""
    modulus, radius, eta, load = 1e6, 0.01, 0.1, 1e-2
    force = load * 2.0 * modulus * radius
    contact = line(modulus, force, RoughGap(1e-6), FilmRheology(eta_b=eta))
    at, before = contact.dry(force), 1e-8
    for g, least, middle in ((10.07, 20.5, 26.1), (5.589, 13.43, 17.26), (3.108, 9.03, 11.25)):
        speed = 4.0 * (load / g) ** 2 * modulus * radius / eta
        at = reached(contact, force, np.inf, (before, speed), at)
        before, scale = speed, g**2 / (load * radius)
        pressed = at.pressure > 1e-4 * at.pressure.max()
        assert at.film[pressed].min() * scale == pytest.approx(least, rel=3e-3)
        assert np.interp(0.0, contact.place, at.film) * scale == pytest.approx(middle, rel=3e-3)
        assert at.dry < 1e-6


def test_a_stribeck_curve_is_the_same_up_and_down(soft):
    load = soft.loads[0]
    contact, speeds = soft.contact.on(load), np.geomspace(1e-9, 1.0, 10)
    at, up = contact.dry(load), {}
    assert at.friction == pytest.approx(soft.contact.mu, rel=1e-12)
    before = 0.1 * speeds[0]
    for speed in speeds:
        at = up[speed] = reached(contact, load, np.inf, (before, speed), at)
        before = speed
    share = np.array([one.dry for one in up.values()])
    assert share[0] == pytest.approx(1.0, rel=1e-4)
    assert np.all(np.diff(share) <= 0.0) and share[-1] < 1e-6
    assert up[speeds[0]].friction == pytest.approx(soft.contact.mu, rel=1e-4)
    for speed in speeds[-2::-1]:
        at = reached(contact, load, np.inf, (before, speed), at)
        assert at.friction == pytest.approx(up[speed].friction, rel=1e-8)
        before = speed


def test_a_film_is_as_thick_as_the_oil_that_there_is(soft):
    curves = compute(replace(soft, oils=(8.1e-4, np.inf)))  # 0.9 um
    flooded, short = (np.array(curve.rows) for curve in curves)
    assert not any(curve.failed for curve in curves)
    assert np.allclose(short[:2, 4], flooded[:2, 4], rtol=1e-6)  # oil enough
    assert short[-2:, 6] == pytest.approx(0.9e-6, rel=5e-3)
    assert short[-2:, 9] == pytest.approx(1.0, rel=1e-3)
    assert np.all(flooded[:, 9] < 1.0)
    assert np.all(short[-2:, 4] > 1.5 * flooded[-2:, 4])


def test_a_case_with_a_film_that_is_found_is_mapped_as_a_line_contact(soft, tmp_path, monkeypatch):
    monkeypatch.setattr(line_contact, "film_map", lambda case: replace(soft, speeds=(1e-5, 1e-3)))
    case = CASES / "film" / "soft-line.toml"
    directory = run_map(case, [], tmp_path / "map", False)
    assert {path.name for path in (directory / "figures").iterdir()} == {"film_map.png"}
    with (directory / "film_map.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 2 * len(soft.oils)
    assert json.loads((directory / "summary.json").read_text())["points_not_found"] == 0
    check_free(directory, True)


def test_a_map_is_drawn_though_no_state_is_found_with_the_least_oil(soft, tmp_path):
    """Such a curve has no row, which the title of its panel took the pressure from."""
    load = soft.loads[0]
    row = (load, 1e5, 1e-4, np.inf, 0.1, 0.5, 1e-6, 1e-6, 3.0, 1.0, 5.0)
    curves = [Curve(load, np.inf, (row,), ()), Curve(load, soft.oils[0], (), soft.speeds)]
    draw(soft, curves, tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 0


def test_a_contact_behind_others_is_mapped(tmp_path):
    """Of a case whose first contact has no map, and of one without a contact."""
    text = (CASES / "sfa.toml").read_text()
    other = (
        '[[contact]]\nslave = "elastomer_left"\nmaster = "aluminium_right"\n'
        'friction = { law = "frictionless" }\n\n'
    )
    start = text.index("[[contact]]")
    path = tmp_path / "second.toml"
    second = text[:start] + other + text[start:]
    path.write_text(second.replace('"contact.0.film.thickness"', '"contact.1.film.thickness"'))
    assert map_setup(path).films == map_setup(CASES / "sfa.toml").films
    with pytest.raises(InputError, match=r'here is contact.0 "frictionless"'):
        map_setup(CASES / "block-compression.toml")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("film/slider", 'contact.0.master = "runner"'),
        ("film/squeeze", "takes a circle as tool"),
        ("forming/strip-draw-oil", "takes an elastic body with moduli of its own"),
    ],
)
def test_what_is_no_line_contact_is_not_mapped(name, words):
    with pytest.raises(InputError, match=words):
        run_map(CASES / f"{name}.toml", [], None, False)


@pytest.mark.parametrize(("moduli", "share"), [("instantaneous", 0.4), ("long-term", 1.0)])
def test_a_contact_that_stays_where_it_is_is_relaxed(moduli, share):
    """E* of a body with branches is that of its long-term modulus."""
    data = tomllib.loads((CASES / "film" / "soft-line.toml").read_text())
    shear, bulk = 1e6, 50e6
    rubber = {"material": "neo-hookean", "G": shear, "K": bulk}
    rubber |= {"prony": [[0.6, 0.01]], "moduli": moduli}
    setup = film_map(Case.model_validate(data | {"bodies": {"rubber": rubber}}))
    assert any("E* is that of its long-term G" in note for note in setup.notes)
    found = setup.contact.modulus
    G = share * shear
    young = 9.0 * bulk * G / (3.0 * bulk + G)
    assert found == pytest.approx(young / (1.0 - (young / (2.0 * G) - 1.0) ** 2), rel=1e-12)
