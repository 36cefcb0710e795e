"""A step that is being tried, and what a way to solve it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from petsc4py import PETSc

from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit.loose_bodies import LooseBodies
from tribox.app.implicit.newton import Newton
from tribox.app.implicit.predictor import Predictor
from tribox.geometry.surfaces.facets import Floats


@dataclass(slots=True)
class Attempt:
    """A step that is being tried.

    Attributes:
        newton: whose ``trial`` becomes the solution; predictor: finds starts.
        x: the last converged unknowns.
        step: duration and contact modes, as they are committed.
        pressed: whether anything pressed at the last converged state.
        bodies: those that contact alone holds.
        start: (n,), m, the predicted start of the owned unknowns.
    """

    newton: Newton
    predictor: Predictor
    x: PETSc.Vec
    step: StepMode
    pressed: bool
    bodies: LooseBodies
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
