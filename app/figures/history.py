"""Figures drawn from the files of a results directory."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from app.case.case import Case
from app.case.friction import FrictionMap
from app.case.reading import load_case
from app.figures.phase_plots import draw_phases
from app.figures.style import COLOURS, MARKERS, STYLE, columns, save
from app.results.directory import read_table
from forms.closed_forms.homogeneous_sliding import (
    effective_viscosity,
    steady_traction,
    threshold_speed,
)
from forms.friction.parameters import FrictionMapParameters
from geometry.surfaces.facets import Floats

# -- one run --------------------------------------------------------------------------------------


def draw_history(directory: Path) -> None:
    """Draw ``history.png`` and ``energy.png``; the steady points too, where there are some.

    Raises:
        InputError: the directory holds no history.
    """
    rows = read_table(directory / "history.csv")
    figures = directory / "figures"
    if not rows:
        return
    with plt.rc_context(STYLE):
        save(_forces(rows), figures / "history.png")
        save(_energies(rows), figures / "energy.png")
        case = load_case(directory / "case.toml")
        draw_phases(case, directory)
        steady = [
            load_step for load_step in _load_steps(directory) if load_step["steady"] is not None
        ]
        if steady and isinstance(case.contact[0].friction, FrictionMap):
            _draw_film([_series(case, steady)], figures)


def _load_steps(directory: Path) -> list[dict[str, Any]]:
    """The load steps of a run, from its summary; none if it was killed before it wrote one."""
    summary = directory / "summary.json"
    if not summary.is_file():
        return []
    load_steps: list[dict[str, Any]] = json.loads(summary.read_text(encoding="utf-8"))["load_steps"]
    return load_steps


def _mark_stages(axes: Axes, rows: list[dict[str, Any]], named: bool) -> None:
    """A line where each stage or velocity begins, and its name above the axes."""
    keys = [(row["stage"], row["velocity"]) for row in rows]
    starts = [i for i, key in enumerate(keys) if i == 0 or key != keys[i - 1]]
    for start in starts:
        axes.axvline(rows[start]["step"] - 0.5, color="0.8", lw=0.8, zorder=0)
    apart = 0.03 * len(rows)
    last = -apart
    for start in starts:
        if not named or start - last < apart:
            continue
        last = start
        stage, velocity = keys[start]
        axes.annotate(
            f"{velocity:g} m/s" if velocity else stage,
            (rows[start]["step"] - 0.5, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            fontsize=7,
            color="0.35",
            rotation=60,
        )


def _forces(rows: list[dict[str, Any]]) -> Figure:
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(7, 5.4), sharex=True)
    step, normal, tangential, friction = columns(
        rows, "step", "normal_force", "tangential_force", "friction_coefficient"
    )
    top.plot(step, normal, color=COLOURS[0], label="normal force")
    top.plot(step, tangential, color=COLOURS[1], label="tangential force")
    top.set_ylabel("force (N)")
    top.legend()
    bottom.plot(step, friction, color=COLOURS[2])
    bottom.set_ylabel("T/N (-)")
    bottom.set_ylim(bottom=0.0)
    bottom.set_xlabel("step")
    _mark_stages(top, rows, named=True)
    _mark_stages(bottom, rows, named=False)
    return figure


def _energies(rows: list[dict[str, Any]]) -> Figure:
    figure, axes = plt.subplots(figsize=(7, 4))
    step, strain, interface, dissipated, numerical, kinetic, damping, error = columns(
        rows,
        "step",
        "strain_energy",
        "interface_energy",
        "dissipation",
        "numerical_dissipation",
        "kinetic_energy",
        "damping_dissipation",
        "energy_error",
    )
    parts = {"strain": strain, "interface": interface, "dissipated": dissipated - numerical}
    parts |= {"kinetic": kinetic} if kinetic.any() else {}
    parts |= {"damped": damping} if damping.any() else {}
    supplied = sum(parts.values()) + error
    thrown = abs(supplied - columns(rows, "external_work")[0]).max() > 1e-9 * abs(supplied).max()
    name = "external work" + " and initial kinetic energy" * bool(thrown)
    axes.plot(step, supplied, color="k", lw=2.5, alpha=0.35, label=name)
    axes.stackplot(step, *parts.values(), labels=list(parts), colors=COLOURS, alpha=0.6)
    largest = float(np.max(np.abs(supplied))) or 1.0
    axes.plot(step, error, color=COLOURS[1], lw=1, label="not accounted for")
    axes.set_title(
        f"largest gap between work and its uses: {np.max(np.abs(error)) / largest:.1e} of the work",
        fontsize=9,
    )
    axes.set_xlabel("step")
    axes.set_ylabel("energy (J)")
    # Below: areas and lines may fill all of the axes.
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=3, fontsize=8)
    return figure


# -- film -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Series:
    """Steady points of one film thickness.

    Attributes:
        thickness: D, m; parameters: of the law.
        speed: m/s; viscosity: Pa s; traction: Pa, T/A; pressure: Pa, N/A; mu: computed μ(d).
        steady: whether each point is; label: what the series is called.
    """

    label: str
    thickness: float
    parameters: FrictionMapParameters
    speed: Floats
    viscosity: Floats
    traction: Floats
    pressure: float
    mu: float
    steady: NDArray[np.bool_]


def _series(case: Case, load_steps: Iterable[dict[str, Any]], label: str = "") -> Series:
    contact = case.contact[0]
    assert isinstance(contact.friction, FrictionMap) and contact.film is not None
    speed, viscosity, tangential, normal, area, mu, steady = columns(
        sorted(load_steps, key=lambda load_step: abs(load_step["velocity"])),
        *("velocity", "effective_viscosity", "tangential_force", "normal_force"),
        *("contact_area", "mu", "steady"),
    )
    mean_pressure = float(np.mean(normal / area))
    thickness = contact.film.at(mean_pressure)
    return Series(
        label=label or f"D = {thickness * 1e9:g} nm",
        thickness=thickness,
        parameters=contact.friction.parameters(),
        speed=np.abs(speed),
        viscosity=viscosity,
        traction=np.abs(tangential) / area,
        pressure=mean_pressure,
        mu=float(np.mean(mu)),
        steady=steady.astype(bool),
    )


def draw_sweep(case: Case, directory: Path) -> None:
    """Draw the figures of a collated sweep.

    Raises:
        InputError: the directory holds no ``sweep.csv``.
    """
    rows = read_table(directory / "sweep.csv")
    figures = directory / "figures"
    parts = case.sweep_cases()
    with plt.rc_context(STYLE):
        laws = [single.contact[0] for _, single in parts]
        film = all(isinstance(c.friction, FrictionMap) for c in laws)
        series = [
            _series(single, steady, _series_label(case, label))
            for label, single in parts
            if film
            and (steady := [row for row in rows if row["label"] == label and row["steady"] >= 0])
        ]
        if series:
            _draw_film(series, figures)
        save(_sweep_ends(case, rows), figures / "sweep.png")


def _series_label(case: Case, label: str) -> str:
    """Name of a sweep's series: the swept value, or D where that is what is swept."""
    assert case.sweep is not None
    return "" if case.sweep.key.endswith("film.thickness") else label


def _sweep_ends(case: Case, rows: list[dict[str, Any]]) -> Figure:
    """Forces at the end of each run of the sweep."""
    assert case.sweep is not None
    last = {row["label"]: row for row in rows}
    figure, axes = plt.subplots(figsize=(6, 3.6))
    at = np.arange(len(last))
    normal, tangential = columns(list(last.values()), "normal_force", "tangential_force")
    axes.bar(at - 0.2, normal, 0.4, color=COLOURS[0], label="normal")
    axes.bar(at + 0.2, tangential, 0.4, color=COLOURS[1], label="tangential")
    axes.set_xticks(at, [label.split("=", 1)[-1] for label in last])
    axes.set_xlabel(case.sweep.key)
    axes.set_ylabel("force at the end of the run (N)")
    axes.legend()
    return figure


def _draw_film(series: list[Series], figures: Path) -> None:
    wet = [one for one in series if one.thickness > 0.0]  # D = 0 has no viscosity
    if wet:
        save(_viscosity_figure(wet), figures / "effective_viscosity.png")
    save(_map_figure(series), figures / "friction_map.png")


def _unsteady_words(series: list[Series]) -> str:
    """What to say of the grey crosses, where there are some."""
    return "" if all(one.steady.all() for one in series) else " (grey crosses: NOT steady)"


def _cross_out(axes: Axes, speed: Floats, value: Floats, steady: NDArray[np.bool_]) -> None:
    """Grey crosses over points that were not steady when they were taken."""
    axes.loglog(speed[~steady], value[~steady], "x", ms=11, mew=2, color="0.45", zorder=5)


def _curve_speeds(series: list[Series]) -> Floats:
    low = min(s.speed.min() for s in series)
    high = max(s.speed.max() for s in series)
    return np.geomspace(low / 1.5, high * 1.5, 2000)


def _broken(values: Floats, speed: Floats, at: float) -> Floats:
    """A curve with a gap where it jumps, so that no line is drawn across."""
    out = values.copy()
    jump = np.searchsorted(speed, at)
    if 0 < jump < len(speed):
        out[jump - 1] = np.nan
    return out


def _viscosity_figure(series: list[Series]) -> Figure:
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.6), sharey=True)
    speed = _curve_speeds(series)
    for number, one in enumerate(series):
        colour = COLOURS[number % len(COLOURS)]
        star = float(threshold_speed(one.thickness, one.parameters))
        curve = effective_viscosity(speed, one.thickness, one.pressure, one.mu, one.parameters)
        for axes, scale in ((left, 1.0), (right, 1.0 / one.thickness)):
            axes.loglog(speed * scale, _broken(curve, speed, star), color=colour, lw=1)
            axes.loglog(
                one.speed * scale,
                one.viscosity,
                MARKERS[number % len(MARKERS)],
                ms=max(9.0 - 1.5 * number, 3.0),  # points that coincide stay visible
                mfc="none" if number % 2 else colour,
                color=colour,
                label=one.label,
            )
            _cross_out(axes, one.speed * scale, one.viscosity, one.steady)
            if speed[0] < star < speed[-1] and one.thickness < one.parameters.D_max:
                axes.axvline(star * scale, color=colour, ls=":", lw=1)
    eta = series[0].parameters.eta_b
    for axes in (left, right):
        axes.axhline(eta, color="k", lw=0.8, ls="--", zorder=0)
    left.annotate(
        f"$\\eta_b$ = {eta:g} Pa s",
        (0.02, eta),
        xycoords=("axes fraction", "data"),
        xytext=(0, -8),
        textcoords="offset points",
        va="top",
        fontsize=8,
    )
    left.set_ylim(bottom=0.3 * eta)
    left.set_xlabel("sliding velocity V (m/s)")
    left.set_ylabel("effective viscosity $T D/(A V)$ (Pa s)")
    right.set_xlabel("shear rate V/D (1/s)")
    left.legend(frameon=True, framealpha=0.9, edgecolor="none")
    figure.suptitle(
        f"points: computed steady states{_unsteady_words(series)}; lines: closed form; dotted: V*",
        fontsize=9,
        y=0.95,
    )
    return figure


def _map_figure(series: list[Series]) -> Figure:
    figure, axes = plt.subplots(figsize=(6.6, 4.8))
    speed = _curve_speeds(series)
    for colour, one in zip(_colours(len(series)), series, strict=True):
        star = float(threshold_speed(one.thickness, one.parameters))
        curve = steady_traction(speed, one.thickness, one.pressure, one.mu, one.parameters)
        axes.loglog(speed, _broken(curve, speed, star) / 1e6, color=colour, lw=1)
        viscous = (one.speed > star) | (one.thickness >= one.parameters.D_max)
        for chosen, marker in ((~viscous, "o"), (viscous, "s")):
            axes.loglog(
                one.speed[chosen],
                one.traction[chosen] / 1e6,
                marker,
                ms=5,
                color=colour,
                mfc=colour if marker == "o" else "w",
            )
        axes.plot([], [], color=colour, label=one.label)
    axes.plot([], [], "o", color="0.4", label="frictional or mixed (V < V*)")
    axes.plot([], [], "s", color="0.4", mfc="w", label="viscous (V > V* or D ≥ D_max)")
    axes.set_xlabel("sliding velocity V (m/s)")
    axes.set_ylabel("friction F(V; D) per area (MPa)")
    axes.set_title(
        f"friction map: computed points{_unsteady_words(series)} on the closed form", fontsize=9
    )
    axes.legend(fontsize=8)
    return figure


def _colours(count: int) -> list[str]:
    return [COLOURS[i % len(COLOURS)] for i in range(count)]
