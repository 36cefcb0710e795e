"""Material points: a friction law stepped through given slip, pressure and film, without bodies.

Axis letters: n steps, q points; the slip is along one line, so its vectors have one component.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import FrictionLaw, FrictionResponse

Floats = NDArray[np.float64]

FIRST_SLIP = 1e-9
"""m, first step on the way to steady sliding: short against any pre-sliding length."""
GROWTH = 1.4
"""Ratio of a step to the one before, on the way to steady sliding."""
STEPS_IN_A_ROW = 3
"""Steps over which the traction must not change any more."""


@dataclass(frozen=True, slots=True)
class Phase:
    """Part of a program: equal steps at given speeds.

    Attributes:
        name: What the points do, such as "rest".
        duration: s, > 0.
        steps: Number of equal steps.
        speed: (q,) or a number, m/s, slip speed; its sign is the direction.
        pressure: (q,) or a number, Pa, contact pressure, 0 is open.
        film: (q,) or a number, m, film thickness.
        rate_dependent: Whether time counts; without, slip is all that matters.
    """

    name: str
    duration: float
    steps: int
    speed: ArrayLike
    pressure: ArrayLike
    film: ArrayLike
    rate_dependent: bool = True


@dataclass(frozen=True, slots=True)
class Track:
    """What the points went through, one row per step.

    Attributes:
        phase: (n,), name of the phase.
        time: (n,), s, at the end of the step.
        slip: (n, q), m, sum of all slip increments.
        speed: (n, q), m/s.
        traction: (n, q), Pa, in the direction of positive slip.
        slip_path: (n, q), m, length of the permanent slip.
        alpha: (n, q), film fraction.
        mu: (n, q), coefficient of friction at the slip path reached.
        regime: (n, q), codes of ``tribox.forms.friction.law.Regime``.
        dissipated: (n, q), J/m^2 in the step.
    """

    phase: tuple[str, ...]
    time: Floats
    slip: Floats
    speed: Floats
    traction: Floats
    slip_path: Floats
    alpha: Floats
    mu: Floats
    regime: NDArray[np.int8]
    dissipated: Floats


@dataclass(frozen=True, slots=True)
class Program:
    """Points that go through the same phases.

    Attributes:
        phases: One after the other.
        points: Number q of points; what a phase gives as a number holds for all of them.
    """

    phases: Sequence[Phase]
    points: int

    def steps(self, value: Callable[[Phase], ArrayLike]) -> Floats:
        """What each phase says of its points, at each step, (n, q)."""
        parts = [
            np.broadcast_to(np.asarray(value(phase), dtype=np.float64), (phase.steps, self.points))
            for phase in self.phases
        ]
        return np.concatenate(parts)


def follow(law: FrictionLaw, phases: Sequence[Phase], points: int) -> Track:
    """Step a law through phases from a state without history; see :func:`follow_all`."""
    (track,) = follow_all(law, [Program(phases, points)])
    return track


def follow_all(law: Any, programs: Sequence[Program]) -> tuple[Track, ...]:
    """Step a law through programs, all points of all of them side by side.

    Programs with steps of different length need a law that takes a ``dt`` (q,), as the friction
    map does. A program that ends before the others has its last step repeated, which nobody sees.

    Args:
        law: The law.
        programs: Each from a state without history; all phases alike in ``rate_dependent``.

    Raises:
        ValueError: An array of a phase does not fit its points, or the phases are not alike.
    """
    phases = [phase for program in programs for phase in program.phases]
    rate_dependent = phases[0].rate_dependent
    if any(phase.rate_dependent != rate_dependent for phase in phases):
        raise ValueError("time counts in all phases or in none")
    dt, speed, pressure, film = (
        _side_by_side([program.steps(value) for program in programs])
        for value in (
            lambda phase: phase.duration / phase.steps,
            lambda phase: phase.speed,
            lambda phase: phase.pressure,
            lambda phase: phase.film,
        )
    )
    state = law.initial_state(dt.shape[1], 1)
    columns: list[tuple[NDArray[np.generic], ...]] = []
    for n in range(len(dt)):
        step = float(dt[n, 0]) if len(programs) == 1 else dt[n]
        response = law.update(
            (speed[n] * step)[:, None], step, pressure[n], film[n], state,
            rate_dependent=rate_dependent,
        )  # fmt: skip
        state = response.state
        columns.append((
            speed[n] * step, speed[n], response.traction[:, 0], state.slip_path, state.alpha,
            law.coefficient(state), response.regime, response.dissipation.total,
        ))  # fmt: skip
    table = [np.array(column) for column in zip(*columns, strict=True)]
    return tuple(_tracks(programs, dt, table))


def _side_by_side(parts: Sequence[Floats]) -> Floats:
    """Tables (n, q) of different length in one, the last row of each repeated to the end."""
    longest = max(len(part) for part in parts)
    ends = [np.pad(part, ((0, longest - len(part)), (0, 0)), mode="edge") for part in parts]
    return np.concatenate(ends, axis=1)


def _tracks(programs: Sequence[Program], dt: Floats, table: Sequence[Any]) -> Iterator[Track]:
    """What the points of each program went through."""
    first = 0
    for program in programs:
        names = tuple(phase.name for phase in program.phases for _ in range(phase.steps))
        own = slice(0, len(names)), slice(first, first + program.points)
        slip, *others = (column[own] for column in table)
        yield Track(names, np.cumsum(dt[own][:, 0]), np.cumsum(slip, axis=0), *others)
        first += program.points


@dataclass(frozen=True, slots=True)
class Steady:
    """Steady sliding of q points at one speed, or at v of them.

    Attributes:
        traction: (q,) or (v, q), Pa.
        mu: Likewise, coefficient of friction at the slip reached.
        alpha: Likewise, film fraction.
        regime: Likewise, codes of ``tribox.forms.friction.law.Regime``.
        slip: A number or (v,), m, distance slid until all points were steady (or given up).
        steady: Like the traction, whether it had stopped changing.
    """

    traction: Floats
    mu: Floats
    alpha: Floats
    regime: NDArray[np.int8]
    slip: float | Floats
    steady: NDArray[np.bool_]


def slide_to_steady(
    law: FrictionLaw,
    speed: float,
    pressure: Floats,
    film: Floats,
    *,
    tolerance: float = 1e-6,
    least_slip: float = 1e-3,
    most_slip: float = 100.0,
) -> Steady:
    """Slide points at one speed, in growing steps, until their traction stays the same.

    A point is steady when its traction has changed by less than the tolerance in each of the last
    steps, each longer than the one before by a fixed ratio: a slow creep towards the end value
    does not pass for steady.

    Args:
        law: The law.
        speed: m/s, > 0.
        pressure: (q,), Pa.
        film: (q,), m.
        tolerance: Largest relative change of the traction in one step.
        least_slip: m, distance to slide at least; it must exceed the law's pre-sliding length.
        most_slip: m, distance after which the points count as not steady.
    """
    slide = _Slide(law, np.array([speed]), pressure, film, tolerance)
    slide.run(least_slip, most_slip)
    found = slide.found
    return Steady(
        found.traction[0], found.mu[0], found.alpha[0], found.regime[0],
        float(np.max(found.slip)), found.steady[0],
    )  # fmt: skip


def slide_at_speeds(
    law: FrictionMap,
    speeds: Floats,
    pressure: Floats,
    film: Floats,
    *,
    tolerance: float = 1e-6,
    least_slip: float = 1e-3,
    most_slip: float = 100.0,
) -> Steady:
    """As :func:`slide_to_steady` for each of several speeds (v,), m/s, all of them side by side.

    Their steps are of the same slip, so of different length in time; the friction map takes that.
    """
    slide = _Slide(law, speeds, pressure, film, tolerance)
    slide.run(least_slip, most_slip)
    return slide.found


class _Slide:
    """Points (v, q) that slide in growing steps, q of them at each of v speeds.

    Attributes:
        found: What the points of each speed were like when they were last looked at.
    """

    def __init__(
        self, law: Any, speeds: Floats, pressure: Floats, film: Floats, tolerance: float
    ) -> None:
        shape = len(speeds), len(film)
        self._law, self._shape, self._tolerance = law, shape, tolerance
        # A single speed has a step of one length in time, which any law takes.
        self._speed = np.repeat(speeds, len(film)) if len(speeds) > 1 else float(speeds[0])
        self._pressure, self._film = np.tile(pressure, len(speeds)), np.tile(film, len(speeds))
        self._running: NDArray[np.bool_] = np.ones(len(speeds), dtype=np.bool_)
        self._slip: Floats = np.zeros(len(speeds))  # of ``found``
        zeros: Floats = np.zeros(shape)
        self.found = Steady(
            zeros, zeros.copy(), zeros.copy(), np.zeros(shape, dtype=np.int8),
            self._slip, np.zeros(shape, dtype=np.bool_),
        )  # fmt: skip

    def run(self, least_slip: float, most_slip: float) -> None:
        """Slide until the points of every speed are steady or have gone too far."""
        state = self._law.initial_state(len(self._film), 1)
        step, slid = FIRST_SLIP, 0.0
        before: Floats = np.zeros(len(self._film))
        calm: NDArray[np.int64] = np.zeros(len(self._film), dtype=np.int64)
        while self._running.any():
            slip = np.full((len(self._film), 1), step)
            response = self._law.update(slip, step / self._speed, self._pressure, self._film, state)
            state, traction = response.state, response.traction[:, 0]
            slid += step
            change = np.abs(traction - before) <= self._tolerance * np.abs(traction)
            calm = np.where(change, calm + 1, 0)
            self._look(response, slid, calm >= STEPS_IN_A_ROW)
            if slid > least_slip:
                self._running &= ~self.found.steady.all(axis=1)
            if slid > most_slip:
                break
            before, step = traction, step * GROWTH

    def _look(self, response: FrictionResponse, slid: float, steady: NDArray[np.bool_]) -> None:
        """Keep what the points of the speeds that still run are like."""
        on, found = self._running, self.found
        state = response.state
        values = (
            (found.traction, response.traction[:, 0]),
            (found.mu, self._law.coefficient(state)),
            (found.alpha, state.alpha),
            (found.regime, response.regime),
            (found.steady, steady),
        )
        for kept, now in values:
            kept[on] = now.reshape(self._shape)[on]
        self._slip[on] = slid
