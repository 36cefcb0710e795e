"""A matrix factorised directly, by a solver of PETSc's of its own.

MUMPS, and CHOLMOD for matrices that are symmetric and positive: its substitutions take two thirds
of the time (102 400 unknowns in the plane: 15.6 and 23.5 ms). It works on one rank only.
"""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.implicit.linear_way import CLOSEST, petsc_kinds
from tribox.geometry.surfaces.facets import Floats

DIRECT: dict[str, str | float | bool] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}


def positive_solver(comm: PETSc.Comm) -> str:
    """PETSc's name of the solver for symmetric and positive matrices."""
    at_hand = any(PETSc.Sys.hasExternalPackage(name) for name in ("cholmod", "suitesparse"))
    if comm.getSize() == 1 and at_hand:
        return str(PETSc.Mat.SolverType.CHOLMOD)
    return str(PETSc.Mat.SolverType.MUMPS)


class Factor:
    """The factorisation of a matrix whose values may change.

    The analysis is made once, from the matrix as it is first; each change of its values is followed
    by a numeric factorisation.

    Attributes:
        solution: the last one.
        anew: that of earlier values only the analysis is in use, which no value depends on.
    """

    anew = False

    def __init__(
        self,
        matrix: PETSc.Mat,
        prefix: str,
        symmetric: bool = False,
        solver: str = PETSc.Mat.SolverType.MUMPS,
    ) -> None:
        """Prepare to factorise ``matrix``; collective.

        Args:
            solver: PETSc's name of the solver.
        """
        self._matrix, self._solver = matrix, solver
        self._ksp = PETSc.KSP().create(matrix.comm)
        self._ksp.setOptionsPrefix(prefix)
        self._ksp.setType(PETSc.KSP.Type.PREONLY)
        kind = PETSc.PC.Type.CHOLESKY if symmetric else PETSc.PC.Type.LU
        pc = self._ksp.getPC()
        pc.setType(kind)
        pc.setFactorSolverType(solver)
        if symmetric:
            matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._ksp.setOperators(matrix)
        self.solution, self._rhs = matrix.createVecs()

    def make(self, _widened: bool = False) -> bool:
        """Factorise the matrix as it is now; returns whether it could be done; collective."""
        self._ksp.setOperators(self._matrix)
        try:
            self._ksp.setUp()
            works = int(self._ksp.getPC().getFailedReason()) == PETSc.PC.FailedReason.NOERROR
        except PETSc.Error:
            if self._solver != PETSc.Mat.SolverType.CHOLMOD:
                raise  # MUMPS does so for options that it cannot take only
            works = False  # CHOLMOD also for a matrix that is not positive
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


class CoupledFactor:
    """A new factorisation for each matrix; its analysis is kept while the pattern stays.

    Attributes:
        direct, part, closest: see :class:`tribox.app.implicit.linear_way.LinearWay`.
    """

    direct, part, closest = True, "factorisation", CLOSEST

    def __init__(self, ksp: PETSc.KSP, matrix: PETSc.Mat) -> None:
        """Solve by ``ksp``, whatever its options are, with ``matrix``."""
        self._ksp, self._matrix, self._analysed = ksp, matrix, False

    def kinds(self) -> str:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        return petsc_kinds(self._ksp.getType(), self._ksp.getPC().getType())

    def renew(self) -> None:
        """Forget the factorisation with its analysis; collective."""
        self._ksp.reset()
        self._analysed = False

    def set_up(self, widened: bool) -> bool:
        """Factorise the matrix; see :class:`tribox.app.implicit.linear_way.LinearWay`; collective.

        PETSc exchanges the matrix's inside on an addition with another pattern and does not see
        by itself that the factorisation's analysis is out of date.
        """
        if widened:
            self.renew()
        anew, self._analysed = not self._analysed, True
        self._ksp.setOperators(self._matrix)
        self._ksp.setUp()
        return anew

    def aim(self, share: float, on_path: bool = False) -> None:
        """Nothing to do: a substitution leaves next to nothing."""

    def snapshot(self) -> Snapshot:
        """Nothing: the factorisation is made again from its matrices."""
        return {}

    def restore(self, kept: Snapshot, set_up: Callable[[], None]) -> None:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        set_up()
