"""Which bodies keep the tangent of their undeformed state, and what that does to a solution."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.conftest import BLOCK, BOXES
from tribox.app.build.model import body_dofs, build_model
from tribox.app.case.case import Case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation


def model_of(text=BLOCK, comm=MPI.COMM_SELF, **changes):
    """The model of a case without compiled loops; two underscores in a change are a dot."""
    data = tomllib.loads(text)
    for key, value in changes.items():
        *path, last = key.split("__")
        table = data
        for name in path:
            table = table[name]
        table[last] = value
    model = build_model(Case.model_validate(data), comm)
    bodies = model.problem.bodies
    bodies.cells = [None] * len(bodies.solids)
    return model


def moved(model, motion, name="aluminium"):
    """Displacements by ``motion`` of places (n, i), m, of one body, the others at rest."""
    problem = model.problem
    x, dofs = problem.new_vector(), body_dofs(model, name)
    place = problem.space.tabulate_dof_coordinates()[:, : problem.dim]
    x.array[dofs] = motion(place[dofs[:, 0] // problem.dim])
    return x


def stretched(size):
    return lambda place: size * place * np.eye(place.shape[1])[1]


def turned(angle):
    c, s = np.cos(angle) - 1.0, np.sin(angle)
    return lambda place: np.stack(
        [c * place[:, 0] - s * place[:, 1], s * place[:, 0] + c * place[:, 1]], axis=1
    )


def assembled(model, x, allowed=True):
    """The tangent at ``x``, a new matrix, and which bodies kept theirs."""
    problem = model.problem
    problem.tangent.undeformed.allowed = allowed
    A = problem.new_matrix(x)
    problem.assemble_tangent(x, A)
    return A, problem.tangent.undeformed.on


def difference(A, B):
    """Of two matrices, over the second."""
    D = A.copy()
    D.axpy(-1.0, B)
    return D.norm() / B.norm()


@pytest.fixture(scope="module")
def block():
    return model_of()


def test_a_stiff_body_that_hardly_moves_keeps_its_tangent(block):
    for size in (1e-7, 1e-6):
        x = moved(block, stretched(size))
        A, kept = assembled(block, x)
        exact, none = assembled(block, x, allowed=False)
        assert (kept, none) == ((False, True), (False, False))
        assert 1e-2 * size < difference(A, exact) < 20.0 * size


def test_bodies_with_a_compiled_loop_have_none():
    model = build_model(Case.model_validate(tomllib.loads(BLOCK)), MPI.COMM_SELF)
    assert all(model.problem.bodies.cells)
    assert assembled(model, model.problem.new_vector())[1] == (False, False)


@pytest.mark.parametrize("motion", [stretched(1e-3), turned(1e-3), turned(np.pi)])
def test_a_strain_or_a_rotation_ends_it(block, motion):
    """A rotation has no strain, and turns the tangent all the same."""
    x = moved(block, motion)
    A, kept = assembled(block, x)
    exact, _ = assembled(block, x, allowed=False)
    assert kept == (False, False)
    assert difference(A, exact) == 0.0
    # What moves the whole body is none.
    shifted = moved(block, lambda place: np.full_like(place, 1e-3))
    assert assembled(block, shifted)[1] == (False, True)


@pytest.mark.parametrize(("ratio", "kept"), [(50.0, False), (150.0, True)])
def test_only_bodies_far_stiffer_than_the_softest_in_contact(ratio, kept):
    model = model_of(bodies__aluminium__E=f"{5 * ratio} MPa", bodies__elastomer__nu=0.33)
    assert assembled(model, model.problem.new_vector())[1] == (False, kept)


class Counts(Observer):
    """Forces and Newton iterations of each step, and how often the tangent was kept."""

    def __init__(self):
        self.forces, self.newton, self.kept = [], 0, 0

    def step(self, state, row, result):
        self.forces.append((row.normal_force, row.tangential_force))
        self.newton += result.iterations
        self.kept += any(state.model.problem.tangent.undeformed.on)


@pytest.mark.parametrize("text", [BLOCK, BOXES], ids=["plane", "space"])
def test_forces_and_iterations_stay(text):
    """The residual is exact, and so are the forces; with a platen in space."""
    runs = []
    for allowed in (False, True):
        model = model_of(text, solver={"tolerance": 1e-9, "linear": "direct"})
        model.problem.tangent.undeformed.allowed = allowed
        runs.append(Counts())
        Simulation(model).run(runs[-1])
    exact, kept = runs
    assert exact.kept == 0 and kept.kept == len(kept.forces)
    a, b = np.array(exact.forces), np.array(kept.forces)
    assert np.abs(a - b).max() < 1e-9 * np.abs(a).max()
    assert kept.newton <= exact.newton + 1


def flags(comm, directory):
    """Whether the aluminium is kept, and sums of the tangent's values, of three states."""
    model = model_of(comm=comm)
    problem, out = model.problem, []
    one_node = moved(model, lambda place: np.full_like(place, 1e-4), "elastomer")
    place = problem.space.tabulate_dof_coordinates()[: problem.owned // 2, :2]
    corner = np.nonzero(np.abs(place).sum(axis=1) < 1e-9)[0]  # below, on the left
    for size in (0.0, 1e-8, 1e-6):
        one_node.array[2 * corner] = size
        A, kept = assembled(model, one_node)
        out.append([list(kept), A.norm() / 1e10])
    return out


@pytest.mark.mpi(flags, 2, 3)
def test_one_node_on_one_rank_ends_it_for_all(on_ranks):
    alone = on_ranks(flags, 1)
    assert [kept for kept, _ in alone] == [[False, True], [False, True], [False, False]]
    for ranks in (2, 3):
        for (kept, norm), (expected, size) in zip(on_ranks(flags, ranks), alone, strict=True):
            assert kept == expected
            assert norm == pytest.approx(size, rel=1e-12)
