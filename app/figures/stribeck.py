"""Stribeck view of a run with velocities: F_T/N at the end of each over V, and over η_b V/p."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tribox.app.figures import style
from tribox.app.figures.history import spans_decades
from tribox.app.figures.steady_points import series_numbers
from tribox.app.figures.style import Floats, Unit
from tribox.forms.closed_forms import threshold_speed
from tribox.forms.friction.parameters import FrictionMapParameters

if TYPE_CHECKING:
    from tribox.app.case.case import Case
    from tribox.app.results import Results
    from tribox.app.results.reading import Table


@dataclass(frozen=True, slots=True)
class StribeckSeries:
    """Sliding at several velocities, of one pair or of all together."""

    label: str  # what it is called
    speed: Floats  # (n,), m/s, |V|, rising
    ratio: Floats  # (n,), F_T/N
    hersey: Floats  # (n,), m, η_b V/p with the mean pressure p; NaN without a film
    settled: NDArray[np.bool_]  # (n,) False where the velocity ended before the force was steady
    star: float = math.nan  # m/s, V* of the film, where friction jumps; NaN where it plays no part
    # its thickness, m, and its law, of the only pair of a run with a friction map
    film: tuple[float, FrictionMapParameters] | None = None
    # (n,) share of the load that asperities carry, where the film is an unknown; else None
    dry: Floats | None = None


def series_of(results: Results, label: str = "") -> list[StribeckSeries]:
    """The Stribeck points of a run: of each pair where there are several."""
    found = [one for pair in _unknown_films(results) for one in _film_series(results, label, pair)]
    if found:
        return found
    ends = results.table("load_steps")
    if "velocity" not in ends:
        return []
    ends = ends.rows(ends["velocity"] != 0.0)
    if len(np.unique(np.abs(ends["velocity"]))) < 2:
        return []
    # −1, or no number, is a velocity that was held for a time, not until anything is steady.
    settled = np.array([value not in (False, 0) for value in ends["steady"]])
    contacts = results.table("contacts")
    names = list(dict.fromkeys(contacts["pair"])) if len(contacts) else []
    if len(names) < 2:
        one = _series(label, ends, ends["velocity"], settled, results.case, 0)
        return [replace(one, film=_film(results.case, ends))]
    found = []
    for number, name in enumerate(names):
        own = contacts.where("pair", name)
        place = {step: row for row, step in enumerate(own["step"].tolist())}
        there = np.isin(ends["step"], own["step"])
        rows = own.rows(np.array([place[step] for step in ends["step"][there].tolist()], np.int64))
        words = f"{label}, {name}" if label else str(name)
        speeds, own_settled = ends["velocity"][there], settled[there]
        found.append(_series(words, rows, speeds, own_settled, results.case, number))
    return found


def _unknown_films(results: Results) -> list[int]:
    """Numbers of the pairs whose film is found."""
    pairs = enumerate(results.case.contact)
    return [n for n, one in pairs if one.film is not None and one.film.is_unknown]


def _film_series(results: Results, label: str, pair: int) -> list[StribeckSeries]:
    """A pair whose film is found, at the end of each stage that it slides in and load step.

    Its slip speed is that of the surfaces, whatever drives them.
    """
    contacts, name = results.table("contacts"), style.pair_names(results)[pair]
    if not len(contacts):
        return []
    rows = contacts.where("pair", name)
    load_steps = results.table("load_steps")
    ends = {step for _, step in style.stage_ends(results)}
    unsettled: set[int] = set()
    if "steady" in load_steps:
        ends |= set(map(int, load_steps["step"]))
        unsettled = set(map(int, load_steps["step"][load_steps["steady"] == 0.0]))
    taken = np.isin(rows["step"], list(ends)) & (rows["slip_speed"] > 0.0)
    rows = rows.rows(taken & (rows["normal_force"] > 0.0))
    if len(np.unique(rows["slip_speed"])) < 2:
        return []
    words = " ".join(
        part for part in (label, name if len(_unknown_films(results)) > 1 else "") if part
    )
    settled = ~np.isin(rows["step"], list(unsettled))
    one = _series(words, rows, rows["slip_speed"], settled, results.case, pair)
    order = np.argsort(np.abs(rows["slip_speed"]), kind="stable")
    return [replace(one, dry=(rows["asperity_force"] / rows["normal_force"])[order])]


def _film(case: Case, ends: Table) -> tuple[float, FrictionMapParameters] | None:
    """Film thickness (m) at the mean pressure of the ends of load steps, and the law, if any."""
    pressed = ends.rows(ends["normal_force"] > 0.0)
    if len(case.contact) != 1 or not len(pressed):
        return None
    contact = case.contact[0]
    law = contact.map
    if law is None or contact.film is None:
        return None
    film = contact.film.at(float(np.mean(pressed["normal_force"] / pressed["contact_area"])))
    return (film, law) if film > law.D_min else None


def _numbers(series: list[StribeckSeries]) -> list[int]:
    """Which colour, marker and dashes each has: its film's, where all differ by their film."""
    law = next((one.film[1] for one in series if one.film is not None), None)
    return series_numbers([one.film and one.film[0] for one in series], law)


def _viscosity(case: Case, pair: int) -> float:
    """η_b of a pair, Pa s; NaN without a film."""
    contact = case.contact[pair]
    film = contact.film
    if film is not None and film.is_unknown and film.eta_b is not None:
        return film.eta_b
    return np.nan if contact.map is None or film is None else contact.map.eta_b


def _threshold(case: Case, pair: int, pressure: float) -> float:
    """V* of a pair's film at a mean pressure, m/s; NaN where friction does not jump."""
    contact = case.contact[pair]
    law = contact.map
    if law is None or contact.given_film is None:
        return math.nan
    film = contact.given_film.at(pressure)
    return float(threshold_speed(film, law)) if law.D_min < film < law.D_max else math.nan


def _series(
    label: str, rows: Table, velocity: Floats, settled: NDArray[np.bool_], case: Case, pair: int
) -> StribeckSeries:
    speed, normal = np.abs(velocity), rows["normal_force"]
    friction, area = rows["friction_force"], rows["contact_area"]
    order, viscosity = np.argsort(speed, kind="stable"), _viscosity(case, pair)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(normal > 0.0, friction / normal, np.nan)
        hersey = np.where(normal > 0.0, viscosity * speed * area / normal, np.nan)
    pressed = normal > 0.0
    pressure = float(np.mean(normal[pressed] / area[pressed])) if pressed.any() else 0.0
    star = _threshold(case, pair, pressure)
    points = speed[order], ratio[order], hersey[order], settled[order]
    return StribeckSeries(label, *points, star=star)


def stribeck_figure(series: list[StribeckSeries], case: str = "") -> Figure | None:
    """Friction over velocity and, with a film, over the Hersey length; None without velocities."""
    if not series:
        return None
    film = any(np.isfinite(one.hersey).any() for one in series)
    shared = any(one.dry is not None for one in series)
    figure = Figure(figsize=(10.0 if film else 6.0, 6.6 if shared else 4.6), layout="constrained")
    rows = figure.subplots(
        1 + shared, 1 + film, sharey="row", sharex="col", squeeze=False,
        height_ratios=[2.0, 1.0] if shared else None,
    )  # fmt: skip
    panels = rows[0]
    speeds = style.velocity_unit(np.concatenate([one.speed for one in series]))
    _draw(panels[0], series, [speeds.of(one.speed) for one in series])
    panels[0].set_xlabel(style.VELOCITY.label(speeds.name))
    panels[0].set_ylabel(style.RATIO.label())
    if film:
        lengths = style.fitting(np.concatenate([one.hersey for one in series]), "m")
        _draw(panels[1], series, [lengths.of(one.hersey) for one in series])
        panels[1].set_xlabel(f"{style.HERSEY.label(lengths.name)}, p = N/A")
    for column, axes in enumerate(rows[1] if shared else ()):
        _draw_shares(axes, series, speeds if column == 0 else lengths, column == 0)
        axes.set_xlabel(panels[column].get_xlabel())
        panels[column].set_xlabel("")
    if shared:
        rows[1][0].set_ylabel("load on asperities (-)")
    unsteady = not all(one.settled.all() for one in series)
    words = f"; {style.CROSSES}" if unsteady else ""
    if any(len(_parts(one)) > 1 for one in series):
        words += "; lines end where V* lies between two points"
    figure.suptitle(style.titled(case, f"friction at the end of each velocity{words}"), fontsize=9)
    if len(series) > 1:
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center",
                      fontsize=8)  # fmt: skip
    return figure


def _draw_shares(axes: Axes, series: list[StribeckSeries], unit: Unit, speed: bool) -> None:
    """What asperities carry of the load, over velocity (``speed``) or Hersey's length."""
    for number, one in zip(_numbers(series), series, strict=True):
        if one.dry is not None:
            x = unit.of(one.speed if speed else one.hersey)
            axes.plot(x, one.dry, **style.look_of(number), lw=0.8, ms=4)
    axes.set_ylim(-0.03, 1.03)


def _parts(one: StribeckSeries) -> list[slice]:
    """The points of a series below V*, and those above: between them friction jumps."""
    jump, count = int(np.searchsorted(one.speed, one.star)), len(one.speed)
    return [slice(0, jump), slice(jump, count)] if 0 < jump < count else [slice(0, count)]


def _draw(axes: Axes, series: list[StribeckSeries], places: list[Floats]) -> None:
    axes.set_xscale("log")
    for number, one, x in zip(_numbers(series), series, places, strict=True):
        for part in _parts(one):
            label = one.label if part.start == 0 else ""
            axes.plot(x[part], one.ratio[part], **style.look_of(number), lw=0.8, ms=5, label=label)
        style.cross_out(axes, x, one.ratio, ~one.settled)
    ratios = np.concatenate([one.ratio for one in series])
    if spans_decades(ratios):
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0.0)
    style.thin_log_ticks(axes)
