"""Notices bodies that float, held by weak springs (:mod:`tribox.app.implicit.weak_hold`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass

from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.implicit.stepper import StepResult
from tribox.app.simulation.history import Row
from tribox.app.simulation.observer import Interval
from tribox.app.simulation.time_text import time_text


@dataclass(slots=True)
class Floating:
    """The steps in which a body floated.

    Attributes:
        when: the first of them, in words; steps: their number.
        holding: largest force of the springs of a step over the largest force of the run till then.
    """

    when: str
    steps: int = 0
    holding: float = 0.0


class FloatingWatch:
    """Keeps which bodies floated, and what held them.

    Attributes:
        found: by name of the body.
    """

    def __init__(self) -> None:
        """Begin with none."""
        self.found: dict[str, Floating] = {}

    def step(self, row: Row, result: StepResult | Interval) -> None:
        """Look at a converged step."""
        if isinstance(result, Interval):
            return
        for body in result.floating:
            when = f"first at time {time_text(row.time, row.dt)}, stage {row.stage}"
            one = self.found.setdefault(body, Floating(when))
            one.steps += 1
            one.holding = max(one.holding, result.holding)

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        return {name: asdict(one) for name, one in self.found.items()}

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self.found = {name: Floating(**one) for name, one in kept.items()}

    def warnings(self) -> Iterator[str]:
        """A line for each body that floated."""
        for name, one in self.found.items():
            yield (
                f"body {name} floats in {one.steps} steps ({one.when}): no support and no contact "
                "force holds it; its place is where it was before, kept by weak springs with at "
                f"most {one.holding:.1e} of the largest force"
            )
