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
    columns_of_others,
    forget_products,
    is_direct,
    pattern_in_place,
    values_in_place,
)
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.implicit.factor import CLOSEST, petsc_kinds
from tribox.forms.native import library
from tribox.geometry.surfaces.facets import Floats, Ints

SOURCE = "block_sweeps.c"
WIDTH = 8  # lanes that interpolations take at once

KRYLOV: dict[str, str | float | bool] = {
    "ksp_type": "fgmres",
    # Newton's method gains three digits an iteration where it converges: more would be wasted.
    "ksp_rtol": 1e-3,
    "ksp_max_it": 200,
    "ksp_gmres_restart": 60,
    "pc_type": "gamg",
    # Of several ranks' graph G the square is made as Gᵀ times G, not in one: a fifth less time.
    "pc_gamg_square_0_mat_product_algorithm": "at*b",
    # One symmetric sweep of Gauss-Seidel within each rank: it needs no bounds of eigenvalues,
    # and did not fail at a Poisson's ratio of 0.49, where incomplete factorisation did.
    "mg_levels_ksp_type": "richardson",
    "mg_levels_ksp_max_it": 1,
    "mg_levels_pc_type": "sor",
}
# A solve that takes more than MANY iterations, and more than WORN times as many as the first with
# the preconditioner, has the next one made anew: that costs as much as some 35 iterations.
MANY, WORN = 30, 1.5
DAMPED = 0.8
"""Share of what sweeps find that is added beyond two ranks: where three meet, sweeps within each
raise errors. Boxes of 27 054 unknowns took 1465 iterations on four ranks, 254 on two."""
ITERATED = 1e-4
"""Share of the forces that solves by iterations need not get below. With 1e-3 points stuck or
slipped by smooth errors that were left, for one Newton iteration more where most begin to: 37
instead of 35, and 840 linear ones instead of 909, with 199 353 unknowns."""
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

    def stays(self) -> bool:
        """Whether the preconditioner at hand serves on."""
        return self._is_made and not self.worn()

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
        if anew:
            self._forget_products()

    def _forget_products(self) -> None:
        """Give back what PETSc keeps to make the levels again from another matrix; collective.

        On several ranks that is more than the levels themselves.
        """
        if self.pc.getType() == PETSc.PC.Type.GAMG:
            numbers = range(self.pc.getMGLevels())
            smoothers = [self.pc.getMGSmoother(one) for one in numbers]
            forget_products([solver.getOperators()[0] for solver in smoothers])
            forget_products([self.pc.getMGInterpolation(one) for one in numbers[1:]])

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
            taken *= min(1.0, math.log(min(self._usual, 0.5)) / math.log(min(self._share, 0.5)))
        return taken


class MultigridSolver:
    """Solves with a matrix as a factorisation would, by iterations.

    Sweeps over the matrix take a fraction of the time in blocks of a node's unknowns in single
    precision, so that the finest level is copied into them. GAMG cannot coarsen these.

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
            constant: its values never change, and it serves nothing else: it becomes one of blocks.
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
        self._finest: FinestLevel | None = None
        self._product = matrix
        self.solution, self._rhs = matrix.createVecs()
        self._image = self._rhs.duplicate()
        self.converged = True

    def make(self, widened: bool = False) -> bool:
        """Make the preconditioner, if there is none that serves, for the matrix as it is now.

        Returns whether it could be done; collective.
        """
        if self._finest is not None and not self.multigrid.stays():
            self._finest.release()
        self._ksp.setPC(self.multigrid.pc)
        try:
            self.multigrid.set_up(widened)
        except PETSc.Error:  # no bounds of eigenvalues, on all ranks: far from any equilibrium
            self.multigrid.renew()
            return False
        if not can_sweep(self._matrix) or self.multigrid.pc.getMGLevels() == 1:
            return True
        if self._finest is None:
            self._finest = FinestLevel(self._matrix)
            self._product = PETSc.Mat().createPython(
                self._matrix.getSizes(), self._finest, self._matrix.comm
            )
        if self._finest.take(self.multigrid.pc):
            if self._constant:
                self._matrix.convert(PETSc.Mat.Type.BAIJ, self._matrix)
            self._finest.meet_others(widened)
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
        return self._solve(self._rhs, self.solution, most)

    def _solve(self, rhs: PETSc.Vec, solution: PETSc.Vec, most: float) -> Floats:
        """Solve what PETSc has been told to be the system; collective."""
        size = rhs.norm()
        if size <= most:
            solution.set(0.0)
            return solution.array_r
        self.multigrid.leave(most / size)
        self._ksp.solve(rhs, solution)
        self._count(self._ksp.getIterationNumber())
        self.converged = self._ksp.getConvergedReason() > 0
        return solution.array_r

    def image(self) -> PETSc.Vec:
        """The matrix times the last solution, N; collective."""
        self._matrix.mult(self.solution, self._image)
        return self._image

    @property
    def matrix(self) -> PETSc.Mat:
        """The matrix, which :meth:`destroy` leaves to its owner."""
        return self._matrix

    def destroy(self) -> None:
        """Give the memory back; collective."""
        for part in (self._ksp, self.multigrid.pc, self._cycle):
            part.destroy()
        if self._finest is not None:
            self._product.destroy()
            self._finest.free()


def can_sweep(matrix: PETSc.Mat) -> bool:
    """Whether a matrix is one that :class:`FinestLevel` knows."""
    known = matrix.getBlockSize() in (2, 3) and np.dtype(PETSc.IntType) == np.int32
    return known and is_direct(matrix)


class FinestLevel:
    """A V-cycle whose finest level is swept in blocks, as PETSc's preconditioner in Python.

    Symmetric sweeps of Gauss-Seidel within each rank, in single precision, beyond two ranks by
    :data:`DAMPED` of what they find. Each leaves its residual for half a product; the second
    begins with what the coarse levels found, for half a product more. What it leaves is also what
    the matrix makes of all that was found: this is the matrix, too, as PETSc's in Python.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Make room for sweeps over ``matrix``."""
        self._code = library(SOURCE)
        self._matrix, self._blocks = matrix, Blocks(self._code, matrix.getBlockSize())
        self._count = matrix.getLocalSize()[0] // matrix.getBlockSize()
        self._share = ctypes.c_double(DAMPED if matrix.comm.size > 2 else 1.0)
        self._work = np.zeros(2 * 4 * self._count, np.float32), np.zeros(4 * self._count)
        self._room = (*map(_at, self._work),)
        self._left, self._felt, self._product = (matrix.createVecLeft() for _ in range(3))
        self._found = 0, 0  # the vector found last, and its state
        self._levels: CoarseLevels | None = None
        self._others: OtherRanks | None = None

    def take(self, aggregates: PETSc.PC) -> bool:
        """Take over the values of the matrix; whether sweeps can be used; collective.

        Args:
            aggregates: the coarse levels.
        """
        self._found = 0, 0
        if self._levels is None:
            self._levels = CoarseLevels(aggregates)
        missing = self._blocks.take(self._matrix)
        return self._matrix.comm.tompi4py().allreduce(missing < 0, op=MPI.LAND)

    def meet_others(self, widened: bool) -> None:
        """Learn what other ranks have, if that is to be done anew; collective."""
        if self._matrix.comm.size > 1 and (widened or self._others is None):
            if self._others is not None:
                self._others.destroy()
            self._others = OtherRanks(self._matrix)

    def release(self) -> None:
        """Let go of the coarse levels, which PETSc may then make anew; collective."""
        if self._levels is not None:
            self._levels.destroy()
            self._levels = None
        self._found = 0, 0

    def free(self) -> None:  # `destroy` is what PETSc calls of its Python contexts
        """Give the memory back; collective."""
        self.release()
        for vector in (self._left, self._felt, self._product):
            vector.destroy()
        if self._others is not None:
            self._others.destroy()

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Put the matrix times ``x`` into ``y``; collective."""
        if self._found == (x.handle, x.stateGet()):
            self._product.copy(y)
        else:
            self._matrix.mult(x, y)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Put into ``x`` what a V-cycle finds for the right-hand side ``b``; collective."""
        assert self._levels is not None
        left, right, product = self._left, b, self._product
        self.sweep(b, x, left, from_zero=True)
        if self._others is not None:
            self._others.add(x, left, -1.0)
        self._levels.correct(left, x)
        if self._others is not None:
            right = self._felt
            b.copy(right)
            self._others.add(x, right, -1.0)
        self.sweep(right, x, left)
        product.waxpy(-1.0, left, right)
        if self._others is not None:  # `right` had what there was of `x` before
            self._others.add(x, product)
        self._found = x.handle, x.stateGet()

    def sweep(self, b: PETSc.Vec, x: PETSc.Vec, left: PETSc.Vec, from_zero: bool = False) -> None:
        """Sweep over this rank's own unknowns, to find what is ``left`` of ``b``, too."""
        vectors = _at(b.array_r), _at(x.array), _at(left.array)
        how = self._share, ctypes.c_int64(from_zero), *self._room
        self._code.tribox_sweep(*self._blocks.arguments, *vectors, *how)


class Blocks:
    """A rank's own part of a matrix, in blocks of a node's unknowns and single precision.

    Attributes:
        arguments: what C functions are told of the blocks.
    """

    def __init__(self, code: ctypes.CDLL, size: int) -> None:
        """Make no room yet for blocks (size, size)."""
        self._code, self._size = code, size
        self._code.tribox_split_blocks.restype = ctypes.c_int64
        self._parts: tuple[NDArray[Any], ...] = ()
        self.arguments: tuple[Any, ...] = ()

    def take(self, matrix: PETSc.Mat) -> int:
        """Take over its values; the first row without a block on the diagonal, or −1."""
        size, n = self._size, matrix.getLocalSize()[0] // self._size
        entries, more = size**2, 4  # a block is read by fours
        with pattern_in_place(matrix) as (start, column), values_in_place(matrix) as values:
            blocks = max(0, _count_blocks(self._code, (size, size, n), start, column) - n)
            if not self._parts or len(self._parts[1]) != blocks:
                ends, columns = np.empty((2, n + 1), np.int32), np.empty(blocks, np.int32)
                floats = (np.zeros(entries * one + more, np.float32) for one in (blocks, n, n))
                self._parts = ends, columns, *floats, np.empty(entries * n)
                self.arguments = *_numbers(size, n), *map(_at, self._parts)
            every: tuple[NDArray[Any], ...] = (start, column, values, *self._parts)
            split = self._code.tribox_split_blocks
            return int(split(*_numbers(size, n, blocks), *map(_at, every)))


class OtherRanks:
    """What this rank's rows of a matrix have in the columns of other ranks."""

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Learn which unknowns these are; collective."""
        self._part, columns = columns_of_others(matrix)
        in_blocks = matrix.getType() == PETSc.Mat.Type.MPIBAIJ
        source, size = matrix.createVecRight(), matrix.getBlockSize() if in_blocks else 1
        self._x = PETSc.Vec().createSeq(len(columns) * size, comm=MPI.COMM_SELF)
        wanted = PETSc.IS().createBlock(size, columns, comm=MPI.COMM_SELF)
        self._scatter = PETSc.Scatter().create(source, wanted, self._x, None)
        source.destroy()
        wanted.destroy()

    def destroy(self) -> None:
        """Give the memory back; collective."""
        self._scatter.destroy()
        self._x.destroy()

    def add(self, x: PETSc.Vec, y: PETSc.Vec, times: float = 1.0) -> None:
        """Add their part of the matrix times ``x`` to ``y``; collective."""
        self._scatter.scatter(x, self._x)
        self._x.scale(times)
        add_product(self._part, self._x, y)

    def add_transposed(self, y: PETSc.Vec, x: PETSc.Vec) -> None:
        """Add the transpose of their part times ``y`` to ``x``; collective."""
        self._x.set(0.0)
        mine = PETSc.Vec().createWithArray(y.array, comm=MPI.COMM_SELF)
        add_product(self._part, mine, self._x, transposed=True)
        mine.destroy()
        mode = PETSc.Scatter.Mode.REVERSE
        self._scatter.scatter(self._x, x, addv=PETSc.InsertMode.ADD_VALUES, mode=mode)


class Interpolation:
    """That from the next level to the finest, in blocks and single precision.

    A block has the unknowns of a node and those of an aggregate, as many as rigid motions.
    """

    def __init__(self, between: PETSc.Mat) -> None:
        """Take over its values; collective."""
        self._code, more = library(SOURCE), WIDTH
        size, width = between.getBlockSizes()
        rows, columns = between.getLocalSize()[0] // size, between.getLocalSize()[1] // width
        self._numbers = _numbers(size, width, rows)
        self._coarse, self._width = np.zeros((columns, WIDTH), np.float32), width
        with pattern_in_place(between) as (start, column), values_in_place(between) as values:
            blocks = _count_blocks(self._code, (size, width, rows), start, column)
            ends, columns = np.empty(rows + 1, np.int32), np.empty(blocks, np.int32)
            parts = np.zeros(size * width * blocks + more, np.float32)
            self._parts: tuple[NDArray[Any], ...] = (ends, columns, parts)
            every: tuple[NDArray[Any], ...] = (start, column, values, *self._parts)
            self._code.tribox_take_blocks(*self._numbers, *map(_at, every))
        self._arguments = *self._numbers, *map(_at, (*self._parts, self._coarse))
        self._others = OtherRanks(between) if between.comm.size > 1 else None

    def destroy(self) -> None:
        """Give the memory back; collective."""
        if self._others is not None:
            self._others.destroy()

    def multTranspose(self, fine: PETSc.Vec, coarse: PETSc.Vec) -> None:
        """As PETSc's method of a matrix; collective."""
        self._coarse[:] = 0.0
        self._interpolate(_at(fine.array_r), transposed=True)
        coarse.array.reshape(-1, self._width)[:] = self._coarse[:, : self._width]
        if self._others is not None:
            self._others.add_transposed(fine, coarse)

    def multAdd(self, coarse: PETSc.Vec, fine: PETSc.Vec, out: PETSc.Vec) -> None:
        """As PETSc's method of a matrix, with ``fine`` as ``out``; collective."""
        assert fine is out
        self._coarse[:] = 0.0  # a restriction leaves anything beyond the width
        self._coarse[:, : self._width] = coarse.array_r.reshape(-1, self._width)
        self._interpolate(_at(fine.array), transposed=False)
        if self._others is not None:
            self._others.add(coarse, fine)

    def _interpolate(self, fine: ctypes.c_void_p, transposed: bool) -> None:
        self._code.tribox_interpolate(*self._arguments, fine, ctypes.c_int64(transposed))


class CoarseLevels:
    """All levels of PETSc's multigrid but the finest.

    What ranks share is kept by petsc4py when the last reference to it goes, until a collective
    call that nobody makes: so it is given back here.
    """

    def __init__(self, pc: PETSc.PC) -> None:
        """Take them out of the multigrid that is set up; collective."""
        numbers = range(1, pc.getMGLevels())
        self._between: list[Any] = [pc.getMGInterpolation(level) for level in numbers]
        self._solvers = [pc.getMGCoarseSolve(), *(pc.getMGSmoother(one) for one in numbers[:-1])]
        self._matrices = [solver.getOperators()[0] for solver in self._solvers]
        if self._between and can_interpolate(self._between[-1]):
            self._between[-1] = Interpolation(self._between[-1])
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


def can_interpolate(between: PETSc.Mat) -> bool:
    """Whether :class:`Interpolation` knows a matrix."""
    size, width = between.getBlockSizes()
    return is_direct(between) and size in (2, 3) and 1 < width <= WIDTH


def _count_blocks(code: ctypes.CDLL, sizes: tuple[int, ...], start: Ints, column: Ints) -> int:
    """Number of blocks (rows, columns) in so many rows of them."""
    code.tribox_count_blocks.restype = ctypes.c_int64
    return int(code.tribox_count_blocks(*_numbers(*sizes), _at(start), _at(column)))


def _numbers(*values: int) -> tuple[ctypes.c_int64, ...]:
    return tuple(map(ctypes.c_int64, values))


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
