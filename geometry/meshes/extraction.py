"""From a gmsh model to the arrays of a mesh; on one process."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import numpy.typing as npt

from geometry.meshes.array_model import GMSH_TYPES
from geometry.meshes.gmsh_model import MeshError, elements_of, named_groups
from geometry.meshes.mesh_arrays import FACETS, MeshArrays, Part

_LOWER = {0: 15, 1: 1}  # gmsh's kinds of elements of points and of edges


def arrays_of(gmsh: ModuleType, source: str) -> MeshArrays:
    """Check the current model and take its mesh out of it.

    Args:
        gmsh: The module, from ``gmsh_session``.
        source: Name of the model in messages, for instance its file.

    Raises:
        MeshError: The mesh cannot be used, see `geometry.meshes.gmsh_model.named_groups`.
    """
    groups = named_groups(gmsh, source)
    kind = gmsh.model.mesh.getElementTypes(groups.dim)[0]
    cell = next(name for name, number in GMSH_TYPES.items() if number == kind)
    numbers, x, _ = gmsh.model.mesh.getNodes()
    position = np.empty((len(numbers), 3))
    position[np.asarray(numbers, dtype=np.int64) - 1] = np.reshape(x, (-1, 3))
    bodies, surfaces = (
        {
            name: Part(tag, np.concatenate(elements_of(gmsh, dim, tag)) - 1)
            for name, tag in named.items()
        }
        for dim, named in ((groups.dim, groups.bodies), (groups.dim - 1, groups.surfaces))
    )
    for name, part in surfaces.items():
        kinds = {
            int(found)
            for entity in gmsh.model.getEntitiesForPhysicalGroup(groups.dim - 1, part.tag)
            for found in gmsh.model.mesh.getElementTypes(groups.dim - 1, entity)
        }
        if kinds != {GMSH_TYPES[FACETS[cell]]}:
            raise MeshError(
                f"{source}: the facets of surface {name!r} are not first-order {FACETS[cell]}s, "
                f"as those of {cell} cells are"
            )
    corners = np.unique(np.concatenate([part.corners.reshape(-1) for part in bodies.values()]))
    others = {
        name: _nodes_of(gmsh, name, dim, entities, source)
        for name, (dim, entities) in groups.groups.items()
    }
    whole = {name: rows for name, rows in others.items() if np.isin(rows, corners).all()}
    return MeshArrays(cell, position, bodies, surfaces, whole)


def _nodes_of(
    gmsh: ModuleType, name: str, dim: int, entities: list[int], source: str
) -> npt.NDArray[np.int64]:
    """Nodes (e, a) of the points or first-order edges of a group."""
    rows = []
    for entity in entities:
        kinds, _, nodes = gmsh.model.mesh.getElements(dim, entity)
        if list(kinds) != [_LOWER[dim]]:
            what = "points" if dim == 0 else "edges of first order"
            raise MeshError(f"{source}: the group {name!r} is not made of {what}, or not meshed")
        rows.append(np.asarray(nodes[0], dtype=np.int64).reshape(-1, dim + 1) - 1)
    return np.unique(np.concatenate(rows), axis=0)
