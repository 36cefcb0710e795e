"""The return mapping ends on the yield surface, whatever the law, the rate and the step."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import JohnsonCook, Linear, Perzyna, Swift, Table, Voce
from tribox.forms.bodies.plastic_points import PlasticPoints
from tribox.forms.bodies.return_mapping import ITERATIONS, _FlowStress, plastic_step


def tens(low, high):
    """Powers of ten between two exponents."""
    return st.floats(low, high).map(lambda x: 10.0**x)


def tables(rises):
    """A table with rises of strain and stress in pairs."""
    steps = np.cumsum([(0.0, 1.0), *rises], axis=0)
    return Table(steps)


LAWS = st.one_of(
    st.builds(Linear, st.just(1.0), st.one_of(st.just(0.0), tens(-3, 3))),
    st.builds(
        lambda gain, exponent, modulus: Voce(1.0, 1.0 + gain, exponent, modulus),
        tens(-3, 1),
        tens(-1, 5),
        st.one_of(st.just(0.0), tens(-3, 2)),
    ),
    st.builds(Swift, st.just(1.0), tens(-8, 0), st.floats(0.0, 1.0)),
    st.lists(st.tuples(tens(-5, 0), st.one_of(st.just(0.0), tens(-3, 1))), max_size=6).map(tables),
)
RATES = st.one_of(
    st.none(),
    st.builds(JohnsonCook, tens(-4, 0), tens(-6, 6)),
    st.builds(Perzyna, tens(-6, 6), tens(-1.3, 0)),
)


@settings(deadline=None)
@given(
    law=LAWS,
    rate=RATES,
    shear=tens(0, 5),
    dt=tens(-9, 9),
    alpha=st.one_of(st.just(0.0), tens(-6, 1)),
    over=st.lists(tens(-10, 3), min_size=1, max_size=5),
)
@example(  # α + Δα has a few floating-point values about the root, between which g jumps
    law=tables([(1.0, 0.0), (1e-4, 1.0)]), rate=None, shear=1.0, dt=1.0, alpha=1.0, over=[1e-4]
)
def test_the_step_is_the_root_for_any_law_rate_and_overstress(law, rate, shear, dt, alpha, over):
    """The equation changes sign within 1e-9 of the step, or vanishes to round-off.

    The law sees α + Δα, which has no values nearer to one another than its round-off.
    """
    strains = np.full(len(over), alpha)
    trial = law.stress(strains) * (1.0 + np.array(over))
    flow_stress = _FlowStress(ElastoPlastic(shear, shear, law, rate), strains, dt)
    calls = []

    class Counted:
        hardening, alpha = law, strains
        start, most = flow_stress.start, flow_stress.most

        def __call__(self, step):
            calls.append(step)
            return flow_stress(step)

    step = plastic_step(trial, shear, Counted())
    assert np.isfinite(step).all() and (step >= 0.0).all()
    near = np.maximum(1e-9 * step, np.spacing(strains + step))
    for nearby, sign in ((np.maximum(step - near, 0.0), 1.0), (step + near, -1.0)):
        left = trial - 3.0 * shear * nearby - flow_stress(nearby)[0]
        assert (sign * left >= -1e-13 * trial).all()
    assert len(calls) < ITERATIONS // 2


@settings(deadline=None, max_examples=50)
@given(
    law=LAWS,
    rate=RATES,
    dt=tens(-3, 3),
    strains=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    size=tens(-3, 0),
    space=st.booleans(),
    compiled=st.booleans(),
)
def test_the_stress_after_a_step_is_the_flow_stress(law, rate, dt, strains, size, space, compiled):
    points = PlasticPoints(ElastoPlastic(300.0, 800.0, law, rate), space, compiled)
    F = np.diag(np.exp(size * np.array(strains)))
    stretches = F.reshape(1, 9) if space else F.reshape(1, 9)[:, [0, 1, 3, 4, 8]]
    update = points.update(stretches, points.start(1), dt, False, volumetric=False)
    tau = update.P[0, ::4] * np.diag(F) if space else update.P[0, [0, 3, 4]] * np.diag(F)
    mises, alpha = np.sqrt(1.5 * tau @ tau), update.state[:, -1]
    factor = 1.0 if rate is None else rate.factor(alpha / dt)
    trial = 2.0 * 300.0 * np.sqrt(1.5) * np.linalg.norm(size * (strains - np.mean(strains)))
    roundoff = 1e-12 * trial + 4e-15 * 600.0  # of the strain, which is of order 1
    assert update.valid and tau.sum() == pytest.approx(0.0, abs=roundoff)
    if alpha > 0.0:
        assert mises == pytest.approx(law.stress(alpha) * factor, abs=roundoff)
        assert mises == pytest.approx(trial - 900.0 * alpha, abs=roundoff)
    else:
        assert trial <= law.stress(alpha) * (1.0 + 2e-11)
        assert mises == pytest.approx(trial, abs=roundoff)
