"""A matrix factorised directly (MUMPS), by a solver of PETSc's of its own."""

from __future__ import annotations

from petsc4py import PETSc

from tribox.geometry.surfaces.facets import Floats


class Factor:
    """The factorisation of a matrix whose values may change.

    The analysis is made once, from the matrix as it is first; each change of its values is followed
    by a numeric factorisation.

    Attributes:
        solution: the last one.
    """

    def __init__(self, matrix: PETSc.Mat, prefix: str, symmetric: bool = False) -> None:
        """Prepare to factorise ``matrix``; collective.

        Args:
            matrix: square.
            prefix: of the options for MUMPS.
            symmetric: whether it is symmetric and positive.
        """
        self._matrix = matrix
        self._ksp = PETSc.KSP().create(matrix.comm)
        self._ksp.setOptionsPrefix(prefix)
        self._ksp.setType(PETSc.KSP.Type.PREONLY)
        kind = PETSc.PC.Type.CHOLESKY if symmetric else PETSc.PC.Type.LU
        pc = self._ksp.getPC()
        pc.setType(kind)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        if symmetric:
            matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._ksp.setOperators(matrix)
        self.solution, self._rhs = matrix.createVecs()

    def make(self) -> bool:
        """Factorise the matrix as it is now; returns whether it could be done; collective."""
        self._ksp.setOperators(self._matrix)
        self._ksp.setUp()
        works = int(self._ksp.getPC().getFailedReason()) == PETSc.PC.FailedReason.NOERROR
        if not works:
            self._ksp.reset()  # or PETSc would say of the next that it worked, and do nothing
        return works

    def solve(self, rhs: Floats) -> Floats:
        """The solution (n,) for a right-hand side (n,), owned rows each; collective."""
        self._rhs.array[:] = rhs
        self._ksp.solve(self._rhs, self.solution)
        return self.solution.array_r

    def destroy(self) -> None:
        """Give the memory back; collective."""
        self._ksp.destroy()
