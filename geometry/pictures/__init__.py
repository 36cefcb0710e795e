"""Pictures of a mesh: bodies in colour, surfaces drawn and labelled; in space from outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import dolfinx
import numpy as np
import numpy.typing as npt
from matplotlib import color_sequences
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpi4py import MPI
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from tribox.geometry.compat import cell_nodes, cell_order, entity_nodes
from tribox.geometry.meshes.mesh import NamedMesh

MAX_FACETS_OUTLINED = 20_000
"""Facets beyond which their edges are left out: they would only blacken the picture."""

CYCLIC = {3: [0, 1, 2], 4: [0, 1, 3, 2], 6: [0, 5, 1, 3, 2, 4], 9: [0, 4, 1, 6, 3, 7, 2, 5]}
"""Nodes round a polygon, by their number: DOLFINx numbers corners row by row, then the edges."""

OTHERS = "other facets"

ELEVATION, AZIMUTH = 22.0, -62.0
"""Where the picture is seen from, degrees."""

Points = npt.NDArray[np.float64]

KINDS = {"held": "0.2", "moved": "#1b6ca8", "loaded": "#c2571a"}
"""What is done to a surface, and the colour that it is drawn in."""
TOOL = "#2b4c7e"
VEIL = 0.35  # opacity of tools in space
VIEWS = (
    ("", ELEVATION, AZIMUTH, ""),
    ("from behind and below", -22.0, 118.0, ""),
    ("from the front", 0.0, -90.0, "y"),
    ("from above", 90.0, -90.0, "z"),
)
"""Words, elevation and azimuth (degrees), and the axis of matplotlib that is looked along."""


@dataclass(frozen=True, slots=True)
class Arrow:
    """What is done to a surface or tool in one direction.

    Attributes:
        direction: (i,) of length one; None: across the surface, into its body.
        kind: one of `KINDS`.
    """

    direction: tuple[float, ...] | None
    kind: str


@dataclass(frozen=True, slots=True)
class Marks:
    """What a picture of a case shows beside its mesh.

    Attributes:
        words: of surfaces and tools, behind their names; arrows: likewise.
        tools: outlines by name: points (n, i), m, and lines (c, 2) or triangles (c, 3).
        pairs: lines of text.
    """

    words: Mapping[str, str] = field(default_factory=dict)
    arrows: Mapping[str, Sequence[Arrow]] = field(default_factory=dict)
    tools: Mapping[str, tuple[Points, npt.NDArray[Any]]] = field(default_factory=dict)
    pairs: Sequence[str] = ()

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


NO_MARKS = Marks()


def outer_facets(named: NamedMesh) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Facets (f,) of one cell only that this process owns, and the body's tag (f,) of each."""
    mesh = named.mesh
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    facets = dolfinx.mesh.exterior_facet_indices(mesh.topology)
    owned = mesh.topology.index_map(tdim - 1).size_local
    facets = np.asarray(facets[facets < owned], dtype=np.int32)
    to_cells = mesh.topology.connectivity(tdim - 1, tdim)
    cells = to_cells.array[to_cells.offsets[facets]]
    tags = np.zeros(int(named.cell_tags.indices.max(initial=-1)) + 1, dtype=np.int32)
    tags[named.cell_tags.indices] = named.cell_tags.values
    return facets, tags[cells]


def facet_polygons(mesh: dolfinx.mesh.Mesh, facets: npt.NDArray[np.int32], x: Points) -> Points:
    """Nodes (f, a, 3) round facets, on nodes at ``x`` (n, 3).

    Args:
        mesh: The mesh, in space.
        facets: Local facets (f,).
        x: Position of each node of the geometry, for instance the current one.
    """
    around = (4 if mesh.topology.cell_name() == "hexahedron" else 3) * cell_order(mesh)
    if not len(facets):
        return np.empty((0, around, 3))
    nodes = entity_nodes(mesh, 2, facets)
    return np.asarray(x[nodes][:, CYCLIC[nodes.shape[1]]], dtype=np.float64)


def add_facets(axes: Any, groups: Sequence[tuple[Points, str | tuple[float, ...]]]) -> None:
    """Draw groups of facets, y upwards, in axes of matplotlib's 3D kind.

    Args:
        groups: Corners (f, a, 3) in cyclic order, in the unit of the axes, and their colour.
    """
    polygons = np.concatenate([corners for corners, _ in groups])
    colours = np.concatenate([np.tile(to_rgba(c), (len(corners), 1)) for corners, c in groups])
    total = len(polygons)
    width = 0.0 if total > MAX_FACETS_OUTLINED else float(np.clip(12.0 / total**0.5, 0.05, 0.5))
    # One collection: facets are sorted by their distance within a collection only.
    axes.add_collection3d(
        Poly3DCollection(
            turned(polygons),
            facecolors=colours,
            edgecolors="0.35",
            linewidths=width,
        )
    )


def turned(x: Points) -> Points:
    """Positions (…, 3) with y in the place of z, which points upwards in matplotlib's axes."""
    return np.stack([x[..., 0], -x[..., 2], x[..., 1]], axis=-1)


def frame(axes: Any, x: Points, unit: str) -> None:
    """Equal scales, limits around the points (n, 3), and the axes' own names."""
    seen = turned(x)
    low, high = seen.min(axis=0), seen.max(axis=0)
    for letter, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{letter}lim")(a, b)
    axes.set_box_aspect(np.maximum(high - low, 1e-3 * (high - low).max()), zoom=0.8)
    axes.set(xlabel=f"x ({unit})", ylabel=f"−z ({unit})", zlabel=f"y ({unit})")
    axes.view_init(ELEVATION, AZIMUTH)
    axes.locator_params(nbins=5)


def draw_space(
    named: NamedMesh, title: str, factor: float, unit: str, marks: Marks = NO_MARKS
) -> Figure | None:
    """Draw the named surfaces and all other outer facets; collective.

    Args:
        named: A mesh in space.
        factor: From m to the unit of the axes.
        unit: Its name.
        marks: What is shown beside the mesh.

    Returns:
        The figure on the first process, None on the others.
    """
    mesh = named.mesh
    facets, _ = outer_facets(named)
    groups = {}
    for name in named.surfaces:
        groups[name] = np.intersect1d(named.facets(name), facets)
    rest = np.setdiff1d(facets, np.concatenate([*groups.values(), np.empty(0, np.int32)]))
    mine = {
        name: facet_polygons(mesh, found, mesh.geometry.x)
        for name, found in [*groups.items(), (OTHERS, rest.astype(np.int32))]
    }
    parts = mesh.comm.gather(mine)
    if parts is None:
        return None
    drawn = {name: factor * np.concatenate([part[name] for part in parts]) for name in mine}
    shown = {name: p for name, p in drawn.items() if len(p)}
    tools = {name: factor * points[cells] for name, (points, cells) in marks.tools.items()}
    return _figure(shown, tools, title, unit, marks)


def _figure(
    drawn: dict[str, Points], tools: dict[str, Points], title: str, unit: str, marks: Marks
) -> Figure:
    """Four views of the same, and the names with what is done to them."""
    figure = Figure(figsize=(13, 10), layout="constrained")
    colours = color_sequences["tab20"]
    shown = {
        name: "0.85" if name == OTHERS else colours[k % len(colours)]
        for k, name in enumerate(drawn)
    }
    whole = np.concatenate([p.reshape(-1, 3) for p in drawn.values()])
    groups: list[tuple[Points, str | tuple[float, ...]]] = []
    groups += [(drawn[name], shown[name]) for name in drawn]
    corners = next(iter(drawn.values())).shape[1]
    for triangles in tools.values():  # in one collection all polygons have as many corners
        groups.append((triangles[:, [*range(3), *[2] * (corners - 3)]], (*to_rgb(TOOL), VEIL)))
    every = np.concatenate([p.reshape(-1, 3) for p, _ in groups])
    for number, (words, elevation, azimuth, across) in enumerate(VIEWS, start=1):
        axes: Any = figure.add_subplot(2, 2, number, projection="3d", proj_type="ortho")
        add_facets(axes, groups)
        frame(axes, every, unit)
        axes.view_init(elevation, azimuth)
        axes.set_title(words, fontsize=9)
        if across:  # the axis that is looked along is a point
            axes.set(**{f"{across}ticks": [], f"{across}label": ""})
        _arrows(axes, {**drawn, **tools}, marks, 0.2 * float(np.ptp(whole, axis=0).max()))
    handles: list[Any] = [
        Patch(color=shown[name], label=_counted(name, len(drawn[name]), marks)) for name in drawn
    ]
    handles += [Patch(color=TOOL, alpha=VEIL, label=f"tool {marks.label(name)}") for name in tools]
    handles += marks.handles()
    figure.legend(handles=handles, loc="outside lower center", frameon=False, fontsize=9, ncols=2)
    figure.suptitle("\n".join((title, *marks.pairs)), fontsize=11)
    return figure


def _counted(name: str, facets: int, marks: Marks) -> str:
    """A surface with the number of its facets, and what is done to it."""
    words = marks.words.get(name)
    return f"{name}: {facets}; {words}" if words else f"{name}: {facets}"


def _arrows(axes: Any, places: Mapping[str, Points], marks: Marks, length: float) -> None:
    """An arrow from the middle of each surface or tool, for each thing that is done to it."""
    centre = np.concatenate([p.reshape(-1, 3) for p in places.values()]).mean(axis=0)
    for name, arrows in marks.arrows.items():
        if name not in places:
            continue
        middle = places[name].reshape(-1, 3).mean(axis=0)
        for arrow in arrows:
            inside = _inwards(places[name], centre)
            way = inside if arrow.direction is None else np.array(arrow.direction)
            tail = middle - length * way if arrow.direction is None else middle
            start, along = turned(tail), turned(length * way)
            colour = KINDS[arrow.kind]
            if arrow.kind == "held":
                ends = np.stack([start - 0.25 * along, start + 0.25 * along])
                axes.plot(*ends.T, color=colour, lw=2.5, zorder=9)
            else:
                axes.quiver(*start, *along, color=colour, lw=2.0, zorder=9)


def _inwards(polygons: Points, centre: Points) -> Points:
    """Mean direction across polygons (f, a, 3), to the side of a point."""
    normals = np.cross(polygons[:, 1] - polygons[:, 0], polygons[:, 2] - polygons[:, 1])
    away = np.einsum("fi,fi->f", normals, centre - polygons.mean(axis=1))
    mean = (normals * np.where(away < 0.0, -1.0, 1.0)[:, None]).sum(axis=0)
    return np.asarray(mean / (np.linalg.norm(mean) or 1.0))


# -- Meshes in the plane, and the picture of either ------------------------------------------------


MAX_CELLS_OUTLINED = 200_000
"""Cells beyond which their edges are left out: they would only blacken the picture."""

ROOM = 0.15  # of the largest extent, that a tool is shown of beside the bodies at most
WORDS = 0.07  # inches that a letter of what is said behind a name takes

ARROWS = 5  # on a surface
HEADING = 0.25  # inches of a line of the heading

BODY_WIDTH, BODY_HEIGHT, MARGIN, LABEL_PITCH = 6.5, 6.0, 2.0, 0.3
"""Largest extent of the bodies, room for labels on each side, and their least distance: inches."""


@dataclass(frozen=True, slots=True)
class _Outline:
    """The drawn lines, in m: the cells of bodies and the segments of surfaces.

    Attributes:
        cells: Nodes of each body's cells in cyclic order, (c, node, 2).
        segments: Nodes along each surface's facets, (f, node, 2).
        inwards: Unit vectors from each facet into its cell, (f, 2).
    """

    cells: dict[str, Points]
    segments: dict[str, Points]
    inwards: dict[str, Points]


def save_picture(
    named: NamedMesh, path: Path, title: str = "", dpi: int = 150, marks: Marks = NO_MARKS
) -> None:
    """Write a picture of the mesh; collective, the first process writes.

    The file appears under its name only when it is complete. Its format follows from the name
    (``.png``, ``.pdf``, ``.svg``). Surfaces are drawn a little inside their own body, so that two
    that touch can be distinguished.

    Raises:
        FileNotFoundError: If the directory does not exist.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"{path.parent}: no such directory")
    figure = draw(named, title, marks)
    if figure is None:
        return
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        figure.savefig(partial, dpi=dpi)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def draw(named: NamedMesh, title: str = "", marks: Marks = NO_MARKS) -> Figure | None:
    """Draw the mesh; collective.

    Returns:
        The figure on the first process, None on the others.
    """
    if named.mesh.geometry.dim == 3:
        x = named.mesh.geometry.x
        low = named.mesh.comm.allreduce(x.min(axis=0, initial=np.inf), op=MPI.MIN)
        high = named.mesh.comm.allreduce(x.max(axis=0, initial=-np.inf), op=MPI.MAX)
        return draw_space(named, title, *length_unit(float((high - low).max())), marks)
    parts = named.mesh.comm.gather(_local_outline(named), root=0)
    if parts is None:
        return None
    whole = _Outline(
        *(
            {name: np.concatenate([getattr(part, field)[name] for part in parts]) for name in names}
            for field, names in (
                ("cells", named.bodies),
                ("segments", named.surfaces),
                ("inwards", named.surfaces),
            )
        )
    )
    return _plane_figure(whole, title, marks)


def _local_outline(named: NamedMesh) -> _Outline:
    """The part of the picture that this process owns."""
    mesh = named.mesh
    mesh.topology.create_connectivity(1, 2)
    to_cells = mesh.topology.connectivity(1, 2)
    x, nodes = mesh.geometry.x[:, :2], cell_nodes(mesh)
    along = [0, 2, 1] if cell_order(mesh) == 2 else [0, 1]
    owned_cells, owned_facets = (mesh.topology.index_map(dim).size_local for dim in (2, 1))
    cells, segments, inwards = {}, {}, {}
    for name in named.bodies:
        own = named.cells(name)
        cells[name] = x[nodes[own[own < owned_cells]][:, CYCLIC[nodes.shape[1]]]]
    for name in named.surfaces:
        facets = named.facets(name)
        facets = facets[facets < owned_facets]
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
    low, high = _with_tools(corners.min(axis=0), corners.max(axis=0), marks)
    factor, unit = length_unit(float((high - low).max()))
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
    axes.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    figure.suptitle("\n".join((title, *marks.pairs)), fontsize=11 if marks.pairs else None)
    _draw_bodies(axes, outline, factor, marks)
    _draw_surfaces(axes, outline, factor, per_inch, marks)
    return figure


def _with_tools(low: Points, high: Points, marks: Marks) -> tuple[Points, Points]:
    """Corners (i,), m, of a frame round the bodies, with some room where there are tools."""
    room = ROOM * float((high - low).max())
    for points, _ in marks.tools.values():
        low, high = (
            np.minimum(low, np.maximum(points.min(axis=0), low - room)),
            np.maximum(high, np.minimum(points.max(axis=0), high + room)),
        )
    return low, high


def _draw_bodies(axes: Any, outline: _Outline, factor: float, marks: Marks) -> None:
    """The cells, one colour for each body, and a legend with their numbers."""
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
            colour = TOOL if name in tools else colours[list(lines).index(name) % len(colours)]
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
    for name, (points, cells) in marks.tools.items():
        segments = factor * points[cells]
        axes.add_collection(LineCollection(list(segments), color=TOOL, linewidth=2.0, zorder=3))
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
        way = inwards[chosen] if arrow.direction is None else np.array([arrow.direction[:2]])
        length = (0.16 if arrow.kind == "held" else 0.4) * per_inch
        along = np.broadcast_to(length * way, start.shape)
        if arrow.kind == "held":
            strokes = np.stack([start - along, start + along], axis=1)
            axes.add_collection(LineCollection(list(strokes), color=KINDS["held"], linewidth=2.0))
            continue
        tail = start - along if arrow.direction is None else start
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


def length_unit(size: float) -> tuple[float, str]:
    """The factor from m to a unit in which ``size`` has a few digits, and its name."""
    for factor, unit in ((1.0, "m"), (1e3, "mm"), (1e6, "µm")):
        if size * factor >= 1.0:
            return factor, unit
    return 1e9, "nm"
