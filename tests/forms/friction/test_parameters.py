"""Parameters of the friction-map law: what is refused, presets, the map itself."""

import math

import numpy as np
import pytest

from tribox.forms.friction import law as settling
from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters, FrictionlessLaw
from tribox.forms.friction.film import at_rest, film_point, threshold_speed
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.parameters import PRESETS, FrictionMapParameters, with_preset
from tribox.forms.friction.return_mapping import SlipWeakening
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters

GOOD = {
    "mu_s": 0.12, "K_T": 1e12, "eta_b": 0.8, "D_max": 250e-9, "alpha": 0.039, "V_star": 1e-3,
    "V_star_at": 10e-9,
}  # fmt: skip
UNPRINTED = {"mu_s": 0.1, "K_T": 1e12}


def make(**changes):
    values = GOOD | changes
    return FrictionMapParameters(**{k: v for k, v in values.items() if v is not None})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mu_s": -0.1}, r"mu_s = -0\.1: must be >= 0"),
        ({"mu_s": math.nan}, "mu_s = nan: must be finite"),
        ({"mu_s": "0.1"}, "mu_s = '0.1': must be a number"),
        ({"mu_d": 0.2}, r"mu_d = 0\.2: must be <= mu_s = 0\.12"),
        ({"mu_d": -0.2}, r"mu_d = -0\.2: must be >= 0"), ({"A_d": -1e-6}, "A_d = -1e-06"),
        ({"B": -1.0}, r"B = -1\.0"), ({"K_T": 0.0}, r"K_T = 0\.0: must be > 0 Pa/m"),
        ({"K_T": math.inf}, "K_T = inf"), ({"eta_b": -0.8}, r"eta_b = -0\.8"),
        ({"D_min": -1e-9}, "D_min = -1e-09"),
        ({"D_min": 250e-9}, "D_max = 2.5e-07: must be > D_min = 2.5e-07 m"),
        ({"alpha": 1.1}, r"alpha = 1\.1: must be >= 0 and <= 1"),
        ({"alpha": ((1e-8, 0.1), (3e-8, 1.5))}, "alpha = .* must be >= 0 and <= 1"),
        ({"alpha": ((0.0, 0.1), (3e-8, 0.5))}, "alpha = .* must be > 0 m"),
        ({"alpha": ((3e-8, 0.1), (1e-8, 0.5))}, "alpha = .* the film thickness must rise"),
        ({"alpha": (0.1, 0.2)}, r"alpha = .* a table of rows \[film thickness, value\]"),
        ({"alpha": None}, "give either alpha or beta, found neither"),
        ({"beta": 1.0}, "give either alpha or beta, found both"),
        ({"alpha": None, "beta": 0.0}, r"beta = 0\.0: must be > 0"),
        ({"gamma": 4e-25}, r"give either V_star \(with V_star_at\) or gamma, found both"),
        ({"V_star": None}, r"give either V_star \(with V_star_at\) or gamma, found neither"),
        ({"V_star": 0.0}, r"V_star = 0\.0: must be > 0"),
        ({"V_star_at": None}, "V_star_at: missing"),
        ({"V_star_at": 0.0}, r"V_star_at = 0\.0: must be > 0"),
        ({"V_star": None, "gamma": 4e-25}, "V_star_at = 1e-08: belongs to V_star"),
        ({"V_star": None, "V_star_at": None, "gamma": -1.0}, r"gamma = -1\.0: must be > 0"),
        ({"V_star": None, "V_star_at": None, "gamma": 4e-25, "eta_b": 0.0},
         r"eta_b = 0\.0: must be > 0 Pa\*s with gamma"),
        ({"transition_width": -0.1}, r"transition_width = -0\.1"),
        ({"transition_width": 1.0}, r"transition_width = 1\.0: must be >= 0 and < 1"),
        ({"flow_rule": "wieghted"}, "flow_rule = 'wieghted': must be 'weighted' or 'literal'"),
        ({"reentry": "x"}, "reentry = 'x': must be 'consistent' or 'literal'"),
        ({"switch": "x"}, "switch = 'x': must be 'implicit' or 'lagged'"),
    ],
)  # fmt: skip
def test_impossible_parameters_are_refused_in_one_line(changes, message):
    with pytest.raises(ValueError, match=message) as caught:
        make(**changes)
    assert "\n" not in str(caught.value)


def test_mu_d_defaults_to_mu_s():
    assert make().friction.constant
    assert make(mu_d=0.1, B=1e6).friction == SlipWeakening(0.12, 0.1, 0.0, 1e6)


@pytest.mark.parametrize(
    ("preset", "film", "alpha"),
    [
        ("paper-printed", (10e-9, 30e-9, 180e-9), (0.04, 0.97902, 0.9999967)),
        ("paper-swapped", (10e-9, 30e-9, 180e-9), (0.04, 0.99998, 0.99672)),
        ("friction-map", (10e-9, 30e-9, 180e-9, 105e-9), (0.039, 0.9967, 0.9999, 0.9983)),
    ],
)
def test_film_fraction_of_the_presets(preset, film, alpha):
    extra = {} if preset.startswith("paper") else {"V_star": 1e-3, "V_star_at": 10e-9}
    parameters = FrictionMapParameters(**with_preset(preset, UNPRINTED | extra))
    solid = at_rest(parameters, np.array(film)).solid
    # Five digits were computed by hand; where alpha is near 1 it is 1 - alpha that matters.
    np.testing.assert_allclose(1.0 - solid, alpha, atol=6e-6)
    if preset == "paper-printed":
        assert solid[2] == pytest.approx(1e-5 * math.log(250 / 180), rel=1e-5)


def test_presets_hold_what_is_printed_and_nothing_else():
    assert set(PRESETS) == {"paper-printed", "paper-swapped", "friction-map"}
    for preset in PRESETS.values():
        assert not {"mu_s", "mu_d", "A_d", "B", "K_T"} & preset.keys()
    with pytest.raises(ValueError, match="gamma, found neither"):
        FrictionMapParameters(**with_preset("friction-map", UNPRINTED))
    with pytest.raises(ValueError, match="preset = 'paper': must be 'paper-printed' or"):
        with_preset("paper", {})


def test_given_values_displace_those_of_a_preset():
    merged = with_preset("paper-printed", {"alpha": 0.5, "beta": None, "eta_b": 1.0})
    assert merged["alpha"] == 0.5 and "beta" not in merged and merged["eta_b"] == 1.0
    merged = with_preset("paper-printed", {"V_star": 1e-3, "V_star_at": 1e-8})
    assert "gamma" not in merged and merged["V_star"] == 1e-3
    assert "beta" in merged


def test_gamma_and_threshold_speed_are_two_ways_to_say_the_same():
    gamma = 0.8 * 1e-3**2 * 10e-9 / 250e-9
    film = np.array([0.0, 10e-9, 40e-9])
    by_gamma = make(gamma=gamma, V_star=None, V_star_at=None)
    np.testing.assert_allclose(threshold_speed(make(), film), [np.inf, 1e-3, 0.5e-3])
    np.testing.assert_allclose(threshold_speed(by_gamma, film), [np.inf, 1e-3, 0.5e-3])


def test_film_fraction_over_the_film_thickness():
    parameters = make(alpha=None, beta=0.5, D_min=10e-9, D_max=110e-9)
    film = np.array([0.0, 10e-9, 35e-9, 110e-9, 1e-6])
    for speed, inside in ((0.0, 0.5), (1.0, 1.0)):
        point = film_point(parameters, film, np.full(5, speed))
        np.testing.assert_allclose(point.alpha, [0.0, 0.0, inside, 1.0, 1.0], rtol=1e-14)
        np.testing.assert_array_equal(point.solid, 1.0 - point.alpha)


def test_the_transition_is_continuous_with_its_derivative():
    width, film = 0.1, np.array([10e-9])
    parameters = make(transition_width=width)
    speed = 1e-3 * np.array([0.8, 0.9 - 1e-9, 0.9 + 1e-9, 1.0, 1.1 - 1e-9, 1.1 + 1e-9, 1.2])
    point = film_point(parameters, film, speed)
    middle = 0.039 + 0.961 / 2
    expected = [0.039, 0.039, 0.039, middle, 1.0, 1.0, 1.0]
    np.testing.assert_allclose(point.alpha, expected, atol=1e-14)
    slope = 0.961 * 1.5 / (2 * width * 1e-3)
    np.testing.assert_allclose(point.d_alpha_d_speed, [0, 0, 0, slope, 0, 0, 0], atol=1e-6 * slope)
    sharp = film_point(make(transition_width=0.0), film, 1e-3 * np.array([1 - 1e-12, 1.0]))
    np.testing.assert_allclose(sharp.alpha, [0.039, 1.0])
    assert sharp.d_alpha_d_speed is None


def test_one_film_thickness_stands_for_all_points():
    speed = 1e-3 * np.linspace(0.5, 1.5, 7)
    for changes in ({}, {"transition_width": 0.0}, {"alpha": None, "beta": 0.3}):
        short = film_point(make(**changes), np.array([20e-9]), speed)
        full = film_point(make(**changes), np.full(7, 20e-9), speed)
        np.testing.assert_array_equal(short.alpha, full.alpha)
        np.testing.assert_array_equal(short.d_alpha_d_film, full.d_alpha_d_film)


@pytest.mark.parametrize("B", [1e3, 1e6, 3e6])
@pytest.mark.parametrize("A_d", [0.0, 1e-6])
def test_slip_weakening_solves_its_equation(A_d, B):
    friction = SlipWeakening(mu_s=0.12, mu_d=0.03, A_d=A_d, B=B)
    rng = np.random.default_rng(0)
    pressure = 3e6 * rng.uniform(0.1, 1.0, 500)
    path = 10 ** rng.uniform(-9, -3, 500)
    threshold = friction.coefficient(path) * pressure
    trial = threshold / 1e12 * (1.0 + 10 ** rng.uniform(-6, 4, 500))
    after = friction.slipped_path(trial, 1e12, pressure, path)
    slip = after - path
    assert (slip > 0.0).all() and (slip < trial).all()
    residual = 1e12 * (trial - slip) - friction.coefficient(after) * pressure
    # 1e-16 of the lengths that were added.
    assert (np.abs(residual) <= 1e12 * 1e-15 * (trial + path)).all()


def test_coefficient_of_friction_over_the_slip():
    friction = SlipWeakening(mu_s=0.12, mu_d=0.04, A_d=1e-6, B=1e6)
    path = np.array([0.0, 1e-6, 2e-6, 1.0])
    np.testing.assert_allclose(friction.coefficient(path), [0.12, 0.12, 0.08, 0.04], rtol=1e-5)
    np.testing.assert_allclose(friction.slope(path), [0.0, 0.0, -0.08e6 / 4, -8e-8], rtol=1e-5)


# -- What laws say of where their friction tends, against sliding there ----------------------------

P = np.array([1e6, 2e6, 0.0])
FILM = np.full(3, 30e-9)


def friction_map(**values) -> FrictionMap:
    keys = {
        "mu_s": 0.2, "mu_d": 0.1, "A_d": 2e-6, "B": 1e6, "K_T": 1e12, "eta_b": 0.8,
        "D_max": 250e-9, "alpha": 0.3, "V_star": 1e-3, "V_star_at": 30e-9,
    }  # fmt: skip
    return FrictionMap(FrictionMapParameters(**keys | values))


def slide(law, way: float, speed: float = 1e-5, steps: int = 20):
    """State and traction (q,) after a way."""
    state = law.initial_state(3, 2)
    for _ in range(steps):
        slip = np.tile([way / steps, 0.0], (3, 1))
        response = law.update(slip, way / steps / speed, P, FILM, state)
        state = response.state
    return state, np.linalg.norm(response.traction, axis=1)


@pytest.mark.parametrize("flow_rule", ["weighted", "literal"])
@pytest.mark.parametrize("way", [1.5e-6, 2e-5])
def test_the_map_says_what_its_traction_will_still_lose(flow_rule, way):
    law = friction_map(flow_rule=flow_rule, reentry="literal")
    state, now = slide(law, way)
    _, end = slide(law, 1e3)
    left = settling.unsettled(law, state, P)
    assert left[0] > 1e3
    assert left == pytest.approx(now - end, rel=1e-6, abs=1e-6)


def test_nothing_is_left_where_the_film_carries_all_or_nothing_weakens():
    for law in (friction_map(V_star=1e-6), friction_map(B=0.0), friction_map(mu_d=0.2)):
        state, _ = slide(law, 1e-5)
        assert not settling.unsettled(law, state, P).any()
    assert settling.settling_slip(friction_map(B=0.0)) == 0.0


def test_the_settling_slip_is_where_the_coefficient_is_near_its_end():
    law = friction_map()
    state = law.initial_state(2, 2)
    slip = settling.settling_slip(law)
    state.slip_path = np.array([slip, 0.99 * slip])
    reached, before = law.coefficient(state)
    assert reached == pytest.approx(0.1 * (1.0 + settling.SETTLED), rel=1e-12)
    assert before > reached
    assert settling.settling_slip(friction_map(mu_d=0.0)) == np.inf


@pytest.mark.parametrize(
    "law",
    [
        friction_map(B=0.0),
        friction_map(B=0.0, flow_rule="literal", reentry="literal"),
        CoulombLaw(CoulombParameters(mu=0.2, K_T=1e12)),
        StribeckLaw(StribeckParameters(mu_s=0.2, mu_d=0.2, V_s=1.0, K_T=1e12)),
    ],
)
def test_the_presliding_length_is_the_elastic_slip_of_a_sliding_point(law):
    state, _ = slide(law, 1e-5)
    elastic = np.linalg.norm(state.elastic_slip, axis=1)
    assert elastic[0] > 0.0
    assert settling.presliding_length(law, state, P) == pytest.approx(elastic, rel=1e-9)


def test_laws_that_say_nothing():
    law = FrictionlessLaw()
    state = law.initial_state(3, 2)
    state.elastic_slip[:, 1] = 1e-7
    assert settling.knows_its_end(law) and settling.settling_slip(law) == 0.0
    assert not settling.unsettled(law, state, P).any()
    assert settling.presliding_length(law, state, P) == pytest.approx([1e-7, 1e-7, 0.0])


def test_a_slip_alone_does_not_tell_the_end():
    class Half(FrictionlessLaw):
        settling_slip = 1e-5

    assert not settling.knows_its_end(Half())
    assert settling.knows_its_end(friction_map())
