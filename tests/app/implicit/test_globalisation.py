"""Which phases a step goes through: of Newton's method, and of starts and softer contacts."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from tests.app.equilibrium.test_equilibrium import coulomb
from tribox.app.equilibrium.step_mode import HoldingSprings, StepMode
from tribox.app.implicit.globalisation import (
    APPROACH,
    FAR,
    NEARLY,
    SEARCH,
    HeldApproach,
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
    WHOLE_STEPS,
    Inside,
    Newton,
    Patience,
    length_to_least_energy,
)
from tribox.app.implicit.options import ImplicitOptions
from tribox.app.implicit.predictor import Attempt


def attempt(
    near, contacts=1, pressed=True, loose=(), rubbing=False, moved=0.0, flows=False, bounded=False
):
    problem = SimpleNamespace(
        flows=flows,
        contacts=[None] * contacts,
        trials=[],
        committed=[],
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
    assert after(near=False, loose=[0], moved=1e-3, flows=True) == (inside, APPROACH)
    assert after(near=True, pressed=False) == (inside,)
    assert after(near=False, rubbing=True) == (inside, APPROACH)
    assert after(near=False, rubbing=True, moved=1e-3) == (APPROACH, inside)
    assert after(near=False, rubbing=True, moved=1e-3, flows=True) == (inside, APPROACH)
    assert after(near=True, rubbing=True) == ()
    assert after(near=True, rubbing=True, flows=True) == (inside,)
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


def test_a_body_that_floats_is_not_pushed_away_from_inside(monkeypatch):
    seen, given = Scripted(monkeypatch, [2]), attempt(near=False)
    given.newton.inside, given.newton.begin = Inside(last=True), lambda x: None
    given.step = given.step.held(HoldingSprings(np.ones(1), np.zeros(1), weak=True))
    assert solve(given) == (1, 2) and seen.ran == [PredictedStart()]


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
    newton._patience = Patience(patient=patient)
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


def made(pair):
    problem = pair().problem(coulomb(0.3))
    x = problem.new_vector()
    return Newton(problem, LinearSolver(problem, x), x, ImplicitOptions())


@pytest.mark.parametrize("phase", NEWTON_PHASES, ids=lambda phase: phase.name)
def test_whole_steps_at_the_end_have_the_derivative_of_what_touches(pair, monkeypatch, phase):
    newton = made(pair)
    newton.residual_of(StepMode())
    monkeypatch.setattr(Newton, "_iterate", lambda self: (0, 1))
    newton._run(phase, StepMode())
    (mode,) = newton._step.pairs(newton.problem.contacts)
    assert mode[1].only_pressed is (phase is NEWTON_PHASES[-1])
    assert not WHOLE_STEPS.only_pressed


def test_what_is_known_of_steps_from_inside_goes_on_with_a_run(pair):
    first, second = made(pair), made(pair)
    first.inside = Inside(last=True, opening=2)
    second.restore(first.snapshot())
    assert second.inside == first.inside


class Along:
    """A Newton step of one unit, along which the residual is given, of the way from its start."""

    def __init__(self, newton, monkeypatch, force):
        start, increment = newton.trial.copy(), newton.trial.copy()
        start.set(0.0)
        increment.set(0.0)
        increment.setValue(0, -1.0)
        for one in (start, increment):
            one.assemble()
        self.newton = newton

        def residual_of(step):
            newton._residual.set(0.0)
            newton._residual.array[0] = force(newton.trial.array_r[0])
            return newton._residual.norm()

        def begins(step):
            residual_of(step)
            return start, increment

        newton.trial.set(0.0)
        monkeypatch.setattr(newton, "residual_of", residual_of)
        monkeypatch.setattr(newton, "_increment", begins)

    @property
    def way(self):
        return float(self.newton.trial.array_r[0])


def test_a_step_on_a_tangent_without_stiffness_goes_the_other_way(pair, monkeypatch):
    """The energy falls towards −0.125, and the Newton step leads uphill."""
    along = Along(made(pair), monkeypatch, lambda x: x + 0.125)
    assert along.newton.step_to_least_energy(StepMode(), 1e-3, near=0.12) == 0.125
    assert along.way == pytest.approx(-0.125, abs=0.125 * ENOUGH)


def test_a_step_near_a_solution_is_not_turned_round(pair, monkeypatch):
    """There friction makes the work of its forces negative."""
    along = Along(made(pair), monkeypatch, lambda x: x + 0.125)
    assert along.newton.step_to_least_energy(StepMode(), 1e-3, near=0.13) == 0.125
    assert along.way == 1.0


@pytest.mark.parametrize("none", [np.nan, np.inf])
def test_a_step_to_where_there_are_no_numbers_is_halved(pair, monkeypatch, none):
    along = Along(made(pair), monkeypatch, lambda x: 1.0 if x < 0.3 else none)
    along.newton.step(StepMode(), falling=False)
    assert along.way == 0.25


@pytest.mark.parametrize(
    ("left", "rubs", "flows", "tried"),
    [
        (0.5 * FAR, False, True, [False]),
        (0.5 * FAR, True, True, [False]),
        (2.0 * FAR, False, True, []),
        (2.0 * FAR, True, False, []),
        (0.5 * NEARLY, True, True, [True]),
        (2.0 * NEARLY, True, True, []),
    ],
)
def test_after_a_step_from_inside_a_prediction_is_tried_where_it_may_be_near(
    left, rubs, flows, tried
):
    """Where bodies flow and rub it may be so further off, as long as each iteration gains."""
    given, seen = attempt(near=False, rubbing=rubs, flows=flows), []

    def solves(step, patient, hasty, eager):
        seen.append(eager)
        return 3, 2

    given.newton.residual_of, given.newton.solve = lambda step: left, solves
    given.newton.trial = SimpleNamespace(array_r=np.zeros(1))
    given.predictor.predict = lambda *given: 0
    assert PredictedStart(if_near=True).run(given) == ((3, 2) if tried else (0, -6))
    assert seen == tried


@pytest.mark.parametrize(
    ("residuals", "little"), [([0.2, 0.11], True), ([0.2, 0.09], False), ([1e-5, 9e-6], False)]
)
def test_an_eager_iteration_ends_where_it_gains_little(pair, residuals, little):
    newton, reasons = made(pair), PETSc.SNES.ConvergedReason
    before, last = residuals
    newton.problem.reference_force, newton._phase = 1.0, WHOLE_STEPS
    for eager in (True, False):
        newton.residuals, newton._patience = [before], Patience(eager=eager)
        ends = newton._test(newton.snes, 1, (0.0, 0.0, last))
        assert ends == (reasons.DIVERGED_LINE_SEARCH if eager and little else None)
