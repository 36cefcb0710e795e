"""Flexible GMRES with smoothed aggregation (GAMG), for more unknowns than can be factorised."""

from __future__ import annotations

import math
from collections.abc import Callable

from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.implicit.linear_way import CLOSEST, petsc_kinds

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
# A solve that takes more than MANY iterations, and more than WORN times as many as the first with
# the preconditioner, has the next one made anew: that costs as much as some 35 iterations.
MANY, WORN = 30, 1.5
CLOSE = 1e-5
"""Share of the forces that a first solve from a start on the path may leave. With the usual one the
start's smooth errors remain, points open or slip by them, and a solve more is needed."""


class Multigrid:
    """An iterative solver, whatever its options are, whose preconditioner is kept.

    Operator and finest smoother are those of the matrix at hand; the coarse spaces and their
    matrices are those of an earlier one until solves take too long. What changes from one tangent
    to the next is the contact, which the smoother sees; the bodies, for which there are coarse
    spaces, hardly change. Nor does a wider pattern matter to them.

    Attributes:
        direct, part, closest: see :class:`tribox.app.implicit.linear_way.LinearWay`.
        made: how often the preconditioner was made.
    """

    direct, part, closest = False, "preconditioner", CLOSEST

    def __init__(self, ksp: PETSc.KSP, matrix: PETSc.Mat, near: PETSc.NullSpace) -> None:
        """Solve by ``ksp`` with ``matrix``, whose near-nullspace is ``near``."""
        self._ksp, self._matrix, self._near = ksp, matrix, near
        self._is_made = False
        self._fresh: float | None = None  # iterations of the first solve with the preconditioner
        self._iterations = 0.0  # of the last solve before the run was resumed
        self._usual = self._share = float(ksp.getTolerances()[0])  # of forces, left by a solve
        self.made = 0

    def kinds(self) -> str:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        return petsc_kinds(self._ksp.getType(), self._ksp.getPC().getType())

    def worn(self) -> bool:
        """Whether the last solve with the preconditioner took too many iterations."""
        last = self._last_iterations() if self._is_made else 0
        if last == 0:
            return False
        if self._fresh is None:
            self._fresh = last
        return last > max(MANY, WORN * self._fresh)

    def renew(self) -> None:
        """Forget the preconditioner with its coarse spaces; collective."""
        self._ksp.reset()
        self._is_made, self._fresh = False, None

    def set_up(self, widened: bool) -> bool:
        """Make the preconditioner if there is none that serves; collective.

        See :class:`tribox.app.implicit.linear_way.LinearWay`.
        """
        if self.worn():
            self.renew()
        anew, self._is_made = not self._is_made, True
        self.made += anew
        self._matrix.setNearNullSpace(self._near)
        self._ksp.setOperators(self._matrix)
        preconditioner = self._ksp.getPC()
        preconditioner.setReusePreconditioner(not anew)
        self._ksp.setUp()
        preconditioner.setReusePreconditioner(True)
        return anew

    def aim(self, share: float, on_path: bool = False) -> None:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`; the options say what is usual."""
        self._share = min(self._usual, max(share, CLOSE)) if on_path else self._usual
        self._ksp.setTolerances(rtol=self._share)

    def snapshot(self) -> Snapshot:
        """What tells whether the preconditioner is worn."""
        return {"fresh": self._fresh, "iterations": self._last_iterations()}

    def restore(self, kept: Snapshot, set_up: Callable[[], None]) -> None:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        set_up()
        self._fresh, self._iterations = kept["fresh"], kept["iterations"]

    def _last_iterations(self) -> float:
        """Iterations that the last solve, or that before the run was resumed, took to the usual."""
        taken = float(self._ksp.getIterationNumber())
        if self._share < self._usual:
            taken *= math.log(min(self._usual, 0.5)) / math.log(self._share)
        return taken or self._iterations


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
