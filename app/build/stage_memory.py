"""What boundaries remember of the state that a stage begins with: forces reached, and places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from tribox.app.case.time_tables import TimeTable
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.nodal_load import NodalLoad
from tribox.app.equilibrium.prescribed import Platen, Prescribed
from tribox.app.equilibrium.snapshot import Snapshot, scattered
from tribox.geometry.surfaces.facets import Floats

Acts = Callable[[str], bool]
"""Whether something acts in the stage of this name."""


@dataclass(frozen=True, slots=True)
class StageChange:
    """One stage gives way to another.

    Attributes:
        before, now: their names; "" before the first one.
        time: s, of the change.
        problem: at the last converged state, evaluated with what acted before.
    """

    before: str
    now: str
    time: float
    problem: Equilibrium


class Remembering(Protocol):
    """What has to be told of a new stage."""

    def begin(self, change: StageChange) -> None:
        """Take note of the state that a stage begins with; collective."""

    def snapshot(self, owned: int) -> Snapshot:
        """All that is remembered; ``owned`` is the number of unknowns of this rank."""

    def restore(self, kept: Snapshot) -> None:
        """Remember what :meth:`snapshot` has seen."""


@dataclass(slots=True)
class ReachedForce:
    """The force that the displacement of a platen, or of a tool's component, has led to.

    Attributes:
        part: what is moved; stages: in which its displacement is given.
        force: N (per unit thickness), along its direction, at the end of the last of them; None
            before.
    """

    part: Platen | Prescribed
    stages: tuple[str, ...]
    force: float | None = None

    def begin(self, change: StageChange) -> None:
        """See :class:`Remembering`."""
        if change.before in self.stages and change.now not in self.stages:
            self.force = change.problem.reaction(self.part)

    def snapshot(self, owned: int) -> Snapshot:
        """See :class:`Remembering`."""
        return {"force": self.force}

    def restore(self, kept: Snapshot) -> None:
        """See :class:`Remembering`."""
        self.force = kept["force"]


@dataclass(slots=True)
class MovedOn:
    """Displacements that a velocity moves on from where they are when it begins to act.

    Attributes:
        part: what is prescribed; speed: m/s, over time; acts: in which stages.
        start: (c,), m, displacements when it began to act; time: s, when that was.
    """

    part: Prescribed
    speed: TimeTable
    acts: Acts
    start: Floats = field(init=False)
    time: float = 0.0

    def __post_init__(self) -> None:
        """Begin undeformed."""
        self.start = np.zeros(len(self.part.dofs))

    def value(self, time: float, driven: float) -> Floats:
        """Displacements (c,), m, at ``time`` (s)."""
        return self.start + (self.speed.integral(time) - self.speed.integral(self.time))

    def begin(self, change: StageChange) -> None:
        """See :class:`Remembering`."""
        if self.acts(change.now) and not (change.before and self.acts(change.before)):
            self.start = change.problem.u.x.array[self.part.dofs].copy()
            self.time = change.time

    def snapshot(self, owned: int) -> Snapshot:
        """See :class:`Remembering`."""
        return {"start": scattered(self.part.dofs, self.start, owned), "time": self.time}

    def restore(self, kept: Snapshot) -> None:
        """See :class:`Remembering`."""
        self.start, self.time = kept["start"][self.part.dofs], kept["time"]


@dataclass(slots=True)
class Released:
    """Forces that are given up, of what held a surface or of a contact, taken off over a stage.

    Attributes:
        load: forces at its unknowns, those at the start of the stage for a factor of one.
        stage: its name; duration: s.
        given_up: forces (n,), N per unit thickness, on the owned unknowns that are given up;
            collective.
        time: s, when it began.
    """

    load: NodalLoad
    stage: str
    duration: float
    given_up: Callable[[Equilibrium], Floats]
    time: float = 0.0

    def factor(self, stage: str, time: float) -> float:
        """Share of the forces that acts at ``time`` (s) of a stage."""
        if stage != self.stage:
            return 0.0
        return min(max(1.0 - (time - self.time) / self.duration, 0.0), 1.0)

    def begin(self, change: StageChange) -> None:
        """See :class:`Remembering`."""
        if change.now == self.stage:
            self.load.shares = self.given_up(change.problem)[self.load.dofs]
            self.time = change.time

    def snapshot(self, owned: int) -> Snapshot:
        """See :class:`Remembering`."""
        return {"reactions": scattered(self.load.dofs, self.load.shares, owned), "time": self.time}

    def restore(self, kept: Snapshot) -> None:
        """See :class:`Remembering`."""
        self.load.shares, self.time = kept["reactions"][self.load.dofs], kept["time"]
