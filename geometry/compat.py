"""What differs between DOLFINx versions in reading gmsh models (0.9: gmshio, 0.10 on: gmsh)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import dolfinx
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

# DOLFINx calls it on every process with the communicator, the number of parts, the kinds of cells
# and, for each kind, the vertices of the cells in a row; it returns the parts of these cells.
CellPartitioner = Callable[..., Any]


def cell_partitioner(
    share_out: Callable[[npt.NDArray[np.int64], int], npt.NDArray[np.int32]],
) -> CellPartitioner:
    """A partitioner for a mesh of one kind of cells that one process holds.

    Args:
        share_out: gives the part (c,) of each cell, from the cells' vertices in one row and the
            number of parts; called on the process that has cells.
    """

    def partition(comm: Any, parts: int, kinds: Any, cells: Any) -> Any:
        vertices = np.asarray(cells[0], dtype=np.int64)
        found = share_out(vertices, parts) if len(vertices) else np.empty(0, dtype=np.int32)
        return dolfinx.cpp.graph.AdjacencyList_int32(found.reshape(-1, 1))

    return partition


def model_to_mesh(
    model: Any,
    comm: MPI.Comm,
    rank: int,
    gdim: int,
    partitioner: CellPartitioner | None = None,
) -> tuple[dolfinx.mesh.Mesh, dolfinx.mesh.MeshTags, dolfinx.mesh.MeshTags]:
    """Distribute the gmsh model of one process; collective.

    Args:
        model: ``gmsh.model`` on ``rank``; not used elsewhere.
        comm: Communicator of the mesh.
        rank: The process that holds the model.
        gdim: Number of coordinates of a point.
        partitioner: Shares out the cells; None: by DOLFINx's own, which balances cells.

    Returns:
        The mesh, and the physical tags of its cells and of its facets (possibly none).
    """
    try:
        from dolfinx.io import gmsh as reader
    except ImportError:
        from dolfinx.io import gmshio as reader
    mesh, cell_tags, facet_tags = reader.model_to_mesh(
        model, comm, rank, gdim=gdim, partitioner=partitioner
    )[:3]
    if facet_tags is None:
        none = np.empty(0, dtype=np.int32)
        facet_tags = dolfinx.mesh.meshtags(mesh, mesh.topology.dim - 1, none, none)
    return mesh, cell_tags, facet_tags
