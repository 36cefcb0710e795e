"""Polygons in colours, one path for all that have the same one.

A colour map has some hundred colours and a mesh ten thousands of cells: drawn cell by cell, most of
the time goes into paths of four corners each.
"""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import PathCollection
from matplotlib.path import Path

from tribox.app.figures.field_values import ColourScale
from tribox.app.figures.style import Floats

EDGE = 0.3  # points, a line round each cell: or the page would shine through between them


def coloured_cells(corners: Floats, values: Floats, scale: ColourScale) -> PathCollection:
    """Filled polygons.

    Args:
        corners: (f, a, 2) of the polygons, in the unit of the axes.
        values: (f,) SI.
        scale: of the colours.

    Returns:
        A path for each colour, its number the first of the values that have it.
    """
    values = values * scale.unit.factor
    colours = colormaps[scale.colours](scale.norm(values), bytes=True).view(np.uint32)[:, 0]
    order = np.argsort(colours, kind="stable")
    starts = np.flatnonzero(np.diff(colours[order], prepend=~colours[order[:1]]))
    closed = np.concatenate([corners, corners[:, :1]], axis=1)[order]
    codes = np.full(closed.shape[:2], Path.LINETO, dtype=Path.code_type)
    codes[:, 0], codes[:, -1] = Path.MOVETO, Path.CLOSEPOLY
    parts = (np.split(whole, starts[1:]) for whole in (closed, codes))
    return PathCollection(
        [Path(places.reshape(-1, 2), how.reshape(-1)) for places, how in zip(*parts, strict=True)],
        array=values[order[starts]],
        norm=scale.norm,
        cmap=scale.colours,
        edgecolors="face",
        linewidths=EDGE,
        snap=False,
    )
