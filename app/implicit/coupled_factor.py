"""The whole tangent factorised directly (MUMPS)."""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.implicit.linear_way import CLOSEST, petsc_kinds

DIRECT: dict[str, str | float | bool] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}


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
