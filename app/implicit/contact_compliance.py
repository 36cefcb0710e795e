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
import scipy.linalg
import scipy.sparse

from tribox.geometry.surfaces.facets import Floats, Ints


@dataclass(frozen=True, slots=True)
class ContactCompliance:
    """The kept bodies as they answer to one tangent.

    Attributes:
        touched: (m,) of the unknowns c those that contact couples in this tangent.
        of_others: (s, m) sparse, A_sc; on_kept: (m, s) sparse, A_cs; among: (m, m) sparse, N.
        free: (m, c), F of the touched unknowns; F: (c, c).
        G: (m, m), m/N.
    """

    touched: Ints
    of_others: scipy.sparse.csr_matrix
    on_kept: scipy.sparse.csr_matrix
    among: scipy.sparse.csr_matrix
    free: Floats
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
            of_others: (s, c), A_sc, N/m.
            on_kept: (c, s), A_cs.
            among: (c, c), N.
        """
        m = _coupled(of_others, on_kept)
        of_others, on_kept, among = of_others[:, m], on_kept[m], among[m][:, m]
        free = F[m]
        square = np.ascontiguousarray(free[:, m])
        mixed = np.asarray((among.T @ square.T).T)
        mixed[np.diag_indices(len(m))] += 1.0
        G = scipy.linalg.solve(mixed, square, check_finite=False) if len(m) else square
        return cls(m, of_others, on_kept, among, free, G)

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
    """Kept unknowns (m,) that an entry couples with the others: patterns hold zeros as well."""
    coupled = np.zeros(on_kept.shape[0], dtype=bool)
    coupled[of_others.indices[of_others.data != 0.0]] = True
    rows = np.repeat(np.arange(len(coupled)), np.diff(on_kept.indptr))
    coupled[rows[on_kept.data != 0.0]] = True
    out: Ints = np.nonzero(coupled)[0].astype(np.int32)
    return out
