"""Where bodies are condensed, and that what they give is right in cases that are not plain."""

from collections.abc import Iterator

import numpy as np
import pytest
import scipy.sparse

from tests.app.checkpoint.small_cases import BOTTOM, COARSE, STAGES, changed, pairs
from tests.app.conftest import BLOCK, FILM
from tests.app.implicit.test_body_blocks import METAL, assembled, exact, forces, forces_left, sunk
from tests.conftest import SOFT
from tests.solved import solved
from tribox.app.implicit import condensed_bodies
from tribox.app.implicit.body_blocks import BodyByBody
from tribox.app.implicit.condensed_bodies import CLOSE, CondensedBodies, ContactCompliance


@pytest.fixture(autouse=True)
def _however_small(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Condense bodies however many of their unknowns are of contact."""
    monkeypatch.setattr(condensed_bodies, "DENSE", np.inf)
    yield


def condensed(problem, x):
    solver = assembled(problem, x)
    assert isinstance(solver.way._bodies, CondensedBodies)
    return solver


def solves(solver, rhs=None, share=1e-9):
    """Solve, and hold what is left against what may be."""
    rhs = rhs or forces(solver.problem)
    found = solver.problem.new_vector()
    solver.way.aim(share)
    solver.ksp.solve(rhs, found)
    assert solver.ksp.getConvergedReason() > 0
    size = 1.01 * np.linalg.norm(np.delete(rhs.array_r, solver.problem.constrained_dofs()))
    left, on_others = forces_left(solver, found, rhs)
    assert left <= share * size and on_others <= min(share, CLOSE) * size
    return found


# -- conditions -----------------------------------------------------------------------------------


def inner_pair(solver):
    """Two neighbours of the soft body that no contact touches."""
    bodies = solver.way._bodies
    inner = np.delete(bodies._others, bodies._s)
    inner = np.setdiff1d(inner, solver.problem.constrained_dofs())
    columns, _ = solver.matrix.getRow(int(inner[0]))
    return int(inner[0]), int(np.setdiff1d(np.intersect1d(columns, inner), inner[:1])[0])


@pytest.mark.parametrize("value", [0.5, np.nan])
def test_where_the_bulk_is_not_symmetric_bodies_are_solved_for_in_turn(pair, value):
    problem, x = sunk(pair())
    solver = condensed(problem, x)
    row, column = inner_pair(solver)
    solver.matrix.setValue(row, column, value)
    solver.matrix.assemble()
    solver.way._bodies.bulk.worn = True
    solver.way.set_up(False)
    assert isinstance(solver.way._bodies, BodyByBody)
    rhs, found = forces(problem), problem.new_vector()
    solver.way.aim(1e-9)
    solver.ksp.solve(rhs, found)
    if np.isfinite(value):
        assert solver.way._whole is None
        np.testing.assert_allclose(found.array_r, exact(solver.matrix, rhs), atol=1e-6)


@pytest.mark.parametrize("row", ["of the others", "of the kept"])
def test_a_contact_without_numbers_is_left_to_the_whole(pair, row):
    """As where Newton's method has run away; the next tangent is as any other."""
    problem, x = sunk(pair())
    solver = condensed(problem, x)
    bodies = solver.way._bodies
    felt = bodies._kept[bodies._c[bodies._compliance.touched]]
    at = int(felt[2] if row == "of the kept" else bodies._others[bodies._s[2]])
    solver.matrix.setValue(at, int(felt[2]), np.nan)
    solver.matrix.assemble()
    solver.way.set_up(False)
    solver.ksp.solve(forces(problem), problem.new_vector())
    assert solver.way._whole is not None
    solver.assemble(x)
    solves(solver)
    assert solver.way._whole is None


def test_a_compliance_that_is_singular_is_not_used(pair, monkeypatch):
    problem, x = sunk(pair())
    solver = condensed(problem, x)
    of = ContactCompliance.of

    def unstable(F, of_others, on_kept, among):
        return of(F, of_others, on_kept, scipy.sparse.csr_matrix(-np.linalg.inv(F)))

    rhs, found = forces(problem), problem.new_vector()
    monkeypatch.setattr(ContactCompliance, "of", unstable)
    solver.assemble(x)
    solver.ksp.solve(rhs, found)
    assert solver.way._whole is not None
    np.testing.assert_allclose(found.array_r, exact(solver.matrix, rhs), atol=1e-9)


# -- solutions ------------------------------------------------------------------------------------


KEPT = pytest.mark.parametrize("upper", [SOFT, METAL], ids=["kept master", "kept slave"])


def soft_moved(blocks, upper, shear, press):
    """A pair with its soft body moved, one that is kept beside it, and the state."""

    def moved(X):
        return np.stack([shear * X[:, 1], -0.02 - press * X[:, 1]], axis=1)

    def below(X):
        return np.stack([shear * (X[:, 1] + 0.5), 0.02 + press * (X[:, 1] + 0.5)], axis=1)

    if upper is SOFT:
        return blocks.displaced(moved, np.zeros_like)
    return blocks.displaced(np.zeros_like, below)


def condensed_pair(pair, upper):
    """A pair of which one body is kept, a state in which they touch, and the solver made there."""
    blocks = pair()
    problem, near = sunk(blocks, upper=upper, lower=METAL if upper is SOFT else SOFT)
    return blocks, near, condensed(problem, near)


@KEPT
def test_the_bulk_of_a_tangent_before_still_solves(pair, upper):
    """In some iterations, after which the next tangent's is factorised."""
    blocks, near, solver = condensed_pair(pair, upper)
    bodies = solver.way._bodies
    solves(solver)
    assert not bodies.bulk.worn  # it is that of this very tangent
    solver.assemble(soft_moved(blocks, upper, 0.02, 0.01))
    solves(solver)
    assert bodies.bulk.worn and bodies.bulk.factorised == 1 and not bodies.renewed
    solver.assemble(near)
    solves(solver)
    assert bodies.bulk.factorised == 2 and not bodies.bulk.worn


@KEPT
def test_a_bulk_that_does_not_do_is_factorised_at_once(pair, upper):
    """States as different as can be: the whole is not factorised, and no solve has failed."""
    blocks, near, solver = condensed_pair(pair, upper)
    bodies, rhs = solver.way._bodies, forces(solver.problem)
    solver.assemble(soft_moved(blocks, upper, 0.9, 0.5))
    for _ in range(2):  # the second finds the bulk there
        found = solves(solver, rhs)
        wanted = exact(solver.matrix, rhs)
        np.testing.assert_allclose(found.array_r, wanted, atol=1e-6 * np.abs(wanted).max())
        assert bodies.renewed and bodies.bulk.worn and bodies.bulk.factorised == 2
    assert solver.way._whole is None and solver.way._failures == 0
    solver.assemble(near)
    assert not bodies.renewed and bodies.bulk.factorised == 3


def test_a_soft_body_that_contact_alone_holds(pair):
    """Without contact its bulk is singular; held at the unknowns of contact it is not."""
    problem, x = sunk(pair(), held=("bottom",))
    solves(condensed(problem, x))


# -- whole runs -----------------------------------------------------------------------------------


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


def simulated(data, **solver):
    data = data | {"solver": solver}
    return solved(data)


@pytest.mark.parametrize("case", [platen, tied, axisymmetric, q2, swapped, bent])
def test_a_run_is_that_with_the_whole_factorised(tmp_path, case):
    data = case(tmp_path)
    ours, whole = simulated(data), simulated(data, petsc={"pc_type": "lu"})
    way = ours.stepper.solver.way
    assert isinstance(way._bodies, CondensedBodies) and not way._given_up
    assert 0 < way._bodies.bulk.factorised < ours.stepper.solver.assembled
    small = 1e-8 * max(abs(row.normal_force) for row in whole.rows)
    for a, b in zip(ours.rows, whole.rows, strict=True):
        assert a.normal_force == pytest.approx(b.normal_force, abs=small)
        assert a.tangential_force == pytest.approx(b.tangential_force, abs=small)
    spent = [sum(row.newton_iterations for row in sim.rows) for sim in (ours, whole)]
    assert spent[0] <= spent[1] + 1
