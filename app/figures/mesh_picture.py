"""Pictures of a mesh: bodies in colour, surfaces drawn and labelled; in space from outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
import numpy.typing as npt
from matplotlib import color_sequences, rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator

from tribox.app.figures import scenes
from tribox.app.figures.style import Unit, fitting, save
from tribox.geometry.compat import cell_nodes, cell_order, entity_nodes
from tribox.geometry.meshes.mesh import NamedMesh

CYCLIC = {3: [0, 1, 2], 4: [0, 1, 3, 2], 6: [0, 5, 1, 3, 2, 4], 9: [0, 4, 1, 6, 3, 7, 2, 5]}
"""Nodes round a polygon, by their number: DOLFINx numbers corners row by row, then the edges."""

OTHERS = "other facets"

Points = npt.NDArray[np.float64]

KINDS = {"held": "0.2", "moved": "#1b6ca8", "loaded": "#c2571a"}
"""What is done to a surface, and the colour that it is drawn in."""
BACK = (-scenes.OBLIQUE[0], -scenes.OBLIQUE[1], -scenes.OBLIQUE[2])
VIEWS = {
    "": scenes.OBLIQUE,
    "from behind and below": BACK,
    "from the front": (0.0, 1.0, 0.0),
    "from above": (0.0, 0.0, 1.0),
}
"""Where bodies in space are seen from, as of :func:`camera_at`; along an axis with a ruler."""
DARKEST = 0.8  # brightness of facets turned away: colours are told apart by the legend
FLAT = 2.0  # area seen along z over that along y, from which on z points upwards


@dataclass(frozen=True, slots=True)
class Arrow:
    """What is done to a surface or tool in one direction."""

    # (i,) of length one; None: across the surface, into its body
    direction: tuple[float, ...] | None
    kind: str  # one of `KINDS`
    presses: bool = False  # whether the sense of the direction is that into the body

    def ways(self, inwards: Points) -> Points:
        """Where the arrow points (n, i) on a surface with directions (n, i) into its body."""
        if self.direction is None:
            return inwards
        way = np.array(self.direction[: inwards.shape[1]])
        turned = self.presses & (inwards @ way < 0.0)
        return np.where(turned[:, None], -way, way)

    @property
    def comes(self) -> bool:
        """Whether it ends on the surface and does not begin there."""
        return self.presses or self.direction is None


@dataclass(frozen=True, slots=True)
class Marks:
    """What a picture of a case shows beside its mesh."""

    # of surfaces and tools, behind their names
    words: Mapping[str, str] = field(default_factory=dict)
    arrows: Mapping[str, Sequence[Arrow]] = field(default_factory=dict)  # likewise
    # outlines by name: points (n, i), m, and lines (c, 2) or triangles (c, 3)
    tools: Mapping[str, tuple[Points, npt.NDArray[Any]]] = field(default_factory=dict)
    pairs: Sequence[str] = ()  # lines of text
    slaves: Sequence[str] = ()  # their surfaces

    def label(self, name: str) -> str:
        """A name with its words."""
        return f"{name}: {self.words[name]}" if self.words.get(name) else name

    def handles(self) -> list[Line2D]:
        """Of a legend: the kinds of arrows that there are."""
        found = {arrow.kind for arrows in self.arrows.values() for arrow in arrows}
        return [
            Line2D([], [], color=colour, lw=2.5, label=kind)
            for kind, colour in KINDS.items()
            if kind in found
        ]

    def outlines(self, factor: float = 1.0) -> dict[str, Points]:
        """Lines or triangles (c, a, i) of the tools, from m by a factor."""
        return {name: factor * points[cells] for name, (points, cells) in self.tools.items()}


NO_MARKS = Marks()


@dataclass(frozen=True, slots=True)
class _Hull:
    """The outer facets of bodies in space."""

    corners: Points  # (f, a, 3), m, nodes round them
    surface: npt.NDArray[np.int64]  # (f,) number of the surface of each, the last of all: of none
    body: npt.NDArray[np.int64]  # (f,) likewise


def _hull(named: NamedMesh) -> _Hull:
    mesh = named.mesh
    mesh.topology.create_connectivity(2, 3)
    facets = dolfinx.mesh.exterior_facet_indices(mesh.topology)
    to_cells = mesh.topology.connectivity(2, 3)
    cells = to_cells.array[to_cells.offsets[facets]]
    surface, body = np.full(len(facets), len(named.surfaces)), np.zeros(len(facets), np.int64)
    for number, name in enumerate(named.surfaces):
        surface[np.isin(facets, named.facets(name))] = number
    for number, name in enumerate(named.bodies):
        body[np.isin(cells, named.cells(name))] = number
    nodes = entity_nodes(mesh, 2, facets)
    return _Hull(mesh.geometry.x[nodes][:, CYCLIC[nodes.shape[1]]], surface, body)


def _space_figure(named: NamedMesh, hull: _Hull, title: str, marks: Marks) -> Figure:
    """Four views of the same, and the names with what is done to them."""
    figure = Figure(figsize=(13, 10), layout="constrained")
    colours = color_sequences["tab20"]
    names = (*named.surfaces, OTHERS)
    shown = {name: colours[k % len(colours)] for k, name in enumerate(named.surfaces)}
    shown[OTHERS] = to_rgb("0.85")
    places = {name: hull.corners[hull.surface == k] for k, name in enumerate(names)}
    tools = marks.outlines()
    every = np.concatenate(list(tools.values())) if tools else None
    nodes = hull.corners.reshape(-1, 3)
    scene = scenes.Scene(
        nodes,
        np.arange(len(nodes)).reshape(hull.corners.shape[:2]),
        np.array([shown[name] for name in names])[hull.surface],
        hull.body,
        *scenes.room_for(nodes.min(axis=0), nodes.max(axis=0), every),
        ambient=DARKEST,
    )
    unit = fitting(np.ptp(nodes, axis=0), "m")
    upwards = _upwards(hull, names, marks)
    for number, (words, eye) in enumerate(VIEWS.items(), start=1):
        seen = replace(scene, camera=scenes.camera_at(eye, upwards))
        view = scenes.View(seen, scenes.facets_seen(seen), scenes.veil_of(seen, every))
        axes = figure.add_subplot(2, 2, number)
        if 1.0 in eye:
            scenes.show(axes, view)
            _rule(axes, seen.camera, unit)
        else:
            scenes.draw_space(axes, view, tuple(named.bodies))
        axes.set_title(words, fontsize=9)
        _space_arrows(axes, seen, {**places, **tools}, marks)
        axes.autoscale_view()
    handles: list[Any] = [
        Patch(color=shown[name], label=_counted(name, len(facets), marks))
        for name, facets in places.items()
        if len(facets)
    ]
    handles += [
        Patch(color=scenes.TOOL, alpha=scenes.VEIL, label=f"tool {marks.label(name)}")
        for name in tools
    ]
    handles += marks.handles()
    figure.legend(handles=handles, loc="outside lower center", frameon=False, fontsize=9, ncols=2)
    figure.suptitle("\n".join((title, *marks.pairs)), fontsize=11)
    return figure


def _upwards(hull: _Hull, names: Sequence[str], marks: Marks) -> int:
    """The axis that points upwards: 1 (y), or 2 where contacts or bodies lie flat.

    Drawings have z upwards as often as not, and a sheet across it would be seen as a wall.
    """
    slaves = [k for k, name in enumerate(names) if name in marks.slaves]
    flat = np.isin(hull.surface, slaves)
    normals = scenes.area_vectors(hull.corners[flat] if flat.any() else hull.corners)
    _, along_y, along_z = np.abs(normals).sum(axis=0)
    return 2 if along_z > FLAT * along_y else 1


def _rule(axes: Axes, camera: scenes.Camera, unit: Unit) -> None:
    """Ticks along a picture that is seen along an axis, with the names of the other two."""
    for axis, along in ((axes.xaxis, camera.right), (axes.yaxis, camera.up)):
        letter = int(np.argmax(np.abs(along)))
        sign = float(np.sign(along[letter]))  # seen from above z points downwards
        axis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
        axis.set_major_formatter(FuncFormatter(lambda v, _, sign=sign: unit.number(sign * v)))
        axis.set_label_text(f"{'xyz'[letter]} ({unit.name})")


def _counted(name: str, facets: int, marks: Marks) -> str:
    """A surface with the number of its facets, and what is done to it."""
    words = marks.words.get(name)
    return f"{name}: {facets}; {words}" if words else f"{name}: {facets}"


def _space_arrows(
    axes: Axes, scene: scenes.Scene, places: Mapping[str, Points], marks: Marks
) -> None:
    """An arrow from the middle of each surface or tool, for each thing that is done to it."""
    length = 0.2 * float(np.ptp(scene.position, axis=0).max())
    centre = scene.position.mean(axis=0)
    for name, arrows in marks.arrows.items():
        if not len(places.get(name, ())):
            continue
        # The middle of a tool may lie far beyond the frame, which it would widen.
        middle = np.clip(places[name].mean(axis=(0, 1)), scene.low, scene.high)
        # Mean direction across polygons (f, a, 3), to the side of a point
        polygons = places[name]
        normals = scenes.area_vectors(polygons)
        away = np.einsum("fi,fi->f", normals, centre - polygons.mean(axis=1))
        mean = (normals * np.where(away < 0.0, -1.0, 1.0)[:, None]).sum(axis=0)
        inside = np.asarray(mean / (np.linalg.norm(mean) or 1.0))
        for arrow in arrows:
            along = length * arrow.ways(inside[None])[0]
            start = (middle - along if arrow.comes else middle) @ scene.camera.plane
            across, colour = along @ scene.camera.plane, KINDS[arrow.kind]
            if arrow.kind == "held":
                ends = np.stack([start - 0.25 * across, start + 0.25 * across])
                axes.plot(*ends.T, color=colour, lw=2.5, zorder=9)
            elif np.linalg.norm(across) > 0.05 * length:  # else towards the eye or away from it
                axes.update_datalim([start, start + across])
                axes.annotate("", tuple(start + across), tuple(start), zorder=9, arrowprops={
                    "arrowstyle": "-|>", "lw": 2.0, "color": colour, "shrinkA": 0, "shrinkB": 0,
                })  # fmt: skip


# -- Meshes in the plane, and the picture of either ------------------------------------------------


MAX_CELLS_OUTLINED = 200_000
"""Cells beyond which their edges are left out: they would only blacken the picture."""

WORDS = 0.07  # inches that a letter of what is said behind a name takes

ARROWS = 5  # on a surface
HEADING = 0.25  # inches of a line of the heading

BODY_WIDTH, BODY_HEIGHT, MARGIN, LABEL_PITCH = 6.5, 6.0, 2.0, 0.3
"""Largest extent of the bodies, room for labels on each side, and their least distance: inches."""


@dataclass(frozen=True, slots=True)
class _Outline:
    """The drawn lines, in m: the cells of bodies and the segments of surfaces."""

    cells: dict[str, Points]  # nodes of each body's cells in cyclic order, (c, node, 2)
    segments: dict[str, Points]  # nodes along each surface's facets, (f, node, 2)
    inwards: dict[str, Points]  # unit vectors from each facet into its cell, (f, 2)


def save_picture(named: NamedMesh, path: Path, title: str, marks: Marks = NO_MARKS) -> None:
    """Write a picture (PNG) of a mesh on one process, complete or not at all."""
    with rc_context({"figure.dpi": 150, "text.parse_math": False}):
        save(draw(named, title, marks), path)


def draw(named: NamedMesh, title: str = "", marks: Marks = NO_MARKS) -> Figure:
    """Draw a mesh on one process."""
    if named.mesh.geometry.dim == 3:
        return _space_figure(named, _hull(named), title, marks)
    return _plane_figure(_outline(named), title, marks)


def _outline(named: NamedMesh) -> _Outline:
    mesh = named.mesh
    mesh.topology.create_connectivity(1, 2)
    to_cells = mesh.topology.connectivity(1, 2)
    x, nodes = mesh.geometry.x[:, :2], cell_nodes(mesh)
    along = [0, 2, 1] if cell_order(mesh) == 2 else [0, 1]
    cells, segments, inwards = {}, {}, {}
    for name in named.bodies:
        cells[name] = x[nodes[named.cells(name)][:, CYCLIC[nodes.shape[1]]]]
    for name in named.surfaces:
        facets = named.facets(name)
        ends = entity_nodes(mesh, 1, facets)
        first = to_cells.array[to_cells.offsets[facets]]
        segments[name] = x[ends[:, along]]
        inwards[name] = _inward(x[ends], x[nodes[first]].mean(axis=1))
    return _Outline(cells, segments, inwards)


def _inward(segments: Points, centres: Points) -> Points:
    """Unit normals (f, 2) of segments, ends first (f, ≥ 2, 2), on the side of centres (f, 2)."""
    along = segments[:, 1] - segments[:, 0]
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    side = np.einsum("fi,fi->f", normal, centres - segments.mean(axis=1))
    return np.asarray(normal * np.where(side < 0.0, -1.0, 1.0)[:, None])


def _plane_figure(outline: _Outline, title: str, marks: Marks) -> Figure:
    """The whole picture, at a scale that leaves room for the labels beside the bodies."""
    corners = np.concatenate([c.reshape(-1, 2) for c in outline.cells.values()])
    tools = list(marks.outlines().values())
    every = np.concatenate(tools)[..., :2] if tools else None
    low, high = scenes.room_for(corners.min(axis=0), corners.max(axis=0), every)
    unit = fitting(high - low, "m")
    factor = unit.factor
    centre, span = 0.5 * (low + high) * factor, (high - low) * factor
    per_inch = max(span[0] / BODY_WIDTH, span[1] / BODY_HEIGHT)
    labels = len(outline.segments) + len(marks.tools)
    rows = max(span[1] / per_inch + 0.5, LABEL_PITCH * (labels / 2 + 2))
    margin = MARGIN + WORDS * (max(map(len, marks.words.values()), default=0))
    width, height = span[0] / per_inch + 2.0 * margin, rows
    heading = 1.3 + HEADING * len(marks.pairs)
    figure = Figure(figsize=(width + 1.0, height + heading), layout="constrained")
    axes = figure.add_subplot()
    axes.set_xlim(centre[0] + np.array([-0.5, 0.5]) * width * per_inch)
    axes.set_ylim(centre[1] + np.array([-0.5, 0.5]) * height * per_inch)
    axes.set_aspect("equal")
    axes.set(xlabel=f"x ({unit.name})", ylabel=f"y ({unit.name})")
    figure.suptitle("\n".join((title, *marks.pairs)), fontsize=11 if marks.pairs else None)
    # The cells, one colour for each body, and a legend with their numbers.
    colours = color_sequences["Pastel1"]
    total = sum(len(c) for c in outline.cells.values())
    width = 0.0 if total > MAX_CELLS_OUTLINED else float(np.clip(20.0 / total**0.5, 0.05, 0.6))
    for k, (name, cells) in enumerate(outline.cells.items()):
        kind = "quadrilaterals" if cells.shape[1] % 4 == 0 else "triangles"
        patches = PolyCollection(
            list(cells * factor),
            facecolor=colours[k % len(colours)],
            edgecolor="0.35",
            linewidth=width,
            label=f"{name}: {len(cells)} {kind}",
        )
        axes.add_collection(patches)
    handles = [*axes.get_legend_handles_labels()[0], *marks.handles()]
    axes.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False
    )
    _draw_surfaces(axes, outline, factor, per_inch, marks)
    return figure


def _draw_surfaces(
    axes: Any, outline: _Outline, factor: float, per_inch: float, marks: Marks
) -> None:
    """The named surfaces, just inside their bodies, tools, and their labels in the margins."""
    colours = color_sequences["tab10"]
    lines = {}
    for k, (name, segments) in enumerate(outline.segments.items()):
        shift = 0.02 * per_inch * outline.inwards[name][:, None, :]
        lines[name] = segments * factor + shift
        colour = colours[k % len(colours)]
        axes.add_collection(LineCollection(list(lines[name]), color=colour, linewidth=2.5))
        _draw_arrows(axes, name, lines[name], outline.inwards[name], per_inch, marks)
    tools = _draw_tools(axes, factor, per_inch, marks)
    lines |= tools
    sides = _label_sides(lines, float(np.mean(axes.get_xlim())))
    middle = float(np.mean(axes.get_ylim()))
    for side in (-1, 1):
        points = {name: _label_point(lines[name], side) for name in lines if sides[name] == side}
        edge = axes.get_xlim()[(side + 1) // 2] - side * 0.1 * per_inch
        for row, name in enumerate(sorted(points, key=lambda n: float(points[n][1]))):
            y = middle + (row - 0.5 * (len(points) - 1)) * _pitch(axes, len(points), per_inch)
            colour = (
                scenes.TOOL if name in tools else colours[list(lines).index(name) % len(colours)]
            )
            axes.annotate(
                f"tool {marks.label(name)}" if name in tools else marks.label(name),
                points[name],
                (edge, y),
                color=colour,
                fontsize=9,
                ha="left" if side < 0 else "right",
                va="center",
                arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.8},
            )
            axes.plot(*points[name], "o", color=colour, markersize=4)


def _draw_tools(axes: Any, factor: float, per_inch: float, marks: Marks) -> dict[str, Points]:
    """Outlines of the tools; the lines (f, 2, 2) of each that are in the frame."""
    low, high = (np.array(pair) for pair in zip(axes.get_xlim(), axes.get_ylim(), strict=True))
    seen = {}
    for name, segments in marks.outlines(factor).items():
        axes.add_collection(
            LineCollection(list(segments), color=scenes.TOOL, linewidth=2.0, zorder=3)
        )
        middle = segments.mean(axis=1)
        inside = segments[((middle >= low) & (middle <= high)).all(axis=1)]
        seen[name] = inside if len(inside) else segments
        _draw_arrows(axes, name, seen[name], np.zeros((len(seen[name]), 2)), per_inch, marks)
    return seen


def _draw_arrows(
    axes: Any, name: str, lines: Points, inwards: Points, per_inch: float, marks: Marks
) -> None:
    """What is done to a surface: strokes across what is held, arrows for motions and loads."""
    chosen = np.unique(np.linspace(0, len(lines) - 1, ARROWS + 2).round().astype(int)[1:-1])
    for arrow in marks.arrows.get(name, ()):
        start = lines[chosen].mean(axis=1)
        length = (0.16 if arrow.kind == "held" else 0.4) * per_inch
        along = length * arrow.ways(inwards[chosen])
        if arrow.kind == "held":
            strokes = np.stack([start - along, start + along], axis=1)
            axes.add_collection(LineCollection(list(strokes), color=KINDS["held"], linewidth=2.0))
            continue
        tail = start - along if arrow.comes else start
        axes.quiver(
            *tail.T, *along.T, color=KINDS[arrow.kind], angles="xy", scale_units="xy", scale=1.0,
            width=0.004, zorder=4,
        )  # fmt: skip


def _pitch(axes: Any, labels: int, per_inch: float) -> float:
    """Distance of labels above one another, spreading them over the height of the picture."""
    low, high = axes.get_ylim()
    return float(max(LABEL_PITCH * per_inch, (high - low) / (labels + 1)))


def _label_sides(lines: dict[str, Points], centre: float) -> dict[str, int]:
    """On which side, -1 left or 1 right, each surface is labelled.

    Surfaces that lie to one side are labelled there, the others where there are fewer labels.
    """
    sides: dict[str, int] = {}
    across: list[str] = []
    for name, drawn in lines.items():
        low, high = drawn[..., 0].min(), drawn[..., 0].max()
        if low < centre < high:
            across.append(name)
        else:
            sides[name] = -1 if high <= centre else 1
    for name in across:
        sides[name] = -1 if sum(sides.values()) > 0 else 1
    return sides


def _label_point(drawn: Points, side: int) -> Points:
    """The middle of the facet a label points to: near the surface's end on the label's side."""
    middles = drawn.mean(axis=1)
    low, high = drawn[..., 0].min(), drawn[..., 0].max()
    target = np.array([0.5 * (low + high) + side * 0.35 * (high - low), middles[:, 1].mean()])
    return np.asarray(middles[np.argmin(((middles - target) ** 2).sum(axis=1))])
