"""What is tried to solve a step, one phase after the other until one converges.

The first phase starts from the prediction. Those after it start elsewhere, or approach the solution
through softer contacts: where many points open or close at once, a stiff penalty makes Newton's
method try one set of them after another, while a soft one lets it find the region. Bodies that
touch nowhere find each other by contacts that pull as well.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from petsc4py import PETSc

from app.equilibrium.step_mode import StepMode
from app.implicit.newton import Newton
from app.implicit.predictor import Predictor
from geometry.surfaces.facets import Floats


@dataclass(slots=True)
class Attempt:
    """A step that is being tried.

    Attributes:
        newton: whose ``trial`` becomes the solution; predictor: finds starts.
        x: the last converged unknowns.
        step: duration and contact modes, as they are committed.
        pressed: whether anything pressed at the last converged state.
        start: (n,), m, the predicted start of the owned unknowns.
    """

    newton: Newton
    predictor: Predictor
    x: PETSc.Vec
    step: StepMode
    pressed: bool
    start: Floats = field(default_factory=lambda: np.empty(0))

    @property
    def trial(self) -> PETSc.Vec:
        """The unknowns that are iterated."""
        return self.newton.trial

    @property
    def has_contacts(self) -> bool:
        """Whether there is a contact that could be made softer."""
        return bool(self.newton.problem.contacts)

    def return_to_start(self) -> None:
        """Put the predicted start back."""
        self.trial.array[:] = self.start


class Phase(Protocol):
    """One way to solve a step."""

    def run(self, attempt: Attempt) -> tuple[int, int]:
        """Solve from a start of its own; iterations and PETSc's converged reason; collective."""
        ...


@dataclass(frozen=True, slots=True)
class PredictedStart:
    """Newton's method from the predicted start."""

    def run(self, attempt: Attempt) -> tuple[int, int]:
        """See :class:`Phase`."""
        started = attempt.predictor.predict(attempt.x, attempt.trial, attempt.step)
        attempt.start = attempt.trial.array_r.copy()
        more, reason = attempt.newton.solve(attempt.step, patient=not attempt.has_contacts)
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


APPROACH = SoftContact((Softness(0.03),))
SEARCH = SoftContact(
    (Softness(1e-3, adhesive_facets=2.0), Softness(1e-3), Softness(0.03)), from_last_state=True
)


def phases_after(attempt: Attempt) -> tuple[Phase, ...]:
    """What is tried after the predicted start has failed.

    Where the iteration came near, the bodies touch where they will: a shorter step is better.
    """
    if not attempt.has_contacts:
        return (LinearStart(),)
    if attempt.newton.is_near():
        return ()
    return (APPROACH,) if attempt.pressed else (APPROACH, SEARCH)


def solve(attempt: Attempt) -> tuple[int, int]:
    """Solve a step by the phases in turn; iterations and PETSc's converged reason; collective."""
    iterations, reason = PredictedStart().run(attempt)
    if reason > 0:
        return iterations, reason
    phases = phases_after(attempt)
    attempt.return_to_start()
    for phase in phases:
        more, reason = phase.run(attempt)
        iterations += more
        if reason > 0:
            break
    return iterations, reason
