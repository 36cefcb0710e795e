"""Figures of the history of a run: forces and their ratio, and energies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tribox.app.case.stage import solver_of
from tribox.app.figures import style
from tribox.app.figures.style import Floats, Longs, Unit, fitting
from tribox.app.results.reading import Table, joined

if TYPE_CHECKING:
    from tribox.app.results import Results


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
    forces = (fitting(history["normal_force"], "N"), fitting(history["friction_force"], "N"))
    lines = list(_lines(results))
    for label, colour, width, rows, table in lines:
        x = at.values[rows]
        normal, friction = table["normal_force"], table["friction_force"]
        pressed = normal > NOUGHT * float(np.max(np.abs(normal), initial=0.0))
        # Before there is a contact the ratio would be one of two round-offs.
        ratio = np.full(len(normal), np.nan)
        ratio[pressed] = friction[pressed] / normal[pressed]
        shown = forces[0].of(normal), forces[1].of(friction), ratio
        look: dict[str, Any] = {"color": colour, "lw": width, "label": label}
        look |= {"marker": "."} if len(x) < 3 else {}
        for axes, values in zip(panels, shown, strict=False):
            axes.plot(x, values, **look)
    if len(lines) == 1:  # added up over several pairs it acts nowhere
        _draw_resultant(panels[1:2], at.values, history, forces[1])
    units = (*forces, Unit(0, ""))
    for axes, quantity, unit in zip(
        panels, (style.NORMAL_FORCE, style.FRICTION_FORCE, style.RATIO), units, strict=False
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

    Of several pairs that ever press all together, then each; of one pair alone the history.
    """
    history = results.table("history")
    contacts = results.table("contacts")
    names: list[str] = []
    if len(contacts):
        names = list(dict.fromkeys(contacts["pair"][contacts["normal_force"] != 0.0]))
    whole = np.arange(len(history)), history
    if len(names) < 2:
        yield (str(names[0]) if names else "contact", style.COLOURS[0], 1.4, *whole)
        return
    yield ("all pairs", "0.25", 1.4, *whole)
    place = {int(step): k for k, step in enumerate(history["step"])}
    for number, name in enumerate(names[:MOST_PAIRS]):
        table = contacts.where("pair", name).where("step", *place)
        rows = np.array([place[int(step)] for step in table["step"]], dtype=np.int64)
        yield (str(name), style.COLOURS[number % len(style.COLOURS)], 1.1, rows, table)


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
            style.thin_log_ticks(axes)
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
    # What the parts and the gap add up to: beyond external work, the energy of first velocities.
    supplied = np.sum(list(parts.values()), axis=0) + error
    largest = float(np.max(np.abs(supplied))) or 1.0
    moving_first = bool(np.abs(supplied - table["external_work"]).max() > 1e-9 * largest)
    first = [] if moving_first else [0.0]
    x = np.concatenate([[at.begin] * len(first), at.values])
    unit = fitting(supplied, "J")

    def whole(values: Floats) -> Floats:
        return unit.of(np.concatenate([first, values]))

    name = "external work" + " and initial kinetic energy" * moving_first
    axes.plot(x, whole(supplied), color="k", lw=2.5, alpha=0.35, label=name)
    axes.stackplot(
        x, *map(whole, parts.values()), labels=list(parts), colors=style.FILLS, alpha=0.6
    )
    axes.plot(x, whole(error), color=style.RED, lw=1, label="not accounted for")
    at.mark(axes, named=True)
    gap = float(np.max(np.abs(error))) / largest
    words = f"largest gap between work and its uses: {gap:.1e} of the work"
    figure.suptitle(style.heading(results, words), fontsize=9)
    axes.set_xlabel(at.label)
    axes.set_ylabel(style.ENERGY.label(unit.name))
    figure.legend(loc="outside lower center", ncols=4, fontsize=8)
    return figure


def _energies(table: Table) -> tuple[dict[str, Floats], Floats]:
    """What the work went into, J, by name, and what is not accounted for; each (n,)."""
    column = table.columns
    # Results of before there was any have no such columns.
    flow = sum(column.get(f"{kind}_dissipation", 0.0) for kind in ("plastic", "viscous"))
    parts = {
        "strain": column["strain_energy"],
        "interface": column["interface_energy"],
        "dissipated": column["dissipation"] + flow - column["numerical_dissipation"],
    }
    more = {"kinetic": column["kinetic_energy"], "damped": column["damping_dissipation"]}
    return parts | {name: part for name, part in more.items() if part.any()}, column["energy_error"]


# -- What the figures of a history are drawn over: time, the path of the driven surface, or steps

# Time per step of one stage over that of another from which on time would hide one of them.
UNEVEN = 30.0
SQUEEZED = 0.05  # of the rest of the axis, for stages that are not to scale
STILL = 1e-9  # of the whole path: a surface that has moved by less is not driven yet
NAMES_APART = 0.035  # of the axis


@dataclass(frozen=True, slots=True)
class Abscissa:
    """Places of the rows of a history."""

    values: Floats  # (n,), in the unit of the label, one for each row
    label: str  # of the axis
    starts: tuple[tuple[float, str], ...]  # (value, name) where each stage or velocity begins

    @property
    def begin(self) -> float:
        """Where the run begins, before its first row."""
        return _begin(self.values)

    def mark(self, axes: Axes, *, named: bool) -> None:
        """A line where each stage or velocity begins, and its name above the axes.

        Of names that would overlap, that of the longer stage stands; one stage alone has none.
        """
        if len(self.starts) < 2:
            return
        for place, _ in self.starts:
            axes.axvline(place, color="0.8", lw=0.8, zorder=0)
        apart = NAMES_APART * float(np.ptp([*self.values, *(p for p, _ in self.starts)]) or 1.0)
        ends = [*(place for place, _ in self.starts[1:]), float(self.values[-1])]
        lengths = [end - place for end, (place, _) in zip(ends, self.starts, strict=True)]
        shown: list[float] = []
        for k in np.argsort(lengths, kind="stable")[::-1]:
            place, name = self.starts[k]
            if not named or any(abs(place - other) < apart for other in shown):
                continue
            shown.append(place)
            axes.annotate(
                name, (place, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 3),
                textcoords="offset points", fontsize=7, color="0.35", rotation=45,
            )  # fmt: skip


def _begin(values: Floats) -> float:
    """Where a run begins, whose first row need not stand beyond 0."""
    first = float(values[0])
    return 0.0 if first > 0.0 else 2.0 * first - float(values[min(1, len(values) - 1)])


def abscissa_of(results: Results) -> Abscissa:
    """What the history of a run is drawn over.

    The path of the driven surface, where velocities are held until steady: time at the slowest
    would hide that at all others; stages before it stand to its left. Else time; but where the
    stages differ so much in time per step that one could not be seen, time without the stages that
    it has no effect in, or steps.
    """
    history = results.table("history")
    time, driven = history["time"], history["driven_displacement"]
    path = np.cumsum(np.abs(np.diff(driven, prepend=0.0)))
    if any(stage.velocities for stage in results.case.stage) and path[-1] > 0.0:
        unit = fitting(path, "m")
        label = style.DRIVEN_PATH.label(unit.name)
        moved = history["stage"][int(np.argmax(path > STILL * path[-1]))]
        still = int(np.argmax(history["stage"] == moved))
        if still:
            first = ", ".join(dict.fromkeys(history["stage"][:still]))
            # Before anything is driven: beside the path, and not all of it on one line.
            path[:still] = np.linspace(-SQUEEZED * path[-1], 0.0, still + 1)[1:]
            label = f"path of the driven surface since the end of {first} ({unit.name})"
        return _made(results, unit.of(path), label)
    if not _uneven(history, time):
        unit = fitting(time, "s")
        return _made(results, unit.of(time), style.TIME.label(unit.name))
    idle = _idle_rows(results)
    since = time - time[max(idle - 1, 0)]
    if 0 < idle < len(time) and not _uneven(history.rows(slice(idle, None)), since[idle:]):
        since[:idle] = np.linspace(-SQUEEZED * since[-1], 0.0, idle + 1)[1:]
        unit = fitting(since, "s")
        before = ", ".join(dict.fromkeys(history["stage"][:idle]))
        label = f"time since the end of {before}, which is not to scale ({unit.name})"
        return _made(results, unit.of(since), label)
    return _made(results, history["step"], style.STEP.name)


def _idle_rows(results: Results) -> int:
    """Number of rows at the beginning in stages that time has no effect in."""
    idle = {stage.name for stage in results.case.stage if not stage.rate_dependent}
    counts = np.array([stage not in idle for stage in results.table("history")["stage"]])
    return int(np.argmax(counts)) if counts.any() else 0


def _uneven(history: Table, time: Floats) -> bool:
    """Whether the time of a step in one stage is far from that in another."""
    of = [np.flatnonzero(history["stage"] == name) for name in dict.fromkeys(history["stage"])]
    ends, counts = time[[rows[-1] for rows in of]], np.array([len(rows) for rows in of])
    lengths = np.diff(ends, prepend=0.0) / counts
    lengths = lengths[lengths > 0.0]
    return bool(len(lengths) > 1 and lengths.max() > UNEVEN * lengths.min())


def _made(results: Results, values: Floats, label: str) -> Abscissa:
    history = results.table("history")
    several = {stage.name for stage in results.case.stage if stage.velocities}
    rows = zip(history["stage"], history["velocity"], strict=True)
    keys = [(stage, velocity if stage in several else 0.0) for stage, velocity in rows]
    begins = [i for i, key in enumerate(keys) if i == 0 or key != keys[i - 1]]
    starts, unit = [], style.unit_of_velocity(results)
    for i in begins:
        stage, velocity = keys[i]
        before = float(values[i - 1]) if i else _begin(values)
        name = style.velocity_text(velocity, unit) if stage in several else str(stage)
        starts.append((before, name))
    return Abscissa(values, label, tuple(starts))


# -- Force over displacement of what is moved: surfaces, platens, springs, rigid tools -------------


MOST_PANELS = 8
HARDLY_MOVED = 1e-4  # of the largest displacement of all surfaces: what moves less is a support
IDLE = 1e-9  # of the largest force: what needs less moves freely, such as along a symmetry plane


@dataclass(frozen=True, slots=True)
class Curve:
    """What one panel shows."""

    surface: str  # its name
    x: str  # column of the table
    y: str  # likewise
    x_label: str  # without units, as y_label
    y_label: str
    x_unit: str  # SI
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
              f"{style.DISPLACEMENT.words}_{i}",
              f"{style.REACTION.words}_{i}", "m", "N")
        for (name, i), way in travel.items()
        if way > HARDLY_MOVED * largest and _largest(table, f"force_{i}", name) > IDLE * most
    ]  # fmt: skip
    for boundary in results.case.boundary:
        turned = boundary.rotation
        if turned is not None and boundary.surface in names and f"moment_{turned.axis}" in table:
            about = f"{style.MOMENT.words}_{turned.axis}"
            time = style.TIME.words
            curves.append(
                Curve(boundary.surface, "time", f"moment_{turned.axis}", time, about, "s", "N m")
            )
    for name, tool in results.case.tools.items():
        if tool.rotation is not None and tool.rotation.moment is None:
            labels = "rotation", f"driving {style.MOMENT.name}"
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
    panels = style.panels_in(figure, rows, columns, len(curves))
    for axes, curve in zip(panels, curves, strict=False):
        _draw(axes, curve, table)
    handles, labels = panels[0].get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=8)
    words = "force of the surroundings on each moved surface or tool"
    figure.suptitle(style.heading(results, words), fontsize=9)
    return figure


def _draw(axes: Axes, curve: Curve, surfaces: Table) -> None:
    table = surfaces.where("surface", curve.surface)
    x_unit, y_unit = (fitting(table[curve.x], curve.x_unit), fitting(table[curve.y], curve.y_unit))
    x, y = x_unit.of(table[curve.x]), y_unit.of(table[curve.y])
    stages = list(dict.fromkeys(table["stage"]))
    of = table["stage"]
    for number, stage in enumerate(stages):
        rows = np.flatnonzero(of == stage)
        # With the last point of the stage before, so that the curve has no gaps.
        rows = np.concatenate([rows[:1] - 1, rows]) if rows[0] else rows
        marker = "" if len(rows) > 40 else "."
        axes.plot(x[rows], y[rows], marker=marker, ls=style.dashes_of(number), ms=4, lw=1.1,
                  color=style.colour_of(number), label=str(stage))  # fmt: skip
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
            style.save(figure, files[-1])
    return files


def phase_figure(rows: Table, surface: str, axis: str) -> Figure:
    """The force on a sprung surface over time, and its velocity against that force."""
    time, force, speed = (rows[name] for name in ("time", f"force_{axis}", f"velocity_{axis}"))
    times, forces, speeds = (fitting(np.ptp(time), "s"), fitting(force, "N"), fitting(speed, "m/s"))
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(times.of(time - time[0]), forces.of(force), color=style.COLOURS[0], lw=1)
    force_on = f"{style.REACTION.name} of the spring on {surface}"
    named = f"{force_on}, {style.REACTION.symbol}_{axis} ({forces.name})"
    left.set_xlabel(f"{style.TIME.name} since the first explicit row ({times.name})")
    left.set_ylabel(named)
    right.plot(forces.of(force), speeds.of(speed), color=style.COLOURS[1], lw=0.8)
    right.set_xlabel(named)
    right.set_ylabel(f"velocity of {surface} in {axis} ({speeds.name})")
    return figure
