"""A way to an equilibrium far from the last one: springs at all nodes, that give way.

Springs hold all nodes, without force at the state reached so far. Each stage finds the equilibrium
with them, coarsely, and that is the next state. Their stiffness follows the forces that they carry:
where a path of equilibria ends and the bodies snap these grow, and the way of a stage remains
small; near the next equilibrium they vanish, and the springs with them (pseudo-transient
continuation with switched evolution relaxation: C. T. Kelley, D. E. Keyes, Convergence analysis of
pseudo-transient continuation, SIAM J. Numer. Anal. 35, 1998; a proximal-point method). All stages
start from the committed history and commit nothing; what is committed is solved without springs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.step_mode import HoldingSprings
from tribox.app.implicit.interior_point import shortest_facet
from tribox.app.implicit.loose_bodies import nodal_shares
from tribox.app.implicit.predictor import Attempt, Phase
from tribox.geometry.surfaces.facets import Floats

FIRST = 0.1  # way of the first stage, about, in lengths of a slave facet
SOFTER, STIFFER = 1.5, 4.0  # the springs after a stage that was solved, and after one that failed
FOLLOWS = 3.0  # most that the stiffness follows the force from a stage to the next
WAITS, LONGEST = 2, 8  # stages after a failure before springs get softer; they double up to that
COARSE, LIMIT = 1e-3, 12  # relative residual of a stage, and its iterations
NEAR, NEARER = 1e-5, 0.3  # force of the springs to go on without them, and that after a failure
FAILURES = 12  # most stages that fail
ITERATIONS = 12  # most iterations of all stages, over those of an attempt


@dataclass(frozen=True, slots=True)
class Relaxation(Phase):
    """Newton's method with springs at all nodes, that move with the bodies and give way."""

    def run(self, attempt: Attempt) -> tuple[int, int]:
        newton, trial = attempt.newton, attempt.trial
        failed = int(PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH)
        left, strayed = trial.array_r.copy(), newton.strayed
        attempt.return_to_start()
        if not np.isfinite(newton.residual_of(attempt.step)):
            trial.array[:] = newton.problem.constrained_values(attempt.x)
        if not np.isfinite(newton.residual_of(attempt.step)):
            return 0, failed
        pace = Pace(start_stiffness(attempt))
        shares, place = spring_shares(attempt), trial.array_r.copy()
        iterations, near = 0, NEAR
        while pace.failures < FAILURES and iterations < ITERATIONS * newton.options.max_iterations:
            springs = HoldingSprings(pace.stiffness * shares, place)
            trial.array[:] = place
            newton.begin(trial)
            more, reason = newton.search(attempt.step.held(springs), COARSE, LIMIT)
            iterations += more
            if reason <= 0:
                pace.fail()
                continue
            carried = carried_by(springs, attempt)
            place = trial.array_r.copy()
            pace.follow(carried)
            if carried > near:
                continue
            newton.begin(trial)
            more, reason = newton.search(attempt.step, newton.options.tolerance, LIMIT)
            iterations += more
            if reason > 0:
                attempt.relaxed = True
                return iterations, reason
            pace.failures += 1
            near = NEARER * carried
        trial.array[:] = left  # what failed before springs held it says more of why
        newton.residuals, newton.strayed = [newton.residual_of(attempt.step)], strayed
        return iterations, failed


@dataclass(slots=True)
class Pace:
    """How stiff the springs are."""

    stiffness: float  # N/m, of all springs of a body
    carried: float = 0.0  # force of the last stage that was solved, over the reference; 0: none was
    failures: int = 0  # stages that failed
    waits: int = 0  # stages before springs get softer again
    patience: int = WAITS  # these after the next failure

    def follow(self, carried: float) -> None:
        """Take note of a stage that was solved."""
        ratio = carried / self.carried if self.carried else 1.0
        self.stiffness *= min(max(ratio, 1.0 / FOLLOWS), FOLLOWS)
        self.carried = carried
        if self.waits:
            self.waits -= 1
        else:
            self.stiffness /= SOFTER

    def fail(self) -> None:
        """Take note of a stage without a solution."""
        self.failures += 1
        self.stiffness *= STIFFER
        if self.carried:  # before, it is only the first stiffness that is being found
            self.waits, self.patience = self.patience, min(2 * self.patience, LONGEST)


def start_stiffness(attempt: Attempt) -> float:
    """Of springs that the forces at the start stretch by a part of a facet, N/m; collective."""
    problem = attempt.newton.problem
    share = min(attempt.newton.residual_of(attempt.step), 1.0)
    return share * problem.reference_force / (FIRST * shortest_facet(problem))


def spring_shares(attempt: Attempt) -> Floats:
    """Share (n,) of each owned unknown in the springs of its body; none of what is prescribed."""
    problem = attempt.newton.problem
    nodal = np.repeat(nodal_shares(problem), problem.dim)
    shares = np.zeros(problem.owned)
    shares[: len(nodal)] = nodal
    shares[problem.constrained_dofs()] = 0.0
    return shares


def carried_by(springs: HoldingSprings, attempt: Attempt) -> float:
    """Norm of the springs' forces at the trial over the reference force; collective."""
    problem, force = attempt.newton.problem, springs.force(attempt.trial.array_r)
    squared = problem.comm.allreduce(float(force @ force), op=MPI.SUM)
    return float(np.sqrt(squared)) / max(problem.reference_force, problem.roundoff)
