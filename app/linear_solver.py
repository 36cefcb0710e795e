"""The tangent's matrix and what was factorised of it last."""

from __future__ import annotations

from petsc4py import PETSc

from app.equilibrium import Equilibrium


class LinearSolver:
    """Solves with the tangent of the state it was last assembled at.

    PETSc factorises when it first solves with a changed matrix, so that further solves cost a
    substitution only.

    Attributes:
        matrix: the tangent, supports and platens included.
        assembled: how often it was assembled, and so factorised.
    """

    def __init__(self, problem: Equilibrium, x: PETSc.Vec) -> None:
        """Make room for the tangent at ``x``; collective."""
        self.problem = problem
        self.matrix = problem.new_matrix(x)
        self.assembled = 0
        self._pattern = problem.pattern_changes
        self._ksp: PETSc.KSP | None = None

    def use(self, ksp: PETSc.KSP) -> None:
        """Solve with ``ksp``, whose operators this matrix becomes."""
        self._ksp = ksp
        ksp.setOperators(self.matrix)

    @property
    def ksp(self) -> PETSc.KSP:
        """PETSc's solver."""
        assert self._ksp is not None, "use() comes first"
        return self._ksp

    def assemble(self, x: PETSc.Vec) -> None:
        """Assemble the exact tangent at ``x``; collective."""
        self.problem.jacobian(None, x, self.matrix, self.matrix)
        self._changed()

    def solve_from(self, x: PETSc.Vec, rhs: PETSc.Vec, increment: PETSc.Vec) -> bool:
        """Solve with the tangent at ``x`` for an increment that meets prescribed values.

        Args:
            x: state, m.
            rhs: out-of-balance forces with the sign of loads; changed.
            increment: holds what is prescribed, at the held unknowns; the rest is found.

        Returns:
            Whether the solution is to be trusted.
        """
        problem = self.problem
        problem.assemble_tangent(x, self.matrix)
        rows = problem.held_dofs() + problem.first
        self.matrix.zeroRowsColumns(rows, 1.0, x=increment, b=rhs)
        self._changed()
        return self.solve(rhs, increment)

    def solve(self, rhs: PETSc.Vec, solution: PETSc.Vec) -> bool:
        """Solve with the tangent assembled last; returns whether it worked."""
        self.ksp.solve(rhs, solution)
        return self.forget_failure()

    def forget_failure(self) -> bool:
        """Drop a factorisation that failed, over which the next solve would stumble.

        Returns:
            False if the last solve failed.
        """
        if self.ksp.getConvergedReason() >= 0:
            return True
        self.ksp.reset()
        self.ksp.setOperators(self.matrix)
        return False

    def _changed(self) -> None:
        """Take note of new entries, and of a new pattern.

        PETSc exchanges the matrix's inside on an addition with another pattern and does not see
        by itself that the factorisation's analysis is out of date.
        """
        self.assembled += 1
        if self._pattern != self.problem.pattern_changes:
            self._pattern = self.problem.pattern_changes
            self.ksp.reset()
            self.ksp.setOperators(self.matrix)
