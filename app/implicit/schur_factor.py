"""A symmetric matrix factorised but for some of its unknowns, which are left to a dense matrix.

With the unknowns i eliminated and the unknowns s left over, A x = b is (MUMPS, user's guide: Schur
complement)

    (A_ss − A_si A_ii⁻¹ A_is) x_s = b_s − A_si A_ii⁻¹ b_i,    A_ii x_i = b_i − A_is x_s.

The dense matrix on the left may be exchanged as often as wanted: what couples the unknowns s among
themselves, as contact does, costs no factorisation of A_ii. petsc4py leaves
PETSc's functions for it out.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from petsc4py import PETSc

from tribox.app.equilibrium.matrix_values import petsc_library
from tribox.app.implicit.factor import Factor
from tribox.geometry.surfaces.facets import Floats, Ints

_UNFACTORED, _FACTORED = 0, 1  # PETSc's MatFactorSchurStatus
_ZERO_PIVOT = 71  # PETSc's PETSC_ERR_MAT_LU_ZRPVT
_SIGNATURES: dict[str, list[Any]] = {
    "MatFactorSetSchurIS": 2 * [ctypes.c_void_p],
    "MatFactorGetSchurComplement": 3 * [ctypes.c_void_p],
    "MatFactorRestoreSchurComplement": [*2 * [ctypes.c_void_p], ctypes.c_int],
    "MatDenseGetArray": 2 * [ctypes.c_void_p],
    "MatDenseRestoreArray": 2 * [ctypes.c_void_p],
    "MatSetUnfactored": [ctypes.c_void_p],
    "MatLUFactor": 4 * [ctypes.c_void_p],
}


@functools.cache
def _petsc() -> ctypes.CDLL | None:
    """PETSc's library; None where the functions needed are not found in it."""
    return petsc_library(_SIGNATURES)


def is_at_hand() -> bool:
    """Whether this PETSc has what is needed."""
    return np.dtype(PETSc.ScalarType) == np.float64 and _petsc() is not None


def _call(name: str, *arguments: object) -> None:
    code = getattr(_petsc(), name)(*arguments)
    if code:
        raise PETSc.Error(code)


class SchurFactor(Factor):
    """The factorisation of all unknowns but some; on one rank.

    Attributes:
        complement: (s, s), A_ss − A_si A_ii⁻¹ A_is of the last factorisation.
    """

    complement: Floats

    def __init__(self, matrix: PETSc.Mat, left: Ints, prefix: str) -> None:
        """Prepare to factorise ``matrix`` but for the unknowns ``left`` (s,)."""
        super().__init__(matrix, prefix, symmetric=True)
        self._prefix, self._left = prefix, left.astype(PETSc.IntType)
        self._inner: PETSc.Mat | None = None  # PETSc's factorisation

    def _prepare(self) -> PETSc.Mat:
        """A factorisation that is to leave unknowns over."""
        self._ksp.setOperators(self._matrix)
        pc = self._ksp.getPC()
        pc.setFactorSetUpSolverType()
        inner = pc.getFactorMatrix()
        inner.setOptionsPrefix(self._prefix)  # PETSc does so only where it is made later
        rows = PETSc.IS().createGeneral(self._left, comm=self._matrix.comm)
        _call("MatFactorSetSchurIS", inner.handle, rows.handle)
        rows.destroy()
        return inner

    def make(self, _widened: bool = False) -> bool:
        """Factorise the matrix as it is now; returns whether it could be done.

        Before it solves it wants a dense part: its own may be singular.
        """
        self._inner = self._inner or self._prepare()
        if not super().make():
            self._inner = None
            return False
        with self._dense(_UNFACTORED) as (matrix, values):
            _call("MatSetUnfactored", matrix)
            self.complement = _mirrored(values)
        return True

    def exchange(self, dense: Floats) -> bool:
        """Solve from now on with this dense part (s, s); returns whether it is regular."""
        with self._dense(_FACTORED) as (matrix, values):
            values[:] = dense
            _call("MatSetUnfactored", matrix)
            try:
                _call("MatLUFactor", matrix, None, None, None)
            except PETSc.Error as error:
                if error.ierr != _ZERO_PIVOT:
                    raise
                return False
        return True

    @contextmanager
    def _dense(self, status: int) -> Iterator[tuple[ctypes.c_void_p, Floats]]:
        """The dense part, PETSc's and as an array, that is in this status afterwards."""
        matrix, values = ctypes.c_void_p(), ctypes.POINTER(ctypes.c_double)()
        assert self._inner is not None
        by, handle, size = ctypes.byref, self._inner.handle, len(self._left)
        _call("MatFactorGetSchurComplement", handle, by(matrix), None)
        _call("MatDenseGetArray", matrix, by(values))
        try:
            yield matrix, np.ctypeslib.as_array(values, (size, size)).T
        finally:
            _call("MatDenseRestoreArray", matrix, by(values))
            _call("MatFactorRestoreSchurComplement", handle, by(matrix), status)


def _mirrored(values: Floats) -> Floats:
    """A symmetric matrix of which a triangle may be missing, whole."""
    below, above = np.tril(values, -1), np.triu(values, 1)
    if not above.any():
        above = below.T
    elif not below.any():
        below = above.T
    out: Floats = below + above + np.diag(np.diag(values))
    return out
