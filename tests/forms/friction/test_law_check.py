"""Laws put to the test: the built-in ones pass, each kind of mistake is found."""

from dataclasses import replace

import numpy as np
import pytest

from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters, FrictionlessLaw
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law_check import Conditions, check_law
from tribox.forms.friction.parameters import FrictionMapParameters
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters

COULOMB = CoulombLaw(CoulombParameters(mu=0.3, K_T=1e12))
MAP = {
    **{"mu_s": 0.12, "mu_d": 0.1, "A_d": 1e-6, "B": 1e6, "K_T": 1e12, "eta_b": 0.8},
    **{"D_max": 250e-9, "alpha": 0.5, "V_star": 1e-3, "V_star_at": 10e-9},
}
LAWS = {
    "frictionless": FrictionlessLaw(),
    "coulomb": COULOMB,
    "stribeck": StribeckLaw(
        StribeckParameters(mu_s=0.15, mu_d=0.08, V_s=1e-3, viscous=1e6, K_T=1e12)
    ),
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
