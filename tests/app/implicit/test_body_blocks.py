"""Solving for one body after the other gives what factorising the whole gives."""

import gc
import tomllib
import weakref

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg
from mpi4py import MPI

from tests.app.checkpoint.small_cases import BOTTOM, COARSE, STAGES, changed, pairs
from tests.app.conftest import BLOCK, BOXES, FILM
from tests.app.implicit.test_linear_solver import new_solver
from tests.conftest import SOFT
from tests.laws import coulomb
from tests.solved import built, solved
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.errors import InputError
from tribox.app.implicit import body_blocks, volume_split
from tribox.app.implicit.body_blocks import KEPT_LIMIT, MOST, BodyBlocks, BodyByBody
from tribox.app.implicit.factor import CoupledFactor, Factor
from tribox.app.implicit.kept_bodies import kept_bodies, stiff_solids
from tribox.app.implicit.multigrid import MultigridSolver
from tribox.app.implicit.volume_split import VolumeSplitSolver
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.contact.penalty import ContactTerm

METAL = NeoHookean(shear_modulus=3000.0, bulk_modulus=8000.0)


def sunk(blocks, lower=METAL, upper=SOFT, held=("top", "bottom"), penalty=50.0, **parts):
    """Two blocks with Coulomb friction, held on some surfaces, and a state in which they touch."""
    prescribed = [blocks.held(name, axis) for name in held for axis in (0, 1)]
    term = ContactTerm(blocks.surface(), coulomb(0.3), penalty)
    problem = Equilibrium(
        blocks.u, blocks.solids(upper, lower), [term], prescribed=prescribed, **parts
    )
    x = blocks.displaced(
        lambda X: np.stack([0.02 + 0.01 * X[:, 1], -0.02 - 0.01 * X[:, 1]], axis=1),
        lambda X: 1e-5 * X,
    )
    return problem, x


def forces(problem, seed=0):
    """Noise: forces, and displacements where these are prescribed."""
    out = problem.new_vector()
    out.array[:] = np.random.default_rng(seed).normal(size=problem.owned)
    return out


def exact(matrix, rhs):
    indptr, columns, values = matrix.getValuesCSR()
    whole = scipy.sparse.csc_matrix(scipy.sparse.csr_matrix((values, columns, indptr)))
    return scipy.sparse.linalg.spsolve(whole, rhs.array_r)


def assembled(problem, x):
    solver = new_solver(problem)
    solver.assemble(x)
    return solver


@pytest.mark.parametrize("softer", [2000.0, 100.0])
def test_the_increments_are_those_of_the_whole(pair, softer):
    """To the share of the forces that is asked for, or less; exactly where they are prescribed."""
    problem, x = sunk(pair(), NeoHookean(softer * 1.5, softer * 4.0))
    solver = assembled(problem, x)
    rhs, found, errors = forces(problem), problem.new_vector(), []
    wanted = exact(solver.matrix, rhs)
    held = problem.constrained_dofs()
    size = 1.01 * np.linalg.norm(np.delete(rhs.array_r, held))
    for asked in (1e-2, 1e-9):
        solver.way.aim(asked)
        solver.ksp.solve(rhs, found)
        assert solver.ksp.getConvergedReason() > 0
        left = problem.new_vector()
        solver.matrix.mult(found, left)
        left.axpy(-1.0, rhs)
        assert left.norm() <= min(asked, MOST) * size
        np.testing.assert_array_equal(found.array_r[held], rhs.array_r[held])
        errors.append(np.linalg.norm(found.array_r - wanted) / np.linalg.norm(wanted))
    assert errors[1] < 1e-5 and errors[1] < 1e-2 * errors[0]
    assert isinstance(solver.way._bodies, BodyByBody) and solver.way._whole is None


def test_a_stiff_body_that_is_moved_takes_the_other_along(pair):
    """What moves it is so large that the forces of the soft body are nothing beside it."""
    problem, x = sunk(pair(), upper=METAL, lower=SOFT)
    solver = assembled(problem, x)
    rhs, increment = problem.new_vector(), problem.new_vector()
    increment.array[problem.prescribed[1].dofs] = -0.01
    assert solver.solve_from(x, rhs, increment)
    assert isinstance(solver.way._bodies, BodyByBody) and solver.way._whole is None
    wanted = exact(solver.matrix, rhs)
    soft = pair().nodes("aluminium")
    moved = increment.array_r.reshape(-1, 2)[soft]
    assert np.abs(moved).max() > 1e-3
    np.testing.assert_allclose(moved, wanted.reshape(-1, 2)[soft], atol=0.03 * np.abs(moved).max())


# -- conditions -----------------------------------------------------------------------------------


def names(problem):
    kept = kept_bodies(problem, stiff_solids(problem))
    return None if kept is None else tuple(solid.name for solid in kept.solids)


def test_a_body_is_kept_where_it_is_stiff_and_held(pair):
    blocks = pair()
    assert names(sunk(blocks)[0]) == ("aluminium",)
    assert names(sunk(blocks, upper=METAL, lower=SOFT)[0]) == ("elastomer",)
    # Contact stiffness times the length of a facet, 50/6, over Young's modulus.
    assert names(sunk(blocks, lower=NeoHookean(3.0, 8.0))[0]) is None
    # Nothing but the other body holds it.
    assert names(sunk(blocks, held=("top",))[0]) is None
    # Both would be: contacts that are so soft do not tell which is the soft one.
    assert names(sunk(blocks, upper=METAL)[0]) is None


def test_what_the_user_chooses_is_left_to_petsc(pair):
    """Unless his options are MUMPS's, or of Newton's method."""
    data = tomllib.loads(BLOCK)
    ways = {}
    for key, value in {"pc_type": "lu", "mat_mumps_icntl_14": 40, "snes_max_it": 30}.items():
        data["solver"] = {"petsc": {key: value}}
        sim = built(data)
        ways[key] = type(sim.stepper.solver.way)
        assert sim.stepper.solver.direct
    assert list(ways.values()) == [CoupledFactor, BodyBlocks, BodyBlocks]


def test_an_option_that_mumps_cannot_take_is_refused_with_its_reason():
    data = tomllib.loads(BLOCK)
    data["solver"] = {"petsc": {"mat_mumps_icntl_20": 1}}
    with pytest.raises(InputError, match=r"ICNTL\(20\)=1 is not supported"):
        built(data)


# -- where it does not work -----------------------------------------------------------------------


def failing(monkeypatch, calls):
    """Let the solves by bodies with these numbers fail; returns the numbers of all of them."""
    seen, solve = [], BodyByBody.solve

    def sometimes(self, b, x, share):
        seen.append(len(seen))
        return solve(self, b, x, share) and seen[-1] not in calls

    monkeypatch.setattr(BodyByBody, "solve", sometimes)
    return seen


def test_a_solve_that_fails_is_made_with_a_factorisation_of_the_whole(pair, monkeypatch):
    problem, x = sunk(pair())
    solver = assembled(problem, x)
    seen = failing(monkeypatch, {0})
    found, rhs = problem.new_vector(), forces(problem)
    for _ in range(2):  # the second finds the factorisation there
        solver.ksp.solve(rhs, found)
        np.testing.assert_allclose(found.array_r, exact(solver.matrix, rhs), atol=1e-9)
    assert len(seen) == 1
    solver.assemble(x)
    solver.ksp.solve(rhs, found)
    assert len(seen) == 2 and solver.way._whole is None


def test_a_singular_tangent_is_told_and_forgotten(pair):
    """A body that nothing holds and nothing touches."""
    problem, x = sunk(pair(gap=0.5), held=("bottom",))
    solver = assembled(problem, problem.new_vector())
    assert isinstance(solver.way._bodies, BodyByBody)
    found, rhs = problem.new_vector(), forces(problem)
    solver.matrix.zeroRowsColumns(np.arange(4, dtype=np.int32), 0.0)
    solver.way.set_up(False)
    solver.ksp.solve(rhs, found)
    assert not solver.forget_failure()
    held, x = sunk(pair())
    again = assembled(held, x)
    again.ksp.solve(forces(held), found)
    assert again.ksp.getConvergedReason() > 0


# -- whole runs -----------------------------------------------------------------------------------

TIGHT = {"solver": {"tolerance": 1e-10}}


def simulated(keys):
    return solved(changed(BLOCK, keys))


@pytest.fixture(scope="module")
def with_the_whole():
    sim = simulated({"solver": {"tolerance": 1e-10, "petsc": {"pc_type": "lu"}}})
    assert isinstance(sim.stepper.solver.way, CoupledFactor)
    return sim.rows


def test_a_run_is_that_with_the_whole_factorised(with_the_whole):
    """Rows to round-off of the tolerance, and no iteration more."""
    ours = simulated(TIGHT)
    assert isinstance(ours.stepper.solver.way._bodies, BodyByBody)
    for a, b in zip(ours.rows, with_the_whole, strict=True):
        assert a.normal_force == pytest.approx(b.normal_force, rel=1e-9)
        assert a.tangential_force == pytest.approx(b.tangential_force, rel=1e-9, abs=1e-9)
    spent = [sum(row.newton_iterations for row in rows) for rows in (ours.rows, with_the_whole)]
    assert spent[0] <= spent[1] + 1


def platen(directory):
    """The soft body under a platen, slid on a film."""
    thin = {"geometry.upper.elements": [5, 2], "geometry.lower.elements": [8, 2]}
    return changed(FILM, {**thin, "stage.1.max_steps": 6})


def tied(directory):
    """A pad tied to a plate on two dies of metal, which it slides over."""
    data = pairs(directory)
    for name in ("left", "right"):
        data["bodies"][name] = data["bodies"][name] | {"E": "70 GPa"}
    return data


def axisymmetric(directory):
    """Unknowns of contact on the axis are prescribed."""
    down = {"x": 0, "y": [["0 s", 0], ["2 s", "-0.1 mm"]]}
    keys = {
        "geometry.section": "axisymmetric",
        "boundary": [BOTTOM, {"surface": "top", "displacement": down}],
    }
    data = changed(BLOCK, COARSE | keys | {"stage": STAGES})
    del data["geometry"]["thickness"]
    return data


def q2(directory):
    kinds = {f"bodies.{name}.formulation": "q2" for name in ("elastomer", "aluminium")}
    return changed(BLOCK, COARSE | kinds | {"stage": STAGES})


def swapped(directory):
    ends = {"contact.0.slave": "aluminium_contact", "contact.0.master": "elastomer_contact"}
    return changed(BLOCK, COARSE | ends | {"stage": STAGES})


def bent(directory):
    """The stiff body is held at one side: it bends, and what is inside it reaches the contact."""
    held = {"surface": "aluminium_left", "displacement": {"x": 0, "y": 0}}
    top = changed(BLOCK, {})["boundary"][1]
    return changed(BLOCK, COARSE | {"boundary": [held, top], "stage": STAGES})


@pytest.mark.parametrize("case", [platen, tied, axisymmetric, q2, swapped, bent])
def test_bodies_of_other_kinds_give_what_the_whole_gives(tmp_path, case):
    data = case(tmp_path)
    ours, whole = solved(data), solved(data | {"solver": {"petsc": {"pc_type": "lu"}}})
    way = ours.stepper.solver.way
    assert isinstance(way._bodies, BodyByBody) and not way._given_up
    small = 1e-8 * max(abs(row.normal_force) for row in whole.rows)
    for a, b in zip(ours.rows, whole.rows, strict=True):
        assert a.normal_force == pytest.approx(b.normal_force, abs=small)
        assert a.tangential_force == pytest.approx(b.tangential_force, abs=small)
    spent = [sum(row.newton_iterations for row in sim.rows) for sim in (ours, whole)]
    assert spent[0] <= spent[1] + 1


def boxes(comm, linear, nu=0.45):
    """Boxes in space, the lower one a thousand times stiffer, are pressed and slid."""
    keys = {"solver": {"linear": linear, "tolerance": 1e-9}, "bodies.elastomer.nu": nu}
    return solved(changed(BOXES, keys), comm)


def forces_of(sim):
    return [[row.normal_force, row.tangential_force] for row in sim.rows]


def by_iterations(comm, directory, limit=0):
    """Forces, and iterations of Newton's method and of linear solves; collective."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(body_blocks, "KEPT_LIMIT", limit)
        sim = boxes(comm, "krylov")
    way = sim.stepper.solver.way
    assert isinstance(way._bodies.own, MultigridSolver) and way._whole is None
    assert isinstance(way._bodies._stiff, Factor if limit else MultigridSolver)
    return forces_of(sim), *(
        sum(getattr(row, name) for row in sim.rows)
        for name in ("newton_iterations", "linear_iterations")
    )


@pytest.fixture(scope="module")
def boxes_by_factors():
    sim = boxes(MPI.COMM_SELF, "direct")
    assert isinstance(sim.stepper.solver.way._bodies.own, Factor)
    return forces_of(sim), sum(row.newton_iterations for row in sim.rows)


@pytest.mark.mpi(by_iterations, 2)
@pytest.mark.parametrize(("ranks", "limit"), [(1, KEPT_LIMIT), (1, 0), (2, 0)])
def test_bodies_solved_for_by_iterations(on_ranks, boxes_by_factors, ranks, limit):
    """The soft one, and the stiff one where it is too large to factorise."""
    found, newton, linear = (
        on_ranks(by_iterations, 2) if ranks == 2 else by_iterations(MPI.COMM_SELF, None, limit)
    )
    wanted, exactly = boxes_by_factors
    np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-7 * np.abs(wanted).max())
    assert newton <= exactly + 2 * len(wanted)
    assert 5 * newton < linear < 40 * newton


def test_iterations_that_fail_are_followed_by_a_factorisation(boxes_by_factors, monkeypatch):
    """Of the whole, for that tangent, and for all where it happens often."""
    monkeypatch.setattr(BodyByBody, "solve", lambda *_: False)
    sim = boxes(MPI.COMM_SELF, "krylov")
    way, (wanted, exactly) = sim.stepper.solver.way, boxes_by_factors
    assert isinstance(way._whole, Factor) and way._given_up and not way.direct
    np.testing.assert_allclose(forces_of(sim), wanted, rtol=1e-7, atol=1e-7 * np.abs(wanted).max())
    assert sum(row.newton_iterations for row in sim.rows) <= exactly + 1


def nearly_incompressible(comm, directory, split=True):
    """Forces, and iterations of linear solves over those of Newton's method; collective."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(volume_split, "NEARLY", volume_split.NEARLY if split else np.inf)
        sim = boxes(comm, "krylov", 0.499)
    assert isinstance(sim.stepper.solver.way._bodies.own, VolumeSplitSolver) == split
    newton, linear = (
        sum(getattr(row, f"{name}_iterations") for row in sim.rows) for name in ("newton", "linear")
    )
    return forces_of(sim), linear / newton


@pytest.mark.mpi(nearly_incompressible, 2)
def test_pressures_as_unknowns_halve_the_iterations_of_rubber(on_ranks):
    wanted, plain = nearly_incompressible(MPI.COMM_SELF, None, split=False)
    for found, each in (
        nearly_incompressible(MPI.COMM_SELF, None),
        on_ranks(nearly_incompressible, 2),
    ):
        np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-7 * np.abs(wanted).max())
        assert 2.0 * each < plain


def test_nothing_outlives_the_solver(pair):
    """PETSc holds its preconditioner, which must not hold PETSc's solver."""
    problem, x = sunk(pair())
    solver = assembled(problem, x)
    solver.solve(forces(problem), problem.new_vector())
    way = weakref.ref(solver.way)
    assert isinstance(way(), BodyBlocks)
    del solver
    gc.collect()
    assert way() is None
