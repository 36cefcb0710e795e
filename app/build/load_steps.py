"""Load steps: the stretches of a stage with one velocity of the driven boundaries."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from tribox.app.case.case import Case
from tribox.app.case.stage import Stage
from tribox.app.case.time_tables import smooth_step, smooth_step_integral


@dataclass(frozen=True, slots=True)
class LoadStep:
    """A stretch of a stage with one velocity and one length of step.

    Attributes:
        stage: the stage it belongs to.
        velocity: m/s, of driven boundaries.
        dt: s, the step asked for; in explicit stages the interval between two rows.
        steps: number of such steps; None: until steady.
        before: m/s, velocity of driven boundaries when the load step begins.
    """

    stage: Stage
    velocity: float
    dt: float
    steps: int | None
    before: float = 0.0

    @property
    def label(self) -> str:
        """Name for messages and results."""
        return (
            f"{self.stage.name} {self.velocity:g} m/s" if self.stage.velocities else self.stage.name
        )

    def travel(self, time: float) -> float:
        """Displacement of driven boundaries after ``time`` (s) of the load step, m.

        The velocity goes from that before to the load step's own, smoothly within ``ramp``.
        """
        ramp = self.stage.ramp
        if ramp <= 0.0:
            return self.velocity * time
        eased = ramp * smooth_step_integral(time / ramp)
        return self.before * time + (self.velocity - self.before) * eased

    def speed(self, time: float) -> float:
        """Velocity of driven boundaries after ``time`` (s) of the load step, m/s."""
        ramp = self.stage.ramp
        if ramp <= 0.0:
            return self.velocity
        return self.before + (self.velocity - self.before) * smooth_step(time / ramp)


def load_steps_of(
    stage: Stage, film_conductance: float = 0.0, before: float = 0.0
) -> Iterator[LoadStep]:
    """The load steps of a stage: one for each velocity, or one for its duration.

    Args:
        film_conductance: largest eta_b/D, Pa s/m, for the limit on the film's stress.
        before: m/s, velocity of driven boundaries at the end of the stage before.
    """
    for velocity in stage.velocities_within(film_conductance):
        assert stage.slip_step is not None
        yield LoadStep(stage, velocity, stage.slip_step / abs(velocity), None, before)
        before = velocity
    if not stage.velocities:
        assert stage.duration is not None
        velocity = stage.velocity or 0.0
        yield LoadStep(stage, velocity, stage.duration / stage.steps, stage.steps, before)


def all_load_steps(case: Case) -> list[LoadStep]:
    """The load steps of all stages of a case, in order."""
    out: list[LoadStep] = []
    for stage in case.stage:
        before = out[-1].velocity if out else 0.0
        out += load_steps_of(stage, case.film_conductance, before)
    return out
