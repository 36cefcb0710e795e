"""Resultants of a contact in the plane, in space and round an axis, in numbers."""

from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from tests.contact_boxes import PENALTY, Scene
from tribox.app.simulation.contact_resultants import contact_columns, measure_contact
from tribox.forms.friction.coulomb import CoulombLaw, CoulombParameters

DEPTH = 0.02
PRESSURE = PENALTY * DEPTH
STICKY = CoulombLaw(CoulombParameters(mu=1e3, K_T=60.0))


def pressed(shape, law=STICKY):
    scene = Scene(shape, law)
    scene.term.commit(scene.term.evaluate(scene.moved(lambda x: 0.0 * x), 1.0))
    return scene


def measured(scene, motion, driven=None):
    x = scene.moved(motion)
    return measure_contact(scene.term, scene.term.evaluate(x, 1.0), MPI.COMM_SELF, driven)


@pytest.mark.parametrize("shape", ["tet4", "hex8", "tet10"])
def test_sliding_in_space(shape):
    """The slave's square of side 0.5 is dragged along an oblique way; μ p A resists."""
    way = np.array([0.6, -0.8, 0.0])
    scene = pressed(shape, CoulombLaw(CoulombParameters(mu=0.3, K_T=60.0)))
    normal, friction = PRESSURE * 0.25, 0.3 * PRESSURE * 0.25
    for driven, share in ((None, 1.0), (way, 1.0), ([1.0, 0.0, 0.0], 0.6), ([0, 0, -1.0], 1.0)):
        m = measured(scene, lambda x: np.broadcast_to(0.1 * way, x.shape), driven)
        assert m.normal_force == pytest.approx(normal, rel=1e-10)
        assert m.tangential_force == pytest.approx(share * friction, rel=1e-10)
        assert m.drag == pytest.approx(share * friction, rel=1e-10)
        np.testing.assert_allclose(m.friction, friction * way, atol=1e-12)
        np.testing.assert_allclose(m.force, [*-(friction * way)[:2], normal], atol=1e-12)
        assert m.twist_moment == pytest.approx(0.0, abs=1e-12)
        assert m.area == pytest.approx(0.25, rel=1e-12)


@pytest.mark.parametrize("shape", ["tet4", "hex8", "hex27"])
def test_twist(shape):
    """Turned by a small angle about its middle while it sticks: M = K_T θ ∫ r² dA, no resultant."""
    scene = pressed(shape)
    angle, middle = 1e-6, np.array([0.55, 0.55, 0.0])
    turn = angle * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    m = measured(scene, lambda x: (x - middle) @ turn.T)
    assert m.twist_moment == pytest.approx(60.0 * angle * 0.5**4 / 6.0, rel=1e-5)
    np.testing.assert_allclose(m.friction, 0.0, atol=1e-6 * m.twist_moment)
    # About another point there is a force too, and still the moment through the middle.
    m = measured(scene, lambda x: x @ turn.T)
    assert m.twist_moment == pytest.approx(60.0 * angle * 0.5**4 / 6.0, rel=1e-5)
    force = 60.0 * angle * 0.25 * 0.55
    np.testing.assert_allclose(m.friction, [-force, force, 0.0], rtol=1e-5, atol=1e-12)


def test_a_dry_pair_beside_a_film_leaves_its_viscosity_alone():
    """D and η_eff are those of the pairs with a film; μ is weighted by the normal force."""
    scene = pressed("hex8", CoulombLaw(CoulombParameters(mu=0.3, K_T=60.0)))
    way = np.array([0.6, -0.8, 0.0])
    found = measured(scene, lambda x: np.broadcast_to(0.1 * way, x.shape), way)
    wet = replace(found, film=3.0)
    dry = replace(found, normal_force=3.0 * found.normal_force, friction_coefficient=0.7, area=9.0)
    alone = contact_columns([wet], 2.0, True, 0.5)
    both = contact_columns([wet, dry], 2.0, True, 0.5)
    assert both["film_thickness"] == alone["film_thickness"] == pytest.approx(3.0, rel=1e-12)
    assert both["effective_viscosity"] == pytest.approx(alone["effective_viscosity"], rel=1e-12)
    assert both["mu"] == pytest.approx(0.25 * 0.3 + 0.75 * 0.7, rel=1e-12)
