"""The friction map at material points: steady sliding, slip weakening, tests in time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tribox.app.friction_map.setup import Floats, MapSetup
from tribox.app.results.directory import write_json, write_table
from tribox.forms.closed_forms import presliding_length, steady_traction, threshold_speed
from tribox.forms.friction.film import at_rest
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import Regime

# -- Material points: a friction law stepped through given slip, pressure and film, without bodies -
#
# Axis letters: n steps, q points; the slip is along one line, so its vectors have one component.

FIRST_SLIP = 1e-9
"""m, first step on the way to steady sliding: short against any pre-sliding length."""
GROWTH = 1.4  # ratio of a step to the one before, on the way to steady sliding
UNCHANGED = 1e-6  # largest relative change of the traction in one step that counts as none
STEPS_IN_A_ROW = 3  # steps over which the traction must not change any more


@dataclass(frozen=True, slots=True)
class Phase:
    """Part of a program: equal steps at given speeds."""

    name: str  # what the points do, such as "rest"
    duration: float  # s, > 0
    steps: int  # number of equal steps
    speed: ArrayLike  # (q,) or a number, m/s, slip speed; its sign is the direction
    pressure: ArrayLike  # (q,) or a number, Pa, contact pressure, 0 is open
    film: ArrayLike  # (q,) or a number, m, film thickness
    rate_dependent: bool = True  # whether time counts; without, slip is all that matters


@dataclass(frozen=True, slots=True)
class Track:
    """What the points went through, one row per step."""

    phase: tuple[str, ...]  # (n,), name of the phase
    time: Floats  # (n,), s, at the end of the step
    slip: Floats  # (n, q), m, sum of all slip increments
    speed: Floats  # (n, q), m/s
    traction: Floats  # (n, q), Pa, in the direction of positive slip
    slip_path: Floats  # (n, q), m, length of the permanent slip
    alpha: Floats  # (n, q), film fraction
    mu: Floats  # (n, q), coefficient of friction at the slip path reached
    regime: NDArray[np.int8]  # (n, q), codes of ``tribox.forms.friction.law.Regime``
    dissipated: Floats  # (n, q), J/m^2 in the step


def follow(law: Any, phases: Sequence[Phase], points: int) -> Track:
    """Step a law through phases, one after the other, from a state without history.

    What a phase gives as a number holds for all points.
    """
    state = law.initial_state(points, 1)
    columns: list[tuple[NDArray[np.generic], ...]] = []
    for phase in phases:
        dt = phase.duration / phase.steps
        speed, pressure, film = (
            np.broadcast_to(np.asarray(value, dtype=np.float64), (points,))
            for value in (phase.speed, phase.pressure, phase.film)
        )
        for _ in range(phase.steps):
            response = law.update(
                (speed * dt)[:, None], dt, pressure, film, state,
                rate_dependent=phase.rate_dependent,
            )  # fmt: skip
            state = response.state
            columns.append((
                speed * dt, speed, response.traction[:, 0], state.slip_path, state.alpha,
                law.coefficient(state), response.regime, response.dissipation.total,
            ))  # fmt: skip
    names = tuple(phase.name for phase in phases for _ in range(phase.steps))
    time = np.cumsum(np.concatenate([[p.duration / p.steps] * p.steps for p in phases]))
    slip, *others = (np.array(column) for column in zip(*columns, strict=True))
    return Track(names, time, np.cumsum(slip, axis=0), *others)


@dataclass(frozen=True, slots=True)
class Steady:
    """Steady sliding of q points at each of v speeds."""

    traction: Floats  # (v, q), Pa
    mu: Floats  # (v, q), coefficient of friction at the slip reached
    alpha: Floats  # (v, q), film fraction
    regime: NDArray[np.int8]  # (v, q), codes of ``tribox.forms.friction.law.Regime``
    steady: NDArray[np.bool_]  # (v, q), whether the traction had stopped changing
    slip: Floats  # (v,), m, distance slid until all points were steady (or given up)


def slide_at_speeds(
    law: FrictionMap,
    speeds: Floats,
    pressure: Floats,
    film: Floats,
    *,
    least_slip: float = 1e-3,
    most_slip: float = 100.0,
) -> Steady:
    """Slide points at speeds (v,), m/s, in growing steps, until their traction stays the same.

    All speeds side by side: their steps are of the same slip, so of different length in time. A
    point is steady when its traction has changed by less than ``UNCHANGED`` in each of the last
    steps, each longer than the one before by a fixed ratio: a slow creep towards the end value does
    not pass for steady. ``pressure``: (q,), Pa; ``film``: (q,), m; ``least_slip``: m, more than the
    pre-sliding length; ``most_slip``: m, after which points count as not steady.
    """
    shape = len(speeds), len(film)
    slowness = np.repeat(1.0 / speeds, len(film))
    pressures, films = np.tile(pressure, len(speeds)), np.tile(film, len(speeds))
    traction, mu, alpha = np.zeros((3, *shape))
    regime, steady = np.zeros(shape, dtype=np.int8), np.zeros(shape, dtype=np.bool_)
    found = Steady(traction, mu, alpha, regime, steady, np.zeros(len(speeds)))
    running: NDArray[np.bool_] = np.ones(len(speeds), dtype=np.bool_)
    state = law.initial_state(len(films), 1)
    before: Floats = np.zeros(len(films))
    calm: NDArray[np.int64] = np.zeros(len(films), dtype=np.int64)
    step, slid = FIRST_SLIP, 0.0
    while running.any() and slid <= most_slip:
        slip = np.full((len(films), 1), step)
        response = law.update(slip, step * slowness, pressures, films, state)
        state, now = response.state, response.traction[:, 0]
        slid += step
        calm = np.where(np.abs(now - before) <= UNCHANGED * np.abs(now), calm + 1, 0)
        for array, values in (
            (traction, now), (mu, law.coefficient(state)), (alpha, state.alpha),
            (regime, response.regime), (steady, calm >= STEPS_IN_A_ROW),
        ):  # fmt: skip
            array[running] = values.reshape(shape)[running]
        found.slip[running] = slid
        if slid > least_slip:
            running &= ~steady.all(axis=1)
        before, step = now, step * GROWTH
    return found


# -- The friction map at material points: steady sliding, slip weakening, tests in time ------------


MAP_COLUMNS = (
    *("thickness [m]", "pressure [Pa]", "velocity [m/s]", "traction [Pa]"),
    *("effective_viscosity [Pa*s]", "friction_coefficient [-]", "bulk_fluid_stress [Pa]"),
    *("closed_form_traction [Pa]", "alpha [-]", "mu [-]", "regime", "steady"),
)
TRACK_COLUMNS = (
    *("thickness [m]", "phase", "time [s]", "slip [m]", "velocity [m/s]", "traction [Pa]"),
    *("alpha [-]", "mu [-]", "slip_path [m]", "regime", "dissipated [J/m^2]"),
)


@dataclass(frozen=True, slots=True)
class Curve:
    """Steady sliding under one film and load; arrays (v,) over the speeds."""

    film: float  # m, thickness D
    pressure: float  # Pa, load per area
    speed: Floats  # m/s
    traction: Floats  # Pa, from stepping the law
    mu: Floats  # coefficient of friction reached
    alpha: Floats  # film fraction
    regime: NDArray[np.int8]  # codes of ``tribox.forms.friction.law.Regime``
    steady: NDArray[np.bool_]  # whether the traction had stopped changing
    exact: Floats  # Pa, closed form at the coefficient reached; NaN within the transition at V*

    @property
    def viscosity(self) -> Floats:
        """Effective viscosity T D/V, Pa s."""
        return self.traction * self.film / self.speed

    @property
    def deviation(self) -> float:
        """Largest relative distance from the closed form."""
        away = np.abs(self.traction - self.exact)
        scale = np.where(self.exact > 0.0, self.exact, 1.0)
        return float(np.nanmax(away / scale, initial=0.0))


@dataclass(frozen=True, slots=True)
class FrictionMapResult:
    """All curves of a map."""

    by_film: tuple[Curve, ...]  # T(V; D), one curve for each thickness
    by_load: tuple[Curve, ...]  # T(V; L), one for each load
    weakening: Track  # one dry point, slid from rest
    start_stop: Track  # points of the thicknesses ``films``
    jump: Track  # likewise
    films: tuple[float, ...]  # m


def compute_map(setup: MapSetup) -> FrictionMapResult:
    """Step the law through all programs of the map."""
    law = FrictionMap(setup.parameters)
    films = np.array([*setup.films, *(setup.film for _ in setup.loads)])
    loads = np.array([*(setup.pressure for _ in setup.films), *setup.loads])
    curves = _steady_curves(setup, law, films, loads)
    # From D_max on all films are plain fluids: one of them shows what they do.
    fluid = [D for D in setup.films if setup.parameters.D_max <= D]
    tested = (*setup.between, *fluid[:1])
    moved = tested or setup.films[:1]
    return FrictionMapResult(
        by_film=curves[: len(setup.films)],
        by_load=curves[len(setup.films) :],
        weakening=_weakening(setup, law),
        start_stop=follow(law, _start_stop(setup, moved), len(moved)),
        jump=follow(law, _velocity_jump(setup, moved), len(moved)),
        films=tested,
    )


def _steady_curves(
    setup: MapSetup, law: FrictionMap, films: Floats, loads: Floats
) -> tuple[Curve, ...]:
    parameters, speeds = setup.parameters, setup.speeds
    # Under the literal flow rule a film with alpha close to 1 holds on over a long slip.
    lengths = presliding_length(
        loads, parameters.mu_s, 1.0 - at_rest(parameters, films).solid, parameters
    )
    least = 3.0 * float(np.max(lengths, where=np.isfinite(lengths), initial=1e-4))
    least += 10.0 * parameters.A_d
    found = slide_at_speeds(law, speeds, loads, films, least_slip=least, most_slip=1e4 * least)
    traction, mu, alpha, regime, steady = (
        getattr(found, name).T for name in ("traction", "mu", "alpha", "regime", "steady")
    )
    star = threshold_speed(films, parameters)
    exact = steady_traction(speeds, films[:, None], loads[:, None], mu, parameters)
    inside = np.abs(speeds / star[:, None] - 1.0) <= parameters.transition_width
    wet = (films > parameters.D_min) & (films < parameters.D_max)
    exact[inside & wet[:, None]] = np.nan
    return tuple(
        Curve(
            float(films[q]), float(loads[q]), speeds,
            traction[q], mu[q], alpha[q], regime[q], steady[q], exact[q],
        )
        for q in range(len(films))
    )  # fmt: skip


def _weakening(setup: MapSetup, law: FrictionMap) -> Track:
    """A point without film, slid until mu has fallen by 95 % of mu_s - mu_d."""
    p = setup.parameters
    reach = _build_up(setup)
    if not p.friction.constant:
        # 1/(1 + B s) is a twentieth there.
        reach += p.A_d + 19.0 / p.B
    else:
        reach *= 4.0
    # Up to A_d and in the fall beyond alike, steps are short against what happens there.
    phase = Phase("slide", 1.0, 240, reach, setup.pressure, p.D_min, rate_dependent=False)
    return follow(law, [phase], 1)


def _slow_and_fast(setup: MapSetup) -> tuple[float, float]:
    """A speed below the V* of every film, and one above."""
    stars = threshold_speed(np.array(setup.between or [setup.parameters.D_max]), setup.parameters)
    return 0.3 * float(stars.min()), 3.0 * float(stars.max())


def _build_up(setup: MapSetup) -> float:
    """Slip over which friction builds up, m; any small one where there is no friction."""
    p = setup.parameters
    return p.mu_s * setup.pressure / p.K_T or 1e-6


def _distance(setup: MapSetup) -> float:
    """A slip by which friction has built up and mu has fallen."""
    p = setup.parameters
    # After 4/B beyond A_d four fifths of the fall are done.
    return 3.0 * _build_up(setup) + (0.0 if p.friction.constant else p.A_d + 4.0 / p.B)


def _start_stop(setup: MapSetup, films: tuple[float, ...]) -> list[Phase]:
    """Below V*: start, rest, start again, reverse."""
    V, _ = _slow_and_fast(setup)
    time = _distance(setup) / V
    D, p = np.array(films), setup.pressure
    return [
        Phase("start", time, 120, V, p, D),
        Phase("rest", 0.5 * time, 20, 0.0, p, D),
        Phase("start again", 0.5 * time, 60, V, p, D),
        Phase("rest again", 0.5 * time, 20, 0.0, p, D),
        Phase("reverse", time, 120, -V, p, D),
    ]


def _velocity_jump(setup: MapSetup, films: tuple[float, ...]) -> list[Phase]:
    """From below V* to above and back."""
    slow, fast = _slow_and_fast(setup)
    way = _distance(setup)
    D, p = np.array(films), setup.pressure
    return [
        Phase("slow", way / slow, 120, slow, p, D),
        Phase("fast", 0.5 * way / fast, 60, fast, p, D),
        Phase("slow again", way / slow, 120, slow, p, D),
    ]


# -- files ----------------------------------------------------------------------------------------


def write_map(setup: MapSetup, result: FrictionMapResult, directory: Path, seconds: float) -> None:
    """Write the tables and ``summary.json`` of a map into a directory that is ready."""
    write_table(directory / "friction_map.csv", MAP_COLUMNS, _map_rows(setup, result.by_film))
    write_table(directory / "load_map.csv", MAP_COLUMNS, _map_rows(setup, result.by_load))
    dry = (setup.parameters.D_min,)
    films = result.films or setup.films[:1]
    for name, track, thicknesses in (
        ("slip_weakening", result.weakening, dry),
        ("start_stop", result.start_stop, films),
        ("velocity_jump", result.jump, films),
    ):
        write_table(directory / f"{name}.csv", TRACK_COLUMNS, _track_rows(track, thicknesses))
    write_json(directory / "summary.json", summary(setup, result, seconds))


def summary(setup: MapSetup, result: FrictionMapResult, seconds: float) -> dict[str, Any]:
    """What was mapped, with which parameters, and how far it is from the closed forms."""
    curves = (*result.by_film, *result.by_load)
    stars = threshold_speed(np.array(setup.films), setup.parameters)
    return {
        "title": setup.title,
        "notes": list(setup.notes),
        "friction": setup.friction.model_dump(mode="json", exclude_none=True),
        "thicknesses_m": list(setup.films),
        "threshold_speeds_m_per_s": [float(v) if math.isfinite(v) else None for v in stars],
        "pressure_Pa": setup.pressure,
        "loads_Pa": list(setup.loads),
        "load_map_thickness_m": setup.film,
        "points": int(sum(len(curve.speed) for curve in curves)),
        "points_not_steady": int(sum(np.sum(~curve.steady) for curve in curves)),
        "largest_deviation_from_closed_form": max(curve.deviation for curve in curves),
        "seconds": round(seconds, 2),
    }


def _map_rows(setup: MapSetup, curves: tuple[Curve, ...]) -> Iterator[list[Any]]:
    p = setup.parameters
    for curve in curves:
        wet = curve.film > p.D_min
        # The abscissa of the Stribeck presentation: what the bulk fluid alone would drag with.
        bulk_stress = p.eta_b * curve.speed / curve.film if wet else np.zeros_like(curve.speed)
        friction = curve.traction, curve.viscosity, curve.traction / curve.pressure
        columns = (curve.speed, *friction, bulk_stress, curve.exact, curve.alpha, curve.mu)
        rows = zip(np.stack(columns, axis=1), curve.regime, curve.steady, strict=True)
        for row, regime, steady in rows:
            # Alone the closed form is missing where there is none.
            numbers = [
                "" if column is curve.exact and math.isnan(number) else float(number)
                for column, number in zip(columns, row, strict=True)
            ]
            words = Regime(int(regime)).name.lower(), str(bool(steady)).lower()
            yield [curve.film, curve.pressure, *numbers, *words]


def _track_rows(track: Track, films: tuple[float, ...]) -> Iterator[list[Any]]:
    of_points = track.slip, track.speed, track.traction, track.alpha, track.mu, track.slip_path
    for q, film in enumerate(films):
        columns = track.time, *(values[:, q] for values in of_points)
        for n, phase in enumerate(track.phase):
            regime = Regime(int(track.regime[n, q])).name.lower()
            numbers = [float(column[n]) for column in columns]
            yield [film, phase, *numbers, regime, float(track.dissipated[n, q])]
