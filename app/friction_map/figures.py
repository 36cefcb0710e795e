"""Figures of the friction map at material points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from tribox.app.figures import style
from tribox.app.figures.steady_points import broken, film_numbers, mark_bulk, with_room
from tribox.app.figures.style import Floats
from tribox.app.friction_map.material_tests import Curve, FrictionMapResult, Track
from tribox.app.friction_map.setup import MapSetup
from tribox.forms.closed_forms import steady_traction, threshold_speed

MARKER_SIZE = 4.0
# Left margin, over the page's width, of panels whose ticks may have many digits beside two lines of
# label: these pages are not widened to what is drawn.
WIDE_MARGIN = 0.17


def draw_map(setup: MapSetup, result: FrictionMapResult, figures: Path) -> None:
    """Draw all figures of a map into a directory that exists."""
    films = result.films or setup.films[:1]
    made: dict[str, Callable[[], Figure]] = {
        "friction_map_thickness": lambda: _by_film(setup, result.by_film),
        "friction_map_load": lambda: _by_load(setup, result.by_load),
        "effective_viscosity": lambda: _viscosity(setup, result.by_film),
        "stribeck": lambda: _stribeck(setup, result.by_film),
        "slip_weakening": lambda: _weakening(setup, result.weakening),
        "start_stop": lambda: _start_stop(setup, result.start_stop, films),
        "velocity_jump": lambda: _jump(setup, result.jump, films),
    }
    with rc_context(style.STYLE):
        for name, draw in made.items():
            style.save(draw(), figures / f"{name}.png", tight=False)


# -- steady sliding -------------------------------------------------------------------------------


def _number(setup: MapSetup, film: float) -> int | None:
    """Which of the films one is, as the figures of a run count them; None of a dry contact."""
    wet = [one for one in setup.films if one > setup.parameters.D_min]
    return film_numbers(wet, setup.parameters).get(film)


def _colour(setup: MapSetup, film: float) -> str:
    number = _number(setup, film)
    return "0.45" if number is None else style.colour_of(number)


def _marks(setup: MapSetup, film: float) -> dict[str, Any]:
    """Colour, marker and dashes of a film."""
    number = _number(setup, film)
    if number is None:
        return {"color": _colour(setup, film), "marker": "x", "ls": (0, (1, 1))}
    return style.look_of(number)


def _film_label(setup: MapSetup, film: float) -> str:
    p = setup.parameters
    if film <= p.D_min:
        return "dry (D ≤ D_min)" if film > 0.0 else "dry (D = 0)"
    return f"D = {film * 1e9:g} nm" + (" ≥ D_max" if film >= p.D_max else "")


def _star(setup: MapSetup, film: float) -> float:
    """V*, m/s; infinite where it plays no part."""
    between = setup.parameters.D_min < film < setup.parameters.D_max
    return float(threshold_speed(film, setup.parameters)) if between else np.inf


def _draw_steady(
    setup: MapSetup, axes: Axes, curve: Curve, marks: dict[str, Any], label: str,
    by_speed: float = 1.0, by_traction: Callable[[Floats], Floats | float] = lambda speed: 1e-3,
) -> None:  # fmt: skip
    """A closed form, and the points that the law was stepped to; each times these factors."""
    colour, marker, dashes = marks["color"], marks["marker"], marks["ls"]
    fine = np.asarray(np.geomspace(setup.speeds[0], setup.speeds[-1], 3000), dtype=np.float64)
    exact = np.asarray(
        steady_traction(fine, curve.film, curve.pressure, curve.mu[0], setup.parameters)
    )
    exact = broken(exact, fine, _star(setup, curve.film)) * by_traction(fine)
    axes.plot(fine * by_speed, exact, color=colour, lw=1, ls=dashes)
    points = {"marker": marker, "ms": MARKER_SIZE, "mfc": "none", "color": colour}
    shown = curve.traction * by_traction(curve.speed)
    axes.plot(curve.speed * by_speed, shown, ls="none", **points)
    axes.plot([], [], lw=1, ls=dashes, label=label, **points)


def _explain(setup: MapSetup, axes: Axes, star: bool) -> None:
    text = "points: law stepped to steady sliding; lines: closed form"
    text += "; dotted: V*" if star else ""
    axes.set_title(style.titled(setup.title, text), fontsize=8.5, y=1.0)


def _mark_stars(setup: MapSetup, axes: Axes, curves: Sequence[Curve]) -> bool:
    """Dotted lines at the threshold speeds that lie within the map."""
    shown = False
    for curve in curves:
        star = _star(setup, curve.film)
        if curve.speed[0] < star < curve.speed[-1]:
            axes.axvline(star, color=_colour(setup, curve.film), ls=":", lw=1, zorder=0)
            shown = True
    return shown


def _log_log() -> tuple[Figure, Axes]:
    """A figure with both axes logarithmic."""
    figure = Figure(figsize=(7, 5))
    figure.subplots_adjust(right=0.97, top=0.92)
    return figure, figure.subplots(subplot_kw={"xscale": "log", "yscale": "log"})


def _finish(axes: Axes, x: str, y: str, place: str, title: str) -> None:
    """Names of the axes, legend and ticks."""
    axes.set(xlabel=x, ylabel=y)
    axes.legend(
        fontsize=8, loc=place, title=title, title_fontsize=8, frameon=True, framealpha=0.9,
        edgecolor="none",
    )  # fmt: skip
    style.thin_log_ticks(axes)


def _under(setup: MapSetup) -> str:
    return f"pressure p = {setup.pressure / 1e6:g} MPa"


def _by_film(setup: MapSetup, curves: Sequence[Curve]) -> Figure:
    figure, axes = _log_log()
    for curve in curves:
        marks = _marks(setup, curve.film)
        _draw_steady(setup, axes, curve, marks, _film_label(setup, curve.film))
    _explain(setup, axes, _mark_stars(setup, axes, curves))
    _finish(axes, style.VELOCITY.label(), style.TRACTION.label("kPa"), "lower right", _under(setup))
    return figure


def _by_load(setup: MapSetup, curves: Sequence[Curve]) -> Figure:
    figure, axes = _log_log()
    for number, curve in enumerate(curves):
        label = f"p = {curve.pressure / 1e6:.3g} MPa"
        _draw_steady(setup, axes, curve, style.look_of(number), label)
    _explain(setup, axes, False)
    star = _star(setup, setup.film)
    if setup.speeds[0] < star < setup.speeds[-1]:
        axes.axvline(star, color="0.4", ls=":", lw=1, zorder=0)
        axes.annotate(
            "V*", (star, 1.0), xycoords=("data", "axes fraction"), xytext=(-3, -2),
            textcoords="offset points", ha="right", va="top", fontsize=9, color="0.3",
        )  # fmt: skip
    film = _film_label(setup, setup.film)
    _finish(axes, style.VELOCITY.label(), style.TRACTION.label("kPa"), "upper left", film)
    return figure


def _viscosity(setup: MapSetup, curves: Sequence[Curve]) -> Figure:
    figure, axes = _log_log()
    wet = [curve for curve in curves if curve.film > setup.parameters.D_min]
    for curve in wet:
        marks, label = _marks(setup, curve.film), _film_label(setup, curve.film)
        film = curve.film
        _draw_steady(setup, axes, curve, marks, label, by_traction=lambda v, D=film: D / v)  # type: ignore[misc]
    _explain(setup, axes, _mark_stars(setup, axes, curves))
    eta = setup.parameters.eta_b
    mark_bulk(axes, eta)
    with_room(axes, min(eta, *(float(curve.viscosity.min()) for curve in wet)), 0.2)
    name = f"{style.VISCOSITY.words} = T D/V ({style.VISCOSITY.unit})"
    _finish(axes, style.VELOCITY.label(), name, "upper right", _under(setup))
    return figure


def _stribeck(setup: MapSetup, curves: Sequence[Curve]) -> Figure:
    """Friction over V η_b/D, the traction of a Newtonian film (in the paper: both times A)."""
    figure, axes = _log_log()
    for curve in curves:
        label, marks = _film_label(setup, curve.film), _marks(setup, curve.film)
        if curve.film <= setup.parameters.D_min:
            axes.axhline(curve.traction[0] / 1e3, color=marks["color"], lw=1.2, ls=marks["ls"],
                         label=f"{label}: Coulomb")  # fmt: skip
            continue
        _draw_steady(setup, axes, curve, marks, label, setup.parameters.eta_b / curve.film / 1e3)
    ends = axes.get_xlim()
    axes.plot(ends, ends, color="k", lw=0.8, ls="--", label="Newtonian: T = V η_b/D")
    axes.set_xlim(ends)
    _explain(setup, axes, False)
    x = "viscous stress of the bulk fluid V η_b/D (kPa)"
    _finish(axes, x, style.TRACTION.label("kPa"), "lower right", _under(setup))
    return figure


# -- in time --------------------------------------------------------------------------------------


def _weakening(setup: MapSetup, track: Track) -> Figure:
    p = setup.parameters
    figure = Figure(figsize=(7, 4.4))
    axes = figure.subplots()
    end = float(track.slip_path[-1, 0]) or p.mu_s * setup.pressure / p.K_T
    path = np.asarray(np.linspace(0.0, end, 2000), dtype=np.float64)
    mu = p.friction.coefficient(path)
    # Slip is permanent slip and the elastic deformation of the asperities, mu p/K_T.
    slip = np.append(0.0, path + mu * setup.pressure / p.K_T)
    axes.plot(
        slip * 1e6, np.concatenate([[0.0], mu]), color=style.COLOURS[0], lw=1, label="closed form"
    )
    axes.plot(
        track.slip[::4, 0] * 1e6, track.traction[::4, 0] / setup.pressure, "o", ms=MARKER_SIZE,
        mfc="none", color=style.RED, label="law stepped from rest",
    )  # fmt: skip
    axes.axhline(p.mu_s, color="0.5", lw=0.8, ls="--", zorder=0)
    axes.annotate(f"μ_s = {p.mu_s:g}", (1.0, p.mu_s), xycoords=("axes fraction", "data"),
                  xytext=(0, 3), textcoords="offset points", ha="right", fontsize=8)  # fmt: skip
    if p.mu_dynamic < p.mu_s:
        axes.axhline(p.mu_dynamic, color="0.5", lw=0.8, ls="--", zorder=0)
        axes.annotate(f"μ_d = {p.mu_dynamic:g}", (1.0, p.mu_dynamic),
                      xycoords=("axes fraction", "data"), xytext=(0, -3),
                      textcoords="offset points", ha="right", va="top", fontsize=8)  # fmt: skip
    axes.set_ylim(0.0, 1.15 * p.mu_s or 1.0)
    axes.set_xlim(left=0.0)
    words = f"dry contact under {setup.pressure / 1e6:g} MPa; the rise is elastic, over μp/K_T"
    axes.set_title(style.titled(setup.title, words), fontsize=8.5, y=1.0)
    axes.set_xlabel(style.SLIP.label("µm"))
    axes.set_ylabel(style.LOCAL_RATIO.label())
    axes.legend(loc="lower right", fontsize=8)
    return figure


def _phases(track: Track) -> list[tuple[str, int, int]]:
    """Name, first and one past the last step of each phase."""
    starts = [i for i, name in enumerate(track.phase) if i == 0 or name != track.phase[i - 1]]
    ends = [*starts[1:], len(track.phase)]
    return [(track.phase[a], a, b) for a, b in zip(starts, ends, strict=True)]


def _name_phases(axes: Axes, track: Track, x: Floats) -> None:
    """Lines between the phases and their names above the axes."""
    edges = np.concatenate([[0.0], x])
    for name, first, last in _phases(track):
        if first:
            axes.axvline(edges[first], color="0.6", lw=0.8, ls=":", zorder=0)
        axes.annotate(
            name, (0.5 * (edges[first] + edges[last]), 1.0), xycoords=("data", "axes fraction"),
            xytext=(0, 3), textcoords="offset points", ha="center", fontsize=8, color="0.3",
        )  # fmt: skip


def _start_stop(setup: MapSetup, track: Track, films: tuple[float, ...]) -> Figure:
    """Traction and velocity over time, one panel for each film: the sizes differ by far."""
    figure = Figure(figsize=(7, 1.3 + 1.45 * len(films)))
    panels = figure.subplots(
        len(films) + 1, 1, sharex=True, height_ratios=[*(1.0 for _ in films), 0.55]
    )
    unit = style.fitting(track.time[-1], "s")
    time = unit.of(track.time)
    for q, (axes, film) in enumerate(zip(panels[:-1], films, strict=True)):
        _traction_panel(axes, setup, film, time, track.traction[:, q], _colour(setup, film))
        for _, first, _ in _phases(track)[1:]:
            axes.axvline(time[first - 1], color="0.6", lw=0.8, ls=":", zorder=0)
    _name_phases(panels[0], track, time)
    speed = np.concatenate([[0.0], track.speed[:, 0]])
    panels[-1].step(np.concatenate([[0.0], time]), speed, color="0.25", where="pre", lw=1.2)
    _name_ordinate(panels[-1], "V (m/s)")
    panels[-1].yaxis.set_major_formatter(FuncFormatter(lambda value, _: style.plain_number(value)))
    figure.suptitle(setup.title, fontsize=9, y=0.96)
    panels[-1].set_xlabel(style.TIME.label(unit.name))
    figure.subplots_adjust(left=WIDE_MARGIN, right=0.97)
    return figure


def _traction_panel(
    axes: Axes, setup: MapSetup, film: float, x: Floats, traction: Floats, colour: str
) -> None:
    unit, scale = ("kPa", 1e-3) if float(np.max(np.abs(traction))) >= 1e3 else ("Pa", 1.0)
    axes.plot(
        np.concatenate([[0.0], x]), np.concatenate([[0.0], traction]) * scale, color=colour, lw=1.3
    )
    _name_ordinate(axes, f"D = {film * 1e9:g} nm\nT ({unit})")
    axes.margins(y=0.12)


def _name_ordinate(axes: Axes, text: str) -> None:
    """Label and few ticks of the y axis of one panel of several.

    The place of the label is given: to align labels, matplotlib sets all ticks of all panels anew
    for each of them.
    """
    axes.set_ylabel(text, fontsize=8)
    axes.yaxis.set_label_coords(-0.125, 0.5)
    axes.locator_params(axis="y", nbins=4)


def _jump(setup: MapSetup, track: Track, films: tuple[float, ...]) -> Figure:
    """Traction over slip: time would hide the fast phase."""
    figure = Figure(figsize=(7, 0.9 + 1.5 * len(films)))
    panels = figure.subplots(len(films), 1, sharex=True, squeeze=False)
    slip = track.slip[:, 0] * 1e6
    figure.suptitle(setup.title, fontsize=9, y=0.96)
    two = lambda speed: style.plain_number(float(f"{speed:.2g}"))  # noqa: E731
    named = [f"{name}\n{two(track.speed[first, 0])} m/s" for name, first, _ in _phases(track)]
    spans = _phases(track)
    names = [label for label, (_, a, b) in zip(named, spans, strict=True) for _ in range(b - a)]
    for q, (axes, film) in enumerate(zip(panels[:, 0], films, strict=True)):
        _traction_panel(axes, setup, film, slip, track.traction[:, q], _colour(setup, film))
        for _, first, _ in spans[1:]:
            axes.axvline(slip[first - 1], color="0.6", lw=0.8, ls=":", zorder=0)
    _name_phases(panels[0, 0], replace(track, phase=tuple(names)), slip)
    panels[-1, 0].set_xlabel(style.SLIP.label("µm"))
    figure.subplots_adjust(left=WIDE_MARGIN, right=0.97)
    return figure
