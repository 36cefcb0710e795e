"""Pictures of bodies in space: their outer facets, seen from the front, the right and above."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import dolfinx
import numpy as np
import numpy.typing as npt
from matplotlib import color_sequences
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
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


def outer_facets(named: NamedMesh) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Facets (f,) of one cell only that this process owns, and the body's tag (f,) of each.

    Those of carriers are not among them.
    """
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
    of_body = np.isin(tags[cells], list(named.bodies.values()))
    return facets[of_body], tags[cells[of_body]]


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


def draw_space(named: NamedMesh, title: str, factor: float, unit: str) -> Figure | None:
    """Draw the named surfaces and all other outer facets; collective.

    Args:
        named: A mesh in space.
        title: Heading of the picture.
        factor: From m to the unit of the axes.
        unit: Its name.

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
    return _figure({name: p for name, p in drawn.items() if len(p)}, title, unit)


def _figure(drawn: dict[str, Points], title: str, unit: str) -> Figure:
    figure = Figure(figsize=(10, 7.5), layout="constrained")
    axes = figure.add_subplot(projection="3d")
    colours = color_sequences["tab20"]
    shown = {
        name: "0.85" if name == OTHERS else colours[k % len(colours)]
        for k, name in enumerate(drawn)
    }
    add_facets(axes, [(drawn[name], shown[name]) for name in drawn])
    handles = [Patch(color=shown[name], label=f"{name}: {len(drawn[name])}") for name in drawn]
    frame(axes, np.concatenate([p.reshape(-1, 3) for p in drawn.values()]), unit)
    figure.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=9)
    figure.suptitle(title)
    return figure
