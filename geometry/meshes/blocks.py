"""Unknowns beside the displacements of the mesh's nodes: blocks of numbers, and fields on surfaces.

A block's entries lie in nodes of their own that no cell has, behind those of the rank that owns
them: entry k in component k mod i of the block's node k div i. One vector and one matrix hold all
blocks, and what goes by the number of a node, as contacts do, reaches every one of them. What is
left of a block's last node is held at zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.geometry.compat import with_more_nodes
from tribox.geometry.surfaces.facets import Floats, Ints, Longs, order_by_place


@dataclass(slots=True, eq=False)
class Block:
    """Unknowns beside the displacement.

    A vector of unknowns holds u/``scale`` in m, one of residuals ``weight`` r in N. Both make the
    rows of all blocks of one size: line searches and starts are compared by the norm of all.

    Attributes:
        name: of the block.
        count: its entries on this rank.
        place: (count, i), m, by which its entries are ordered, on whichever ranks they are; None:
            as they come, all on one rank.
        scale: unit of the unknown per m; weight: N per unit of the residual.
        reference: N, what its residual is compared with, which who evaluates it sets; None: its
            residual is judged together with the forces on the bodies.
        dofs: (count,) local unknowns, of this rank; padding: those that are left over.
        nodes: (m,) global node of each entry of all ranks, ordered; components: (m,) there.
        order: (m,) place of each ordered entry among those of all ranks, one rank after the other.
    """

    name: str
    count: int
    place: Floats | None = None
    scale: float = 1.0
    weight: float = 1.0
    reference: float | None = None
    dofs: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int32))
    padding: Ints = field(default_factory=lambda: np.empty(0, dtype=np.int32))
    nodes: Longs = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    components: Longs = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    order: Longs = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    @classmethod
    def of_numbers(cls, name: str, count: int, comm: MPI.Comm) -> Block:
        """Numbers that the last rank owns."""
        return cls(name, count if comm.rank == comm.size - 1 else 0)

    def on_all_ranks(self, values: Floats, comm: MPI.Comm) -> Floats:
        """Its ordered entries (m,) of values (n,) of the owned unknowns; collective."""
        return np.concatenate(comm.allgather(values[self.dofs]))[self.order]

    def _put(self, space: dolfinx.fem.FunctionSpace, first: int) -> None:
        """Put it into the nodes from the local one ``first`` on; collective."""
        dim, comm = space.dofmap.index_map_bs, space.mesh.comm
        unknowns = first * dim + np.arange(dim * _nodes(self.count, dim), dtype=np.int32)
        self.dofs, self.padding = unknowns[: self.count], unknowns[self.count :]
        mine = space.dofmap.index_map.local_range[0] * dim + self.dofs.astype(np.int64)
        place = np.empty((self.count, 0)) if self.place is None else self.place
        gathered = comm.allgather((mine, place))
        numbers = np.concatenate([some for some, _ in gathered])
        self.order = np.arange(len(numbers))
        if self.place is not None:
            self.order = order_by_place(np.concatenate([where for _, where in gathered]))
        self.nodes, self.components = np.divmod(numbers[self.order], dim)


def with_blocks(
    space: dolfinx.fem.FunctionSpace, blocks: Sequence[Block]
) -> dolfinx.fem.FunctionSpace:
    """A displacement's space with room for blocks, which then know their places; collective."""
    dim, first = space.dofmap.index_map_bs, space.dofmap.index_map.size_local
    counts = [_nodes(block.count, dim) for block in blocks]
    wider = with_more_nodes(space, sum(counts))
    for block, count in zip(blocks, counts, strict=True):
        block._put(wider, first)
        first += count
    return wider


def _nodes(count: int, dim: int) -> int:
    """Whole nodes of ``dim`` unknowns for ``count`` entries."""
    return -(-count // dim)
