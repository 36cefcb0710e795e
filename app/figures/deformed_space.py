"""Pictures of deformed bodies in space, with the pressure of each pair seen along its normal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib import rc_context
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure, FigureBase

from tribox.app.figures.body_shapes import Bodies
from tribox.app.figures.field_values import ColourScale, common_scale
from tribox.app.figures.names import heading, pair_names
from tribox.app.figures.pressure_maps import draw_pairs
from tribox.app.figures.rendering import render
from tribox.app.figures.scenes import facets_seen
from tribox.app.figures.space_bodies import View, draw_space, scene_of
from tribox.app.figures.states import State
from tribox.app.figures.style import CASE_STYLE, panels_in, save
from tribox.app.figures.tool_surfaces import room_for, tool_triangles, veil_of
from tribox.app.figures.tractions import pairs_shown, roundoff_of, without_roundoff

if TYPE_CHECKING:
    from tribox.app.results import Results

MOST_PAIRS = 4


def draw_states_in_space(
    results: Results, states: Sequence[State], drawn: Sequence[Bodies], figures: Path
) -> list[Path]:
    """Draw states in space, each into a file of its name.

    Args:
        results: of a run.
        states: what to draw.
        drawn: the bodies of each.
        figures: directory that exists.
    """
    scale = common_scale([one.field for one in drawn])
    tools = [tool_triangles(results, state.step) for state in states]
    frames = [
        room_for(bodies.position.min(axis=0), bodies.position.max(axis=0), triangles)
        for bodies, triangles in zip(drawn, tools, strict=True)
    ]
    scenes = [scene_of(b, scale, *frame) for b, frame in zip(drawn, frames, strict=True)]
    pictures = render(scenes)
    files = []
    with rc_context(CASE_STYLE):
        for number, (state, scene) in enumerate(zip(states, scenes, strict=True)):
            picture = None if pictures is None else pictures[number]
            view = View(scene, facets_seen(scene), picture, veil_of(scene, tools[number]))
            figure = _figure(results, state, drawn[number], scale, view)
            files.append(figures / f"{state.name}.png")
            save(figure, files[-1])
    return files


def mesh_in_space(bodies: Bodies, scale: ColourScale) -> Figure:
    """The outer facets of the bodies, a colour for each body."""
    scene = scene_of(bodies, scale)
    figure = Figure(figsize=(7.5, 6.5), layout="constrained")
    draw_space(figure.subplots(), View(scene, facets_seen(scene), None), bodies.names)
    return figure


def _figure(
    results: Results, state: State, bodies: Bodies, scale: ColourScale, view: View
) -> Figure:
    """The bodies from outside, and beside them the pressure of each pair."""
    names = pair_names(results)
    if not names:
        figure = Figure(figsize=(7.0, 5.5), layout="constrained")
        _draw_bodies(figure, view, bodies, scale)
        figure.suptitle(heading(results, state.title), fontsize=9)
        return figure
    nodes = without_roundoff(results.grid("contact", state.step), roundoff_of(results))
    pairs = {k: names[k] for k in pairs_shown(nodes, len(names), MOST_PAIRS)}
    columns = 1 if len(pairs) == 1 else 2
    rows = -(-len(pairs) // columns)
    figure = Figure(figsize=(6.5 + 4.3 * columns, max(5.5, 4.6 * rows)), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(6.0, 4.8 * columns))
    _draw_bodies(left, view, bodies, scale)
    figure.suptitle(heading(results, state.title), fontsize=9)
    panels = panels_in(right, rows, columns, len(pairs))
    draw_pairs(right, panels[: len(pairs)], nodes, pairs)
    return figure


def _draw_bodies(figure: FigureBase, view: View, bodies: Bodies, scale: ColourScale) -> None:
    """The bodies with a bar of their colours below."""
    bar = ScalarMappable(scale.norm, scale.colours)
    axes = figure.add_subplot()
    draw_space(axes, view, bodies.names)
    words = f" ({scale.unit.name})" if scale.unit.name else ""
    figure.colorbar(bar, ax=axes, label=bodies.field.label + words, extend=scale.extend,
                    orientation="horizontal", shrink=0.7, pad=0.02, aspect=35)  # fmt: skip
