"""Bodies in the plane: deformed cells in colour, their old outline, names, and slave surfaces.

A colour map has some hundred colours and a mesh ten thousands of cells: drawn cell by cell, most of
the time goes into paths of four corners each. So cells of one colour are one path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import withStroke

from tribox.app.figures.body_shapes import Bodies, ColourScale
from tribox.app.figures.style import RED, Floats, Unit, fitting
from tribox.app.figures.tractions import facets_of, line_starts

if TYPE_CHECKING:
    import meshio
SLENDER = 6.0  # extent over extent from which on the shorter one is stretched
SMALL = 0.15  # extent of what is pressed over that of the bodies, below which it is seen close up
CELLS_OUTLINED = 4000
MESH_WIDTH = 0.3  # points
# Distinct from each other and from the colours of the fields.
PAIR_COLOURS = ("#e6399b", "#ff7f0e", "#111111", "#00b5d8", "#8c4a2f", RED)


EDGE = 0.3  # points, a line round each cell: or the page would shine through between them


def coloured_cells(corners: Floats, values: Floats, scale: ColourScale) -> PathCollection:
    """Filled polygons (f, a, 2), in the axes' unit, by values (f,), SI: a path for each colour."""
    values = values * scale.unit.factor
    colours = colormaps[scale.colours](scale.norm(values), bytes=True).view(np.uint32)[:, 0]
    order = np.argsort(colours, kind="stable")
    # Before the first stands what is surely another colour, so that it begins a path as well.
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


@dataclass(frozen=True, slots=True)
class Frame:
    """What a picture in the plane shows."""

    low: Floats  # (2,), m, corners round bodies and old outlines
    high: Floats  # likewise
    unit: Unit  # of the axes
    stretched: bool  # whether the scales differ
    names: tuple[str, str]  # of the axes

    @property
    def is_tall(self) -> bool:
        """Whether there is more room beside the bodies than below them."""
        width, height = self.high - self.low
        return bool(not self.stretched and height > 1.2 * width)

    @property
    def words(self) -> str:
        """What to say of its proportions."""
        width, height = self.high - self.low
        return f" ({self.names[bool(width > height)]} stretched)" if self.stretched else ""

    def height_over(self, across: float, least: float, most: float) -> float:
        """Inches for bodies ``across`` wide, between two limits."""
        width, height = self.high - self.low
        return 4.0 if self.stretched else float(np.clip(across * height / width, least, most))


def frame_round(states: Sequence[Bodies], names: tuple[str, str]) -> Frame:
    """A frame round all states, and round what they were before."""
    places = [p[:, :2] for one in states for p in (one.position, one.reference)]
    low = np.min([p.min(axis=0) for p in places], axis=0)
    high = np.max([p.max(axis=0) for p in places], axis=0)
    extent = np.maximum(high - low, 1e-300)
    stretched = bool(extent.max() > SLENDER * extent.min())
    return Frame(low, high, fitting([extent.max()], "m"), stretched, names)


def close_up(frame: Frame, nodes: meshio.Mesh) -> Frame | None:
    """A frame round what is pressed, where it would hardly be seen among the bodies; else None."""
    pressed = np.asarray(nodes.point_data["pressure"]) > 0.0
    if frame.stretched or not pressed.any():
        return None
    places = nodes.points[pressed, :2]
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    size = float(np.ptp(places, axis=0).max())
    whole = float((frame.high - frame.low).max())
    if size > SMALL * whole:
        return None
    half = 0.75 * max(size, 1e-3 * whole)
    return Frame(middle - half, middle + half, fitting([2.0 * half], "m"), False, frame.names)


def draw_bodies(
    axes: Axes, bodies: Bodies, scale: ColourScale, frame: Frame, *, named: bool = True
) -> PathCollection:
    """Draw all bodies of a state; returns the cells, which a colour bar can be made of."""
    factor = frame.unit.factor
    before = bodies.reference[bodies.edges, :2] * factor
    old = LineCollection(list(before), colors="0.6", linewidths=0.7, linestyles=":")
    cells = coloured_cells(bodies.corners(factor), bodies.field.values, scale)
    for drawn in (old, cells):  # the frame is known, so that nobody need seek their limits
        axes.add_collection(drawn, autolim=False)
    if len(bodies.polygons) < CELLS_OUTLINED:
        ends = np.stack([bodies.polygons, np.roll(bodies.polygons, -1, axis=1)], axis=-1)
        once = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0)
        sides = bodies.position[once, :2] * factor
        codes = np.tile(np.array([Path.MOVETO, Path.LINETO], dtype=Path.code_type), len(sides))
        lines = PathPatch(  # as one path they take a tenth of the time
            Path(sides.reshape(-1, 2), codes), fill=False, ec="k", alpha=0.25, lw=MESH_WIDTH,
            snap=False, zorder=2,
        )  # fmt: skip
        axes.add_artist(lines)  # as a patch its limits would be sought bit by bit
    around = bodies.position[bodies.edges, :2] * factor
    outline = LineCollection(list(around), colors="0.25", linewidths=0.8)
    axes.add_collection(outline, autolim=False)
    factor = frame.unit.factor
    low, high = frame.low * factor, frame.high * factor
    margin = 0.04 * (high - low) if frame.stretched else np.full(2, 0.04 * (high - low).max())
    axes.set_xlim(low[0] - margin[0], high[0] + margin[0])
    axes.set_ylim(low[1] - margin[1], high[1] + margin[1])
    if not frame.stretched:
        axes.set_aspect("equal", adjustable="box")
    axes.grid(False)
    axes.set_xlabel(f"{frame.names[0]} ({frame.unit.name})")
    axes.set_ylabel(f"{frame.names[1]} ({frame.unit.name})")
    if named:
        _name_bodies(axes, bodies, frame)
    return cells


def _name_bodies(axes: Axes, bodies: Bodies, frame: Frame) -> None:
    """The name of each body: on it, or at its right end where it is too thin for that."""
    extent = (frame.high - frame.low) * frame.unit.factor
    for number, name in enumerate(bodies.names):
        corners = bodies.corners(frame.unit.factor, np.flatnonzero(bodies.body == number))
        if not len(corners):
            continue
        middles = corners.mean(axis=1)
        low, high = corners.reshape(-1, 2).min(axis=0), corners.reshape(-1, 2).max(axis=0)
        thin = (high - low)[1] < 0.09 * extent[1]
        target = 0.5 * (low + high)
        if thin:
            target[0] = high[0]
        place = middles[np.argmin((((middles - target) / extent) ** 2).sum(axis=1))]
        axes.annotate(
            name,
            place,
            xytext=(6, 0) if thin else (0, 0),
            textcoords="offset points",
            ha="left" if thin else "center",
            va="center",
            fontsize=8,
            color="0.1",
            zorder=6,
            annotation_clip=False,
            path_effects=[withStroke(linewidth=2.2, foreground="w", alpha=0.8)],
        )


def pair_colour(pair: int) -> str:
    """The colour of a contact pair in all panels of a picture."""
    return PAIR_COLOURS[pair % len(PAIR_COLOURS)]


def draw_slaves(
    axes: Axes, nodes: meshio.Mesh, pairs: Mapping[int, str], unit: Unit
) -> list[LineCollection]:
    """Mark where pairs are pressed, a dot where their arc length begins; a collection each."""
    pressure = np.asarray(nodes.point_data["pressure"], dtype=np.float64)
    starts = line_starts(nodes, list(pairs))
    drawn = []
    for pair in pairs:
        facets = facets_of(nodes, pair)
        pressed = facets[(pressure[facets] > 0.0).all(axis=1)]
        if not len(pressed):
            pressed = facets[(pressure[facets] > 0.0).any(axis=1)]
        lines = nodes.points[pressed][..., :2] * unit.factor
        drawn.append(
            LineCollection(list(lines), colors=pair_colour(pair), linewidths=2.0, zorder=4)
        )
        axes.add_collection(drawn[-1])
        x, y = starts[pair] * unit.factor
        axes.plot(x, y, "o", ms=4, color=pair_colour(pair), mec="w", mew=0.6, zorder=5)
    return drawn
