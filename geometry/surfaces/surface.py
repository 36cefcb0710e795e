"""A contact pair's surfaces: quadrature points on the slave side, facets on the master side.

The slave points come from a facet submesh with a quadrature space; UFL assembles once the operator
S = ∫ t̂·v dΓ₀ between that space and the displacement space, whose rows hold the shape functions of
each point, so that any displacement element and any order of points on a facet is right by
construction. The master surface is a fixed list of nodes and facets. Both are replicated where
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

from geometry.compat import (
    facet_kind,
    facet_submesh,
    facets_per_cell,
    integration_facets,
    mixed_form,
)
from geometry.surfaces.facets import FacetShape, Floats, Ints, Longs, facet_shape, unit_normals
from geometry.surfaces.ordering import order_by_place
from geometry.surfaces.projection import FacetSurface, Projection
from geometry.surfaces.slave_normals import PointNormals, SlaveNormals
from geometry.surfaces.vertices import slave_vertices

# Default degree of the quadrature on slave facets, by the dimension of space.
QUADRATURE_DEGREE = {2: 9, 3: 5}


@dataclass(slots=True)
class SlavePoints:
    """Quadrature points of the slave facets owned by this rank.

    Attributes:
        nodes: (q, a) global node (displacement block) numbers that move each point.
        shape: (q, a) shape functions there.
        shape_derivative: (q, α, a) their derivatives along ``tangents``, per reference length, 1/m.
        weight: (q,) quadrature weight times reference facet measure: m (per unit thickness) in the
            plane, m² in space and with axial symmetry (the whole ring 2πR).
        position: (q, i), m, reference.
        tangents: (q, α, i) orthonormal tangents of the facets, reference.
        facet: (q,) number of the slave facet, for counting pairs of facets; mesh_facet: (q,) its
            local number in the mesh.
        xi: (q, α) reference coordinates on it; facet_length: (q,), m, its length, in space the side
            of a square or of half a square of its area; facet_share: (q,) share of it that the
            point stands for; reach: (q,), m, in the plane half the way from the point to the end of
            that piece, so that no point fades while slave and master end at the same place.
    """

    nodes: Longs
    shape: Floats
    shape_derivative: Floats
    weight: Floats
    position: Floats
    tangents: Floats
    facet: Ints
    mesh_facet: Ints
    xi: Floats
    facet_length: Floats
    facet_share: Floats
    reach: Floats


@dataclass(slots=True)
class MasterFacets:
    """All master facets of the pair, the same on every rank.

    Attributes:
        nodes: (n,) global node (displacement block) numbers.
        facets: (f, a) rows into ``nodes``, ordered so that the normal points out of the body.
        position: (n, i), m, reference.
        shape: of all facets.
    """

    nodes: Longs
    facets: Ints
    position: Floats
    shape: FacetShape


class ContactSurface:
    """Slave points and master facets of one pair, and the current positions of both.

    Attributes:
        slave, master: points and facets; vertices: of the slave facets.
        target: search for the closest point on the master.
        facet_length: m, mean length of the slave facets.
        nodes: (m,) global nodes of the pair: those of this rank's slave facets, then all master
            nodes from row ``first_master`` on; slave_rows: (q, a) rows of the points' nodes.
        normals: of the slave, for the kinks of a master in the plane; None without kinks.
            chain_rows: (q, s) rows of the vertices that they take.
    """

    def __init__(
        self,
        space: dolfinx.fem.FunctionSpace,
        slave_facets: NDArray[np.int32],
        master_facets: NDArray[np.int32],
        quadrature_degree: int,
        axisymmetric: bool = False,
        smoothing_angle: float | None = None,
    ) -> None:
        """Collect both surfaces; collective.

        Args:
            space: blocked vector Lagrange space of the displacement, of degree 1 or 2.
            slave_facets: local facets (owned and ghosts) of the slave surface.
            master_facets: local facets (owned and ghosts) of the master surface.
            quadrature_degree: degree integrated exactly on an affine slave facet.
            axisymmetric: whether x is the distance from an axis of symmetry; weights then are those
                of whole rings, and forces totals.
            smoothing_angle: rad; a smooth master, but for sides where its facets' normals differ by
                more. None: the facets as they are.

        Raises:
            ValueError: on every rank, if a surface has no facet or folds onto itself, the
                displacement has another degree, or the master cannot be made smooth.
        """
        self.space = space
        self.dim = space.mesh.geometry.dim
        self.axisymmetric = axisymmetric
        self.shape = displacement_facet(space)
        self.slave = _slave_points(space, self.shape, slave_facets, quadrature_degree)
        self.facet_length = facet_length(space.mesh, slave_facets)
        if axisymmetric:
            self.slave.weight = 2.0 * np.pi * self.slave.position[:, 0] * self.slave.weight
        self.master = _master_facets(space, self.shape, master_facets)
        self.target = FacetSurface(
            self.shape, self.master.facets, self.master.position, smoothing_angle
        )
        self.vertices = slave_vertices(
            space,
            self.shape,
            self.slave.nodes,
            self.slave.xi,
            self.slave.weight,
            self.slave.facet_length,
        )
        self.normals = self._find_normals() if self.target.has_kinks else None
        self._number_nodes()
        self._scatter: PETSc.Scatter | None = None

    def _number_nodes(self) -> None:
        """Number the nodes of the pair, and find those of each point."""
        chain: Longs = np.empty((0, 4), dtype=np.int64)
        if self.normals is not None:
            chain = self.vertices.nodes[self.normals.around]
        needed: Longs = np.unique(np.concatenate([self.slave.nodes.ravel(), chain.ravel()]))
        self.slave_rows: Longs = np.searchsorted(needed, self.slave.nodes)
        self.chain_rows: Longs = np.searchsorted(needed, chain)
        self.first_master = len(needed)
        self.nodes: Longs = np.concatenate([needed, self.master.nodes])

    def _find_normals(self) -> SlaveNormals:
        """Normals of a slave in the plane; collective."""
        local = _outward(self.space, self.shape, self.slave.mesh_facet)[0]
        first = self.space.dofmap.index_map.local_to_global(local[:, 0].astype(np.int32))
        return SlaveNormals(self.vertices, first != self.slave.nodes[:, 0])

    def displacements(self, x: PETSc.Vec) -> tuple[Floats, Floats]:
        """Displacements of the slave points' nodes (q, a, i) and master nodes (n, i); collective.

        Args:
            x: global vector of the displacement space, m.
        """
        values = self.gather(x)
        return values[self.slave_rows], values[self.first_master :]

    def gather(self, x: PETSc.Vec) -> Floats:
        """Displacements (m, i), m, of the pair's ``nodes``; collective.

        Args:
            x: global vector of the displacement space, m.
        """
        if self._scatter is None:
            index = PETSc.IS().createBlock(
                self.dim, self.nodes.astype(PETSc.IntType), comm=PETSc.COMM_SELF
            )
            self._here = PETSc.Vec().createSeq(self.dim * len(self.nodes))
            self._scatter = PETSc.Scatter().create(x, index, self._here, None)
        self._scatter.scatter(x, self._here, addv=False, mode=False)
        return np.array(self._here.array_r).reshape(-1, self.dim)

    def project(
        self,
        points: Floats,
        nodes: Floats,
        frozen_facets: Ints | None = None,
        rays: PointNormals | None = None,
        fading: bool = False,
    ) -> Projection:
        """Closest points on the master, on its current nodes (n, i), m, of the points (q, i), m.

        Args:
            points: see above.
            nodes: see above.
            frozen_facets: (q,) facets that the points do not leave for a neighbour at once.
            rays: normals of the slave at the points, to project along; None: closest points.
            fading: whether points leave the end of a master in the plane bit by bit.
        """
        return self.target.project(
            points, nodes, frozen_facets, rays, self.slave.reach if fading else None
        )

    def slave_normals(self, values: Floats) -> PointNormals | None:
        """Normals to project along, from displacements (m, i) of the pair's nodes, or None."""
        if self.normals is None:
            return None
        position = self.vertices.position[self.normals.around] + values[self.chain_rows]
        return self.normals.at(position)

    def master_nodes(self, facet: Ints) -> Longs:
        """Global nodes (q, m) that move the master facets ``facet`` (q,)."""
        nodes: Longs = self.master.nodes[self.target.stencil[facet]]
        return nodes

    def slave_positions(self, displacement: Floats) -> Floats:
        """Current positions (q, i) of the slave points from nodal displacements (q, a, i)."""
        moved: Floats = np.einsum("qa,qai->qi", self.slave.shape, displacement)
        return self.slave.position + moved

    def slave_area_ratio(self, displacement: Floats) -> Floats:
        """Area ratio da/dA (q,) of the slave surface from nodal displacements (q, a, i).

        The current tangents t_α = T_α + ∂u/∂T_α span the area |t_1| or |t_1 × t_2|; a ring also
        grows by r/R.
        """
        grad = np.einsum("qba,qai->qbi", self.slave.shape_derivative, displacement)
        now = self.slave.tangents + grad
        ratio: Floats = _measure(now)
        if self.axisymmetric:
            ratio *= self.slave_positions(displacement)[:, 0] / self.slave.position[:, 0]
        return ratio


def _measure(tangents: Floats) -> Floats:
    """Length (q,) of one tangent, or area of the parallelogram of two, (q, α, i)."""
    if tangents.shape[1] == 1:
        out: Floats = np.linalg.norm(tangents[:, 0], axis=1)
        return out
    return np.linalg.norm(np.cross(tangents[:, 0], tangents[:, 1]), axis=1)


def displacement_facet(space: dolfinx.fem.FunctionSpace) -> FacetShape:
    """Shape of the facets of a displacement space.

    Raises:
        ValueError: neither the first nor the second degree, or a cell without such facets.
    """
    degree = space.element.basix_element.degree
    if degree > 2:
        raise ValueError(f"contact takes displacements of degree 1 or 2, not {degree}")
    return facet_shape(facet_kind(space.mesh), degree)


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


def facet_length(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32]) -> float:
    """Mean length of facets, m; in space the side of a square or of half a square; collective.

    Args:
        mesh: the mesh.
        facets: local facets, owned and ghosts.
    """
    dim = mesh.topology.dim
    mesh.topology.create_connectivity(dim - 1, 0)
    longest = mesh.h(dim - 1, _owned(mesh, facets))
    total, count = mesh.comm.allreduce(np.array([longest.sum(), float(len(longest))]))
    return float(total / count / np.sqrt(dim - 1))


def _owned(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32]) -> NDArray[np.int32]:
    size = mesh.topology.index_map(mesh.topology.dim - 1).size_local
    return facets[facets < size]


def point_operator(
    space: dolfinx.fem.FunctionSpace, facets: NDArray[np.int32], degree: int
) -> tuple[PETSc.Mat, Ints]:
    """Sᵀ = ∫ t̂·u dΓ₀, rows the points of the facet submesh, blocked.

    Returns:
        The matrix, and the local facet of the mesh that each owned point (q,) lies on.
    """
    mesh = space.mesh
    fdim = mesh.topology.dim - 1
    sub, to_parent, relation = facet_submesh(mesh, facets)
    dim = mesh.geometry.dim
    element = basix.ufl.quadrature_element(sub.basix_cell(), value_shape=(dim,), degree=degree)
    points = dolfinx.fem.functionspace(sub, element)
    ds = ufl.Measure(
        "ds",
        domain=mesh,
        subdomain_data=[(1, integration_facets(mesh, facets))],
        metadata={"quadrature_degree": degree},
    )(1)
    form = ufl.inner(ufl.TrialFunction(space), ufl.TestFunction(points)) * ds
    matrix = dolfinx.fem.petsc.assemble_matrix(mixed_form(form, relation))
    matrix.assemble()
    owned = points.dofmap.index_map.size_local
    per_facet = points.dofmap.dof_layout.num_dofs
    cell = np.empty(owned, dtype=np.int32)
    table = points.dofmap.list[: sub.topology.index_map(fdim).size_local]
    cell[table.reshape(-1)] = np.repeat(np.arange(len(table), dtype=np.int32), per_facet)
    return matrix, to_parent[cell]


def _rows(matrix: PETSc.Mat, nodes: Longs, dim: int) -> Floats:
    """Values (q, a) of the first component of each owned point at the given nodes (q, a)."""
    indptr, indices, values = matrix.getValuesCSR()
    count = np.diff(indptr)[::dim]
    row = np.repeat(np.arange(len(count)), count)
    start = np.repeat(indptr[:-1:dim] - np.cumsum(count) + count, count)
    take = start + np.arange(len(row))
    width = np.int64(matrix.getSize()[1])
    key = row * width + indices[take]
    order = np.argsort(key)
    wanted = np.arange(len(nodes))[:, None] * width + dim * nodes
    found: Floats = values[take][order][np.searchsorted(key, wanted, sorter=order)]
    return found


def _slave_points(
    space: dolfinx.fem.FunctionSpace, form: FacetShape, facets: NDArray[np.int32], degree: int
) -> SlavePoints:
    mesh = space.mesh
    _require_facets(mesh, facets, "slave")
    operator, facet = point_operator(space, facets, degree)
    distinct, number = np.unique(facet, return_inverse=True)
    local = facet_nodes(space, distinct)[number].reshape(len(facet), form.count)
    nodes = space.dofmap.index_map.local_to_global(local.reshape(-1)).reshape(local.shape)
    values = _rows(operator, nodes, mesh.geometry.dim)
    operator.destroy()
    weight = values.sum(axis=1)
    shape = values / weight[:, None]
    corners = space.tabulate_dof_coordinates()[:, : mesh.geometry.dim][local]
    # Shape functions reproduce the reference coordinates: so each point's are known, in the order
    # in which the operator has the points.
    xi = shape @ form.points
    derivative = form.first(xi)
    tangents, derivative = _orthonormal(np.einsum("qba,qai->qbi", derivative, corners), derivative)
    number = number.reshape(-1)
    length = _lengths(form, number, weight)
    share = weight / np.bincount(number, weight)[number]
    return SlavePoints(
        nodes=nodes.astype(np.int64),
        shape=shape,
        shape_derivative=derivative,
        weight=weight,
        position=np.einsum("qa,qai->qi", shape, corners),
        tangents=tangents,
        facet=number.astype(np.int32),
        mesh_facet=facet.astype(np.int32),
        xi=xi,
        facet_length=length,
        facet_share=share,
        reach=length * _half_way_to_the_end(number, xi, share),
    )


def _half_way_to_the_end(facet: Longs, xi: Floats, share: Floats) -> Floats:
    """Half the way (q,), in lengths of a facet, from the points to the ends of their pieces.

    Along a facet in the plane the pieces lie one after the other, each with its point inside.
    """
    order = np.lexsort([xi[:, 0], facet])
    total = np.cumsum(share[order])  # a facet's shares add up to one
    end = np.empty_like(total)
    end[order] = total - facet[order]
    inside = xi[:, 0]
    out: Floats = 0.5 * np.minimum(inside - (end - share), end - inside)
    return out


def _lengths(form: FacetShape, facet: Longs, weight: Floats) -> Floats:
    """Length (q,), m, of each point's facet from the weights on it."""
    size = np.bincount(facet, weight).astype(np.float64)
    if form.directions == 2:
        size = np.sqrt(2.0 * size if form.cell == "triangle" else size)
    out: Floats = size[facet]
    return out


def _orthonormal(tangents: Floats, derivative: Floats) -> tuple[Floats, Floats]:
    """Gram–Schmidt on tangents (q, α, i), with the same combinations of derivatives (q, α, a)."""
    tangents, derivative = tangents.copy(), derivative.copy()
    if tangents.shape[1] == 2:
        first = np.einsum("qi,qi->q", tangents[:, 0], tangents[:, 0])
        share = (np.einsum("qi,qi->q", tangents[:, 0], tangents[:, 1]) / first)[:, None]
        tangents[:, 1] -= share * tangents[:, 0]
        derivative[:, 1] -= share * derivative[:, 0]
    length = np.linalg.norm(tangents, axis=2)[..., None]
    return tangents / length, derivative / length


def _master_facets(
    space: dolfinx.fem.FunctionSpace, shape: FacetShape, facets: NDArray[np.int32]
) -> MasterFacets:
    mesh = space.mesh
    _require_facets(mesh, facets, "master")
    local, position = _outward(space, shape, _owned(mesh, facets))
    glob = space.dofmap.index_map.local_to_global(local.reshape(-1).astype(np.int32))
    gathered = mesh.comm.allgather((glob.reshape(local.shape), position))
    nodes = np.concatenate([g for g, _ in gathered])
    where = np.concatenate([p for _, p in gathered])
    order = order_by_place(where[:, : shape.corners].mean(axis=1))
    nodes, where = nodes[order], where[order]
    unique, first, inverse = np.unique(nodes.reshape(-1), return_index=True, return_inverse=True)
    return MasterFacets(
        nodes=unique.astype(np.int64),
        facets=inverse.reshape(nodes.shape).astype(np.int32),
        position=where.reshape(-1, where.shape[-1])[first],
        shape=shape,
    )


def _outward(
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


def _require_facets(mesh: dolfinx.mesh.Mesh, facets: NDArray[np.int32], side: str) -> None:
    if mesh.comm.allreduce(len(_owned(mesh, facets)), op=MPI.SUM) == 0:
        raise ValueError(f"the {side} surface has no facet")
