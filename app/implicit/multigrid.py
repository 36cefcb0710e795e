"""Flexible GMRES with smoothed aggregation (GAMG), for more unknowns than can be factorised.

Of the whole tangent, or of the bodies that are solved for in turn
(:mod:`tribox.app.implicit.body_blocks`).
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.matrix_values import blocks_in_place
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.implicit.factor import CLOSEST, petsc_kinds
from tribox.forms.native import library
from tribox.geometry.surfaces.facets import Floats, Ints

SOURCE = "block_sweeps.c"

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
# For matrices that are symmetric and positive.
SYMMETRIC = {key: value for key, value in KRYLOV.items() if key != "ksp_gmres_restart"}
SYMMETRIC |= {"ksp_type": "cg", "ksp_norm_type": "unpreconditioned"}
# A solve that takes more than MANY iterations, and more than WORN times as many as the first with
# the preconditioner, has the next one made anew: that costs as much as some 35 iterations.
MANY, WORN = 30, 1.5
DAMPED = {"mg_levels_ksp_richardson_scale": 0.8}
"""Options beyond two ranks: where three meet, sweeps within each add up and raise errors. Boxes of
27 054 unknowns took 1465 iterations on four ranks, 254 on two."""
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
        direct, part, closest: see :class:`tribox.app.implicit.factor.LinearWay`.
        ksp: PETSc's solver.
        made: how often the preconditioner was made.
    """

    direct, part, closest = False, "preconditioner", CLOSEST

    def __init__(self, ksp: PETSc.KSP, matrix: PETSc.Mat, near: PETSc.NullSpace) -> None:
        """Solve by ``ksp`` with ``matrix``, whose near-nullspace is ``near``."""
        self.ksp, self._matrix, self._near = ksp, matrix, near
        self._is_made = False
        self._fresh: float | None = None  # iterations of the first solve with the preconditioner
        self._usual = self._share = float(ksp.getTolerances()[0])  # of forces, left by a solve
        self.made = 0

    def kinds(self) -> str:
        """See :class:`tribox.app.implicit.factor.LinearWay`."""
        return petsc_kinds(self.ksp.getType(), self.ksp.getPC().getType())

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
        self.ksp.reset()
        self._is_made, self._fresh = False, None

    def set_up(self, widened: bool) -> None:
        """Make the preconditioner if there is none that serves; collective.

        See :class:`tribox.app.implicit.factor.LinearWay`.
        """
        if self.worn():
            self.renew()
        anew, self._is_made = not self._is_made, True
        self.made += anew
        self._matrix.setNearNullSpace(self._near)
        self.ksp.setOperators(self._matrix)
        preconditioner = self.ksp.getPC()
        preconditioner.setReusePreconditioner(not anew)
        self.ksp.setUp()
        preconditioner.setReusePreconditioner(True)

    def aim(self, share: float, on_path: bool = False) -> None:
        """See :class:`tribox.app.implicit.factor.LinearWay`; the options say what is usual."""
        self.leave(min(self._usual, max(share, CLOSE)) if on_path else self._usual)

    def leave(self, share: float) -> None:
        """Let the next solve leave this share of the forces."""
        self._share = share
        self.ksp.setTolerances(rtol=share)

    def snapshot(self) -> Snapshot:
        """Nothing: the preconditioner is made again from the matrix."""
        return {}

    def restore(self, kept: Snapshot) -> None:
        """Nothing to do."""

    def _last_iterations(self) -> float:
        """Iterations that the last solve took, or would have, to leave the usual share."""
        taken = float(self.ksp.getIterationNumber())
        if self._share != self._usual:
            taken *= math.log(min(self._usual, 0.5)) / math.log(min(self._share, 0.5))
        return taken


class MultigridSolver:
    """Solves with a matrix as a factorisation would, by iterations.

    Products with the matrix and sweeps over it take half the time in blocks of a node's unknowns
    (BAIJ), so that the finest level is copied into them. GAMG cannot coarsen these.

    Attributes:
        multigrid: the preconditioner that is kept.
        solution: the last one; image: the matrix times that.
        converged: whether it is as close as was asked for.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        near: PETSc.NullSpace,
        prefix: str,
        options: Mapping[str, str | float | bool],
        count: Callable[[int], None],
    ) -> None:
        """Prepare to solve with ``matrix``; collective."""
        at_hand = PETSc.Options(prefix)
        damped = DAMPED if matrix.comm.size > 2 else {}
        for key, value in (dict(options) | damped).items():
            at_hand[key] = value
        self._ksp = PETSc.KSP().create(matrix.comm)
        self._ksp.setOptionsPrefix(prefix)
        self._ksp.setOperators(matrix)
        self._ksp.setFromOptions()
        self.multigrid = Multigrid(self._ksp, matrix, near)
        self._matrix, self._count = matrix, count
        self._blocks: PETSc.Mat | None = None
        self._sweeps = BlockSweeps()
        self.solution, self._rhs = matrix.createVecs()
        self.image = self._rhs.duplicate()
        self.converged = True

    def make(self, widened: bool = False) -> bool:
        """Make the preconditioner, if there is none that serves, for the matrix as it is now.

        Returns True: it can be done; collective.
        """
        self.multigrid.set_up(widened)
        if widened and self._blocks is not None:
            self._blocks.destroy()
            self._blocks = None
        self._blocks = self._matrix.convert(PETSc.Mat.Type.BAIJ, self._blocks or PETSc.Mat())
        # Other values do not make PETSc forget the inverses of the diagonal blocks; this does.
        self._blocks.zeroRows(np.empty(0, dtype=PETSc.IntType))
        pc = self._ksp.getPC()
        finest = pc.getMGLevels() - 1
        if finest > 0:
            smoother = pc.getMGSmoother(finest)
            smoother.setOperators(self._blocks)
            if self._sweeps.take(self._blocks):
                smoother.getPC().setType(PETSc.PC.Type.PYTHON)
                smoother.getPC().setPythonContext(self._sweeps)
            smoother.setUp()
            _leave_residual_to(pc, finest, self._blocks)
        self._ksp.setOperators(self._blocks, self._matrix)
        return True

    def solve(self, rhs: Floats, most: float) -> Floats:
        """The solution (n,) for a right-hand side (n,), owned rows each; collective.

        Args:
            rhs: N.
            most: N, norm of the forces that may be left.
        """
        assert self._blocks is not None
        self._rhs.array[:] = rhs
        size = self._rhs.norm()
        if size <= most:
            self.solution.set(0.0)
            self.image.set(0.0)
            return self.solution.array_r
        self.multigrid.leave(most / size)
        self._ksp.solve(self._rhs, self.solution)
        self._count(self._ksp.getIterationNumber())
        self.converged = self._ksp.getConvergedReason() > 0
        self._blocks.mult(self.solution, self.image)
        return self.solution.array_r

    def destroy(self) -> None:
        """Give the memory back; collective."""
        for part in (self._ksp, self._blocks):
            if part is not None:
                part.destroy()


class BlockSweeps:
    """A symmetric sweep of Gauss-Seidel over blocks of three, as PETSc's preconditioner in Python.

    Within each rank, in single precision: a third of the time of PETSc's.
    """

    def __init__(self) -> None:
        self._code = library(SOURCE)
        self._code.tribox_split_blocks.restype = ctypes.c_int64
        self._arrays: tuple[NDArray[Any], ...] = ()

    def take(self, matrix: PETSc.Mat) -> bool:
        """Take over the values of a matrix in blocks; whether these sweeps can be used."""
        if matrix.getBlockSize() != 3 or np.dtype(PETSc.IntType) != np.int32:
            return False
        with blocks_in_place(matrix) as (start, column, values):
            n, more = len(start) - 1, 4  # a block is read by fours
            if not self._arrays or len(self._arrays[1]) != len(column):
                ends, columns = np.empty((2, n + 1), np.int32), np.empty(len(column), np.int32)
                sizes = 9 * len(column) + more, 9 * n + more, 4 * n
                self._arrays = ends, columns, *(np.zeros(size, np.float32) for size in sizes)
            self._count = ctypes.c_int64(n)
            every: tuple[NDArray[Any], ...] = (start, column, values, *self._arrays[:-1])
            arrays = [_at(one) for one in every]
            return bool(self._code.tribox_split_blocks(self._count, *arrays) < 0)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Sweep from zero to ``x`` with the right-hand side ``b``."""
        *fixed, scratch = map(_at, self._arrays)
        right, found = b.array_r, x.array
        self._code.tribox_sweep(self._count, *fixed, _at(right), _at(found), scratch)


def _at(array: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _leave_residual_to(pc: PETSc.PC, level: int, matrix: PETSc.Mat) -> None:
    """Let a level of PETSc's multigrid find residuals by a matrix; petsc4py has no word for it."""
    handles = ctypes.c_void_p(pc.handle), ctypes.c_int(level), None, ctypes.c_void_p(matrix.handle)
    if code := ctypes.CDLL(PETSc.__file__).PCMGSetResidual(*handles):
        raise PETSc.Error(code)


def rigid_motions_of(problem: Equilibrium, dofs: Ints | None = None) -> PETSc.NullSpace:
    """Rigid motions, orthonormal, for smoothed aggregation; collective.

    Those of all bodies together serve each of them: smoothed aggregation restricts them to its
    aggregates, which lie within a body.

    Args:
        dofs: owned local unknowns, of whole nodes, that alone move; None: all.
    """
    dim, position = problem.dim, problem.unknowns.node_places().reshape(-1)
    values = position if dofs is None else position[dofs]
    coordinates = PETSc.Vec().createMPI((len(values), PETSc.DECIDE), bsize=dim, comm=problem.comm)
    coordinates.array[:] = values
    return PETSc.NullSpace().createRigidBody(coordinates)
