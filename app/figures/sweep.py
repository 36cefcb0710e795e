"""Figure of a sweep: forces at the end of each stage or velocity over the swept value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tribox.app.case.quantities import QuantityError, split_quantity
from tribox.app.figures import style
from tribox.app.figures.history import DECADES, LEAST, NOUGHT, spans_decades
from tribox.app.figures.style import Floats, Quantity, Unit

if TYPE_CHECKING:
    from tribox.app.results import Results

MOST_LINES = 8
MOST_TICKS = 10  # values that have a tick each on a logarithmic axis


@dataclass(frozen=True, slots=True)
class SweptValues:
    """Where the values of a sweep stand on its axis."""

    places: dict[str, float]  # by the label of each run
    label: str  # of the axis
    texts: tuple[str, ...] = ()  # ticks of values that are no numbers; empty for numbers

    @property
    def is_log(self) -> bool:
        """Whether the axis is logarithmic: positive numbers over more than a decade."""
        found = list(self.places.values())
        return not self.texts and min(found) > 0.0 and max(found) > 10.0 * min(found)


def swept_values(key: str, labels: Sequence[str], values: Sequence[object]) -> SweptValues:
    """Values of a sweep as numbers in one unit, where they are; else one place after the other."""
    try:
        split = [split_quantity(value) for value in values]
        unit = next((u for _, u in split if u), "")
        numbers = [_in_unit(number, u, unit) for number, u in split]
    except QuantityError:
        texts = tuple(label.split("=", 1)[-1] for label in labels)
        return SweptValues(
            dict(zip(labels, map(float, range(len(labels))), strict=True)), key, texts
        )
    shown = f"{key} ({unit})" if unit else key
    return SweptValues(dict(zip(labels, numbers, strict=True)), shown)


def _in_unit(number: float, given: str, unit: str) -> float:
    """A number in another unit; plain numbers among quantities are SI, which is no one unit."""
    from tribox.app.case.quantities import parse_quantity

    if given == unit:
        return number
    if not given:
        raise QuantityError("values with and without a unit")
    return number * parse_quantity(f"1 {given}", unit)


@dataclass(frozen=True, slots=True)
class SweepLine:
    """The same stage or velocity of all runs."""

    label: str  # of it
    places: Floats  # (n,) on the axis
    normal: Floats  # (n,), N
    friction: Floats  # (n,), N
    unsettled: Any  # (n,) whether it ended before the force was steady


def sweep_lines(results: Results, swept: SweptValues) -> list[SweepLine]:
    """One line for each stage or velocity that at least one run has come to."""
    table = results.table("sweep").where("label", *swept.places)
    lines, unit = [], style.unit_of_velocity(results)
    for stage, velocity in dict.fromkeys(zip(table["stage"], table["velocity"], strict=True)):
        rows = table.where("stage", stage).where("velocity", velocity)
        at = np.array([swept.places[label] for label in rows["label"]])
        order = np.argsort(at, kind="stable")
        speed = style.velocity_text(velocity, unit)
        name = f"{stage}, {speed}" if velocity else str(stage)
        normal, friction, steady = (
            rows[column][order] for column in ("normal_force", "friction_force", "steady")
        )
        lines.append(SweepLine(name, at[order], normal, friction, steady == 0))
    return lines


def _chosen(lines: list[SweepLine]) -> list[SweepLine]:
    """At most so many lines that they can be told apart, evenly; the first and the last stay."""
    if len(lines) <= MOST_LINES:
        return lines
    kept = np.unique(np.rint(np.linspace(0, len(lines) - 1, MOST_LINES)).astype(int))
    return [lines[k] for k in kept]


def sweep_figure(results: Results) -> Figure | None:
    """Normal force, friction force and their ratio over the swept value; None without any row."""
    sweep = results.case.sweep
    if sweep is None or not len(results.table("sweep")):
        return None
    swept = swept_values(sweep.key, sweep.labels, sweep.values)
    found = sweep_lines(results, swept)
    if not found:
        return None
    lines = _chosen(found)
    figure = Figure(figsize=(8.2, 7.4), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    units = (
        style.fitting(np.concatenate([line.normal for line in lines]), "N"),
        style.fitting(np.concatenate([line.friction for line in lines]), "N"),
        Unit(0, ""),
    )
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(lines)))
    for number, line in enumerate(lines):
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(line.normal > 0.0, line.friction / line.normal, np.nan)
        for axes, unit, values in zip(
            panels, units, (line.normal, line.friction, ratio), strict=True
        ):
            _draw(axes, swept, line, unit.of(_whole(values)), colours[number], number)
    for axes, unit, quantity in zip(
        panels, units, (style.NORMAL_FORCE, style.FRICTION_FORCE, style.RATIO), strict=True
    ):
        axes.set_ylabel(quantity.label(unit.name))
        _scales(axes, swept)
    panels[-1].set_xlabel(swept.label)
    words = "" if len(lines) == len(found) else f" ({len(lines)} of {len(found)} shown)"
    crosses = f"; {style.CROSSES}" * any(line.unsettled.any() for line in lines)
    title = f"at the end of each stage or velocity{words}{crosses}"
    figure.suptitle(f"{results.case.title}\n{title}".strip(), fontsize=9)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    return figure


@dataclass(frozen=True, slots=True)
class Compared:
    """One quantity in each run: of pairs and tools at its largest, of probes in the end."""

    quantity: Quantity  # its name and SI unit
    lines: dict[str, tuple[Floats, Floats]]  # (n,) of each name, on the axis and in SI


_COMPARED = (
    ("pair", Quantity("normal force of pairs", "N", "N"), ("normal_force",)),
    ("pair", Quantity("friction force of pairs", "F_T", "N"), ("friction_force",)),
    ("tool", Quantity("force on tools", "|R|", "N"), ("force_x", "force_y", "force_z")),
    ("tool", Quantity("moment on tools", "|M|", "N m"), ("moment_x", "moment_y", "moment_z")),
    ("probe", Quantity("bend angle", "", "°"), ("bend_angle",)),
    ("probe", Quantity("springback", "", "°"), ("springback",)),
    ("probe", Quantity("least thickness", "", "m"), ("min_thickness",)),
)


def compared(results: Results, swept: SweptValues) -> list[Compared]:
    """What pairs, tools and probes gave at the ends of load steps in each run of a sweep."""
    table = results.table("sweep_details")
    if not len(table):
        return []
    table = table.where("label", *swept.places)
    found = []
    for kind, quantity, names in _COMPARED:
        rows, there = table.where("kind", kind), [name for name in names if name in table]
        if not len(rows) or not there:
            continue
        lines = {}
        for name, own in rows.parts("name"):
            values = np.stack([own[part] for part in there], axis=1)
            squares: Floats = np.nansum(values**2, axis=1)
            size: Floats = values[:, 0] if len(names) == 1 else np.sqrt(squares)
            size = np.degrees(size) if quantity.unit == "°" else size
            order = sorted(dict.fromkeys(own["label"]), key=lambda label: swept.places[label])
            runs = [size[own["label"] == label] for label in order]
            # A tool that has gone back carries nothing; a shape is what is left in the end.
            ends = [run[-1] if kind == "probe" else run[np.argmax(np.abs(run))] for run in runs]
            places = np.array([swept.places[label] for label in order])
            lines[str(name)] = (places, np.array(ends))
        largest = max(float(np.nanmax(np.abs(y), initial=0.0)) for _, y in lines.values())
        # what is as good as nothing beside it, such as a free moment, is drawn so
        if largest > 0.0:
            for name, (x, y) in lines.items():
                lines[name] = (x, np.where(np.abs(y) > NOUGHT * largest, y, 0.0 * y))
            found.append(Compared(quantity, lines))
    return found


def comparison_figure(results: Results) -> Figure | None:
    """Forces of pairs and tools, springback and thickness over the swept value; None without."""
    sweep = results.case.sweep
    if sweep is None or not len(results.table("sweep_details")):
        return None
    swept = swept_values(sweep.key, sweep.labels, sweep.values)
    found = compared(results, swept)
    if not found:
        return None
    columns = min(len(found), 2)
    rows = -(-len(found) // columns)
    figure = Figure(figsize=(4.6 * columns + 0.4, 3.0 * rows + 0.7), layout="constrained")
    panels = style.panels_in(figure, rows, columns, len(found))
    for axes, one in zip(panels, found, strict=False):
        unit = style.fitting(np.concatenate([y for _, y in one.lines.values()]), one.quantity.unit)
        for number, (name, (x, y)) in enumerate(one.lines.items()):
            look = style.look_of(number) | ({"ls": "none"} if swept.texts else {})
            axes.plot(x, unit.of(y), **look, lw=0.9, ms=5, label=name)
        axes.set_ylabel(one.quantity.label(unit.name))
        _scales(axes, swept, from_zero=one.quantity.unit in ("N", "N m"))
        axes.set_xlabel(swept.label)
        axes.legend(fontsize=8)
    words = "forces: largest at the end of a load step; angles and thickness: at the end of the run"
    figure.suptitle(style.heading(results, words), fontsize=9)
    return figure


def _whole(values: Floats) -> Floats:
    """Values without those that are rounding beside the largest of them all."""
    least = LEAST * float(np.nanmax(np.abs(values), initial=0.0))
    return np.where(np.abs(values) > least, values, np.nan)


def _draw(
    axes: Axes, swept: SweptValues, line: SweepLine, values: Floats, colour: Any, number: int
) -> None:
    joined = "none" if swept.texts else "-"
    axes.plot(line.places, values, marker=style.marker_of(number), ls=joined, lw=0.9, ms=5,
              color=colour, mfc="none" if number % 2 else colour, label=line.label)  # fmt: skip
    style.cross_out(axes, line.places, values, line.unsettled)


def _scales(axes: Axes, swept: SweptValues, *, from_zero: bool = True) -> None:
    """Logarithmic where values span decades; ticks at the values, or their words."""
    values = np.concatenate([np.asarray(line.get_ydata(), np.float64) for line in axes.lines])
    found = values[np.isfinite(values)]
    positive = found[found > 0.0]
    if spans_decades(found) or (len(positive) and positive.max() > DECADES * positive.min()):
        axes.set_yscale("log")
    elif len(found) and from_zero:
        low, high = 1.08 * float(found.min()), 1.08 * float(found.max())
        axes.set_ylim(min(0.0, low), max(0.0, high) or (0.0 if low < 0.0 else 1.0))
    elif len(found):
        axes.margins(y=0.2)
    if swept.is_log:
        axes.set_xscale("log")
    style.thin_log_ticks(axes)
    places = sorted(set(swept.places.values()))
    if swept.texts:
        axes.set_xticks(places, swept.texts)
        axes.margins(x=0.15)
    elif swept.is_log and len(places) <= MOST_TICKS:
        axes.set_xticks(places, [f"{place:g}" for place in places])
