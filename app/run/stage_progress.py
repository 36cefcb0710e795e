"""How far a run has come within its stages, by what it tells while it goes on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from tribox.app.case.case import Case
from tribox.app.case.stage import Stage
from tribox.app.simulation.history import time_text


@dataclass(slots=True)
class StageProgress:
    """How far one stage has come.

    Attributes:
        stage: the stage; number: from 1.
        velocities: m/s, of its load steps; none if it has a duration.
        began: s, time of the run at its start; started: s, of the clock.
        time: s, of the run; dt: s, of the last step.
        done: load steps done; turned: s, time of the run at the start of the one at hand.
        cuts: steps cut so far.
        ended: s, of the clock; None before.
        before: share that was done when a run was gone on with.
    """

    stage: Stage
    number: int
    velocities: tuple[float, ...]
    began: float
    started: float
    time: float
    turned: float
    dt: float = 0.0
    done: int = 0
    cuts: int = 0
    ended: float | None = None
    before: float = 0.0

    @property
    def load_steps(self) -> int:
        """Number of load steps."""
        return max(1, len(self.velocities))

    @property
    def steps(self) -> float:
        """Steps at the velocity at hand; 0 in a stage that has a duration."""
        if self.done >= len(self.velocities) or self.stage.slip_step is None:
            return 0.0
        return (self.time - self.turned) * abs(self.velocities[self.done]) / self.stage.slip_step

    @property
    def share(self) -> float:
        """Share of the stage that is done, from 0 to 1; until steady, at least so much."""
        if self.done >= self.load_steps:
            return 1.0
        if self.stage.duration is not None:
            return min(max((self.time - self.began) / self.stage.duration, 0.0), 1.0)
        return (self.done + min(self.steps / self.stage.max_steps, 1.0)) / self.load_steps

    def seconds_left(self, now: float) -> float | None:
        """Seconds of the clock that the rest takes at the pace so far; None at the start.

        Until steady it is the most it can be.
        """
        share = self.share
        made = share - self.before
        return (now - self.started) * (1.0 - share) / made if made > 0.0 else None

    def place(self) -> str:
        """Where the stage is: its own time, or its load step and the steps at this velocity."""
        if self.stage.duration is not None:
            own = time_text(self.time - self.began, self.dt).removesuffix(" s")
            return f"{own}/{self.stage.duration:g} s"
        if self.done >= self.load_steps:
            return f"{self.load_steps} load steps"
        return (
            f"load step {self.done + 1}/{self.load_steps}, "
            f"step {self.steps:.0f}/{self.stage.max_steps}"
        )

    def time_left(self, now: float) -> str:
        """The time left in words, or the time taken by a stage that is done."""
        if self.before == 1.0:
            return "done before"
        if self.ended is not None:
            return f"done in {clock(self.ended - self.started)}"
        left = self.seconds_left(now)
        if left is None:
            return ""
        most = "" if self.stage.duration is not None else "at most "
        return f"{most}{clock(left)} left"


class StagesProgress:
    """The stages of a run, one after the other.

    Attributes:
        begun: progress of the stages begun so far; the last is the one at hand.
        now: the clock, s.
    """

    def __init__(self, case: Case, now: Callable[[], float] = time.monotonic) -> None:
        """Begin with the first stage.

        Args:
            case: that is run.
            now: the clock, s.
        """
        self._stages = case.stage
        self._conductance = case.film_conductance
        self.now = now
        self.begun: list[StageProgress] = []
        self._begin(0.0)

    @property
    def here(self) -> StageProgress:
        """The stage at hand, or the last of all."""
        return self.begun[-1]

    @property
    def count(self) -> int:
        """Number of stages, those to come included."""
        return len(self._stages)

    def at(self, time: float, dt: float) -> StageProgress:
        """The run has come to ``time`` (s), by a step of ``dt`` (s)."""
        here = self.here
        here.time, here.dt = time, dt
        return here

    def end_load_step(self) -> None:
        """A load step of the stage at hand has ended, and perhaps the stage."""
        here = self.here
        here.done, here.turned = here.done + 1, here.time
        if here.done == here.load_steps:
            here.ended = self.now()
            if len(self.begun) < self.count:
                self._begin(here.time)

    def go_on(self, ends: Iterable[tuple[float, float]], time: float, dt: float) -> None:
        """A run goes on that had come somewhere.

        Args:
            ends: s, time and last step of each load step that had ended.
            time: s, to which it had come; dt: s, its last step.
            dt: see time.
        """
        for end in ends:
            self.at(*end)
            self.end_load_step()
        self.at(time, dt)
        for one in self.begun:
            one.before = one.share

    def _begin(self, time: float) -> None:
        stage = self._stages[len(self.begun)]
        velocities = stage.velocities_within(self._conductance)
        number = len(self.begun) + 1
        self.begun.append(
            StageProgress(stage, number, velocities, time, self.now(), time=time, turned=time)
        )


def clock(seconds: float) -> str:
    """A duration as 0:05 or 1:02:03."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
