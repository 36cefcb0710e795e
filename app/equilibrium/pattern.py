"""The pattern of matrices of the unknowns: which have room for entries.

Bodies and contacts couple nodes with all of their unknowns, so that it is kept by nodes, with the
few entries that platens need beside. A matrix is laid out by it as a whole, in its place.

Axis letters: c cells, a nodes of a cell, p pairs.
"""

from __future__ import annotations

import dolfinx
import numpy as np
import scipy.sparse
from petsc4py import PETSc

from tribox.geometry.surfaces.facets import Ints, Longs

PIECE = 4096  # nodes whose rows are written at a time


class Pattern:
    """Entries in this rank's own rows.

    Attributes:
        dim: unknowns of a node; first: number of this rank's first node.
        blocks: (own nodes, all nodes), where nodes are coupled with all of their unknowns.
        entries: (own unknowns, all unknowns), what there is beside.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace) -> None:
        """Couple nothing yet."""
        self._space, imap = space, space.dofmap.index_map
        self.dim, self._comm = space.dofmap.index_map_bs, space.mesh.comm
        self.first, owned, size = imap.local_range[0], imap.size_local, imap.size_global
        none = np.empty(0, dtype=np.int64)
        self.blocks = _table(none, none, (owned, size))
        self.entries = _table(none, none, (owned * self.dim, size * self.dim))

    def add_cells(self, cells: Ints | None = None) -> None:
        """Couple the nodes of local cells (c,), all owned ones by default; collective."""
        imap, mesh = self._space.dofmap.index_map, self._space.mesh
        if cells is None:
            cells = np.arange(mesh.topology.index_map(mesh.topology.dim).size_local, dtype=np.int32)
        local = imap.size_local + imap.num_ghosts
        nodes = np.asarray(self._space.dofmap.list)[cells]
        row = np.repeat(np.arange(len(nodes)), nodes.shape[1])
        table = _table(row, nodes.reshape(-1), (len(nodes), local))
        both = (table.T @ table).tocoo()
        number = imap.local_to_global(np.arange(local, dtype=np.int32)).astype(np.int64)
        self.blocks = self.blocks + self._mine(number[both.row], number[both.col], 1)

    def add_nodes(self, pairs: Longs) -> None:
        """Couple pairs (p, 2) of global nodes, both ways; collective."""
        both = np.concatenate([pairs, pairs[:, ::-1]])
        self.blocks = self.blocks + self._mine(both[:, 0], both[:, 1], 1)

    def add_entries(self, pairs: Longs) -> None:
        """Make room for rows and columns (p, 2) of global unknowns; collective."""
        self.entries = self.entries + self._mine(pairs[:, 0], pairs[:, 1], self.dim)

    def _mine(self, rows: Longs, columns: Longs, width: int) -> scipy.sparse.csr_matrix:
        """Entries in own rows, of all that any rank has; ``width`` rows to a node; collective."""
        owned, size = self.blocks.shape
        first = self.first * width
        if self._comm.size > 1:
            ends = np.array(self._comm.allgather(first + owned * width))
            owner = np.searchsorted(ends, rows, side="right")
            both, mine = np.stack([rows, columns]), owner == self._comm.rank
            offers = [both[:, (owner == one) & ~mine] for one in range(len(ends))]
            got = self._comm.alltoall(offers)
            rows, columns = np.concatenate([both[:, mine], *got], axis=1)
        return _table(rows - first, columns, (owned * width, size * width))

    def matrix(self) -> PETSc.Mat:
        """A matrix of zeros; collective."""
        A = PETSc.Mat().create(comm=self._comm)
        sizes = tuple(one * self.dim for one in self.blocks.shape)
        A.setSizes((sizes, sizes), bsize=self.dim)
        A.setType(PETSc.Mat.Type.AIJ)
        imap = self._space.dofmap.index_map
        local = np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32)
        numbers = imap.local_to_global(local).astype(PETSc.IntType)
        A.setLGMap(PETSc.LGMap().create(numbers, bsize=self.dim, comm=self._comm))
        self._write(A)
        return A

    def lay_out(self, A: PETSc.Mat) -> None:
        """Lay ``A`` out anew, of zeros, without a second matrix beside it; collective."""
        # What PETSc knew of the places of entries goes with the type, and with it the numbering.
        kind, numbers = A.getType(), A.getLGMap()
        A.setType(PETSc.Mat.Type.DENSE)
        A.setType(kind)
        A.setLGMap(*numbers)
        self._write(A)

    def _write(self, A: PETSc.Mat) -> None:
        """Put zeros into a matrix that has no entries; collective."""
        dim, (owned, size), ends = self.dim, self.blocks.shape, self.blocks.indptr
        own = (self.blocks.indices >= self.first) & (self.blocks.indices < self.first + owned)
        inner = np.diff(np.append(0, np.cumsum(own))[ends])
        more = np.diff(self.entries.indptr)
        counts = (np.repeat(dim * one, dim) + more for one in (inner, np.diff(ends) - inner))
        most = owned * dim, (size - owned) * dim
        room = tuple(
            np.minimum(count, limit).astype(PETSc.IntType)
            for count, limit in zip(counts, most, strict=True)
        )
        # An empty array counts as none at all, and ranks that give none wait for the others.
        A.setPreallocationNNZ(room if owned else (0, 0))
        each = np.ones((dim, dim), dtype=bool)
        for start in range(0, owned, PIECE):
            part = scipy.sparse.kron(self.blocks[start : start + PIECE], each, "bsr").tocsr()
            rows = np.arange(part.shape[0]) + (self.first + start) * dim
            _put_zeros(A, rows, part)
        rows = np.nonzero(more)[0]
        _put_zeros(A, rows + self.first * dim, self.entries[rows])
        A.assemble()


def cell_matrix(space: dolfinx.fem.FunctionSpace, cells: Ints | None = None) -> PETSc.Mat:
    """Zeros wherever local cells (c,), all owned ones by default, have entries; collective."""
    pattern = Pattern(space)
    pattern.add_cells(cells)
    return pattern.matrix()


def _put_zeros(A: PETSc.Mat, rows: Longs, entries: scipy.sparse.csr_matrix) -> None:
    """Put zeros into global ``rows`` (r,) of a matrix, wherever there are entries (r, n)."""
    A.setValuesIJV(
        entries.indptr.astype(PETSc.IntType),
        entries.indices.astype(PETSc.IntType),
        np.zeros(len(entries.indices)),
        rowmap=rows.astype(PETSc.IntType),
    )


def _table(row: Longs, column: Longs, shape: tuple[int, int]) -> scipy.sparse.csr_matrix:
    """Entries of a sparse matrix, each once, in ascending order."""
    ones = np.ones(len(row), dtype=bool)
    return scipy.sparse.csr_matrix((ones, (row, column)), shape=shape)
