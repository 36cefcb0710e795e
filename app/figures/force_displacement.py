"""Force over displacement of what is moved: surfaces, platens, springs, rigid tools."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tribox.app.case.stage import solver_of
from tribox.app.figures.style import COLOURS, colour_of, dashes_of, panels_in, save
from tribox.app.figures.units import (
    DISPLACEMENT,
    MOMENT,
    REACTION,
    TIME,
    fitting,
    heading,
)
from tribox.app.results.reading import Table, joined

if TYPE_CHECKING:
    from tribox.app.results import Results

MOST_PANELS = 8
STILL = 1e-4  # of the largest displacement of all surfaces: what moves less is a support
IDLE = 1e-9  # of the largest force: what needs less moves freely, such as along a symmetry plane


@dataclass(frozen=True, slots=True)
class Curve:
    """What one panel shows.

    Attributes:
        surface: its name. x, y: columns of the table.
        x_label, y_label: without units; x_unit, y_unit: SI.
    """

    surface: str
    x: str
    y: str
    x_label: str
    y_label: str
    x_unit: str
    y_unit: str


def moved_parts(results: Results) -> Table:
    """Rows of the surfaces, and of tools with what drives them as the force on them.

    A tool that is released has no more to do with the body from there on: its curve ends.
    """
    tools = results.table("tools")
    if not len(tools):
        return results.table("surfaces")
    stages = [stage.name for stage in results.case.stage]
    for number, stage in enumerate(results.case.stage):
        for tool in results.case.tools.keys() & set(stage.release):
            tools = tools.rows((tools["tool"] != tool) | ~np.isin(tools["stage"], stages[number:]))
    driving = {f"driving_force_{i}": f"force_{i}" for i in "xyz" if f"force_{i}" in tools}
    names = driving | {"tool": "surface"}
    kept = {k: v for k, v in tools.columns.items() if k not in driving.values()}
    return joined(results.table("surfaces"), Table({names.get(k, k): v for k, v in kept.items()}))


def curves_of(results: Results, table: Table) -> list[Curve]:
    """What moves, each in the directions that it moves in; moments of what is turned."""
    if not len(table):
        return []
    letters = [i for i in "xyz" if f"displacement_{i}" in table]
    names = list(dict.fromkeys(table["surface"]))
    travel = {
        (name, i): float(np.ptp(table.where("surface", name)[f"displacement_{i}"]))
        for name in names
        for i in letters
    }
    largest = max(travel.values(), default=0.0)
    most = max((_largest(table, f"force_{i}") for i in letters), default=0.0)
    curves = [
        Curve(name, f"displacement_{i}", f"force_{i}",
              f"{DISPLACEMENT.name} {DISPLACEMENT.symbol}_{i}",
              f"{REACTION.name} {REACTION.symbol}_{i}", "m", "N")
        for (name, i), way in travel.items()
        if way > STILL * largest and _largest(table, f"force_{i}", name) > IDLE * most
    ]  # fmt: skip
    for boundary in results.case.boundary:
        turned = boundary.rotation
        if turned is not None and boundary.surface in names and f"moment_{turned.axis}" in table:
            about = f"{MOMENT.name} {MOMENT.symbol}_{turned.axis}"
            time = f"{TIME.name} {TIME.symbol}"
            curves.append(
                Curve(boundary.surface, "time", f"moment_{turned.axis}", time, about, "s", "N m")
            )
    for name, tool in results.case.tools.items():
        if tool.rotation is not None and tool.rotation.moment is None:
            labels = "rotation", f"driving {MOMENT.name}"
            curves.append(Curve(name, "rotation", "driving_moment", *labels, "rad", "N m"))
    return curves[:MOST_PANELS]


def _largest(table: Table, column: str, surface: str | None = None) -> float:
    """Largest amount in a column, of one surface or of all."""
    rows = table if surface is None else table.where("surface", surface)
    return float(np.max(np.abs(rows[column]), initial=0.0))


def force_displacement_figure(results: Results) -> Figure | None:
    """A panel for each moved surface or tool and direction, stages in colours; None without any."""
    table = moved_parts(results)
    curves = curves_of(results, table)
    if not curves:
        return None
    columns = min(len(curves), 2)
    rows = -(-len(curves) // columns)
    figure = Figure(figsize=(4.4 * columns + 0.4, 3.3 * rows + 0.5), layout="constrained")
    panels = panels_in(figure, rows, columns, len(curves))
    for axes, curve in zip(panels, curves, strict=False):
        _draw(axes, curve, table)
    handles, labels = panels[0].get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=8)
    words = "force of the surroundings on each moved surface or tool"
    figure.suptitle(heading(results, words), fontsize=9)
    return figure


def _draw(axes: Axes, curve: Curve, surfaces: Table) -> None:
    table = surfaces.where("surface", curve.surface)
    x_unit, y_unit = fitting(table[curve.x], curve.x_unit), fitting(table[curve.y], curve.y_unit)
    x, y = x_unit.of(table[curve.x]), y_unit.of(table[curve.y])
    stages = list(dict.fromkeys(table["stage"]))
    of = table["stage"]
    for number, stage in enumerate(stages):
        rows = np.flatnonzero(of == stage)
        # With the last point of the stage before, so that the curve has no gaps.
        rows = np.concatenate([rows[:1] - 1, rows]) if rows[0] else rows
        marker = "" if len(rows) > 40 else "."
        axes.plot(x[rows], y[rows], marker=marker, ls=dashes_of(number), ms=4, lw=1.1,
                  color=colour_of(number), label=str(stage))  # fmt: skip
    axes.set_title(curve.surface, fontsize=9)
    axes.set_xlabel(f"{curve.x_label} ({x_unit.name})")
    axes.set_ylabel(f"{curve.y_label} ({y_unit.name})")


# -- Figures of explicit runs: phase plots of sprung surfaces, histories of several runs overlaid


def draw_phases(results: Results, figures: Path) -> list[Path]:
    """A phase plot of each sprung surface, ``phase.png`` or, of several, ``phase-NAME.png``.

    Only explicit stages are shown: in the others nothing swings.
    """
    case, table = results.case, results.table("surfaces")
    sprung = [(b.surface, b.spring.direction) for b in case.boundary if b.spring is not None]
    stages = [
        stage.name for stage in case.stage if solver_of(stage, case.solver.kind) == "explicit"
    ]
    if not sprung or not len(table):
        return []
    files = []
    for surface, axis in sprung:
        rows = table.where("surface", surface).where("stage", *stages)
        if len(rows):
            picture = "phase.png" if len(sprung) == 1 else f"phase-{surface}_{axis}.png"
            files.append(figures / picture)
            figure = phase_figure(rows, surface, axis)
            figure.suptitle(case.title, fontsize=9)
            save(figure, files[-1])
    return files


def phase_figure(rows: Table, surface: str, axis: str) -> Figure:
    """The force on a sprung surface over time, and its velocity against that force."""
    time, force, speed = (rows[name] for name in ("time", f"force_{axis}", f"velocity_{axis}"))
    times, forces, speeds = fitting(np.ptp(time), "s"), fitting(force, "N"), fitting(speed, "m/s")
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(times.of(time - time[0]), forces.of(force), color=COLOURS[0], lw=1)
    named = f"{REACTION.name} of the spring on {surface}, {REACTION.symbol}_{axis} ({forces.name})"
    left.set_xlabel(f"{TIME.name} since the first explicit row ({times.name})")
    left.set_ylabel(named)
    right.plot(forces.of(force), speeds.of(speed), color=COLOURS[1], lw=0.8)
    right.set_xlabel(named)
    right.set_ylabel(f"velocity of {surface} in {axis} ({speeds.name})")
    return figure
