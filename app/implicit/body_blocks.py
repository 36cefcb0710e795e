"""Direct solves of bodies in contact, each factorised by itself where one of them is far stiffer.

The stiff bodies are condensed (:mod:`tribox.app.implicit.condensed_bodies`), or each body is solved
for in turn (:mod:`tribox.app.implicit.body_by_body`): in space, on several ranks, and where most
unknowns are of contact. Where no body can be kept the whole tangent is factorised, and so it is
where solving by bodies does not get there: for that tangent, and for good where that happens often.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from weakref import ref

from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.free_bodies import supports_at_hand
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.implicit.body_by_body import BodyByBody
from tribox.app.implicit.condensed_bodies import CLOSE, CondensedBodies, can_condense
from tribox.app.implicit.coupled_factor import DIRECT
from tribox.app.implicit.factor import Factor
from tribox.app.implicit.kept_bodies import KeptBodies, kept_bodies
from tribox.app.implicit.linear_way import CLOSEST, LEFT, petsc_kinds
from tribox.forms.bodies.solid import Solid

# Solves that failed are weighed against those that did not: three in a row, or more than one in
# six, are too many.
FAILED, TOO_MANY = 5, 15


class BodyBlocks:
    """Solves with the tangent, as PETSc's preconditioner in Python.

    Attributes:
        direct, part: see :class:`tribox.app.implicit.linear_way.LinearWay`.
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
        pc.setPythonContext(_Preconditioner(self))
        self._supports: tuple[object, ...] | None = None  # that the bodies were chosen for
        self._bodies: CondensedBodies | BodyByBody | None = None
        self._whole: Factor | None = None  # of the tangent; None: it is solved by the bodies
        self._fallen = False  # whether that is so of the tangent at hand only
        self._given_up = False  # whether it is so for good
        self._chosen = False  # whether the bodies are
        self._remade = False  # whether an analysis was made between two tangents
        self._works = False  # whether what was factorised last could be
        self._failures = 0
        self._share = LEFT  # of forces that a solve may leave out of balance
        self._rest = problem.new_vector()

    def kinds(self) -> str:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        return petsc_kinds(str(DIRECT["ksp_type"]), str(DIRECT["pc_type"]))

    # -- factorisations -----------------------------------------------------------------------

    def renew(self) -> None:
        """Forget all factorisations; collective."""
        self._drop_whole()
        if self._bodies is not None:
            self._bodies.destroy()
        self._bodies, self._chosen = None, False

    def _drop_whole(self) -> None:
        if self._whole is not None:
            self._whole.destroy()
        self._whole, self._fallen = None, False

    def set_up(self, widened: bool) -> bool:
        """Factorise; see :class:`tribox.app.implicit.linear_way.LinearWay`; collective."""
        anew = self._make(widened) or self._remade
        self._remade = False
        self._ksp.setOperators(self._matrix)
        self._ksp.getPC().setFailedReason(PETSc.PC.FailedReason.NOERROR)
        self._ksp.setUp()
        return anew

    def _make(self, widened: bool) -> bool:
        """Factorise; returns whether that began with an analysis."""
        chosen = self._choose()
        if self._fallen:
            self._drop_whole()
        self._given_up = self._given_up or self._failures >= TOO_MANY
        if self._bodies is not None and not self._given_up:
            self._works, anew = self._make_bodies(widened)
        else:
            anew = self._whole is None or widened
            self._make_whole(anew)
        return anew or chosen

    def _make_bodies(self, widened: bool) -> tuple[bool, bool]:
        """Factorise by bodies; in turn from where the bulk is not symmetric: pressure that follows.

        Returns:
            Whether that worked, and whether nothing of earlier tangents is in use.
        """
        assert self._bodies is not None
        works, anew = self._bodies.make(self._matrix, widened)
        if isinstance(self._bodies, BodyByBody) or self._bodies.bulk.symmetric:
            return works, anew
        self._bodies.destroy()
        bodies = kept_bodies(self._problem, self._stiff)
        assert bodies is not None
        self._bodies = BodyByBody(self._problem, bodies, self._prefix)
        return self._bodies.make(self._matrix, True)

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
            found = self._solver_of(bodies)
            if found.works:
                self._bodies = found
            else:
                found.destroy()
        return True

    def _solver_of(self, bodies: KeptBodies) -> CondensedBodies | BodyByBody:
        condense = can_condense(self._problem, bodies)
        kind = CondensedBodies if condense else BodyByBody
        return kind(self._problem, bodies, self._prefix)

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

    def aim(self, share: float, on_path: bool = False) -> None:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        self._share = share

    @property
    def closest(self) -> float:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        return CLOSE if isinstance(self._bodies, CondensedBodies) else CLOSEST

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """Solve for ``x`` (m) with forces ``b`` (N); collective."""
        if not self._chosen:  # forgotten after a solve that failed
            self._remade = self._make(True)
        if self._whole is None and not self._solve_by_bodies(b, x):
            self._fall_back()
        if self._whole is not None and self._works:
            x.array[:] = self._whole.solve(b.array_r)
        elif self._whole is not None:
            pc.setFailedReason(PETSc.PC.FailedReason.SUBPC_ERROR)

    def _solve_by_bodies(self, b: PETSc.Vec, x: PETSc.Vec) -> bool:
        """Solve for one body after the other; returns whether that worked.

        What is prescribed is put in beforehand: displacements are not to be added to forces in
        norms.
        """
        assert self._bodies is not None
        held = self._problem.constrained_dofs()
        b.copy(self._rest)
        self._rest.array[held] = 0.0
        converged = self._works and self._bodies.solve(self._rest, x, self._share)
        self._failures = max(self._failures - 1, 0) if converged else self._failures + FAILED
        x.array[held] = b.array_r[held]
        return converged

    # -- restart ------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        condensed = self._bodies if isinstance(self._bodies, CondensedBodies) else None
        return {
            "failures": self._failures,
            "given_up": self._given_up,
            "fallen": self._fallen,
            "worn": condensed is not None and condensed.bulk.worn,
            "renewed": condensed is not None and condensed.renewed and self._whole is None,
        }

    def restore(self, kept: Snapshot, set_up: Callable[[], None]) -> None:
        """See :class:`tribox.app.implicit.linear_way.LinearWay`."""
        self._supports, self._failures, self._given_up = None, 0, kept["given_up"]
        set_up()
        self._failures = kept["failures"]
        if isinstance(self._bodies, CondensedBodies):
            self._bodies.bulk.worn = kept["worn"]
            if kept["renewed"]:
                self._bodies.renew()
        if kept["fallen"]:
            self._fall_back()


class _Preconditioner:
    """What PETSc calls; it keeps nothing alive, for Python does not see what PETSc holds."""

    def __init__(self, blocks: BodyBlocks) -> None:
        self._blocks = ref(blocks)

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        """See :meth:`BodyBlocks.apply`."""
        blocks = self._blocks()
        assert blocks is not None, "the solver that this belongs to is gone"
        blocks.apply(pc, b, x)
