"""Rows of a sparse matrix, one for each slave vertex, summed over the points around it.

Axis letters: p points, g groups of points with the same vertices and nodes, k vertices of a slave
facet, m nodes of the pair that move a point, i space, v vertices. Where the entries go changes only
when points change their master facets, or vertices open and close: it is worth keeping.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from mpi4py import MPI

from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
from tribox.geometry.surfaces.slave_points import SlaveVertices


@dataclass(frozen=True, slots=True)
class Coupling:
    """A sparse part of the tangent between nodes of the pair."""

    rows: Longs  # global nodes
    columns: Longs  # likewise
    matrix: scipy.sparse.csr_matrix  # their unknowns, (rows · i, columns · i)


@dataclass(frozen=True, slots=True)
class NodeRows:
    """Rows of vertices against nodes: entries (e, i) of row v from ``indptr[v]`` on."""

    indptr: Longs
    node: Longs
    data: Floats

    def matrix(self, columns: int) -> scipy.sparse.csr_matrix:
        """The same with a column for each unknown of so many nodes."""
        data = self.data[:, None, :]
        shape = (len(self.indptr) - 1, data.shape[2] * columns)
        return scipy.sparse.bsr_matrix((data, self.node, self.indptr), shape=shape).tocsr()


def outside_parts(
    whole: tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix],
    nodes: tuple[Longs, Longs],
    outside: tuple[Bools, Bools],
) -> list[Coupling]:
    """The parts of LᵀR in rows, or else in columns, of nodes outside."""
    (left, right), (rows, columns), (row_out, column_out) = whole, nodes, outside
    by_row, by_column = np.repeat(row_out, 3), np.repeat(column_out, 3)
    left, right = left.tocsc(), right.tocsc()
    return [
        Coupling(rows[row_out], columns, (left[:, by_row].T @ right).tocsr()),
        Coupling(
            rows[~row_out], columns[column_out], (left[:, ~by_row].T @ right[:, by_column]).tocsr()
        ),
    ]


def adding_up(key: Longs) -> tuple[Longs, scipy.sparse.csr_matrix]:
    """One row (g,) of each ``key`` (q,), and the matrix (g, q) that adds up rows of equal keys."""
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    place = group.reshape(-1), np.arange(len(key))
    shape = (len(first), len(key))
    return first, scipy.sparse.csr_matrix((np.ones(len(key)), place), shape=shape)


def completed(
    rows: scipy.sparse.csr_matrix, vertices: SlaveVertices, of_point: Longs, nodes: Longs, dim: int
) -> tuple[scipy.sparse.csr_matrix, Longs]:
    """Rows of vertices with the other ranks' parts of those that several ranks have; collective.

    Args:
        rows: (v, nodes · i) or, one for each component, (v · i, nodes · i), of this rank.
        vertices: of the slave.
        of_point: (q, k) those that this rank asks for.
        nodes: (n,) global nodes of the columns.
        dim: components i of a node.

    Returns:
        The matrix (…, columns · i), and the global nodes of its columns.
    """
    if vertices.comm.size == 1:
        return rows, nodes
    asked = np.zeros(vertices.count, dtype=bool)
    asked[of_point] = True
    each = rows.shape[0] // vertices.count
    shared, here = np.repeat(vertices.shared, each), np.repeat(asked, each)
    return with_others(rows, (shared, here), nodes, dim, vertices.comm)


def with_others(
    rows: scipy.sparse.csr_matrix,
    exchanged: tuple[Bools, Bools],
    nodes: Longs,
    dim: int,
    comm: MPI.Comm,
) -> tuple[scipy.sparse.csr_matrix, Longs]:
    """The same of any rows (r,): those that others may have, and those that this rank asks for."""
    if comm.size == 1:
        return rows, nodes
    shared, here = exchanged
    part = rows[shared].tocoo()
    at = np.nonzero(shared)[0][part.row], nodes[part.col // dim]
    gathered = comm.allgather((*at, part.col % dim, part.data))
    others = [g for rank, g in enumerate(gathered) if rank != comm.rank]
    row, node, axis, value = (np.concatenate(p) for p in zip(*others, strict=True))
    # Nodes of other ranks get columns of their own, also where this rank has the node: assembly
    # adds up columns of one node.
    new = np.unique(node)
    columns = np.concatenate([nodes, new])
    column = dim * len(nodes) + dim * np.searchsorted(new, node) + axis
    mine, wanted = rows.tocoo(), here[row]
    place = (np.concatenate([mine.row, row[wanted]]), np.concatenate([mine.col, column[wanted]]))
    data = np.concatenate([mine.data, value[wanted]])
    size = (rows.shape[0], dim * len(columns))
    return scipy.sparse.csr_matrix((data, place), shape=size), columns


class VertexRows:
    """Where the entries (p, k, m, i) of points go in a matrix (v, nodes · i).

    Attributes:
        points: (p,); facet: (p,) their master facets; needs: (v,) vertices that have rows.
    """

    def __init__(
        self,
        points: Longs,
        facet: Ints,
        needs: Bools,
        numbers: tuple[Longs, Longs, Longs],
        size: tuple[int, int],
    ) -> None:
        """Find the places.

        Args:
            points: (p,).
            facet: (p,) master facets of the points.
            needs: (v,) vertices that have rows; others would fill products with zeros.
            numbers: (p,) the same for points with the same vertices and nodes, and these: vertices
                (p, k) and nodes (p, m).
            size: number of nodes, and of components i.
        """
        self.points, self.facet, self.needs = points, facet, needs
        key, vertex, nodes = numbers
        count, dim = size
        self._shape = (len(needs), dim * count)
        first, self._adding = adding_up(key)
        row, column = np.broadcast_arrays(
            vertex[first][:, :, None, None], dim * nodes[first][:, None, :, None] + np.arange(dim)
        )
        keep = np.nonzero(needs[row.reshape(-1)])[0]
        # One number per entry of the matrix: sorted by it, entries of one place stand side by side,
        # so that `matrix` adds them up by reduceat without a search of its own.
        place = row.reshape(-1)[keep] * self._shape[1] + column.reshape(-1)[keep]
        order = np.argsort(place, kind="stable")
        self._order = keep[order]
        distinct, self._starts = np.unique(place[order], return_index=True)
        rows, self._indices = np.divmod(distinct, self._shape[1])
        self._indptr = np.searchsorted(rows, np.arange(len(needs) + 1))

    def fits(self, points: Longs, facet: Ints, needs: Bools) -> bool:
        """Whether the entries of these points go to the same places."""
        return (
            np.array_equal(self.points, points)
            and np.array_equal(self.facet, facet)
            and np.array_equal(self.needs, needs)
        )

    def matrix(self, values: Floats) -> scipy.sparse.csr_matrix:
        """The matrix (v, nodes · i) of entries ``values`` (p, k, m, i)."""
        size = int(np.prod(values.shape[1:]))
        summed = (self._adding @ values.reshape(len(values), size)).reshape(-1)[self._order]
        data = np.add.reduceat(summed, self._starts) if len(self._starts) else summed
        return scipy.sparse.csr_matrix((data, self._indices, self._indptr), shape=self._shape)
