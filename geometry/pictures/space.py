"""Pictures of bodies in space: their outer facets, seen from the front, the right and above."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import dolfinx
import numpy as np
import numpy.typing as npt
from matplotlib import color_sequences
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from tribox.geometry.compat import cell_order, entity_nodes
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
        axes: The axes.
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
        title: Heading of the picture.
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
