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
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.matrix_values import (
    add_product,
    blocks_in_place,
    columns_of_others,
)
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
DAMPED = 0.8
"""Share of what sweeps find that is added beyond two ranks: where three meet, sweeps within each
raise errors. Boxes of 27 054 unknowns took 1465 iterations on four ranks, 254 on two."""
CLOSE = 1e-5
"""Share of the forces that a first solve from a start on the path may leave. With the usual one the
start's smooth errors remain, points open or slip by them, and a solve more is needed."""


def damped(options: Mapping[str, str | float | bool], ranks: int) -> dict[str, str | float | bool]:
    """Options of multigrid for a number of ranks."""
    return dict(options) | ({"mg_levels_ksp_richardson_scale": DAMPED} if ranks > 2 else {})


class Multigrid:
    """An iterative solver, whatever its options are, whose preconditioner is kept.

    Operator and finest smoother are those of the matrix at hand; the coarse spaces and their
    matrices are those of an earlier one until solves take too long. What changes from one tangent
    to the next is the contact, which the smoother sees; the bodies, for which there are coarse
    spaces, hardly change. Nor does a wider pattern matter to them.

    Attributes:
        direct, part, closest: see :class:`tribox.app.implicit.factor.LinearWay`.
        ksp: PETSc's solver; pc: its preconditioner, the levels of the multigrid.
        made: how often the preconditioner was made.
    """

    direct, part, closest = False, "preconditioner", CLOSEST

    def __init__(self, ksp: PETSc.KSP, matrix: PETSc.Mat, near: PETSc.NullSpace) -> None:
        """Solve by ``ksp`` with ``matrix``, whose near-nullspace is ``near``."""
        self.ksp, self.pc, self._matrix, self._near = ksp, ksp.getPC(), matrix, near
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
        self.pc.reset()  # which need not be the solver's own
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
        self.pc.setReusePreconditioner(not anew)
        self.ksp.setUp()
        self.pc.setReusePreconditioner(True)

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

    Products with the matrix and sweeps over it take a fraction of the time in blocks of a node's
    unknowns (BAIJ), so that the finest level is copied into them. GAMG cannot coarsen these.

    Attributes:
        multigrid: the preconditioner that is kept.
        solution: the last one.
        converged: whether it is as close as was asked for.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        near: PETSc.NullSpace,
        prefix: str,
        options: Mapping[str, str | float | bool],
        count: Callable[[int], None],
        constant: bool = False,
    ) -> None:
        """Prepare to solve with ``matrix``; collective.

        Args:
            constant: its values never change, and it serves nothing else: no copy is made of it.
        """
        at_hand = PETSc.Options(prefix)
        for key, value in damped(options, matrix.comm.size).items():
            at_hand[key] = value
        self._ksp = PETSc.KSP().create(matrix.comm)
        self._ksp.setOptionsPrefix(prefix)
        self._ksp.setOperators(matrix)
        self._ksp.setFromOptions()
        self.multigrid = Multigrid(self._ksp, matrix, near)
        self._matrix, self._count, self._constant = matrix, count, constant
        self._cycle = PETSc.PC().create(matrix.comm)
        self._cycle.setType(PETSc.PC.Type.PYTHON)
        self._blocks: PETSc.Mat | None = None
        self._finest: FinestLevel | None = None
        self._product = matrix
        self.solution, self._rhs = matrix.createVecs()
        self._image = self._rhs.duplicate()
        self.converged = True

    def make(self, widened: bool = False) -> bool:
        """Make the preconditioner, if there is none that serves, for the matrix as it is now.

        Returns True: it can be done; collective.
        """
        if self._finest is not None:
            self._finest.release()
        self._ksp.setPC(self.multigrid.pc)
        self.multigrid.set_up(widened)
        if widened and self._blocks is not None:
            self._blocks.destroy()
            self._blocks = None
        if not can_sweep(self._matrix) or self.multigrid.pc.getMGLevels() == 1:
            return True
        into = self._matrix if self._constant else self._blocks or PETSc.Mat()
        self._blocks = self._matrix.convert(PETSc.Mat.Type.BAIJ, into)
        if self._finest is None:
            self._finest = FinestLevel(self._matrix)
            self._product = PETSc.Mat().createPython(
                self._matrix.getSizes(), self._finest, self._matrix.comm
            )
        if self._finest.take(self._blocks, self.multigrid.pc):
            self._cycle.setPythonContext(self._finest)
            self._ksp.setPC(self._cycle)
            self._ksp.setOperators(self._product, self._matrix)
        return True

    def solve(self, rhs: Floats, most: float) -> Floats:
        """The solution (n,) for a right-hand side (n,), owned rows each; collective.

        Args:
            rhs: N.
            most: N, norm of the forces that may be left.
        """
        self._rhs.array[:] = rhs
        size = self._rhs.norm()
        if size <= most:
            self.solution.set(0.0)
            return self.solution.array_r
        self.multigrid.leave(most / size)
        self._ksp.solve(self._rhs, self.solution)
        self._count(self._ksp.getIterationNumber())
        self.converged = self._ksp.getConvergedReason() > 0
        return self.solution.array_r

    def image(self) -> PETSc.Vec:
        """The matrix times the last solution, N; collective."""
        self._ksp.getOperators()[0].mult(self.solution, self._image)
        return self._image

    @property
    def matrix(self) -> PETSc.Mat:
        """The matrix, which :meth:`destroy` leaves to its owner."""
        return self._matrix

    def destroy(self) -> None:
        """Give the memory back; collective."""
        for part in (self._ksp, self.multigrid.pc, self._cycle, self._blocks):
            if part is not None:
                part.destroy()
        if self._finest is not None:
            self._product.destroy()
            self._finest.free()


def can_sweep(matrix: PETSc.Mat) -> bool:
    """Whether a matrix is one of blocks that :class:`FinestLevel` knows."""
    return matrix.getBlockSize() in (2, 3) and np.dtype(PETSc.IntType) == np.int32


class FinestLevel:
    """A V-cycle whose finest level is swept in blocks, as PETSc's preconditioner in Python.

    Symmetric sweeps of Gauss-Seidel within each rank, in single precision, beyond two ranks by
    :data:`DAMPED` of what they find. The first leaves its residual for half a product; the second
    begins with what the coarse levels found, for half a product more. It is the matrix, too, as
    PETSc's in Python, in double precision.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Make room for sweeps over what is of the size of ``matrix``."""
        self._code = library(SOURCE)
        self._code.tribox_split_blocks.restype = ctypes.c_int64
        self._size, self._count = matrix.getBlockSize(), matrix.getLocalSize()[0]
        self._count //= self._size
        self._share = ctypes.c_double(DAMPED if matrix.comm.size > 2 else 1.0)
        self._parts: tuple[NDArray[Any], ...] = ()
        self._matrix: tuple[NDArray[Any], ...] = ()
        self._work = np.zeros(3 * 4 * self._count, np.float32)
        self._left = matrix.createVecLeft()
        self._levels: CoarseLevels | None = None
        self._blocks: PETSc.Mat | None = None
        self._others: OtherRanks | None = None

    def take(self, blocks: PETSc.Mat, aggregates: PETSc.PC) -> bool:
        """Take over the values of a matrix in blocks; whether sweeps can be used; collective.

        Args:
            blocks: if it is the last one, of the same pattern.
            aggregates: the coarse levels.
        """
        self.release()
        self._levels = CoarseLevels(aggregates)
        if blocks.comm.size > 1 and blocks is not self._blocks:
            if self._others is not None:
                self._others.destroy()
            self._others = OtherRanks(blocks)
        self._blocks = blocks
        with blocks_in_place(blocks) as (start, column, values):
            # PETSc keeps these where they are.
            self._matrix = start, column, values
            n, entries, more = self._count, self._size**2, 4  # a block is read by fours
            if not self._parts or len(self._parts[1]) != len(column):
                ends, columns = np.empty((2, n + 1), np.int32), np.empty(len(column), np.int32)
                sizes = (entries * size + more for size in (len(column), n, n))
                self._parts = ends, columns, *(np.zeros(size, np.float32) for size in sizes)
            every: tuple[NDArray[Any], ...] = (*self._matrix, *self._parts)
            missing = self._code.tribox_split_blocks(*self._sizes(), *map(_at, every))
        return blocks.comm.tompi4py().allreduce(missing < 0, op=MPI.LAND)

    def _sizes(self) -> tuple[ctypes.c_int64, ctypes.c_int64]:
        return ctypes.c_int64(self._size), ctypes.c_int64(self._count)

    def release(self) -> None:
        """Let go of the coarse levels, which PETSc may then make anew; collective."""
        if self._levels is not None:
            self._levels.destroy()
            self._levels = None

    def free(self) -> None:  # `destroy` is what PETSc calls of its Python contexts
        """Give the memory back; collective."""
        self.release()
        self._left.destroy()
        if self._others is not None:
            self._others.destroy()

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Put the matrix times ``x`` into ``y``; collective."""
        arrays = *map(_at, self._matrix), _at(x.array_r), _at(y.array)
        self._code.tribox_multiply(*self._sizes(), *arrays)
        if self._others is not None:
            self._others.add(x, y)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Put into ``x`` what a V-cycle finds for the right-hand side ``b``; collective."""
        assert self._levels is not None
        left = self._left
        self.sweep(b, x, left)
        if self._others is not None:
            self._others.take_off(x, left)
        self._levels.correct(left, x)
        right = b
        if self._others is not None:
            b.copy(left)
            self._others.take_off(x, left)
            right = left
        self.sweep(right, x)

    def sweep(self, b: PETSc.Vec, x: PETSc.Vec, left: PETSc.Vec | None = None) -> None:
        """Sweep over this rank's own unknowns; from zero to find what is ``left`` of ``b``."""
        from_zero = ctypes.c_int64(left is not None)
        rest = None if left is None else _at(left.array)
        vectors = _at(b.array_r), _at(x.array), rest, self._share, from_zero, _at(self._work)
        self._code.tribox_sweep(*self._sizes(), *map(_at, self._parts), *vectors)


class OtherRanks:
    """What this rank's rows of a matrix in blocks have in the columns of other ranks."""

    def __init__(self, blocks: PETSc.Mat) -> None:
        """Learn which unknowns these are; collective."""
        self._part, columns = columns_of_others(blocks)
        self._x = PETSc.Vec().createSeq(len(columns) * blocks.getBlockSize(), comm=MPI.COMM_SELF)
        source, size = blocks.createVecRight(), blocks.getBlockSize()
        wanted = PETSc.IS().createBlock(size, columns, comm=MPI.COMM_SELF)
        self._scatter = PETSc.Scatter().create(source, wanted, self._x, None)
        source.destroy()
        wanted.destroy()

    def destroy(self) -> None:
        """Give the memory back; collective."""
        self._scatter.destroy()
        self._x.destroy()

    def add(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Add their part of the matrix times ``x`` to ``y``; collective."""
        self._scatter.scatter(x, self._x)
        add_product(self._part, self._x, y)

    def take_off(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Take it off ``y``; collective."""
        self._scatter.scatter(x, self._x)
        self._x.scale(-1.0)
        add_product(self._part, self._x, y)


class CoarseLevels:
    """All levels of PETSc's multigrid but the finest.

    What ranks share is kept by petsc4py when the last reference to it goes, until a collective
    call that nobody makes: so it is given back here.
    """

    def __init__(self, pc: PETSc.PC) -> None:
        """Take them out of the multigrid that is set up; collective."""
        numbers = range(1, pc.getMGLevels())
        self._between = [pc.getMGInterpolation(level) for level in numbers]
        self._solvers = [pc.getMGCoarseSolve(), *(pc.getMGSmoother(one) for one in numbers[:-1])]
        self._matrices = [solver.getOperators()[0] for solver in self._solvers]
        self._vectors = [(*one.createVecs(), one.createVecLeft()) for one in self._matrices]

    def destroy(self) -> None:
        """Give back vectors, and what is held of PETSc's multigrid; collective."""
        vectors = (vector for three in self._vectors for vector in three)
        for part in (*vectors, *self._matrices, *self._solvers, *self._between):
            part.destroy()

    def correct(self, left: PETSc.Vec, x: PETSc.Vec, level: int | None = None) -> None:
        """Add to ``x`` what the levels below find for the residual ``left``; collective."""
        level = len(self._solvers) - 1 if level is None else level
        solver, between = self._solvers[level], self._between[level]
        found, right, rest = self._vectors[level]
        between.multTranspose(left, right)
        solver.setInitialGuessNonzero(False)
        solver.solve(right, found)
        if level > 0:
            self._matrices[level].mult(found, rest)
            rest.aypx(-1.0, right)
            self.correct(rest, found, level - 1)
            solver.setInitialGuessNonzero(True)
            solver.solve(right, found)
        between.multAdd(found, x, x)


def _at(array: NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


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
