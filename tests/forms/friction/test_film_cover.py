"""The share of a point's area that is wet: the film's traction is proportional to it."""

import numpy as np
import pytest

from tests.forms.friction.test_friction_map import FLOWS, K_T, V_STAR, P, parameters, with_flow
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.stribeck import StribeckLaw, StribeckParameters

LAWS = {name: FrictionMap(with_flow(parameters(), name)) for name in FLOWS}
LAWS["stribeck"] = StribeckLaw(
    StribeckParameters(mu_s=0.15, mu_d=0.08, V_s=V_STAR, K_T=K_T, viscous=1e8)
)
COVERS = np.array([0.0, 0.3, 1.0])


def responses(law, rate_dependent=True):
    """One step of the same point, fast on a thick film, at each cover."""
    n = len(COVERS)
    return law.update(
        np.tile([3e-6, -1e-6], (n, 1)),
        1e-4,
        np.full(n, P),
        np.full(n, 150e-9),
        law.initial_state(n, 2),
        area_ratio=1.1,
        film_cover=COVERS,
        rate_dependent=rate_dependent,
    )


@pytest.mark.parametrize("name", LAWS)
def test_film_is_linear_in_its_cover(name):
    """Traction, dissipation and derivatives; what is dry or stored does not feel it."""
    out = responses(LAWS[name])
    assert out.dissipation.viscous[0] == 0.0 < out.dissipation.viscous[2]
    for value in (
        out.traction,
        out.d_traction_d_slip,
        out.d_traction_d_pressure,
        out.d_traction_d_elastic,
        out.d_traction_d_film,
        out.dissipation.viscous,
        out.dissipation.total,
    ):
        between = value[0] + 0.3 * (value[2] - value[0])
        np.testing.assert_allclose(value[1], between, rtol=1e-9, atol=1e-12 * np.abs(value).max())
    assert not np.allclose(out.traction[0], out.traction[2], rtol=1e-6)
    for part in (out.state.elastic_slip, out.dissipation.coulomb, out.state.alpha):
        np.testing.assert_array_equal(part, np.broadcast_to(part[:1], part.shape))


@pytest.mark.parametrize("name", ["newtonian", "stribeck"])
def test_without_rates_the_cover_says_nothing(name):
    out = responses(LAWS[name], rate_dependent=False)
    np.testing.assert_array_equal(out.traction, np.broadcast_to(out.traction[:1], (3, 2)))
