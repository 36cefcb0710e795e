"""Solves of bodies in contact, one after the other where one of them is far stiffer.

The stiff bodies are factorised once; the others for each tangent, or solved for by iterations where
they are too large. Where no body can be kept the whole tangent is solved with in the same way, and
so it is where solving by bodies does not get there: for that tangent, and for good where that
happens often. Where iterations take longer than factorisations would, these may take their place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from weakref import ref

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.matrix_values import PlacesOfPart
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.equilibrium.supports import supports_at_hand
from tribox.app.implicit.factor import (
    CLOSEST,
    DIRECT,
    Effort,
    Factor,
    LinearWay,
    factors_fit,
    petsc_kinds,
    positive_solver,
)
from tribox.app.implicit.kept_bodies import KeptBodies, kept_bodies
from tribox.app.implicit.multigrid import (
    CLOSE,
    ITERATED,
    KRYLOV,
    Multigrid,
    MultigridSolver,
    damped,
    rigid_motions_of,
)
from tribox.app.implicit.volume_split import Volumes, VolumeSplitSolver
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Ints

# Solves that failed are weighed against those that did not: three in a row, or more than one in
# six, are too many.
FAILED, TOO_MANY = 5, 15


# In space a factorisation of up to SMALL unknowns takes as long as some DEAR iterations; of more,
# as many more times as long as there are more unknowns (measured with 59 055: .5 s and 10 ms; an
# iteration with 199 353 66 ms, of factors an estimate). With PATIENCE times as many above that the
# next system is factorised.
DEAR, SMALL, PATIENCE = 100, 50_000, 3


class IterationBudget:
    """Whether solves by iterations take so long that factorisations would be cheaper.

    Attributes:
        most: iterations of the longest solve since the budget was used up first; 0: it never was.
        over: iterations above what factorisations cost; spent: of the solve that goes on.
        refused: whether memory was too short for factors.
        stiff: unknowns of stiff bodies that are factorised as their multigrid does not get there.
    """

    def __init__(self, size: int) -> None:
        """A budget for systems of so many unknowns in all."""
        self.most, self.over, self.spent = 0, 0.0, 0
        self.refused, self.stiff = False, 0
        self._dear = DEAR * max(1.0, size / SMALL)

    def close(self) -> None:
        """Take note of what a solve has spent, whether it converged or not."""
        self.over = max(self.over + self.spent - self._dear, 0.0)
        if self.most or self.over > PATIENCE * self._dear:
            self.most = max(self.most, self.spent)
        self.spent = 0


class BodyBlocks(LinearWay):
    """Solves with the tangent, as PETSc's preconditioner in Python.

    Attributes:
        count: is told the iterations of each solve.
        budget: what solves by iterations may take.
        turned: whether systems are factorised because that was used up.
    """

    def __init__(
        self,
        ksp: PETSc.KSP,
        matrix: PETSc.Mat,
        problem: Equilibrium,
        stiff: Sequence[Solid],
        count: Callable[[int], None],
        may_turn: bool = False,
    ) -> None:
        """Solve by ``ksp``, which leaves all to this object; collective.

        Args:
            ksp: PETSc's solver; where it is not of type "preonly", what is large is solved for
                by iterations.
            may_turn: whether to factorise where iterations take too long, if memory allows.
        """
        self._ksp, self._matrix, self._problem, self._stiff = ksp, matrix, problem, stiff
        self.direct, self.count = ksp.getType() == PETSc.KSP.Type.PREONLY, count
        self.budget, self.turned = IterationBudget(problem.size), False
        self._may_turn = may_turn and problem.dim == 3
        self._prefix = ksp.getOptionsPrefix() or ""
        options = PETSc.Options(self._prefix)
        for key in () if self.direct else damped(KRYLOV, problem.comm.size):
            options.delValue(key)  # they become those of the solvers that are made here
        options["ksp_type"], options["pc_type"] = PETSc.KSP.Type.PREONLY, PETSc.PC.Type.PYTHON
        ksp.setFromOptions()
        pc = ksp.getPC()
        pc.setPythonContext(_Preconditioner(self))
        self._supports: tuple[object, ...] | None = None  # that the bodies were chosen for
        self._bodies: BodyByBody | None = None
        self._whole: Factor | MultigridSolver | None = None  # None: it is solved by the bodies
        self._fallen = False  # whether that is so of the tangent at hand only
        self._given_up = False  # whether it is so for good
        self._chosen = False  # whether the bodies are
        self._works = False  # whether what was factorised last could be
        self._failures = 0
        self._share = ITERATED  # of forces that a solve may leave out of balance
        self._rest = problem.new_vector()

    @property
    def effort(self) -> Effort:
        """What solves so far took that was too much."""
        return Effort(self.budget.most, self.turned, self.budget.stiff)

    @property
    def part(self) -> str:
        return "factorisation" if self.direct else "preconditioner"

    def kinds(self) -> str:
        return petsc_kinds(str(DIRECT["ksp_type"]), str(DIRECT["pc_type"]))

    def _tell(self, iterations: int) -> None:
        self.budget.spent += iterations
        self.count(iterations)

    # -- factorisations -----------------------------------------------------------------------

    def renew(self) -> None:
        """Forget all factorisations; collective."""
        self._drop_whole()
        if self._bodies is not None:
            self._bodies.destroy()
        self._bodies, self._chosen = None, False

    def _drop_whole(self) -> None:
        if self._whole is not None:
            self._whole.destroy()
        self._whole, self._fallen = None, False

    def set_up(self, widened: bool) -> None:
        self._make(widened)
        self._ksp.setOperators(self._matrix)
        self._ksp.getPC().setFailedReason(PETSc.PC.FailedReason.NOERROR)
        self._ksp.setUp()

    def _make(self, widened: bool) -> None:
        """Factorise by bodies, or the whole."""
        self._choose()
        if self._fallen:
            self._drop_whole()
        self._given_up = self._given_up or self._failures >= TOO_MANY
        if self._bodies is not None and not self._given_up:
            self._works = self._bodies.make(self._matrix, widened)
        else:
            self._make_whole(widened)

    def _choose(self) -> None:
        """Choose the bodies that are kept, if that is to be done anew."""
        supports = supports_at_hand(self._problem)
        same = supports == self._supports
        if same and self._chosen:
            return
        self.renew()
        if not same and self._supports is not None:
            self._failures, self._given_up = 0, False
        self._supports, self._chosen = supports, True
        bodies = kept_bodies(self._problem, self._stiff)
        if bodies is not None:
            count = None if self.direct else self._tell
            found = BodyByBody(self._problem, bodies, self._prefix, count, self.budget.stiff)
            if found.works:
                self._bodies = found
            else:
                found.destroy()

    def _make_whole(self, widened: bool) -> None:
        """Make ready to solve with the whole tangent."""
        if self._whole is None or (widened and isinstance(self._whole, Factor)):
            self._drop_whole()
            self._whole = self._new_whole()
        self._works = self._whole.make(widened)

    def _new_whole(self) -> Factor | MultigridSolver:
        comm, size = self._problem.comm, self._problem.size
        # What iterations for the bodies do not get to is no easier for those of the whole.
        if self.direct or (self._bodies is not None and factors_fit(comm, size)):
            return Factor(self._matrix, self._prefix)
        near, prefix = rigid_motions_of(self._problem), f"{self._prefix}whole_"
        return MultigridSolver(self._matrix, near, prefix, KRYLOV, self._tell)

    # -- solution -----------------------------------------------------------------------------

    def aim(self, share: float, on_path: bool = False) -> None:
        if not self.direct:
            share = max(share, CLOSE if on_path else ITERATED)
        self._share = share

    @property
    def closest(self) -> float:
        return CLOSEST if self.direct else CLOSE

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve for ``x`` (m) with forces ``b`` (N); collective."""
        works = self._solve(b, x)
        self.budget.close()
        if self.budget.most and not self.direct and self._may_turn and not self.budget.refused:
            self.budget.refused = not factors_fit(self._problem.comm, self._problem.size)
            if not self.budget.refused:
                self._turn()
                works = works or self._solve(b, x)
        if not works:
            pc.setFailedReason(PETSc.PC.FailedReason.SUBPC_ERROR)

    def _turn(self) -> None:
        """Factorise from now on, by bodies again; collective."""
        self.renew()
        self.direct = self.turned = True
        self._failures, self._given_up = 0, False

    def _solve(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve with what was made for the tangent at hand; returns whether that worked."""
        if not self._chosen:  # forgotten after a solve that failed
            self._make(True)
        if self._whole is None and not self._solve_by_bodies(b, x):
            # With the whole of the tangent that is at hand, and of no other.
            self._drop_whole()
            self._make_whole(widened=True)
            self._fallen = True
        return self._whole is None or (self._works and self._solve_whole(b, x))

    def _solve_whole(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve with the whole tangent; returns whether that worked."""
        if isinstance(self._whole, Factor):
            x.array[:] = self._whole.solve(b.array_r)
            return True
        assert self._whole is not None
        held = self._without_prescribed(b)
        x.array[:] = self._whole.solve(self._rest.array_r, self._share * self._rest.norm())
        x.array[held] = b.array_r[held]
        return self._whole.converged

    def _solve_by_bodies(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve for one body after the other; returns whether that worked."""
        assert self._bodies is not None
        held = self._without_prescribed(b)
        converged = self._works and self._bodies.solve(self._rest, x, self._share)
        self.budget.stiff = self._bodies.factorised
        self._failures = max(self._failures - 1, 0) if converged else self._failures + FAILED
        x.array[held] = b.array_r[held]
        return converged

    def _without_prescribed(self, b: PETSc.Vec) -> Ints:
        """Leave the forces alone in the rest; returns where displacements are prescribed.

        These are put in beforehand: they are not to be added to forces in norms.
        """
        held = self._problem.constrained_dofs()
        b.copy(self._rest)
        self._rest.array[held] = 0.0
        return held

    # -- restart ------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        spent = {"over": self.budget.over, "most": self.budget.most, "turned": self.turned}
        spent |= {"refused": self.budget.refused, "factorised": self.budget.stiff}
        return {"failures": self._failures, "given_up": self._given_up, **spent}

    @property
    def multigrid(self) -> Multigrid | None:
        """The preconditioner that is kept, if what is solved at present is solved by iterations."""
        solver = self._bodies.own if self._bodies is not None else None
        solver = self._whole if self._given_up or self._bodies is None else solver
        return solver.multigrid if isinstance(solver, MultigridSolver) else None

    def restore(self, kept: Snapshot) -> None:
        self._supports = None  # whatever supports there were, these are no others
        self._failures, self._given_up = kept["failures"], kept["given_up"]
        self.budget.over, self.budget.most = kept.get("over", 0.0), kept.get("most", 0)
        self.budget.refused = kept.get("refused", False)
        self.budget.stiff = kept.get("factorised", 0)
        size, comm = self._problem.size, self._problem.comm
        if kept["turned"] and self._may_turn and factors_fit(comm, size):
            self.direct = self.turned = True


class _Preconditioner:
    """What PETSc calls; it keeps nothing alive, for Python does not see what PETSc holds."""

    def __init__(self, blocks: BodyBlocks) -> None:
        self._blocks = ref(blocks)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        blocks = self._blocks()
        assert blocks is not None, "the solver that this belongs to is gone"
        blocks.apply(pc, b, x)


# -- Linear systems of bodies in contact, solved for one body after the other ----------------------
#
# With the unknowns k of stiff bodies on supports of their own, and s of all others, block
# Gauss-Seidel on the tangent A takes in turn
#
# .. math:: A_{ss} d_s = r_s, \quad K d_k = r_k, \quad r \leftarrow r - A d
#
# until little is left (Saad, Iterative methods for sparse linear systems, 2nd ed., 4.1.1).
# :math:`A_{ss}`, with the stiffness of its contacts, is factorised for each tangent, or solved with
# by iterations that leave a little; K, the stiff bodies undeformed and without contacts, is
# factorised once, or its multigrid made once where it is large. Each solve leaves of the
# one before it about the stiffness of the others over that of the stiff bodies: where these are a
# thousand times stiffer two to four solves do. As contacts that move on couple other nodes of two
# bodies, the pattern of :math:`A_{ss}`, and with it the analysis of its factorisation, stays what
# it was.

# A stiff body that is moved makes such forces that those of the others are nothing beside: they
# have to follow once.
LEAST = 3
LIMIT = 9  # solves: the factorisation of the whole is no dearer than that
MOST = 1e-6
"""Share of the forces that a solve may leave. With 1e-3 of them at the start of a step other points
slipped than by a factorisation of the whole: 651 Newton iterations instead of 173, with 221 700
unknowns."""
HALF = 0.5  # of the forces of two solves before, that must not be left
MARGIN = 0.5  # of the forces that may be left: what a solve by iterations leaves
FELT = 2e-4, 1e-2
"""Shares of the forces on the stiff bodies, and on the others, by more than which these put the
other ones out of balance when they are solved for in turn: no solve before need leave less. With
2e-3 and 5e-2 there were as many iterations, and a Newton iteration more in every fifth step."""
STIFF = dict(KRYLOV)  # options for stiff bodies beyond
KEPT_LIMIT = 30_000
"""Unknowns of stiff bodies up to which they are factorised in any case. At 34 680 both ways take
the same time where cells are even; graded ones take many more iterations."""


class BodyByBody:
    """Keeps the factorisations, and solves with them.

    Attributes:
        works: whether the stiff bodies could be factorised.
        own: the solver of the other bodies.
        factorised: unknowns of the stiff ones, if their multigrid did not get there; else 0.
    """

    def __init__(
        self,
        problem: Equilibrium,
        bodies: KeptBodies,
        prefix: str,
        count: Callable[[int], None] | None = None,
        factorised: int = 0,
    ) -> None:
        """Factorise the stiff bodies; collective.

        Args:
            count: is told iterations; None: all bodies are factorised.
            factorised: as the attribute, of earlier solves.
        """
        self.factorised = factorised
        self._prefix, self._count, self._problem = prefix, count, problem
        self._kept, self._places = bodies.dofs, PlacesOfPart(bodies.others, bodies.others)
        self._volumes = Volumes(problem, self._places.rows)
        self._stiff = self._solver_of_kept(bodies.tangent(problem))
        self.works = self._stiff.make()
        self._rows = self._global(bodies.others, problem.comm)
        self._rows.setBlockSize(problem.dim)
        # Of the stiff bodies the rows that contacts couple to the others.
        self._touched = PlacesOfPart(bodies.others[:0], bodies.others)
        self._coupling: PETSc.Mat | None = None
        self._touched_rows: PETSc.IS | None = None
        self._matrix: PETSc.Mat | None = None
        self._block: PETSc.Mat | None = None  # of the other bodies, as it is factorised
        self.own: Factor | MultigridSolver | None = None
        self._left, self._step = problem.new_vector(), problem.new_vector()
        self._image = problem.new_vector()

    def _global(self, dofs: Ints, comm: MPI.Comm) -> PETSc.IS:
        """Owned local unknowns as PETSc numbers them; collective."""
        return PETSc.IS().createGeneral(dofs + self._problem.first, comm=comm)

    def _solver_of_kept(self, K: PETSc.Mat) -> Factor | MultigridSolver:
        """Their solver, for good."""
        if self._count is None or self.factorised or K.size[0] <= KEPT_LIMIT:
            return Factor(K, self._prefix, symmetric=True, solver=positive_solver(K.comm))
        near = rigid_motions_of(self._problem, self._kept)
        return MultigridSolver(K, near, f"{self._prefix}kept_", STIFF, self._count, True)

    def _factorise_kept(self) -> Factor | None:
        """Factorise the stiff bodies after all, if memory allows; collective.

        Graded cells, or long ones, may be such that their multigrid does not get there.
        """
        before = self._stiff.matrix
        if not factors_fit(before.comm.tompi4py(), before.size[0]):
            return None
        K = before.convert(PETSc.Mat.Type.AIJ, PETSc.Mat())
        self._stiff.destroy()
        before.destroy()
        factor = Factor(K, self._prefix, symmetric=True, solver=positive_solver(K.comm))
        self._stiff = factor
        if not factor.make():
            return None
        self.factorised = K.size[0]
        return factor

    def make(self, matrix: PETSc.Mat, widened: bool) -> bool:
        """Factorise the other bodies' block of the tangent; collective.

        Returns whether that worked.
        """
        self._matrix = matrix
        anew = self._extract(matrix, widened)
        if self._count is not None and self._volumes:
            self._volumes.take_off(matrix, self._block)
        self._couple(matrix, widened)
        if anew:
            self._analyse()
        assert self.own is not None
        return self.own.make()

    def _extract(self, matrix: PETSc.Mat, widened: bool) -> bool:
        """Take out the other bodies' block; returns whether it has another pattern.

        What depends on that, but not on the rest of the tangent's, serves again.
        """
        block, places = self._block, self._places
        if block is not None and (places.find(matrix, block) if widened else places.found):
            places.take(matrix, block)
            return False
        if block is not None and not widened:
            matrix.createSubMatrix(self._rows, self._rows, block)
            return False
        if block is not None:
            block.destroy()
        self._block = matrix.createSubMatrix(self._rows, self._rows)
        places.find(matrix, self._block)
        return True

    def _couple(self, matrix: PETSc.Mat, widened: bool) -> None:
        """Take out what the other bodies do to the stiff ones: the few rows that are not empty."""
        if self._coupling is not None and not widened:
            if self._touched.found:
                self._touched.take(matrix, self._coupling)
            else:
                matrix.createSubMatrix(self._touched_rows, self._rows, self._coupling)
            return
        comm = matrix.comm.tompi4py()
        kept = self._global(self._kept, comm)
        every = matrix.createSubMatrix(kept, self._rows)
        touched = self._kept[np.diff(every.getValuesCSR()[0]) > 0]
        for old in (self._coupling, self._touched_rows):
            if old is not None:
                old.destroy()
        self._touched_rows = self._global(touched, comm)
        self._coupling = matrix.createSubMatrix(self._touched_rows, self._rows)
        self._touched = PlacesOfPart(touched, self._places.rows)
        self._touched.find(matrix, self._coupling)
        self._felt = self._coupling.createVecLeft()
        for part in (every, kept):
            part.destroy()

    def _analyse(self) -> None:
        assert self._block is not None
        if self.own is not None:
            self.own.destroy()
        if self._count is None:
            self.own = Factor(self._block, self._prefix)
            return
        near = rigid_motions_of(self._problem, self._places.rows)
        known = self._block, near, f"{self._prefix}own_", KRYLOV, self._count
        split = self._volumes
        self.own = VolumeSplitSolver(*known, split) if split else MultigridSolver(*known)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, share: float) -> bool:
        """Solve with the tangent for ``x`` (m) until a share of the forces ``b`` (N) is left.

        Collective. Where all bodies are factorised no more than :data:`MOST` is left, whatever the
        share. Returns whether it got there.
        """
        exact = isinstance(self.own, Factor)
        share = min(share, MOST) if exact else share
        norm, others = b.norm(), self._on_others(b)
        if not np.isfinite(norm):
            x.set(np.nan)
            return True
        b.copy(self._left)
        x.set(0.0)
        lefts, most = [norm], share * norm
        for number in range(LIMIT):
            stirred = self._on_others(self._left)
            if number % 2:
                self._move_kept(x, max(MARGIN * most, FELT[1] * stirred))
            else:
                # What kept bodies that are moved do to the others is followed as closely.
                follow = share * stirred if stirred > others else np.inf
                on_kept = math.sqrt(max(lefts[-1] ** 2 - stirred**2, 0.0))
                self._move_others(x, min(max(MARGIN * most, FELT[0] * on_kept), follow))
            lefts.append(self._left.norm())
            if len(lefts) <= LEAST:
                continue
            if lefts[-1] <= most:
                return True
            if not lefts[-1] <= HALF * lefts[-3]:
                return False
        return False

    def _on_others(self, forces: PETSc.Vec) -> float:
        """Norm of the forces on the other bodies, N; collective."""
        mine = forces.array_r[self._places.rows]
        return float(np.sqrt(self._problem.comm.allreduce(float(mine @ mine))))

    def _move_others(self, x: PETSc.Vec, most: float) -> None:
        """Solve for the other bodies: the stiff ones feel it by few unknowns only."""
        assert self.own is not None and self._coupling is not None
        forces = self._left.array_r[self._places.rows]
        if isinstance(self.own, Factor):
            x.array[self._places.rows] += self.own.solve(forces)
            self._left.array[self._places.rows] = 0.0
        else:
            x.array[self._places.rows] += self.own.solve(forces, most)
            self._left.array[self._places.rows] -= self.own.image().array_r
        self._coupling.mult(self.own.solution, self._felt)
        self._left.array[self._touched.rows] -= self._felt.array_r

    def _move_kept(self, x: PETSc.Vec, most: float) -> None:
        """Solve for the stiff bodies, whose tangent may be another than the one that is kept."""
        assert self._matrix is not None
        self._step.set(0.0)
        forces, stiff = self._left.array_r[self._kept], self._stiff
        found = stiff.solve(forces) if isinstance(stiff, Factor) else stiff.solve(forces, most)
        if isinstance(stiff, MultigridSolver) and not stiff.converged:
            factor = self._factorise_kept()
            found = found if factor is None else factor.solve(forces)
        self._step.array[self._kept] = found
        x.axpy(1.0, self._step)
        self._matrix.mult(self._step, self._image)
        self._left.axpy(-1.0, self._image)

    def destroy(self) -> None:
        """Give the memory back; collective."""
        K = self._stiff.matrix
        for part in (self.own, self._stiff, K, self._block, self._coupling):
            if part is not None:
                part.destroy()
