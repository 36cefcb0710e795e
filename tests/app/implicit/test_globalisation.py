"""Which phases a step goes through: of Newton's method, and of starts and softer contacts."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit.approach import HeldApproach
from tribox.app.implicit.attempt import Attempt
from tribox.app.implicit.globalisation import (
    APPROACH,
    SEARCH,
    LinearStart,
    PredictedStart,
    SoftContact,
    phases_after,
    solve,
)
from tribox.app.implicit.interior_point import FromInside
from tribox.app.implicit.linear_solver import LinearSolver
from tribox.app.implicit.newton import (
    EDGED,
    ENOUGH,
    KINKED,
    NEWTON_PHASES,
    STALLED,
    Inside,
    Newton,
    length_to_least_energy,
)
from tribox.app.implicit.options import ImplicitOptions


def attempt(
    near, contacts=1, pressed=True, loose=(), rubbing=False, moved=0.0, flows=False, bounded=False
):
    problem = SimpleNamespace(
        flows=flows,
        contacts=[None] * contacts,
        comm=MPI.COMM_SELF,
        constrained_values=lambda x: x.array_r + moved,
    )
    x = SimpleNamespace(array_r=np.zeros(1))
    newton = SimpleNamespace(problem=problem, trial=None, is_near=lambda: near, is_bounded=bounded)
    bodies = SimpleNamespace(directions=loose)
    predictor = SimpleNamespace(rubbing=lambda: rubbing)
    return Attempt(newton, predictor, x, StepMode(), pressed, bodies)


def test_what_is_tried_after_the_prediction_depends_on_where_it_failed():
    held, inside = HeldApproach(), FromInside("others")

    def after(*given, **more):
        return phases_after(attempt(*given, **more), inside)

    assert after(near=False) == (inside, APPROACH)
    assert after(near=False, bounded=True) == (LinearStart(),)  # films bound the steps
    assert after(near=False, pressed=False) == (inside, APPROACH, SEARCH)
    assert after(near=False, loose=[0]) == (inside, APPROACH, held)
    assert after(near=False, pressed=False, loose=[0]) == (held, inside, APPROACH, SEARCH)
    driven = {"near": False, "pressed": False, "loose": [0], "moved": 1e-3}
    assert after(**driven) == (inside, held, APPROACH, SEARCH)
    assert after(near=True, pressed=False) == (inside,)
    assert after(near=False, rubbing=True) == (inside, APPROACH)
    assert after(near=False, rubbing=True, moved=1e-3) == (APPROACH, inside)
    assert after(near=False, rubbing=True, moved=1e-3, flows=True) == (inside, APPROACH)
    assert after(near=True, rubbing=True) == ()
    for near in (True, False):
        assert after(near, contacts=0) == (LinearStart(),)


class Scripted:
    """A phase whose results are given, one a call, and the phases that ran."""

    def __init__(self, monkeypatch, reasons):
        self.ran, reasons = [], iter(reasons)

        def run(phase, attempt):
            self.ran.append(phase)
            return 1, next(reasons)

        for kind in (PredictedStart, FromInside, SoftContact):
            monkeypatch.setattr(kind, "run", run)


@pytest.mark.parametrize(
    ("last", "reasons", "ran", "after"),
    [
        (False, [2], [PredictedStart()], False),
        (False, [-6, 2], [PredictedStart(), FromInside()], True),
        (True, [-6, 2], [PredictedStart(if_near=True), FromInside("last")], True),
        (True, [2], [PredictedStart(if_near=True)], False),
        (
            True,
            [-6, -6, -6, -6, -6],
            [
                PredictedStart(if_near=True),
                FromInside("last"),
                PredictedStart(),
                FromInside("others"),
                APPROACH,
            ],
            False,
        ),
    ],
)
def test_a_step_after_one_found_from_inside_begins_there(monkeypatch, last, reasons, ran, after):
    seen, given = Scripted(monkeypatch, reasons), attempt(near=False)
    given.newton.inside, given.newton.begin = Inside(last), lambda x: None
    given.start, given.newton.trial = np.zeros(1), SimpleNamespace(array=np.zeros(1))
    iterations, reason = solve(given)
    assert (iterations, reason, seen.ran) == (len(ran), reasons[-1], ran)
    assert given.newton.inside.last is after


@pytest.mark.parametrize(
    ("ends", "ran"),
    [
        ([(0.5, -6)], ["line search"]),
        ([(1e-9, 2)], ["line search"]),
        ([(STALLED, -6), (1e-9, 2)], ["line search", "whole steps"]),
        ([(EDGED, -6), (1e-9, 2)], ["line search", "frozen facets"]),
        ([(2.0 * EDGED, -6), (1e-9, 2)], ["line search", "whole steps"]),
        ([(KINKED, -6), (1e-9, 2)], ["line search", "frozen facets"]),
        ([(KINKED, -6), (0.5, -6)], ["line search", "frozen facets"]),
        ([(KINKED, -6), (1e-6, -6), (1e-7, -6)], [phase.name for phase in NEWTON_PHASES]),
    ],
)
def test_a_phase_runs_where_the_one_before_came_near_enough(pair, monkeypatch, ends, ran):
    """Each phase ends with a residual and a reason; iterations add up, the last reason counts."""
    problem = pair().problem(None)
    x = problem.new_vector()
    newton = Newton(problem, LinearSolver(problem, x), x, ImplicitOptions())
    names, left = [], iter(ends)

    def run(self, phase, step):
        names.append(phase.name)
        residual, reason = next(left)
        self.residuals = [residual] if phase.starts_over else [*self.residuals, residual]
        return 3, reason

    monkeypatch.setattr(Newton, "_run", run)
    assert newton.solve(StepMode()) == (3 * len(ran), ends[-1][1])
    assert names == ran


@pytest.mark.parametrize("patient", [True, False])
def test_patience_lets_a_phase_stall_far_from_the_solution_only(pair, patient):
    problem = pair().problem(None)
    x = problem.new_vector()
    newton = Newton(problem, LinearSolver(problem, x), x, ImplicitOptions())
    newton._patient = patient
    for last, stalled in ((2.0 * STALLED, not patient), (0.5 * STALLED, True)):
        newton.residuals = list(np.linspace(1.05, 1.0, 5) * last)
        assert newton._is_stalled() == stalled
    newton.residuals = list(np.linspace(2.0, 1.0, 5) * STALLED)
    assert not newton._is_stalled()


@pytest.mark.parametrize(
    ("work", "first", "where"),
    [
        (lambda a: 1.0 - 0.9 * a, 1.0, 1.0),  # Newton's step as it should be
        (lambda a: 1.0 - 0.2 * a, 1.0, 1.0),  # never longer than that
        (lambda a: 1.0 - 5.0 * a, 1.0, 0.2),
        (lambda a: 1.0 - 25.0 * a**2, 1.0, 0.2),
        (lambda a: 1.0 - 10.0 * a if a < 0.4 else -np.inf, 1.0, 0.1),
        (lambda a: 1.0 + 8.0 * a, -1e-3, -0.125),  # uphill: the other way
        (lambda a: 1.0 + 8.0 * a if a > -0.2 else -np.inf, -0.05, -0.125),
    ],
)
def test_a_step_ends_where_the_forces_along_it_do_no_more_work(work, first, where):
    tried = []

    def asked(length):
        tried.append(length)
        return work(length)

    length = length_to_least_energy(asked, first)
    assert length == tried[-1] and len(tried) <= 12
    assert length == 1.0 == where or abs(work(length)) <= ENOUGH


def test_a_step_of_which_no_length_is_good_ends_where_there_are_numbers():
    """The last length may have none; the one nearest to the start that had them is made then."""
    tried = []

    def asked(length):
        tried.append(length)
        return 1.0 if abs(length) < 1e-3 else -np.inf

    assert 0.0 < length_to_least_energy(asked, 1.0) == tried[-1] < 1e-3
