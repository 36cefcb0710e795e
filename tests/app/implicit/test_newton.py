"""Newton's method on the whole problem: its order, a platen, bodies without contact."""

import gc
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

import tribox.app.implicit.newton
import tribox.app.implicit.predictor
from tests.laws import FILM, coulomb, film_map
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit.linear_solver import LinearSolver
from tribox.app.implicit.newton import (
    ENOUGH,
    ImplicitOptions,
    Inside,
    Newton,
    length_to_least_energy,
)
from tribox.app.implicit.predictor import Predictor
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.forms.friction.law import Regime


@pytest.fixture
def unaided(monkeypatch):
    """Starts that only repeat the last increment, and a new tangent in every iteration.

    What the predictor and an old factorisation do for a step would hide the order of the method.
    """
    monkeypatch.setattr(tribox.app.implicit.predictor, "HIGHEST_ORDER", 1)
    monkeypatch.setattr(
        Predictor,
        "_continue",
        lambda self, x, trial, ratio, step: self._extrapolate(trial, ratio, step),
    )
    monkeypatch.setattr(tribox.app.implicit.newton, "REUSE_SAFETY", np.inf)


def pressed_and_slid(pair, law, film=0.0, moves=(), tolerance=1e-13):
    """Residual histories of steps that move the top by each of ``moves`` (x, y)."""
    blocks = pair("quadrilateral", (8, 4), (13, 3))
    bottom = [blocks.held("bottom", 0), blocks.held("bottom", 1)]
    top = [blocks.held("top", 0), blocks.held("top", 1)]
    problem = blocks.problem(law, film=film, degree=3, prescribed=[*bottom, *top])
    stepper = ImplicitStepper(problem, ImplicitOptions(tolerance=tolerance))
    results, regimes = [], []
    for move in moves:
        for held, value in zip(top, move, strict=True):
            held.value = value
        result = stepper.attempt(1.0)
        assert result.converged, result
        regimes.append(problem.trials[0].response.regime.copy())
        stepper.commit()
        results.append(result.residuals)
    return results, regimes


PRESS = [(0.0, -0.02 * i) for i in range(1, 4)]
FLOOR = 1e-13


def check_quadratic(histories):
    """r_{k+1} <= 20 r_k², down to round-off, once r is so small that no point changes sides.

    A tangent that lacks a term gains a constant factor in each iteration instead.
    """
    counted = 0
    for residuals in histories:
        for before, after in pairwise(residuals):
            if before < 5e-3:
                assert after < 20.0 * before**2 + FLOOR, residuals
                counted += after > FLOOR
    assert counted >= len(histories)


@pytest.mark.usefixtures("unaided")
@pytest.mark.parametrize(
    ("law", "film", "step", "regime"),
    [
        (coulomb(0.3), 0.0, 0.03, Regime.SLIP),
        (film_map(), FILM, 0.03, Regime.MIXED),
        (film_map(V_star=1e-3), FILM, 0.03, Regime.VISCOUS),
    ],
    ids=["coulomb", "mixed", "viscous"],
)
def test_newton_ends_quadratically_in_sliding(pair, law, film, step, regime):
    slide = [(step * i, -0.06) for i in range(1, 12)]
    results, regimes = pressed_and_slid(pair, law, film, PRESS + slide)
    gross = [i for i, found in enumerate(regimes) if (found == regime).all()]
    assert len(gross) >= 5
    check_quadratic([results[i] for i in gross])


@pytest.mark.usefixtures("unaided")
def test_newton_ends_quadratically_at_the_onset_of_slip(pair):
    slide = [(0.01 * i, -0.06) for i in range(1, 8)]
    results, regimes = pressed_and_slid(pair, coulomb(0.3), 0.0, PRESS + slide)
    sliding = [int(np.count_nonzero(found == Regime.SLIP)) for found in regimes]
    points = len(regimes[0])
    onset = [i for i in range(1, len(sliding)) if sliding[i - 1] < sliding[i] <= points]
    partly = [i for i in onset if sliding[i] < points]
    assert len(onset) >= 3 and partly, sliding
    check_quadratic([results[i] for i in onset])


@pytest.mark.parametrize("kind", [KeyboardInterrupt, FloatingPointError])
@pytest.mark.parametrize("within", ["residual", "jacobian"])
def test_what_comes_up_within_petsc_is_raised_as_it_is(pair, monkeypatch, request, kind, within):
    def rises(*args, **options):
        raise kind("in the middle")

    blocks = pair()
    problem = blocks.problem(None, prescribed=[blocks.held("top", 0), blocks.held("bottom", 0)])
    problem.prescribed[0].value = 0.1
    newton = ImplicitStepper(problem).newton
    monkeypatch.setattr(problem, within, rises)
    request.addfinalizer(partial(gc.set_threshold, *gc.get_threshold()))
    gc.set_threshold(20)  # garbage collected under way once cost the interpreter its life
    with pytest.raises(kind, match="in the middle"):
        newton.solve(StepMode())


# -- Which phases a step goes through: of Newton's method, and of starts and softer contacts -------


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


def test_what_is_known_of_steps_from_inside_goes_on_with_a_run(pair):
    first, second = made(pair), made(pair)
    first.inside = Inside(last=True, opening=2, softly=True)
    second.restore(first.snapshot())
    assert second.inside == first.inside
