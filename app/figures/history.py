"""Figures of the history of a run: forces and their ratio, and energies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tribox.app.figures.abscissa import abscissa_of
from tribox.app.figures.names import heading
from tribox.app.figures.style import COLOURS, FILLS, RED, Floats, Longs, thin_log_ticks
from tribox.app.figures.symbols import ENERGY, FRICTION_FORCE, NORMAL_FORCE, RATIO
from tribox.app.figures.units import Unit, fitting

if TYPE_CHECKING:
    from tribox.app.results import Results
    from tribox.app.results.table import Table

MOST_PAIRS = 12  # with a line of their own
DECADES = 100.0  # largest over smallest value from which on an axis is logarithmic
NOUGHT = 1e-6  # of the largest: smaller normal forces are no contact yet
LEAST = 1e-10  # of the largest: smaller friction is rounding


def forces_figure(results: Results) -> Figure:
    """Normal force, friction force and their ratio, of each pair where there are several."""
    history = results.table("history")
    at = abscissa_of(results)
    count = 3 if history["friction_force"].any() else 1  # without friction it has no panels
    figure = Figure(figsize=(7.5, 1.4 + 2.0 * count), layout="constrained")
    panels = list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    forces = fitting(history["normal_force"], "N"), fitting(history["friction_force"], "N")
    lines = list(_lines(results))
    for label, colour, width, rows, table in lines:
        x = at.values[rows]
        normal, friction = table["normal_force"], table["friction_force"]
        shown = forces[0].of(normal), forces[1].of(friction), _over(friction, normal)
        style: dict[str, Any] = {"color": colour, "lw": width, "label": label}
        style |= {"marker": "."} if len(x) < 3 else {}
        for axes, values in zip(panels, shown, strict=False):
            axes.plot(x, values, **style)
    if len(lines) == 1:  # added up over several pairs it acts nowhere
        _draw_resultant(panels[1:2], at.values, history, forces[1])
    units = (*forces, Unit(0, ""))
    for axes, quantity, unit in zip(
        panels, (NORMAL_FORCE, FRICTION_FORCE, RATIO), units, strict=False
    ):
        axes.set_ylabel(quantity.label(unit.name))
    _fit_scales(panels, history)
    for axes in panels:
        at.mark(axes, named=axes is panels[0])
    panels[-1].set_xlabel(at.label)
    figure.suptitle(results.case.title, fontsize=9)
    handles, labels = panels[min(1, count - 1)].get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 3),
                      fontsize=8)  # fmt: skip
    return figure


def _lines(results: Results) -> Iterator[tuple[str, str, float, Longs, Table]]:
    """Label, colour, width, rows of the history and table of each line.

    Of several pairs all together, then each; of one pair alone the history.
    """
    history = results.table("history")
    contacts = results.table("contacts")
    names = list(dict.fromkeys(contacts["pair"])) if len(contacts) else []
    whole = np.arange(len(history)), history
    if len(names) < 2:
        yield (str(names[0]) if names else "contact", COLOURS[0], 1.4, *whole)
        return
    yield ("all pairs", "0.25", 1.4, *whole)
    place = {int(step): k for k, step in enumerate(history["step"])}
    for number, name in enumerate(names[:MOST_PAIRS]):
        table = contacts.where("pair", name).where("step", *place)
        rows = np.array([place[int(step)] for step in table["step"]], dtype=np.int64)
        yield (str(name), COLOURS[number % len(COLOURS)], 1.1, rows, table)


def _over(friction: Floats, normal: Floats) -> Floats:
    """Ratio (n,) of two forces; NaN where the normal force is as good as none."""
    least = NOUGHT * float(np.max(np.abs(normal), initial=0.0))
    out = np.full(len(normal), np.nan)
    pressed = normal > least
    out[pressed] = friction[pressed] / normal[pressed]
    return out


def _draw_resultant(panels: Sequence[Axes], at: Floats, history: Table, unit: Unit) -> None:
    """The signed resultant of the friction, where it says more than the sum of its amounts."""
    if "tangential_force" not in history:
        return
    signed, whole = history["tangential_force"], history["friction_force"]
    largest = float(np.max(whole, initial=0.0))
    unlike = np.abs(np.abs(signed) - whole) > 0.02 * largest
    if unlike.any() or (signed < -NOUGHT * largest).any():
        label = "resultant of the friction, signed"
        for axes in panels:
            axes.plot(at, unit.of(signed), color="0.55", lw=0.9, ls="--", label=label)


def _fit_scales(panels: Sequence[Axes], history: Table) -> None:
    """Friction on logarithmic scales where it spans decades while surfaces are driven."""
    log = spans_decades(history["friction_force"][np.abs(history["velocity"]) > 0.0])
    for axes in panels:
        values = np.concatenate([np.asarray(line.get_ydata(), np.float64) for line in axes.lines])
        values = values[np.isfinite(values)]
        largest = float(np.max(np.abs(values), initial=0.0))
        if log and axes is not panels[0]:
            axes.set_yscale("log")
            axes.set_ylim(bottom=max(values[values > LEAST * largest].min() / 2.0, 0.0))
            thin_log_ticks(axes)
        elif not (values < -NOUGHT * largest).any():
            axes.set_ylim(bottom=0.0)


def spans_decades(values: Floats) -> bool:
    """Whether positive values span decades, leaving out a tenth of them at either end."""
    found = values[np.isfinite(values) & (values > 0.0)]
    if len(found) < 3:
        return bool(len(found) == 2 and found.max() > DECADES * found.min())
    low, high = np.quantile(found, [0.1, 0.9])
    return bool(high > DECADES * low)


def energies_figure(results: Results) -> Figure:
    """Where the work of the run went; from nothing on, unless bodies moved at the beginning."""
    figure = Figure(figsize=(7, 4.4), layout="constrained")
    axes = figure.subplots()
    at, table = abscissa_of(results), results.table("history")
    parts, error = _energies(table)
    supplied = np.sum(list(parts.values()), axis=0) + error
    largest = float(np.max(np.abs(supplied))) or 1.0
    apart = np.abs(supplied - table["external_work"])
    moving_first = bool(apart.max() > 1e-9 * largest)
    first = [] if moving_first else [0.0]
    x = np.concatenate([[at.begin] * len(first), at.values])
    unit = fitting(supplied, "J")

    def whole(values: Floats) -> Floats:
        return unit.of(np.concatenate([first, values]))

    name = "external work" + " and initial kinetic energy" * moving_first
    axes.plot(x, whole(supplied), color="k", lw=2.5, alpha=0.35, label=name)
    axes.stackplot(x, *map(whole, parts.values()), labels=list(parts), colors=FILLS, alpha=0.6)
    axes.plot(x, whole(error), color=RED, lw=1, label="not accounted for")
    at.mark(axes, named=True)
    gap = float(np.max(np.abs(error))) / largest
    words = f"largest gap between work and its uses: {gap:.1e} of the work"
    figure.suptitle(heading(results, words), fontsize=9)
    axes.set_xlabel(at.label)
    axes.set_ylabel(ENERGY.label(unit.name))
    figure.legend(loc="outside lower center", ncols=4, fontsize=8)
    return figure


def _energies(table: Table) -> tuple[dict[str, Floats], Floats]:
    """What the work went into, J, by name, and what is not accounted for; each (n,)."""
    column = table.columns
    flow = column.get("plastic_dissipation", 0.0)  # results of before there was any have none
    parts = {
        "strain": column["strain_energy"],
        "interface": column["interface_energy"],
        "dissipated": column["dissipation"] + flow - column["numerical_dissipation"],
    }
    more = {"kinetic": column["kinetic_energy"], "damped": column["damping_dissipation"]}
    return parts | {name: part for name, part in more.items() if part.any()}, column["energy_error"]
