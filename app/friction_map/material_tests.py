"""The friction map at material points: steady sliding, slip weakening, tests in time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.app.friction_map.material_point import (
    Phase,
    Program,
    Track,
    follow,
    follow_all,
    slide_at_speeds,
)
from tribox.app.friction_map.setup import MapSetup
from tribox.app.results.directory import write_json, write_table
from tribox.forms.closed_forms.homogeneous_sliding import (
    presliding_length,
    steady_traction,
    threshold_speed,
)
from tribox.forms.friction.film_map import at_rest
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import Regime

Floats = NDArray[np.float64]

MAP_COLUMNS = (
    "thickness [m]",
    "pressure [Pa]",
    "velocity [m/s]",
    "traction [Pa]",
    "effective_viscosity [Pa*s]",
    "friction_coefficient [-]",
    "bulk_fluid_stress [Pa]",
    "closed_form_traction [Pa]",
    "alpha [-]",
    "mu [-]",
    "regime",
    "steady",
)
TRACK_COLUMNS = (
    "thickness [m]",
    "phase",
    "time [s]",
    "slip [m]",
    "velocity [m/s]",
    "traction [Pa]",
    "alpha [-]",
    "mu [-]",
    "slip_path [m]",
    "regime",
    "dissipated [J/m^2]",
)


@dataclass(frozen=True, slots=True)
class Curve:
    """Steady sliding under one film and load; arrays (v,) over the speeds.

    Attributes:
        film: m, thickness D.
        pressure: Pa, load per area.
        speed: m/s.
        traction: Pa, from stepping the law.
        mu: Coefficient of friction reached.
        alpha: Film fraction.
        regime: Codes of ``tribox.forms.friction.law.Regime``.
        steady: Whether the traction had stopped changing.
        exact: Pa, closed form at the coefficient reached; NaN within the transition at V*.
    """

    film: float
    pressure: float
    speed: Floats
    traction: Floats
    mu: Floats
    alpha: Floats
    regime: NDArray[np.int8]
    steady: NDArray[np.bool_]
    exact: Floats

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
    """All curves of a map.

    Attributes:
        by_film: T(V; D), one curve for each thickness.
        by_load: T(V; L), one for each load.
        weakening: One dry point, slid from rest.
        start_stop: Points of the thicknesses ``films``.
        jump: Likewise.
        films: m.
    """

    by_film: tuple[Curve, ...]
    by_load: tuple[Curve, ...]
    weakening: Track
    start_stop: Track
    jump: Track
    films: tuple[float, ...]


def compute_map(setup: MapSetup) -> FrictionMapResult:
    """Step the law through all programs of the map."""
    law = FrictionMap(setup.parameters)
    films = np.array([*setup.films, *(setup.film for _ in setup.loads)])
    loads = np.array([*(setup.pressure for _ in setup.films), *setup.loads])
    curves = _steady_curves(setup, law, films, loads)
    tested = _tested_films(setup)
    moved = tested or setup.films[:1]
    start_stop, jump = follow_all(law, [_start_stop(setup, moved), _velocity_jump(setup, moved)])
    return FrictionMapResult(
        by_film=curves[: len(setup.films)],
        by_load=curves[len(setup.films) :],
        weakening=_weakening(setup, law),
        start_stop=start_stop,
        jump=jump,
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


def _tested_films(setup: MapSetup) -> tuple[float, ...]:
    """Films of the tests in time: those with a threshold speed, and the one from D_max on."""
    fluid = [D for D in setup.films if setup.parameters.D_max <= D]
    return (*setup.between, *fluid[:1])


def _weakening(setup: MapSetup, law: FrictionMap) -> Track:
    """A point without film, slid until mu has fallen by 95 % of mu_s - mu_d."""
    p = setup.parameters
    reach = _build_up(setup)
    if not p.friction.constant:
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
    return 3.0 * _build_up(setup) + (0.0 if p.friction.constant else p.A_d + 4.0 / p.B)


def _start_stop(setup: MapSetup, films: tuple[float, ...]) -> Program:
    """Below V*: start, rest, start again, reverse."""
    V, _ = _slow_and_fast(setup)
    time = _distance(setup) / V
    D, p = np.array(films), setup.pressure
    phases = [
        Phase("start", time, 120, V, p, D),
        Phase("rest", 0.5 * time, 20, 0.0, p, D),
        Phase("start again", 0.5 * time, 60, V, p, D),
        Phase("rest again", 0.5 * time, 20, 0.0, p, D),
        Phase("reverse", time, 120, -V, p, D),
    ]
    return Program(phases, len(films))


def _velocity_jump(setup: MapSetup, films: tuple[float, ...]) -> Program:
    """From below V* to above and back."""
    slow, fast = _slow_and_fast(setup)
    way = _distance(setup)
    D, p = np.array(films), setup.pressure
    phases = [
        Phase("slow", way / slow, 120, slow, p, D),
        Phase("fast", 0.5 * way / fast, 60, fast, p, D),
        Phase("slow again", way / slow, 120, slow, p, D),
    ]
    return Program(phases, len(films))


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
        for i, V in enumerate(curve.speed):
            exact = float(curve.exact[i])
            yield [
                curve.film,
                curve.pressure,
                float(V),
                float(curve.traction[i]),
                float(curve.viscosity[i]),
                float(curve.traction[i] / curve.pressure),
                float(bulk_stress[i]),
                "" if math.isnan(exact) else exact,
                float(curve.alpha[i]),
                float(curve.mu[i]),
                Regime(int(curve.regime[i])).name.lower(),
                str(bool(curve.steady[i])).lower(),
            ]


def _track_rows(track: Track, films: tuple[float, ...]) -> Iterator[list[Any]]:
    for q, film in enumerate(films):
        for n, phase in enumerate(track.phase):
            yield [
                film,
                phase,
                float(track.time[n]),
                float(track.slip[n, q]),
                float(track.speed[n, q]),
                float(track.traction[n, q]),
                float(track.alpha[n, q]),
                float(track.mu[n, q]),
                float(track.slip_path[n, q]),
                Regime(int(track.regime[n, q])).name.lower(),
                float(track.dissipated[n, q]),
            ]
