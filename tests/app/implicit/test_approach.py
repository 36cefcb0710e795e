"""When bodies that only contact holds are brought together on springs, and at what pace."""

from __future__ import annotations

from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.implicit import globalisation
from tribox.app.implicit.globalisation import (
    HeldApproach,
    Pace,
    distance,
    is_adrift,
    strays,
    unbalanced_loads,
)

LENGTH = 0.2  # m, of the slave's facets


def contact(gap, on_surface=None, closed=False):
    """A pair and its trial with the gaps of its points."""
    gap = np.asarray(gap, dtype=float)
    on_surface = np.ones(len(gap), dtype=bool) if on_surface is None else np.array(on_surface)
    at = SimpleNamespace(gap=gap, on_surface=on_surface)
    kinematics = SimpleNamespace(closed=np.full(len(gap), closed))
    return SimpleNamespace(projection=at, kinematics=kinematics)


def attempt_of(*trials, way=0.0, pressed=False, directions=1):
    """A step whose predicted start moves the loose body by ``way``."""
    term = SimpleNamespace(surface=SimpleNamespace(facet_length=LENGTH))
    problem = SimpleNamespace(
        trials=trials,
        contacts=[term] * len(trials),
        comm=MPI.COMM_SELF,
        constrained_values=lambda x: x.array_r,
    )
    bodies = SimpleNamespace(
        directions=["y"] * directions, moved=lambda change: np.atleast_1d(change.sum())
    )
    return SimpleNamespace(
        newton=SimpleNamespace(problem=problem),
        bodies=bodies,
        pressed=pressed,
        x=SimpleNamespace(array_r=np.zeros(2)),
        start=np.array([0.0, way]),
        trial=SimpleNamespace(array=np.zeros(2)),
    )


@pytest.mark.parametrize("way", [-1.1, 1.1, np.nan])
def test_a_start_that_moves_a_loose_body_by_a_facet_strays(way):
    assert strays(attempt_of(contact([0.1]), way=way * LENGTH))
    assert not strays(attempt_of(contact([0.1]), way=0.9 * LENGTH))
    assert not strays(attempt_of(contact([0.1]), way=way * LENGTH, pressed=True))
    assert not strays(attempt_of(contact([0.1]), way=way * LENGTH, directions=0))


def test_a_loose_body_under_load_that_touches_nothing_is_adrift(monkeypatch):
    loads = np.array([2.0])
    monkeypatch.setattr(globalisation, "unbalanced_loads", lambda attempt: loads)
    apart, touching = contact([0.1, 0.2]), contact([0.0, 0.2], closed=True)
    assert is_adrift(attempt_of(apart))
    assert not is_adrift(attempt_of(touching))
    assert not is_adrift(attempt_of(apart, touching))
    assert not is_adrift(attempt_of(apart, pressed=True))
    assert not is_adrift(attempt_of(apart, directions=0))
    loads[:] = 0.0
    assert not is_adrift(attempt_of(apart))


def test_what_rounding_leaves_is_no_load():
    """Springs for it would be nothing, and the body as free as without them."""
    attempt = attempt_of(contact([0.1]))
    problem, residual = attempt.newton.problem, MagicMock()
    problem.roundoff, problem.new_vector = 1e-9, lambda: residual
    problem.residual = lambda *arguments: None
    attempt.step, attempt.bodies.sums = None, lambda forces: np.array([-3e-10, -2.0, 2e-9])
    np.testing.assert_array_equal(unbalanced_loads(attempt), [0.0, 2.0, 2e-9])


@pytest.mark.parametrize("pressed", [False, True])
def test_bodies_in_balance_approach_by_soft_contacts_where_they_pressed(monkeypatch, pressed):
    """Without springs; where nothing has pressed yet there is no way to begin with."""
    attempt = attempt_of(contact([0.1]), pressed=pressed)
    balance = np.zeros(1)
    monkeypatch.setattr(globalisation, "unbalanced_loads", lambda attempt: balance)
    attempt.newton = MagicMock(problem=attempt.newton.problem)
    attempt.newton.search.return_value = 3, 1
    attempt.trial = MagicMock(array=np.zeros(2), array_r=np.zeros(2))
    attempt.step, attempt.predictor, attempt.bodies = MagicMock(), MagicMock(), MagicMock()
    attempt.predictor.restart.return_value, attempt.bodies.sums.return_value = 1, balance
    iterations, reason = HeldApproach().run(attempt)
    assert (iterations, reason > 0) == ((1 + 3 + 3, True) if pressed else (0, False))
    for call in attempt.bodies.held.call_args_list:
        np.testing.assert_array_equal(call.args[0], [0.0])
    assert bool(attempt.bodies.held.call_args_list) == pressed


def test_distance_is_the_longest_of_the_pairs_shortest_ways():
    """Points with no master below them do not count."""
    near = contact([0.3, 0.05, 0.2], [True, True, True])
    far = contact([0.01, 0.4, 0.7], [False, True, True])
    nothing = contact([0.9], [False])
    assert distance(attempt_of(near).newton.problem) == 0.05
    assert distance(attempt_of(near, far, nothing).newton.problem) == 0.4
    assert distance(attempt_of(nothing).newton.problem) == 0.0


def test_pace_grows_while_stages_are_solved_and_is_careful_after_one_that_failed():
    pace = Pace(1.0)
    assert [pace.next(True) for _ in range(2)] == [5.0, 25.0]
    assert pace.next(False) == 6.25 and pace.failures == 1
    assert pace.next(True) == 12.5
    softness = [pace.soft]
    for _ in range(3):
        pace.misled()
        softness.append(pace.soft)
    np.testing.assert_allclose(softness, [0.03, 0.18, 1.0, 1.0], rtol=1e-12)
