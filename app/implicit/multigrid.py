"""Flexible GMRES with smoothed aggregation (GAMG), for more unknowns than can be factorised."""

from __future__ import annotations

from collections.abc import Callable

from petsc4py import PETSc

from app.equilibrium.equilibrium import Equilibrium
from app.equilibrium.snapshot import Snapshot
from app.implicit.linear_way import petsc_kinds

KRYLOV: dict[str, str | float | bool] = {
    "ksp_type": "fgmres",
    # Newton's method gains three digits an iteration where it converges: more would be wasted.
    "ksp_rtol": 1e-3,
    "ksp_max_it": 200,
    "ksp_gmres_restart": 60,
    "pc_type": "gamg",
    # One symmetric sweep of Gauss-Seidel within each rank: it needs no bounds of eigenvalues,
    # and did not fail at a Poisson's ratio of 0.49, where incomplete factorisation did.
    "mg_levels_ksp_type": "richardson",
    "mg_levels_ksp_max_it": 1,
    "mg_levels_pc_type": "sor",
}
# Iterations, over those of the first solve with a preconditioner (at least FEW), from which it is
# made from nothing: smoothed aggregation keeps its coarse spaces while the pattern stays, and
# points that stuck may slip by now.
WORN, FEW = 2, 10


class Multigrid:
    """An iterative solver, whatever its options are: a new preconditioner for each matrix.

    Attributes:
        direct, part: see :class:`app.implicit.linear_way.LinearWay`.
    """

    direct, part = False, "preconditioner"

    def __init__(self, ksp: PETSc.KSP, matrix: PETSc.Mat, near: PETSc.NullSpace) -> None:
        """Solve by ``ksp`` with ``matrix``, whose near-nullspace is ``near``."""
        self._ksp, self._matrix, self._near = ksp, matrix, near
        self._fresh: int | None = None  # iterations of the first solve with a new preconditioner
        self._iterations = 0  # of the last solve before the run was resumed
        self._made = False

    def kinds(self) -> str:
        """See :class:`app.implicit.linear_way.LinearWay`."""
        return petsc_kinds(self._ksp.getType(), self._ksp.getPC().getType())

    def worn(self) -> bool:
        """Whether the last solve took far more iterations than the preconditioner's first."""
        last = self._last_iterations()
        if last == 0:
            return False
        if self._fresh is None:
            self._fresh = max(last, FEW)
        return last > WORN * self._fresh

    def renew(self) -> None:
        """Forget the preconditioner with its coarse spaces; collective."""
        self._ksp.reset()
        self._fresh, self._made = None, False

    def set_up(self, widened: bool) -> bool:
        """Make the preconditioner; see :class:`app.implicit.linear_way.LinearWay`; collective."""
        if widened or self.worn():
            self.renew()
        anew, self._made = not self._made, True
        self._matrix.setNearNullSpace(self._near)
        self._ksp.setOperators(self._matrix)
        self._ksp.setUp()
        return anew

    def aim(self, share: float) -> None:
        """Nothing to do: the options say what is left."""

    def snapshot(self) -> Snapshot:
        """What tells whether the preconditioner is worn."""
        return {"fresh": self._fresh, "iterations": self._last_iterations()}

    def restore(self, kept: Snapshot, set_up: Callable[[], None]) -> None:
        """See :class:`app.implicit.linear_way.LinearWay`."""
        set_up()
        self._fresh, self._iterations = kept["fresh"], kept["iterations"]

    def _last_iterations(self) -> int:
        """Iterations of the last solve, or of that before the run was resumed."""
        return int(self._ksp.getIterationNumber()) or self._iterations


def rigid_motions_of(problem: Equilibrium) -> PETSc.NullSpace:
    """Rigid motions, orthonormal, for smoothed aggregation; collective.

    Those of all bodies together serve each of them: smoothed aggregation restricts them to its
    aggregates, which lie within a body.
    """
    nodes = problem.owned // problem.dim
    position = problem.space.tabulate_dof_coordinates()[:nodes, : problem.dim]
    coordinates = problem.new_vector()
    coordinates.array[:] = position.reshape(-1)
    return PETSc.NullSpace().createRigidBody(coordinates)
