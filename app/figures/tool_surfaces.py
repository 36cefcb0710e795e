"""Rigid tools in pictures of space: translucent before what they hide, hidden by what is nearer.

Axis letters: c triangles, a their corners, i space.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from tribox.app.figures.plane_bodies import Frame
from tribox.app.figures.scenes import EYE, RIGHT, UP, Scene, brightness, changes, facets_seen
from tribox.app.figures.style import Floats
from tribox.app.figures.units import fitting

if TYPE_CHECKING:
    from tribox.app.results import Results

VEIL, LINE = 0.35, 0.9  # opacity of a tool, and of the lines round what is seen of it
PARTS = 16  # of the picture, that a triangle spans at most: larger ones are divided
NEARER = 2e-3  # of the frame, that tools are moved to the eye, to be before what they touch


def tool_triangles(results: Results, step: int) -> Floats | None:
    """Triangles, in the plane lines, (c, a, i), m, of all tools; None in a case without tools.

    Raises:
        InputError: nothing was written at this step.
    """
    if not results.case.tools:
        return None
    mesh = results.grid("tools", step)
    found: Floats = np.asarray(mesh.points[mesh.cells[0].data], dtype=np.float64)
    return found


def room_for(low: Floats, high: Floats, triangles: Floats | None) -> tuple[Floats, Floats]:
    """Corners (i,), m, of a frame round bodies, with some room where there are tools."""
    if triangles is None or not triangles.size:
        return low, high
    points, room = triangles.reshape(-1, len(low)), ROOM * float((high - low).max())
    return (
        np.minimum(low, np.maximum(points.min(axis=0), low - room)),
        np.maximum(high, np.minimum(points.max(axis=0), high + room)),
    )


def veil_of(scene: Scene, triangles: Floats | None) -> Floats | None:
    """Colours and opacity (h, w, 4) of the tools over the picture of a scene; None without any."""
    if triangles is None:
        return None
    # What may be seen (c, a, i) of triangles, in parts that are small beside the picture.
    low, high = scene.window
    plane, most = np.stack([RIGHT, UP]).T, float((high - low).max()) / PARTS
    done, rest = [], np.asarray(triangles, dtype=np.float64)
    while len(rest):
        flat = rest @ plane
        inside = (flat.max(axis=1) >= low).all(axis=1) & (flat.min(axis=1) <= high).all(axis=1)
        small: NDArray[np.bool_] = np.ptp(flat, axis=1).max(axis=1) <= most
        done.append(rest[inside & small])
        a, b, c = np.moveaxis(rest[inside & ~small], 1, 0)  # four of each
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        rest = np.concatenate([np.stack(part, axis=1) for part in parts])
    near = np.concatenate(done) if done else rest
    near = near + NEARER * float((scene.high - scene.low).max()) * EYE
    corners = scene.polygons.shape[1]
    numbers = len(scene.position) + np.arange(near[..., 0].size).reshape(-1, 3)
    added = numbers[:, [0, 1, 2, 2][:corners]]  # a triangle as a quadrilateral of no fourth side
    both = replace(
        scene,
        position=np.concatenate([scene.position, near.reshape(-1, 3)]),
        polygons=np.concatenate([scene.polygons, added]),
    )
    seen = facets_seen(both)
    tool = seen >= len(scene.polygons)
    out = np.zeros((*seen.shape, 4))
    out[tool, :3] = np.array(to_rgb(COLOUR)) * brightness(both)[seen[tool], None]
    out[tool, 3] = VEIL
    out[changes(tool.astype(np.int64)), :] = (*to_rgb(COLOUR), LINE)
    return out


# -- Rigid tools in pictures of the plane: their outlines, and room for them in the frame ----------

ROOM = 0.12  # of the largest extent, that a tool is shown of beside the bodies at most
COLOUR = "#2b4c7e"


def tool_lines(results: Results, step: int) -> Floats | None:
    """Lines (c, 2, 2), m, of all tools at a step; None in a case without tools."""
    cells = tool_triangles(results, step)
    return None if cells is None else cells[..., :2]


def with_room(frame: Frame, lines: Floats | None) -> Frame:
    """The frame with some room where there are tools beside the bodies."""
    if lines is None or frame.stretched:
        return frame
    low, high = room_for(frame.low, frame.high, lines)
    return replace(frame, low=low, high=high, unit=fitting([(high - low).max()], "m"))


def draw_tools(axes: Axes, lines: Floats | None, frame: Frame) -> None:
    """Draw the outlines; what is outside of the frame is cut off."""
    if lines is None:
        return
    scaled = list(lines * frame.unit.factor)
    axes.add_collection(LineCollection(scaled, colors=COLOUR, linewidths=1.6, zorder=3))
