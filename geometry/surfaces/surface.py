"""A contact pair's surfaces: quadrature points on the slave side, facets on the master side.

Displacements of the slave's nodes and of the master's that a rank knows
(:mod:`tribox.geometry.surfaces.master`) come by a single PETSc scatter per evaluation, so the mesh
may be partitioned anywhere.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.geometry.surfaces.body_facets import displacement_facet, outward_facets
from tribox.geometry.surfaces.facets import Floats, Ints, Longs, measure, unit_normals
from tribox.geometry.surfaces.images import Held, Images
from tribox.geometry.surfaces.master import (
    FacetRows,
    MasterFacets,
    MasterSource,
    continued,
    grown,
    no_facets,
    node_scatter,
    own_facets,
    whole_master,
)
from tribox.geometry.surfaces.projection import FacetSurface, Projection
from tribox.geometry.surfaces.rigid import RigidMotion, RigidSurface
from tribox.geometry.surfaces.slave_points import (
    PointNormals,
    SlaveNormals,
    slave_points,
    slave_vertices,
)

# Default degree of the quadrature on slave facets, by the dimension of space.
QUADRATURE_DEGREE = {2: 9, 3: 5}
ROUND = np.cos(np.radians(10.0))  # between a facet's normal and that of a round surface there


@dataclass(slots=True)
class RigidMaster:
    """A rigid surface as master, the same on every rank."""

    # (2,) global nodes (displacement blocks) that move it: reference nodes, as in
    # :class:`~tribox.geometry.surfaces.rigid.RigidMotion`
    nodes: Longs
    surface: RigidSurface  # of the tool
    motion: RigidMotion  # of its control points

    @property
    def position(self) -> Floats:
        """Control points (a, i), m, reference."""
        return self.surface.control_points


class ContactSurface:
    """Slave points and master facets of one pair, and the current positions of both.

    Attributes:
        slave: points; vertices: of the slave facets.
        master: facets that this rank knows, or a rigid surface; own_master: (g, a) global nodes of
            the facets of its cells, of a rigid surface those that move it.
        target: search for the closest point on the master; parts: how often it has become larger.
        follows: whether more of the master is fetched when it comes within reach.
        facet_length: m, mean length of the slave facets, in space by their areas as at a point.
        nodes: (m,) global nodes of the pair: those of this rank's slave facets, then the known ones
            of the master from row ``first_master`` on; slave_rows: (q, a) rows of points' nodes.
        normals: of the slave, for the kinks of a master in the plane; None without kinks.
            chain_rows: (q, s) rows of the vertices that they take.
    """

    master: MasterFacets | RigidMaster
    target: FacetSurface | RigidSurface

    def __init__(
        self,
        space: dolfinx.fem.FunctionSpace,
        slave_facets: NDArray[np.int32],
        master: NDArray[np.int32] | RigidMaster,
        quadrature_degree: int,
        axisymmetric: bool = False,
        smoothing_angle: float | None = None,
        fade_length: float | None = None,
        held: Sequence[Longs] = (),
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
            held: by axis, global nodes of all ranks that stay where they are along it: a surface
                that ends at some in a plane goes on as its image.

        Raises:
            ValueError: on every rank, if a surface has no facet or folds onto itself, the degree of
                the displacement is another, or the master cannot be smooth or has another dim.
        """
        self.space = space
        self.dim = space.mesh.geometry.dim
        self.axisymmetric = axisymmetric
        self.shape = displacement_facet(space)
        self.slave = slave_points(space, self.shape, slave_facets, quadrature_degree)
        self.facet_length = _mean(self.slave.facet_length, space.mesh.comm)
        if axisymmetric:
            # Whole rings: forces are totals and not per radian.
            self.slave.weight = 2.0 * np.pi * self.slave.position[:, 0] * self.slave.weight
        slave = self.slave
        known = slave.nodes, slave.xi, slave.weight, slave.facet_length
        self.vertices = slave_vertices(space, self.shape, *known)
        nodes, place = self.vertices.nodes, self.vertices.position
        levels = [place[np.isin(nodes, those), axis] for axis, those in enumerate(held)]
        planes = Held(held, levels) if held else None
        self._find_master(master, (smoothing_angle, fade_length), planes)
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
            slave_facets: local facets (owned and ghosts) of the slave surface.
            reference_nodes: (2,) global numbers of the nodes that hold its motion.
            motion: of the surface's control points.
            quadrature_degree: degree integrated exactly on an affine slave facet.
            axisymmetric: whether x is the distance from an axis of symmetry.
        """
        master = RigidMaster(np.asarray(reference_nodes, dtype=np.int64), surface, motion)
        return cls(space, slave_facets, master, quadrature_degree, axisymmetric)

    def _find_master(
        self,
        master: NDArray[np.int32] | RigidMaster,
        ends: tuple[float | None, float | None],
        held: Held | None,
    ) -> None:
        """Find the master, on several ranks in space what is within reach of it; collective."""
        self.follows, self.parts = True, 0
        self._source: MasterSource | None = None  # None: the whole master is known
        self.first_master = 0
        self.nodes: Longs = np.empty(0, dtype=np.int64)
        self.own_master: Longs
        if isinstance(master, RigidMaster):
            if master.surface.dim != self.dim:
                raise ValueError(
                    f"a rigid surface in {master.surface.dim} dimensions, a slave in {self.dim}"
                )
            self.master, self.target, self.own_master = master, master.surface, master.nodes
            return
        comm, own = self.space.mesh.comm, own_facets(self.space, self.shape, master)
        self.own_master = own[0]
        if self.dim == 2 or comm.size == 1:
            rings, whole = self.axisymmetric, whole_master(self.shape, comm.allgather(own))[0]
            self.master = continued(whole, held, ends[0], rings)
            self.target = self._searched(self.master, ends, rings)
            return
        known = self.space, self.shape, own, ends, self.facet_length, held
        self._source = MasterSource(*known)
        self.master = no_facets(self.shape, self._source.extent)
        still = np.zeros((len(np.unique(self.slave.nodes)), self.dim))
        self._take(self._source.fetch(self.slave.position, still, self.master.number))

    def for_others(self, facets: Ints, master: Ints) -> ContactSurface:
        """The same master for points of other local facets, with ghosts; collective.

        ``master``: those of the master, if it has any.
        """
        if (source := self._source) is None:
            other = copy.copy(self)
            other.target = self.target.for_others()
            return other
        held = () if source.held is None else source.held.nodes
        return ContactSurface(self.space, facets, master, 1, False, *source.ends, held)

    def _searched(
        self, master: MasterFacets, ends: tuple[float | None, float | None], rings: bool = False
    ) -> FacetSurface:
        """The facets of a master, to search; ``ends`` and ``rings`` as ``FacetSurface`` takes."""
        facets, known = (master.facets, master.position), (master.part, master.images)
        return FacetSurface(self.shape, *facets, *ends, *known, rings, master.planes)

    def _take(self, rows: FacetRows) -> None:
        """Know more facets."""
        assert isinstance(self.master, MasterFacets) and self._source is not None
        if self.parts and not len(rows.nodes):
            return
        ends, more = self._source.ends, grown(self.master.own(), rows)
        self.master = master = continued(more, self._source.held, ends[0])
        searches = self.target.search.searches if self.parts else 0
        target = self._searched(master, ends)
        target.search.searches, self.target = searches, target
        self.nodes = np.concatenate([self.nodes[: self.first_master], master.nodes])
        self.parts += 1

    def follow(self, x: PETSc.Vec, values: Floats) -> bool:
        """Fetch more of the master, once facets may be closer; whether it was done; collective.

        At x (global) and displacements (m, i), m, of the pair's ``nodes`` in it.
        """
        slave = values[: self.first_master]
        if self._source is None or not self.follows or not self._source.has_moved(x, slave):
            return False
        assert isinstance(self.master, MasterFacets)
        points = self.slave_positions(values[self.slave_rows])
        self._take(self._source.fetch(points, slave, self.master.number, x))
        self._scatter = None
        return True

    def numbers(self, facet: Ints) -> Ints:
        """Numbers (q,) of facets on the whole master, which mean the same on any ranks."""
        if self._source is None or not isinstance(self.master, MasterFacets):
            return facet
        return self.master.number[facet].astype(np.int32)

    def know(self, numbers: Ints) -> None:
        """Know the facets with these numbers on the whole master; collective."""
        if self._source is None:
            return
        assert isinstance(self.master, MasterFacets)
        self._take(self._source.numbered(numbers.astype(np.int64), self.master.number))
        self._scatter = None

    def numbered(self, numbers: Ints) -> Ints:
        """Facets (q,) of :meth:`numbers`, which this rank then knows; collective."""
        self.know(numbers)
        if self._source is None or not isinstance(self.master, MasterFacets):
            return numbers
        order = np.argsort(self.master.number)
        place = np.searchsorted(self.master.number, numbers, sorter=order)
        return order[place].astype(np.int32)

    def _number_nodes(self) -> None:
        """Number the nodes of the pair, and find those of each point."""
        chain: Longs = np.empty((0, 4), dtype=np.int64)
        if self.normals is not None:
            chain = self.vertices.nodes[self.normals.around]
        needed: Longs = np.unique(np.concatenate([self.slave.nodes.ravel(), chain.ravel()]))
        self.slave_rows: Longs = np.searchsorted(needed, self.slave.nodes)
        self.chain_rows: Longs = np.searchsorted(needed, chain)
        self.first_master = len(needed)
        self.nodes = np.concatenate([needed, self.master.nodes])

    @property
    def images(self) -> Images | None:
        """What continues a smooth master beyond planes of symmetry; None: nothing does.

        Its nodes are the last of the pair's, with the global numbers of those that they are of.
        """
        images = self.master.images if isinstance(self.master, MasterFacets) else None
        return images if images is not None and len(images.of) else None

    @property
    def signs(self) -> Floats | None:
        """Signs (m, i) of displacements and forces of the pair's nodes over the global ones'."""
        if self.images is None:
            return None
        out = np.ones((len(self.nodes), self.dim))
        out[-len(self.images.of) :] = self.images.signs
        return out

    def _find_normals(self) -> SlaveNormals:
        """Normals of a slave in the plane; collective."""
        local = outward_facets(self.space, self.shape, self.slave.mesh_facet)[0]
        first = self.space.dofmap.index_map.local_to_global(local[:, 0].astype(np.int32))
        return SlaveNormals(self.vertices, first != self.slave.nodes[:, 0])

    def gather(self, x: PETSc.Vec) -> Floats:
        """Displacements (m, i), m, of the pair's ``nodes``, from a global vector; collective."""
        values = self.at_nodes(x)
        return self.at_nodes(x) if self.follow(x, values) else values

    def at_nodes(self, x: PETSc.Vec) -> Floats:
        """The same of any vector, of changes for example; where bodies are stays as it was."""
        if self._scatter is None:
            self._scatter, self._here = node_scatter(x, self.nodes, self.dim)
        self._scatter.scatter(x, self._here, addv=False, mode=False)
        values: Floats = np.array(self._here.array_r).reshape(-1, self.dim)
        signs = self.signs
        return values if signs is None else signs * values

    def master_positions(self, values: Floats) -> Floats:
        """Positions (n, i), m, of what moves the master, no images, from displacements (m, i)."""
        master, moved = self.master, values[self.first_master :]
        if isinstance(master, RigidMaster):
            return master.motion.control_points(*master.motion.read(moved))
        own = len(master.nodes) if self.images is None else -len(self.images.of)
        return (master.position + moved)[:own]

    def project(
        self,
        points: Floats,
        nodes: Floats,
        frozen_facets: Ints | None = None,
        rays: PointNormals | None = None,
        fading: bool = False,
    ) -> Projection:
        """Closest points on the master, on its :meth:`master_positions`, of the points (q, i), m.

        ``frozen_facets``: (q,) that are not left at once; ``rays``: normals to project along, or
        None; ``fading``: whether points leave the master's end bit by bit.
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
        each other. ``at``: points (q,) on the master, moved by ``nodes`` (n, i), m;
        ``slave_tangents``: (q, α, i).
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

    def slave_area_ratio(self, tangents: Floats, points: Floats) -> Floats:
        """Area ratio da/dA (q,) of the slave surface from current tangents and points (q, i), m.

        The tangents t_α = T_α + ∂u/∂T_α (q, α, i) span the area |t_1| or |t_1 × t_2|; a ring also
        grows by r/R.
        """
        ratio: Floats = measure(tangents)
        if self.axisymmetric:
            # The hoop stretch r/R.
            ratio *= points[:, 0] / self.slave.position[:, 0]
        return ratio


def _mean(values: Floats, comm: MPI.Comm) -> float:
    """Mean of positive values of points (q,) of all ranks; collective.

    In whole numbers of a small unit, neither rounding of the values nor how points are shared out
    changes their sum: defaults that follow from the mean are compared when a run goes on.
    """
    largest = comm.allreduce(float(values.max(initial=0.0)), op=MPI.MAX)
    unit = 2.0 ** (math.frexp(largest)[1] - 40)
    parts = np.rint(values / unit).astype(np.int64)
    total, count = comm.allreduce(np.array([parts.sum(), len(parts)]))
    return float(unit * (int(total) / int(count)))


def _unless_kinked(smooth: Floats, own: Floats) -> Floats:
    """Unit normals (q, i) of a smooth surface through facets; at kinks the facets' own."""
    length = np.linalg.norm(smooth, axis=1)
    near = np.einsum("qi,qi->q", smooth, own) > ROUND * length
    return np.where(near[:, None], smooth / np.where(near, length, 1.0)[:, None], own)


# -- Values at the nodes of a contact pair, fetched from and returned to whichever rank owns them --


class NodalVector:
    """A vector of unknowns that numpy, DOLFINx and PETSc share in memory.

    Attributes:
        array: local unknowns, those of ghosts last; owned: the part that this rank owns.
        vec: the owned part, as a global vector.
    """

    def __init__(
        self, space: dolfinx.fem.FunctionSpace, shared: dolfinx.la.Vector | None = None
    ) -> None:
        """Make a vector of zeros, or wrap an existing one; collective."""
        index, dim = space.dofmap.index_map, space.dofmap.index_map_bs
        self._la = dolfinx.la.vector(index, dim) if shared is None else shared
        self.array: Floats = self._la.array
        self.owned = self.array[: index.size_local * dim]
        comm = space.mesh.comm
        self.vec = PETSc.Vec().createWithArray(
            self.owned, size=(len(self.owned), None), bsize=dim, comm=comm
        )
        self._alone = comm.size == 1

    def update_ghosts(self) -> None:
        """Bring the ghosts up to date; collective."""
        if not self._alone:
            self._la.scatter_forward()

    def collect_ghosts(self) -> None:
        """Add what this rank put on ghosts to the owners' values; collective."""
        if not self._alone:
            self._la.scatter_reverse(dolfinx.la.InsertMode.add)


class SurfaceExchange:
    """Moves nodal values between the bodies and one contact pair's ``nodes`` (m,), global.

    These are of the slave's facets of this rank, ``slave_rows`` (q, a), then, from
    ``first_master``, all master nodes.
    """

    def __init__(self, surface: ContactSurface) -> None:
        self.nodes, self.slave_rows = surface.nodes, surface.slave_rows
        self.signs, self._images = surface.signs, surface.images
        self._own = len(surface.nodes) - (0 if self._images is None else len(self._images.of))
        self.first_master = surface.first_master
        self.dim = surface.dim
        self._alone = surface.space.mesh.comm.size == 1
        self._scatter: PETSc.Scatter | None = None
        self._here: PETSc.Vec | None = None

    def gather(self, vector: NodalVector, out: Floats) -> None:
        """Put the values at the nodes into ``out`` (m, i); collective."""
        if self._alone:
            values = vector.owned.reshape(-1, self.dim)
            # In its mode "raise" numpy buffers `out`; numbers are within bounds here.
            np.take(values, self.nodes, axis=0, out=out, mode="clip")
        else:
            scatter, here = self._set_up(vector)
            scatter.scatter(vector.vec, here, addv=False, mode=PETSc.ScatterMode.FORWARD)
            out[:] = here.array_r.reshape(out.shape)
        if self.signs is not None:
            out *= self.signs

    def add(self, values: Floats, vector: NodalVector, sizes: bool = False) -> None:
        """Add ``values`` (m, i) at the nodes to ``vector``, those of all ranks; collective.

        Those of images are taken to the nodes that they are of, in place; ``sizes`` have no signs.
        """
        if self._images is not None:
            self._images.give_back(values, self.first_master, sizes)
        if self._alone:
            vector.owned.reshape(-1, self.dim)[self.nodes[: self._own]] += values[: self._own]
            return
        scatter, here = self._set_up(vector)
        here.array[:] = values.reshape(-1)
        scatter.scatter(here, vector.vec, addv=True, mode=PETSc.ScatterMode.REVERSE)

    def _set_up(self, vector: NodalVector) -> tuple[PETSc.Scatter, PETSc.Vec]:
        if self._scatter is None or self._here is None:
            self._scatter, self._here = node_scatter(vector.vec, self.nodes, self.dim)
        return self._scatter, self._here


def facet_turns(target: FacetSurface | RigidSurface, nodes: Floats) -> tuple[Floats, Floats, Longs]:
    """Lengths (f,), m, of a master's facets in the plane, and how they turn at their ends.

    By angles (f, 2), rad, to the left, from what is before a facet and to what is behind it (at
    planes of symmetry its image), 0 at ends; and the facets (f, 2) that are there. ``nodes``: (n,
    i), m.
    """
    near = target.neighbours.tocoo()
    facet, other = (index[near.row != near.col] for index in (near.row, near.col))
    count = near.shape[0]
    every = np.arange(count, dtype=np.int32)
    # Places and directions (e, f, i) of both ends.
    ends = [target.places(every, np.full((count, 1), xi), nodes) for xi in (0.0, 1.0)]
    place = np.stack([at for at, _ in ends])
    way = np.stack([tangent[:, 0] for _, tangent in ends])
    length = np.linalg.norm(way, axis=2).mean(axis=0)
    turn, beside = np.zeros((count, 2)), np.repeat(every[:, None], 2, axis=1).astype(np.int64)
    for end in (0, 1):
        for begin in (0, 1):
            apart = np.linalg.norm(place[end, facet] - place[begin, other], axis=1)
            meet = apart <= 1e-6 * length[facet]
            one, two = facet[meet], other[meet]
            a, b = way[end, one], way[begin, two] * (1.0 if end != begin else -1.0)
            if end == 0:
                a, b = b, a
            turn[one, end] = _turned(a, b)
            beside[one, end] = two
    if isinstance(target, FacetSurface):
        for axis, on in target.ends.planes:
            at, last = np.nonzero(on[target.facets[:, :2]])
            mine = way[last, at]
            image = np.where(np.arange(mine.shape[1]) == axis, mine, -mine)
            turn[at, last] = _turned(mine, image) * np.where(last == 0, -1.0, 1.0)
    return length, turn, beside


def _turned(a: Floats, b: Floats) -> Floats:
    """Angles (p,), rad, from directions (p, i) in the plane to others, to the left."""
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return np.arctan2(cross, np.einsum("pi,pi->p", a, b))
