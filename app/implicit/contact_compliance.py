r"""How bodies that are kept give way under contact, as dense matrices at the unknowns of contact.

The unknowns s of the other bodies and k of those that are kept, of which contact touches the part
c only, obey

.. math::
    A_{ss} x_s + A_{sc} x_c = b_s, \quad K x_k + A_{cs} x_s + N x_c = b_k

with the stiffness K of the kept bodies without contact and N of contact among their own unknowns.
With :math:`F = (K^{-1})_{cc}` and the displacement :math:`w = (K^{-1} b)_c` that they would take
without contact,

.. math::
    x_c = (1 - G N) w - G A_{cs} x_s, \quad G = (1 + F N)^{-1} F,

so that the kept bodies take part in a system for :math:`x_s` alone by the small matrix
:math:`A_{sc} G A_{cs}`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from petsc4py import PETSc

from tribox.app.implicit.factor import Factor, positive_solver
from tribox.app.implicit.schur_factor import SchurFactor
from tribox.geometry.surfaces.facets import Floats, Ints


class KeptCompliance:
    """The factorisation of kept bodies, and their compliance where contact may touch them.

    Attributes:
        works: whether they could be factorised.
    """

    def __init__(self, K: PETSc.Mat, surface: Ints, prefix: str) -> None:
        """Factorise the bodies.

        Args:
            K: (k, k), N/m, their stiffness without contact, on one rank.
            surface: their unknowns c that contact may touch.
            prefix: of the options for MUMPS.
        """
        self._surface = surface
        self._factor = Factor(K, prefix, symmetric=True, solver=positive_solver(K.comm))
        part = SchurFactor(K, surface, prefix)
        self.works = self._factor.make() and part.make()
        if self.works:
            self._F: Floats = np.linalg.inv(part.complement).astype(np.float64)
            self._own = sparse(K)[surface][:, surface]
        part.destroy()

    def against(
        self,
        of_others: scipy.sparse.csr_matrix,
        on_kept: scipy.sparse.csr_matrix,
        among: scipy.sparse.csr_matrix,
    ) -> ContactCompliance:
        """The answer to a tangent; see :meth:`ContactCompliance.of`.

        Args:
            of_others: A_sc, N/m.
            on_kept: A_cs.
            among: K + N, (c, c).
        """
        return ContactCompliance.of(self._F, of_others, on_kept, among - self._own)

    def alone(self, forces: Floats, whole: bool) -> Floats:
        """Displacements (c,), m, under forces (k,), N, without contact.

        Args:
            forces: on all unknowns.
            whole: whether those inside the bodies count, which takes a solve.
        """
        if whole:
            return np.asarray(self.solve(forces)[self._surface])
        return np.asarray(self._F @ forces[self._surface])

    def solve(self, forces: Floats) -> Floats:
        """Displacements (k,), m, under forces (k,), N."""
        return self._factor.solve(forces)

    def destroy(self) -> None:
        """Give the memory back."""
        self._factor.destroy()


@dataclass(frozen=True, slots=True)
class ContactCompliance:
    """The kept bodies as they answer to one tangent.

    Attributes:
        touched: (m,) of the unknowns c those that contact couples in this tangent.
        of_others: (s, m) sparse, A_sc; on_kept: (m, s) sparse, A_cs; among: (m, m) sparse, N.
        G: (m, m), m/N.
    """

    touched: Ints
    of_others: scipy.sparse.csr_matrix
    on_kept: scipy.sparse.csr_matrix
    among: scipy.sparse.csr_matrix
    G: Floats

    @classmethod
    def of(
        cls,
        F: Floats,
        of_others: scipy.sparse.csr_matrix,
        on_kept: scipy.sparse.csr_matrix,
        among: scipy.sparse.csr_matrix,
    ) -> ContactCompliance:
        """Make G.

        Args:
            F: (c, c), m/N, symmetric.
            of_others: (s, c), A_sc, N/m; zeros are taken out of it, and of the next.
            on_kept: (c, s), A_cs.
            among: (c, c), N.
        """
        of_others.eliminate_zeros()  # patterns have room for what contact may couple
        on_kept.eliminate_zeros()
        m = _coupled(of_others, on_kept)
        of_others, on_kept, among = of_others[:, m], on_kept[m], among[m][:, m]
        square = F[np.ix_(m, m)]
        mixed = np.asarray((among.T @ square.T).T)
        mixed[np.diag_indices(len(m))] += 1.0
        G: Floats = np.linalg.solve(mixed, square)
        return cls(m, of_others, on_kept, among, G)

    def stiffness(self) -> Floats:
        """A_sc G A_cs (s, s), N/m: what the kept bodies take off the stiffness of contact."""
        left = self.of_others @ self.G
        return np.asarray((self.on_kept.T @ left.T).T)

    def relief(self, x_s: Floats) -> Floats:
        """A_sc G A_cs x_s (s,), N."""
        return np.asarray(self.of_others @ (self.G @ (self.on_kept @ x_s)))

    def held(self, w: Floats) -> Floats:
        """(1 − G N) w (m,): the displacement w (m,), m, as contact hinders it."""
        return np.asarray(w - self.G @ (self.among @ w))

    def pull(self, w: Floats) -> Floats:
        """A_sc (1 − G N) w (s,), N: on the others, where w (m,) is taken without contact."""
        return np.asarray(self.of_others @ self.held(w))

    def load(self, w: Floats, x_s: Floats) -> Floats:
        """A_cs x_s + N x_c (m,), N: what contact puts on the kept bodies.

        Args:
            w: (m,) displacement that they would take without contact, m.
            x_s: (s,) displacement of the others, m.
        """
        given = self.on_kept @ x_s
        x_c = self.held(w) - self.G @ given
        return np.asarray(given + self.among @ x_c)


def _coupled(of_others: scipy.sparse.csr_matrix, on_kept: scipy.sparse.csr_matrix) -> Ints:
    """Kept unknowns (m,) that are coupled with the others."""
    coupled = np.diff(on_kept.indptr) > 0
    coupled[of_others.indices] = True
    out: Ints = np.nonzero(coupled)[0].astype(np.int32)
    return out


def sparse(matrix: PETSc.Mat) -> scipy.sparse.csr_matrix:
    """A copy of a matrix on one rank."""
    ends, columns, values = matrix.getValuesCSR()
    return scipy.sparse.csr_matrix((values, columns, ends), shape=matrix.getSize())
