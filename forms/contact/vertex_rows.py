"""Rows of a sparse matrix, one for each slave vertex, summed over the points around it.

Axis letters: q points, k vertices of a slave facet, i space, v vertices, n nodes of the pair, e
entries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
from mpi4py import MPI

from tribox.geometry.surfaces.facets import Bools, Floats, Longs
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

    @classmethod
    def of(cls, rows: scipy.sparse.csr_matrix, dim: int) -> NodeRows:
        """From rows with a column for each unknown i of nodes."""
        blocks = rows.tobsr(blocksize=(1, dim))
        indptr, node = (np.asarray(a, dtype=np.int64) for a in (blocks.indptr, blocks.indices))
        return cls(indptr, node, np.ascontiguousarray(blocks.data.reshape(-1, dim)))

    def matrix(self, columns: int) -> scipy.sparse.csr_matrix:
        """The same with a column for each unknown of so many nodes."""
        data = self.data[:, None, :]
        shape = (len(self.indptr) - 1, data.shape[2] * columns)
        return scipy.sparse.bsr_matrix((data, self.node, self.indptr), shape=shape).tocsr()


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
