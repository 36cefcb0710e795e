"""The whole tangent factorised directly (MUMPS)."""

from __future__ import annotations

from petsc4py import PETSc

from app.equilibrium.snapshot import Snapshot

DIRECT: dict[str, str | float | bool] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}


class CoupledFactor:
    """A new factorisation for each matrix; its analysis is kept while the pattern stays.

    Attributes:
        direct, part: see :class:`app.implicit.linear_way.LinearWay`.
    """

    direct, part = True, "factorisation"

    def __init__(self, ksp: PETSc.KSP, matrix: PETSc.Mat) -> None:
        """Solve by ``ksp`` with ``matrix``."""
        self._ksp, self._matrix = ksp, matrix

    def worn(self, widened: bool) -> bool:
        """See :class:`app.implicit.linear_way.LinearWay`: an analysis is of one pattern.

        PETSc exchanges the matrix's inside on an addition with another pattern and does not see by
        itself that the analysis is out of date.
        """
        return widened

    def renew(self) -> None:
        """Forget the factorisation with its analysis; collective."""
        self._ksp.reset()

    def set_up(self) -> None:
        """Factorise the matrix; collective."""
        self._ksp.setOperators(self._matrix)
        self._ksp.setUp()

    def snapshot(self) -> Snapshot:
        """Nothing: the factorisation is made again from its matrices."""
        return {}

    def restore(self, kept: Snapshot) -> None:
        """Nothing to do."""
