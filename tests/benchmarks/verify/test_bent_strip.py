"""Bent strips against textbook formulas and against plastic points at the fibres."""

import numpy as np
import pytest

from benchmarks.verify.metal_bar import Strip
from tribox.forms.bodies.elastoplastic import ElastoPlastic, PlasticPoints
from tribox.forms.bodies.hardening import Linear, Voce

E, NU, T = 70e9, 0.33, 1e-3
STIFFNESS = E * T**3 / 12.0 / (1.0 - NU**2)


def test_an_elastic_strip_springs_back_whole():
    moment, left = Strip(T, E, NU, Linear(1e12).stress).bent(20.0)
    assert moment == pytest.approx(STIFFNESS * 20.0, rel=1e-9)
    assert left == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("curvature", [10.0, 40.0])
def test_an_ideally_plastic_incompressible_strip_bears_the_textbooks_moment(curvature):
    """2/√3 σ_Y t²/4 (1 − ⅓ (y_e/half)²); what is lost is M over the stiffness."""
    stress = 2.0 / np.sqrt(3.0) * 120e6
    nu = 0.499999
    edge = stress * (1.0 - nu**2) / E / curvature / (0.5 * T)
    exact = stress * T**2 / 4.0 * (1.0 - edge**2 / 3.0)
    moment, left = Strip(T, E, nu, Linear(120e6).stress).bent(curvature)
    assert moment == pytest.approx(exact, rel=1e-4)
    lost = exact / (E * T**3 / 12.0 / (1.0 - nu**2))
    assert curvature - left == pytest.approx(lost, rel=1e-4)


def test_fibres_follow_plastic_points():
    """A fibre as a point whose stretch through the thickness is found by secants each step."""
    law, strain, steps = Voce(60e6, 160e6, 12.0, 100e6), 0.02, 200
    G, K = E / (2.0 * (1.0 + NU)), E / (3.0 * (1.0 - 2.0 * NU))
    points = PlasticPoints(ElastoPlastic(G, K, law), space=False)
    state, through = points.start(1), 0.0
    for step in range(1, steps + 1):
        along = strain * step / steps
        for _ in range(30):
            F = np.array([[np.exp(along), 0.0, 0.0, np.exp(through), 1.0]])
            update = points.update(F, state, 1.0, True)
            tau = update.P[0, 3] * F[0, 3]
            through -= tau / (update.A[0, 3, 3] * F[0, 3] ** 2 + tau)
        state = update.state
    expected = [update.P[0, 0] * F[0, 0], update.P[0, 4]]
    strip = Strip(T, E, NU, law.stress)
    stress, alpha = np.zeros((2, 1)), np.zeros(1)
    for _ in range(steps):
        stress, alpha = strip._stepped(stress, alpha, np.array([strain / steps]))
    np.testing.assert_allclose(stress[:, 0], expected, rtol=1e-6)
    assert alpha[0] == pytest.approx(state[0, -1], rel=1e-6)
