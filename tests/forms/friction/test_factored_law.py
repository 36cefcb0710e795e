"""A law times a factor that changes: energy, tangent, and what is kept of the elastic slip."""

from dataclasses import replace

import numpy as np
import pytest

from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters
from tribox.forms.friction.factored_law import FactoredLaw
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.parameters import FrictionMapParameters, with_preset

FILM = FrictionMapParameters(
    **with_preset("friction-map", {"mu_s": 0.3, "K_T": 1e9, "V_star": 1e-4, "V_star_at": 3e-8})
)
LAWS = {
    "coulomb": CoulombLaw(CoulombParameters(mu=0.3, K_T=1e9)),
    "friction-map": FrictionMap(FILM),
}
PRESSURE = np.array([1e6, 2e6, 5e5, 0.0])
THICKNESS = np.full(4, 2e-8)


@pytest.fixture(params=LAWS)
def law(request):
    return FactoredLaw(LAWS[request.param])


def step(law, state, slip, pressure=PRESSURE):
    return law.update(slip, 0.01, pressure, THICKNESS, state)


def slips(count=12):
    return 2e-4 * np.random.default_rng(5).standard_normal((count, 4, 2))


def test_the_energy_balances_and_no_factor_creates_any(law):
    """T·Δg − Δψ is the dissipation, which is not negative, however the factor goes up and down."""
    state = law.initial_state(4, 2)
    factors = [1.0, 0.6, 0.0, 0.3, 0.3, 2.0, 5.0, 0.1, 1.0, 0.7, 0.8, 0.0]
    for number, (factor, slip) in enumerate(zip(factors, slips(), strict=True)):
        law.factor = factor
        pressure = PRESSURE if number != 7 else np.zeros(4)
        out = step(law, state, slip, pressure)
        before, after = law.stored_energy(state), law.stored_energy(out.state)
        work = np.einsum("qi,qi->q", out.traction, slip)
        scale = np.abs(work).max() + before.max() + after.max() + 1e-30
        assert np.abs(work - (after - before) - out.dissipation.total).max() < 1e-12 * scale
        assert out.dissipation.total.min() >= -1e-12 * scale
        state = out.state


def test_the_derivatives_are_those_of_the_traction(law):
    law.factor = 0.8
    state = step(law, law.initial_state(4, 2), 1e-7 * slips(1)[0]).state
    law.factor = 1.7
    slip = 1e-7 * slips(2)[1]
    out, h = step(law, state, slip), 1e-12
    for component in range(2):
        way = np.zeros((4, 2))
        way[:, component] = h
        ends = [step(law, state, slip + sign * way).traction for sign in (1.0, -1.0)]
        difference = (ends[0] - ends[1]) / (2.0 * h)
        size = np.abs(out.d_traction_d_slip).max()
        assert np.allclose(difference, out.d_traction_d_slip[:, :, component], atol=1e-4 * size)
        moved = [
            replace(state, elastic_slip=state.elastic_slip + sign * way) for sign in (1.0, -1.0)
        ]
        ends = [step(law, one, slip).traction for one in moved]
        difference = (ends[0] - ends[1]) / (2.0 * h)
        assert np.allclose(difference, out.d_traction_d_elastic[:, :, component], atol=1e-4 * size)


def test_a_rising_factor_keeps_the_traction_and_a_falling_one_the_slip():
    law, still = FactoredLaw(LAWS["coulomb"]), np.zeros((4, 2))
    first = step(law, law.initial_state(4, 2), np.full((4, 2), 1e-5))
    law.factor = 4.0
    risen = step(law, first.state, still)
    assert np.allclose(risen.traction, first.traction, rtol=1e-14)
    law.factor = 0.5
    fallen = step(law, first.state, still)
    assert np.allclose(fallen.traction, 0.5 * first.traction, rtol=1e-14)
    assert np.allclose(fallen.state.elastic_slip, first.state.elastic_slip, rtol=1e-14)


def test_sliding_friction_is_the_factor_times_mu(law):
    law.factor = 0.4
    state = law.initial_state(4, 2)
    for _ in range(3):
        out = step(law, state, np.tile([1e-3, 0.0], (4, 1)))
        state = out.state
    plain = law.law.update(
        np.tile([1e-3, 0.0], (4, 1)), 0.01, PRESSURE, THICKNESS, law.law.initial_state(4, 2)
    )
    assert np.allclose(out.traction[:, 0], 0.4 * plain.traction[:, 0], rtol=1e-9)
    assert np.allclose(law.coefficient(state), 0.4 * law.law.coefficient(state))


def test_a_state_is_written_and_read_with_its_factor(law):
    law.factor = 0.4
    state = step(law, law.initial_state(4, 2), slips(1)[0]).state
    again = type(state).from_arrays(state.arrays())
    assert np.array_equal(again.factor, state.factor)
    out, same = (step(law, one, slips(2)[1]) for one in (state, again))
    assert np.array_equal(out.traction, same.traction)


def test_a_negative_factor_is_refused():
    with pytest.raises(ValueError, match="factor"):
        FactoredLaw(LAWS["coulomb"], -0.1)
