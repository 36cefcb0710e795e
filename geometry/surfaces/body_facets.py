"""Facets of a body's surface as the mesh has them: nodes, lengths, and which way is out.

Axis letters: f facets, a facet nodes, i space.
"""

from __future__ import annotations

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from tribox.geometry.compat import facet_kind, facets_per_cell
from tribox.geometry.surfaces.facets import FacetShape, Floats, facet_shape, unit_normals


def displacement_facet(space: dolfinx.fem.FunctionSpace) -> FacetShape:
    """Shape of the facets of a displacement space.

    Raises:
        ValueError: neither the first nor the second degree, or a cell without such facets.
    """
    degree = space.element.basix_element.degree
    if degree > 2:
        raise ValueError(f"contact takes displacements of degree 1 or 2, not {degree}")
    return facet_shape(facet_kind(space.mesh), degree)


def facet_nodes(space: dolfinx.fem.FunctionSpace, facets: NDArray[np.int32]) -> NDArray[np.int32]:
    """Local nodes (f, a) of the displacement space on each local exterior facet, closure order."""
    tdim = space.mesh.topology.dim
    cells, local = _cells_of(space.mesh, facets)
    layout = space.dofmap.dof_layout
    local_facets = range(facets_per_cell(space.mesh))
    closure = np.array([layout.entity_closure_dofs(tdim - 1, i) for i in local_facets])
    nodes: NDArray[np.int32] = np.take_along_axis(
        space.dofmap.list[cells], closure[local].astype(np.int64), axis=1
    )
    return nodes


def outward_facets(
    space: dolfinx.fem.FunctionSpace, shape: FacetShape, facets: NDArray[np.int32]
) -> tuple[NDArray[np.int32], Floats]:
    """Local nodes (f, a) of facets and their positions (f, a, i), ordered for outward normals."""
    mesh = space.mesh
    dim = mesh.geometry.dim
    local = facet_nodes(space, facets)
    position = space.tabulate_dof_coordinates()[:, :dim][local]
    cells, _ = _cells_of(mesh, facets)
    inside = dolfinx.mesh.compute_midpoints(mesh, mesh.topology.dim, cells)[:, :dim]
    middle = np.mean(shape.points[: shape.corners], axis=0)
    tangents = np.einsum("ba,fai->fbi", shape.first(middle[None])[0], position)
    away = np.einsum("a,fai->fi", shape.values(middle[None])[0], position) - inside
    flip = np.einsum("fi,fi->f", away, unit_normals(tangents)) < 0.0
    # The mirror image of the reference domain: 1 − ξ in the plane, ξ¹ and ξ² exchanged in space.
    mirrored = 1.0 - shape.points if shape.directions == 1 else shape.points[:, ::-1]
    apart = np.linalg.norm(shape.points[None] - mirrored[:, None], axis=2)
    order = np.argmin(apart, axis=1)
    local[flip] = local[flip][:, order]
    position[flip] = position[flip][:, order]
    return local, position


def facet_length(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32]) -> float:
    """Mean length of facets, m; in space the side of a square or of half a square; collective.

    Args:
        mesh: the mesh.
        facets: local facets, owned and ghosts.
    """
    dim = mesh.topology.dim
    mesh.topology.create_connectivity(dim - 1, 0)
    longest = mesh.h(dim - 1, owned_facets(mesh, facets))
    total, count = mesh.comm.allreduce(np.array([longest.sum(), float(len(longest))]))
    return float(total / count / np.sqrt(dim - 1))


def owned_facets(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32]) -> NDArray[np.int32]:
    """The facets that this rank owns."""
    size = mesh.topology.index_map(mesh.topology.dim - 1).size_local
    return facets[facets < size]


def require_facets(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32], side: str) -> None:
    """Refuse a surface without facets; collective.

    Raises:
        ValueError: on every rank, naming the ``side``.
    """
    if mesh.comm.allreduce(len(owned_facets(mesh, facets)), op=MPI.SUM) == 0:
        raise ValueError(f"the {side} surface has no facet")


def _cells_of(
    mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Cell of each exterior facet, and the facet's number in it."""
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    mesh.topology.create_connectivity(tdim, tdim - 1)
    to_cell = mesh.topology.connectivity(tdim - 1, tdim)
    to_facet = mesh.topology.connectivity(tdim, tdim - 1)
    cells = to_cell.array[to_cell.offsets[facets]]
    table = to_facet.array.reshape(-1, facets_per_cell(mesh))[cells]
    return cells, np.argmax(table == facets[:, None], axis=1)
