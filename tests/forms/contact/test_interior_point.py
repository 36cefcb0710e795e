"""Laws of contact from inside: linear, and at their end the laws themselves."""

import numpy as np
import pytest

from tests.contact_boxes import Scene
from tests.forms.contact.test_tangent import State
from tests.laws import coulomb, film_map
from tribox.forms.contact.interior_point import (
    CentralPoint,
    CentralSlip,
    InteriorPoint,
    InteriorSlip,
    SoftenedPoint,
)
from tribox.forms.contact.state import ContactMode
from tribox.forms.friction.law import Regime, presliding_length

PENALTY = 1e13  # Pa/m


def slips(dim, count=40):
    """Interior points of random trial slips (q, i) up to three times their thresholds (q,)."""
    rng = np.random.default_rng(dim)
    trial = rng.uniform(0.0, 3.0, (count, 1)) * rng.standard_normal((count, dim)) / dim
    threshold = rng.uniform(0.5, 1.5, count)
    start = InteriorSlip(np.zeros((count, dim)), np.ones(count), threshold, np.full(count, 0.1))
    return start, trial, threshold


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_slips_tend_to_the_return_mapping(dim):
    """At the end the elastic slip is the trial slip, or its threshold in the same direction."""
    at, trial, threshold = slips(dim)
    for shrinks in [0.1] * 9 + [1.0] * 8:
        at = at.advanced(trial, threshold, threshold, shrinks, whole=True)
        assert np.all(np.linalg.norm(at.elastic, axis=1) < at.threshold)
        assert np.all(at.permanent > 0.0)
    length = np.linalg.norm(trial, axis=1)
    share = np.minimum(1.0, threshold / length)
    assert 5 < np.count_nonzero(share < 1.0) < len(share)
    np.testing.assert_allclose(at.elastic, share[:, None] * trial, atol=1e-6)
    np.testing.assert_allclose(at.permanent, (1.0 - share) * length, atol=1e-6)


def test_a_point_that_sticks_slips_in_the_iteration_that_takes_it_past_its_threshold():
    """Also where the barrier is low: its permanent slip follows from the trial slip at once."""
    _, trial, threshold = slips(2)
    low, length = np.full(len(threshold), 1e-14), np.linalg.norm(trial, axis=1)
    at = InteriorSlip(np.zeros_like(trial), low / threshold, threshold, low)
    slow = at.advanced(trial, threshold, threshold, 1.0, whole=False)
    at = at.advanced(trial, threshold, threshold, 1.0, whole=True)
    goes = length > threshold
    assert goes.any() and np.all(slow.permanent < 1e-12)
    sum_ = np.linalg.norm(at.elastic, axis=1) * (1.0 + at.permanent / threshold)
    np.testing.assert_allclose(sum_[goes], length[goes], rtol=1e-12)
    for _ in range(5):
        at = at.advanced(trial, threshold, threshold, 1.0, whole=True)
    np.testing.assert_allclose(at.permanent, np.maximum(length - threshold, 0.0), atol=1e-2)


def test_pressures_on_the_central_path_have_the_product_at_every_gap():
    """Far from contact too, and as the barrier falls they become the penalty's."""
    gap, penalty = np.array([-1e-3, -1e-7, 0.0, 1e-7, 1e-3, 1e6]), np.full(6, PENALTY)
    at = InteriorPoint(np.ones(6), np.ones(6), 2.0, 1.0).central()
    pressure, stiffness = at.law(gap, penalty)
    assert np.all(pressure > 0.0) and np.all(stiffness > 0.0)
    # p s, of which the slack is lost to cancellation where it is small: p² / K + p g = μ.
    np.testing.assert_allclose((pressure / penalty + gap)[1:] * pressure[1:], 2.0, rtol=1e-9)
    step = 1e-3 * np.maximum(np.abs(gap), 1e-6)
    slope = (at.law(gap - step, penalty)[0] - at.law(gap + step, penalty)[0]) / (2.0 * step)
    np.testing.assert_allclose(stiffness, slope, rtol=1e-4)
    for _ in range(3):
        at = at.advanced(gap, penalty, 1e-12 * at.barrier, 0.1)
        assert np.all(at.pressure > 0.0) and np.all(at.slack > 0.0)
    np.testing.assert_allclose(at.law(gap, penalty)[0], penalty * np.maximum(-gap, 0.0), atol=1e-6)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_slips_on_the_central_path_fulfil_their_equations_and_end_at_the_return_mapping(dim):
    start, trial, threshold = slips(dim)
    at = start.central()
    new = at.linear(trial, threshold)
    length = np.linalg.norm(new.elastic, axis=1)
    along = new.elastic * (1.0 + new.permanent / threshold)[:, None]
    np.testing.assert_allclose(along, trial, rtol=1e-12)
    np.testing.assert_allclose(new.permanent * (threshold - length**2 / threshold), 0.1)
    rng, small = np.random.default_rng(7), 1e-6
    aside, longer = rng.standard_normal(trial.shape), rng.standard_normal(len(threshold))
    ends = [
        at.linear(trial + side * aside, threshold + side * longer).elastic
        for side in (small, -small)
    ]
    expected = np.einsum("qij,qj->qi", new.d_trial, aside) + new.d_threshold * longer[:, None]
    np.testing.assert_allclose((ends[0] - ends[1]) / (2.0 * small), expected, atol=1e-8)
    last = at.advanced(trial, threshold, 2.0 * threshold, 1e-13, whole=True)
    assert np.all(last.threshold == 2.0 * threshold)
    share = np.minimum(1.0, 2.0 * threshold / np.linalg.norm(trial, axis=1))
    np.testing.assert_allclose(
        last.linear(trial, last.threshold).elastic, share[:, None] * trial, atol=1e-6
    )


STATES = {
    "slip": State(coulomb(0.2), Regime.SLIP, now=(0.13, -0.09, -0.09)),
    "film": State(film_map(), Regime.MIXED, now=(0.13, -0.09, -0.09), film=0.5),
}


@pytest.mark.parametrize("central", [False, True], ids=["linear", "central"])
@pytest.mark.parametrize("pressure", ["averaged", "pointwise"])
@pytest.mark.parametrize("shape", ["Q4", "hex8"])
@pytest.mark.parametrize("state", STATES)
def test_the_tangent_from_inside_is_that_of_differences(shape, state, pressure, central):
    given = STATES[state]
    scene = Scene(shape, given.law, film=given.film, pressure=pressure)
    term = scene.term
    pick = [0, 2] if scene.dim == 2 else [0, 1, 2]
    trial = term.evaluate(scene.vector(np.array(given.before)[pick], 0.03, 0.9), 1.0)
    term.commit(trial)
    nodal = trial.nodal_pressure if pressure == "averaged" else trial.pressure
    pressures = np.maximum(nodal, 0.1 * nodal.max())
    at_points = term.surface.vertices.at_points(pressures) if pressure == "averaged" else pressures
    threshold = presliding_length(term.law, term.state.friction, at_points)
    elastic = 0.5 * term.state.friction.elastic_slip
    longer = np.maximum(threshold, 1.01 * np.linalg.norm(elastic, axis=1))
    slip = InteriorSlip(elastic, np.full(len(threshold), 0.05), longer, 0.01 * longer)
    inside = InteriorPoint(pressures, 0.01 / pressures, 0.01, 10.0, slip)
    inside = inside.central() if central else inside
    assert isinstance(inside, CentralPoint) == isinstance(inside.slip, CentralSlip) == central
    mode = ContactMode(interior=inside)
    x = scene.vector(np.array(given.now)[pick], 0.04, 0.7, 0.01)
    assert scene.error(x, mode=mode) < 1e-7


def test_slips_without_a_threshold_stay_finite_however_many_iterations_there_are():
    """Points that a film carries: their length fell by a factor in each, until its square was 0."""
    nothing = np.zeros(3)
    at = InteriorSlip(np.zeros((3, 1)), np.ones(3), np.full(3, 1e-9), np.array([0.0, 1e-20, 1e-15]))
    at = at.central()
    trial = np.array([[0.0], [1e-9], [1e-3]])
    for _ in range(40):
        at = at.advanced(trial, nothing, nothing, 0.1, whole=True)
    np.testing.assert_array_equal(at.threshold, 1e-9)
    new = at.linear(trial, nothing)
    assert np.isfinite(new.d_trial).all() and not new.d_threshold.any()
    assert np.abs(new.elastic).max() <= 1e-9 * 1e-11


def test_softened_points_come_to_the_law_of_the_penalty():
    """A body of stiffness k under a force, pressed or pulled: each point begins the next one."""
    force, body, softness = np.array([-2.0, 0.5, 3.0]), 0.2, 0.03  # Pa, and of the penalty
    exact = np.maximum(force, 0.0) / (1.0 + body)
    pressure, errors = np.zeros(3), []
    for _ in range(4):
        point = SoftenedPoint((1.0 - softness) * pressure, np.full(3, PENALTY), softness)
        # k g + p(g) K = f of what is closed; what is open carries nothing
        closed = (point.base + force * softness / body) / (1.0 + softness / body)
        gap = -(force - np.maximum(closed, 0.0)) / (body * PENALTY)
        found, stiffness = point.law(gap, np.full(3, PENALTY))
        assert np.all((found > 0.0) == (gap < point.reach))
        np.testing.assert_allclose(stiffness, softness * PENALTY)
        pressure = found
        errors.append(np.abs(found - exact).max())
    ratio = (1.0 - softness) * body / (body + softness)
    np.testing.assert_allclose(np.array(errors[1:]) / errors[:-1], ratio, rtol=1e-6)
