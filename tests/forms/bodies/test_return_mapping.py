"""The return mapping ends on the yield surface, whatever the law, the rate and the step."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tribox.forms.bodies.elastoplastic import ElastoPlastic, PlasticPoints
from tribox.forms.bodies.hardening import JohnsonCook, Linear, Perzyna, Swift, Table, Voce


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


@settings(deadline=None, max_examples=100)
@given(
    law=LAWS,
    rate=RATES,
    dt=tens(-3, 3),
    strains=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    size=tens(-3, 0),
    space=st.booleans(),
)
def test_the_stress_after_a_step_is_the_flow_stress(law, rate, dt, strains, size, space):
    points = PlasticPoints(ElastoPlastic(300.0, 800.0, law, rate), space)
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
