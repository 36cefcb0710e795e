"""The section for a case file holds live keys only where the data determine them."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from tribox.app.errors import InputError
from tribox.app.fit.calibration import Calibration
from tribox.app.fit.data import TribometerData
from tribox.app.fit.model import FitResult, coordinates, friction
from tribox.app.fit.run import friction_section, run_fit
from tribox.app.fit.setup import fit_setup
from tribox.app.friction_map.setup import validated_contact
from tribox.app.results import read

ROOT = Path(__file__).parents[3]
SLOW = ROOT / "examples" / "tribometer" / "first-day.csv"
SYNTHETIC = ROOT / "cases" / "data" / "tribometer-synthetic.csv"


def section(data: Path, *fixed: str, parameters: str | None = None) -> tuple[str, FitResult]:
    setup = fit_setup(data, parameters, fixed, [])
    chosen = coordinates(setup.names, setup.data, setup.base)
    result = Calibration(setup.data, setup.base, chosen, setup.starts).run()
    return friction_section(setup, result, data), result


def live(text: str) -> dict:
    return tomllib.loads(text)["contact"]["friction"]


def uncommented(text: str) -> str:
    lines = text.split("[contact.friction]\n")[1].splitlines()
    return "[contact.friction]\n" + "\n".join(line.removeprefix("# ") for line in lines)


def contact_with(friction: dict):
    film = {"thickness": "30 nm"}
    return validated_contact({"slave": "a", "master": "b", "film": film, "friction": friction})


def test_what_is_not_determined_is_a_comment():
    text, result = section(SLOW)
    assert {e.coordinate.name for e in result.estimates if e.warning} == {
        "mu_s", "alpha", "V_star", "eta_b",
    }  # fmt: skip
    assert {"mu_s", "alpha", "V_star", "V_star_at", "eta_b"}.isdisjoint(live(text))
    assert "\n# V_star at 30 nm = " in text  # a speed says little without its film
    assert live(text)["K_T"] == "1e+12 Pa/m"  # assumed, and said to be
    for key in ("mu_s", "alpha", "V_star", "V_star_at", "eta_b"):
        assert f"\n# {key} = " in text
    # The case does not run on it, and names what it lacks.
    with pytest.raises(InputError, match=r"mu_s"):
        contact_with(live(text))
    # Nothing but the marks keeps it from being the law that was found.
    found = contact_with(live(uncommented(text))).friction.parameters()
    assert found.eta_b == pytest.approx(result.parameters.eta_b, rel=1e-5)
    assert found.V_star == pytest.approx(result.parameters.V_star, rel=1e-5)


def test_a_threshold_speed_that_rests_on_one_row_is_a_comment(tmp_path):
    lines = ["thickness [nm],velocity [mm/s],pressure [MPa],traction [kPa]"]
    for speed in (0.55 * 3.0 ** np.arange(-5.0, 4.0)).tolist():
        # The asperities' share is one below V*, none above, and .3 at the row in between.
        share = 1.0 if speed < 0.5 else 0.3 * (speed < 1.0)
        lines += [f"0,{speed!r},3,300", f"10,{speed!r},3,{240 * share + 0.05e3 * speed!r}"]
    (tmp_path / "data.csv").write_text("\n".join(lines), encoding="utf-8")
    text, result = section(tmp_path / "data.csv", parameters="mu_s,eta_b,alpha,V_star")
    assert {e.coordinate.name for e in result.estimates if e.warning} == {"V_star"}
    assert {"V_star", "V_star_at"}.isdisjoint(live(text)) and "alpha" in live(text)
    assert re.search(r"\n# V_star = .*# not determined: the case needs a value of yours\n", text)


def test_a_preset_does_not_fill_the_gap():
    text, _ = section(SLOW, "preset=paper-printed")
    assert "preset" not in live(text) and "eta_b" not in live(text)
    assert live(text)["reentry"] == live(text)["flow_rule"] == "literal"


def test_what_is_fixed_in_its_place_is_live():
    fixed = ("mu_s=0.1", "eta_b=0.5 Pa*s", "V_star=0.8 mm/s", "V_star_at=10 nm")
    text, result = section(SLOW, *fixed)
    assert result.warnings == ()
    friction = contact_with(live(text)).friction
    assert (friction.mu_s, friction.eta_b, friction.V_star) == (0.1, 0.5, 0.8e-3)
    low, high = result.estimates[0].low, result.estimates[0].high
    assert low < friction.alpha < high and abs(friction.alpha - 0.8) < 0.01


def test_of_a_table_only_the_rows_that_are_open_are_comments(monkeypatch):
    monkeypatch.setattr("tribox.app.fit.model.BROAD", np.log(1.05))
    fixed = ("mu_d=0.1", "A_d=2 um", "B=3e5 1/m", "V_star=0.8 mm/s", "V_star_at=10 nm")
    text, result = section(SYNTHETIC, *fixed)
    open_names = {e.coordinate.name for e in result.estimates if e.warning}
    assert "alpha at 10 nm" in open_names and "alpha at 30 nm" not in open_names
    films = [film for film, _ in live(text)["alpha"]]
    assert films == ["3e-08 m", "1e-07 m"]
    assert '\n    # ["1e-08 m", ' in text
    assert len(contact_with(live(text)).friction.alpha) == 2


def test_a_missing_weakening_says_what_the_case_takes():
    setup = fit_setup(SYNTHETIC, "mu_s,mu_d,A_d,B", ["alpha=0.8"], [])
    data = _picked(setup.data, np.flatnonzero(setup.data.slip < 1e-6))
    # Slips below A_d show no weakening at all.
    data = TribometerData(
        data.thickness, data.velocity, data.pressure, friction(setup.base, data),
        data.slip, data.weight, data.observed,
    )  # fmt: skip
    result = Calibration(data, setup.base, coordinates(setup.names, data, setup.base)).run()
    text = friction_section(setup, result, SYNTHETIC)
    assert "B" not in live(text)
    assert "without it the case takes B = 0 1/m" in text


@pytest.mark.parametrize("law", ["stribeck", "coulomb"])
def test_a_case_runs_on_the_section_as_it_stands(law, tmp_path, film, tribox):
    data = ROOT / "cases" / "data" / "stribeck-synthetic.csv"
    fit = tmp_path / "fit"
    result = run_fit(data, None, [], [], fit, False, law, ["time", "temperature"])
    case = tmp_path / "case.toml"
    bare = re.sub(r"\[contact\.film\].*?(?=\[\[boundary)", "", film, count=1, flags=re.S)
    case.write_text(bare + (fit / "friction.toml").read_text(encoding="utf-8"), encoding="utf-8")
    assert tribox("run", str(case), "--out", str(tmp_path / "out")).returncode == 0
    for end in read(tmp_path / "out").load_steps.itertuples():
        if end.stage != "slide":
            continue
        if law == "coulomb":
            expected = result.parameters.mu
        else:
            mu, _ = result.parameters.coefficient(np.array([abs(end.velocity)]))
            expected = float(mu[0]) + result.parameters.viscous * abs(end.velocity) / 0.5e6
        assert end.friction_coefficient == pytest.approx(expected, rel=2e-3)


def _picked(data: TribometerData, rows: np.ndarray) -> TribometerData:
    arrays = (data.thickness, data.velocity, data.pressure, data.traction, data.slip, data.weight)
    return TribometerData(*(a[rows] for a in arrays), data.observed)
