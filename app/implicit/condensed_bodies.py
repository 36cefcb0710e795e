r"""Linear systems of bodies in contact: the stiff ones condensed, the others' bulk kept a while.

The tangent couples the bodies, and changes from iteration to iteration, mostly at the unknowns of
contact. So:

- Stiff bodies, of which one factorisation is kept, take part in a system for the others alone, by a
  small dense matrix (:mod:`tribox.app.implicit.contact_compliance`).
- The others are factorised but for their unknowns s of contact
  (:mod:`tribox.app.implicit.schur_factor`), and for several tangents: that of the bulk before, with
  the contact of now, preconditions flexible GMRES on what is solved. It is exact for the tangent
  that the bulk was factorised for: one iteration.

What is left then is due to the kept bodies, whose tangent is that of the undeformed state. The pass
is repeated until it is little. As contact enters dense matrices only, no pattern ever changes, and
each body is analysed once. On one rank, where the dense matrices are small beside the
factorisation.
"""

from __future__ import annotations

from weakref import ref

import numpy as np
import scipy.sparse
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.matrix_values import values_in_place
from tribox.app.implicit.contact_compliance import ContactCompliance
from tribox.app.implicit.factor import Factor, positive_solver
from tribox.app.implicit.kept_bodies import KeptBodies
from tribox.app.implicit.schur_factor import SchurFactor, is_at_hand
from tribox.geometry.surfaces.facets import Bools, Floats, Ints

CLOSE = 1e-5
"""Share of the forces that a solve may leave on the bodies that are not kept, and need not get
below on those that are. With 1e-3 left at the start of a step other points slipped than by a
factorisation of the whole: 651 Newton iterations instead of 173, with 221 700 unknowns."""
PASSES = 6
LIMIT = 20  # iterations of GMRES: a factorisation is no dearer than seven
WORN = 2  # iterations beyond which the bulk is factorised for the next tangent
MARGIN = 0.3  # of the forces that may be left on the others: what GMRES leaves
LESS = 0.5  # of the forces that a pass must not leave
STIRRED = 10.0
"""Forces inside the kept bodies, over those that may be left on the others, from which on these
bodies are solved for first: about 1/100 of them comes through to the others."""
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
        for nodes in (term.surface.slave.nodes, term.surface.master.nodes):
            unknowns = problem.unknowns.of_nodes(np.unique(nodes))
            out[problem.tangent.constraints.condensed(unknowns)] = True
    return out


def _following(problem: Equilibrium, others: Ints) -> tuple[Ints, Ints]:
    """Which of the others (m,) move with a platen's leading one, and that one; one rank."""
    place = np.full(problem.owned, -1, dtype=np.int32)
    place[others] = np.arange(len(others), dtype=np.int32)
    pairs = [np.empty((2, 0), dtype=np.int32)]
    for platen in problem.constraints.acting:
        if platen.displacement is None:
            leader = int(platen.all_dofs[0])
            rows = platen.dofs[platen.dofs != leader]
            pairs.append(np.stack([place[rows], np.full(len(rows), place[leader])]))
    followers, leaders = np.concatenate(pairs, axis=1)
    return followers, leaders


class CondensedBodies:
    """Keeps the factorisations, and solves with them.

    Attributes:
        works: whether the stiff bodies could be factorised.
        symmetric: whether the last bulk was that was to be factorised; none other is.
        worn: whether the next tangent's bulk is factorised; it is part of a restart.
        factorised: how often a bulk was.
    """

    def __init__(self, problem: Equilibrium, bodies: KeptBodies, prefix: str) -> None:
        """Factorise the stiff bodies.

        Args:
            problem: the equilibrium, on one rank.
            bodies: which are stiff.
            prefix: of the options for MUMPS.
        """
        self._prefix = prefix
        self._kept, self._others = bodies.dofs, bodies.others
        touched = _of_contact(problem)
        self._c = np.nonzero(touched[self._kept])[0].astype(np.int32)
        self._s = np.nonzero(touched[self._others])[0].astype(np.int32)
        self._inside = np.delete(self._kept, self._c)
        self._followers, self._leaders = _following(problem, self._others)
        K = bodies.tangent(problem)
        self._stiff = Factor(K, prefix, symmetric=True, solver=positive_solver(K.comm))
        self.works = self._stiff.make() and self._find_compliance(K)
        self._rows = _numbers(self._others)
        s, c = _numbers(self._others[self._s]), _numbers(self._kept[self._c])
        self._pairs = ((s, s), (s, c), (c, s), (c, c))
        self._small: list[PETSc.Mat] = []  # what the tangent couples at these pairs
        self._tangent: PETSc.Mat | None = None
        self._block: PETSc.Mat | None = None  # of the others
        self._bulk: PETSc.Mat | None = None  # the same without s among themselves, as factorised
        self._factor: SchurFactor | None = None
        self._krylov: PETSc.KSP | None = None
        self._left, self._step = problem.new_vector(), problem.new_vector()
        self._image = problem.new_vector()
        self.symmetric, self.worn, self.factorised = True, True, 0

    def _find_compliance(self, K: PETSc.Mat) -> bool:
        """F of the kept bodies, undeformed; returns whether it could be found."""
        surface = SchurFactor(K, self._c, self._prefix)
        works = surface.make()
        if works:
            self._F: Floats = np.linalg.inv(surface.complement).astype(np.float64)
            self._K_cc = _sparse(K)[self._c][:, self._c]
        surface.destroy()
        return works

    # -- factorisations -----------------------------------------------------------------------

    def make(self, matrix: PETSc.Mat, widened: bool) -> tuple[bool, bool]:
        """Take the tangent up, and factorise its bulk where the last one is worn out.

        Args:
            matrix: the tangent.
            widened: whether its pattern is another than that of the last one.

        Returns:
            Whether that worked, and whether nothing of an earlier tangent is in use.
        """
        self._tangent = matrix
        self._extract(matrix, widened)
        anew = self.worn
        if anew and not self._factorise():
            return False, True
        ss, sc, cs, cc = (_sparse(part) for part in self._small)
        self._compliance = ContactCompliance.of(self._F, sc, cs, cc - self._K_cc)
        assert self._factor is not None
        dense = self._factor.complement - self._compliance.stiffness()
        dense += ss.toarray()
        return self._factor.exchange(dense), anew

    def _extract(self, matrix: PETSc.Mat, widened: bool) -> None:
        """Take out the block of the other bodies, and what contact couples."""
        if self._block is None or widened:
            for old in (self._block, self._krylov, *self._small):
                if old is not None:
                    old.destroy()
            self._block = matrix.createSubMatrix(self._rows, self._rows)
            self._small = [matrix.createSubMatrix(*pair) for pair in self._pairs]
            self._krylov = self._new_krylov(self._block)
            return
        matrix.createSubMatrix(self._rows, self._rows, self._block)
        for pair, part in zip(self._pairs, self._small, strict=True):
            matrix.createSubMatrix(*pair, part)

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

    def _factorise(self) -> bool:
        """Factorise the bulk of the others; returns whether it is symmetric, and could be."""
        assert self._block is not None
        self.symmetric = _is_symmetric(self._bulk_of(self._block))
        if not self.symmetric:
            return False
        if self._factor is None:
            assert self._bulk is not None
            self._factor = SchurFactor(self._bulk, self._s, self._prefix)
        self.worn = not self._factor.make()
        self.factorised += 1
        return not self.worn

    def _bulk_of(self, block: PETSc.Mat) -> PETSc.Mat:
        """The block without what couples s among themselves; its pattern stays.

        Nor is there what ties unknowns to a platen's leading one: nothing else depends on them.
        """
        ends, columns, values = block.getValuesCSR()
        rows = np.repeat(np.arange(len(ends) - 1, dtype=columns.dtype), np.diff(ends))
        surface = np.zeros(len(ends) - 1, dtype=bool)
        surface[self._s] = True
        within = surface[rows] & surface[columns]
        follows = np.full(len(ends) - 1, -1, dtype=columns.dtype)
        follows[self._followers] = self._leaders
        values[within | (columns == follows[rows])] = 0.0
        keep = ~within | (rows == columns)
        if self._bulk is None:
            counts = np.bincount(rows[keep], minlength=len(ends) - 1)
            starts = np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType)
            self._bulk = PETSc.Mat().createAIJ(
                block.getSizes(), csr=(starts, columns[keep], values[keep]), comm=block.comm
            )
            return self._bulk
        with values_in_place(self._bulk) as here:
            here[:] = values[keep]
        return self._bulk

    # -- solution -----------------------------------------------------------------------------

    def solve(self, b: PETSc.Vec, x: PETSc.Vec, share: float) -> bool:
        """Solve with the tangent for ``x`` (m) until a share of the forces ``b`` (N) is left.

        Returns:
            Whether it got there.
        """
        assert self._tangent is not None
        b.copy(self._left)
        x.set(0.0)
        norm = before = b.norm()
        if not np.isfinite(norm):
            x.set(np.nan)
            return True
        most = min(share, CLOSE) * norm
        for number in range(PASSES):
            if not before > 0.0:
                return True
            iterations = self._pass(most)
            self.worn |= number == 0 and iterations > WORN
            x.axpy(1.0, self._step)
            self._tangent.mult(self._step, self._image)
            self._left.axpy(-1.0, self._image)
            left, others = self._left.norm(), np.linalg.norm(self._left.array_r[self._others])
            if left <= share * norm and others <= most:
                return True
            if not left <= LESS * before:
                break
            before = left
        self.worn = True
        return False

    def _pass(self, most: float) -> int:
        """A step for all bodies, from the forces left; returns GMRES's iterations.

        Args:
            most: N, forces that may be left on the others.
        """
        forces, compliance = self._left.array_r, self._compliance
        on_kept = forces[self._kept]
        w = self._alone(on_kept, most)
        self._b.array[:] = forces[self._others]
        self._b.array[self._s] -= compliance.pull(w)
        iterations = self._solve_condensed(most)
        x_s = self._x.array_r[self._s]
        on_kept[self._c[compliance.touched]] -= compliance.load(w, x_s)
        self._step.array[self._others] = self._x.array_r
        self._step.array[self._kept] = self._stiff.solve(on_kept)
        return iterations

    def _alone(self, forces: Floats, most: float) -> Floats:
        """What forces (k,), N, on the kept bodies move their touched unknowns by without contact.

        Forces inside them count where they are large only; the solve that ends the pass has all.
        """
        touched = self._compliance.touched
        if np.linalg.norm(self._left.array_r[self._inside]) > STIRRED * most:
            return np.asarray(self._stiff.solve(forces)[self._c[touched]])
        return self._compliance.free @ forces[self._c]

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
        assert self._block is not None
        self._block.mult(x, y)
        y.array[self._s] -= self._compliance.relief(x.array_r[self._s])

    def precondition(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve with the bulk that was factorised and the contact of now."""
        assert self._factor is not None
        found = x.array
        found[:] = self._factor.solve(b.array_r)
        found[self._followers] += found[self._leaders]

    def destroy(self) -> None:
        """Give the memory back."""
        parts = (self._factor, self._stiff, self._bulk, self._block, self._krylov, *self._small)
        for part in parts:
            if part is not None:
                part.destroy()


class _Condensed:
    """What PETSc calls; it keeps nothing alive, for Python does not see what PETSc holds."""

    def __init__(self, bodies: CondensedBodies) -> None:
        self._bodies = ref(bodies)

    def mult(self, matrix: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """See :meth:`CondensedBodies.apply_condensed`."""
        bodies = self._bodies()
        assert bodies is not None
        bodies.apply_condensed(x, y)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """See :meth:`CondensedBodies.precondition`."""
        bodies = self._bodies()
        assert bodies is not None
        bodies.precondition(b, x)


def _numbers(unknowns: Ints) -> PETSc.IS:
    return PETSc.IS().createGeneral(unknowns.astype(PETSc.IntType), comm=PETSc.COMM_SELF)


def _sparse(matrix: PETSc.Mat) -> scipy.sparse.csr_matrix:
    ends, columns, values = matrix.getValuesCSR()
    return scipy.sparse.csr_matrix((values, columns, ends), shape=matrix.getSize())


def _is_symmetric(matrix: PETSc.Mat) -> bool:
    """Whether a matrix and its transpose do the same to a vector of noise, to round-off."""
    x, y = matrix.createVecs()
    x.array[:] = np.random.default_rng(0).normal(size=x.getSize())
    z = y.duplicate()
    matrix.mult(x, y)
    matrix.multTranspose(x, z)
    z.axpy(-1.0, y)
    return bool(z.norm() <= 1e-12 * y.norm())
