"""From a gmsh model to the arrays of a mesh; on one process."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import numpy as np
import numpy.typing as npt

from tribox.geometry.meshes.elements import FACETS, KINDS, NUMBERS, Kind
from tribox.geometry.meshes.gmsh_model import MeshError, NamedGroups, elements_of, named_groups
from tribox.geometry.meshes.mesh_arrays import MeshArrays, Part
from tribox.geometry.meshes.refinement import Parts, refined

_LOWER = {0: {15: 1}, 1: {1: 2, 8: 3}}
"""Of points and of edges, gmsh's kinds of elements and their numbers of nodes."""


_Named = dict[str, tuple[int, dict[Kind, npt.NDArray[np.int64]]]]


def arrays_of(gmsh: ModuleType, source: str) -> MeshArrays:
    """Check the current model and take its mesh out of it.

    Args:
        gmsh: The module, from ``gmsh_session``.
        source: Name of the model in messages, for instance its file.

    Raises:
        MeshError: The mesh cannot be used, see `tribox.geometry.meshes.gmsh_model.named_groups`.
    """
    groups = named_groups(gmsh, source)
    numbers, x, _ = gmsh.model.mesh.getNodes()
    position = np.empty((len(numbers), 3))
    position[np.asarray(numbers, dtype=np.int64) - 1] = np.reshape(x, (-1, 3))
    bodies, surfaces = (
        {name: (tag, _elements(gmsh, dim, tag)) for name, tag in named.items()}
        for dim, named in ((groups.dim, groups.bodies), (groups.dim - 1, groups.surfaces))
    )
    kinds = {kind for _, blocks in bodies.values() for kind in blocks}
    first = next(iter(kinds))
    if len(kinds) > 1 or first.shape not in FACETS:
        _check_facet_order(surfaces, source)
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
    used = np.unique(np.concatenate([part.nodes.reshape(-1) for part in bodies.values()]))
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


def _check_facet_order(surfaces: _Named, source: str) -> None:
    """Facets of first-order cells must be of first order themselves."""
    for name, (_, blocks) in surfaces.items():
        if any(kind.order > 1 for kind in blocks):
            raise MeshError(
                f"{source}: the facets of surface {name!r} are of second order, its cells are not"
            )


def _by_shape(parts: _Named) -> Parts:
    """The same with first-order elements by their shape."""
    return {
        name: (tag, {kind.shape: rows for kind, rows in blocks.items()})
        for name, (tag, blocks) in parts.items()
    }
