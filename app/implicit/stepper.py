"""Quasi-static implicit steps: predictor, SNES with the exact tangent, step control.

A step is tried from the last converged state. If it fails, nothing has been committed: the step is
cut and tried again from the same state. After easy steps the length grows back.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from app.equilibrium.equilibrium import Equilibrium
from app.equilibrium.step_mode import DEFAULT_STEP, StepMode
from app.implicit.linear_solver import Linear, LinearSolver, linear_options
from app.implicit.predictor import Predictor

PREFIX = "tribox_"
_numbers = itertools.count()
REUSE_SAFETY = 10.0  # margin in the estimate of what an iteration with the last tangent leaves
# Share of the penalties, and gap in slave facets up to which they pull, with which a step that
# failed is approached; and the same from a state in which nothing presses.
APPROACH = ((0.03, 0.0),)
SEARCH = ((1e-3, 2.0), (1e-3, 0.0), (0.03, 0.0))
STALLED = 0.1  # relative residual below which a stalled line search is followed by whole steps
KINKED = 1e-5  # relative residual from which on an iteration gains far more than GAIN, or wavers
GAIN = 4.0
STALL_WINDOW = 4  # iterations over which the residual must fall by a tenth not to count as stalled


@dataclass(frozen=True, slots=True)
class ImplicitOptions:
    """Settings of the Newton iteration.

    Attributes:
        tolerance: residual norm allowed, relative to the contact or reaction force.
        max_iterations: Newton iterations before a step counts as failed.
        linear: the linear solver; "auto" is direct up to a number of unknowns.
        petsc: further PETSc options, without prefix.
    """

    tolerance: float = 1e-8
    max_iterations: int = 25
    linear: Linear = "auto"
    petsc: Mapping[str, str | float | bool] = field(default_factory=dict)


@dataclass(slots=True)
class StepResult:
    """Outcome of one attempted step.

    Attributes:
        converged: whether the step may be committed.
        iterations: Newton iterations, the predictor's linear solve included.
        factorisations: tangents assembled and factorised for them.
        reason: PETSc's converged reason.
        residuals: residual norm after each iteration, relative to the reference force.
    """

    converged: bool
    iterations: int
    factorisations: int
    reason: int
    residuals: list[float]


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
        self.residuals: list[float] = []
        self.rate_dependent = True
        self._step = DEFAULT_STEP  # of the present attempt
        self._largest_force = 0.0
        self._whole_steps = False
        self._settling = False  # whether points keep to their facets
        self._touching = False  # whether anything pressed at the last converged state
        # Whether no other means are left, so that a step in trouble uses all its iterations.
        self._patient = not problem.contacts
        self.solver = LinearSolver(problem, self.x)
        self.snes = self._new_snes()
        self.solver.use(self.snes.getKSP())
        self.predictor = Predictor(problem, self.solver)

    def _new_snes(self) -> PETSc.SNES:
        snes = PETSc.SNES().create(self.problem.comm)
        prefix = f"{PREFIX}{next(_numbers)}_"  # of its own: options must not reach the next run
        snes.setOptionsPrefix(prefix)
        defaults: dict[str, str | float | bool] = {
            "snes_type": "newtonls",
            "snes_linesearch_type": "bt",
            "snes_linesearch_order": 1,
            **linear_options(self.problem, self.options.linear),
        }
        options = self._petsc_options = PETSc.Options(prefix)
        for key, value in (defaults | dict(self.options.petsc)).items():
            options[key] = value
        self._usual_search = str(options.getString("snes_linesearch_type"))
        snes.setFunction(self._function, self._residual)
        snes.setJacobian(self._jacobian, self.solver.matrix)
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
            self.problem.residual(snes, x, f, self._step)
        else:
            f.set(np.nan)

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        if not self._reuse():
            self.solver.assemble(x, self._step)

    def _reuse(self) -> bool:
        """Whether the tangent factorised last will do for an iteration that ends the step.

        A Newton iteration that reduced the residual by c has moved the tangent by about as much,
        so the old one reduces it by about c once more.
        """
        if not self.solver.direct or len(self.residuals) < 2 or self.residuals[-2] == 0.0:
            return False
        last = self.residuals[-1]
        return REUSE_SAFETY * last * last / self.residuals[-2] <= self.options.tolerance

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
        if self._wavers():
            return PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH
        recent = self.residuals[-STALL_WINDOW - 1 :]
        stalled = len(recent) > STALL_WINDOW and recent[-1] > 0.9 * recent[0]
        hopeless = recent[-1] <= STALLED or not self._patient
        if stalled and hopeless and not self._whole_steps:
            return PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH
        return None

    def _wavers(self) -> bool:
        """Whether the iteration is so near that it should gain far more than it does."""
        if self._settling or self._whole_steps or len(self.residuals) < 2:
            return False
        before, now = self.residuals[-2:]
        return now <= KINKED and now * GAIN > before

    def attempt(self, dt: float) -> StepResult:
        """Try a step of ``dt`` (s) under today's loads; commits nothing; collective."""
        problem = self.problem
        self._step = StepMode.of_stage(dt, problem.contacts, self.rate_dependent)
        self.residuals = []
        assembled = self.solver.assembled
        iterations = self.predictor.predict(self.x, self.trial, self._step)
        start = self.trial.array_r.copy()
        more, reason = self._solve()
        iterations += more
        if reason <= 0:
            self.trial.array[:] = start
            more, reason = self._other_ways(reason)
            iterations += more
        if reason > 0 and not problem.is_evaluated(self.trial):
            problem.residual(None, self.trial, self._residual, self._step)
        return StepResult(
            # An element may be turned inside out and its residual finite all the same; the strain
            # energy, with its logarithm of J, is not.
            converged=reason > 0 and bool(np.isfinite(problem.strain_energy())),
            iterations=iterations,
            factorisations=self.solver.assembled - assembled,
            reason=reason,
            residuals=self.residuals,
        )

    def _other_ways(self, reason: int) -> tuple[int, int]:
        """Solve from ``trial``, the predicted start, where Newton's method failed from there.

        Args:
            reason: why it failed; returned where there is no other way.
        """
        if not self.problem.contacts:
            started = self.predictor.restart(self.x, self.trial, self._step)
            more, reason = self._solve()
            return started + more, reason
        if self._near():
            return 0, reason
        iterations, reason = self._approach(APPROACH)
        if reason <= 0 and not self._touching:
            self.x.copy(self.trial)
            self.trial.array[:] = self.problem.constrained_values(self.trial)
            more, reason = self._approach(SEARCH)
            iterations += more
        return iterations, reason

    def _solve(self) -> tuple[int, int]:
        """Newton iterations with line search; where that stalls, on with whole steps.

        The residual has kinks where points change between stick and slip or open and closed. On
        the far side of one the line search may find no decrease however short the step, while a
        few whole steps settle which side each point is on.
        """
        self.residuals = []
        iterations, reason = self._iterate()
        if reason <= 0 and self._near(KINKED):
            more, reason = self._settle()
            iterations += more
        if reason > 0 or not self._near():
            return iterations, reason
        self._whole_steps = True
        self._search("basic")
        more, reason = self._iterate()
        self._search(None)
        self._whole_steps = False
        return iterations + more, reason

    def _settle(self) -> tuple[int, int]:
        """Newton iterations in which points do not leave their facets for a neighbour at once.

        The normals of two facets differ, however little, and with them the forces. A point that
        belongs on the edge between them is pushed from each onto the other, for ever.
        """
        self.residuals = []
        self._settling = True
        free = self._step
        self._step = free.frozen(self.problem.contacts, self.problem.trials)
        iterations, reason = self._iterate()
        self._step = free
        self._settling = False
        return iterations, reason

    def _near(self, least: float = STALLED) -> bool:
        """Whether the last iteration came so near that the bodies touch where they will."""
        return bool(self.residuals and self.residuals[-1] <= least)

    def _approach(self, stages: Sequence[tuple[float, float]]) -> tuple[int, int]:
        """Solve with a soft contact first, and from there with the contact as it is.

        Where many points open or close at once, a stiff penalty makes Newton's method try one set
        of them after another; a soft one lets it find the region. Bodies that touch nowhere are
        found by contacts that pull as well.

        Args:
            stages: share of the penalties, and the gap up to which they pull in slave facets.
        """
        self._patient = True
        iterations = 0
        whole = self._step
        for scale, facets in (*stages, (1.0, 0.0)):
            self._step = whole.softened(self.problem.contacts, scale, facets)
            more, reason = self._solve()
            self._step = whole
            iterations += more
            if reason <= 0:
                break
        self._patient = False
        return iterations, reason

    def _iterate(self) -> tuple[int, int]:
        """Let SNES solve from the present trial; (iterations, converged reason).

        After a linear solve that failed it goes on once with a new preconditioner.
        """
        iterations = 0
        for _ in range(1 if self.solver.direct else 2):
            with self.problem.timer("linear solve"):  # the other parts take themselves out
                self.snes.solve(None, self.trial)
            iterations += self.snes.getIterationNumber()
            if self.solver.forget_failure():
                break
        return iterations, self.snes.getConvergedReason()

    def _search(self, kind: str | None) -> None:
        """Use a kind of line search; None: the one of the case."""
        self._petsc_options["snes_linesearch_type"] = kind or self._usual_search
        self.snes.setFromOptions()

    def commit(self) -> None:
        """Accept the last attempt: unknowns, contact history and predictor."""
        self.predictor.commit(self.x, self.trial)
        pressed = any(bool(trial.pressure.any()) for trial in self.problem.trials)
        self._touching = self.problem.comm.allreduce(pressed, op=MPI.LOR)
        self.trial.copy(self.x)
        self.problem.commit()
        self._largest_force = max(self._largest_force, self.problem.reference_force)

    def seconds(self) -> dict[str, float]:
        """Seconds of this rank so far in each part of the solution, from assembly to solve."""
        return dict(self.problem.timer.seconds)
