"""From a gmsh model to the arrays of a mesh; on one process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from types import ModuleType

import numpy as np
import numpy.typing as npt

from tribox.geometry.meshes.gmsh_model import (
    CORNERS,
    DIMENSION,
    FACETS,
    HEXAHEDRON,
    INTERVAL,
    KINDS,
    NUMBERS,
    PLACES,
    QUADRILATERAL,
    SIDES,
    Kind,
    MeshError,
    NamedGroups,
    elements_of,
    named_groups,
)
from tribox.geometry.meshes.mesh_arrays import MeshArrays, Part

_LOWER = {0: {15: 1}, 1: {1: 2, 8: 3}}
"""Of points and of edges, gmsh's kinds of elements and their numbers of nodes."""


_Named = dict[str, tuple[int, dict[Kind, npt.NDArray[np.int64]]]]


def arrays_of(gmsh: ModuleType, source: str) -> MeshArrays:
    """Check gmsh's current model, ``source`` in messages, and take its mesh out of it.

    MeshError, see `tribox.geometry.meshes.gmsh_model.named_groups`.
    """
    groups = named_groups(gmsh, source)
    numbers, x, _ = gmsh.model.mesh.getNodes()
    # gmsh gives nodes in no order; its numbers, from 1 on without gaps, are the rows from here on.
    position = np.empty((len(numbers), 3))
    position[np.asarray(numbers, dtype=np.int64) - 1] = np.reshape(x, (-1, 3))
    bodies, surfaces = (
        {name: (tag, _elements(gmsh, dim, tag)) for name, tag in named.items()}
        for dim, named in ((groups.dim, groups.bodies), (groups.dim - 1, groups.surfaces))
    )
    kinds = {kind for _, blocks in bodies.values() for kind in blocks}
    first = next(iter(kinds))
    # A mesh has cells of one kind, and facets of one kind, which those of a prism are not.
    if len(kinds) > 1 or first.shape not in FACETS:
        for name, (_, blocks) in surfaces.items():
            if any(kind.order > 1 for kind in blocks):
                raise MeshError(
                    f"{source}: the facets of surface {name!r} are of second order, its cells are "
                    "not"
                )
        return _refined(gmsh, groups, position, (bodies, surfaces), source)
    wanted = KINDS[NUMBERS[FACETS[first.shape], first.order]]
    for name, (_, blocks) in surfaces.items():
        if blocks.keys() != {wanted}:
            order = "first" if first.order == 1 else "second"
            raise MeshError(
                f"{source}: the facets of surface {name!r} are not {order}-order {wanted.shape}s, "
                f"as those of {first.shape} cells are"
            )
    parts = [
        {name: Part(tag, blocks[kind]) for name, (tag, blocks) in named.items()}
        for named, kind in ((bodies, first), (surfaces, wanted))
    ]
    whole = _groups(gmsh, groups, parts[0], source)
    return MeshArrays(first.shape, position, parts[0], parts[1], whole, order=first.order)


def _groups(
    gmsh: ModuleType, groups: NamedGroups, bodies: dict[str, Part], source: str
) -> dict[str, npt.NDArray[np.int64]]:
    """Nodes of the named points and edges, those that are of the bodies."""
    # Points that only helped to draw, such as centres of arcs, are of no cell.
    nodes = [part.nodes.reshape(-1) for part in bodies.values()]
    used = np.unique(np.concatenate(nodes))
    found = {
        name: _nodes_of(gmsh, name, dim, entities, source)
        for name, (dim, entities) in groups.groups.items()
    }
    return {name: rows for name, rows in found.items() if np.isin(rows, used).all()}


def _nodes_of(
    gmsh: ModuleType, name: str, dim: int, entities: list[int], source: str
) -> npt.NDArray[np.int64]:
    """Nodes (e, a) of the points, or ends of the edges, of a group."""
    rows = []
    for entity in entities:
        kinds, _, nodes = gmsh.model.mesh.getElements(dim, entity)
        if len(kinds) != 1 or int(kinds[0]) not in _LOWER[dim]:
            what = "points" if dim == 0 else "edges"
            raise MeshError(f"{source}: the group {name!r} is not made of {what}, or not meshed")
        width = _LOWER[dim][int(kinds[0])]
        ends = np.asarray(nodes[0], dtype=np.int64).reshape(-1, width)[:, : dim + 1]
        rows.append(ends - 1)
    return np.unique(np.concatenate(rows), axis=0)


def _refined(
    gmsh: ModuleType,
    groups: NamedGroups,
    position: npt.NDArray[np.float64],
    parts: tuple[_Named, _Named],
    source: str,
) -> MeshArrays:
    """The mesh divided into cells of one kind, with its named points; edges are divided too."""
    mesh = refined(position, _by_shape(parts[0]), _by_shape(parts[1]), source)
    edges = [name for name, (dim, _) in groups.groups.items() if dim == 1]
    if edges:
        raise MeshError(
            f"{source}: the group of edges {edges[0]!r} does not go with mixed cells, which are "
            "divided; name points instead"
        )
    return replace(mesh, groups=_groups(gmsh, groups, mesh.bodies, source))


def _elements(gmsh: ModuleType, dim: int, tag: int) -> dict[Kind, npt.NDArray[np.int64]]:
    """Elements (e, a) of a group by kind, in numbers of nodes from 0 on."""
    blocks = elements_of(gmsh, dim, tag)
    for kind in blocks.keys() - KINDS.keys():
        name = gmsh.model.mesh.getElementProperties(kind)[0]
        raise MeshError(f"elements of the kind {name} in physical group {tag} cannot be read")
    return {KINDS[kind]: rows - 1 for kind, rows in blocks.items()}


def _by_shape(parts: _Named) -> Parts:
    """The same with first-order elements by their shape."""
    return {
        name: (tag, {kind.shape: rows for kind, rows in blocks.items()})
        for name, (tag, blocks) in parts.items()
    }


# -- Meshes of several kinds of cells, divided into quadrilaterals or hexahedra alone --------------
#
# One kind of cells is what a mesh can have. Every polygon falls into as many quadrilaterals as it
# has corners, and every cell with three edges at each corner (a tetrahedron, a hexahedron, a prism)
# into as many hexahedra: each of them joins a corner, the middles of its edges and of its faces,
# and the middle of the cell. Middles are means of corners, so that neighbours of any kind fit
# together.
#
# Axis letters: c cells, f facets, a corners, n nodes, i space.

Longs = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Blocks = Mapping[str, Longs]  # elements (c, a) of each shape
Parts = Mapping[str, tuple[int, Blocks]]  # tag and elements of each body or surface

_PLURAL = {
    "triangle": "triangles",
    "quadrilateral": "quadrilaterals",
    "tetrahedron": "tetrahedra",
    "hexahedron": "hexahedra",
    "prism": "prisms",
}


def refined(position: Floats, bodies: Parts, surfaces: Parts, source: str) -> MeshArrays:
    """The mesh of nodes (n, 3) divided into cells of one kind; its names stay.

    Of first-order bodies of any shape of `SIDES`; MeshError of ``source`` if a facet is of no cell,
    or one is too distorted.
    """
    counts: dict[str, int] = {}
    for _, blocks in bodies.values():
        for shape, rows in blocks.items():
            counts[shape] = counts.get(shape, 0) + len(rows)
    cell = QUADRILATERAL if DIMENSION[next(iter(counts))] == 2 else HEXAHEDRON
    middles = _Middles(position, [b for _, b in bodies.values()])
    made = {name: Part(tag, middles.divided(blocks)) for name, (tag, blocks) in bodies.items()}
    try:
        sides = {n: Part(tag, middles.divided(blocks)) for n, (tag, blocks) in surfaces.items()}
    except KeyError:
        raise MeshError(
            f"{source}: facets of a surface are not on the boundary of any cell"
        ) from None
    before = ", ".join(f"{count} {_PLURAL[shape]}" for shape, count in counts.items())
    total = sum(len(part.nodes) for part in made.values())
    kinds = "mixed cells" if len(counts) > 1 else "cells"
    note = f"{kinds} ({before}): refined to {total} {_PLURAL[cell]}"
    mesh = MeshArrays(cell, middles.positions(), made, sides, notes=(note,))
    _check_shape(mesh, source)
    return mesh


class _Middles:
    """Numbers and positions of the middles of edges, faces and cells."""

    def __init__(self, position: Floats, bodies: list[Blocks]) -> None:
        self._position = [position]
        self._count = len(position)
        self._known: dict[int, tuple[Longs, int]] = {}
        for corners in (2, 3, 4):
            found = [
                np.sort(rows[:, list(side)], axis=1)
                for blocks in bodies
                for shape, rows in blocks.items()
                for side in _parts_with(shape, corners)
            ]
            if found:
                # Sorted corners are the same from either cell: neighbours share one middle.
                unique = np.unique(np.concatenate(found), axis=0)
                self._known[corners] = (unique, self._count)
                self._append(position[unique].mean(axis=1))

    def _append(self, places: Floats) -> None:
        self._position.append(places)
        self._count += len(places)

    def positions(self) -> Floats:
        """All nodes (n, 3), those of the mesh first."""
        return np.concatenate(self._position)

    def of(self, rows: Longs) -> Longs:
        """Numbers of the middles of edges or faces (f, a)."""
        known, first = self._known.get(rows.shape[1], (np.empty((0, rows.shape[1])), 0))
        # Of known rows and wanted ones together np.unique says where each first stands: that is its
        # place among the known, or beyond them if it is none.
        both = np.concatenate([known, np.sort(rows, axis=1)]).astype(np.int64)
        _, at, back = np.unique(both, axis=0, return_index=True, return_inverse=True)
        found = at[back.reshape(-1)[len(known) :]]
        if np.any(found >= len(known)):
            raise KeyError
        return np.asarray(first + found, dtype=np.int64)

    def divided(self, blocks: Blocks) -> Longs:
        """The quadrilaterals, hexahedra or intervals that elements fall into."""
        return np.concatenate([self._of_shape(shape, rows) for shape, rows in blocks.items()])

    def _of_shape(self, shape: str, rows: Longs) -> Longs:
        if shape == INTERVAL:
            middle = self.of(rows)
            return np.concatenate(
                [np.stack([rows[:, 0], middle], axis=1), np.stack([middle, rows[:, 1]], axis=1)]
            )
        if DIMENSION[shape] == 2:
            return self._of_polygons(rows)
        return self._of_solids(shape, rows)

    def _of_polygons(self, rows: Longs) -> Longs:
        """Four corners: one of the polygon, the middle of an edge, that of the polygon, another."""
        count = rows.shape[1]
        edges = [self.of(rows[:, [a, (a + 1) % count]]) for a in range(count)]
        inside = self.of(rows)
        return np.concatenate(
            [np.stack([rows[:, a], edges[a], inside, edges[a - 1]], axis=1) for a in range(count)]
        )

    def _of_solids(self, shape: str, rows: Longs) -> Longs:
        first = self._count
        self._append(self._position[0][rows].mean(axis=1))
        inside = first + np.arange(len(rows))
        cells = []
        for corner, (a, b, c) in enumerate(_around(shape)):
            edge = {k: self.of(rows[:, [corner, k]]) for k in (a, b, c)}
            face = {
                pair: self.of(rows[:, side])
                for pair in ((a, b), (b, c), (c, a))
                for side in map(list, SIDES[shape])
                if {corner, *pair} <= set(side)
            }
            lower = (rows[:, corner], edge[a], face[a, b], edge[b])
            upper = (edge[c], face[c, a], inside, face[b, c])
            cells.append(np.stack([*lower, *upper], axis=1))
        return np.concatenate(cells)


def _parts_with(shape: str, corners: int) -> list[tuple[int, ...]]:
    """Edges (two corners) or faces of a cell; in the plane it is a face itself."""
    if corners == 2:
        return sorted(_edges(shape))
    if DIMENSION[shape] == 2:
        return [tuple(range(CORNERS[shape]))] if CORNERS[shape] == corners else []
    return [side for side in SIDES[shape] if len(side) == corners]


def _edges(shape: str) -> set[tuple[int, int]]:
    """Pairs of corners that an edge joins."""
    return {
        (min(a, b), max(a, b))
        for side in SIDES[shape]
        for a, b in zip(side, (*side[1:], side[0]), strict=True)
    }


@lru_cache
def _around(shape: str) -> tuple[tuple[int, int, int], ...]:
    """The three corners joined to each corner of a solid, right-handed about it."""
    place, found = np.array(PLACES[shape]), []
    for corner in range(CORNERS[shape]):
        # Of a pair that holds the corner, the sum less the corner is the other end.
        a, b, c = sorted(sum(pair) - corner for pair in _edges(shape) if corner in pair)
        edges = place[[a, b, c]] - place[corner]
        found.append((a, b, c) if np.linalg.det(edges) > 0.0 else (a, c, b))
    return tuple(found)


def _check_shape(mesh: MeshArrays, source: str) -> None:
    """See that no cell is folded or inverted: at its corners and its middle."""
    cells = mesh.cells
    x = mesh.position[cells][:, :, : mesh.dim]
    place = np.array(PLACES[mesh.cell])[:, : mesh.dim]
    determinants = []
    for at in (*place, np.zeros(mesh.dim)):
        # Derivatives of the products of (1/2 ± ξ) along each direction.
        factors = 0.5 + 2.0 * at * place
        slopes = np.stack(
            [
                2.0 * place[:, j] * np.prod(np.delete(factors, j, axis=1), axis=1)
                for j in range(mesh.dim)
            ]
        )
        determinants.append(np.linalg.det(np.einsum("ja,cai->cij", slopes, x)))
    det = np.array(determinants)  # (corner or middle, c); of one sign in a cell that is not folded
    wrong = np.flatnonzero(~((np.sign(det) == np.sign(det[-1])) & (det != 0.0)).all(axis=0))
    if len(wrong):
        where = ", ".join(f"{value:.4g}" for value in x[wrong[0]].mean(axis=0))
        raise MeshError(
            f"{source}: {len(wrong)} of the {len(cells)} {_PLURAL[mesh.cell]} that mixed cells are "
            f"divided into are folded, the first at ({where}); a cell there is too distorted"
        )
