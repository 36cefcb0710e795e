r"""Linear systems of bodies in contact: the stiff ones condensed, the others' bulk kept a while.

The tangent couples the bodies, and changes from iteration to iteration, mostly at the unknowns of
contact. So:

- Stiff bodies, of which one factorisation is kept, take part in a system for the others alone, by a
  small dense matrix (contact's compliance, below).
- The others are factorised but for their unknowns s of contact, and for several tangents (kept
  bulk, below): the bulk of before, with the contact of now, preconditions flexible GMRES on what is
  solved. It is exact for the tangent that was factorised: one iteration.

What is left then is due to the kept bodies, whose tangent is that of the undeformed state. The pass
is repeated until it is little. As contact enters dense matrices only, no pattern ever changes, and
each body is analysed once. On one rank, where the dense matrices are small beside the
factorisation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple
from weakref import ref

import numpy as np
import scipy.sparse
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.matrix_values import values_in_place
from tribox.app.implicit.factor import Factor, SchurFactor, is_at_hand, positive_solver
from tribox.app.implicit.kept_bodies import KeptBodies
from tribox.geometry.surfaces.facets import Bools, Floats, Ints

CLOSE = 1e-5
"""Share of the forces that a solve may leave on the bodies that are not kept, and need not get
below on those that are. With 1e-3 left at the start of a step other points slipped than by a
factorisation of the whole: 651 Newton iterations instead of 173, with 221 700 unknowns."""
PASSES = 6
LIMIT = 20  # iterations of GMRES: a factorisation is no dearer than seven
WORN = 2  # iterations beyond which the bulk is factorised for the next tangent
MARGIN = 0.9  # of the forces that may be left on the others: what GMRES leaves
LESS = 0.5  # of the forces that a pass must not leave
STIRRED = 10.0
"""Forces inside the kept bodies, over those that may be left on the others, from which on these
bodies are solved for first: about 1/100 of them comes through to the others. Of bodies that bend
more does: they are solved for first as well after a pass that left too much."""
DENSE = 200.0
"""Operations of the dense matrices, (s + c)³, over n^1.5 of n unknowns that are factorised, at
most: then they take about two fifths of an LU factorisation (the plane, nested dissection)."""


def can_condense(problem: Equilibrium, bodies: KeptBodies) -> bool:
    """Whether bodies can be condensed, and whether that pays."""
    if problem.comm.size > 1 or problem.dim > 2 or not is_at_hand():
        return False
    count = np.count_nonzero(_of_contact(problem))
    return 0 < count**3 <= DENSE * len(bodies.others) ** 1.5


def _of_contact(problem: Equilibrium) -> Bools:
    """Whether unknowns (n,) may be coupled by a contact."""
    out = np.zeros(problem.owned, dtype=bool)
    for term in problem.contacts:
        for nodes in (term.surface.slave.nodes, term.surface.own_master):
            unknowns = problem.unknowns.of_nodes(np.unique(nodes))
            out[problem.tangent.constraints.condensed(unknowns)] = True
    return out


def _followers(problem: Equilibrium, others: Ints) -> Followers:
    """Of platens under a force, among the others."""
    place = np.full(problem.owned, -1, dtype=np.int32)
    place[others] = np.arange(len(others), dtype=np.int32)
    pairs = [np.empty((2, 0), dtype=np.int32)]
    for platen in problem.constraints.acting:
        if platen.displacement is None:
            leader = int(platen.all_dofs[0])
            rows = platen.dofs[platen.dofs != leader]
            pairs.append(np.stack([place[rows], np.full(len(rows), place[leader])]))
    return Followers(*np.concatenate(pairs, axis=1))


class CondensedBodies:
    """Keeps the factorisations, and solves with them.

    Attributes:
        works: whether the stiff bodies could be factorised.
        bulk: the factorisation of the others.
        renewed: whether that was made because the one before did not do for the tangent at hand.
    """

    def __init__(self, problem: Equilibrium, bodies: KeptBodies, prefix: str) -> None:
        """Factorise the stiff bodies."""
        self._kept, self._others = bodies.dofs, bodies.others
        touched = _of_contact(problem)
        self._c = np.nonzero(touched[self._kept])[0].astype(np.int32)
        self._s = np.nonzero(touched[self._others])[0].astype(np.int32)
        self._inside = np.delete(self._kept, self._c)
        self._stiff = KeptCompliance(bodies.tangent(problem), self._c, prefix)
        self.works = self._stiff.works
        self.bulk = KeptBulk(self._s, _followers(problem, self._others), prefix)
        every, s = _numbers(self._others), _numbers(self._others[self._s])
        c = _numbers(self._kept[self._c])
        self._pairs = ((every, every), (s, s), (s, c), (c, s), (c, c))
        self._parts: list[PETSc.Mat] = []  # of the tangent, at these pairs
        self._tangent: PETSc.Mat | None = None
        self.renewed = self._fits = False  # whether the bulk is that of the tangent
        self._krylov: PETSc.KSP | None = None
        self._left, self._step = problem.new_vector(), problem.new_vector()
        self._image = problem.new_vector()

    # -- factorisations -----------------------------------------------------------------------

    def make(self, matrix: PETSc.Mat, widened: bool) -> bool:
        """Take the tangent up, and factorise its bulk where the last one is worn out.

        Returns whether that worked.
        """
        self._tangent, self.renewed = matrix, False
        self._extract(matrix, widened)
        self._fits = self.bulk.worn
        sc, cs, cc = (sparse(part) for part in self._parts[2:])
        self._compliance = self._stiff.against(sc, cs, cc)
        works = not self._fits or self._factorise()
        return works and self._complete()

    def renew(self) -> bool:
        """Factorise the bulk of the tangent at hand, for it only; returns whether that worked."""
        self.renewed = self._fits = True
        works = self._factorise() and self._complete()
        self.bulk.worn = True
        return works

    def _factorise(self) -> bool:
        return self.bulk.factorise(self._parts[0])

    def _complete(self) -> bool:
        """Put the contact of the tangent at hand in; returns whether that is regular."""
        # Schur's complement at the contact's unknowns: what contact adds now, less what the kept
        # bodies give.
        own = sparse(self._parts[1]).toarray()
        return self.bulk.complete(own - self._compliance.stiffness())

    def _extract(self, matrix: PETSc.Mat, widened: bool) -> None:
        """Take out the block of the other bodies, and the entries at the unknowns of contact."""
        if self._parts and not widened:
            for pair, part in zip(self._pairs, self._parts, strict=True):
                matrix.createSubMatrix(*pair, part)
            return
        for old in (self._krylov, *self._parts):
            if old is not None:
                old.destroy()
        self._parts = [matrix.createSubMatrix(*pair) for pair in self._pairs]
        self._krylov = self._new_krylov(self._parts[0])

    def _new_krylov(self, block: PETSc.Mat) -> PETSc.KSP:
        """Flexible GMRES on the condensed system."""
        out = PETSc.KSP().create(block.comm)
        shell = PETSc.Mat().createPython(block.getSizes(), _Condensed(self), comm=block.comm)
        shell.setUp()
        out.setOperators(shell)
        shell.destroy()
        out.setType(PETSc.KSP.Type.FGMRES)
        out.getPC().setType(PETSc.PC.Type.PYTHON)
        out.getPC().setPythonContext(_Condensed(self))
        self._x, self._b = block.createVecs()
        return out

    # -- solution -----------------------------------------------------------------------------

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, share: float) -> bool:
        """Solve with the tangent for ``x`` (m) until a share of the forces ``b`` (N) is left.

        Returns whether it got there.
        """
        if self._solve(b, x, share):
            return True
        return not self._fits and self.renew() and self._solve(b, x, share)

    def _solve(self, b: PETSc.Vec, x: PETSc.Vec, share: float) -> bool:
        """Solve with the bulk at hand; returns whether it got there."""
        assert self._tangent is not None
        b.copy(self._left)
        x.set(0.0)
        norm = before = b.norm()
        if not np.isfinite(norm):
            x.set(np.nan)
            return True
        most = min(share, CLOSE) * norm
        thorough = False
        for number in range(PASSES):
            if not before > 0.0:
                return True
            iterations = self._pass(most, thorough)
            self.bulk.worn |= number == 0 and iterations > WORN
            x.axpy(1.0, self._step)
            self._tangent.mult(self._step, self._image)
            self._left.axpy(-1.0, self._image)
            left, others = self._left.norm(), np.linalg.norm(self._left.array_r[self._others])
            if left <= share * norm and others <= most:
                return True
            less = left <= LESS * before
            # A pass that is no better although the kept bodies were solved for first has nothing
            # left to try.
            stuck = not less and (thorough or not np.isfinite(left))
            if stuck or (iterations >= LIMIT and not self._fits):
                break
            thorough, before = thorough or not less, left
        self.bulk.worn = True
        return False

    def _pass(self, most: float, thorough: bool) -> int:
        """A step for all bodies, from the forces left; returns GMRES's iterations."""
        forces, compliance = self._left.array_r, self._compliance
        on_kept, touched = forces[self._kept], compliance.touched
        # The solve that ends the pass has those inside in any case.
        stirred = thorough or np.linalg.norm(forces[self._inside]) > STIRRED * most
        w = self._stiff.alone(on_kept, whole=bool(stirred))[touched]
        self._b.array[:] = forces[self._others]
        self._b.array[self._s] -= compliance.pull(w)
        iterations = self._solve_condensed(most)
        on_kept[self._c[touched]] -= compliance.load(w, self._x.array_r[self._s])
        self._step.array[self._others] = self._x.array_r
        self._step.array[self._kept] = self._stiff.solve(on_kept)
        return iterations

    def _solve_condensed(self, most: float) -> int:
        """Solve for the others; returns the iterations."""
        assert self._krylov is not None
        size = self._b.norm()
        if size <= MARGIN * most:
            self._x.set(0.0)
            return 0
        self._krylov.setTolerances(rtol=MARGIN * most / size, max_it=LIMIT)
        self._krylov.solve(self._b, self._x)
        return int(self._krylov.getIterationNumber())

    def apply_condensed(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """The others' forces y (N) against displacements x (m), with what the kept ones give."""
        self._parts[0].mult(x, y)
        y.array[self._s] -= self._compliance.relief(x.array_r[self._s])

    def precondition(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve with the bulk that was factorised and the contact of now."""
        x.array[:] = self.bulk.solve(b.array_r)

    def destroy(self) -> None:
        """Give the memory back."""
        for part in (self._stiff, self.bulk, self._krylov, *self._parts):
            if part is not None:
                part.destroy()


class _Condensed:
    """What PETSc calls; it keeps nothing alive, for Python does not see what PETSc holds."""

    def __init__(self, bodies: CondensedBodies) -> None:
        self._bodies = ref(bodies)

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        bodies = self._bodies()
        assert bodies is not None
        bodies.apply_condensed(x, y)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        bodies = self._bodies()
        assert bodies is not None
        bodies.precondition(b, x)


def _numbers(unknowns: Ints) -> PETSc.IS:
    return PETSc.IS().createGeneral(unknowns.astype(PETSc.IntType), comm=PETSc.COMM_SELF)


# -- How bodies that are kept give way under contact, as dense matrices at the unknowns of contact
#
# The unknowns s of the other bodies and k of those that are kept, of which contact touches the part
# c only, obey
#
# .. math::
#     A_{ss} x_s + A_{sc} x_c = b_s, \quad K x_k + A_{cs} x_s + N x_c = b_k
#
# with the stiffness K of the kept bodies without contact and N of contact among their own unknowns.
# With :math:`F = (K^{-1})_{cc}` and the displacement :math:`w = (K^{-1} b)_c` that they would take
# without contact,
#
# .. math::
#     x_c = (1 - G N) w - G A_{cs} x_s, \quad G = (1 + F N)^{-1} F,
#
# so that the kept bodies take part in a system for :math:`x_s` alone by the small matrix
# :math:`A_{sc} G A_{cs}`.


class KeptCompliance:
    """The factorisation of kept bodies, and their compliance where contact may touch them.

    Attributes:
        works: whether they could be factorised.
    """

    def __init__(self, K: PETSc.Mat, surface: Ints, prefix: str) -> None:
        """Factorise the bodies.

        Args:
            K: (k, k), N/m, their stiffness without contact, on one rank.
        """
        self._surface = surface
        self._factor = Factor(K, prefix, symmetric=True, solver=positive_solver(K.comm))
        part = SchurFactor(K, surface, prefix)
        self.works = self._factor.make() and part.make()
        if self.works:
            # (K⁻¹)_cc is the inverse of Schur's complement of K at c: no column of K⁻¹ is solved
            # for.
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
            among: K + N, (c, c).
        """
        return ContactCompliance.of(self._F, of_others, on_kept, among - self._own)

    def alone(self, forces: Floats, whole: bool) -> Floats:
        """Displacements (c,), m, under forces (k,), N, without contact."""
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
    """The kept bodies as they answer to one tangent."""

    touched: Ints  # (m,) of the unknowns c those that contact couples in this tangent
    of_others: scipy.sparse.csr_matrix  # (s, m) sparse, A_sc
    on_kept: scipy.sparse.csr_matrix  # (m, s) sparse, A_cs
    among: scipy.sparse.csr_matrix  # (m, m) sparse, N
    G: Floats  # (m, m), m/N

    @classmethod
    def of(
        cls,
        F: Floats,
        of_others: scipy.sparse.csr_matrix,
        on_kept: scipy.sparse.csr_matrix,
        among: scipy.sparse.csr_matrix,
    ) -> ContactCompliance:
        """Make G; no numbers where 1 + F N is singular, or holds none.

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
        # F N with N sparse on the right: scipy multiplies sparse matrices from the left, hence
        # twice transposed.
        mixed = np.asarray((among.T @ square.T).T)
        mixed[np.diag_indices(len(m))] += 1.0
        try:
            G: Floats = np.linalg.solve(mixed, square)
        except np.linalg.LinAlgError:
            G = np.full_like(square, np.nan)
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
    return np.nonzero(coupled)[0].astype(np.int32)


def sparse(matrix: PETSc.Mat) -> scipy.sparse.csr_matrix:
    """A copy of a matrix on one rank."""
    ends, columns, values = matrix.getValuesCSR()
    return scipy.sparse.csr_matrix((values, columns, ends), shape=matrix.getSize())


# -- The factorisation of bodies without their contact, kept for several tangents ------------------
#
# The unknowns of contact are left over when the bodies are factorised (:class:`SchurFactor`): the
# contact of each tangent is put in by a dense matrix, and the bulk that was factorised stays.


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
        """Put in what couples the surface's unknowns (s, s), N/m; returns whether it is regular."""
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
