"""A contact pair's surfaces: quadrature points on the slave side, facets on the master side.

The slave points come from a facet submesh with a quadrature space; UFL assembles once the operator
S = ∫ t̂·v dΓ₀ between that space and the displacement space, whose rows hold the shape functions of
each point, so that any displacement element and any order of points on a facet is right by
construction. The master surface is a fixed list of nodes and segments. Both are replicated where
they are needed by a single PETSc scatter per evaluation, so the mesh may be partitioned anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import basix.ufl
import dolfinx
import dolfinx.fem.petsc
import numpy as np
import ufl
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from geometry.projection import Floats, Ints, Polyline, facet_normal

Longs = NDArray[np.int64]


@dataclass(slots=True)
class SlavePoints:
    """Quadrature points of the slave facets owned by this rank.

    Attributes:
        nodes: (q, a) global node (displacement block) numbers that move each point.
        shape: (q, a) shape functions there.
        shape_derivative: (q, a) their derivative along the facet, per reference length, 1/m.
        weight: (q,), m: quadrature weight times reference facet measure (per unit thickness in 2D).
        position: (q, i), m, reference.
        tangent: (q, i) unit tangents of the facets, reference.
        facet: (q,) number of the slave facet, for counting pairs of facets.
    """

    nodes: Longs
    shape: Floats
    shape_derivative: Floats
    weight: Floats
    position: Floats
    tangent: Floats
    facet: Ints


@dataclass(slots=True)
class MasterFacets:
    """All master facets of the pair, the same on every rank.

    Attributes:
        nodes: (n,) global node (displacement block) numbers.
        facets: (f, 2) rows into ``nodes``, the body to the right of first → second.
        position: (n, i), m, reference.
    """

    nodes: Longs
    facets: Ints
    position: Floats


class ContactSurface:
    """Slave points and master facets of one pair, and the positions of both today."""

    def __init__(
        self,
        space: dolfinx.fem.FunctionSpace,
        slave_facets: NDArray[np.int32],
        master_facets: NDArray[np.int32],
        quadrature_degree: int,
    ) -> None:
        """Collect both surfaces; collective.

        Args:
            space: blocked vector Lagrange space of the displacement.
            slave_facets: local facets (owned and ghosts) of the slave surface.
            master_facets: local facets (owned and ghosts) of the master surface.
            quadrature_degree: degree integrated exactly on a straight slave facet.

        Raises:
            ValueError: on every rank, if a surface has no facet or folds onto itself.
        """
        self.space = space
        self.dim = space.mesh.geometry.dim
        self.slave = _slave_points(space, slave_facets, quadrature_degree)
        self.master = _master_facets(space, master_facets)
        self.polyline = Polyline(self.master.facets, self.master.position)
        needed = np.unique(self.slave.nodes)
        self._slave_rows = np.searchsorted(needed, self.slave.nodes)
        self._slave_count = len(needed)
        self._gather_nodes = np.concatenate([needed, self.master.nodes])
        self._scatter: PETSc.Scatter | None = None

    def displacements(self, x: PETSc.Vec) -> tuple[Floats, Floats]:
        """Displacements of the slave points' nodes (q, a, i) and master nodes (n, i); collective.

        Args:
            x: global vector of the displacement space, m.
        """
        if self._scatter is None:
            index = PETSc.IS().createBlock(
                self.dim, self._gather_nodes.astype(PETSc.IntType), comm=PETSc.COMM_SELF
            )
            self._here = PETSc.Vec().createSeq(self.dim * len(self._gather_nodes))
            self._scatter = PETSc.Scatter().create(x, index, self._here, None)
        self._scatter.scatter(x, self._here, addv=False, mode=False)
        values = self._here.array_r.reshape(-1, self.dim)
        slave = values[: self._slave_count]
        return slave[self._slave_rows], values[self._slave_count :].copy()

    def slave_positions(self, displacement: Floats) -> Floats:
        """Current positions (q, i) of the slave points from nodal displacements (q, a, i)."""
        moved: Floats = np.einsum("qa,qai->qi", self.slave.shape, displacement)
        return self.slave.position + moved

    def slave_stretch(self, displacement: Floats) -> Floats:
        """Area stretch da/dA (q,) of the slave surface from nodal displacements (q, a, i)."""
        grad = np.einsum("qa,qai->qi", self.slave.shape_derivative, displacement)
        stretch: Floats = np.linalg.norm(self.slave.tangent + grad, axis=1)
        return stretch


def facet_nodes(space: dolfinx.fem.FunctionSpace, facets: NDArray[np.int32]) -> NDArray[np.int32]:
    """Local nodes (f, a) of the displacement space on each local facet, in closure order."""
    mesh = space.mesh
    tdim = mesh.topology.dim
    mesh.topology.create_connectivity(tdim - 1, tdim)
    mesh.topology.create_connectivity(tdim, tdim - 1)
    cell = mesh.topology.connectivity(tdim - 1, tdim)
    facet = mesh.topology.connectivity(tdim, tdim - 1)
    layout = space.dofmap.dof_layout
    count = len(layout.entity_closure_dofs(tdim - 1, 0))
    nodes = np.empty((len(facets), count), dtype=np.int32)
    for row, f in enumerate(facets):  # once, at set-up
        c = cell.links(f)[0]
        local = int(np.nonzero(facet.links(c) == f)[0][0])
        nodes[row] = space.dofmap.cell_dofs(c)[layout.entity_closure_dofs(tdim - 1, local)]
    return nodes


def _owned(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32]) -> NDArray[np.int32]:
    size = mesh.topology.index_map(mesh.topology.dim - 1).size_local
    return facets[facets < size]


def integration_facets(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32]) -> NDArray[np.int32]:
    """(cell, local facet) pairs, flattened, of the owned ones among ``facets``."""
    mesh.topology.create_connectivity(mesh.topology.dim - 1, mesh.topology.dim)
    mesh.topology.create_connectivity(mesh.topology.dim, mesh.topology.dim - 1)
    pairs: NDArray[np.int32] = dolfinx.fem.compute_integration_domains(
        dolfinx.fem.IntegralType.exterior_facet,
        mesh.topology,
        np.sort(facets),
        mesh.topology.dim - 1,
    )
    return np.asarray(pairs, dtype=np.int32).reshape(-1)


def point_operators(
    space: dolfinx.fem.FunctionSpace, facets: NDArray[np.int32], degree: int
) -> tuple[PETSc.Mat, PETSc.Mat, Ints, Floats]:
    """Sᵀ and its derivative along the facet, rows the points of the facet submesh.

    Returns:
        ∫ t̂·u dΓ₀ and ∫ t̂·∂u/∂s dΓ₀ (blocked rows), the submesh cell of each owned point (q,),
        and the unit tangents (q, i) along which s is measured.
    """
    mesh = space.mesh
    fdim = mesh.topology.dim - 1
    sub, to_parent = dolfinx.mesh.create_submesh(mesh, fdim, np.sort(facets))[:2]
    dim = mesh.geometry.dim
    element = basix.ufl.quadrature_element(sub.basix_cell(), value_shape=(dim,), degree=degree)
    points = dolfinx.fem.functionspace(sub, element)
    parent_facets = mesh.topology.index_map(fdim)
    to_sub = np.full(parent_facets.size_local + parent_facets.num_ghosts, -1, dtype=np.int32)
    to_sub[to_parent] = np.arange(len(to_parent), dtype=np.int32)
    ds = ufl.Measure(
        "ds",
        domain=mesh,
        subdomain_data=[(1, integration_facets(mesh, facets))],
        metadata={"quadrature_degree": degree},
    )(1)
    test, trial = ufl.TestFunction(points), ufl.TrialFunction(space)
    n = ufl.FacetNormal(mesh)
    along = ufl.as_vector((-n[1], n[0]))
    forms = (
        ufl.inner(trial, test) * ds,
        ufl.inner(ufl.dot(ufl.grad(trial), along), test) * ds,
    )
    matrices = []
    for form in forms:
        compiled = dolfinx.fem.form(form, entity_maps={sub: to_sub})
        matrix = dolfinx.fem.petsc.assemble_matrix(compiled)
        matrix.assemble()
        matrices.append(matrix)
    tangent = dolfinx.fem.petsc.assemble_vector(
        dolfinx.fem.form(ufl.inner(along, test) * ds, entity_maps={sub: to_sub})
    )
    owned = points.dofmap.index_map.size_local
    per_facet = points.dofmap.dof_layout.num_dofs
    cell = np.empty(owned, dtype=np.int32)
    table = points.dofmap.list[: sub.topology.index_map(fdim).size_local]
    cell[table.reshape(-1)] = np.repeat(np.arange(len(table), dtype=np.int32), per_facet)
    weighted = tangent.array_r[: owned * dim].reshape(-1, dim).copy()
    tangent.destroy()
    return matrices[0], matrices[1], cell, weighted


def _rows(matrix: PETSc.Mat, dim: int) -> tuple[Longs, Longs, Floats]:
    """First component of each owned point: (row pointer, node numbers, values)."""
    indptr, indices, values = matrix.getValuesCSR()
    count = np.diff(indptr)[::dim]
    take = np.concatenate(
        [np.arange(a, b) for a, b in zip(indptr[:-1:dim], indptr[1::dim], strict=True)]
        or [np.empty(0, dtype=int)]
    )
    keep = indices[take] % dim == 0
    owner = np.repeat(np.arange(len(count)), count)[keep]
    pointer = np.concatenate([[0], np.cumsum(np.bincount(owner, minlength=len(count)))])
    return pointer, indices[take][keep].astype(np.int64) // dim, values[take][keep]


def _slave_points(
    space: dolfinx.fem.FunctionSpace, facets: NDArray[np.int32], degree: int
) -> SlavePoints:
    mesh = space.mesh
    _require_facets(mesh, facets, "slave")
    shape, derivative, cell, tangent = point_operators(space, facets, degree)
    dim = mesh.geometry.dim
    pointer, nodes, values = _rows(shape, dim)
    _, _, slopes = _rows(derivative, dim)
    shape.destroy()
    derivative.destroy()
    count = len(space.dofmap.dof_layout.entity_closure_dofs(mesh.topology.dim - 1, 0))
    points = len(pointer) - 1
    width = len(nodes) // points if points else count
    # Each row also holds the nodes of the cell off the facet, with values of round-off.
    table = np.abs(values).reshape(points, width)
    pick = np.sort(np.argsort(-table, axis=1)[:, :count], axis=1)
    row = np.arange(points)[:, None]
    values, slopes, nodes = (a.reshape(points, width)[row, pick] for a in (values, slopes, nodes))
    weight = values.sum(axis=1)
    coordinates = _coordinates(space, nodes)
    return SlavePoints(
        nodes=nodes,
        shape=values / weight[:, None],
        shape_derivative=slopes / weight[:, None],
        weight=weight,
        position=np.einsum("qa,qai->qi", values / weight[:, None], coordinates),
        tangent=tangent / weight[:, None],
        facet=cell,
    )


def _coordinates(space: dolfinx.fem.FunctionSpace, nodes: Longs) -> Floats:
    """Reference positions (…, i) of global nodes that this rank owns or has as ghosts."""
    imap = space.dofmap.index_map
    local = np.arange(imap.size_local + imap.num_ghosts, dtype=np.int32)
    known = imap.local_to_global(local)
    order = np.argsort(known)
    at = order[np.searchsorted(known, nodes, sorter=order)]
    positions: Floats = space.tabulate_dof_coordinates()[at][..., : space.mesh.geometry.dim]
    return positions


def _master_facets(space: dolfinx.fem.FunctionSpace, facets: NDArray[np.int32]) -> MasterFacets:
    mesh = space.mesh
    _require_facets(mesh, facets, "master")
    mine = _owned(mesh, facets)
    local = facet_nodes(space, mine)
    if local.shape[1] != 2:
        raise ValueError("master surfaces take straight two-node segments (first-order elements)")
    position = space.tabulate_dof_coordinates()[:, : mesh.geometry.dim][local]
    tdim = mesh.topology.dim
    cell = mesh.topology.connectivity(tdim - 1, tdim)
    cells = np.array([cell.links(f)[0] for f in mine], dtype=np.int32)
    inside = dolfinx.mesh.compute_midpoints(mesh, tdim, cells)[:, : mesh.geometry.dim]
    outward = facet_normal(position[:, 1] - position[:, 0])
    flip = np.einsum("fi,fi->f", inside - position[:, 0], outward) > 0.0
    local[flip] = local[flip][:, ::-1]
    position[flip] = position[flip][:, ::-1]
    glob = space.dofmap.index_map.local_to_global(local.reshape(-1).astype(np.int32))
    gathered = mesh.comm.allgather((glob.reshape(-1, 2), position))
    nodes = np.concatenate([g for g, _ in gathered])
    where = np.concatenate([p for _, p in gathered])
    # Sorted by place, so that the numbering does not depend on the partition.
    middle = where.mean(axis=1)
    order = np.lexsort(middle.T[::-1])
    nodes, where = nodes[order], where[order]
    unique, first, inverse = np.unique(nodes.reshape(-1), return_index=True, return_inverse=True)
    table = inverse.reshape(nodes.shape).astype(np.int32)
    for column, word in ((0, "start"), (1, "end")):
        if len(np.unique(table[:, column])) != len(table):
            raise ValueError(f"the master surface branches: two of its facets {word} at one node")
    return MasterFacets(
        nodes=unique.astype(np.int64),
        facets=table,
        position=where.reshape(-1, where.shape[-1])[first],
    )


def _require_facets(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32], side: str) -> None:
    if mesh.comm.allreduce(len(_owned(mesh, facets)), op=MPI.SUM) == 0:
        raise ValueError(f"the {side} surface has no facet")
