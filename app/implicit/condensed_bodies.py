r"""Linear systems of bodies in contact: the stiff ones condensed, the others' bulk kept a while.

The tangent couples the bodies, and changes from iteration to iteration, mostly at the unknowns of
contact. So:

- Stiff bodies, of which one factorisation is kept, take part in a system for the others alone, by a
  small dense matrix (:mod:`tribox.app.implicit.contact_compliance`).
- The others are factorised but for their unknowns s of contact, and for several tangents
  (:mod:`tribox.app.implicit.kept_bulk`): the bulk of before, with the contact of now, preconditions
  flexible GMRES on what is solved. It is exact for the tangent that was factorised: one iteration.

What is left then is due to the kept bodies, whose tangent is that of the undeformed state. The pass
is repeated until it is little. As contact enters dense matrices only, no pattern ever changes, and
each body is analysed once. On one rank, where the dense matrices are small beside the
factorisation.
"""

from __future__ import annotations

from weakref import ref

import numpy as np
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.implicit.contact_compliance import KeptCompliance, sparse
from tribox.app.implicit.kept_bodies import KeptBodies
from tribox.app.implicit.kept_bulk import Followers, KeptBulk
from tribox.app.implicit.schur_factor import is_at_hand
from tribox.geometry.surfaces.facets import Bools, Ints

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
        for nodes in (term.surface.slave.nodes, term.surface.master.nodes):
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
        """Factorise the stiff bodies.

        Args:
            problem: the equilibrium, on one rank.
            bodies: which are stiff.
            prefix: of the options for MUMPS.
        """
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

    def make(self, matrix: PETSc.Mat, widened: bool) -> tuple[bool, bool]:
        """Take the tangent up, and factorise its bulk where the last one is worn out.

        Args:
            matrix: the tangent.
            widened: whether its pattern is another than that of the last one.

        Returns:
            Whether that worked, and whether nothing of an earlier tangent is in use.
        """
        self._tangent, self.renewed = matrix, False
        self._extract(matrix, widened)
        self._fits = self.bulk.worn
        sc, cs, cc = (sparse(part) for part in self._parts[2:])
        self._compliance = self._stiff.against(sc, cs, cc)
        works = not self._fits or self._factorise()
        return works and self._complete(), self._fits

    def renew(self) -> bool:
        """Factorise the bulk of the tangent at hand, for this one only; returns whether it worked.

        So a restart need not know of a third tangent beside the bulk's and the last.
        """
        self.renewed = self._fits = True
        works = self._factorise() and self._complete()
        self.bulk.worn = True
        return works

    def _factorise(self) -> bool:
        return self.bulk.factorise(self._parts[0])

    def _complete(self) -> bool:
        """Put the contact of the tangent at hand in; returns whether that is regular."""
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

        Returns:
            Whether it got there.
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
            stuck = not less and (thorough or not np.isfinite(left))
            if stuck or (iterations >= LIMIT and not self._fits):
                break
            thorough, before = thorough or not less, left
        self.bulk.worn = True
        return False

    def _pass(self, most: float, thorough: bool) -> int:
        """A step for all bodies, from the forces left; returns GMRES's iterations.

        Args:
            most: N, forces that may be left on the others.
            thorough: whether forces inside the kept bodies count however small they are.
        """
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
