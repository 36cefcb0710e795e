"""Meshes of equal rectangles as arrays, numbered as gmsh numbers them, but made without it.

Loading gmsh takes longer than a small mesh does. Nodes: first the corners of all blocks, then the
nodes along their sides, side by side, then those inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

SIDES = ("contact", "far", "left", "right")
"""Sides of a rectangle in the order of their numbers; contact: row 0, left: column 0."""


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A block of equal rectangular cells.

    Attributes:
        name: of the body; sides: names of the surfaces on :data:`SIDES`.
        x: (i,), m, of its columns of nodes, rising; y: (j,), m, of its rows, away from the contact.
    """

    name: str
    sides: Sequence[str]
    x: Floats
    y: Floats

    @property
    def rises(self) -> bool:
        """Whether it lies above the contact; its cells then go up column by column, else by row."""
        return bool(self.y[-1] > self.y[0])


@dataclass(frozen=True, slots=True)
class RegularMesh:
    """A mesh of quadrilaterals in the plane.

    Attributes:
        position: (n, 3), m; bodies: tag and nodes (c, 4) of the cells of each.
        surfaces: tag and nodes (f, 2) of the facets of each.
    """

    position: Floats
    bodies: Mapping[str, tuple[int, Ints]]
    surfaces: Mapping[str, tuple[int, Ints]]


def regular_mesh(blocks: Sequence[Rectangle]) -> RegularMesh:
    """The mesh of blocks that share no nodes."""
    tables = _numbered(blocks)
    position = np.zeros((sum(table.size for table in tables), 3))
    for block, table in zip(blocks, tables, strict=True):
        position[table, 0], position[table, 1] = block.x[:, None], block.y[None, :]
    named = list(zip(blocks, tables, strict=True))
    bodies = {b.name: (tag, _cells(b, t)) for tag, (b, t) in enumerate(named, start=1)}
    facets = [(name, side) for b, t in named for name, side in zip(b.sides, _along(t), strict=True)]
    # Tags of surfaces go on from those of the bodies: no number means two things.
    surfaces = {
        name: (tag, np.stack([side[:-1], side[1:]], axis=1))
        for tag, (name, side) in enumerate(facets, start=len(blocks) + 1)
    }
    return RegularMesh(position, bodies, surfaces)


def _along(table: Ints) -> Iterator[Ints]:
    """The nodes of each side, from column or row 0 on."""
    yield from (table[:, 0], table[:, -1], table[0], table[-1])


def _numbered(blocks: Sequence[Rectangle]) -> list[Ints]:
    """The number of the node in each column and row (i, j) of each block."""
    tables: list[Ints] = [
        np.empty((len(block.x), len(block.y)), dtype=np.int64) for block in blocks
    ]
    count = 0
    for table in tables:
        table[[0, -1, -1, 0], [0, 0, -1, -1]] = count + np.arange(4)
        count += 4
    for table in tables:
        for side in _along(table):  # views of the table
            inner = side[1:-1]
            inner[:] = count + np.arange(len(inner))
            count += len(inner)
    for block, table in zip(blocks, tables, strict=True):
        inside = table[1:-1, 1:-1] if block.rises else table[1:-1, 1:-1].T
        inside[...] = count + np.arange(inside.size).reshape(inside.shape)
        count += inside.size
    return tables


def _cells(block: Rectangle, table: Ints) -> Ints:
    """Corners (c, 4) of the cells, counter-clockwise from the node nearest to row and column 0."""
    low, right = table[:-1, :-1], table[1:, :-1]
    opposite, left = table[1:, 1:], table[:-1, 1:]
    if block.rises:
        return np.stack([low, right, opposite, left], axis=-1).reshape(-1, 4)
    return np.stack([low.T, left.T, opposite.T, right.T], axis=-1).reshape(-1, 4)
