"""What differs between DOLFINx versions in reading gmsh models (0.9: gmshio, 0.10 on: gmsh)."""

from __future__ import annotations

from typing import Any

import dolfinx
import numpy as np
from mpi4py import MPI


def model_to_mesh(
    model: Any, comm: MPI.Comm, rank: int, gdim: int
) -> tuple[dolfinx.mesh.Mesh, dolfinx.mesh.MeshTags, dolfinx.mesh.MeshTags]:
    """Distribute the gmsh model of one process; collective.

    Args:
        model: ``gmsh.model`` on ``rank``; not used elsewhere.
        comm: Communicator of the mesh.
        rank: The process that holds the model.
        gdim: Number of coordinates of a point.

    Returns:
        The mesh, and the physical tags of its cells and of its facets (possibly none).
    """
    try:
        from dolfinx.io import gmsh as reader
    except ImportError:
        from dolfinx.io import gmshio as reader
    mesh, cell_tags, facet_tags = reader.model_to_mesh(model, comm, rank, gdim=gdim)[:3]
    if facet_tags is None:
        none = np.empty(0, dtype=np.int32)
        facet_tags = dolfinx.mesh.meshtags(mesh, mesh.topology.dim - 1, none, none)
    return mesh, cell_tags, facet_tags
