"""Friction laws and films as a case file names them, run through."""

import csv
import re
from pathlib import Path

import pytest

from tribox.app.case.case import resolved_toml
from tribox.app.case.reading import check_case, load_case

TABLE = 'thickness = [["0 MPa", "60 nm"], ["1 MPa", "20 nm"]]'


def rows(directory: Path) -> list[dict[str, str]]:
    with (directory / "history.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_film_over_the_pressure_reads_back_and_runs(film, case_file, tribox, tmp_path):
    text = film.replace('thickness = "30 nm"', TABLE)
    path = case_file(text)
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


OPTIONS = {
    "limited": 'tau_0 = "2 kPa"\nzeta = 0.01',
    "thinning": 'critical_rate = "1e3 1/s"\nthinning_exponent = 0.5\neta_inf = "0.05 Pa*s"',
    "barus": 'barus = "1e-6 1/Pa"',
}


def test_the_options_of_the_film_tell_in_the_force(film, case_file, tribox, tmp_path):
    """At 2 mm/s the film carries all."""
    forces = {}
    for name, lines in {"newtonian": "", **OPTIONS}.items():
        text = film.replace('V_star_at = "10 nm"', f'V_star_at = "10 nm"\n{lines}')
        text = text.replace('velocities = ["1e-5 m/s", "2e-3 m/s"]', 'velocities = ["2e-3 m/s"]')
        done = tribox("run", case_file(text), "--out", tmp_path / name)
        assert done.returncode == 0, done.stderr
        last = rows(tmp_path / name)[-1]
        forces[name] = float(last["tangential_force"])
        area = float(last["contact_area"])
    assert forces["limited"] < forces["thinning"] < forces["newtonian"] < forces["barus"]
    # Newtonian: 0.8 * 2e-3/30e-9 = 53 kPa; limited: up to 2 kPa + 0.01 * 0.5 MPa = 7 kPa.
    assert forces["newtonian"] / area == pytest.approx(0.8 * 2e-3 / 30e-9, rel=0.1)
    assert forces["limited"] / area == pytest.approx(7e3, rel=0.1)


def test_stribeck_friction_falls_with_the_velocity(block, case_file, tribox, tmp_path):
    section = re.compile(r'^law = "coulomb"\nmu = 0.2\n', re.M)
    assert section.search(block)
    found = []
    for mu_d, V_s in ((0.1, "1e-9 m/s"), (0.1, "1e3 m/s")):
        law = f'law = "stribeck"\nmu_s = 0.2\nmu_d = {mu_d}\nV_s = "{V_s}"\n'
        path, out = case_file(section.sub(law, block)), tmp_path / V_s.split()[0]
        done = tribox("run", path, "--out", out)
        assert done.returncode == 0, done.stderr
        found.append(abs(float(rows(out)[-1]["friction_coefficient"])))
    assert found[0] == pytest.approx(0.1, rel=0.02)
    assert found[1] == pytest.approx(0.2, rel=0.02)


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
