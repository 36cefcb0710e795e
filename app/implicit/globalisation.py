"""What is tried to solve a step, one phase after the other until one converges.

The first phase starts from the prediction. Those after it start elsewhere, or approach the solution
through softer contacts: where many points open or close at once, a stiff penalty makes Newton's
method try one set of them after another, while a soft one lets it find the region. Bodies that a
load presses on each other are held by springs meanwhile (:mod:`tribox.app.implicit.approach`);
others that touch nowhere find each other by contacts that pull as well.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.implicit.approach import HeldApproach, is_adrift, strays
from tribox.app.implicit.attempt import Attempt, Phase
from tribox.app.implicit.interior_point import FromInside


@dataclass(frozen=True, slots=True)
class PredictedStart:
    """Newton's method from the predicted start.

    Attributes:
        if_near: whether it is tried only where the prediction leaves little, or, where bodies
            flow and rub, not much, as long as each iteration gains.
    """

    if_near: bool = False

    def run(self, attempt: Attempt) -> tuple[int, int]:
        """See :class:`Phase`."""
        if is_adrift(attempt):
            attempt.start = attempt.trial.array_r.copy()
            return 0, PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH
        started = attempt.predictor.predict(attempt.x, attempt.trial, attempt.step)
        attempt.newton.on_path = started == 0
        attempt.start = attempt.trial.array_r.copy()
        failed = PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH
        if strays(attempt):
            return started, failed
        newton, eager = attempt.newton, False
        if self.if_near:
            left = newton.residual_of(attempt.step)
            eager = left > FAR
            sliding = newton.problem.flows and attempt.predictor.rubbing()
            if left > (NEARLY if sliding else FAR):
                return started, failed
        more, reason = newton.solve(
            attempt.step,
            patient=not attempt.has_contacts,
            hasty=attempt.has_contacts and not attempt.predictor.rubbing(),
            eager=eager,
        )
        return started + more, reason


@dataclass(frozen=True, slots=True)
class LinearStart:
    """Newton's method from the linear step, whatever the path was."""

    def run(self, attempt: Attempt) -> tuple[int, int]:
        """See :class:`Phase`."""
        started = attempt.predictor.restart(attempt.x, attempt.trial, attempt.step)
        more, reason = attempt.newton.solve(attempt.step, patient=True)
        return started + more, reason


@dataclass(frozen=True, slots=True)
class Softness:
    """Changes of the contacts that ease a solution.

    Attributes:
        penalty_scale: factor of the penalties.
        adhesive_facets: gap up to which contacts pull, in lengths of a slave facet.
    """

    penalty_scale: float
    adhesive_facets: float = 0.0


@dataclass(frozen=True, slots=True)
class SoftContact:
    """Newton's method with soft contacts first, and from there with the contacts as they are.

    Attributes:
        stages: the soft contacts, one after the other.
        from_last_state: whether it starts from the last converged state with the prescribed
            values put in, and not from the prediction.
    """

    stages: tuple[Softness, ...]
    from_last_state: bool = False

    def run(self, attempt: Attempt) -> tuple[int, int]:
        """See :class:`Phase`."""
        problem = attempt.newton.problem
        attempt.return_to_start()
        if self.from_last_state:
            attempt.trial.array[:] = problem.constrained_values(attempt.x)
        iterations, reason = 0, 0
        for stage in (*self.stages, Softness(1.0)):
            soft = attempt.step.with_penalty_scale(
                problem.contacts, stage.penalty_scale, stage.adhesive_facets
            )
            more, reason = attempt.newton.solve(soft, patient=True)
            iterations += more
            if reason <= 0:
                break
        return iterations, reason


FAR = 1e-2  # relative residual of a prediction from which on contacts change much
NEARLY = 0.3  # the same of bodies that flow and rub, where a few iterations show whether it is

APPROACH = SoftContact((Softness(0.03),))
SEARCH = SoftContact(
    (Softness(1e-3, adhesive_facets=2.0), Softness(1e-3), Softness(0.03)), from_last_state=True
)


def phases_after(attempt: Attempt, inside: FromInside) -> tuple[Phase, ...]:
    """What is tried after the predicted start has failed, among it a way from ``inside``.

    Where a body floats, on which nothing presses, nothing is found from inside. Where pressed
    bodies rub, a shorter step is better if the iteration came near, and softer contacts are tried
    sooner. Bodies that forces alone bring together find each other sooner by springs.
    """
    if not attempt.has_contacts:
        return (LinearStart(),)
    near = attempt.newton.is_near()
    held = (HeldApproach(),) if attempt.bodies.directions else ()
    floats = attempt.step.holding is not None
    if near:
        rubs = floats or (attempt.pressed and attempt.predictor.rubbing())
        return () if rubs else (inside,)
    if floats:
        return (*held, APPROACH)
    elastic = not attempt.newton.problem.flows
    if elastic and attempt.pressed and attempt.predictor.rubbing() and is_moved(attempt):
        return (*held, APPROACH, inside)
    if attempt.pressed:
        return (inside, APPROACH, *held)
    found = (inside, *held) if is_moved(attempt) else (*held, inside)
    return (*found, APPROACH, SEARCH)


def is_moved(attempt: Attempt) -> bool:
    """Whether a prescribed displacement changes in the step: not forces alone drive; collective."""
    problem = attempt.newton.problem
    moved = not np.array_equal(problem.constrained_values(attempt.x), attempt.x.array_r)
    return bool(problem.comm.allreduce(moved, op=MPI.LOR))


def solve(attempt: Attempt) -> tuple[int, int]:
    """Solve a step by the phases in turn; iterations and PETSc's converged reason; collective.

    After a step that was found from inside the next one begins there, unless its prediction is
    near.
    """
    first: tuple[Phase, ...] = (PredictedStart(),)
    # A body that floats stays where it is: pressures from inside would push it away.
    began_inside = attempt.newton.inside.last and attempt.step.holding is None
    if began_inside:
        first = (PredictedStart(if_near=True), FromInside("last"), *first)
    iterations, reason = _in_turn(attempt, first)
    if reason <= 0:
        inside = FromInside("others" if began_inside else "all")
        rest = [phase for phase in phases_after(attempt, inside) if phase not in first]
        attempt.return_to_start()
        more, reason = _in_turn(attempt, rest)
        iterations += more
    return iterations, reason


def _in_turn(attempt: Attempt, phases: Iterable[Phase]) -> tuple[int, int]:
    iterations, reason = 0, int(PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH)
    for phase in phases:
        attempt.newton.begin(attempt.x)
        more, reason = phase.run(attempt)
        iterations += more
        attempt.newton.inside.last = reason > 0 and isinstance(phase, FromInside)
        if reason > 0:
            break
    return iterations, reason
