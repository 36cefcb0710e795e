"""The factorisation of bodies without their contact, kept for several tangents.

The unknowns of contact are left over when the bodies are factorised
(:mod:`tribox.app.implicit.schur_factor`): the contact of each tangent is put in by a dense matrix,
and the bulk of the tangent that was factorised stays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from tribox.app.equilibrium.matrix_values import values_in_place
from tribox.app.implicit.schur_factor import SchurFactor
from tribox.geometry.surfaces.facets import Floats, Ints


class Followers(NamedTuple):
    """Unknowns (m,) that move with a platen's leading one, and that one (m,)."""

    unknowns: Ints
    leaders: Ints


class KeptBulk:
    """Factorises, and solves.

    Attributes:
        worn: whether the next tangent is to be factorised; part of a restart.
        symmetric: whether the last bulk was that was to be factorised; none other is.
        factorised: how often one was.
    """

    def __init__(self, surface: Ints, followers: Followers, prefix: str) -> None:
        """Begin without a factorisation.

        Args:
            surface: unknowns s that contact may couple.
            followers: of platens.
            prefix: of the options for MUMPS.
        """
        self._surface, self._followers, self._prefix = surface, followers, prefix
        self._matrix: PETSc.Mat | None = None
        self._factor: SchurFactor | None = None
        self.symmetric, self.worn, self.factorised = True, True, 0

    def factorise(self, block: PETSc.Mat) -> bool:
        """Factorise the bodies' block of a tangent; returns whether it is symmetric, and could be.

        Args:
            block: on one rank; but for the surface's unknowns its pattern never changes.
        """
        matrix = self._without_surface(block)
        self.symmetric = _is_symmetric(matrix)
        if not self.symmetric:
            return False
        self._factor = self._factor or SchurFactor(matrix, self._surface, self._prefix)
        self.worn = not self._factor.make()
        self.factorised += 1
        return not self.worn

    def complete(self, contact: Floats) -> bool:
        """Put in what couples the surface's unknowns (s, s), N/m; returns whether that is regular.

        Args:
            contact: the bodies' own part included.
        """
        assert self._factor is not None
        dense = self._factor.complement + contact
        return bool(np.isfinite(dense).all()) and self._factor.exchange(dense)

    def solve(self, rhs: Floats) -> Floats:
        """Displacements (n,), m, for forces (n,), N."""
        assert self._factor is not None
        out = np.array(self._factor.solve(rhs))
        out[self._followers.unknowns] += out[self._followers.leaders]
        return out

    def _without_surface(self, block: PETSc.Mat) -> PETSc.Mat:
        """The block without what couples the surface's unknowns among themselves.

        Nor is there what ties unknowns to a platen's leading one: nothing else depends on them.
        """
        ends, columns, values = block.getValuesCSR()
        size = len(ends) - 1
        rows = np.repeat(np.arange(size, dtype=columns.dtype), np.diff(ends))
        surface = np.zeros(size, dtype=bool)
        surface[self._surface] = True
        within = surface[rows] & surface[columns]
        follows = np.full(size, -1, dtype=columns.dtype)
        follows[self._followers.unknowns] = self._followers.leaders
        values[within | (columns == follows[rows])] = 0.0
        keep = ~within | (rows == columns)
        if self._matrix is None:
            counts = np.bincount(rows[keep], minlength=size)
            starts = np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType)
            csr = (starts, columns[keep], values[keep])
            self._matrix = PETSc.Mat().createAIJ(block.getSizes(), csr=csr, comm=block.comm)
            return self._matrix
        with values_in_place(self._matrix) as here:
            here[:] = values[keep]
        return self._matrix

    def destroy(self) -> None:
        """Give the memory back."""
        for part in (self._factor, self._matrix):
            if part is not None:
                part.destroy()


def _is_symmetric(matrix: PETSc.Mat) -> bool:
    """Whether a matrix and its transpose do the same to a vector of noise, to round-off."""
    x, y = matrix.createVecs()
    x.array[:] = np.random.default_rng(0).normal(size=x.getSize())
    z = y.duplicate()
    matrix.mult(x, y)
    matrix.multTranspose(x, z)
    z.axpy(-1.0, y)
    return bool(z.norm() <= 1e-12 * y.norm())
