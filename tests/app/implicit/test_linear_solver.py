"""The linear solvers agree, and the Krylov one knows how bodies move as rigid ones."""

import math
import tomllib
from pathlib import Path

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc

from tests.app.conftest import BLOCK, BOXES
from tests.app.read_log import read_log
from tests.conftest import SOFT
from tests.contact_boxes import two_boxes
from tests.laws import coulomb
from tests.solved import built, solved
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.errors import SolutionError
from tribox.app.implicit import body_blocks, factor
from tribox.app.implicit.body_blocks import IterationBudget
from tribox.app.implicit.factor import DIRECT, Factor, factors_fit
from tribox.app.implicit.globalisation import SoftContact
from tribox.app.implicit.linear_solver import DIRECT_LIMIT, LinearSolver, linear_options
from tribox.app.implicit.multigrid import (
    KRYLOV,
    FinestLevel,
    Interpolation,
    Multigrid,
    MultigridSolver,
)
from tribox.app.implicit.newton import Newton
from tribox.app.run.run import run_case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation
from tribox.forms.bodies.solid import Solid


class CoarseStates(Observer):
    """What changes when a preconditioner's coarsest matrix is made again, after each step."""

    def __init__(self):
        self.found = []

    def step(self, state, row, result):
        if not state.stepper.solver.direct:
            found = coarse_state(state.stepper.solver)
            if found not in self.found:
                self.found.append(found)


def simulated(linear, observer=None):
    data = tomllib.loads(BLOCK)
    data["solver"] = {"linear": linear, "tolerance": 1e-10}
    sim = built(data)

    sim.run(observer or Observer())
    return sim


def test_krylov_and_direct_agree():
    coarse = CoarseStates()
    direct, krylov = simulated("direct"), simulated("krylov", coarse)
    assert direct.stepper.solver.direct and not krylov.stepper.solver.direct
    assert krylov.stepper.solver.way.multigrid.pc.getType() == "gamg"
    for a, b in zip(direct.rows, krylov.rows, strict=True):
        assert b.normal_force == pytest.approx(a.normal_force, rel=1e-8)
        assert b.tangential_force == pytest.approx(a.tangential_force, rel=1e-7, abs=1e-9)
    # One preconditioner serves: SNES, which would make one with each tangent, leaves it alone.
    assert len(coarse.found) == krylov.stepper.solver.way.multigrid.made == 1
    assert krylov.stepper.solver.assembled > 20
    # An inexact solve costs Newton's method little: its tolerance is below what a step gains.
    spent = [sum(row.newton_iterations for row in sim.rows) for sim in (direct, krylov)]
    assert spent[1] <= spent[0] + len(direct.rows)


def test_nearly_incompressible_in_space_with_friction_and_a_platen():
    """The multigrid neither breaks down nor creeps: the force is right, and no step is cut."""
    data = tomllib.loads(BOXES)
    data["solver"] = {"linear": "direct"}
    direct = built(data)
    data["solver"] = {"linear": "krylov"}
    sim = built(data)
    counts, count = [], sim.stepper.solver.way.count

    def seen(iterations):
        counts.append(iterations)
        count(iterations)

    sim.stepper.solver.way.count = seen
    sim.run(Observer())
    direct.run(Observer())
    assert [row.attempts for row in sim.rows] == [1, 1, 1]
    assert 5 < max(counts) < 60
    assert sum(row.linear_iterations for row in sim.rows) == sum(counts)
    assert not any(row.linear_iterations for row in direct.rows)
    assert sim.rows[-1].normal_force == pytest.approx(0.4, rel=1e-4)
    for a, b in zip(sim.rows, direct.rows, strict=True):
        assert a.tangential_force == pytest.approx(b.tangential_force, rel=1e-5, abs=1e-8)


def slid(linear):
    """A layer is pressed and slid by nearly three times its thickness, each in a single step."""
    data = tomllib.loads(BOXES)
    data["bodies"]["elastomer"]["nu"] = 0.45
    data["geometry"] = {
        "kind": "two-boxes",
        "upper": {"width": 1e-3, "height": 2.5e-4, "depth": 1e-3, "elements": [6, 2, 6]},
        "lower": {"width": 2e-3, "height": 5e-4, "depth": 1.5e-3, "elements": [9, 2, 6]},
        "offset": [1e-4, 2.5e-4],
    }
    data["boundary"][1] = {
        "surface": "top",
        "displacement": {"x": [[1.0, 0.0], [2.0, 7e-4]], "y": [[0.0, 0.0], [1.0, -2e-5]], "z": 0},
    }
    data["stage"][0]["steps"] = 1
    data["solver"] = {"linear": linear, "tolerance": 1e-9}
    return solved(data)


def test_a_slide_of_many_facets_in_space_is_one_step():
    """It starts from the body slid as a whole: sheared by 280 % it would be cut, and cut again."""
    direct, krylov = slid("direct"), slid("krylov")
    for sim in (direct, krylov):
        assert [row.attempts for row in sim.rows] == [1, 1]
        assert sim.rows[-1].newton_iterations <= 7
        assert sim.rows[-1].stick_fraction == 0.0
        assert sim.rows[-1].friction_coefficient == pytest.approx(0.2, rel=1e-4)
    a, b = direct.rows[-1], krylov.rows[-1]
    assert b.normal_force == pytest.approx(a.normal_force, rel=1e-8)
    assert b.tangential_force == pytest.approx(a.tangential_force, rel=1e-7)


def test_auto_factorises_up_to_a_number_of_unknowns():
    class Size:
        def __init__(self, size, dim):
            self.size, self.dim, self.fields, self.comm = size, dim, [], MPI.COMM_SELF

    for dim, limit in DIRECT_LIMIT.items():
        assert linear_options(Size(limit, dim), "auto") == DIRECT
        assert linear_options(Size(limit + 1, dim), "auto") == KRYLOV
        assert linear_options(Size(limit + 1, dim), "direct") == DIRECT
        assert linear_options(Size(1, dim), "krylov") == KRYLOV


# -- the solver itself ----------------------------------------------------------------------------


def new_solver(problem, kind="direct", as_it_is=False):
    solver = LinearSolver(problem, problem.new_vector())
    ksp = PETSc.KSP().create(problem.comm)
    ksp.setOptionsPrefix(f"test_{kind}_")
    options = PETSc.Options(ksp.getOptionsPrefix())
    for key, value in linear_options(problem, kind).items():
        options[key] = value
    ksp.setFromOptions()
    solver.use(ksp, as_it_is)
    return solver


def held(blocks, *surfaces):
    return [blocks.held(name, axis) for name in surfaces for axis in (0, 1)]


def noise(problem, seed=0):
    x = problem.new_vector()
    x.array[:] = np.random.default_rng(seed).normal(size=problem.owned)
    return x


def test_the_factor_follows_a_pattern_that_widens(pair):
    """The contact moves on to other facets: the factor's analysis is out of date."""
    blocks = pair("quadrilateral", (6, 2), (40, 2))
    problem = blocks.problem(coulomb(0.3), prescribed=held(blocks, "top", "bottom"))
    solver = new_solver(problem)
    rhs, found, image = noise(problem), problem.new_vector(), problem.new_vector()
    patterns = set()
    for way in (0.0, 0.2, 0.4):
        x = blocks.displaced(lambda X, way=way: np.tile([way, -0.02], (len(X), 1)), np.zeros_like)
        solver.assemble(x)
        patterns.add(problem.pattern_changes)
        assert solver.solve(rhs, found)
        solver.matrix.mult(found, image)
        assert (image - rhs).norm() < 1e-9 * rhs.norm()
    assert len(patterns) > 1
    assert solver.assembled == 3


def linear_step(blocks, size):
    """Stretch two blocks by a linear step; its norm, and the share of forces out of balance.

    Collective over the processes of the blocks.
    """
    parts = held(blocks, "top", "bottom", "elastomer_contact")
    problem = blocks.problem(None, prescribed=parts)
    solver = new_solver(problem)
    x, rhs, step = (problem.new_vector() for _ in range(3))
    parts[0].value, parts[1].value = size, -2.0 * size
    problem.residual(None, x, rhs)
    rhs.scale(-1.0)
    wanted = problem.constrained_values(x)[problem.constrained_dofs()]
    step.array[problem.constrained_dofs()] = wanted
    assert solver.solve_from(x, rhs, step)
    np.testing.assert_allclose(step.array_r[problem.constrained_dofs()], wanted, atol=1e-16)
    problem.residual(None, step, rhs)
    free = np.delete(problem.unbalanced, problem.constrained_dofs())
    squares = np.array([free @ free, problem.unbalanced @ problem.unbalanced])
    free, forces = np.sqrt(problem.comm.allreduce(squares))
    return step.norm(), free / forces


def test_a_linear_step_meets_the_prescribed_values_and_balances_the_rest(pair):
    left = [linear_step(pair(), size)[1] for size in (1e-4, 1e-5)]
    # What is left is of second order in the step: a tenth of the step leaves a tenth of the share.
    assert left[0] < 1e-3 and left[1] == pytest.approx(left[0] / 10.0, rel=0.05)


def test_a_singular_tangent_is_told_and_forgotten(pair):
    """MUMPS refuses a body of whose unknowns nothing is asked; the next tangent is a new one."""
    blocks = pair("quadrilateral", (1, 1), (1, 1))
    problem = blocks.problem(None, prescribed=held(blocks, "top", "bottom"))
    solver = new_solver(problem)
    x, rhs, found = problem.new_vector(), noise(problem), problem.new_vector()
    solver.assemble(x)
    assert solver.solve(rhs, found)
    expected = found.copy()
    solver.matrix.zeroEntries()
    solver.matrix.assemble()
    solver.ksp.setOperators(solver.matrix)
    assert not solver.solve(rhs, found)
    solver.assemble(x)
    assert solver.solve(rhs, found)
    assert (found - expected).norm() < 1e-12 * expected.norm()


def loose(pair, dim):
    """Two bodies that nothing holds, their principal axes oblique in space."""
    if dim == 2:
        return pair().problem(None)
    mesh, *_ = two_boxes("hexahedron", False, 7)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (3,))))
    cells = np.arange(mesh.topology.index_map(3).size_local, dtype=np.int32)
    return Equilibrium(u, [Solid("all", u, cells, SOFT, "q1-sri", section="3D")], [])


@pytest.mark.parametrize(("dim", "count"), [(2, 3), (3, 6)])
def test_multigrid_is_told_the_rigid_motions_of_the_bodies(pair, dim, count):
    """Orthonormal, and of bodies that nothing holds they are what the tangent cannot feel."""
    problem = loose(pair, dim)
    solver = new_solver(problem, "krylov")
    assert not solver.direct
    solver.assemble(problem.new_vector())
    near = solver.matrix.getNearNullSpace()
    assert near
    modes = near.getVecs()
    assert len(modes) == count
    gram = np.array([[a.dot(b) for a in modes] for b in modes])
    np.testing.assert_allclose(gram, np.eye(count), atol=1e-12)
    image = problem.new_vector()
    for mode in modes:
        solver.matrix.mult(mode, image)
        assert image.norm() < 1e-12 * solver.matrix.norm()
    # Of a motion u(x) = a + G x only the skew part of G may be there.
    position = problem.space.tabulate_dof_coordinates()[:, :dim]
    for mode in modes:
        values = mode.array_r.reshape(-1, dim)
        gradient, *_ = np.linalg.lstsq(position - position[0], values - values[0], rcond=None)
        np.testing.assert_allclose(gradient + gradient.T, 0.0, atol=1e-12)


def coarse_state(solver):
    """What changes when the matrix of the coarsest space is made again.

    Whoever keeps it keeps the matrix itself: the next one can't take its place in memory.
    """
    way = solver.way
    kept = way if isinstance(way, Multigrid) else way.multigrid
    matrix = kept.pc.getMGCoarseSolve().getOperators()[0]
    return matrix, matrix.stateGet()


def test_a_linear_solve_that_fails_is_tried_with_a_new_preconditioner(monkeypatch):
    def other_means(*arguments):
        raise AssertionError("there was no need of a softer contact, or of whole steps")

    monkeypatch.setattr(Newton, "_search", other_means)
    monkeypatch.setattr(SoftContact, "run", other_means)
    data = tomllib.loads(BLOCK)
    data["solver"] = {"linear": "krylov", "petsc": {"ksp_rtol": 1e-8}}
    runs = []
    for failing in (None, 4):
        sim = built(data)
        test = FailsOnce(failing)
        sim.stepper.solver.ksp.setConvergenceTest(test)
        sim.run(Observer())
        assert test.failed is (failing is not None)
        assert {row.attempts for row in sim.rows} == {1}
        runs.append(sim.rows[-1])
    assert runs[0].tangential_force == pytest.approx(runs[1].tangential_force, rel=1e-6)


class FailsOnce:
    """Convergence by 1e-8, but for one solve, which gives up at once."""

    def __init__(self, failing):
        self.failing, self.solves, self.failed, self.start = failing, 0, False, 0.0

    def __call__(self, ksp, iteration, norm):
        reasons = PETSc.KSP.ConvergedReason
        if iteration == 0:
            self.solves, self.start = self.solves + 1, norm
        if self.solves == self.failing and not self.failed:
            self.failed = True
            return reasons.DIVERGED_MAX_IT
        return reasons.CONVERGED_RTOL if norm <= 1e-8 * self.start else None


def blocks(values, missing=()):
    """A matrix (n, n, d, d) as PETSc has it, without some of the blocks."""
    n, size = len(values), values.shape[-1]
    there = np.array([[(i, j) not in missing for j in range(n)] for i in range(n)])
    dense = values.transpose(0, 2, 1, 3).reshape(size * n, size * n)
    rows, indices = np.nonzero(np.kron(there, np.ones((size, size))))
    indptr = np.searchsorted(rows, np.arange(size * n + 1))
    csr = indptr.astype(np.int32), indices.astype(np.int32), dense[rows, indices]
    made = PETSc.Mat().createAIJ((size * n, size * n), csr=csr, comm=MPI.COMM_SELF)
    made.setBlockSize(size)
    made.assemble()
    return made


class NoCoarseLevels:
    """What stands for multigrid without any levels below the finest."""

    def getMGLevels(self):
        return 1

    def getMGCoarseSolve(self):
        ksp = PETSc.KSP().create(MPI.COMM_SELF)
        ksp.setOperators(PETSc.Mat().createAIJ((1, 1), comm=MPI.COMM_SELF))
        return ksp


@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("share", [1.0, 0.8])
def test_sweeps_in_single_precision_are_those_of_gauss_seidel(size, share):
    rng, n, missing = np.random.default_rng(3), 7, {(0, 3), (3, 0), (6, 1), (5, 2)}
    values = rng.normal(size=(n, n, size, size))
    values[range(n), range(n)] += 9.0 * np.eye(size)
    for i, j in missing:
        values[i, j] = 0.0
    right, start = rng.normal(size=(2, size * n))
    matrix = blocks(values, missing)
    level = FinestLevel(matrix)
    level._share.value = share
    whole = values.transpose(0, 2, 1, 3).reshape(size * n, size * n)
    lower = np.kron(np.tri(n), np.ones((size, size))) * whole
    diagonal = np.kron(np.eye(n), np.ones((size, size))) * whole
    swept = np.linalg.solve(lower, np.eye(size * n))  # (D + L) y = r and (D + U) d = D y
    swept = share * np.linalg.solve(whole - lower + diagonal, diagonal @ swept)
    away = np.full(size * n, 1e4)  # all go far together, and only what they differ by is rounded
    for scale in (1.0, 1e9):  # the values of one pattern may change
        matrix.scale(scale)
        assert level.take(NoCoarseLevels())
        b, x = matrix.createVecs()
        left = b.duplicate()
        b.array[:] = scale * right
        level.sweep(b, x, left, from_zero=True)
        once = swept @ right
        np.testing.assert_allclose(x.array, once, atol=2e-6 * np.abs(once).max())
        rest = scale * (right - whole @ once)
        np.testing.assert_allclose(left.array, rest, atol=2e-6 * np.abs(rest).max())
        b.array[:] = scale * (right + whole @ away)
        x.array[:] = start + away
        level.sweep(b, x, left)
        again = start + swept @ (right - whole @ start)
        np.testing.assert_allclose(x.array - away, again, atol=4e-6 * np.abs(again).max())
        rest = scale * (right - whole @ again)
        np.testing.assert_allclose(left.array, rest, atol=4e-6 * np.abs(rest).max())
        level.mult(matrix, x, left)
        product = scale * (whole @ x.array)
        np.testing.assert_allclose(left.array, product, rtol=1e-12, atol=1e-13 * scale)


@pytest.mark.parametrize("size", [2, 3])
def test_interpolation_in_single_precision_is_that_of_the_matrix(size):
    """Whether or not rows of a node have all the columns of an aggregate."""
    rng, fine, coarse, width = np.random.default_rng(4), 9, 4, 3 * size - 3
    dense = rng.normal(size=(size * fine, width * coarse))
    dense[rng.random(dense.shape) < 0.4] = 0.0
    rows, indices = np.nonzero(dense)
    indptr = np.searchsorted(rows, np.arange(size * fine + 1))
    csr = indptr.astype(np.int32), indices.astype(np.int32), dense[rows, indices]
    matrix = PETSc.Mat().createAIJ(dense.shape, csr=csr, comm=MPI.COMM_SELF)
    matrix.setBlockSizes(size, width)
    matrix.assemble()
    between = Interpolation(matrix)
    below, above = matrix.createVecs()
    for _ in range(2):  # nothing is left over of the first time
        above.array[:] = rng.normal(size=size * fine)
        between.multTranspose(above, below)
        np.testing.assert_allclose(below.array, dense.T @ above.array, atol=3e-6)
        expected = above.array + dense @ below.array
        between.multAdd(below, above, above)
        np.testing.assert_allclose(above.array, expected, atol=3e-6 * np.abs(expected).max())


# -- Iterations that take longer than factorisations would -----------------------------------------


def boxes_run(linear, directory=None, **settings):
    """Two boxes pressed and slid; of those of a directory the log, too."""
    data = tomllib.loads(BOXES)
    data["solver"] = {"linear": linear, "tolerance": 1e-9, **settings}
    if directory is None:
        return solved(data)
    case = Case.model_validate(data | {"output": {"figures": False}})
    return run_case(case, directory, quiet=True, comm=MPI.COMM_SELF), read_log(directory)


@pytest.fixture(scope="module")
def factorised():
    return boxes_run("direct").rows


@pytest.fixture
def dear_from_the_start(monkeypatch):
    """Any iteration is too many, and all systems are too large to be factorised unasked."""
    monkeypatch.setitem(DIRECT_LIMIT, 3, 0)
    monkeypatch.setattr(body_blocks, "DEAR", 1)


def same_forces(rows, others):
    for a, b in zip(rows, others, strict=True):
        assert a.normal_force == pytest.approx(b.normal_force, rel=1e-8)
        assert a.tangential_force == pytest.approx(b.tangential_force, rel=1e-6, abs=1e-9)


def test_auto_factorises_where_iterations_take_too_long(factorised, dear_from_the_start, tmp_path):
    sim, log = boxes_run("auto", tmp_path / "out")
    solver = sim.stepper.solver
    assert solver.direct and solver.way.turned
    assert sim.rows[0].linear_iterations > 0 == sim.rows[-1].linear_iterations
    assert {row.attempts for row in sim.rows} == {1}
    same_forces(sim.rows, factorised)
    assert log.count("systems were factorised from there on") == 1
    # So it stays in a run that goes on.
    other = Simulation(sim.model).stepper.solver
    assert not other.direct
    other.way.restore(solver.way.snapshot())
    assert other.direct and other.way.part == "factorisation"


@pytest.mark.parametrize("linear", ["auto", "krylov"])
def test_iterations_go_on_where_they_are_asked_for_or_memory_is_short(
    factorised, dear_from_the_start, monkeypatch, tmp_path, linear
):
    if linear == "auto":
        monkeypatch.setattr(factor, "free_memory", lambda: 1e6)
    sim, log = boxes_run(linear, tmp_path / "out")
    assert not sim.stepper.solver.direct and sim.rows[-1].linear_iterations > 0
    same_forces(sim.rows, factorised)
    assert log.count('solver.linear = "direct" is faster, and surer, if memory allows') == 1
    if linear == "auto":  # and so they do in a run that goes on, whatever memory there is by then
        monkeypatch.setattr(factor, "free_memory", lambda: math.inf)
        other = Simulation(sim.model).stepper.solver.way
        other.restore(sim.stepper.solver.way.snapshot())
        assert other._may_turn and other.budget.refused and not other.direct


def test_few_iterations_are_not_told(factorised, tmp_path):
    _, log = boxes_run("krylov", tmp_path / "out")
    assert "linear solves took" not in log


def test_failure_with_many_iterations_suggests_to_factorise(dear_from_the_start, monkeypatch):
    monkeypatch.setitem(KRYLOV, "ksp_max_it", 2)
    monkeypatch.setattr(factor, "free_memory", lambda: 1e6)
    said = r'linear solves took up to .* try solver\.linear = "direct", if memory allows'
    with pytest.raises(SolutionError, match=said):
        boxes_run("krylov", min_step_fraction=0.5)


def test_a_stiff_body_whose_multigrid_does_not_get_there_is_factorised(
    factorised, monkeypatch, tmp_path
):
    """It is told, and a run that goes on does not try again."""
    monkeypatch.setattr(body_blocks, "KEPT_LIMIT", 0)
    monkeypatch.setitem(body_blocks.STIFF, "ksp_max_it", 1)
    sim, log = boxes_run("krylov", tmp_path / "out")
    way = sim.stepper.solver.way
    bodies = way._bodies
    assert isinstance(bodies._stiff, Factor) and isinstance(bodies.own, MultigridSolver)
    same_forces(sim.rows, factorised)
    unknowns = bodies._stiff.matrix.size[0]
    assert log.count(f"their {unknowns} unknowns were factorised from there on") == 1
    other = Simulation(sim.model).stepper.solver
    other.way.restore(way.snapshot())
    other.assemble(sim.stepper.newton.trial)
    assert isinstance(other.way._bodies._stiff, Factor)


def spend(budget, solves):
    for iterations in solves:
        budget.spent = iterations
        budget.close()
    return budget.most


def test_budget_is_used_up_by_many_dear_solves_only():
    budget = IterationBudget(20_000)
    assert spend(budget, 100 * [90, 110, 60]) == 0
    assert spend(budget, (200, 250, 260)) == 260
    assert spend(IterationBudget(200_000), 100 * [260]) == 0


def test_factors_of_many_unknowns_do_not_fit(monkeypatch):
    assert 0.0 < factor.free_memory() < math.inf
    monkeypatch.setattr(factor, "free_memory", lambda: 8e9)
    assert factors_fit(MPI.COMM_SELF, 100_000) and not factors_fit(MPI.COMM_SELF, 1_000_000)


def iterations_of(comm, directory):
    """Those of a box that is pressed on another one and pulled."""
    data = tomllib.loads((Path(__file__).parents[3] / "cases" / "boxes-3d.toml").read_text())
    data["geometry"]["upper"]["elements"] = [12, 6, 12]
    data["geometry"]["lower"]["elements"] = [17, 5, 17]
    data["stage"][0]["steps"], data["stage"][1] = (
        1,
        data["stage"][1] | {"duration": "0.1 s", "steps": 1},
    )
    data["solver"] = {"linear": "krylov"}
    sim = Simulation(build_model(Case.model_validate(data), comm))
    sim.run(Observer())
    return sim.implicit.stepper.solver.iterations


@pytest.mark.long
@pytest.mark.mpi(iterations_of, 4)
def test_sweeps_within_each_rank_keep_the_iterations_few(on_ranks):
    """Undamped, they raise errors where three ranks meet: three times the iterations on four."""
    alone = iterations_of(MPI.COMM_SELF, None)
    assert on_ranks(iterations_of, 4) <= 1.6 * alone
