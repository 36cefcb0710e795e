"""Pictures of the deformed bodies with the tractions of each contact pair."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, FigureBase
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.tri import Triangulation

from tribox.app.figures import scenes, style, tractions
from tribox.app.figures.body_shapes import (
    Bodies,
    CellField,
    ColourScale,
    common_scale,
    named_after,
    read_bodies,
)
from tribox.app.figures.plane_bodies import (
    Frame,
    close_up,
    draw_bodies,
    draw_slaves,
    frame_round,
    pair_colour,
)
from tribox.app.figures.style import Floats, Unit
from tribox.app.simulation.history import time_text

if TYPE_CHECKING:
    import meshio

    from tribox.app.results import Results
    from tribox.app.results.reading import Table


MOST_PAIRS = 8  # pairs with a panel of their own
PALE = 8  # colours for bodies in the picture of the mesh
IN_ONE_COLUMN = 2


def draw_deformed(results: Results, figures: Path, field: str) -> list[Path]:
    """Draw the last state, each stage's end, the highest load; InputError without the array."""
    states = [replace(s, name=named_after(s.name, field)) for s in states_to_draw(results)]
    if not states:
        return []
    names = style.body_names(results)
    drawn = [read_bodies(results.fields(state.step), names, field) for state in states]
    scale = common_scale([one.field for one in drawn])
    draw = _figure if results.case.contact else _bodies_alone
    draw = _figure_in_space if drawn[0].dim == 3 else draw
    files = [figures / f"{state.name}.png" for state in states]
    with rc_context(style.CASE_STYLE):
        for state, bodies, file in zip(states, drawn, files, strict=True):
            style.save(draw(results, state, bodies, scale), file)
    return files


def draw_mesh(results: Results, figures: Path) -> list[Path]:
    """Draw ``mesh.png``: the bodies before anything moved, with their cells and slave surfaces."""
    if not len(results.steps):
        return []
    first = int(results.steps[0])
    moved = read_bodies(results.fields(first), style.body_names(results), "displacement")
    numbers = CellField(np.asarray(moved.body % PALE, dtype=np.float64), "", "", "body")
    bodies = replace(moved, position=moved.reference, field=numbers)
    scale = ColourScale(Normalize(-0.5, PALE - 0.5), "Pastel2", Unit(0, ""), "neither")
    words = f"mesh before anything moved: {len(bodies.polygons)} "
    if bodies.dim == 3:
        figure, words = mesh_in_space(bodies, scale), f"{words}outer facets"
    else:
        nodes = results.contact(first) if results.case.contact else None
        figure, stretched = _mesh_figure(results, bodies, scale, nodes)
        words += f"cells{stretched}"
    figure.suptitle(style.heading(results, words), fontsize=9)
    style.save(figure, figures / "mesh.png")
    return [figures / "mesh.png"]


def _mesh_figure(
    results: Results, bodies: Bodies, scale: ColourScale, nodes: meshio.Mesh | None
) -> tuple[Figure, str]:
    """The bodies with their cells in the plane, and what to say of their proportions."""
    frame = frame_round([bodies], style.axis_names(results))
    figure = Figure(figsize=(8.4, frame.height_over(7.4, 2.0, 8.0) + 1.2), layout="constrained")
    axes = figure.subplots()
    draw_bodies(axes, bodies, scale, frame)
    if nodes is not None:
        names = style.pair_names(results)
        reference = np.asarray(nodes.point_data["reference"], dtype=np.float64)[:, :2]
        for pair in tractions.pairs_shown(nodes, len(names), MOST_PAIRS):
            lines = reference[tractions.facets_of(nodes, pair)] * frame.unit.factor
            slave = LineCollection(list(lines), colors=pair_colour(pair), linewidths=2.0, zorder=4)
            slave.set_label(f"slave of {names[pair]}")
            axes.add_collection(slave, autolim=False)
        figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure, frame.words


def _figure(results: Results, state: State, bodies: Bodies, scale: ColourScale) -> Figure:
    """The bodies, and below or beside them the tractions of each pair."""
    nodes = tractions.without_roundoff(results.contact(state.step), tractions.roundoff_of(results))
    points = results.contact_points(state.step)
    lines = scenes.tool_lines(results, state.step)
    frame = scenes.with_room(frame_round([bodies], style.axis_names(results)), lines)
    names = style.pair_names(results)
    pairs = {k: names[k] for k in tractions.pairs_shown(nodes, len(names), MOST_PAIRS)}
    near = close_up(frame, nodes)
    figure, top, beside, panels = _layout(frame, len(pairs), near is not None)
    cells = draw_bodies(top, bodies, scale, frame)
    scenes.draw_tools(top, lines, frame)
    draw_slaves(top, nodes, pairs, frame.unit)
    if near is not None and beside is not None:
        draw_bodies(beside, bodies, scale, near, named=False)
        scenes.draw_tools(beside, lines, near)
        draw_slaves(beside, nodes, pairs, near.unit)
        beside.set_title("close-up", fontsize=9)
    whole = [top] if beside is None else [top, beside]
    figure.colorbar(cells, ax=whole, label=scale.label(bodies.field), extend=scale.extend,
                    shrink=0.9, pad=0.02, fraction=0.05, aspect=25)  # fmt: skip
    figure.suptitle(style.heading(results, state.title + frame.words), fontsize=9)
    # Tractions of each pair, in the same unit in all panels
    total = len(names)
    data = nodes.point_data
    stress = style.fitting(np.concatenate([data["pressure"], data["tangential_traction"]]), "Pa")
    length = style.fitting(np.ptp(data["reference"], axis=0), "m")
    for axes, (pair, name) in zip(panels, pairs.items(), strict=True):
        tractions.draw_tractions(axes, nodes, points, pair, length, stress)
        axes.set_title(name, fontsize=9, color=pair_colour(pair), loc="left", pad=3)
        if axes.lines:
            axes.set_ylabel(f"traction ({stress.name})", fontsize=9)
    words = f"arc length along the slave from the dot ({length.name}); lengths and areas undeformed"
    if len(pairs) < total:
        words += f"\n{len(pairs)} of {total} pairs: those that carry most"
    panels[0].figure.supxlabel(words, fontsize=9)
    drawn = next((axes for axes in panels if axes.lines), None)
    if drawn is not None:
        # Outside of all panels: above a narrow one it would lie on the name of its pair.
        drawn.figure.legend(
            *drawn.get_legend_handles_labels(), fontsize=8, loc="outside upper right", ncols=2
        )
    return figure


def _bodies_alone(results: Results, state: State, bodies: Bodies, scale: ColourScale) -> Figure:
    """The bodies of a case without contact."""
    frame = frame_round([bodies], style.axis_names(results))
    figure = Figure(figsize=(8.0, frame.height_over(6.4, 2.0, 7.0) + 1.0), layout="constrained")
    axes = figure.subplots()
    cells = draw_bodies(axes, bodies, scale, frame)
    figure.colorbar(cells, ax=axes, label=scale.label(bodies.field), extend=scale.extend)
    figure.suptitle(style.heading(results, state.title + frame.words), fontsize=9)
    return figure


def _layout(frame: Frame, pairs: int, closer: bool) -> tuple[Figure, Axes, Axes | None, list[Axes]]:
    """A figure with room for the bodies, a close-up of the contact, and a panel of each pair."""
    columns = 1 if pairs <= IN_ONE_COLUMN or frame.is_tall else 2
    rows = -(-pairs // columns)
    width, height = frame.high - frame.low
    if frame.is_tall:
        tall = min(9.0, max(6.0, 2.2 * rows))
        figure = Figure(figsize=(9.0, tall), layout="constrained")
        share = float(np.clip(width / height * tall / 9.0 + 0.15, 0.25, 0.5))
        room, below = figure.subfigures(1, 2, width_ratios=(share, 1.0 - share))
    else:
        half = 3.2 if closer else 6.4
        body = 3.0 if frame.stretched else float(np.clip(half * height / width, 1.3, 5.0))
        body = max(body, 3.0) if closer else body
        under = 0.7 + (2.2 if rows == 1 else 1.8) * rows
        figure = Figure(figsize=(8.0, body + 0.9 + under), layout="constrained")
        room, below = figure.subfigures(2, 1, height_ratios=(body + 0.9, under))
    across = closer and not frame.is_tall
    shape = (1, 2) if across else (2, 1) if closer else (1, 1)
    first, *others = room.subplots(*shape, squeeze=False).flat
    panels = style.panels_in(below, rows, columns, pairs)
    return figure, first, others[0] if others else None, panels[:pairs]


# -- Pictures of deformed bodies in space, with the pressure of each pair seen along its normal ----


MOST_IN_SPACE = 4


def mesh_in_space(bodies: Bodies, scale: ColourScale) -> Figure:
    """The outer facets of the bodies, a colour for each body."""
    scene = scenes.scene_of(bodies, scale)
    figure = Figure(figsize=(7.5, 6.5), layout="constrained")
    scenes.draw_space(
        figure.subplots(), scenes.View(scene, scenes.facets_seen(scene)), bodies.names
    )
    return figure


def _figure_in_space(results: Results, state: State, bodies: Bodies, scale: ColourScale) -> Figure:
    """The bodies from outside, and beside them the pressure of each pair."""
    names, tools = style.pair_names(results), scenes.tool_triangles(results, state.step)
    room = scenes.room_for(bodies.position.min(axis=0), bodies.position.max(axis=0), tools)
    scene = scenes.scene_of(bodies, scale, *room)
    view = scenes.View(scene, scenes.facets_seen(scene), scenes.veil_of(scene, tools))
    if not names:
        figure = Figure(figsize=(7.0, 5.5), layout="constrained")
        _draw_bodies(figure, view, bodies, scale)
        figure.suptitle(style.heading(results, state.title), fontsize=9)
        return figure
    nodes = tractions.without_roundoff(results.contact(state.step), tractions.roundoff_of(results))
    pairs = {k: names[k] for k in tractions.pairs_shown(nodes, len(names), MOST_IN_SPACE)}
    columns = 1 if len(pairs) == 1 else 2
    rows = -(-len(pairs) // columns)
    figure = Figure(figsize=(6.5 + 4.3 * columns, max(5.5, 4.6 * rows)), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(6.0, 4.8 * columns))
    _draw_bodies(left, view, bodies, scale)
    figure.suptitle(style.heading(results, state.title), fontsize=9)
    panels = style.panels_in(right, rows, columns, len(pairs))
    draw_pairs(right, panels[: len(pairs)], nodes, pairs)
    return figure


def _draw_bodies(figure: FigureBase, view: scenes.View, bodies: Bodies, scale: ColourScale) -> None:
    """The bodies with a bar of their colours below."""
    bar = ScalarMappable(scale.norm, scale.colours)
    axes = figure.add_subplot()
    scenes.draw_space(axes, view, bodies.names)
    figure.colorbar(bar, ax=axes, label=scale.label(bodies.field), extend=scale.extend,
                    orientation="horizontal", shrink=0.7, pad=0.02, aspect=35)  # fmt: skip


# -- Pressure and friction on slave surfaces in space, each seen along its mean normal -------------
#
# Axis letters: f facets, a corners, v vertices of a slave, i space.

SMALL = 0.5  # extent of what is pressed over the slave's, below which only that is shown
ARROWS = 250  # friction tractions drawn, about


@dataclass(frozen=True, slots=True)
class Plan:
    """A slave surface seen along its mean normal."""

    across: Floats  # (v, 2), m, current, in the directions of ``axes``
    axes: Floats  # (2, 3), unit vectors
    names: tuple[str, str]  # of the two directions
    facets: tractions.Ints  # (f, a)


def seen_along_normal(nodes: meshio.Mesh, pair: int) -> Plan:
    """A slave in the plane across its mean normal, where it is pressed (all of it if nowhere).

    The normal is that of the slave, out of its body, turned towards the viewer where it has to be:
    the picture is seen from y, from z or from x upwards, never from below.
    """
    facets = tractions.facets_of(nodes, pair)
    x = np.asarray(nodes.points, dtype=np.float64)
    pressure = np.asarray(nodes.point_data["pressure"], dtype=np.float64)
    # Weighted by pressure: all round a roller normals cancel, where it touches they do not.
    share = pressure[facets].mean(axis=1)
    areas = scenes.area_vectors(x[facets])
    normal = (areas * share[:, None]).sum(axis=0) if share.any() else areas.sum(axis=0)
    length = float(np.linalg.norm(normal))
    normal = normal / length if length > 0.0 else np.array([0.0, 1.0, 0.0])
    for axis in (1, 2, 0):
        if abs(normal[axis]) > 0.1:
            normal = normal * np.sign(normal[axis])
            break
    right = np.array([1.0, 0.0, 0.0]) if abs(normal[0]) < 0.9 else np.array([0.0, 0.0, -1.0])
    right = right - normal * (normal @ right)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(normal, right)])
    return Plan(x @ axes.T, axes, (_direction(axes[0]), _direction(axes[1])), facets)


def _direction(vector: Floats) -> str:
    """Name of a direction: that of an axis, or its components."""
    largest = int(np.argmax(np.abs(vector)))
    if abs(vector[largest]) > 0.9999:
        return ("−" if vector[largest] < 0.0 else "") + "xyz"[largest]
    return "along (" + ", ".join(f"{v:.2g}" for v in vector) + ")"


def draw_pairs(
    figure: Any, panels: Sequence[Axes], nodes: meshio.Mesh, pairs: Mapping[int, str]
) -> None:
    """Pressure and friction of each pair, in the same colours in all panels."""
    pressure = np.asarray(nodes.point_data["pressure"], dtype=np.float64)
    stress = style.fitting(pressure, "Pa")
    top = float(pressure.max()) * stress.factor or 1.0
    for axes, (pair, name) in zip(panels, pairs.items(), strict=True):
        plan = seen_along_normal(nodes, pair)
        unit = style.fitting(np.ptp(plan.across[np.unique(plan.facets)], axis=0), "m")
        draw_pressure(axes, nodes, plan, unit, stress, top)
        draw_friction(axes, nodes, plan, unit)
        axes.set_title(name, fontsize=9, color=pair_colour(pair))
        axes.set(xlabel=f"{plan.names[0]} ({unit.name})", ylabel=f"{plan.names[1]} ({unit.name})")
        axes.set_aspect("equal", adjustable="box")
        axes.grid(False)
    label = f"{style.CONTACT_PRESSURE.words} ({stress.name})"
    bar = ScalarMappable(Normalize(0.0, top), "inferno")
    figure.colorbar(bar, ax=list(panels), label=label, orientation="horizontal", shrink=0.7,
                    pad=0.02, aspect=35)  # fmt: skip


def draw_pressure(
    axes: Axes, nodes: meshio.Mesh, plan: Plan, unit: Unit, stress: Unit, top: float
) -> None:
    """Pressure on a slave where half or more of a node's surroundings touches; else its facets.

    Nodal pressures end somewhere between two nodes. Drawn down to the last node that has some, the
    rim would have the teeth of the mesh; the share that touches says where it is.
    """
    facets, place = plan.facets, plan.across * unit.factor
    pressure = np.asarray(nodes.point_data["pressure"], dtype=np.float64) * stress.factor
    around = np.concatenate([facets, facets[:, :1]], axis=1)
    outlines = LineCollection(list(place[around]), colors="0.88", linewidths=0.4, zorder=0)
    axes.add_collection(outlines)
    pressed = np.unique(facets[(pressure[facets] > 0.0).any(axis=1)])
    if len(pressed):
        mesh, values = _triangles(place, facets, pressure)
        colours = axes.tripcolor(
            mesh, values, shading="gouraud", cmap="inferno", vmin=0.0, vmax=top
        )
        rim = touching(nodes, facets, place)
        colours.set_clip_path(rim, axes.transData)
        axes.add_patch(PathPatch(rim, fill=False, edgecolor="0.4", linewidth=0.6))
    else:
        tractions.write_no_load(axes)
    # Limits round a slave, or round what is pressed where that is a small part of it
    whole = place[np.unique(facets)]
    pressed = place[pressed]
    shown = whole
    if len(pressed) and np.ptp(pressed, axis=0).max() < SMALL * np.ptp(whole, axis=0).max():
        shown = pressed
    margin = 0.07 * float(np.ptp(shown, axis=0).max() or 1.0)
    (left, low), (right, high) = shown.min(axis=0) - margin, shown.max(axis=0) + margin
    axes.set(xlim=(left, right), ylim=(low, high))


def touching(nodes: meshio.Mesh, facets: tractions.Ints, place: Floats) -> Outline:
    """Outline of where half or more of a node's surroundings touches.

    Where the contact file lacks ``cover``, pressed nodes count as covered. ``place``: (v, 2), of
    the nodes, in the unit of the outline.
    """
    data = nodes.point_data
    cover = np.asarray(data["cover"] if "cover" in data else data["pressure"] > 0.0, np.float64)
    mesh, values = _triangles(place, facets, cover)
    # No share is above 1: the upper level only closes the interval.
    filled = Figure().subplots().tricontourf(mesh, values, levels=[0.5, 2.0])
    return Outline.make_compound_path(*filled.get_paths())


def _triangles(
    place: Floats, facets: tractions.Ints, values: Floats
) -> tuple[Triangulation, Floats]:
    """Triangles of the facets and their nodal values; quadrilaterals are cut from their middle."""
    if facets.shape[1] == 3:
        return Triangulation(*place.T, facets), values
    # Of two triangles each, colours would show which diagonal was taken.
    middle = len(place) + np.arange(len(facets))
    sides = [np.stack([facets[:, k], facets[:, (k + 1) % 4], middle], axis=1) for k in range(4)]
    places = np.concatenate([place, place[facets].mean(axis=1)])
    mesh = Triangulation(*places.T, np.concatenate(sides))
    return mesh, np.concatenate([values, values[facets].mean(axis=1)])


def draw_friction(axes: Axes, nodes: meshio.Mesh, plan: Plan, unit: Unit) -> None:
    """Arrows of the friction on the master, where there is some."""
    vectors = nodes.point_data.get("friction_traction")
    if vectors is None:
        return
    own = np.unique(plan.facets)
    traction = np.asarray(vectors, dtype=np.float64)[own]
    largest = float(np.linalg.norm(traction, axis=1).max(initial=0.0))
    pressure = np.asarray(nodes.point_data["pressure"])[own]
    shown = np.flatnonzero((np.linalg.norm(traction, axis=1) > 0.02 * largest) & (pressure > 0.0))
    if not largest > 0.0 or not len(shown):
        return
    every = max(1, len(shown) // ARROWS)
    shown = shown[::every]
    place = plan.across[own[shown]] * unit.factor
    along = traction[shown] @ plan.axes.T
    stress = style.fitting([largest], "Pa")
    axes.quiver(*place.T, *(along * stress.factor).T, color="#7fd4ff", width=0.004, pivot="mid",
                zorder=3)  # fmt: skip
    axes.annotate(
        f"arrows: {style.TRACTION.words} on the master, up to {stress.text(largest)}",
        (0.0, -0.17), xycoords="axes fraction", fontsize=8, color="0.35", annotation_clip=False,
    )  # fmt: skip


# -- Which states of a run are worth a picture, and what its title says ---------------------------

AS_HIGH = 0.999  # share of the largest normal force from which on a load counts as the highest
HIGHEST = "highest load"
ENDINGS = {
    "failed": "last state before the failure",
    "interrupted": "last state before the interruption",
    "running": "last state so far",
}


@dataclass(frozen=True, slots=True)
class State:
    """A state to draw."""

    name: str  # of the picture, without its ending
    step: int  # of the field output
    title: str  # what it shows, for people


def states_to_draw(results: Results) -> list[State]:
    """The last state, the end of each stage before the last, and the highest load.

    The highest load has no picture of its own where another shows it or as good as that, and no
    mention where several do.
    """
    outputs = np.asarray(results.steps, dtype=np.int64)
    if not len(outputs):
        return []
    history = results.table("history")
    last = int(outputs[-1])
    names, notes = {last: "deformed"}, {last: [ENDINGS.get(results.summary.get("status", ""), "")]}
    ends = style.stage_ends(results)
    for number, (stage, end) in enumerate(ends[:-1], 1):
        step = _nearest(outputs, end)
        names.setdefault(step, f"deformed-{number}-{re.sub(r'[^A-Za-z0-9.+=_%µμ-]+', '_', stage)}")
        near = "" if step == last else f"nearest output to the end of {stage}"
        notes.setdefault(step, []).append(f"end of {stage}" if step == end else near)
    peak = _highest(history, list(names), outputs)
    if peak is not None:
        step, note = peak
        names.setdefault(step, "deformed-highest-load")
        exact = note == HIGHEST
        notes.setdefault(step, []).append(note if exact or step != last else "")
    return [State(names[s], s, title_of(results, s, notes[s])) for s in sorted(names)]


def _highest(history: Table, drawn: list[int], outputs: Any) -> tuple[int, str] | None:
    """The output at the highest load and what to say of it.

    None where nothing is pressed, and where no other picture shows a lower load than one that is
    drawn.
    """
    if not len(history) or "normal_force" not in history:
        return None
    force = history["normal_force"]
    steps = history["step"].astype(np.int64)
    largest = float(np.nanmax(force))
    if not largest > 0.0:
        return None
    high = {int(step) for step in steps[force >= AS_HIGH * largest]}
    shown = [step for step in drawn if step in high]
    if shown:
        return (shown[0], HIGHEST) if len(shown) == 1 < len(drawn) else None
    at = int(steps[np.nanargmax(force)])
    written = [s for s in outputs.tolist() if s in high]
    if written:
        return at if at in written else written[0], HIGHEST
    return _nearest(outputs, at), f"nearest output to the highest load (step {at})"


def _nearest(outputs: Any, step: int) -> int:
    return int(outputs[np.argmin(np.abs(outputs - step))])


def title_of(results: Results, step: int, notes: Sequence[str] = ()) -> str:
    """Stage, velocity, time and number of a step, for people, then what is special."""
    words = [note for note in notes if note]
    history = results.table("history")
    found = history.where("step", step).records() if len(history) else []
    if not found:
        return "; ".join([f"step {step}", *words])
    row, unit = found[0], style.unit_of_velocity(results)
    velocity, time = float(row.get("velocity", 0.0)), float(row["time"])
    moving = f" at {style.velocity_text(velocity, unit)}" if abs(velocity) > 0.0 else ""
    when, total = time_text(time, float(row.get("dt", 0.0))), int(history["step"][-1])
    said = f"stage {row['stage']}{moving}, t = {when}, step {step} of {total}"
    return "; ".join([said, *words])
