"""Which phases a step goes through: of Newton's method, and of starts and softer contacts."""

import numpy as np
import pytest

from tests.app.equilibrium.test_equilibrium import coulomb
from tribox.app.implicit.linear_solver import LinearSolver
from tribox.app.implicit.newton import ENOUGH, Inside, Newton, length_to_least_energy
from tribox.app.implicit.options import ImplicitOptions


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
    first.inside = Inside(last=True, opening=2)
    second.restore(first.snapshot())
    assert second.inside == first.inside
