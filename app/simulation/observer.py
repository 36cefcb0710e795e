"""What wants to know of a run while it goes on."""

from __future__ import annotations

from dataclasses import dataclass

from tribox.app.build.load_steps import LoadStep
from tribox.app.implicit.stepper import StepResult
from tribox.app.simulation.history import Row
from tribox.app.simulation.run_state import RunState


@dataclass(frozen=True, slots=True)
class Interval:
    """How an explicit run got from one row to the next.

    Attributes:
        steps: time steps; dt: s, of the last of them; stable: s, stable step at the end.
        total: time steps of the run so far.
        kinetic_ratio: kinetic over strain energy at the end; 0 without strain energy.
        failed: whether the run ends within it, without the row.
    """

    steps: int
    dt: float
    stable: float
    total: int
    kinetic_ratio: float
    failed: bool = False


class Observer:
    """What wants to know of a run; the default does nothing."""

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """A step has converged and is committed, or an explicit interval is over; collective."""

    def ready(self, state: RunState) -> None:
        """All of the last step has been told, and another is about to begin; collective.

        A run can be stopped here, and gone on with later. Explicit runs come by between two rows
        too.
        """

    def within(self, state: RunState, load_step: LoadStep, steps: int) -> None:
        """Called now and then between two rows of an explicit run, after ``steps``; collective."""

    def load_step(
        self, state: RunState, load_step: LoadStep, row: Row, steady: bool | None
    ) -> None:
        """A load step has ended; ``steady`` is None where nobody asked for it; collective."""

    def attempt(
        self, state: RunState, load_step: LoadStep, dt: float, result: StepResult | Interval
    ) -> None:
        """A step or interval of ``dt`` (s) has been tried; what comes of it follows; collective.

        The time of the state is that before a step, and that at the end of an interval.
        """

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """A step of ``dt`` (s) has failed and is tried again shorter; collective."""
