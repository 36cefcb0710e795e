r"""Linear systems of bodies in contact, solved for one body after the other.

With the unknowns k of stiff bodies on supports of their own, and s of all others, block
Gauss-Seidel on the tangent A takes in turn

.. math:: A_{ss} d_s = r_s, \quad K d_k = r_k, \quad r \leftarrow r - A d

until little is left (Saad, Iterative methods for sparse linear systems, 2nd ed., 4.1.1).
:math:`A_{ss}`, with the stiffness of its contacts, is factorised for each tangent; K, the stiff
bodies undeformed and without contacts, once. Each solve leaves of the one before it about the
stiffness of the others over that of the stiff bodies: where these are a thousand times stiffer two
to four solves do. As contacts that move on couple other nodes of two bodies, the pattern of
:math:`A_{ss}`, and with it the analysis of its factorisation, stays what it was.
"""

from __future__ import annotations

import itertools

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.implicit.factor import Factor, positive_solver
from tribox.app.implicit.kept_bodies import KeptBodies
from tribox.geometry.surfaces.facets import Ints

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
