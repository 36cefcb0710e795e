"""Rigid tools in pictures of the plane: their outlines, and room for them in the frame."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from tribox.app.figures.plane_bodies import Frame
from tribox.app.figures.style import Floats
from tribox.app.figures.units import fitting

if TYPE_CHECKING:
    from tribox.app.results import Results

ROOM = 0.12  # of the largest extent, that a tool is shown of beside the bodies at most
COLOUR = "#2b4c7e"


def tool_lines(results: Results, step: int) -> Floats | None:
    """Lines (c, 2, 2), m, of all tools at a step; None in a case without tools.

    Raises:
        InputError: nothing was written at this step.
    """
    if not results.case.tools:
        return None
    mesh = results.grid("tools", step)
    lines: Floats = np.asarray(mesh.points[mesh.cells[0].data][..., :2], dtype=np.float64)
    return lines


def with_room(frame: Frame, lines: Floats | None) -> Frame:
    """The frame with some room where there are tools beside the bodies."""
    if lines is None or frame.stretched:
        return frame
    points = lines.reshape(-1, 2)
    room = ROOM * float((frame.high - frame.low).max())
    low = np.minimum(frame.low, np.maximum(points.min(axis=0), frame.low - room))
    high = np.maximum(frame.high, np.minimum(points.max(axis=0), frame.high + room))
    return replace(frame, low=low, high=high, unit=fitting([(high - low).max()], "m"))


def draw_tools(axes: Axes, lines: Floats | None, frame: Frame) -> None:
    """Draw the outlines; what is outside of the frame is cut off."""
    if lines is None:
        return
    scaled = list(lines * frame.unit.factor)
    axes.add_collection(LineCollection(scaled, colors=COLOUR, linewidths=1.6, zorder=3))
