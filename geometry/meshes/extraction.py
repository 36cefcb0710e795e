"""From a gmsh model to the arrays of a mesh; on one process."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import numpy.typing as npt

from geometry.meshes.elements import FACETS, KINDS, NUMBERS, Kind
from geometry.meshes.gmsh_model import MeshError, elements_of, named_groups
from geometry.meshes.mesh_arrays import MeshArrays, Part
from geometry.meshes.refinement import Parts, refined


def arrays_of(gmsh: ModuleType, source: str) -> MeshArrays:
    """Check the current model and take its mesh out of it.

    Args:
        gmsh: The module, from ``gmsh_session``.
        source: Name of the model in messages, for instance its file.

    Raises:
        MeshError: The mesh cannot be used, see `geometry.meshes.gmsh_model.named_groups`.
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
        return refined(position, _by_shape(bodies), _by_shape(surfaces), source)
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
    return MeshArrays(first.shape, position, parts[0], parts[1], order=first.order)


_Named = dict[str, tuple[int, dict[Kind, npt.NDArray[np.int64]]]]


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
