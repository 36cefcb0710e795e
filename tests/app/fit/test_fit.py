"""The fit recovers what data were made with, and names what they cannot tell."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from tribox.app.case import check_case, load_case
from tribox.app.errors import InputError
from tribox.app.fit.calibration import Calibration
from tribox.app.fit.data import TribometerData, read_data
from tribox.app.fit.material_data import read_material
from tribox.app.fit.model import RANGES, coordinates, friction
from tribox.app.fit.run import report, run_fit
from tribox.app.fit.setup import fit_setup
from tribox.forms.closed_forms import steady_traction
from tribox.forms.friction.coulomb import CoulombParameters
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.parameters import FrictionMapParameters, with_preset
from tribox.forms.friction.stribeck import StribeckParameters

ROOT = Path(__file__).parents[3]
SYNTHETIC = ROOT / "cases" / "data" / "tribometer-synthetic.csv"
STRIBECK = ROOT / "cases" / "data" / "stribeck-synthetic.csv"
OF_THE_MACHINE = ["time", "temperature [degC]"]
BEHIND_IT = {
    "mu_s": 0.13, "mu_d": 0.10, "A_d": 2e-6, "B": 3e5, "eta_b": 0.5, "V_star": 0.8e-3,
    "alpha at 10 nm": 0.2, "alpha at 30 nm": 0.8, "alpha at 100 nm": 0.97,
}  # fmt: skip


def law(**changes) -> FrictionMapParameters:
    own = {"mu_s": 0.1, "K_T": 1e12, "V_star": 1e-3, "V_star_at": 10e-9, "eta_b": 0.5}
    return FrictionMapParameters(**with_preset("friction-map", own | changes))


def rows(D, V, p=3e6, slip=np.nan, weight=1.0) -> TribometerData:
    D, V, p, slip, weight = np.broadcast_arrays(*map(np.asarray, (D, V, p, slip, weight)))
    D, V, p, slip, weight = (a.astype(float).ravel() for a in (D, V, p, slip, weight))
    return TribometerData(D, V, p, np.ones(len(D)), slip, weight, "traction")


def measured(truth: FrictionMapParameters, data: TribometerData, noise: float, seed: int):
    scatter = np.exp(noise * np.random.default_rng(seed).standard_normal(len(data)))
    return TribometerData(
        data.thickness, data.velocity, data.pressure, friction(truth, data) * scatter,
        data.slip, data.weight, data.observed,
    )  # fmt: skip


def fitted(data, base, *names, **starts):
    return Calibration(data, base, coordinates(names, data, base), starts).run()


def sliding(films=(0.0, 10e-9, 30e-9, 300e-9), speeds=10) -> TribometerData:
    D, V = np.meshgrid(films, np.geomspace(1e-6, 3e-2, speeds))
    return rows(D, V)


# -- the model ------------------------------------------------------------------------------------


@pytest.mark.parametrize("flow_rule", ["weighted", "literal"])
def test_steady_rows_are_the_closed_form(flow_rule):
    truth = law(flow_rule=flow_rule, mu_s=0.2, mu_d=0.1, B=1e6, transition_width=0.0)
    data = sliding()
    exact = steady_traction(data.velocity, data.thickness, data.pressure, 0.1, truth)
    assert friction(truth, data) == pytest.approx(exact, rel=1e-9)


def test_rows_over_slip_are_what_small_steps_of_the_law_give():
    truth = law(mu_s=0.2, mu_d=0.1, A_d=2e-6, B=5e5, alpha=0.6)
    film, V, steps, step = 30e-9, 1e-5, 400, 1e-7
    one, dt = FrictionMap(truth), 1e-7 / 1e-5
    state, traction = one.initial_state(1, 1), []
    for _ in range(steps):
        response = one.update(np.array([[step]]), dt, np.array([3e6]), np.array([film]), state)
        state = response.state
        traction.append(response.traction[0, 0])
    data = rows(film, V, slip=step * np.arange(1, steps + 1))
    assert friction(truth, data) == pytest.approx(np.array(traction), rel=1e-9)


# -- recovery -------------------------------------------------------------------------------------


def test_the_film_is_recovered_within_the_stated_intervals():
    """95 % intervals of 5 parameters in 6 noisy data sets: at most 5 of 30 may miss."""
    alpha = ((10e-9, 0.2), (30e-9, 0.8))
    truth = law(alpha=alpha)
    values = {"mu_s": 0.1, "eta_b": 0.5, "V_star": 1e-3, "alpha at 10 nm": 0.2}
    values["alpha at 30 nm"] = 0.8
    missed = 0
    for seed in range(6):
        data = measured(truth, sliding(), 0.05, seed)
        result = fitted(data, law(mu_s=0.3, eta_b=1.0), "mu_s", "alpha", "eta_b", "V_star")
        assert result.warnings == ()
        assert result.scatter == pytest.approx(0.05, rel=0.5)
        for estimate in result.estimates:
            name = estimate.coordinate.name
            missed += not estimate.low <= values[name] <= estimate.high
            assert estimate.low < estimate.value < estimate.high
            # V* is known to lie between two velocities, which are a factor of 3 apart here.
            far = 0.7 if name == "V_star" else 0.25
            assert estimate.value == pytest.approx(values[name], rel=far)
    assert missed <= 5


def test_exact_data_give_exact_parameters():
    data = measured(law(beta=0.3, mu_s=0.17), sliding(), 0.0, 0)
    result = fitted(data, law(beta=1.0), "mu_s", "beta", "eta_b")
    found = [e.value for e in result.estimates]
    assert found == pytest.approx([0.17, 0.3, 0.5], rel=1e-6)
    assert result.scatter < 1e-6


def test_data_without_scatter_do_not_settle_a_threshold_speed_by_round_off():
    """One row above V* and a free viscosity: any V* from there up fits as well."""
    truth = law(alpha=0.16, eta_b=5.0, V_star=1.0)
    data = measured(truth, rows(10e-9, 10.0 ** np.arange(-8.0, -1.0)), 0.0, 0)
    result = fitted(data, law(alpha=0.5), "mu_s", "alpha", "eta_b", "V_star")
    assert "V_star" in names_of(result)
    assert result.estimates[-1].high is None


def test_gamma_and_threshold_speed_say_the_same():
    gamma = 0.5 * 1e-6 * 10e-9 / 250e-9
    data = measured(law(alpha=((10e-9, 0.2), (30e-9, 0.8))), sliding(), 0.02, 3)
    base = law(alpha=((10e-9, 0.2), (30e-9, 0.8)))
    star = fitted(data, base, "V_star", "eta_b")
    other = fitted(data, law(V_star=None, V_star_at=None, gamma=1e-10, alpha=base.alpha),
                   "gamma", "eta_b")  # fmt: skip
    assert other.estimates[0].low < gamma < other.estimates[0].high
    eta = other.estimates[1].value
    ends = [eta * V**2 * 10 / 250 for V in (star.estimates[0].low, star.estimates[0].high)]
    assert [other.estimates[0].low, other.estimates[0].high] == pytest.approx(ends, rel=1e-6)


def test_a_wide_transition_gives_the_threshold_speed_a_slope():
    truth = law(alpha=0.5, transition_width=0.6)
    data = measured(truth, rows(10e-9, np.geomspace(1e-4, 1e-2, 40)), 0.02, 5)
    result = fitted(data, law(alpha=0.5, transition_width=0.6), "V_star")
    [star] = result.estimates
    assert "V_star" in result.slopes.names
    assert star.low < 1e-3 < star.high < 1.1 * star.low


def between_branches(truth: FrictionMapParameters, noise: float, seed: int) -> TribometerData:
    """Dry rows and rows with a film, of speeds that are a factor of 3 apart."""
    speeds = 0.55e-3 * 3.0 ** np.arange(-5.0, 4.0)
    D, V = np.meshgrid([0.0, 10e-9], speeds)
    return measured(truth, rows(D, V), noise, seed)


def test_a_row_between_both_branches_leaves_the_threshold_speed_between_its_neighbours():
    """How far V* is from it goes with the width of the transition, which no row tells."""
    data = between_branches(law(alpha=0.2, V_star=0.462e-3, transition_width=0.3), 0.01, 1)
    result = fitted(data, law(alpha=0.5), "mu_s", "alpha", "eta_b", "V_star")
    star = result.estimates[-1]
    assert star.low == pytest.approx(0.55e-3 / 3.0) and star.high == pytest.approx(0.55e-3 * 3.0)
    assert names_of(result) == {"V_star"}
    assert "one or two rows between both branches" in star.warning
    assert "transition_width = 0.03" in star.warning
    # A row on a branch leaves it between that row and the next, as ever.
    data = between_branches(law(alpha=0.2, V_star=0.8e-3), 0.01, 1)
    [*_, star] = fitted(data, law(alpha=0.5), "mu_s", "alpha", "eta_b", "V_star").estimates
    assert star.warning is None
    assert [star.low, star.high] == pytest.approx([0.55e-3 / 1.03, 1.65e-3 / 0.97])


def test_intervals_of_the_threshold_speed_hold_whatever_the_width_of_the_transition():
    """95 % intervals in 12 tables whose transition is up to .5 wide where .03 is assumed."""
    missed = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        speed = 0.55e-3 * 3.0 ** rng.uniform(-0.5, 0.5)
        truth = law(alpha=0.2, V_star=speed, transition_width=rng.uniform(0.03, 0.5))
        data = between_branches(truth, 0.03, seed)
        star = fitted(data, law(alpha=0.5), "mu_s", "alpha", "eta_b", "V_star").estimates[-1]
        missed += not (star.low or 0.0) <= speed <= (star.high or np.inf)
    assert missed <= 1


def test_weights_decide_between_rows_that_disagree():
    data = rows([0.0] * 4, 1e-5, weight=[1.0, 1.0, 1e6, 1e6])
    data = TribometerData(data.thickness, data.velocity, data.pressure,
                          np.array([0.1, 0.1, 0.2, 0.2]) * 3e6, data.slip, data.weight,
                          "traction")  # fmt: skip
    [mu] = fitted(data, law(), "mu_s").estimates
    assert mu.value == pytest.approx(0.2, rel=1e-4)


# -- identifiability ------------------------------------------------------------------------------


def names_of(result) -> set[str]:
    return {e.coordinate.name for e in result.estimates if e.warning}


def test_viscosity_is_named_where_no_row_has_a_film():
    data = measured(law(), rows(0.0, np.geomspace(1e-6, 1e-2, 8)), 0.02, 0)
    result = fitted(data, law(), "mu_s", "eta_b")
    assert names_of(result) == {"eta_b"}
    assert "cannot determine" in result.warnings[0]


def test_friction_and_film_fraction_are_named_where_only_their_product_shows():
    data = measured(law(alpha=0.4), rows(10e-9, np.geomspace(1e-8, 1e-6, 10)), 0.02, 0)
    result = fitted(data, law(alpha=0.5), "mu_s", "alpha")
    assert names_of(result) == {"mu_s", "alpha"}
    assert all(word in line for word, line in zip(["alpha", "mu_s"], result.warnings, strict=True))
    dry = measured(law(alpha=0.4), rows([0.0] * 3 + [10e-9] * 10, 1e-6), 0.02, 0)
    assert names_of(fitted(dry, law(alpha=0.5), "mu_s", "alpha")) == set()


@pytest.mark.parametrize("fast", [True, False])
def test_threshold_speed_is_named_where_all_rows_lie_on_one_side(fast):
    speeds = np.geomspace(2e-3, 1e-1, 10) if fast else np.geomspace(1e-8, 1e-5, 10)
    data = measured(law(alpha=0.3), rows(10e-9, speeds), 0.02, 0)
    result = fitted(data, law(alpha=0.3), "V_star")
    [star] = result.estimates
    assert names_of(result) == {"V_star"}
    assert (star.low is None) == fast
    assert (star.high is None) != fast


def test_what_hangs_on_an_open_threshold_speed_is_named():
    """The fastest row of a slow test may lie above V*: read so, it gives any viscosity."""
    data = measured(law(alpha=0.8), rows(30e-9, np.geomspace(1e-6, 3e-4, 6)), 0.02, 4)
    result = fitted(data, law(alpha=0.5), "mu_s", "alpha", "eta_b", "V_star")
    assert names_of(result) == {"mu_s", "alpha", "eta_b", "V_star"}
    eta = next(e for e in result.estimates if e.coordinate.key == "eta_b")
    assert eta.low > 2 * 0.5  # what the interval of one V* is worth
    assert "another V_star fits as well" in eta.warning
    assert all("; add " in line and "--fix" not in line for line in result.warnings)
    told = "\n".join(report(fit_setup(SYNTHETIC, None, [], []), result))
    assert told.count("--fix NAME=VALUE") == 1  # said once, for all of them


# -- files ----------------------------------------------------------------------------------------


def test_the_shipped_data_give_back_the_values_they_state(tmp_path, capsys, drawn_figures):
    result = run_fit(SYNTHETIC, None, [], [], tmp_path / "fit", False)
    assert {e.coordinate.name for e in result.estimates} == set(BEHIND_IT)
    assert result.warnings == ()
    numbers = json.loads((tmp_path / "fit" / "fit.json").read_text(encoding="utf-8"))
    for name, value in BEHIND_IT.items():
        one = numbers["parameters"][name]
        assert one["low"] <= value <= one["high"], name
        assert one["determined"]
    assert (tmp_path / "fit" / "figures" / "fit.png").stat().st_size > 20_000
    assert len((tmp_path / "fit" / "fit.csv").read_text().splitlines()) == numbers["rows"] + 1
    assert "assumed" in capsys.readouterr().out
    with pytest.raises(InputError, match="--force"):
        run_fit(SYNTHETIC, None, [], [], tmp_path / "fit", False)

    section = (tmp_path / "fit" / "friction.toml").read_text(encoding="utf-8")
    text = (ROOT / "cases" / "sfa.toml").read_text(encoding="utf-8")
    swapped = re.sub(
        r"\[contact\.friction\].*?(?=\[\[boundary)", section, text, count=1, flags=re.S
    )
    assert swapped != text
    case = tmp_path / "calibrated.toml"
    case.write_text(swapped, encoding="utf-8")
    case_of_tutorial = ROOT / "examples" / "tribometer" / "sliding.toml"
    appended = case_of_tutorial.read_text(encoding="utf-8") + section
    assert not check_case(write(tmp_path, appended, "fitted.toml"))
    parameters = load_case(case).contact[0].friction.parameters()
    assert parameters.eta_b == pytest.approx(result.parameters.eta_b, rel=1e-5)
    for given, found in zip(parameters.alpha, result.parameters.alpha, strict=True):
        assert given == pytest.approx(found, rel=1e-9)


def write(tmp_path, text, name="data.csv") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_units_loads_forces_and_viscosities_are_brought_to_one(tmp_path):
    tables = [
        "thickness [nm],velocity [mm/s],pressure [MPa],traction [kPa]\n10,2,3,300\n",
        "velocity [m/s], thickness [m], load [N], area [mm^2], force [mN]\n2e-3,1e-8,3,1,300\n",
        "thickness [nm],velocity [mm/s],pressure [MPa],friction_coefficient [%]\n10,2,3,10\n",
        "# note\n\nthickness [nm],velocity [mm/s],pressure [MPa],effective_viscosity [mPa*s]\n"
        "10,2,3,1500\n",
    ]
    for text in tables:
        data = read_data(write(tmp_path, text))
        found = [data.thickness, data.velocity, data.pressure, data.traction]
        assert np.array(found)[:, 0] == pytest.approx([1e-8, 2e-3, 3e6, 3e5], rel=1e-12)
        assert data.steady.all()
    constants = {"thickness": 1e-8, "velocity": 2e-3}
    data = read_data(write(tmp_path, "pressure [Pa],traction [Pa]\n3e6,3e5\n"), constants)
    assert (data.thickness[0], data.velocity[0]) == (1e-8, 2e-3)


# -- laws that ask for no film --------------------------------------------------------------------


def test_a_stribeck_curve_without_film_thickness_gives_back_what_is_behind_it(
    tmp_path, capsys, drawn_figures
):
    out = tmp_path / "fit"
    result = run_fit(STRIBECK, None, [], [], out, False, "stribeck", OF_THE_MACHINE)
    behind_it = {"mu_s": 0.15, "mu_d": 0.06, "V_s": 2e-3, "viscous": 8e4}
    assert {e.coordinate.name for e in result.estimates} == set(behind_it)
    assert result.warnings == () and result.scatter < 0.03
    for e in result.estimates:
        assert e.low is not None and e.high is not None
        assert e.low < behind_it[e.coordinate.name] < e.high < 1.3 * e.low
    assert (out / "figures" / "fit.png").stat().st_size > 20_000
    rows = (out / "fit.csv").read_text(encoding="utf-8").splitlines()
    assert rows[1].startswith(",1e-05,2000000.0,,")  # no thickness, no slip
    assert "delta" in capsys.readouterr().out  # assumed


@pytest.mark.parametrize("viscous", [0.0, 3e7])
def test_exact_stribeck_data_give_exact_parameters_also_over_slip(viscous):
    own = {"mu_s": 0.2, "mu_d": 0.08, "V_s": 3e-3, "delta": 1.7, "viscous": viscous}
    truth = StribeckParameters(**own, K_T=2e12)
    V = np.geomspace(1e-5, 1e-1, 16)
    data = measured(truth, rows([0.0], [*V, 1e-5, 1e-5], slip=[*V * np.nan, 2e-8, 6e-8]), 0.0, 1)
    exact = truth.coefficient(data.velocity)[0] * 3e6 + viscous * data.velocity
    assert data.traction[:16] == pytest.approx(exact[:16], rel=1e-9)
    assert data.traction[16:] == pytest.approx(2e12 * data.slip[16:] + viscous * 1e-5, rel=1e-9)
    names = [name for name in (*own, "K_T") if name != "viscous" or viscous]
    result = fitted(data, StribeckParameters(mu_s=0.1, mu_d=0.1, V_s=1.0, K_T=1e12), *names)
    assert result.warnings == ()
    for e in result.estimates:
        assert e.value == pytest.approx(getattr(truth, e.coordinate.key), rel=1e-5)


def test_of_coulomb_friction_the_mean_is_found_and_the_rise_over_slip():
    truth = CoulombParameters(mu=0.17, K_T=5e11)
    data = measured(truth, rows(0.0, [1e-3] * 12, slip=[*[np.nan] * 8, 2e-7, 4e-7, 5e-7, 8e-7]),
                    0.02, 3)  # fmt: skip
    result = fitted(data, CoulombParameters(mu=0.1, K_T=1e12), "mu", "K_T")
    for e, value in zip(result.estimates, (0.17, 5e11), strict=True):
        assert e.low < value < e.high and e.warning is None


def test_what_a_stribeck_curve_leaves_open_is_named():
    truth = StribeckParameters(mu_s=0.2, mu_d=0.08, V_s=3e-3, K_T=1e18)
    slow = measured(truth, rows(0.0, np.geomspace(1e-7, 1e-5, 8)), 0.01, 2)
    base = StribeckParameters(mu_s=0.1, mu_d=0.05, V_s=1.0, K_T=1e18)
    result = fitted(slow, base, "mu_s", "mu_d", "V_s", "viscous")
    assert {e.coordinate.name for e in result.estimates if e.warning} >= {"V_s", "viscous"}
    assert any("velocities over which the friction falls" in line for line in result.warnings)
    assert not any("A_d" in line or "D_min" in line for line in result.warnings)


def test_names_that_tribometers_write_are_understood_and_told(tmp_path, capsys):
    text = STRIBECK.read_text(encoding="utf-8")
    names = "time [s],velocity [mm/s],pressure [MPa],friction_coefficient"
    for other in (
        "t,Speed (mm/s),Contact pressure [MPa],COF",
        "t,SLIDING-SPEED [mm/s],pressure [MPa],mu",
    ):
        path = write(tmp_path, text.replace(names, other))
        data = read_data(path, ignored=["t", "temperature"], needs_film=False)
        assert (data.velocity[0], data.pressure[0]) == (1e-5, 2e6)
        assert data.observed == "friction_coefficient"
    run_fit(path, None, [], [], tmp_path / "fit", False, "stribeck", ["t", "temperature"])
    told = capsys.readouterr().out.splitlines()[0]
    assert told == ('note: read "SLIDING-SPEED [mm/s]" as velocity, "mu" as friction_coefficient')
    with pytest.raises(InputError, match=r'no such columns .*"distance'):
        read_data(write(tmp_path, text.replace("pressure", "distance")), needs_film=False)


def test_a_file_of_the_other_kind_of_test_is_told_apart(tmp_path):
    pull = "strain,stress [MPa]\n0.01,30\n0.02,40\n"
    with pytest.raises(InputError, match="strain, stress: read by tribox fit --material"):
        read_data(write(tmp_path, pull), needs_film=False)
    friction = "time [s],velocity [mm/s],friction_coefficient\n1,1,0.1\n2,2,0.1\n"
    with pytest.raises(InputError, match="friction_coefficient: read by tribox fit without --mat"):
        read_material(write(tmp_path, friction), {}, [], None, None)
    distance = "velocity [mm/s],distance,friction_coefficient\n1,1,0.1\n2,2,0.1\n"
    with pytest.raises(InputError) as error:
        read_data(write(tmp_path, distance), needs_film=False)
    assert "read by" not in str(error.value)


def test_steady_coefficients_need_no_pressure_where_the_law_has_no_use_for_it(tmp_path):
    text = "velocity [mm/s],load [N],friction_coefficient\n"
    text += "".join(f"{v},{90 + v},{mu}\n" for v, mu in ((1, 0.1), (2, 0.12), (4, 0.11), (8, 0.1)))
    path = write(tmp_path, text)
    result = run_fit(path, None, [], [], tmp_path / "fit", False, "coulomb")
    mean = np.exp(np.mean(np.log([0.1, 0.12, 0.11, 0.1])))
    assert result.estimates[0].value == pytest.approx(mean, rel=1e-6)
    head, first = (tmp_path / "fit" / "fit.csv").read_text(encoding="utf-8").splitlines()[:2]
    assert "friction_coefficient [-],fitted_friction_coefficient [-]" in head
    assert first.startswith(",0.001,,,0.1,0.107")  # no thickness, pressure nor slip
    # The viscous part is a traction, so with it the pressure counts.
    with pytest.raises(InputError, match=r"area is missing.*--fix viscous=0, none is needed"):
        fit_setup(path, None, [], [], "stribeck")
    names = fit_setup(path, None, ["viscous=0"], [], "stribeck").names
    assert names == ("mu_s", "mu_d", "V_s")
    # The rise over slip is one of the traction: K_T asks for the pressure.
    slid = text.replace("\n", "\n1,").replace("velocity", "slip [um],velocity")
    slid = write(tmp_path, slid.removesuffix("1,"))
    with pytest.raises(InputError, match=r"area is missing; add"):
        fit_setup(slid, None, [], [], "coulomb")


def test_the_thickness_is_asked_for_only_by_the_law_of_the_film(tmp_path):
    path = write(tmp_path, GOOD.replace("thickness [nm],", "").replace("\n0,", "\n"))
    with pytest.raises(InputError, match=r"--law stribeck and --law coulomb"):
        read_data(path)
    assert not read_data(path, needs_film=False).knows_film
    assert fit_setup(path, None, [], [], "coulomb").names == ("mu",)
    viscous = path.read_text(encoding="utf-8").replace(
        "traction [kPa]", "effective_viscosity [Pa*s]"
    )
    with pytest.raises(InputError, match="thickness is missing"):
        read_data(write(tmp_path, viscous), needs_film=False)


@pytest.mark.parametrize("mark", [";", "\t"])
def test_tables_of_spreadsheets_are_read(tmp_path, mark):
    """Semicolons or tabs between columns, decimals behind commas, rows without a value."""
    written = GOOD.replace(",", mark).replace("1e-", "1,0e-") + 3 * mark + "\n"
    read = read_data(write(tmp_path, written))
    same = read_data(write(tmp_path, GOOD))
    assert read.velocity == pytest.approx(same.velocity, rel=1e-15)
    assert read.traction == pytest.approx(same.traction, rel=1e-15)


def test_columns_that_are_told_are_not_read(tmp_path):
    text = "".join(f"now,{line}\n" for line in GOOD.splitlines()).replace("now", "time [h]", 1)
    path = write(tmp_path, text)
    assert len(read_data(path, ignored=["time"])) == 8
    assert len(read_data(path, ignored=["Time [h]"])) == 8
    with pytest.raises(InputError, match=r'no column "times" in .*; there are time \[h\], thick'):
        read_data(path, ignored=["times"])
    both = text.replace("time [h]", "time [h],T", 1).replace("now,", "now,20,")
    with pytest.raises(InputError, match=r'"time \[h\]", "T"; .* --ignore-columns "time,T"'):
        read_data(write(tmp_path, both))


def test_all_bad_rows_are_named_at_once(tmp_path):
    text = GOOD.replace("0,1e-2,3,302", "0,-1e-2,3,302").replace("3,305", "3,many")
    path = write(tmp_path, text.replace("0,1e-7,3,307", "0,1e-7,3"))
    with pytest.raises(InputError) as caught:
        read_data(path)
    lines = caught.value.said
    assert [line.removeprefix(f"{path}:")[:2] for line in lines] == ["3:", "6:", "8:"]
    assert "velocity" in lines[0] and "traction" in lines[1] and "3 values" in lines[2]
    assert str(caught.value) == lines[0]
    many = write(tmp_path, GOOD.splitlines()[0] + 30 * "\n0,1e-3,3,many")
    with pytest.raises(InputError) as caught:
        read_data(many)
    assert caught.value.said[-1] == "... and 10 more" and len(caught.value.said) == 21


HEAD = "thickness [nm],velocity [m/s],pressure [MPa],traction [kPa]"
GOOD = HEAD + "\n" + "".join(f"0,1e-{k},3,{300 + k}\n" for k in range(1, 9))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["is empty"]), (HEAD, ["no data"]),
        (GOOD.replace(",", ";").replace("301", "301.5").replace("305", "305,5"),
         [":6:", "behind a point in line 2", "behind a comma in line 6"]),
        ("Machine 7\n" + GOOD, [":1:", '"Machine 7"', 'begin lines before that of the names']),
        (GOOD.replace("0,1e-3,3,303", '0,1e-3,3,"303,5"'), [":4:", "traction", "point"]),
        (GOOD.replace("velocity", "velocty"), [":1:", "velocty", 'did you mean "velocity"']),
        (GOOD.replace("[nm]", "[s]"), [":1:", "thickness", "wrong dimension"]),
        (GOOD.replace("[nm]", "[nanny]"), ["thickness", "unknown unit"]),
        (GOOD.replace(" [m/s]", ""), ["velocity", "needs its unit", "[m/s]"]),
        (GOOD.replace("pressure [MPa],", "").replace(",3,", ","), ["neither", '--fix "pressure=']),
        (GOOD.replace("thickness [nm],", "").replace("\n0,", "\n"), ["thickness", "--fix"]),
        (GOOD.replace("0,1e-3,3,303", "0,-1e-3,3,303"), [":4:", "velocity", "> 0 m/s"]),
        (GOOD.replace("0,1e-3,3,303", "0,1e-3,3,nan"), [":4:", "traction", "finite"]),
        (GOOD.replace("0,1e-3,3,303", "0,1e-3,3,many"), [":4:", "traction", "number"]),
        (GOOD.replace("0,1e-3,3,303", "0,1e-3,3"), [":4:", "3 values for 4 columns"]),
        (GOOD.replace("traction [kPa]", "force [N]"), ["area", "missing"]),
        (GOOD.replace("traction [kPa]", "effective_viscosity [Pa*s]"), [":2:", "thickness = 0"]),
        (GOOD.replace("traction [kPa]", "pressure [kPa]"), ["pressure", "twice"]),
        (HEAD + "\n0,1e-3,3,300\n", ["too few data", "mu_s", "2 rows", "found 1", "--fix"]),
        (GOOD.replace("thickness [nm]", "Thicknes (nm)"), ['"thickness"', "[m]", "brackets"]),
        (GOOD.replace("thickness [nm]", "temperature [K]"),
         ["weight; take other columns out", '--ignore-columns "temperature"']),
    ],
)  # fmt: skip
def test_wrong_data_are_one_line(tmp_path, text, words):
    assert_refused(tmp_path, text, words)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"parameters": "mu_s,etab"}, ["etab", 'did you mean "eta_b"']),
        ({"parameters": ","}, ["names none"]),
        ({"parameters": "mu_s,mu_s"}, ["twice"]),
        ({"parameters": "alpha,beta"}, ["alpha, beta"]),
        ({"parameters": "V_star", "fixed": ["gamma=4e-25 N/s"]}, ["V_star, gamma"]),
        ({"parameters": "mu_s", "fixed": ["mu_s=0.1"]}, ["mu_s", "--fix"]),
        ({"parameters": "mu_s,B"}, ["mu_d"]),
        ({"parameters": "mu_s,alpha"}, ["alpha", "no row has a film"]),
        ({"parameters": "mu_s,V_star"}, ["V_star", "no row has a film"]),
        ({"fixed": ["K_T=3 m"]}, ["K_T", "wrong dimension"]),
        ({"fixed": ["KT=3"]}, ["KT", 'did you mean "K_T"']),
        ({"fixed": ["velocity=1 m/s"]}, ["velocity", "is in the file"]),
        ({"fixed": ["mu_s"]}, ["mu_s", "key=value"]),
        ({"start": ["mu_s=-1"]}, ["--start mu_s", "between"]),
        ({"start": ["eta_b=1"]}, ["eta_b", "is not fitted"]),
        ({"law": "stribek"}, ["stribek", 'did you mean "stribeck"']),
        ({"law": "stribeck", "parameters": "mu_s,V_s"}, ["mu_d", "--fix mu_d"]),
        ({"law": "coulomb", "parameters": "mu_s"}, ["mu_s", "of law coulomb"]),
        ({"law": "coulomb", "fixed": ["eta_b=1"]}, ["eta_b", "mu, K_T"]),
    ],
)
def test_wrong_options_are_one_line(tmp_path, options, words):
    assert_refused(tmp_path, GOOD, words, **options)


def assert_refused(tmp_path, text, words, parameters=None, fixed=(), start=(), law="friction-map"):
    path = write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        run_fit(path, parameters, fixed, start, tmp_path / "out", False, law)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message
    assert not (tmp_path / "out").exists()


def test_the_data_are_never_cleared(tmp_path):
    path = write(tmp_path, GOOD)
    with pytest.raises(InputError, match=r"data\.csv"):
        run_fit(path, None, [], [], tmp_path, True)
    assert path.read_text(encoding="utf-8") == GOOD


def test_what_is_fitted_follows_the_columns(tmp_path):
    assert fit_setup(write(tmp_path, GOOD), None, [], []).names == ("mu_s",)
    assert set(fit_setup(SYNTHETIC, None, [], []).names) == {
        "mu_s", "mu_d", "A_d", "B", "alpha", "V_star", "eta_b",
    }  # fmt: skip
    assert "eta_b" not in fit_setup(SYNTHETIC, None, ["eta_b=0.5 Pa*s"], []).names
    setup = fit_setup(SYNTHETIC, "mu_s,eta_b", ["mu_d=0.1", "B=3e5 1/m"], ["mu_s=0.2"])
    assert (setup.base.mu_d, setup.base.B, setup.starts) == (0.1, 3e5, {"mu_s": 0.2})
    assert "A_d" in setup.assumed and "B" not in setup.assumed
    assert set(setup.assumed) <= set(RANGES) | {"D_min", "D_max", "V_star_at"} | {
        "transition_width", "flow_rule",
    }  # fmt: skip
