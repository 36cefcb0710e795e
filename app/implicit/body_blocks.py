"""Direct solves of bodies in contact, each factorised by itself where one of them is far stiffer.

The stiff bodies are condensed (:mod:`tribox.app.implicit.condensed_bodies`), or each body is solved
for in turn (:mod:`tribox.app.implicit.body_blocks`): in space, on several ranks, and where most
unknowns are of contact. Where no body can be kept the whole tangent is factorised, and so it is
where solving by bodies does not get there: for that tangent, and for good where that happens often.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from weakref import ref

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.free_bodies import supports_at_hand
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.implicit.condensed_bodies import CLOSE, CondensedBodies, can_condense
from tribox.app.implicit.coupled_factor import DIRECT
from tribox.app.implicit.factor import Factor, positive_solver
from tribox.app.implicit.kept_bodies import KeptBodies, kept_bodies
from tribox.app.implicit.linear_way import CLOSEST, LEFT, petsc_kinds
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Ints

# Solves that failed are weighed against those that did not: three in a row, or more than one in
# six, are too many.
FAILED, TOO_MANY = 5, 15


class BodyBlocks:
    """Solves with the tangent, as PETSc's preconditioner in Python.

    Attributes:
        direct, part: see :class:`tribox.app.implicit.linear_way.LinearWay`.
    """

    direct, part = True, "factorisation"

    def __init__(
        self, ksp: PETSc.KSP, matrix: PETSc.Mat, problem: Equilibrium, stiff: Sequence[Solid]
    ) -> None:
        """Solve by ``ksp``, which leaves all to this object; collective.

        Args:
            ksp: PETSc's solver, of type "preonly".
            matrix: the tangent.
            problem: that it is the tangent of.
            stiff: bodies that may be kept.
        """
        self._ksp, self._matrix, self._problem, self._stiff = ksp, matrix, problem, stiff
        self._prefix = ksp.getOptionsPrefix() or ""
        PETSc.Options(self._prefix)["pc_type"] = PETSc.PC.Type.PYTHON
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(_Preconditioner(self))
        self._supports: tuple[object, ...] | None = None  # that the bodies were chosen for
        self._bodies: CondensedBodies | BodyByBody | None = None
        self._whole: Factor | None = None  # of the tangent; None: it is solved by the bodies
        self._fallen = False  # whether that is so of the tangent at hand only
        self._given_up = False  # whether it is so for good
        self._chosen = False  # whether the bodies are
        self._remade = False  # whether an analysis was made between two tangents
        self._works = False  # whether what was factorised last could be
        self._failures = 0
        self._share = LEFT  # of forces that a solve may leave out of balance
        self._rest = problem.new_vector()

    def kinds(self) -> str:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        return petsc_kinds(str(DIRECT["ksp_type"]), str(DIRECT["pc_type"]))

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

    def set_up(self, widened: bool) -> bool:
        """Factorise; see :class:`tribox.app.implicit.linear_way.LinearWay`; collective."""
        anew = self._make(widened) or self._remade
        self._remade = False
        self._ksp.setOperators(self._matrix)
        self._ksp.getPC().setFailedReason(PETSc.PC.FailedReason.NOERROR)
        self._ksp.setUp()
        return anew

    def _make(self, widened: bool) -> bool:
        """Factorise; returns whether that began with an analysis."""
        chosen = self._choose()
        if self._fallen:
            self._drop_whole()
        self._given_up = self._given_up or self._failures >= TOO_MANY
        if self._bodies is not None and not self._given_up:
            self._works, anew = self._make_bodies(widened)
        else:
            anew = self._whole is None or widened
            self._make_whole(anew)
        return anew or chosen

    def _make_bodies(self, widened: bool) -> tuple[bool, bool]:
        """Factorise by bodies; in turn from where the bulk is not symmetric: pressure that follows.

        Returns:
            Whether that worked, and whether nothing of earlier tangents is in use.
        """
        assert self._bodies is not None
        works, anew = self._bodies.make(self._matrix, widened)
        if isinstance(self._bodies, BodyByBody) or self._bodies.bulk.symmetric:
            return works, anew
        self._bodies.destroy()
        bodies = kept_bodies(self._problem, self._stiff)
        assert bodies is not None
        self._bodies = BodyByBody(self._problem, bodies, self._prefix)
        return self._bodies.make(self._matrix, True)

    def _choose(self) -> bool:
        """Choose the bodies that are kept, if that is to be done anew; returns whether it was."""
        supports = supports_at_hand(self._problem)
        same = supports == self._supports
        if same and self._chosen:
            return False
        self.renew()
        if not same and self._supports is not None:
            self._failures, self._given_up = 0, False
        self._supports, self._chosen = supports, True
        bodies = kept_bodies(self._problem, self._stiff)
        if bodies is not None:
            found = self._solver_of(bodies)
            if found.works:
                self._bodies = found
            else:
                found.destroy()
        return True

    def _solver_of(self, bodies: KeptBodies) -> CondensedBodies | BodyByBody:
        condense = can_condense(self._problem, bodies)
        kind = CondensedBodies if condense else BodyByBody
        return kind(self._problem, bodies, self._prefix)

    def _make_whole(self, anew: bool) -> None:
        """Factorise the whole tangent, ``anew`` with its analysis."""
        if anew:
            self._drop_whole()
            self._whole = Factor(self._matrix, self._prefix)
        assert self._whole is not None
        self._works = self._whole.make()

    def _fall_back(self) -> None:
        """Factorise the whole of the tangent that is at hand, and of no other."""
        self._make_whole(anew=True)
        self._fallen = True

    # -- solution -----------------------------------------------------------------------------

    def aim(self, share: float, on_path: bool = False) -> None:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        self._share = share

    @property
    def closest(self) -> float:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        return CLOSE if isinstance(self._bodies, CondensedBodies) else CLOSEST

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve for ``x`` (m) with forces ``b`` (N); collective."""
        if not self._chosen:  # forgotten after a solve that failed
            self._remade = self._make(True)
        if self._whole is None and not self._solve_by_bodies(b, x):
            self._fall_back()
        if self._whole is not None and self._works:
            x.array[:] = self._whole.solve(b.array_r)
        elif self._whole is not None:
            pc.setFailedReason(PETSc.PC.FailedReason.SUBPC_ERROR)

    def _solve_by_bodies(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve for one body after the other; returns whether that worked.

        What is prescribed is put in beforehand: displacements are not to be added to forces in
        norms.
        """
        assert self._bodies is not None
        held = self._problem.constrained_dofs()
        b.copy(self._rest)
        self._rest.array[held] = 0.0
        converged = self._works and self._bodies.solve(self._rest, x, self._share)
        self._failures = max(self._failures - 1, 0) if converged else self._failures + FAILED
        x.array[held] = b.array_r[held]
        return converged

    # -- restart ------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        condensed = self._bodies if isinstance(self._bodies, CondensedBodies) else None
        return {
            "failures": self._failures,
            "given_up": self._given_up,
            "fallen": self._fallen,
            "worn": condensed is not None and condensed.bulk.worn,
            "renewed": condensed is not None and condensed.renewed and self._whole is None,
        }

    def restore(self, kept: Snapshot, set_up: Callable[[], None]) -> None:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        self._supports, self._failures, self._given_up = None, 0, kept["given_up"]
        set_up()
        self._failures = kept["failures"]
        if isinstance(self._bodies, CondensedBodies):
            self._bodies.bulk.worn = kept["worn"]
            if kept["renewed"]:
                self._bodies.renew()
        if kept["fallen"]:
            self._fall_back()


class _Preconditioner:
    """What PETSc calls; it keeps nothing alive, for Python does not see what PETSc holds."""

    def __init__(self, blocks: BodyBlocks) -> None:
        self._blocks = ref(blocks)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """See :meth:`BodyBlocks.apply`."""
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
# :math:`A_{ss}`, with the stiffness of its contacts, is factorised for each tangent; K, the stiff
# bodies undeformed and without contacts, once. Each solve leaves of the one before it about the
# stiffness of the others over that of the stiff bodies: where these are a thousand times stiffer
# two to four solves do. As contacts that move on couple other nodes of two bodies, the pattern of
# :math:`A_{ss}`, and with it the analysis of its factorisation, stays what it was.

# A stiff body that is moved makes such forces that those of the others are nothing beside: they
# have to follow once.
LEAST = 3
LIMIT = 9  # solves: the factorisation of the whole is no dearer than that
MOST = 1e-6
"""Share of the forces that a solve may leave. With 1e-3 of them at the start of a step other points
slipped than by a factorisation of the whole: 651 Newton iterations instead of 173, with 221 700
unknowns."""
HALF = 0.5  # of the forces of two solves before, that must not be left


class BodyByBody:
    """Keeps the factorisations, and solves with them.

    Attributes:
        works: whether the stiff bodies could be factorised.
        solves: of one body, in all.
    """

    def __init__(self, problem: Equilibrium, bodies: KeptBodies, prefix: str) -> None:
        """Factorise the stiff bodies; collective.

        Args:
            problem: the equilibrium.
            bodies: which are stiff.
            prefix: of the options for MUMPS.
        """
        self._prefix = prefix
        K = bodies.tangent(problem)
        self._stiff = Factor(K, prefix, symmetric=True, solver=positive_solver(K.comm))
        self.works = self._stiff.make()
        self._kept, self._others = bodies.dofs, bodies.others
        self._first = problem.first
        self._rows = self._global(self._others, problem.comm)
        # Of the stiff bodies the rows that contacts couple to the others.
        self._coupling: PETSc.Mat | None = None
        self._touched_rows: PETSc.IS | None = None
        self._matrix: PETSc.Mat | None = None
        self._block: PETSc.Mat | None = None  # of the other bodies, as it is factorised
        self._source: PETSc.Mat | None = None  # as it is taken out of the tangent
        self._factor: Factor | None = None
        self._left, self._step = problem.new_vector(), problem.new_vector()
        self._image = problem.new_vector()
        self.solves = 0

    def _global(self, dofs: Ints, comm: MPI.Comm) -> PETSc.IS:
        """Owned local unknowns as PETSc numbers them; collective."""
        return PETSc.IS().createGeneral(dofs + self._first, comm=comm)

    def make(self, matrix: PETSc.Mat, widened: bool) -> tuple[bool, bool]:
        """Factorise the other bodies' block of the tangent; collective.

        Args:
            matrix: the tangent.
            widened: whether its pattern is another than that of the last one.

        Returns:
            Whether that worked, and whether the block has another pattern.
        """
        self._matrix = matrix
        anew = self._extract(matrix, widened)
        self._couple(matrix, widened)
        if anew:
            self._analyse()
        assert self._factor is not None
        return self._factor.make(), anew

    def _extract(self, matrix: PETSc.Mat, widened: bool) -> bool:
        """Take out the other bodies' block; returns whether it has another pattern."""
        source, block = self._source, self._block
        if source is None or widened:
            source = matrix.createSubMatrix(self._rows, self._rows)
            if self._source is not None and self._source is not block:
                self._source.destroy()
            self._source = source
            if block is None or not _same_pattern(block, source):
                if block is not None:
                    block.destroy()
                self._block = source
                return True
        else:
            matrix.createSubMatrix(self._rows, self._rows, source)
        if block is not source:
            assert block is not None
            source.copy(block, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        return False

    def _couple(self, matrix: PETSc.Mat, widened: bool) -> None:
        """Take out what the other bodies do to the stiff ones: the few rows that are not empty."""
        if self._coupling is not None and not widened:
            matrix.createSubMatrix(self._touched_rows, self._rows, self._coupling)
            return
        comm = matrix.comm.tompi4py()
        kept = self._global(self._kept, comm)
        every = matrix.createSubMatrix(kept, self._rows)
        self._touched = self._kept[np.diff(every.getValuesCSR()[0]) > 0]
        for old in (self._coupling, self._touched_rows):
            if old is not None:
                old.destroy()
        self._touched_rows = self._global(self._touched, comm)
        self._coupling = matrix.createSubMatrix(self._touched_rows, self._rows)
        self._felt = self._coupling.createVecLeft()
        for part in (every, kept):
            part.destroy()

    def _analyse(self) -> None:
        assert self._block is not None
        if self._factor is not None:
            self._factor.destroy()
        self._factor = Factor(self._block, self._prefix)

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, share: float) -> bool:
        """Solve with the tangent for ``x`` (m) until a share of the forces ``b`` (N) is left.

        Collective. No more than :data:`MOST` is left, whatever the share.

        Returns:
            Whether it got there.
        """
        share = min(share, MOST)
        assert self._matrix is not None and self._factor is not None
        b.copy(self._left)
        x.set(0.0)
        norms = [b.norm()]
        if not np.isfinite(norms[0]):
            x.set(np.nan)
            return True
        moves = (self._move_others, self._move_kept)
        for move in itertools.islice(itertools.cycle(moves), LIMIT):
            move(x)
            self.solves += 1
            norms.append(self._left.norm())
            if len(norms) <= LEAST:
                continue
            if norms[-1] <= share * norms[0]:
                return True
            if not norms[-1] <= HALF * norms[-3]:
                return False
        return False

    def _move_others(self, x: PETSc.Vec) -> None:
        """Solve for the other bodies: the stiff ones feel it by few unknowns only."""
        assert self._factor is not None and self._coupling is not None
        x.array[self._others] += self._factor.solve(self._left.array_r[self._others])
        self._coupling.mult(self._factor.solution, self._felt)
        self._left.array[self._others] = 0.0
        self._left.array[self._touched] -= self._felt.array_r

    def _move_kept(self, x: PETSc.Vec) -> None:
        """Solve for the stiff bodies, whose tangent may be another than the one that is kept."""
        assert self._matrix is not None
        self._step.set(0.0)
        self._step.array[self._kept] = self._stiff.solve(self._left.array_r[self._kept])
        x.axpy(1.0, self._step)
        self._matrix.mult(self._step, self._image)
        self._left.axpy(-1.0, self._image)

    def destroy(self) -> None:
        """Give the memory back; collective."""
        for part in (self._factor, self._stiff, self._source, self._block, self._coupling):
            if part is not None:
                part.destroy()


def _same_pattern(one: PETSc.Mat, other: PETSc.Mat) -> bool:
    """Whether two matrices have entries at the same places, on all ranks; collective."""
    pairs = zip(one.getValuesCSR()[:2], other.getValuesCSR()[:2], strict=True)
    same = all(np.array_equal(a, b) for a, b in pairs)
    return bool(one.comm.tompi4py().allreduce(same, op=MPI.LAND))
