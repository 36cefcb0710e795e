"""What start the predictor chooses: a problem whose solutions are known, state by state."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit.predictor import CORRECTIONS, Predictor


class Known:
    """A problem solved by ``path(load)``, and a solver that knows its tangent.

    The first two unknowns are prescribed: they are the two numbers in ``held``. The residual of the
    others is their distance from the solution, as long as that is less than ``basin``; beyond, it
    only tells the direction and is large. A solve gives ``share`` of the right increment.

    Attributes:
        reference_force: what a residual is compared with.
        seen: all unknowns whose residual was evaluated.
        solves: how often the solver was asked; steps: how often for a linear step.
    """

    comm = MPI.COMM_SELF

    def __init__(self, path: Callable[[float], list[float]]) -> None:
        self.path = path
        self.load, self.held = 0.0, np.zeros(2)
        self.platens = [SimpleNamespace(pull=lambda displacement: self.load)]
        self.loads: list[SimpleNamespace] = []
        self.nodal_loads: list[SimpleNamespace] = []
        self.trials: list[SimpleNamespace] = []
        self.contacts: list[SimpleNamespace] = []
        self.solids: list[SimpleNamespace] = []
        self.direct, self.works, self.share, self.basin = True, True, 1.0, np.inf
        self.reference_force = np.inf
        self.rounding = SimpleNamespace(is_within_reach=lambda x: bool(np.isfinite(x.norm())))
        self.seen: list[np.ndarray] = []
        self.solves = self.steps = 0
        self.x, self.trial = self.new_vector(), self.new_vector()
        self.predictor = Predictor(self, self)

    def solution(self) -> np.ndarray:
        return np.array([*self.held, *self.path(self.load)])

    def new_vector(self) -> PETSc.Vec:
        return PETSc.Vec().createWithArray(np.zeros(2 + len(self.path(0.0))), comm=self.comm)

    def constrained_dofs(self) -> np.ndarray:
        return np.array([0, 1])

    def constrained_values(self, x: PETSc.Vec) -> np.ndarray:
        return np.array([*self.held, *x.array_r[2:]])

    def residual(self, snes: None, x: PETSc.Vec, f: PETSc.Vec, step: StepMode) -> None:
        self.seen.append(x.array_r.copy())
        apart = x.array_r - self.solution()
        f.array[:] = np.where(np.abs(apart) < self.basin, apart, 1e3 * np.sign(apart))

    def solve(self, rhs: PETSc.Vec, solution: PETSc.Vec, on_path: bool = False) -> bool:
        self.solves += 1
        solution.array[:] = self.share * rhs.array_r
        return self.works

    def solve_from(
        self, x: PETSc.Vec, rhs: PETSc.Vec, increment: PETSc.Vec, step: StepMode
    ) -> bool:
        self.steps += 1
        increment.array[2:] = rhs.array_r[2:]
        return True

    def go(self, load: float, *held: float) -> None:
        """Solve the step to this load and take it into the path."""
        self.put(load, *held)
        self.trial.array[:] = self.solution()
        self.predictor.commit(self.x, self.trial)
        self.trial.copy(self.x)

    def put(self, load: float, *held: float) -> None:
        """The load and prescribed values (default: all of it is load)."""
        self.load = load
        self.held = np.array(held or (0.0, 0.0))

    def start(self, load: float, *held: float) -> np.ndarray:
        """Where the step to this load starts."""
        self.put(load, *held)
        self.seen.clear()
        self.solves = self.steps = 0
        self.factorisations = self.predictor.predict(self.x, self.trial)
        assert self.factorisations == self.steps
        return self.trial.array_r.copy()


def curved(s: float) -> list[float]:
    """A path of third order."""
    return [1.0 + s, s**2 - s, 0.3 * s**3 - s]


def along(problem: Known, *loads: float) -> Known:
    for load in loads:
        problem.go(load)
    return problem


def test_a_path_is_continued_to_third_order_by_steps_of_any_length():
    problem = along(Known(curved), 0.0, 0.5, 0.7, 1.5)
    problem.share = 0.0  # what follows is the extrapolation's alone
    start = problem.start(2.7)
    assert problem.factorisations == 0
    np.testing.assert_allclose(start, problem.solution(), atol=1e-12)


def test_past_a_kink_the_line_through_the_last_two_states_is_best():
    problem = along(Known(lambda s: [abs(s - 2.0)]), 0.0, 1.0, 2.0, 3.0)
    problem.share = 0.0
    np.testing.assert_allclose(problem.start(4.0), [0.0, 0.0, 2.0], atol=1e-13)


def test_one_correction_with_the_last_tangent_ends_what_the_extrapolation_began():
    """The correction starts from the residual of the best order, not of the one tried last."""
    problem = along(Known(lambda s: [abs(s - 2.0) + 0.01 * s**2]), 0.0, 1.0, 2.0, 3.0)
    start = problem.start(4.0)
    np.testing.assert_allclose(start, problem.solution(), atol=1e-13)
    assert problem.solves == 1 and problem.steps == 0


@pytest.mark.parametrize("fault", ["wrong", "small", "failed", "not a number"])
def test_a_correction_that_does_not_pay_is_undone(fault):
    problem = along(Known(lambda s: [s**4]), 0.0, 1.0, 2.0, 3.0)
    problem.share = {"wrong": -1.0, "small": 0.4, "failed": 1.0, "not a number": np.nan}[fault]
    problem.works = fault != "failed"
    start = problem.start(4.0)
    assert all(np.isfinite(x).all() for x in problem.seen)
    problem.share = 0.0
    np.testing.assert_array_equal(start, problem.start(4.0))
    assert 0.0 < abs(start[2] - 4.0**4) < 4.0**4 - 3.0**4


def test_where_the_extrapolation_leads_astray_the_last_state_is_corrected():
    """The path ends at a load of 3: the tangent knows, from the last state, the line does not."""
    problem = along(Known(lambda s: [10.0 * min(s, 3.0) + 0.1 * s]), 0.0, 1.0, 2.0, 3.0)
    problem.basin = 1.0
    start = problem.start(3.5)
    np.testing.assert_allclose(start, problem.solution(), atol=1e-12)
    problem.share = 0.6  # of a tangent that is not quite right
    left = problem.start(3.5) - problem.solution()
    assert left[2] == pytest.approx(-0.05 * 0.4**CORRECTIONS, rel=1e-6)
    assert CORRECTIONS > 1


@pytest.mark.parametrize(("rubs", "force"), [(False, 1.0), (False, 1e4), (True, 1.0)])
def test_where_nothing_rubs_a_start_far_off_is_replaced_by_the_linear_step(rubs, force):
    problem = along(Known(lambda s: [s**4]), 0.0, 1.0, 2.0, 3.0)
    problem.share, problem.reference_force = 0.0, force
    slope = np.full(1, float(rubs))
    problem.trials = [SimpleNamespace(response=SimpleNamespace(d_traction_d_slip=slope))]
    start = problem.start(4.0)
    replaced = not rubs and force == 1.0
    assert problem.steps == replaced
    assert (start[2] == pytest.approx(4.0**4)) == replaced


def test_the_last_state_is_corrected_with_the_current_prescribed_values():
    problem = Known(lambda s: [0.0])
    for value in (0.0, 1.0, 2.0, 3.0):
        problem.path = lambda s, value=value: [10.0 * value]
        problem.go(0.0, value, 0.5 * value)
    problem.path = lambda s: [30.1]
    problem.basin = 1.0
    np.testing.assert_allclose(problem.start(0.0, 3.5, 1.75), problem.solution(), atol=1e-12)
    assert any(np.array_equal(x, [3.5, 1.75, 30.0]) for x in problem.seen)


# -- when the path goes on ------------------------------------------------------------------------


def test_the_first_step_is_linear_from_the_state_at_hand():
    problem = Known(curved)
    np.testing.assert_allclose(problem.start(0.4, 0.1, 0.2), problem.solution(), atol=1e-14)
    assert problem.factorisations == 1
    assert problem.predictor.restart(problem.x, problem.trial) == 1
    np.testing.assert_allclose(problem.trial.array_r, problem.solution(), atol=1e-14)


def both(problem: Known, *states: tuple[float, float, float]) -> Known:
    for state in states:
        problem.go(*state)
    return problem


STRAIGHT = ((0.0, 0.0, 0.0), (1.0, 1.0, 2.0), (2.0, 2.0, 4.0))


@pytest.mark.parametrize(
    ("step", "goes_on"),
    [
        ((3.0, 3.0, 6.0), True),
        ((2.5, 2.5, 5.0), True),
        ((3.0, 3.0, 6.1), False),  # another direction of the prescribed displacements
        ((3.1, 3.0, 6.0), False),  # a load that lags
        ((2.0, 3.0, 6.0), False),
        ((3.0, 2.0, 4.0), False),  # the load alone goes on
        ((1.0, 1.0, 2.0), False),  # back
    ],
)
def test_the_path_goes_on_where_all_that_drives_it_does(step, goes_on):
    problem = both(Known(curved), *STRAIGHT)
    problem.start(*step)
    assert problem.factorisations == (0 if goes_on else 1)


def test_a_turn_under_constant_load_ends_the_path():
    problem = both(Known(curved), (1.0, 1.0, 2.0), (1.0, 2.0, 4.0))
    problem.start(1.0, 3.0, 6.0)
    assert problem.factorisations == 0
    problem.start(1.0, 3.0, 6.0 + 1e-6)
    assert problem.factorisations == 1


def test_after_a_turn_the_path_begins_again():
    """The step of the turn is continued along its line, whatever came before."""
    problem = both(Known(curved), *STRAIGHT)
    turn = problem.x.array_r.copy()
    problem.path = lambda s: [2.0, 0.0, 7.0]
    problem.go(2.0, 2.0, 5.0)
    last = problem.x.array_r.copy()
    problem.share = 0.0
    problem.start(2.0, 2.0, 6.0)
    assert problem.factorisations == 0
    tried = np.unique([x for x in problem.seen if x[1] == 6.0], axis=0)
    expected = np.unique([2.0 * last - turn, [2.0, 6.0, *last[2:]]], axis=0)
    np.testing.assert_allclose(tried, expected, atol=1e-12)


def test_where_nothing_moves_the_start_is_the_last_state():
    problem = both(Known(curved), *STRAIGHT, STRAIGHT[-1])
    np.testing.assert_array_equal(problem.start(*STRAIGHT[-1]), problem.x.array_r)
    assert problem.factorisations == 0 and not problem.seen


def test_contacts_that_forget_their_path_start_from_the_last_state():
    """As films in steady states do: with what is prescribed, and without a look at the residual."""
    problem = both(Known(curved), *STRAIGHT)
    problem.contacts = [SimpleNamespace(forgets=True)]
    expected = problem.x.array_r.copy()
    expected[:2] = 3.0, 6.0
    np.testing.assert_array_equal(problem.start(3.0, 3.0, 6.0), expected)
    assert problem.factorisations == 0 and not problem.seen


def test_each_step_is_measured_by_the_one_before_it():
    """Increments, not totals: of loads alone, and after a step of another length."""
    problem = along(Known(lambda s: [2.0 * s]), 5.0, 6.0, 6.5, 8.5)
    problem.share = 0.0
    np.testing.assert_allclose(problem.start(9.5), [0.0, 0.0, 19.0], atol=1e-12)
    assert problem.factorisations == 0
