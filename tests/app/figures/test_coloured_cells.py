"""Cells drawn colour by colour, against each cell drawn by itself."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from tribox.app.figures.body_shapes import colour_scale
from tribox.app.figures.plane_bodies import EDGE, coloured_cells


def picture(artist) -> np.ndarray:
    """Pixels (h, w, 3) of cells that fill the unit square."""
    figure = Figure(figsize=(4.0, 4.0), dpi=100)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.add_collection(artist, autolim=False)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].astype(int)


def test_the_picture_is_that_of_each_cell_by_itself():
    """Cells of some pixels, values beyond both ends of the scale and one that is no number."""
    lines = np.linspace(0.0, 1.0, 21)
    x, y = np.meshgrid(lines, lines)
    nodes = np.stack([x + 0.02 * np.sin(6.0 * y) * x * (1 - x), y], axis=-1)
    sides = nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]
    corners = np.stack(sides, axis=2).reshape(-1, 4, 2)
    values = np.sin(np.arange(400.0)) * 1e6
    scale = colour_scale(values, "Pa")
    values[:3] = -3e6, 3e6, np.nan
    ours = coloured_cells(corners, values, scale)
    each = PolyCollection(
        corners,
        array=values * scale.unit.factor,
        norm=scale.norm,
        cmap=scale.colours,
        edgecolors="face",
        linewidths=EDGE,
        snap=False,
    )
    assert len(ours.get_paths()) < 257
    found, expected = picture(ours), picture(each)
    # Apart only on the lines between cells, where the one drawn last is seen.
    inner = np.ones((20, 20), dtype=bool)
    inner[3:-3, 3:-3] = False
    between = np.tile(inner, (20, 20))
    np.testing.assert_array_equal(found[~between], expected[~between])
    assert (found[~between] != 255).any(axis=-1).sum() == 399 * 14 * 14
