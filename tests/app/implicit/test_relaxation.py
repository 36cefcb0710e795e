"""Bodies that follow springs, which give way, to an equilibrium."""

from types import SimpleNamespace

import pytest

from tests.app.implicit.test_interior_point import FRICTIONLESS, bending, strip
from tests.solved import built
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit.globalisation import PredictedStart
from tribox.app.implicit.interior_point import FromInside
from tribox.app.implicit.relaxation import Pace
from tribox.app.implicit.stepper import StepResult
from tribox.app.simulation.watches import RelaxationWatch

METAL = {"material": "AA1050-O"}


def lost(_phase, attempt):
    """A phase that ends at the linear step, as if that were all it had found."""
    attempt.predictor.restart(attempt.x, attempt.trial, attempt.step)
    attempt.start = attempt.trial.array_r.copy()
    return 0, -1


def forces(stepper):
    pairs = zip(stepper.problem.contacts, stepper.problem.trials, strict=True)
    return [term.surface.slave.weight @ trial.pressure for term, trial in pairs]


def test_metal_is_relaxed_to_the_exact_equilibrium_where_a_cut_has_not_helped(monkeypatch):
    """Nothing of the springs is left in what is committed."""
    case = strip([40, 2], 0.06, bending(6e-4), 4, FRICTIONLESS, METAL)
    expected = []
    for fails in (False, True):
        simulation = built(case)
        stepper = simulation.stepper
        stepper.rate_dependent = False
        simulation.model.set_loads(0.25, 0.0)
        if fails:
            monkeypatch.setattr(PredictedStart, "run", lost)
            monkeypatch.setattr(FromInside, "run", lost)
            assert not stepper.attempt(0.25).converged
        result = stepper.attempt(0.25)
        assert result.converged and result.relaxed == fails
        expected.append(forces(stepper))
    assert expected[1] == pytest.approx(expected[0], rel=1e-5) and min(expected[0]) > 0.0
    exact = StepMode.of_stage(0.25, stepper.problem.contacts, False)
    assert exact.holding is None and stepper.newton.residual_of(exact) <= 1e-8


def test_springs_follow_the_forces_that_they_carry():
    pace = Pace(8.0)
    pace.fail()  # nothing was solved before: only the first stiffness is being found
    assert (pace.stiffness, pace.waits) == (32.0, 0)
    pace.follow(0.1)
    assert pace.stiffness == pytest.approx(32.0 / 1.5)
    pace.follow(0.2)  # the bodies snap
    assert pace.stiffness == pytest.approx(32.0 / 1.5 * 2.0 / 1.5)
    before = pace.stiffness
    pace.fail()
    pace.follow(0.2)
    assert pace.stiffness == pytest.approx(4.0 * before) and pace.waits == 1
    pace.follow(0.002)
    assert pace.stiffness == pytest.approx(4.0 * before / 3.0)


def test_relaxed_steps_are_warned_of_once_and_after_a_restart():
    watch, again = RelaxationWatch(), RelaxationWatch()
    for number, relaxed in enumerate([False, True, True]):
        row = SimpleNamespace(when=f"time {number} s, stage press")
        watch.step(row, StepResult(True, 1, 1, 2, [1e-9], relaxed=relaxed))
    again.restore(watch.snapshot())
    [line] = again.warnings()
    assert "relaxed by springs in 2 steps (first at time 1 s, stage press)" in line
    assert not list(RelaxationWatch().warnings())
