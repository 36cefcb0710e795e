"""What the material points of a body remember: committed values, and those of the last evaluation.

Newton's method, line search, predictor and approach phases evaluate in any order and often in vain.
An evaluation therefore starts from committed values alone, and is known by what it depends on: the
displacements, the duration of the step and the number of the committed values. Committing makes
its values those that the next step starts from; whatever else was evaluated leaves no trace.

Axis letters: k material points of the body's own cells, cell by cell; s values of a point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Origin:
    """From where material points are evaluated.

    Attributes:
        values: (k, s), committed; dt: s, duration of the step, infinite where rates do not count.
    """

    values: Floats
    dt: float


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Material points at one displacement.

    Attributes:
        u: (n,), m, local unknowns; origin: from where; number: of the committed values.
        stress: (k, p), Pa, first Piola–Kirchhoff stress; values: (k, s), what is remembered.
        elastic: (k,), J/m³, stored; dissipation: (k,), J/m³, since the origin; numerical: (k,) the
            part of it that belongs to the length of the step.
        valid: whether all points could be evaluated; where not, all but the values are NaN.
    """

    u: Floats
    origin: Origin
    number: int
    stress: Floats
    values: Floats
    elastic: Floats
    dissipation: Floats
    numerical: Floats
    valid: bool


@dataclass(frozen=True, slots=True)
class PointHistory:
    """What a body must be given to be again as it was after its last committed step.

    It has to be evaluated and committed again, at the displacements of that time.

    Attributes:
        origin: of the last committed step; None: there was none.
        dissipated: (2,), J, of this rank before that step, and the numerical part of it.
    """

    origin: Origin | None
    dissipated: Floats


class PointState:
    """Committed and trial values of the material points of one body.

    Attributes:
        committed: (k, s); number: how often they were committed.
        trial: the evaluation that a commit would take; None: none since the last commit.
        last: the evaluation committed last; None before.
    """

    def __init__(self, initial: Floats) -> None:
        """Begin with the ``initial`` values (k, s)."""
        self._initial = initial
        self.begin(initial)

    def begin(self, values: Floats | None) -> None:
        """Start from ``values`` (k, s), or from the initial ones, as if nothing had been."""
        self.committed = self._initial if values is None else values
        self.number = 0
        self.trial: Evaluation | None = None
        self.last: Evaluation | None = None

    def known(self, u: Floats, dt: float) -> Evaluation | None:
        """The trial, if it is that of the displacements ``u`` (n,), m, and ``dt`` (s)."""
        found = self.trial
        if found is None or found.number != self.number or found.origin.dt != dt:
            return None
        return found if np.array_equal(found.u, u) else None

    def at(self, u: Floats) -> Evaluation | None:
        """What was committed or tried last, if it was at the displacements ``u`` (n,), m."""
        for found in (self.last, self.trial):
            if found is not None and np.array_equal(found.u, u):
                return found
        return None

    def tangent_origin(self, u: Floats, dt: float) -> Origin:
        """From where the tangent at ``u`` (n,), m, of a step of ``dt`` (s) is taken.

        At the displacements of the last committed step all points that flowed in it are on the edge
        of their elastic range. Seen from there the tangent is elastic, and the step that it
        predicts far too stiff: the tangent is that of the step that led there.
        """
        if self.last is not None and np.array_equal(self.last.u, u):
            return self.last.origin
        return Origin(self.committed, dt)

    def commit(self) -> Evaluation | None:
        """Start from the trial's values from now on; what was committed, None if nothing was."""
        done = self.trial
        if done is None:
            return None
        self.committed, self.last, self.trial = done.values, done, None
        self.number += 1
        return done
