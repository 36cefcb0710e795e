"""Pictures of the deformed bodies with the tractions of each contact pair."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from tribox.app.figures.body_shapes import (
    Bodies,
    CellField,
    ColourScale,
    common_scale,
    named_after,
    read_bodies,
)
from tribox.app.figures.deformed_space import draw_states_in_space, mesh_in_space
from tribox.app.figures.plane_bodies import (
    Frame,
    close_up,
    draw_bodies,
    draw_slaves,
    frame_round,
    pair_colour,
)
from tribox.app.figures.states import State, states_to_draw
from tribox.app.figures.style import CASE_STYLE, panels_in, save
from tribox.app.figures.tool_surfaces import draw_tools, tool_lines, with_room
from tribox.app.figures.tractions import (
    draw_tractions,
    facets_of,
    pairs_shown,
    roundoff_of,
    without_roundoff,
)
from tribox.app.figures.units import Unit, axis_names, body_names, fitting, heading, pair_names

if TYPE_CHECKING:
    from tribox.app.results import Results
    from tribox.app.results.vtu import Grid

MOST_PAIRS = 8  # pairs with a panel of their own
PALE = 8  # colours for bodies in the picture of the mesh
IN_ONE_COLUMN = 2


def draw_deformed(results: Results, figures: Path, field: str) -> list[Path]:
    """Draw the last state, the end of each stage and the highest load.

    Raises:
        InputError: there is no such array.
    """
    states = [replace(s, name=named_after(s.name, field)) for s in states_to_draw(results)]
    if not states:
        return []
    names = body_names(results)
    drawn = [read_bodies(results.grid("fields", state.step), names, field) for state in states]
    if drawn[0].dim == 3:
        return draw_states_in_space(results, states, drawn, figures)
    files = []
    scale = common_scale([one.field for one in drawn])
    with rc_context(CASE_STYLE):
        for state, bodies in zip(states, drawn, strict=True):
            draw = _figure if results.case.contact else _bodies_alone
            figure = draw(results, state, bodies, scale)
            files.append(figures / f"{state.name}.png")
            save(figure, files[-1])
    return files


def draw_mesh(results: Results, figures: Path) -> list[Path]:
    """Draw ``mesh.png``: the bodies before anything moved, with their cells and slave surfaces."""
    if not len(results.steps):
        return []
    first = int(results.steps[0])
    moved = read_bodies(results.grid("fields", first), body_names(results), "displacement")
    numbers = CellField(np.asarray(moved.body % PALE, dtype=np.float64), "", "", "body")
    bodies = replace(moved, position=moved.reference, field=numbers)
    scale = ColourScale(Normalize(-0.5, PALE - 0.5), "Pastel2", Unit(0, ""), "neither")
    words = f"mesh before anything moved: {len(bodies.polygons)} "
    if bodies.dim == 3:
        figure, words = mesh_in_space(bodies, scale), f"{words}outer facets"
    else:
        nodes = results.grid("contact", first) if results.case.contact else None
        figure, stretched = _mesh_figure(results, bodies, scale, nodes)
        words += f"cells{stretched}"
    figure.suptitle(heading(results, words), fontsize=9)
    save(figure, figures / "mesh.png")
    return [figures / "mesh.png"]


def _mesh_figure(
    results: Results, bodies: Bodies, scale: ColourScale, nodes: Grid | None
) -> tuple[Figure, str]:
    """The bodies with their cells in the plane, and what to say of their proportions."""
    frame = frame_round([bodies], axis_names(results))
    figure = Figure(figsize=(8.4, frame.height_over(7.4, 2.0, 8.0) + 1.2), layout="constrained")
    axes = figure.subplots()
    draw_bodies(axes, bodies, scale, frame)
    if nodes is not None:
        names = pair_names(results)
        reference = np.asarray(nodes.point_data["reference"], dtype=np.float64)[:, :2]
        for pair in pairs_shown(nodes, len(names), MOST_PAIRS):
            lines = reference[facets_of(nodes, pair)] * frame.unit.factor
            slave = LineCollection(list(lines), colors=pair_colour(pair), linewidths=2.0, zorder=4)
            slave.set_label(f"slave of {names[pair]}")
            axes.add_collection(slave, autolim=False)
        figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure, frame.words


def _figure(results: Results, state: State, bodies: Bodies, scale: ColourScale) -> Figure:
    """The bodies, and below or beside them the tractions of each pair."""
    nodes = without_roundoff(results.grid("contact", state.step), roundoff_of(results))
    points = results.grid("contact_points", state.step)
    lines = tool_lines(results, state.step)
    frame = with_room(frame_round([bodies], axis_names(results)), lines)
    names = pair_names(results)
    pairs = {k: names[k] for k in pairs_shown(nodes, len(names), MOST_PAIRS)}
    near = close_up(frame, nodes)
    figure, top, beside, panels = _layout(frame, len(pairs), near is not None)
    cells = draw_bodies(top, bodies, scale, frame)
    draw_tools(top, lines, frame)
    draw_slaves(top, nodes, pairs, frame.unit)
    if near is not None and beside is not None:
        draw_bodies(beside, bodies, scale, near, named=False)
        draw_tools(beside, lines, near)
        draw_slaves(beside, nodes, pairs, near.unit)
        beside.set_title("close-up", fontsize=9)
    whole = [top] if beside is None else [top, beside]
    figure.colorbar(cells, ax=whole, label=scale.label(bodies.field), extend=scale.extend,
                    shrink=0.9, pad=0.02, fraction=0.05, aspect=25)  # fmt: skip
    figure.suptitle(heading(results, state.title + frame.words), fontsize=9)
    _fill_panels(panels, nodes, points, pairs, len(names))
    return figure


def _bodies_alone(results: Results, state: State, bodies: Bodies, scale: ColourScale) -> Figure:
    """The bodies of a case without contact."""
    frame = frame_round([bodies], axis_names(results))
    figure = Figure(figsize=(8.0, frame.height_over(6.4, 2.0, 7.0) + 1.0), layout="constrained")
    axes = figure.subplots()
    cells = draw_bodies(axes, bodies, scale, frame)
    figure.colorbar(cells, ax=axes, label=scale.label(bodies.field), extend=scale.extend)
    figure.suptitle(heading(results, state.title + frame.words), fontsize=9)
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
    panels = panels_in(below, rows, columns, pairs)
    return figure, first, others[0] if others else None, panels[:pairs]


def _fill_panels(
    panels: list[Axes],
    nodes: Grid,
    points: Grid | None,
    pairs: Mapping[int, str],
    total: int,
) -> None:
    """Tractions of each pair, in the same unit in all panels."""
    data = nodes.point_data
    stress = fitting(np.concatenate([data["pressure"], data["tangential_traction"]]), "Pa")
    length = fitting(np.ptp(data["reference"], axis=0), "m")
    for axes, (pair, name) in zip(panels, pairs.items(), strict=True):
        draw_tractions(axes, nodes, points, pair, length, stress)
        axes.set_title(name, fontsize=9, color=pair_colour(pair), loc="left", pad=3)
        if axes.lines:
            axes.set_ylabel(f"traction ({stress.name})", fontsize=9)
    words = f"arc length along the slave from the dot, undeformed ({length.name})"
    if len(pairs) < total:
        words += f"\n{len(pairs)} of {total} pairs: those that carry most"
    panels[0].figure.supxlabel(words, fontsize=9)
    drawn = next((axes for axes in panels if axes.lines), None)
    if drawn is not None:
        # Outside of all panels: above a narrow one it would lie on the name of its pair.
        drawn.figure.legend(
            *drawn.get_legend_handles_labels(), fontsize=8, loc="outside upper right", ncols=2
        )
