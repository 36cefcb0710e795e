"""Direct solves of bodies in contact, body by body where one of them is far stiffer.

Flexible GMRES on the whole tangent, preconditioned by a sweep over the bodies
(:mod:`app.implicit.body_sweep`). Where no body can be kept the whole tangent is factorised, and so
it is where GMRES does not get there: for that tangent, and for good where that happens often.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from petsc4py import PETSc

from app.equilibrium.equilibrium import Equilibrium
from app.equilibrium.free_bodies import supports_at_hand
from app.equilibrium.snapshot import Snapshot
from app.implicit.body_sweep import BodySweep
from app.implicit.coupled_factor import DIRECT
from app.implicit.factor import Factor
from app.implicit.kept_bodies import kept_bodies
from app.implicit.linear_way import petsc_kinds
from forms.bodies.solid import Solid

# One iteration leaves 1e-5 where a body is a thousand times stiffer, and Newton's method gains no
# more than five digits an iteration.
RTOL = 1e-3
LIMIT = 6  # iterations: a factorisation of the whole takes as long
# Solves that failed are weighed against those that did not: three in a row, or more than one in
# five, are too many.
FAILED, TOO_MANY = 5, 15


class BodyBlocks:
    """Solves with the tangent; what PETSc asks of a preconditioner in Python (``apply``).

    Attributes:
        direct, part: see :class:`app.implicit.linear_way.LinearWay`.
        solves, iterations: of GMRES, so far.
    """

    direct, part = True, "factorisation"

    def __init__(
        self, ksp: PETSc.KSP, matrix: PETSc.Mat, problem: Equilibrium, stiff: Sequence[Solid]
    ) -> None:
        """Solve by ``ksp``, which leaves all to this object; collective.

        Args:
            ksp: PETSc's solver, of type "preonly".
            matrix: the tangent.
            problem: that it is the tangent of.
            stiff: bodies that may be kept.
        """
        self._ksp, self._matrix, self._problem, self._stiff = ksp, matrix, problem, stiff
        self._prefix = ksp.getOptionsPrefix() or ""
        PETSc.Options(self._prefix)["pc_type"] = PETSc.PC.Type.PYTHON
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(self)
        self._supports: tuple[object, ...] | None = None  # that the bodies were chosen for
        self._sweep: BodySweep | None = None
        self._whole: Factor | None = None  # of the tangent; None: it is solved by the bodies
        self._fallen = False  # whether that is so of the tangent at hand only
        self._given_up = False  # whether it is so for good
        self._chosen = False  # whether the bodies are
        self._works = False  # whether what was factorised last could be
        self._failures = self.solves = self.iterations = 0
        self._rest = problem.new_vector()
        self._gmres = self._new_gmres()

    def _new_gmres(self) -> PETSc.KSP:
        gmres = PETSc.KSP().create(self._problem.comm)
        gmres.setType(PETSc.KSP.Type.FGMRES)
        gmres.setTolerances(rtol=RTOL, atol=0.0, max_it=LIMIT)
        gmres.getPC().setType(PETSc.PC.Type.PYTHON)
        return gmres

    def kinds(self) -> str:
        """See :class:`app.implicit.linear_way.LinearWay`."""
        return petsc_kinds(str(DIRECT["ksp_type"]), str(DIRECT["pc_type"]))

    # -- factorisations -----------------------------------------------------------------------

    def renew(self) -> None:
        """Forget all factorisations; collective."""
        self._drop_whole()
        if self._sweep is not None:
            self._sweep.destroy()
        self._sweep, self._chosen = None, False

    def _drop_whole(self) -> None:
        if self._whole is not None:
            self._whole.destroy()
        self._whole, self._fallen = None, False

    def set_up(self, widened: bool) -> bool:
        """Factorise; see :class:`app.implicit.linear_way.LinearWay`; collective."""
        chosen = self._choose()
        if self._fallen:
            self._drop_whole()
        self._given_up = self._given_up or self._failures >= TOO_MANY
        if self._sweep is not None and not self._given_up:
            self._works, anew = self._sweep.make(self._matrix, widened)
        else:
            anew = self._whole is None or widened
            self._make_whole(anew)
        self._ksp.setOperators(self._matrix)
        self._ksp.getPC().setFailedReason(PETSc.PC.FailedReason.NOERROR)
        self._ksp.setUp()
        return anew or chosen

    def _choose(self) -> bool:
        """Choose the bodies that are kept, if that is to be done anew; returns whether it was."""
        supports = supports_at_hand(self._problem)
        same = supports == self._supports
        if same and self._chosen:
            return False
        self.renew()
        if not same and self._supports is not None:
            self._failures, self._given_up = 0, False
        self._supports, self._chosen = supports, True
        bodies = kept_bodies(self._problem, self._stiff)
        if bodies is not None:
            sweep = BodySweep(self._problem, bodies, self._prefix)
            if sweep.works:
                self._sweep = sweep
                self._gmres.getPC().setPythonContext(sweep)
            else:
                sweep.destroy()
        return True

    def _make_whole(self, anew: bool) -> None:
        """Factorise the whole tangent, ``anew`` with its analysis."""
        if anew:
            self._drop_whole()
            self._whole = Factor(self._matrix, self._prefix)
        assert self._whole is not None
        self._works = self._whole.make()

    def _fall_back(self) -> None:
        """Factorise the whole of the tangent that is at hand, and of no other."""
        self._make_whole(anew=True)
        self._fallen = True

    # -- solution -----------------------------------------------------------------------------

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve for ``x`` (m) with forces ``b`` (N); collective."""
        if self._whole is None and not self._solve_by_bodies(b, x):
            self._fall_back()
        if self._whole is not None and not (self._works and self._whole.solve(b, x)):
            pc.setFailedReason(PETSc.PC.FailedReason.SUBPC_ERROR)

    def _solve_by_bodies(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve by GMRES; returns whether that worked.

        What is prescribed is put in beforehand: GMRES would meet it to its tolerance only, and
        would add displacements to forces in its norms.
        """
        held = self._problem.constrained_dofs()
        b.copy(self._rest)
        self._rest.array[held] = 0.0
        converged = self._works and self._iterate(x)
        self._failures = max(self._failures - 1, 0) if converged else self._failures + FAILED
        x.array[held] = b.array_r[held]
        return converged

    def _iterate(self, x: PETSc.Vec) -> bool:
        self._gmres.setOperators(self._matrix)
        self._gmres.solve(self._rest, x)
        self.solves += 1
        self.iterations += self._gmres.getIterationNumber()
        reason = int(self._gmres.getConvergedReason())
        # Numbers that are not finite give no others by any method.
        return reason > 0 or reason == PETSc.KSP.ConvergedReason.DIVERGED_NANORINF

    # -- restart ------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """See :class:`app.implicit.linear_way.LinearWay`."""
        return {
            "failures": self._failures,
            "given_up": self._given_up,
            "fallen": self._fallen,
        }

    def restore(self, kept: Snapshot, set_up: Callable[[], None]) -> None:
        """See :class:`app.implicit.linear_way.LinearWay`."""
        self._supports, self._failures, self._given_up = None, 0, kept["given_up"]
        set_up()
        self._failures = kept["failures"]
        if kept["fallen"]:
            self._fall_back()
