"""Animation of the deformed bodies of a run: a GIF."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from tribox.app.errors import InputError
from tribox.app.figures.body_shapes import Bodies, ColourScale, common_scale, read_bodies
from tribox.app.figures.deformed import title_of
from tribox.app.figures.plane_bodies import draw_bodies, draw_slaves, frame_round
from tribox.app.figures.scenes import (
    View,
    draw_space,
    draw_tools,
    facets_seen,
    room_for,
    scene_of,
    tool_lines,
    tool_triangles,
    veil_of,
    with_room,
)
from tribox.app.figures.style import CASE_STYLE, axis_names, body_names, heading, pair_names
from tribox.app.figures.tractions import pairs_shown, roundoff_of, without_roundoff
from tribox.app.results.directory import written_whole

if TYPE_CHECKING:
    from tribox.app.results import Results

MOST_FRAMES = 100
SECONDS = 8.0  # that an animation of many frames takes
SLOWEST, FASTEST = 3, 15  # frames per second
DPI = 90
MOST_PAIRS = 12
COLOURS = 128  # of a GIF
LOOKED_AT = 8  # frames that they are chosen from


def animate(results: Results, path: Path, field: str) -> int:
    """Write a GIF of a run's fields; number of frames; InputError if under two, or no array."""
    steps = frames_of(np.asarray(results.steps, dtype=np.int64))
    if len(steps) < 2:
        raise InputError(
            f"{results.directory}: {len(steps)} field output{'s' * (len(steps) != 1)}; an "
            "animation needs two or more (output.fields_every)"
        )
    names = body_names(results)
    states = [read_bodies(results.fields(step), names, field) for step in steps]
    scale = common_scale([state.field for state in states])
    frames = []
    with rc_context(CASE_STYLE), written_whole(path) as part:
        figure, draw = (_in_space if states[0].dim == 3 else _in_the_plane)(
            results, steps, states, scale
        )
        canvas = FigureCanvasAgg(figure)
        for number, step in enumerate(steps):
            draw(number)
            figure.suptitle(heading(results, title_of(results, step)), fontsize=8)
            canvas.draw()
            frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()))
        _save(frames, part, int(np.clip(len(steps) / SECONDS, SLOWEST, FASTEST)))
    return len(steps)


def _save(frames: list[Image.Image], path: Path, rate: int) -> None:
    """Write all frames, ``rate`` of them per second, in one palette.

    Pillow would choose the colours of each frame by what fills most of it: thin lines change their
    colours from frame to frame, and little equals the frame before, which a GIF need not repeat.
    """
    # An image with a palette that serves all frames: colours far apart, and white
    chosen = np.unique(np.linspace(0, len(frames) - 1, LOOKED_AT).round().astype(int))
    width, height = frames[0].size
    sheet = Image.new("RGB", (width, height * len(chosen)))
    for place, number in enumerate(chosen):
        sheet.paste(frames[number], (0, height * place))
    found = sheet.quantize(COLOURS - 1, Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*found[: 3 * (COLOURS - 1)], 255, 255, 255])
    first, *rest = (f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames)
    first.save(path, "gif", save_all=True, append_images=rest, duration=1000 // rate, loop=0)


def frames_of(steps: NDArray[np.int64]) -> list[int]:
    """At most so many steps, evenly chosen; the first and the last are among them."""
    if len(steps) <= MOST_FRAMES:
        return [int(step) for step in steps]
    chosen = np.unique(np.rint(np.linspace(0, len(steps) - 1, MOST_FRAMES)).astype(int))
    return [int(step) for step in steps[chosen]]


def _page(scale: ColourScale, states: list[Bodies], shape: float) -> tuple[Figure, Axes]:
    """A page with a colour bar; its size stays, since all frames must be of one size."""
    width = 7.2 if shape < 1.2 else 5.6
    figure = Figure(figsize=(width, float(np.clip(width * shape + 1.2, 3.0, 7.5))), dpi=DPI)
    axes = figure.subplots()
    figure.subplots_adjust(left=0.1, right=0.86, bottom=0.12, top=0.86)
    bar = figure.add_axes((0.885, 0.14, 0.02, 0.68))
    figure.colorbar(ScalarMappable(scale.norm, scale.colours), cax=bar, extend=scale.extend,
                    label=scale.label(states[0].field))  # fmt: skip
    return figure, axes


def _in_the_plane(
    results: Results, steps: list[int], states: list[Bodies], scale: ColourScale
) -> tuple[Figure, Callable[[int], None]]:
    lines = [tool_lines(results, step) for step in steps]
    drawn = [some for some in lines if some is not None]
    frame = frame_round(states, axis_names(results))
    frame = with_room(frame, np.concatenate(drawn) if drawn else None)
    width, height = frame.high - frame.low
    figure, axes = _page(scale, states, 0.45 if frame.stretched else 0.75 * height / width)
    names, roundoff = pair_names(results), roundoff_of(results)

    def draw(number: int) -> None:
        axes.clear()
        draw_bodies(axes, states[number], scale, frame)
        draw_tools(axes, lines[number], frame)
        if not names:
            return
        nodes = without_roundoff(results.contact(steps[number]), roundoff)
        shown = pairs_shown(nodes, len(names), MOST_PAIRS)
        draw_slaves(axes, nodes, {k: names[k] for k in shown}, frame.unit)

    return figure, draw


def _in_space(
    results: Results, steps: list[int], states: list[Bodies], scale: ColourScale
) -> tuple[Figure, Callable[[int], None]]:
    low = np.min([state.position.min(axis=0) for state in states], axis=0)
    high = np.max([state.position.max(axis=0) for state in states], axis=0)
    tools = [tool_triangles(results, step) for step in steps]
    drawn = [some for some in tools if some is not None]
    low, high = room_for(low, high, np.concatenate(drawn) if drawn else None)
    scenes = [scene_of(state, scale, low, high) for state in states]
    width, height = scenes[0].size
    figure, axes = _page(scale, states, 0.75 * height / width)

    def draw(number: int) -> None:
        axes.clear()
        scene = scenes[number]
        view = View(scene, facets_seen(scene), veil_of(scene, tools[number]))
        draw_space(axes, view, states[number].names)

    return figure, draw
