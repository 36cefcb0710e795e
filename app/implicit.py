"""Quasi-static implicit steps: predictor, SNES with the exact tangent, step control.

A step is tried from the last converged state. If it fails, nothing has been committed: the step is
cut and tried again from the same state. After easy steps the length grows back.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from app.equilibrium import Equilibrium
from geometry.projection import Floats

PREFIX = "tribox_"
_numbers = itertools.count()
STALLED = 0.1  # relative residual below which a stalled line search is followed by whole steps
STALL_WINDOW = 4  # iterations over which the residual must fall by a tenth not to count as stalled


@dataclass(frozen=True, slots=True)
class ImplicitOptions:
    """Settings of the Newton iteration.

    Attributes:
        tolerance: residual norm allowed, relative to the contact or reaction force.
        max_iterations: Newton iterations before a step counts as failed.
        petsc: further PETSc options, without prefix.
    """

    tolerance: float = 1e-8
    max_iterations: int = 25
    petsc: Mapping[str, str | float | bool] = field(default_factory=dict)


@dataclass(slots=True)
class StepResult:
    """Outcome of one attempted step.

    Attributes:
        converged: whether the step may be committed.
        iterations: Newton iterations, the predictor's linear solve included.
        reason: PETSc's converged reason.
        residuals: residual norm after each iteration, relative to the reference force.
    """

    converged: bool
    iterations: int
    reason: int
    residuals: list[float]


@dataclass(frozen=True, slots=True)
class Drive:
    """What pushes a step forward.

    Attributes:
        held: increments of this rank's prescribed displacements, m.
        loads: increments of the platens' forces and the pressures; total: their values.
    """

    held: Floats
    loads: Floats
    total: Floats


class ImplicitStepper:
    """Solves one step at a time and remembers the increments the predictor extrapolates."""

    def __init__(self, problem: Equilibrium, options: ImplicitOptions) -> None:
        """Set SNES up on the problem's residual and tangent; collective.

        Raises:
            ValueError: PETSc refuses one of the options.
        """
        self.problem = problem
        self.options = options
        self.x = problem.new_vector()  # converged unknowns
        self.trial = problem.new_vector()
        self._residual = problem.new_vector()
        self._increment: Floats | None = None
        self._drive: Drive | None = None
        self._loads: Floats = np.empty(0)
        self.residuals: list[float] = []
        self._largest_force = 0.0
        self._whole_steps = False
        PETSc.Log.begin()
        self._log_start = _logged_seconds()
        self.matrix = problem.new_matrix(self.x)
        self._pattern = problem.pattern_changes
        self.snes = self._new_snes()

    def _new_snes(self) -> PETSc.SNES:
        snes = PETSc.SNES().create(self.problem.comm)
        prefix = f"{PREFIX}{next(_numbers)}_"  # of its own: options must not reach the next run
        snes.setOptionsPrefix(prefix)
        defaults: dict[str, str | float | bool] = {
            "snes_type": "newtonls",
            "snes_linesearch_type": "bt",
            "snes_linesearch_order": 1,
            "ksp_type": "preonly",
            "pc_type": "lu",
            "pc_factor_mat_solver_type": "mumps",
        }
        options = self._petsc_options = PETSc.Options(prefix)
        for key, value in (defaults | dict(self.options.petsc)).items():
            options[key] = value
        self._usual_search = str(options.getString("snes_linesearch_type"))
        snes.setFunction(self._function, self._residual)
        snes.setJacobian(self._jacobian, self.matrix)
        snes.setTolerances(max_it=self.options.max_iterations)
        snes.setConvergenceTest(self._test)
        try:
            snes.setFromOptions()
            snes.getKSP().getPC().setFromOptions()
        except PETSc.Error as error:
            PETSc.Options()["options_left"] = False  # all else is of no interest any more
            reason = str(error).strip().splitlines()[-1].split("] ", 1)[-1]
            raise ValueError(reason) from None
        return snes

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        # Numbers that are not finite come from an inverted element or a singular matrix. SNES sees
        # a norm that is none: the line search cuts, or the step fails.
        if np.isfinite(x.norm()):
            self.problem.residual(snes, x, f)
        else:
            f.set(np.nan)

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        self.problem.jacobian(snes, x, A, P)
        self._forget_factor()

    def _forget_factor(self) -> None:
        """Drop the factorisation's analysis where the matrix has a new pattern.

        PETSc exchanges the matrix's inside on an addition with another pattern and does not see
        by itself that it changed.
        """
        if self._pattern != self.problem.pattern_changes:
            self._pattern = self.problem.pattern_changes
            self.snes.getKSP().reset()

    def _test(
        self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
    ) -> PETSc.SNES.ConvergedReason | None:
        """Residual against the present contact or reaction force: no unit enters."""
        norm = norms[2]
        if not np.isfinite(norm):
            return PETSc.SNES.ConvergedReason.DIVERGED_FNORM_NAN
        scale = max(self.problem.reference_force, 1e-6 * self._largest_force)
        self.residuals.append(norm / scale if scale > 0.0 else norm)
        if norm <= max(self.options.tolerance * scale, self.problem.roundoff):
            return PETSc.SNES.ConvergedReason.CONVERGED_FNORM_RELATIVE
        if iteration >= self.options.max_iterations:
            return PETSc.SNES.ConvergedReason.DIVERGED_MAX_IT
        recent = self.residuals[-STALL_WINDOW - 1 :]
        stalled = len(recent) > STALL_WINDOW and recent[-1] > 0.9 * recent[0]
        if stalled and not self._whole_steps and recent[-1] <= STALLED:
            return PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH
        return None

    def attempt(self, dt: float) -> StepResult:
        """Try a step of ``dt`` (s) under today's loads; commits nothing; collective."""
        problem = self.problem
        problem.dt = dt
        self.residuals = []
        solves = self._predict()
        iterations, reason = self._solve()
        if reason > 0 and not problem.is_evaluated(self.trial):
            problem.residual(None, self.trial, self._residual)
        return StepResult(
            # An element may be turned inside out and its residual finite all the same; the strain
            # energy, with its logarithm of J, is not.
            converged=reason > 0 and bool(np.isfinite(problem.strain_energy())),
            iterations=solves + iterations,
            reason=reason,
            residuals=self.residuals,
        )

    def _solve(self) -> tuple[int, int]:
        """Newton iterations with line search; where that stalls, on with whole steps.

        The residual has kinks where points change between stick and slip or open and closed. On
        the far side of one the line search may find no decrease however short the step, while a
        few whole steps settle which side each point is on.
        """
        iterations, reason = self._iterate()
        if reason > 0 or not self.residuals or self.residuals[-1] > STALLED:
            return iterations, reason
        self._whole_steps = True
        self._search("basic")
        more, reason = self._iterate()
        self._search(None)
        self._whole_steps = False
        return iterations + more, reason

    def _iterate(self) -> tuple[int, int]:
        """Let SNES solve from the present trial; (iterations, converged reason)."""
        self.snes.solve(None, self.trial)
        self._drop_failed_factor()
        return self.snes.getIterationNumber(), self.snes.getConvergedReason()

    def _drop_failed_factor(self) -> None:
        """Forget a factorisation that failed, or the next solve would stumble over it."""
        ksp = self.snes.getKSP()
        if ksp.getConvergedReason() < 0:
            ksp.reset()

    def _search(self, kind: str | None) -> None:
        """Use a kind of line search; None: the one of the case."""
        self._petsc_options["snes_linesearch_type"] = kind or self._usual_search
        self.snes.setFromOptions()

    def commit(self) -> None:
        """Accept the last attempt: unknowns, contact history and predictor."""
        self._increment = self.trial.array_r - self.x.array_r
        self._drive = self._driving()
        self._loads = self._drive.total
        self.trial.copy(self.x)
        self.problem.commit()
        self._largest_force = max(self._largest_force, self.problem.reference_force)

    def seconds(self) -> dict[str, float]:
        """Seconds of this rank so far in each part of the solution, from assembly to solve."""
        logged = {key: v - self._log_start[key] for key, v in _logged_seconds().items()}
        return dict(self.problem.timer.seconds) | logged

    def _driving(self) -> Drive:
        """Increments from the converged state to today's prescribed values and loads."""
        problem = self.problem
        loads = np.array(
            [p.force for p in problem.platens] + [float(p.value.value) for p in problem.pressures]
        )
        held = (problem.held_values(self.x) - self.x.array_r)[problem.held_dofs()]
        return Drive(held, loads - self._loads if len(self._loads) else loads, loads)

    def _predict(self) -> int:
        """Put a start into ``trial``; returns the number of linear solves it took.

        The last increment is repeated, scaled as the prescribed displacements and loads are. Where
        they do not continue in proportion, one solve with the tangent at the last state carries
        the new ones into the bodies.
        """
        self.x.copy(self.trial)
        drive = self._driving()
        ratio = self._proportion(drive)
        if ratio is None:
            self._carry(drive.held)
            return 1
        if self._increment is not None:
            self.trial.array[:] += ratio * self._increment
            self.trial.array[:] = self.problem.held_values(self.trial)
        return 0

    def _proportion(self, drive: Drive) -> float | None:
        """Factor by which ``drive`` continues the last one; None where it does not."""
        last = self._drive or Drive(0.0 * drive.held, 0.0 * drive.loads, drive.total)
        local = np.array([drive.held @ last.held, last.held @ last.held, drive.held @ drive.held])
        cross, before, now = self._sum(local)
        if before == 0.0 and now == 0.0:
            cross, before = drive.loads @ last.loads, last.loads @ last.loads
            now = drive.loads @ drive.loads
            if now == 0.0:
                return 0.0
        ratio = cross / before if before > 0.0 else 0.0
        missed = drive.held - ratio * last.held
        lag = drive.loads - ratio * last.loads
        scale = float(drive.total @ drive.total)
        same = bool(self._sum(np.array([missed @ missed]))[0] <= 1e-18 * max(now, before))
        same = same and bool(lag @ lag <= 1e-18 * scale)
        return ratio if same and ratio > 0.0 else None

    def _carry(self, drive: Floats) -> None:
        """Linear step from the converged state that meets the prescribed displacements."""
        problem, held = self.problem, self.problem.held_dofs()
        increment, rhs = problem.new_vector(), problem.new_vector()
        problem.residual(None, self.x, rhs)
        rhs.scale(-1.0)
        increment.array[held] = drive
        problem.assemble_tangent(self.x, self.matrix)
        self.matrix.zeroRowsColumns(held + problem.first, 1.0, x=increment, b=rhs)
        ksp = self.snes.getKSP()
        self._forget_factor()
        ksp.setOperators(self.matrix)
        ksp.solve(rhs, increment)
        self._drop_failed_factor()
        self.trial.axpy(1.0, increment)
        self.trial.array[:] = problem.held_values(self.trial)
        increment.destroy()
        rhs.destroy()

    def _sum(self, local: Floats) -> Floats:
        total = np.empty_like(local)
        self.problem.comm.Allreduce(local, total, op=MPI.SUM)
        return total


def _logged_seconds() -> dict[str, float]:
    """Seconds PETSc has logged for the parts of the linear solves, in this process."""
    events = {
        "factorisation": ("MatLUFactorSym", "MatLUFactorNum", "MatCholFctrSym", "MatCholFctrNum"),
        "preconditioner set-up": ("PCSetUp",),
        "linear solve": ("KSPSolve",),
    }
    seconds = {
        part: sum(PETSc.Log.Event(name).getPerfInfo()["time"] for name in names)
        for part, names in events.items()
    }
    # PETSc counts a factorisation as part of setting up the preconditioner.
    seconds["preconditioner set-up"] -= seconds["factorisation"]
    return seconds
