"""The tangent's matrix, and the linear solver that works with it.

Direct (MUMPS) up to a number of unknowns, above it flexible GMRES with smoothed aggregation (GAMG),
unless iterations take longer than factorisations would.
Friction makes the tangent unsymmetric, and contact joins the bodies within the matrix. Where one of
them is far stiffer each is solved for by itself (:mod:`tribox.app.implicit.body_blocks`).
"""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Literal

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.equilibrium.step_mode import DEFAULT_STEP, StepMode
from tribox.app.implicit.body_blocks import BodyBlocks
from tribox.app.implicit.factor import DIRECT, LEFT, NO_EFFORT, CoupledFactor, Effort, LinearWay
from tribox.app.implicit.kept_bodies import stiff_solids
from tribox.app.implicit.multigrid import CLOSE, KRYLOV, Multigrid, damped, rigid_motions_of

Linear = Literal["auto", "direct", "krylov"]
# Unknowns up to which "auto" factorises, by the dimension of space: a factorisation takes about
# n^1.5 operations in the plane and n^2 in space, and n log n and n^(4/3) words of memory. In space
# 9381 unknowns took 17.6 s of processor time by factors and 8.2 by iterations where metal flows,
# 14 661 of two soft bodies 22.8 and 8.5; beside a stiff body, factorised once, 9381 took 3.2 and
# 2.5, 6.9 and 5.7 with a Poisson's ratio of .4995.
DIRECT_LIMIT = {2: 2_000_000, 3: 10_000}
ENDING = 0.1  # what a linear solve may leave, over what Newton's method may leave in the end


def linear_options(problem: Equilibrium, kind: Linear) -> dict[str, str | float | bool]:
    """PETSc options of the linear solver that a case asks for."""
    if chosen_solver(problem, kind) == "direct":
        return DIRECT
    return damped(KRYLOV, problem.comm.size)


def chosen_solver(problem: Equilibrium, kind: Linear) -> Linear:
    """The linear solver that a case asks for, "auto" by what each would cost."""
    if kind != "auto":
        return kind
    few = problem.size <= DIRECT_LIMIT[problem.dim]
    return "direct" if few or problem.fields else "krylov"


class LinearSolver:
    """Solves with the tangent of the state it was last assembled at.

    The matrix is factorised, or its preconditioner made, when it has been assembled: further
    solves with it cost a substitution only.

    Attributes:
        matrix: the tangent, supports and platens included.
        assembled: how often it was assembled, and so factorised.
        iterations: of all solves so far, if they are iterative.
    """

    def __init__(self, problem: Equilibrium, x: PETSc.Vec) -> None:
        """Make room for the tangent at ``x``; collective."""
        self.problem = problem
        self.matrix = problem.new_matrix(x)
        self.assembled = self.iterations = 0
        self._pattern = problem.pattern_changes
        self._ksp: PETSc.KSP | None = None
        self._way: LinearWay | None = None

    def use(self, ksp: PETSc.KSP, as_it_is: bool = False, may_turn: bool = False) -> None:
        """Solve with ``ksp``, whose operators this matrix becomes; collective.

        Args:
            ksp: PETSc's solver.
            may_turn: whether to factorise where iterations take too long, if memory allows.
        """
        self._ksp = ksp
        ksp.setOperators(self.matrix)
        iterative = ksp.getType() != PETSc.KSP.Type.PREONLY
        whole = as_it_is or bool(self.problem.fields)  # fields belong to no body
        stiff = [] if whole else stiff_solids(self.problem)
        if stiff or (iterative and not whole):
            self._way = BodyBlocks(ksp, self.matrix, self.problem, stiff, self._count, may_turn)
        elif iterative:
            self._way = Multigrid(ksp, self.matrix, rigid_motions_of(self.problem))
            # PETSc tells of the start of a solve as iteration 0.
            ksp.setMonitor(lambda ksp, iteration, norm: self._count(int(iteration > 0)))
        else:
            self._way = CoupledFactor(ksp, self.matrix)

    def _count(self, iterations: int) -> None:
        self.iterations += iterations

    def try_options(self, x: PETSc.Vec, prefix: str, names: Iterable[str]) -> None:
        """Set everything up at ``x``, as PETSc reads some options only then; collective.

        Args:
            x: state, m.
            prefix: of the solver's options.

        Raises:
            ValueError: PETSc refuses one of the options, or has no use for it.
        """
        try:
            self.assemble(x)
            self.ksp.setUpOnBlocks()
        except PETSc.Error as error:
            raise refusal(error) from None
        idle = unused(self.problem.comm, prefix, names)
        if idle:
            silence()
            raise ValueError(f"{', '.join(idle)}: not used by PETSc with {self.way.kinds()}")
        self.way.renew()  # the first factorisation of the run is that of its first tangent
        self.ksp.setOperators(self.matrix)
        self.assembled = self.iterations = 0

    @property
    def direct(self) -> bool:
        """Whether a solve with the matrix at hand is a substitution: cheap beside a new matrix."""
        return self.way.direct

    @property
    def effort(self) -> Effort:
        """What solves by iterations took that was too much."""
        return self._way.effort if isinstance(self._way, BodyBlocks) else NO_EFFORT

    @property
    def way(self) -> LinearWay:
        """How systems are solved."""
        assert self._way is not None, "use() comes first"
        return self._way

    @property
    def ksp(self) -> PETSc.KSP:
        """PETSc's solver."""
        assert self._ksp is not None, "use() comes first"
        return self._ksp

    def assemble(
        self, x: PETSc.Vec, step: StepMode = DEFAULT_STEP, before: PETSc.Vec | None = None
    ) -> None:
        """Assemble the tangent at ``x``; collective.

        Args:
            x: state, m.
            before: state that pressures are carried from; None: the exact tangent.
        """
        self.problem.jacobian(None, x, self.matrix, self.matrix, step, before)
        self._changed()

    def solve_from(
        self, x: PETSc.Vec, rhs: PETSc.Vec, increment: PETSc.Vec, step: StepMode = DEFAULT_STEP
    ) -> bool:
        """Solve with the tangent at ``x`` for an increment that meets prescribed values.

        Returns whether the solution is to be trusted.

        Args:
            x: state, m.
        """
        problem = self.problem
        problem.assemble_tangent(x, self.matrix, step)
        rows = problem.constrained_dofs() + problem.first
        self.matrix.zeroRowsColumns(rows, 1.0, x=increment, b=rhs)
        self._changed()
        return self.solve(rhs, increment)

    def solve(self, rhs: PETSc.Vec, solution: PETSc.Vec, on_path: bool = False) -> bool:
        """Solve with the tangent assembled last; returns whether it worked.

        ``on_path``: see :class:`tribox.app.implicit.factor.LinearWay`.
        """
        self.way.aim(LEFT if self.direct else CLOSE, on_path)
        with self.problem.timer("linear solve"), errors_as_raised():
            self.ksp.solve(rhs, solution)
        return self.forget_failure()

    def aim(self, share: float, on_path: bool = False, least: float = np.inf) -> None:
        """Solve so well that ``share`` of the forces may do as what Newton's method leaves.

        ``on_path``: see :class:`tribox.app.implicit.factor.LinearWay`; ``least``: share that a
        solve may have to get to, however dear that is.
        """
        closest = min(self.way.closest, least)
        self.way.aim(float(np.clip(ENDING * share, closest, LEFT if self.direct else 1.0)), on_path)

    def forget_failure(self) -> bool:
        """Drop a factorisation that failed, over which the next solve would stumble.

        Returns False if the last solve failed.
        """
        if self.ksp.getConvergedReason() >= 0:
            return True
        self.way.renew()
        self.ksp.setOperators(self.matrix)
        return False

    def _changed(self) -> None:
        """Take note of new entries, and of a new pattern."""
        self.assembled += 1
        widened = self._pattern != self.problem.pattern_changes
        self._pattern = self.problem.pattern_changes
        with self.problem.timer(self.way.part), errors_as_raised():
            self.way.set_up(widened)

    def snapshot(self) -> Snapshot:
        """What later factorisations and preconditioners depend on."""
        return {"assembled": self.assembled, "way": self.way.snapshot()}

    def restore(self, kept: Snapshot, x: PETSc.Vec, step: StepMode) -> None:
        """Go on from what :meth:`snapshot` has seen, with the tangent at ``x`` (m); collective."""
        self.way.renew()
        self.way.restore(kept["way"])
        self.assemble(x, step)
        self.assembled = kept["assembled"]


# -- What PETSc made of its options, and of what functions that it calls raise ---------------------


OF_OTHERS = ("snes_", "mat_mumps_")
"""How options begin that do not say how linear systems are solved."""


def sets_solver(names: Iterable[str]) -> bool:
    """Whether options, without prefix, say how linear systems are solved."""
    return any(not name.startswith(OF_OTHERS) for name in names)


def unused(comm: MPI.Comm, prefix: str, names: Iterable[str]) -> list[str]:
    """The options that no object of PETSc has asked for so far, on any rank; collective.

    Raises:
        RuntimeError: PETSc does not tell.
    """
    library = ctypes.CDLL(PETSc.__file__)
    found = []
    for name in names:
        used = ctypes.c_int(0)
        code = library.PetscOptionsUsed(None, f"{prefix}{name}".encode(), ctypes.byref(used))
        if code:
            raise RuntimeError(f"PETSc does not tell whether it used {name} (error {code})")
        if not comm.allreduce(bool(used.value), op=MPI.LOR):
            found.append(name)
    return found


def refusal(error: PETSc.Error) -> ValueError:
    """The error for options with which PETSc does not work: its reason, on one line."""
    silence()
    lines = str(error).strip().splitlines()
    return ValueError(lines[-1].split("] ", 1)[-1])


def silence() -> None:
    """Have PETSc say nothing, at its end, of options that were not used: all is over."""
    PETSc.Options()["options_left"] = False


@contextmanager
def errors_as_raised() -> Iterator[None]:
    """Raise what a function that PETSc called has raised, also Ctrl-C, not PETSc's error for it.

    PETSc's handler of errors makes Python objects while the exception is under way; the collector
    of garbage, were it to run then, would lose it, and petsc4py 3.22 would read freed memory.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    except PETSc.Error as error:
        if error.__cause__ is None:
            raise
        raise error.__cause__ from None
    finally:
        if collects:
            gc.enable()
