r"""A preconditioner for bodies in contact: one body after the other.

With the unknowns k of stiff bodies on supports of their own, and s of all others, a symmetric sweep
of Gauss-Seidel over the two blocks of the tangent A,

.. math:: A_{ss} y_s = r_s, \quad K z_k = r_k - A_{ks} y_s, \quad A_{ss} z_s = r_s - A_{sk} z_k,

is a preconditioner of A (Saad, Iterative methods for sparse linear systems, 2nd ed., ch. 14).
:math:`A_{ss}`, with the stiffness of its contacts, is factorised for each tangent; K, the stiff
bodies undeformed and without contacts, once. The second solve takes the others along as the stiff
bodies give way, so that what is left is of the order of the stiffness of the *others*, not of their
contacts, over that of the stiff bodies. As contacts that move on couple other nodes of two bodies,
the pattern of :math:`A_{ss}`, and with it the analysis of its factorisation, stays what it was.
"""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from app.equilibrium.equilibrium import Equilibrium
from app.implicit.factor import Factor
from app.implicit.kept_bodies import KeptBodies
from geometry.surfaces.facets import Floats, Ints


class BodySweep:
    """The preconditioner, as PETSc asks for one in Python (``apply``)."""

    def __init__(self, problem: Equilibrium, bodies: KeptBodies, prefix: str) -> None:
        """Factorise the stiff bodies; collective.

        Args:
            problem: the equilibrium.
            bodies: which are stiff.
            prefix: of the options for MUMPS.
        """
        self._prefix = prefix
        self._stiff = Factor(bodies.tangent(problem), prefix, symmetric=True)
        self.works = self._stiff.make()
        self._kept, self._others = bodies.dofs, bodies.others
        rows = self._others + problem.first
        self._rows = PETSc.IS().createGeneral(rows, comm=problem.comm)
        self._matrix: PETSc.Mat | None = None
        self._block: PETSc.Mat | None = None  # of the other bodies, as it is factorised
        self._source: PETSc.Mat | None = None  # as it is taken out of the tangent
        self._factor: Factor | None = None
        self._image = problem.new_vector()
        self._r_kept, self._z_kept = self._stiff.vectors()

    def make(self, matrix: PETSc.Mat, widened: bool) -> tuple[bool, bool]:
        """Factorise the other bodies' block of the tangent; collective.

        Args:
            matrix: the tangent.
            widened: whether its pattern is another than that of the last one.

        Returns:
            Whether that worked, and whether the block has another pattern.
        """
        self._matrix = matrix
        anew = self._extract(matrix, widened)
        if anew:
            self._analyse()
        assert self._factor is not None
        return self._factor.make(), anew

    def _extract(self, matrix: PETSc.Mat, widened: bool) -> bool:
        """Take out the other bodies' block; returns whether it has another pattern."""
        source, block = self._source, self._block
        if source is None or widened:
            source = matrix.createSubMatrix(self._rows, self._rows)
            if self._source is not None and self._source is not block:
                self._source.destroy()
            self._source = source
            if block is None or not _same_pattern(block, source):
                if block is not None:
                    block.destroy()
                self._block = source
                return True
        else:
            matrix.createSubMatrix(self._rows, self._rows, source)
        if block is not source:
            assert block is not None
            source.copy(block, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        return False

    def _analyse(self) -> None:
        assert self._block is not None
        if self._factor is not None:
            self._factor.destroy()
        self._factor = Factor(self._block, self._prefix)
        self._r_others, self._z_others = self._factor.vectors()

    def apply(self, pc: PETSc.PC, r: PETSc.Vec, z: PETSc.Vec) -> None:
        """One sweep, from ``r`` (N) to ``z`` (m); collective."""
        assert self._matrix is not None and self._factor is not None
        self._r_others.array[:] = r.array_r[self._others]
        self._factor.solve(self._r_others, self._z_others)
        first = self._z_others.array_r.copy()
        self._image_of(first, self._others, z)
        self._r_kept.array[:] = r.array_r[self._kept] - self._image.array_r[self._kept]
        self._stiff.solve(self._r_kept, self._z_kept)
        self._image_of(self._z_kept.array_r, self._kept, z)
        self._r_others.array[:] = -self._image.array_r[self._others]
        self._factor.solve(self._r_others, self._z_others)
        z.array[self._others] = first + self._z_others.array_r

    def _image_of(self, values: Floats, dofs: Ints, z: PETSc.Vec) -> None:
        """Put ``values`` at owned unknowns into ``z``, zero elsewhere, and A z into ``_image``."""
        assert self._matrix is not None
        z.set(0.0)
        z.array[dofs] = values
        self._matrix.mult(z, self._image)

    def destroy(self) -> None:
        """Give the memory back; collective."""
        for part in (self._factor, self._stiff, self._source, self._block, self._rows):
            if part is not None:
                part.destroy()


def _same_pattern(one: PETSc.Mat, other: PETSc.Mat) -> bool:
    """Whether two matrices have entries at the same places, on all ranks; collective."""
    pairs = zip(one.getValuesCSR()[:2], other.getValuesCSR()[:2], strict=True)
    same = all(np.array_equal(a, b) for a, b in pairs)
    return bool(one.comm.tompi4py().allreduce(same, op=MPI.LAND))
