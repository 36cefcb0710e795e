"""Laws put to the test: the built-in ones pass, each kind of mistake is found."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from tribox.app.build.case_notes import (
    notes_on_fixed_threshold,
    notes_on_tabulation,
    notes_on_threshold,
    notes_on_uniqueness,
)
from tribox.forms import closed_forms
from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters, FrictionlessLaw
from tribox.forms.friction.film import threshold_speed
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import Regime
from tribox.forms.friction.law_check import Conditions, check_law
from tribox.forms.friction.parameters import FrictionMapParameters, with_preset
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters

COULOMB = CoulombLaw(CoulombParameters(mu=0.3, K_T=1e12))
MAP = {
    **{"mu_s": 0.12, "mu_d": 0.1, "A_d": 1e-6, "B": 1e6, "K_T": 1e12, "eta_b": 0.8},
    **{"D_max": 250e-9, "alpha": 0.5, "V_star": 1e-3, "V_star_at": 10e-9},
}
LAWS = {
    "frictionless": FrictionlessLaw(),
    "coulomb": COULOMB,
    **{
        f"stribeck {delta:g} {viscous:g}": StribeckLaw(
            StribeckParameters(
                mu_s=0.15, mu_d=0.08, V_s=1e-3, delta=delta, viscous=viscous, K_T=1e12
            )
        )
        for delta, viscous in ((0.5, 0.0), (1.0, 1e6), (2.0, 1e8))
    },
    "map": FrictionMap(FrictionMapParameters(**MAP, film_onset_pressure=1e4)),
}
AT = Conditions(pressure=1e6, film=30e-9, steps=(1e-3, 1.0))


class Spoilt:
    """Coulomb friction with a mistake in ``update``."""

    def __init__(self, mistake) -> None:
        self.mistake = mistake
        self.initial_state, self.stored_energy = COULOMB.initial_state, COULOMB.stored_energy
        self.coefficient = COULOMB.coefficient

    def update(self, slip, dt, pressure, film, state, **options):
        response = COULOMB.update(slip, dt, pressure, film, state, **options)
        return self.mistake(response, slip, pressure, film, state)


@pytest.mark.parametrize("name", LAWS)
def test_the_built_in_laws_pass(name):
    findings = {finding.quantity: finding for finding in check_law(LAWS[name], AT)}
    assert [q for q, finding in findings.items() if not finding.good] == []
    assert len(findings) == 8
    compared = findings["d_traction_d_slip"]
    assert compared.asked == (2 + 3) * 3 * 200 and compared.compared > 0.9 * compared.asked


def test_stick_slip_and_open_points_are_among_those_compared():
    seen = np.zeros(5)

    def look(response, *rest):
        seen[:] += np.bincount(response.regime, minlength=5)
        return response

    check_law(Spoilt(look), AT)
    share = seen / seen.sum()
    assert share[0] > 0.05 and share[1] > 0.2 and share[2] > 0.2


def test_nothing_depends_on_units():
    """The same law with a millionth of the stiffness, at a millionth of the pressure."""
    soft = CoulombLaw(CoulombParameters(mu=0.3, K_T=1e3))
    findings = check_law(soft, Conditions(pressure=1e-3, steps=(1e-9, 1e9)))
    assert all(finding.good for finding in findings)
    stiff = check_law(COULOMB, Conditions(pressure=1e6, steps=(1e-9, 1e9)))
    assert [f.compared for f in findings] == pytest.approx([f.compared for f in stiff], rel=0.02)


def forgets_slip(response, slip, pressure, film, state):
    """0.1 % off."""
    return replace(response, d_traction_d_slip=0.999 * response.d_traction_d_slip)


def transposes(response, slip, pressure, film, state):
    out = response.d_traction_d_elastic.copy()
    out[:, 0, 1] *= -1.0
    return replace(response, d_traction_d_elastic=out)


def forgets_pressure(response, slip, pressure, film, state):
    return replace(response, d_traction_d_pressure=np.zeros_like(response.traction))


def invents_film(response, slip, pressure, film, state):
    return replace(response, d_traction_d_film=response.traction / 30e-9)


def changes_state(response, slip, pressure, film, state):
    state.slip_path += 1e-9
    return response


def mixes_points(response, slip, pressure, film, state):
    return replace(response, traction=response.traction * (1.0 + 1e-6 * len(pressure)))


def pushes(response, slip, pressure, film, state):
    return replace(response, traction=-response.traction)


def miscounts(response, slip, pressure, film, state):
    parts = replace(response.dissipation, viscous=1e-3 * np.abs(response.dissipation.coulomb))
    return replace(response, dissipation=parts)


def is_noisy(response, slip, pressure, film, state):
    noise = 1.0 + 1e-3 * np.sin(1e15 * slip)
    return replace(response, traction=response.traction * noise)


def is_no_number(response, slip, pressure, film, state):
    wide = np.linalg.norm(slip, axis=1) > 1e-5
    return replace(
        response, d_traction_d_pressure=np.where(wide[:, None], np.nan, response.traction * 0.0)
    )


MISTAKES = {
    forgets_slip: "d_traction_d_slip", transposes: "d_traction_d_elastic",
    forgets_pressure: "d_traction_d_pressure", invents_film: "d_traction_d_film",
    changes_state: "state passed in, changed", mixes_points: "traction among other points",
    pushes: "dissipation, below 0", miscounts: "dissipation, its parts",
    is_noisy: "d_traction_d_slip", is_no_number: "d_traction_d_pressure",
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.__name__)
def test_each_mistake_is_found_where_it_is(mistake):
    findings = {f.quantity: f for f in check_law(Spoilt(mistake), Conditions(1e6, 30e-9, (1.0,)))}
    found = findings[MISTAKES[mistake]]
    assert not found.good
    if mistake is not is_noisy:
        assert found.worst > found.allowed and "pressure" in found.where
    if mistake is forgets_slip:
        assert found.worst == pytest.approx(1e-3, rel=1e-3)
        assert [q for q, f in findings.items() if not f.good] == ["d_traction_d_slip"]


def test_the_literal_rule_breaks_the_second_law():
    """A falling alpha under the printed re-entry rule makes energy (docs/law.md)."""
    literal = FrictionMap(FrictionMapParameters(**MAP, reentry="literal", film_onset_pressure=1e4))
    findings = {f.quantity: f for f in check_law(literal, AT)}
    assert not findings["dissipation, below 0"].good
    assert findings["dissipation, its parts"].good


# -- Checks of parameters against a run, and the closed forms of homogeneous sliding ---------------

P = 3e6
BASE = FrictionMapParameters(
    **with_preset(
        "friction-map",
        {"mu_s": 0.12, "mu_d": 0.10, "K_T": 1e12, "V_star": 1e-3, "V_star_at": 10e-9},
    )
)


def noted(notes, parameters, *values, **more) -> str | None:
    """The line that there is to say, if there is one; films are numbers or lists."""
    if notes is not notes_on_fixed_threshold:
        values = *values[:-1], np.atleast_1d(values[-1])
    return next(iter(notes(parameters, *values, **more)), None)


def test_uniqueness_is_told_with_its_numbers():
    # t_N (mu_s - mu_d) B = 6e4 B: unique up to B = 1e12/6e4 = 1.67e7 1/m.
    unique = dataclasses.replace(BASE, B=1.6e7)
    assert noted(notes_on_uniqueness, BASE, P, 10e-9) is None
    assert noted(notes_on_uniqueness, unique, P, 10e-9) is None
    message = noted(notes_on_uniqueness, dataclasses.replace(BASE, B=2e7), P, 10e-9)
    assert message is not None and "\n" not in message
    for number in ("1e+12 Pa/m", "1.2e+12 Pa/m", "3e+06 Pa", "2.5e+06 Pa"):
        assert number in message
    # The literal rule: (1 - alpha) K_T, here 0.0033e12 at 30 nm; nothing to weaken at alpha = 1.
    literal = dataclasses.replace(unique, flow_rule="literal")
    message = noted(notes_on_uniqueness, literal, P, np.array([10e-9, 30e-9, 250e-9]))
    assert message is not None and "(1 - alpha) K_T = 3.3e+09 Pa/m" in message
    assert noted(notes_on_uniqueness, literal, P, 250e-9) is None


def test_where_uniqueness_fails_stick_and_slip_coexist():
    """Two states, both within the threshold, that the same slip leads to."""
    law = FrictionMap(dataclasses.replace(BASE, B=1e8, mu_d=0.0))
    assert noted(notes_on_uniqueness, law.parameters, P, 0.0) is not None
    reach = 0.12 * P / 1e12
    state = law.initial_state(1, 1)
    tractions = []
    for slip in (0.999 * reach, 0.002 * reach):
        response = law.update(np.array([[slip]]), 1.0, np.array([P]), np.zeros(1), state)
        state = response.state
        tractions.append(response.traction[0, 0])
    # From just below the threshold to just above it: the traction falls at once.
    assert response.regime[0] == Regime.SLIP
    assert tractions[1] < 0.1 * tractions[0]


def test_a_threshold_speed_out_of_reach_is_told():
    printed = FrictionMapParameters(**with_preset("paper-printed", {"mu_s": 0.1, "K_T": 1e12}))
    within = {"position_error": 1e-15, "dt": 1e-4}
    message = noted(notes_on_threshold, printed, np.array([10e-9, 180e-9]), **within)
    assert message is not None and "\n" not in message
    for part in ("gamma = 4e-25", "8.3e-13 m/s", "1.8e-07 m", "within round-off", "1e-11 m/s"):
        assert part in message
    slow = noted(notes_on_threshold, printed, 10e-9, position_error=1e-16, dt=10.0, slowest=1e-8)
    assert slow is not None and "below every speed of sliding (from 1e-08 m/s)" in slow
    assert noted(notes_on_threshold, BASE, 10e-9, **within, slowest=1e-8) is None
    # No threshold speed plays a part in a dry contact or in a thick film.
    assert noted(notes_on_threshold, printed, np.array([0.0, 300e-9]), **within) is None


FILM = np.array([0.0, 10e-9, 30e-9, 180e-9, 250e-9, 400e-9])


def test_effective_viscosity_written_out():
    eta = closed_forms.effective_viscosity(1e-4, [10e-9, 30e-9], P, 0.1, BASE)
    np.testing.assert_allclose(eta, [0.961 * 30 + 0.039 * 0.8, 0.0033 * 90 + 0.9967 * 0.8])
    literal = dataclasses.replace(BASE, flow_rule="literal")
    eta = closed_forms.effective_viscosity(1e-4, [10e-9, 30e-9], P, 0.1, literal)
    np.testing.assert_allclose(eta, [30 + 0.039 * 0.8, 90 + 0.9967 * 0.8])


def test_speeds_that_mark_the_map():
    np.testing.assert_allclose(
        closed_forms.threshold_speed(FILM[:3], BASE), [np.inf, 1e-3, 1e-3 / np.sqrt(3.0)]
    )
    assert closed_forms.crossover_speed(10e-9, P, 0.1, 0.8) == pytest.approx(3.75e-3)
    above = closed_forms.film_fraction([0.999e-3, 1e-3], 10e-9, BASE)
    np.testing.assert_allclose(above, [0.039, 1.0])


@pytest.mark.parametrize("rule", ["weighted", "literal"])
@pytest.mark.parametrize("film", [0.0, 10e-9, 180e-9])
def test_presliding_length_is_where_the_asperities_give_way(rule, film):
    parameters = dataclasses.replace(BASE, flow_rule=rule)
    law = FrictionMap(parameters)
    alpha = closed_forms.film_fraction(0.0, film, parameters)
    reach = closed_forms.presliding_length(P, 0.12, alpha, parameters)
    # Slowly: below the threshold speed throughout.
    for factor, regime in ((0.999, Regime.STICK), (1.001, (Regime.SLIP, Regime.MIXED))):
        slip = factor * np.full((1, 2), float(reach) / np.sqrt(2.0))
        response = law.update(slip, 1e6, np.array([P]), np.array([film]), law.initial_state(1, 2))
        assert response.regime[0] in np.atleast_1d(regime)
    expected = {"weighted": 3.6e-7, "literal": 3.6e-7 / (1.0 - alpha)}[rule]
    assert reach == pytest.approx(expected, rel=1e-12)
    literal = dataclasses.replace(BASE, flow_rule="literal")
    assert closed_forms.presliding_length(P, 0.12, 1.0, literal) == np.inf


@pytest.mark.parametrize(
    ("changes", "film", "told"),
    [
        ({}, [10e-9, 30e-9, 180e-9], None),
        # Outside D_min < D < D_max alpha is 0 or 1, whatever the table says.
        ({}, [0.0, 250e-9, 300e-9], None),
        # 0.9967 + 70/150 (0.9999 - 0.9967)
        ({}, [30e-9, 100e-9], "alpha = 0.9982 at D = 1e-07 m (interpolated);"),
        # From 0 at D_min on.
        ({}, [5e-9], "alpha = 0.0195 at D = 5e-09 m (interpolated);"),
        ({"alpha": None, "beta": ((1e-8, 1.0), (3e-8, 1.0))}, [5e-9], "(end of the table);"),
        ({"alpha": 0.5}, [100e-9], None),
        ({"alpha": None, "beta": ((10e-9, 1.0), (30e-9, 1.0))}, [25e-9], "no row for some"),
        ({}, [11e-9, 12e-9, 13e-9, 14e-9, 15e-9, 16e-9], "at D = 1.4e-08 m (interpolated), and 2"),
    ],
)
def test_film_fractions_that_a_table_does_not_hold_are_told(changes, film, told):
    note = noted(notes_on_tabulation, dataclasses.replace(BASE, **changes), np.array(film))
    assert (note is None) is (told is None)
    if note is not None:
        assert told in note and "such values are no data" in note
        assert f"the table of {'beta' if 'beta' in changes else 'alpha'} has no row" in note


def test_a_threshold_speed_that_does_not_move_with_the_viscosity_names_the_gamma_that_does():
    assert noted(notes_on_fixed_threshold, BASE, 0.8) is None
    note = noted(notes_on_fixed_threshold, dataclasses.replace(BASE, eta_b=3.2), 0.8)
    assert note is not None and "V_star is given directly and does not move with eta_b" in note
    gamma = float(note.split("gamma = ")[1].split(" ")[0])
    moving = dataclasses.replace(BASE, V_star=None, V_star_at=None, gamma=gamma)
    # At the preset's viscosity it is V_star at V_star_at, at four times that half of it.
    for viscosity, speed in ((0.8, 1e-3), (3.2, 0.5e-3)):
        parameters = dataclasses.replace(moving, eta_b=viscosity)
        assert threshold_speed(parameters, np.array([10e-9])) == pytest.approx(speed, rel=1e-3)
        assert noted(notes_on_fixed_threshold, parameters, 0.8) is None
