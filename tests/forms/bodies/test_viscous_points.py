"""Maxwell branches at material points: closed forms, an ODE solution, tangents, dissipation."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given as of_any
from hypothesis import settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from tests.forms.bodies import plastic_samples as given
from tribox.forms.bodies.elastoplastic import PlasticPoints
from tribox.forms.bodies.point_state import DISSIPATED
from tribox.forms.bodies.viscous_points import Branch, ViscousPoints

BRANCHES = (Branch(0.7, 0.3), Branch(0.4, 2.0), Branch(0.2, 0.01))
PLANE = [0, 1, 3, 4, 8]


def identity(space):
    eye = np.eye(3).reshape(-1)
    return eye if space else eye[PLANE]


def some(space, count=20, size=0.3, seed=0):
    """Deformation gradients (n, p), none of them turned inside out."""
    p = 9 if space else 5
    return identity(space) + np.random.default_rng(seed).uniform(-size, size, (count, p))


def aged(points, count=20, dt=0.4):
    """A state that three steps have led to."""
    state = points.start(count)
    for seed in (5, 6, 7):
        state = points.update(some(points.space, count, 0.2, seed), state, dt, False).state
    return state


@pytest.mark.parametrize("space", [False, True])
def test_of_a_point_that_is_turned_inside_out_nothing_is_remembered(space):
    points = ViscousPoints(BRANCHES, space)
    state, F = aged(points, 13), some(space, 13)
    F[3] *= -1.0
    bad = points.update(F, state, 0.3, True)
    assert not bad.valid and np.isnan(bad.P[3]).all() and np.isfinite(bad.P[2]).all()
    assert np.array_equal(bad.state[3], state[3])


@pytest.mark.parametrize("space", [False, True])
def test_dashpots_that_are_held_answer_as_in_no_time(space):
    points = ViscousPoints(BRANCHES, space)
    state, F = aged(points, 13), some(space, 13)
    held, sudden = points.frozen().update(F, state, 1.0, True), points.update(F, state, 1e-12, True)
    inner = points.columns["viscous_metric_1"]
    np.testing.assert_allclose(held.state[:, inner], state[:, inner], rtol=0, atol=1e-13)
    for a, b in ((held.P, sudden.P), (held.A, sudden.A)):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9 * np.abs(b).max())


@pytest.mark.parametrize("space", [False, True])
@pytest.mark.parametrize("dt", [0.03, 3.0])
def test_the_tangent_is_the_derivative_and_symmetric(space, dt):
    points = ViscousPoints(BRANCHES, space)
    state, F = aged(points), some(space)
    along, step = np.random.default_rng(1).normal(size=F.shape), 1e-5
    A = points.update(F, state, dt, True).A
    sides = [points.update(F + s * step * along, state, dt, False).P for s in (1.0, -1.0)]
    slope = (sides[0] - sides[1]) / (2.0 * step)
    assert np.abs(np.einsum("npq,nq->np", A, along) - slope).max() < 1e-7 * np.abs(slope).max()
    assert np.abs(A - A.transpose(0, 2, 1)).max() <= 1e-14 * np.abs(A).max()


def test_the_plane_is_a_part_of_space():
    plane, space = (ViscousPoints(BRANCHES, s) for s in (False, True))
    F = some(False)
    wide = given.tensors(F).reshape(-1, 9)
    one, other = (p.update(f, p.start(20), 0.3, True) for p, f in ((plane, F), (space, wide)))
    np.testing.assert_allclose(other.P[:, PLANE], one.P, rtol=0, atol=1e-14)
    np.testing.assert_allclose(other.A[:, PLANE][:, :, PLANE], one.A, rtol=0, atol=1e-13)


def metrics(state, b):
    """C_k (n, 3, 3) of a branch in space."""
    return state[:, 6 * b : 6 * b + 6][:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3)


def test_rotations_turn_the_stress_and_leave_the_memory():
    points = ViscousPoints(BRANCHES, True)
    state, F = aged(points), some(True)
    Q = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    turned = (Q @ F.reshape(-1, 3, 3)).reshape(-1, 9)
    one, other = (points.update(f, state, 0.2, False) for f in (F, turned))
    wanted = (Q @ one.P.reshape(-1, 3, 3)).reshape(-1, 9)
    np.testing.assert_allclose(other.P, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    np.testing.assert_allclose(other.state, one.state, rtol=0, atol=1e-13)


def test_what_is_remembered_keeps_its_volume_and_the_pressure_is_none():
    points = ViscousPoints(BRANCHES, True)
    state = points.start(20)
    for number, dt in enumerate((1e-3, 0.5, 100.0, math.inf)):
        found = points.update(some(True, 20, 0.25, number), state, dt, False)
        state = found.state
        for b in range(3):
            det = np.linalg.det(metrics(state, b))
            np.testing.assert_allclose(det, 1.0, rtol=0, atol=1e-13)
        F = some(True, 20, 0.25, number).reshape(-1, 3, 3)
        kirchhoff = found.P.reshape(-1, 3, 3) @ F.transpose(0, 2, 1)
        assert np.abs(np.trace(kirchhoff, axis1=1, axis2=2)).max() < 1e-13


@settings(max_examples=60, deadline=None)
@of_any(st.integers(0, 10**6), st.floats(1e-9, 0.4), st.floats(-9.0, 6.0), st.booleans())
def test_no_branch_ever_gives_energy(seed, size, decade, space):
    points = ViscousPoints(BRANCHES, space)
    state = points.start(7)
    for number in range(3):
        F = some(space, 7, size, seed + number)
        found = points.update(F, state, 10.0**decade, False)
        grown = (found.state - state)[:, points.columns[DISSIPATED]]
        assert found.valid and (grown >= 0.0).all() and (found.dissipation >= 0.0).all()
        state = found.state


def sheared(points, gamma, times):
    """Stresses P (n, 5) of simple shear to ``gamma`` at ``times``."""
    state, found = points.start(1), []
    for before, now in pairwise(times):
        F = identity(False)[None].copy()
        F[0, 1] = gamma(now)
        update = points.update(F, state, now - before, False)
        state = update.state
        found.append(update.P[0])
    return np.array(found), state


def exact_shear(gamma, times):
    """The same by the differential equation, and what the branches have dissipated."""

    def rates(time, y):
        C = np.array([[1.0, gamma(time), 0.0], [gamma(time), 1.0 + gamma(time) ** 2, 0], [0, 0, 1]])
        out = []
        for b, branch in enumerate(BRANCHES[:2]):
            Ck = y[9 * b : 9 * b + 9].reshape(3, 3)
            X = C @ np.linalg.inv(Ck)
            D = X - np.trace(X) / 3.0 * np.eye(3)
            out += list((D @ Ck / branch.time).reshape(-1))
        lost = 0.0
        for b, branch in enumerate(BRANCHES[:2]):
            X = C @ np.linalg.inv(y[9 * b : 9 * b + 9].reshape(3, 3))
            D = X - np.trace(X) / 3.0 * np.eye(3)
            lost += 0.5 * branch.modulus / branch.time * np.trace(D @ D)
        return [*out, lost]

    start = [*np.eye(3).reshape(-1), *np.eye(3).reshape(-1), 0.0]
    done = solve_ivp(rates, (0.0, times[-1]), start, t_eval=times, rtol=1e-9, atol=1e-11)
    stress = []
    for time, y in zip(times, done.y.T, strict=True):
        F = np.array([[1.0, gamma(time), 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        tau = np.zeros((3, 3))
        for b, branch in enumerate(BRANCHES[:2]):
            push = F @ np.linalg.inv(y[9 * b : 9 * b + 9].reshape(3, 3)) @ F.T
            tau += branch.modulus * (push - np.trace(push) / 3.0 * np.eye(3))
        stress.append((tau @ np.linalg.inv(F).T).reshape(-1)[PLANE])
    return np.array(stress), done.y[-1]


@pytest.mark.parametrize("frequency", [0.3, 3.0, 40.0])
def test_small_cycles_have_the_moduli_of_the_series(frequency):
    """G′ and G″ to 1e-3 of |G*|, in first order of the step; what fades is told apart."""
    points = ViscousPoints(BRANCHES, False)
    lag = np.array([1j * frequency * branch.time for branch in BRANCHES])
    wanted = sum(np.array([branch.modulus for branch in BRANCHES]) * lag / (1.0 + lag))
    found = []
    for steps in (500, 1000):
        dt = 2.0 * math.pi / frequency / steps
        at = np.arange(steps + 1)
        P, _ = sheared(points, lambda time: 1e-5 * math.sin(frequency * time), dt * at)
        angle, n = 2.0 * math.pi / steps * at[1:], at[1:]
        fading = [(1.0 + dt / branch.time) ** -n for branch in BRANCHES]
        basis = np.column_stack([np.sin(angle), np.cos(angle), *fading])
        parts = np.linalg.lstsq(basis, P[:, 1], rcond=None)[0] / 1e-5
        found.append(complex(*parts[:2]))
    errors = [abs(one - wanted) for one in found]
    assert 0.45 < errors[1] / errors[0] < 0.55
    assert abs(2.0 * found[1] - found[0] - wanted) < 1e-3 * abs(wanted)


@pytest.mark.parametrize("case", ["relaxation", "cycle"])
def test_large_shear_follows_the_differential_equation(case):
    """Within 0.5 % of the largest stress, and first order in the step; energy too."""
    if case == "relaxation":
        gamma, end = (lambda t: 0.8 * min(t / 0.05, 1.0)), 2.0
    else:
        gamma, end = (lambda t: 0.8 * math.sin(2.0 * math.pi * t)), 1.5
    errors = []
    for steps in (400, 800):
        times = np.linspace(0.0, end, steps + 1)
        found, state = sheared(ViscousPoints(BRANCHES[:2], False), gamma, times)
        wanted, lost = exact_shear(gamma, times)
        errors.append(np.abs(found - wanted[1:]).max() / np.abs(wanted).max())
        dissipated = state[0, ViscousPoints(BRANCHES[:2], False).columns[DISSIPATED]].sum()
        assert dissipated == pytest.approx(lost[-1], rel=0.05)
    assert errors[1] < 0.02 and 0.45 < errors[1] / errors[0] < 0.6
    # Two lengths of step together are right to second order.
    coarse, _ = sheared(ViscousPoints(BRANCHES[:2], False), gamma, np.linspace(0.0, end, 401))
    better = 2.0 * found[1::2] - coarse
    assert np.abs(better - wanted[2::2]).max() < 0.005 * np.abs(wanted).max()


def test_an_endless_step_relaxes_all_and_loses_what_was_stored():
    points = ViscousPoints(BRANCHES, True)
    F = some(True)
    loaded = points.update(F, points.start(20), 1e-3, False)
    relaxed = points.update(F, loaded.state, math.inf, True)
    assert np.abs(relaxed.P).max() < 1e-14 and np.abs(relaxed.elastic).max() < 1e-14
    assert relaxed.valid and np.abs(loaded.P).max() > 0.1
    np.testing.assert_allclose(relaxed.dissipation, loaded.elastic, rtol=1e-12)
    # A deformation without rates costs nothing, and one that is slow next to nothing.
    for dt, bar in ((math.inf, 1e-14), (1e4, 1e-3)):
        slow = points.update(F, points.start(20), dt, False)
        assert slow.dissipation.max() < bar * loaded.elastic.max()


RATED = PlasticPoints(given.material("linear", "perzyna"), False)


@pytest.mark.parametrize(
    ("points", "shapes", "dt", "words"),
    [
        (RATED, ((2, 9), (2, 5)), 1.0, r"\(2, 9\), \(2, 5\), not"),
        (RATED, ((2, 5), (3, 5)), 1.0, r"\(3, 5\)"),
        (RATED, ((2, 5), (2, 5)), 0.0, "dt is 0"),
        (RATED, ((2, 5), (2, 5)), math.nan, "dt is nan"),
        (ViscousPoints(BRANCHES[:2], False), ((1, 5), (1, 12)), 0.0, "dt is 0"),
        (ViscousPoints(BRANCHES[:2], False), ((1, 5), (1, 12)), math.nan, "dt is nan"),
    ],
)
def test_wrong_shapes_and_steps_are_refused(points, shapes, dt, words):
    with pytest.raises(ValueError, match=words):
        points.update(*map(np.zeros, shapes), dt, False)
