"""Figures of steady sliding on the friction map: computed points on the closed form."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tribox.app.case.case import Case
from tribox.app.figures import style
from tribox.app.figures.style import Floats, Unit
from tribox.forms.closed_forms import effective_viscosity, steady_traction, threshold_speed
from tribox.forms.friction.parameters import FrictionMapParameters


@dataclass(frozen=True, slots=True)
class Series:
    """Steady points of one film thickness."""

    label: str  # what the series is called
    thickness: float  # D, m
    parameters: FrictionMapParameters  # of the law
    speed: Floats  # m/s
    viscosity: Floats  # Pa s
    traction: Floats  # Pa, F_T/A
    pressure: float  # Pa, N/A
    mu: float  # computed μ(d)
    steady: NDArray[np.bool_]  # whether each point is


def steady_series(case: Case, load_steps: Iterable[dict[str, Any]], label: str = "") -> Series:
    """The steady points of a run of the friction map, by its last rows that ran until steady."""
    contact = case.contact[0]
    assert contact.map is not None and contact.given_film is not None
    speed, viscosity, friction, normal, area, mu, steady = style.columns(
        sorted(load_steps, key=lambda load_step: abs(load_step["velocity"])),
        *("velocity", "effective_viscosity", "friction_force", "normal_force"),
        *("contact_area", "mu", "steady"),
    )
    mean_pressure = float(np.mean(normal / area))
    thickness = contact.given_film.at(mean_pressure)
    return Series(
        label=label or f"D = {thickness * 1e9:g} nm",
        thickness=thickness,
        parameters=contact.map,
        speed=np.abs(speed),
        viscosity=viscosity,
        traction=friction / area,
        pressure=mean_pressure,
        mu=float(np.mean(mu)),
        steady=steady.astype(bool),
    )


USUAL_SHARES = (0.04, 0.12, 0.72, 1.0)
"""Of the way from D_min to D_max: films that always have the first numbers, those of the map."""


def film_numbers(films: Iterable[float], law: FrictionMapParameters) -> dict[float, int]:
    """Which colour, marker and dashes each film has, whatever else a figure shows.

    A film of the usual ones has its own number, another one of those behind them, by whether it is
    below a quarter of the way to D_max; where these are taken, the next that is free.

    ``films``: m, thicknesses above D_min.
    """
    shares = {film: (film - law.D_min) / (law.D_max - law.D_min) for film in films}
    usual, further = range(len(USUAL_SHARES)), range(len(USUAL_SHARES), len(style.COLOURS))

    def wanted(share: float) -> list[int]:
        own = [k for k in usual if abs(min(share, 1.0) - USUAL_SHARES[k]) < 1e-3]
        return [*own, *(further if share < 0.25 else reversed(further)), *usual]

    found: dict[float, int] = {}
    for film in sorted(shares, key=lambda film: (wanted(shares[film])[0] >= len(usual), film)):
        free = [k for k in wanted(shares[film]) if k not in found.values()]
        found[film] = free[0] if free else len(found)
    return found


def series_numbers(films: Sequence[float | None], law: FrictionMapParameters | None) -> list[int]:
    """Which of them each series has: its film's, or its place where films are equal or unknown."""
    known = {film for film in films if film is not None}
    if law is None or len(known) < len(films):
        return list(range(len(films)))
    numbers = film_numbers(known, law)
    return [numbers[film] for film in films if film is not None]


def draw_steady(series: list[Series], figures: Path, case: str = "") -> list[Path]:
    """Draw ``effective_viscosity.png``, where there is a film, and ``friction_map.png``."""
    wet = [one for one in series if one.thickness > 0.0]  # D = 0 has no viscosity
    drawn = {"effective_viscosity.png": _viscosity_figure(wet, case)} if wet else {}
    drawn["friction_map.png"] = _map_figure(series, case)
    for name, figure in drawn.items():
        style.save(figure, figures / name)
    return [figures / name for name in drawn]


def _unsteady_words(series: list[Series]) -> str:
    """What to say of the grey crosses, where there are some."""
    return "" if all(one.steady.all() for one in series) else f" ({style.CROSSES})"


def _curve_speeds(series: list[Series]) -> Floats:
    low = min(s.speed.min() for s in series)
    return np.geomspace(low / 1.5, max(s.speed.max() for s in series) * 1.5, 2000)


def broken(values: Floats, speed: Floats, at: float) -> Floats:
    """A curve with a gap where it jumps, so that no line is drawn across."""
    out = values.copy()
    jump = np.searchsorted(speed, at)
    if 0 < jump < len(speed):
        out[jump - 1] = np.nan
    return out


def _unit(series: list[Series]) -> Unit:
    """The unit of all their velocities."""
    return style.velocity_unit(np.concatenate([one.speed for one in series]))


def with_room(axes: Axes, level: float, share: float = 0.3) -> None:
    """On a logarithmic axis room above and below a level that all points may lie on."""
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, share * level), max(high, level / share))


def mark_bulk(axes: Axes, eta: float, *, named: bool = True) -> None:
    """A line at the viscosity of the bulk fluid, Pa s."""
    axes.axhline(eta, color="k", lw=0.8, ls="--", zorder=0)
    if named:
        axes.annotate(f"η_b = {eta:g} Pa s", (0.02, eta), xycoords=("axes fraction", "data"),
                      xytext=(0, -6), textcoords="offset points", va="top", fontsize=8)  # fmt: skip


def _viscosity_figure(series: list[Series], case: str) -> Figure:
    figure = Figure(figsize=(10, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    speed, unit = _curve_speeds(series), _unit(series)
    numbers = series_numbers([one.thickness for one in series], series[0].parameters)
    for place, one in enumerate(series):
        for axes, scale in ((left, unit.factor), (right, 1.0 / one.thickness)):
            _viscosity_curve(axes, one, (numbers[place], place), speed, scale)
    eta = series[0].parameters.eta_b
    for axes in (left, right):
        mark_bulk(axes, eta, named=axes is left)
    with_room(left, eta)
    left.set_xlabel(style.VELOCITY.label(unit.name))
    left.set_ylabel(f"{style.VISCOSITY.words} = |Σ T| D/(A V) ({style.VISCOSITY.unit})")
    right.set_xlabel(style.SHEAR_RATE.label())
    left.legend(frameon=True, framealpha=0.9, edgecolor="none")
    for axes in (left, right):
        style.thin_log_ticks(axes)
    words = f"points: computed steady states{_unsteady_words(series)}; lines: closed form"
    figure.suptitle(style.titled(case, f"{words}; dotted: V*"), fontsize=9)
    return figure


def _viscosity_curve(
    axes: Axes, one: Series, numbers: tuple[int, int], speed: Floats, scale: float
) -> None:
    """Points and closed form of one series, over the speed times ``scale``."""
    number, place = numbers
    look = style.look_of(number)
    colour = look["color"]
    star = float(threshold_speed(one.thickness, one.parameters))
    curve = effective_viscosity(speed, one.thickness, one.pressure, one.mu, one.parameters)
    axes.loglog(speed * scale, broken(curve, speed, star), color=colour, lw=1, ls=look["ls"])
    axes.loglog(
        one.speed * scale,
        one.viscosity,
        **look | {"ls": "none"},
        ms=max(9.0 - 1.5 * place, 3.0),  # points that coincide stay visible
        mfc="none" if place % 2 else colour,
        label=one.label,
    )
    style.cross_out(axes, one.speed * scale, one.viscosity, ~one.steady)
    if speed[0] < star < speed[-1] and one.thickness < one.parameters.D_max:
        axes.axvline(star * scale, color=colour, ls=":", lw=1)


def _map_figure(series: list[Series], case: str) -> Figure:
    figure = Figure(figsize=(6.8, 5.0), layout="constrained")
    axes = figure.subplots()
    speed, unit = _curve_speeds(series), _unit(series)
    numbers = series_numbers([one.thickness for one in series], series[0].parameters)
    for number, one in zip(numbers, series, strict=True):
        look = style.look_of(number)
        colour, marker = look["color"], look["marker"]
        star = float(threshold_speed(one.thickness, one.parameters))
        curve = steady_traction(speed, one.thickness, one.pressure, one.mu, one.parameters)
        line = broken(curve, speed, star) / 1e6
        axes.loglog(unit.of(speed), line, color=colour, lw=1, ls=look["ls"])
        viscous = (one.speed > star) | (one.thickness >= one.parameters.D_max)
        for chosen, fill in ((~viscous, colour), (viscous, "w")):
            x, y = unit.of(one.speed[chosen]), one.traction[chosen] / 1e6
            axes.loglog(x, y, marker, ms=5, color=colour, mfc=fill)
        style.cross_out(axes, unit.of(one.speed), np.asarray(one.traction / 1e6), ~one.steady)
        axes.plot([], [], **look, ms=5, lw=1, label=one.label)
    axes.plot([], [], "o", color="0.4", label="filled: frictional or mixed (V < V*)")
    axes.plot([], [], "o", color="0.4", mfc="w", label="empty: viscous (V > V* or D ≥ D_max)")
    axes.set_xlabel(style.VELOCITY.label(unit.name))
    axes.set_ylabel(style.MEAN_TRACTION.label("MPa"))
    words = f"friction map: computed points{_unsteady_words(series)} on the closed form"
    figure.suptitle(style.titled(case, words), fontsize=9)
    axes.legend(fontsize=8)
    style.thin_log_ticks(axes)
    return figure
