"""What laws say of where their friction tends, against sliding there."""

import numpy as np
import pytest

from tribox.forms.friction import law as settling
from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters, FrictionlessLaw
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.parameters import FrictionMapParameters
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters

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
