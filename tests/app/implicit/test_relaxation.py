"""Bodies that follow springs, which give way, to an equilibrium."""

from types import SimpleNamespace

import pytest

from tests.app.implicit.test_interior_point import FRICTIONLESS, bending, strip
from tests.solved import built
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit.globalisation import FirmSprings, PredictedStart, SoftContact
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


def found(comm, directory):
    """Forces of both contacts, solved as usual and by relaxation, and what is said of these."""
    case, out = strip([40, 2], 0.06, bending(6e-4), 4, FRICTIONLESS, METAL), []
    for fails in (False, True):
        simulation = built(case, comm)
        stepper, problem = simulation.stepper, simulation.model.problem
        stepper.rate_dependent = False
        simulation.model.set_loads(0.25, 0.0)
        with pytest.MonkeyPatch.context() as patch:
            if fails:
                patch.setattr(PredictedStart, "run", lost)
                patch.setattr(FromInside, "run", lost)
                patch.setattr(SoftContact, "run", lost)
                patch.setattr(FirmSprings, "run", lost)
                assert not stepper.attempt(0.25).converged
                stepper.failures = 1
            result = stepper.attempt(0.25)
        pairs = zip(problem.contacts, problem.trials, strict=True)
        forces = [term.surface.slave.weight @ trial.pressure for term, trial in pairs]
        exact = StepMode.of_stage(0.25, problem.contacts, False)
        assert result.converged and exact.holding is None
        assert stepper.newton.residual_of(exact) <= 1e-8
        out.append([result.relaxed, *(comm.allreduce(float(force)) for force in forces)])
    return out


@pytest.mark.mpi(found, 2)
def test_metal_is_relaxed_to_the_exact_equilibrium_where_a_cut_has_not_helped(on_ranks):
    """Nothing of the springs is left in what is committed, on one rank or two."""
    (usual, *expected), (relaxed, *forces) = on_ranks(found, 1)
    assert (usual, relaxed) == (False, True)
    assert forces == pytest.approx(expected, rel=1e-5) and min(expected) > 0.0
    for mine, other in zip(on_ranks(found, 2), on_ranks(found, 1), strict=True):
        assert mine == pytest.approx(other, rel=1e-6)


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
