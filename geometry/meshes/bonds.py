"""Nodes that bodies or surfaces of a mesh share: there bodies are bonded."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import dolfinx
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from tribox.geometry.compat import cell_nodes, entity_nodes
from tribox.geometry.meshes.mesh import NamedMesh


def bodies_sharing_nodes(named: NamedMesh) -> dict[tuple[str, str], int]:
    """Number of the common nodes of bodies that have any; collective.

    Such bodies are bonded: there they can neither slide nor separate.

    Returns:
        By the names of each such pair, in the order of ``named.bodies``; the same on all processes.
    """
    nodes = {name: cell_nodes(named.mesh)[named.cells(name)] for name in named.bodies}
    return _sharing(named, nodes)


def bonded_groups(named: NamedMesh) -> list[list[str]]:
    """Names of all bodies, those together that shared nodes connect; collective."""
    group = {name: name for name in named.bodies}
    for first, second in bodies_sharing_nodes(named):
        old, new = group[second], group[first]
        group = {name: new if of == old else of for name, of in group.items()}
    return [
        [name for name, of in group.items() if of == first]
        for first in dict.fromkeys(group.values())
    ]


def surfaces_sharing_nodes(named: NamedMesh, surfaces: tuple[str, str]) -> int:
    """Number of the common nodes of two surfaces; collective."""
    mesh = named.mesh
    nodes = {
        name: entity_nodes(mesh, mesh.topology.dim - 1, named.facets(name)) for name in surfaces
    }
    return sum(_sharing(named, nodes).values())


def _sharing(
    named: NamedMesh, nodes: Mapping[str, npt.NDArray[np.int32]]
) -> dict[tuple[str, str], int]:
    """How many of the mesh's nodes two of several sets, by local numbers, share; collective."""
    index, comm = named.mesh.geometry.index_map(), named.mesh.comm
    used = {}
    for name, rows in nodes.items():
        marks = dolfinx.la.vector(index, 1, dtype=np.float64)
        marks.array[np.unique(rows)] = 1.0
        # A node may be used only on a process that does not own it.
        marks.scatter_reverse(dolfinx.la.InsertMode.add)
        used[name] = marks.array[: index.size_local] > 0.0
    counts = {
        (a, b): comm.allreduce(int(np.count_nonzero(used[a] & used[b])), op=MPI.SUM)
        for a, b in combinations(nodes, 2)
    }
    return {pair: count for pair, count in counts.items() if count}
