r"""Solves by iterations for bodies that are nearly incompressible, with a pressure for each cell.

Coarse levels have next to no motions without change of volume, and sweeps from node to node find
none on the finest one, so that iterations of multigrid grow with the root of K/G. With the
change of the cells' volumes B (:meth:`tribox.forms.bodies.point_cells.PointCells.dilatation`),
times the root of most of their stiffness,

.. math:: A = \hat A + B^T B, \qquad \begin{pmatrix} \hat A & B^T \\ B & -1 \end{pmatrix}
    \begin{pmatrix} u \\ q \end{pmatrix} = \begin{pmatrix} f \\ 0 \end{pmatrix}

is the same system. Flexible GMRES solves it, preconditioned by

.. math:: \begin{pmatrix} \hat A & B^T \\ 0 & -\sigma \end{pmatrix}^{-1}, \qquad
    \sigma = 1 + \frac{K - m G}{(m + 2) G} \approx 1 + B \hat A^{-1} B^T,

a cycle of multigrid for Â, whose cells have a bulk modulus of m G left (Benzi, Golub & Liesen, Acta
Numerica 14 (2005) 1, sections 8 and 10). What the second equation leaves counts times the norm of
B's rows: as the forces on the nodes that it stands for.

Axis letters: c cells, a nodes of a cell, i space.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.implicit.multigrid import MultigridSolver
from tribox.forms.bodies.point_cells import PointCells
from tribox.geometry.surfaces.facets import Floats, Ints

NEARLY = 30.0  # K/G from which on pressures are unknowns, ν = .484
LEFT, SHEAR = 10.0, 2.0  # m, and G's share in what resists a change of volume
PRESSED = 10.0
"""Times that of a cell's pressure which its bulk modulus has left: at states far from equilibrium
pressures of some G turn the stiffness of cells negative without it, and cycles diverge."""


class Volumes:
    """The volumes of the cells that are nearly incompressible, for some of the unknowns.

    Attributes:
        count: of this rank's cells.
        rows: B of the tangent at hand; scale: (c,) norms of its rows; sigma: (c,).
    """

    rows: PETSc.Mat | None = None
    scale: Floats
    sigma: Floats

    def __init__(self, problem: Equilibrium, dofs: Ints) -> None:
        """Choose the cells, which may be none; collective.

        Args:
            dofs: owned local unknowns, ascending, that are solved for.
        """
        self._problem, self._dofs = problem, dofs
        self._loops, self._moduli = list[PointCells](), list[tuple[float, float]]()
        plain = problem.dim == 3 and not problem.constraints.slanted
        for solid, cells in zip(problem.solids, problem.bodies.cells, strict=True):
            G, K = solid.material.shear_modulus, solid.material.bulk_modulus
            if not plain or cells is None or not solid.reduced or K < NEARLY * G:
                continue
            self._loops.append(cells.loops[-1])
            self._moduli.append((G, K))
        self.count = sum(len(loop.nodes) for loop in self._loops)

    def __bool__(self) -> bool:
        """Whether any cell is nearly incompressible; the same on all ranks."""
        return bool(self._loops)

    def take_off(self, matrix: PETSc.Mat, block: PETSc.Mat) -> None:
        """Find B at the present displacement, and take BᵀB off the tangent's ``block``; collective.

        Args:
            matrix: the tangent, of which the block is a part or a copy.
        """
        u = self._problem.u.x.array
        nodes = np.concatenate([loop.nodes for loop in self._loops])
        unknowns = (nodes[..., None] * 3 + np.arange(3)).reshape(len(nodes), -1)
        column = self._columns(matrix, block)[unknowns]
        row = np.broadcast_to(np.arange(len(nodes))[:, None], column.shape)
        slopes, self.sigma = self._rows(u)
        take, shape = column >= 0, (len(nodes), block.size[1])
        places = row[take], column[take]
        found = scipy.sparse.csr_matrix((slopes[take], places), shape=shape)
        norms = np.sqrt(np.asarray(found.multiply(found).sum(axis=1)).reshape(-1))
        self.scale = np.maximum(norms, np.finfo(float).tiny)
        self.destroy()
        kind = PETSc.IntType
        parts = found.indptr.astype(kind), found.indices.astype(kind), found.data
        sizes = (len(nodes), PETSc.DETERMINE), block.getSizes()[1]
        self.rows = PETSc.Mat().createAIJ(sizes, csr=parts, comm=block.comm)
        squares = self.rows.transposeMatMult(self.rows)
        block.axpy(-1.0, squares, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        squares.destroy()

    def _rows(self, u: Floats) -> tuple[Floats, Floats]:
        """Rows (c, a·i) of B, and σ (c,), at displacements (n,), m."""
        rows, sigmas = list[Floats]([np.empty((0, 24))]), list[Floats]([np.empty(0)])
        for loop, (G, K) in zip(self._loops, self._moduli, strict=True):
            strain, slopes = loop.dilatation(u)
            left = np.minimum(LEFT * G + PRESSED * K * np.abs(strain), K)
            rows.append(np.sqrt((K - left) * loop.cells.weights)[:, None] * slopes)
            sigmas.append(1.0 + (K - left) / (left + SHEAR * G))
        return np.concatenate(rows), np.concatenate(sigmas)

    def _columns(self, matrix: PETSc.Mat, block: PETSc.Mat) -> Ints:
        """Columns (n,) of the block of this rank's unknowns, ghosts included; −1: none.

        Of what is prescribed there is none, what follows a platen has that of its leader.
        """
        every = matrix.createVecRight()
        every.set(-1.0)
        every.array[self._dofs] = np.arange(*block.getOwnershipRangeColumn())
        every.array[self._problem.constrained_dofs()] = -1.0
        numbers = matrix.getLGMap()[0].indices
        wanted = PETSc.IS().createGeneral(numbers, comm=MPI.COMM_SELF)
        here = PETSc.Vec().createSeq(len(numbers), comm=MPI.COMM_SELF)
        scatter = PETSc.Scatter().create(every, wanted, here, None)
        scatter.scatter(every, here)
        found: Ints = here.array.astype(np.int32)
        for part in (scatter, here, wanted, every):
            part.destroy()
        return found

    def add_product(self, x: PETSc.Vec, y: PETSc.Vec) -> PETSc.Vec:
        """Add BᵀB x to ``y``, which is returned; collective."""
        assert self.rows is not None
        change = self.rows.createVecLeft()
        self.rows.mult(x, change)
        self.rows.multTransposeAdd(change, y, y)
        change.destroy()
        return y

    def destroy(self) -> None:
        """Give the memory back; collective."""
        if self.rows is not None:
            self.rows.destroy()
            self.rows = None


class LargerSystem:
    """The larger matrix and its preconditioner, as PETSc's in Python.

    Attributes:
        cycle: the preconditioner of Â; product: what multiplies with Â.
        wide: a vector of all unknowns, those of Â first.
    """

    cycle: PETSc.PC
    product: PETSc.Mat

    def __init__(self, matrix: PETSc.Mat, volumes: Volumes) -> None:
        """Make room; collective."""
        self._volumes, comm, count = volumes, matrix.comm, volumes.count
        self._u, self._forces = matrix.createVecs()
        self._q = PETSc.Vec().createMPI((count, PETSc.DETERMINE), comm=comm)
        self._change, self._own = self._q.duplicate(), self._u.getLocalSize()
        self.wide = PETSc.Vec().createMPI((self._own + count, PETSc.DETERMINE), comm=comm)
        self._made = 0, 0  # the vector made last, and its state

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Put the preconditioner times ``b`` into ``x``; collective."""
        volumes, (forces, changes) = self._volumes, self.parts(b.array_r)
        assert volumes.rows is not None
        self._q.array[:] = -changes / (volumes.scale * volumes.sigma)
        volumes.rows.multTranspose(self._q, self._forces)
        self._forces.array[:] = forces - self._forces.array_r
        self.cycle.apply(self._forces, self._u)
        u, q = self.parts(x.array)
        u[:], q[:] = self._u.array_r, self._q.array_r
        self._made = x.handle, x.stateGet()

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Put the larger matrix times ``x`` into ``y``; collective."""
        volumes, (forces, changes) = self._volumes, self.parts(y.array)
        assert volumes.rows is not None
        if self._made != (x.handle, x.stateGet()):  # else Â times it is known
            self._u.array[:], self._q.array[:] = self.parts(x.array_r)
        self.product.mult(self._u, self._forces)
        volumes.rows.multTransposeAdd(self._q, self._forces, self._forces)
        volumes.rows.mult(self._u, self._change)
        forces[:] = self._forces.array_r
        changes[:] = volumes.scale * (self._change.array_r - self._q.array_r)

    def parts(self, values: Floats) -> tuple[Floats, Floats]:
        """Those of all unknowns as displacements (or forces) and pressures (or changes)."""
        return values[: self._own], values[self._own :]

    def free(self) -> None:  # `destroy` is what PETSc calls of its Python contexts
        """Give the memory back; collective."""
        for vector in (self._u, self._forces, self._q, self._change, self.wide):
            vector.destroy()


class VolumeSplitSolver(MultigridSolver):
    """Solves with A as :class:`MultigridSolver` does, given Â and B."""

    def __init__(
        self,
        matrix: PETSc.Mat,
        near: PETSc.NullSpace,
        prefix: str,
        options: Mapping[str, str | float | bool],
        count: Callable[[int], None],
        volumes: Volumes,
    ) -> None:
        """Prepare to solve; collective.

        Args:
            matrix: Â.
        """
        super().__init__(matrix, near, prefix, options, count)
        self._volumes, self._larger = volumes, LargerSystem(matrix, volumes)
        self._right, self._found = self._larger.wide, self._larger.wide.duplicate()
        sizes = self._right.getSizes()
        self._system = PETSc.Mat().createPython((sizes, sizes), self._larger, matrix.comm)
        self._both = PETSc.PC().create(matrix.comm)
        self._both.setType(PETSc.PC.Type.PYTHON)
        self._both.setPythonContext(self._larger)

    def make(self, widened: bool = False) -> bool:
        """See :meth:`MultigridSolver.make`."""
        self._ksp.reset()  # of the larger system
        works = super().make(widened)
        self._larger.cycle, self._larger.product = self._ksp.getPC(), self._product
        self._ksp.setPC(self._both)
        self._ksp.reset()
        self._ksp.setOperators(self._system)
        return works

    def solve(self, rhs: Floats, most: float) -> Floats:
        """See :meth:`MultigridSolver.solve`."""
        forces, changes = self._larger.parts(self._right.array)
        forces[:], changes[:] = rhs, 0.0
        found = self._solve(self._right, self._found, most)
        self.solution.array[:] = self._larger.parts(found)[0]
        return self.solution.array_r

    def image(self) -> PETSc.Vec:
        """See :meth:`MultigridSolver.image`."""
        return self._volumes.add_product(self.solution, super().image())

    def destroy(self) -> None:
        """Give the memory back; collective."""
        super().destroy()
        for part in (self._both, self._system, self._found):
            part.destroy()
        self._larger.free()
