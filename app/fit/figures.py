"""Figure of tribometer data and the law fitted to them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tribox.app.figures.steady_points import film_numbers
from tribox.app.figures.style import CASE_STYLE, colour_of, marker_of, save, thin_log_ticks
from tribox.app.figures.symbols import LOCAL_RATIO, SLIP, TRACTION, VELOCITY, VISCOSITY
from tribox.app.fit.data import TribometerData
from tribox.app.fit.model import Parameters, friction
from tribox.app.fit.result import FitResult
from tribox.forms.closed_forms.homogeneous_sliding import threshold_speed
from tribox.forms.friction.coulomb import CoulombParameters
from tribox.forms.friction.parameters import FrictionMapParameters
from tribox.forms.friction.stribeck import StribeckParameters

Floats = NDArray[np.float64]

AXES = {
    "traction": TRACTION.label("kPa"),
    "force": TRACTION.label("kPa"),
    "friction_coefficient": LOCAL_RATIO.label(),
    "effective_viscosity": f"{VISCOSITY.name} {VISCOSITY.symbol} = T D/V ({VISCOSITY.unit})",
}
ONE_LEVEL = 1.1
"""Measured loads, or velocities, no further apart than by this factor are one in the figure."""
MOST_INSIDE = 6
"""Entries of a legend that still leave room for points and lines beside it."""
_NAMES: dict[type[Parameters], str] = {
    FrictionMapParameters: "friction map",
    StribeckParameters: "Stribeck law",
    CoulombParameters: "Coulomb law",
}


@dataclass(frozen=True, slots=True)
class _Group:
    """Rows that one line of the law goes through."""

    rows: NDArray[np.intp]
    thickness: float
    pressure: float
    velocity: float | None
    """m/s, for rows over slip."""
    label: str


def draw_fit(data: TribometerData, result: FitResult, figures: Path, name: str) -> None:
    """Draw ``fit.png``: data and law over velocity, or over slip, and the residuals.

    Args:
        data: measured friction.
        result: the law fitted to them.
        figures: directory of the figure.
        name: of the data, for the title.
    """
    kinds = [over for over in (True, False) if (data.steady == over).any()]
    with rc_context(CASE_STYLE):
        figure = Figure(figsize=(7.2 * len(kinds), 6.4))
        panels = figure.subplots(
            2, len(kinds), sharex="col", squeeze=False, height_ratios=[2.6, 1.0]
        )
        for column, steady in enumerate(kinds):
            _panel(panels[0, column], panels[1, column], data, result, steady)
        _title(figure, data, result, name)
        save(figure, figures / "fit.png")


def _title(figure: Figure, data: TribometerData, result: FitResult, name: str) -> None:
    text = f"{name}\n{len(data)} rows; lines: fitted {_NAMES[type(result.parameters)]}; "
    text += f"scatter {result.scatter:.2%}"
    if result.warnings:
        names = ", ".join(e.coordinate.name for e in result.estimates if e.warning)
        text += f"\nnot determined: {names}"
    figure.suptitle(text, fontsize=9, y=0.89, va="bottom")


def _panel(top: Axes, bottom: Axes, data: TribometerData, result: FitResult, steady: bool) -> None:
    residual = np.log(data.traction / result.traction)
    groups = list(_groups(data, steady))
    for (colour, marker), group in zip(_marks(groups, result.parameters), groups, strict=True):
        x = data.velocity[group.rows] if steady else data.slip[group.rows] * 1e6
        y = _shown(data, data.traction[group.rows], group.rows)
        top.plot(x, y, marker, ms=4.5, mfc="none", color=colour, label=group.label)
        bottom.plot(x, residual[group.rows], marker, ms=4, mfc="none", color=colour)
        _line(top, data, result.parameters, group, colour)
        if steady:
            _open_speeds(top, data, result, group, colour)
    _finish(top, bottom, data, steady)


def _marks(groups: Sequence[_Group], law: Parameters) -> list[tuple[str, str]]:
    """Colour and marker of each group: those of its film in other figures, where films differ."""
    films = [group.thickness for group in groups]
    if not isinstance(law, FrictionMapParameters) or len(set(films)) < len(films):
        return [(colour_of(k), marker_of(k)) for k in range(len(groups))]
    numbers = film_numbers([film for film in films if film > law.D_min], law)
    dry = ("0.45", "x")
    return [
        (colour_of(numbers[film]), marker_of(numbers[film])) if film in numbers else dry
        for film in films
    ]


def _finish(top: Axes, bottom: Axes, data: TribometerData, steady: bool) -> None:
    shown = _shown(data, data.traction, np.arange(len(data)))[data.steady]
    spans = bool(steady and shown.max() > 10.0 * shown.min())
    top.set_yscale("log" if spans else "linear")
    top.set_xscale("log" if steady else "linear")
    if not spans:
        top.set_ylim(bottom=0.0)
    top.set_ylabel(AXES[data.observed])
    aside = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
    place = aside if len(top.get_legend_handles_labels()[0]) > MOST_INSIDE else {}
    top.legend(fontsize=8, frameon=True, framealpha=0.9, edgecolor="none", **place)
    bottom.axhline(0.0, color="k", lw=0.8)
    bottom.set_ylabel("ln(data/law)")
    bottom.set_xlabel(VELOCITY.label() if steady else SLIP.label("µm"))
    largest = float(np.max(np.abs(bottom.get_ylim())))
    bottom.set_ylim(-largest, largest)
    thin_log_ticks(top)


def _groups(data: TribometerData, steady: bool) -> Iterator[_Group]:
    """Rows of one film and load, which scatters; over slip, of one velocity too."""
    chosen = np.flatnonzero(data.steady == steady)
    loads = _levels(data.pressure[chosen])
    speeds = np.zeros(len(chosen)) if steady else _levels(data.velocity[chosen])
    several_loads, several_speeds = (len(np.unique(one)) > 1 for one in (loads, speeds))
    keys = list(zip(data.thickness[chosen], loads, speeds, strict=True))
    for D, p, V in sorted(set(keys)):
        rows = chosen[[key == (D, p, V) for key in keys]]
        words = ["dry (D = 0)" if D <= 0.0 else f"D = {D * 1e9:g} nm"] * data.knows_film
        words += [f"p = {p / 1e6:.4g} MPa"] * several_loads
        words += [f"V = {V:.4g} m/s"] * several_speeds
        label = ", ".join(words) or "measured"
        yield _Group(rows, float(D), float(p), None if steady else float(V), label)


def _levels(values: Floats) -> Floats:
    """The mean of the measured values that were meant to be the same as each, (n,)."""
    known, which = np.unique(values, return_inverse=True)
    level = np.zeros(len(known), dtype=np.intp)
    first = known[0]
    for k, value in enumerate(known[1:], start=1):
        apart = value > ONE_LEVEL * first
        first = value if apart else first
        level[k] = level[k - 1] + apart
    member = level[which]
    means = [values[member == k].mean() for k in range(level[-1] + 1)]
    return np.asarray(means)[member]


def _line(
    axes: Axes, data: TribometerData, parameters: Parameters, group: _Group, colour: str
) -> None:
    """The fitted law through a group."""
    if group.velocity is None:
        V = data.velocity[group.rows]
        velocity = np.asarray(np.geomspace(V.min() / 1.3, V.max() * 1.3, 600), dtype=np.float64)
        slip: Floats = np.full(600, np.nan)
    else:
        slip = np.asarray(np.linspace(0.0, data.slip[group.rows].max() * 1.03, 601)[1:], np.float64)
        velocity = np.full(600, group.velocity)
    ones = np.ones(600)
    curve = TribometerData(
        thickness=group.thickness * ones, velocity=velocity, pressure=group.pressure * ones,
        traction=ones, slip=slip, weight=ones, observed=data.observed,
    )  # fmt: skip
    shown = _shown(curve, friction(parameters, curve), np.arange(600))
    if group.velocity is not None:
        axes.plot(slip * 1e6, shown, color=colour, lw=1)
        return
    if isinstance(parameters, FrictionMapParameters) and group.thickness < parameters.D_max:
        star = float(threshold_speed(group.thickness, parameters))  # No line across the fall there.
        shown[np.abs(velocity / star - 1.0) <= max(parameters.transition_width, 0.01)] = np.nan
    axes.plot(velocity, shown, color=colour, lw=1)


def _open_speeds(
    axes: Axes, data: TribometerData, result: FitResult, group: _Group, colour: str
) -> None:
    """The speeds at which a group's film may take over, where the data do not determine V*."""
    law = result.parameters
    star = next((e for e in result.estimates if e.coordinate.key in ("V_star", "gamma")), None)
    if not isinstance(law, FrictionMapParameters) or star is None or not star.warning:
        return
    if not law.D_min < group.thickness < law.D_max:
        return
    at = float(threshold_speed(group.thickness, law))
    power = 0.5 if star.coordinate.key == "gamma" else 1.0
    V = data.velocity[group.rows]
    low = V.min() / 1.3 if star.low is None else at * (star.low / star.value) ** power
    high = V.max() * 1.3 if star.high is None else at * (star.high / star.value) ** power
    film = f"{group.thickness * 1e9:g} nm"
    label = f"V* at {film}, not determined: 95 % interval"
    axes.axvspan(low, high, color=colour, alpha=0.12, lw=0, label=label)


def _shown(data: TribometerData, traction: Floats, rows: NDArray[np.intp]) -> Floats:
    """Traction in terms of what was observed."""
    if data.observed == "friction_coefficient":
        return np.asarray(traction / data.pressure[rows])
    if data.observed == "effective_viscosity":
        return np.asarray(traction * data.thickness[rows] / data.velocity[rows])
    return np.asarray(traction / 1e3)
