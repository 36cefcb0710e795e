"""A contact pair's surfaces: quadrature points on the slave side, facets on the master side.

The master surface is a fixed list of nodes and facets. Displacements of both are replicated where
they are needed by a single PETSc scatter per evaluation, so the mesh may be partitioned anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import dolfinx
import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.geometry.surfaces.body_facets import (
    displacement_facet,
    facet_length,
    outward_facets,
    owned_facets,
    require_facets,
)
from tribox.geometry.surfaces.facets import (
    FacetShape,
    Floats,
    Ints,
    Longs,
    order_by_place,
    unit_normals,
)
from tribox.geometry.surfaces.projection import FacetSurface, Projection
from tribox.geometry.surfaces.rigid import RigidSurface
from tribox.geometry.surfaces.rigid_motion import RigidMotion
from tribox.geometry.surfaces.slave_points import PointNormals, SlaveNormals, slave_points
from tribox.geometry.surfaces.target import Target
from tribox.geometry.surfaces.vertices import slave_vertices

# Default degree of the quadrature on slave facets, by the dimension of space.
QUADRATURE_DEGREE = {2: 9, 3: 5}
ROUND = np.cos(np.radians(10.0))  # between a facet's normal and that of a round surface there


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

    def sizes(self) -> Floats:
        """Length (f,), m, of each undeformed facet; in space the side of a square or half one."""
        corners = self.position[self.facets[:, : self.shape.corners]]
        apart = np.linalg.norm(corners[:, :, None] - corners[:, None], axis=3)
        longest: Floats = apart.max(axis=(1, 2)) / np.sqrt(self.shape.directions)
        return longest


@dataclass(slots=True)
class RigidMaster:
    """A rigid surface as master, the same on every rank.

    Attributes:
        nodes: global nodes (displacement blocks) that move it: (2,) reference nodes, as in
            :class:`~tribox.geometry.surfaces.rigid_motion.RigidMotion`, or without ``motion`` (a,)
            those that are its control points.
        surface: of the tool.
        motion: of its control points.
    """

    nodes: Longs
    surface: RigidSurface
    motion: RigidMotion | None = None

    @property
    def position(self) -> Floats:
        """Control points (a, i), m, reference."""
        return self.surface.control_points


class ContactSurface:
    """Slave points and master facets of one pair, and the current positions of both.

    Attributes:
        slave: points; vertices: of the slave facets.
        master: facets, or a rigid surface.
        target: search for the closest point on the master.
        facet_length: m, mean length of the slave facets.
        nodes: (m,) global nodes of the pair: those of this rank's slave facets, then all nodes of
            the master from row ``first_master`` on; slave_rows: (q, a) rows of the points' nodes.
        normals: of the slave, for the kinks of a master in the plane; None without kinks.
            chain_rows: (q, s) rows of the vertices that they take.
    """

    def __init__(
        self,
        space: dolfinx.fem.FunctionSpace,
        slave_facets: NDArray[np.int32],
        master: NDArray[np.int32] | RigidMaster,
        quadrature_degree: int,
        axisymmetric: bool = False,
        smoothing_angle: float | None = None,
        fade_length: float | None = None,
    ) -> None:
        """Collect both surfaces; collective.

        Args:
            space: blocked vector Lagrange space of the displacement, of degree 1 or 2.
            slave_facets: local facets (owned and ghosts) of the slave surface.
            master: local facets (owned and ghosts) of the master surface, or a rigid one.
            quadrature_degree: degree integrated exactly on an affine slave facet.
            axisymmetric: whether x is the distance from an axis of symmetry; weights then are those
                of whole rings, and forces totals.
            smoothing_angle: rad; a smooth master, but for sides where its facets' normals differ by
                more. None: the facets as they are.
            fade_length: m, way before an open end over which averaged pressure fades, if given.

        Raises:
            ValueError: on every rank, if a surface has no facet or folds onto itself, the degree of
                the displacement is another, or the master cannot be smooth or has another dim.
        """
        self.space = space
        self.dim = space.mesh.geometry.dim
        self.axisymmetric = axisymmetric
        self.shape = displacement_facet(space)
        self.slave = slave_points(space, self.shape, slave_facets, quadrature_degree)
        self.facet_length = facet_length(space.mesh, slave_facets)
        if axisymmetric:
            self.slave.weight = 2.0 * np.pi * self.slave.position[:, 0] * self.slave.weight
        self.master, self.target = _master_and_target(
            space, self.shape, master, smoothing_angle, fade_length
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

    @classmethod
    def for_tool(
        cls,
        space: dolfinx.fem.FunctionSpace,
        slave_facets: NDArray[np.int32],
        surface: RigidSurface,
        reference_nodes: Longs,
        motion: RigidMotion,
        quadrature_degree: int,
        axisymmetric: bool = False,
    ) -> ContactSurface:
        """The pair of a slave and a rigid tool, see the constructor; collective.

        Args:
            space: of the displacement.
            slave_facets: local facets (owned and ghosts) of the slave surface.
            surface: of the tool.
            reference_nodes: (2,) global numbers of the nodes that hold its motion.
            motion: of the surface's control points.
            quadrature_degree: degree integrated exactly on an affine slave facet.
            axisymmetric: whether x is the distance from an axis of symmetry.
        """
        master = RigidMaster(np.asarray(reference_nodes, dtype=np.int64), surface, motion)
        return cls(space, slave_facets, master, quadrature_degree, axisymmetric)

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
        local = outward_facets(self.space, self.shape, self.slave.mesh_facet)[0]
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

    def master_positions(self, values: Floats) -> Floats:
        """Current positions (n, i), m, of the points that move the master.

        Args:
            values: (m, i), m, displacements of the pair's ``nodes``.
        """
        master, moved = self.master, values[self.first_master :]
        if isinstance(master, RigidMaster) and master.motion is not None:
            return master.motion.control_points(*master.motion.read(moved))
        out: Floats = master.position + moved
        return out

    def project(
        self,
        points: Floats,
        nodes: Floats,
        frozen_facets: Ints | None = None,
        rays: PointNormals | None = None,
        fading: bool = False,
    ) -> Projection:
        """Closest points on the master, on its :meth:`master_positions`, of the points (q, i), m.

        Args:
            points: see above.
            nodes: see above.
            frozen_facets: (q,) facets that the points do not leave for a neighbour at once.
            rays: normals of the slave at the points, to project along; None: closest points.
            fading: whether points leave the end of a master bit by bit.
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

    def slave_tangents(self, displacement: Floats) -> Floats:
        """Current tangents (q, α, i) of the slave facets from nodal displacements (q, a, i)."""
        now: Floats = self.slave.tangents.copy()
        slope = self.slave.shape_derivative
        for a in range(slope.shape[2]):  # few; a sum over all at once takes ten times as long
            now += slope[:, :, a, None] * displacement[:, None, a]
        return now

    def smooth_normals(
        self, at: Projection, nodes: Floats, slave_tangents: Floats
    ) -> tuple[Floats, Floats]:
        """Unit normals (q, i) of smooth surfaces through slave and master facets; collective.

        Those of facets are off by h/2R, and two surfaces would not face each other as they do. At
        kinks the facets' own are given. The slave's have the sign of the master's where they face
        each other.

        Args:
            at: the points (q,) on the master.
            nodes: (n, i), m, current, that move the master.
            slave_tangents: (q, α, i), current, of the slave facets.
        """
        vertices = self.vertices
        own, other = unit_normals(slave_tangents), unit_normals(at.tangents)
        own *= np.where(np.einsum("qi,qi->q", own, other) < 0.0, -1.0, 1.0)[:, None]
        # All facets around a vertex count alike, whatever their area: they have as many points.
        nodal = np.stack([vertices.sums(part) for part in own.T], axis=1)
        length = np.linalg.norm(nodal, axis=1)
        nodal /= np.where(length > 0.0, length, 1.0)[:, None]
        slave = np.einsum("qk,qki->qi", vertices.shape, nodal[vertices.of_point])
        master = self.target.smooth_normals(at.facet, at.xi, nodes)
        return _unless_kinked(slave, own), _unless_kinked(master, other)

    def slave_area_ratio(self, displacement: Floats) -> Floats:
        """Area ratio da/dA (q,) of the slave surface from nodal displacements (q, a, i).

        The current tangents t_α = T_α + ∂u/∂T_α span the area |t_1| or |t_1 × t_2|; a ring also
        grows by r/R.
        """
        ratio: Floats = _measure(self.slave_tangents(displacement))
        if self.axisymmetric:
            ratio *= self.slave_positions(displacement)[:, 0] / self.slave.position[:, 0]
        return ratio


def _unless_kinked(smooth: Floats, own: Floats) -> Floats:
    """Unit normals (q, i) of a smooth surface through facets; at kinks the facets' own."""
    length = np.linalg.norm(smooth, axis=1)
    near = np.einsum("qi,qi->q", smooth, own) > ROUND * length
    out: Floats = np.where(near[:, None], smooth / np.where(near, length, 1.0)[:, None], own)
    return out


def _measure(tangents: Floats) -> Floats:
    """Length (q,) of one tangent, or area of the parallelogram of two, (q, α, i)."""
    if tangents.shape[1] == 1:
        out: Floats = np.linalg.norm(tangents[:, 0], axis=1)
        return out
    (x, y, z), (u, v, w) = tangents.transpose(1, 2, 0)
    area: Floats = np.sqrt((y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2)
    return area


def _master_and_target(
    space: dolfinx.fem.FunctionSpace,
    shape: FacetShape,
    master: NDArray[np.int32] | RigidMaster,
    smoothing_angle: float | None,
    fade_length: float | None,
) -> tuple[MasterFacets | RigidMaster, Target]:
    """The master, and the search for the closest point on it; collective."""
    if not isinstance(master, RigidMaster):
        facets = _master_facets(space, shape, master)
        ends = smoothing_angle, fade_length
        return facets, FacetSurface(shape, facets.facets, facets.position, *ends)
    dim = space.mesh.geometry.dim
    if master.surface.dim != dim:
        raise ValueError(f"a rigid surface in {master.surface.dim} dimensions, a slave in {dim}")
    return master, master.surface


def _master_facets(
    space: dolfinx.fem.FunctionSpace, shape: FacetShape, facets: NDArray[np.int32]
) -> MasterFacets:
    mesh = space.mesh
    require_facets(mesh, facets, "master")
    local, position = outward_facets(space, shape, owned_facets(mesh, facets))
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
