"""Facets of a body's surface as the mesh has them: nodes, lengths, ends, and which way is out.

Axis letters: f facets, a facet nodes, e ends of a surface (in space: edges), k their corners, i
space.
"""

from __future__ import annotations

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from tribox.geometry.compat import facet_kind, facets_per_cell
from tribox.geometry.surfaces.facets import FacetShape, Floats, Longs, facet_shape, unit_normals

SMOOTH = np.radians(30.0)  # angle between facets up to which a body's surface goes on smoothly


def displacement_facet(space: dolfinx.fem.FunctionSpace) -> FacetShape:
    """Shape of the facets of a displacement; ValueError if there are none of its degree or cell."""
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
    return np.take_along_axis(space.dofmap.list[cells], closure[local].astype(np.int64), axis=1)


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


def owned_facets(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32]) -> NDArray[np.int32]:
    """The facets that this rank owns."""
    return facets[facets < mesh.topology.index_map(mesh.topology.dim - 1).size_local]


def require_facets(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32], side: str) -> None:
    """ValueError, on every rank, if the ``side`` of a pair has no facets; collective."""
    if mesh.comm.allreduce(len(owned_facets(mesh, facets)), op=MPI.SUM) == 0:
        raise ValueError(f"the {side} surface has no facet")


class OuterFacets:
    """This rank's facets of the boundary of all bodies, and where named surfaces end on it.

    Attributes:
        nodes: (n,) local ones, sorted, of these facets.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace) -> None:
        """Collect them; collective."""
        mesh, shape = space.mesh, displacement_facet(space)
        tdim = mesh.topology.dim
        mesh.topology.create_connectivity(tdim - 1, tdim)
        outer = dolfinx.mesh.exterior_facet_indices(mesh.topology)
        local, position = outward_facets(space, shape, outer)
        corners = local[:, : shape.corners]
        glob = space.dofmap.index_map.local_to_global(corners.reshape(-1).astype(np.int32))
        self._corners: Longs = glob.reshape(corners.shape).astype(np.int64)
        self.nodes: Longs = np.unique(local).astype(np.int64)
        middle = np.mean(shape.points[: shape.corners], axis=0)
        tangents = np.einsum("ba,fai->fbi", shape.first(middle[None])[0], position)
        self._normal: Floats = unit_normals(tangents)
        self._shape, self._comm = shape, mesh.comm

    def smooth_ends(self, surface: Longs, others: Longs) -> Longs:
        """Ends (e, k) of a surface behind which its body's boundary goes on smoothly; collective.

        Global nodes of corners, the same on every rank. At a corner of the body, an axis or a plane
        of symmetry there is none, nor where ``others`` (f, a) begin, facets as those of
        ``surface``, corners first, this rank's or all.
        """
        mine, more = self._gathered(surface), self._gathered(others)
        # A side that one facet alone has is an end of the surface.
        sides, count = np.unique(self._sides(mine), axis=0, return_counts=True)
        ends: Longs = sides[count == 1]
        keys = np.sort(self._corners, axis=1)
        inside, covered = (_found(keys, np.sort(rows, axis=1)) >= 0 for rows in (mine, more))
        at = _found(self._sides(self._corners), ends).reshape(len(keys), len(self._shape.sides))
        normals = np.zeros((2, len(ends), self._normal.shape[1]))
        for normal, facets in zip(normals, (inside, ~inside & ~covered), strict=True):
            facet, side = np.nonzero((at >= 0) & facets[:, None])
            normal[at[facet, side]] = self._normal[facet]
        here, beyond = self._comm.allreduce(normals)
        return ends[np.einsum("ei,ei->e", here, beyond) > np.cos(SMOOTH)]

    def _gathered(self, facets: Longs) -> Longs:
        """Corners (f, k) of the distinct ones of all ranks' facets (f, a); collective."""
        corners = np.concatenate(self._comm.allgather(facets[:, : self._shape.corners]))
        _, first = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
        return corners[first]

    def _sides(self, corners: Longs) -> Longs:
        """Sorted corners (f s, k) of the sides of each facet in turn."""
        sides = [corners[:, side.nodes[:2]] for side in self._shape.sides]
        stacked = np.sort(np.stack(sides, axis=1), axis=2)
        return stacked.reshape(-1, stacked.shape[2])


def _found(rows: Longs, among: Longs) -> Longs:
    """For each row (n, k) its number among distinct others (m, k); −1: not among them."""
    _, number = np.unique(np.concatenate([among, rows]), axis=0, return_inverse=True)
    which = np.full(int(number.max(initial=-1)) + 1, -1, dtype=np.int64)
    which[number[: len(among)]] = np.arange(len(among))
    return which[number[len(among) :]]


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
