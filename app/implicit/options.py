"""Settings of the implicit stepper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tribox.app.implicit.linear_solver import Linear


@dataclass(frozen=True, slots=True)
class ImplicitOptions:
    """Settings of the Newton iteration.

    Attributes:
        tolerance: residual norm allowed, relative to the contact or reaction force.
        max_iterations: Newton iterations before an attempt counts as failed; a step may make
            several.
        linear: the linear solver; "auto" is direct up to a number of unknowns, and where iterations
            take longer.
        petsc: further PETSc options, without prefix.
    """

    tolerance: float = 1e-8
    max_iterations: int = 25
    linear: Linear = "auto"
    petsc: Mapping[str, str | float | bool] = field(default_factory=dict)
