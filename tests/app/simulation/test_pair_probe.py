"""What the warnings of a contact go by, pair by pair, against closed forms."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tests.contact_boxes import PENALTY, Scene
from tests.geometry.surfaces.test_vertices import graded
from tribox.app.simulation.contact_warnings import FEW, ContactWarnings, PairProbe, PairState
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.friction.coulomb import FrictionlessLaw


def trial_of(surface, pressure):
    """Averaged contact with these pressures (v,) at its vertices."""
    gap = -pressure / PENALTY
    at_points = surface.vertices.at_points(pressure)
    return SimpleNamespace(pressure=at_points, nodal_pressure=pressure, nodal_gap=gap)


def test_depths_are_judged_by_the_local_facets():
    """The same penetration everywhere: over the shortest facets it is most."""
    surface = graded("Q4")
    probe = PairProbe(ContactTerm(surface, FrictionlessLaw(), PENALTY))
    state = probe.measure(trial_of(surface, np.full(surface.vertices.count, 3.0)))
    assert state.deepest == pytest.approx(3.0 / PENALTY)
    assert state.mean == pytest.approx(3.0 / PENALTY)
    expected = 3.0 / PENALTY / surface.vertices.length.min()
    assert state.over_facet == pytest.approx(expected, rel=1e-12)
    assert state.force == pytest.approx(3.0) and state.area == pytest.approx(1.0)


def test_mean_penetration_is_weighted_by_the_force_of_the_vertices():
    surface = graded("Q4")
    probe = PairProbe(ContactTerm(surface, FrictionlessLaw(), PENALTY))
    pressure = np.maximum(np.linspace(-1.0, 3.0, surface.vertices.count), 0.0)
    area = surface.vertices.area
    expected = area @ pressure**2 / PENALTY / (area @ pressure)
    assert probe.measure(trial_of(surface, pressure)).mean == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("pressed", "layers"), [(2, 1), (3, 2), (4, 3), (5, FEW), (0, 0)])
def test_layers_are_counted_from_the_rim(pressed, layers):
    """The end of the slave is no rim; a facet counts if all its vertices press."""
    surface = graded("Q4")
    probe = PairProbe(ContactTerm(surface, FrictionlessLaw(), PENALTY))
    pressure = np.where(np.arange(surface.vertices.count) < pressed, 1.0, 0.0)
    assert probe.measure(trial_of(surface, pressure)).layers == layers


@pytest.mark.parametrize(("bend", "sagitta"), [(0.0, 0.0), (0.5, 0.5)])
def test_sagitta_is_what_a_gap_has_beside_its_linear_part(bend, sagitta):
    """Tilted, the facets have none; bent by b x² it is b h²/4 less at Gauss' points."""
    scene = Scene("Q9", FrictionlessLaw(), degree=9, fine=True, pressure="pointwise")

    def motion(X):
        x = X[:, 0] - 0.55
        return np.stack([0.0 * x, 0.02 * x + bend * x**2], axis=1)

    trial = scene.residual(scene.moved(motion, 0.1))[1]
    state = PairProbe(scene.term).measure(trial)
    size = scene.surface.slave.facet_length[0]
    at = np.unique(np.round(scene.surface.slave.xi[:, 0], 12)) - 0.5
    expected = sagitta * size**2 * np.ptp(at**2)
    assert state.sagitta == pytest.approx(expected, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize(
    ("open_inside", "scatter", "sagitta", "comb"),
    [(0.0, 0.0, 0.9, False), (0.0, 0.0, 1.1, True), (0.06, 0.0, 0.0, True), (0.0, 0.3, 0.0, True)],
)
def test_signs_of_a_comb(open_inside, scatter, sagitta, comb):
    """Each by itself; the sagitta against the mean penetration, here 1."""
    state = PairState(1.0, 1.0, 2.0, 0.1, 1.0, FEW, open_inside, scatter, sagitta)
    assert ContactWarnings._is_comb(state) == comb
