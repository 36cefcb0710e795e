r"""The master's facets: the whole surface, or what lies within reach of a rank's slave points.

In the plane a surface is a line, and every rank has all of it; so has the only rank there is. On
several ranks in space each keeps its own facets (those of its cells, :class:`MasterSource`) and
knows those within reach of its slave points, from whichever rank. When something has moved so far
that another facet may be the closest, all ranks look again, and take what is new behind what they
know, so that numbers of facets and nodes stay valid.

Each rank tells the others the boxes round some groups of its points. A box b has a closest facet no
farther away than any node y of the surface from its farthest point, so that every facet f counts
that is nearer than

.. math:: \min_y \max_{x \in b} |x - y| + m, \qquad m = 2 s + h,

with the largest facet h and the way s that slave and master may move against each other: of the
neighbours of what can be the closest facet until then none is missing, for what is left out is by
m - s farther away than the closest was, which is by s farther away at most.

Axis letters: f facets, g this rank's own facets, a nodes of a facet, s its sides, v its corners, n
nodes, b boxes, q slave points, i space.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from tribox.geometry.surfaces.body_facets import outward_facets, owned_facets, require_facets
from tribox.geometry.surfaces.facets import Bools, FacetShape, Floats, Ints, Longs, order_by_place
from tribox.geometry.surfaces.images import (
    Held,
    Images,
    held_along,
    images_beyond,
    planes_of_symmetry,
)
from tribox.geometry.surfaces.projection import FacetSurface, SurfacePart
from tribox.geometry.surfaces.smoothing import on_axis

BOXES = 32  # round the slave points of a rank, at most
REACH = 1.5  # way before facets are looked for again, over the length of a facet
BULGE = 2.0  # of a smooth patch over that of its facet, and of its nodes' shares


@dataclass(slots=True)
class MasterFacets:
    """Master facets that this rank knows."""

    nodes: Longs  # (n,) global node (displacement block) numbers
    facets: Ints  # (f, a) rows into ``nodes``, ordered so that the normal points out of the body
    position: Floats  # (n, i), m, reference
    shape: FacetShape  # of all facets
    extent: float  # m, the largest of the whole surface along an axis
    # what else is known of facets that are not all of them; None: they are
    part: SurfacePart | None = None
    # what continues a smooth surface beyond planes of symmetry: theirs are the last of the nodes,
    # each with the number of the node that it is the image of
    images: Images | None = None
    # of symmetry that the slave ends at too, each with the nodes (n,) on it
    planes: Sequence[tuple[int, Bools]] = ()

    @property
    def number(self) -> Longs:
        """Numbers (f,) on the whole surface, in an order that no partition changes."""
        return np.arange(len(self.facets)) if self.part is None else self.part.number

    def sizes(self) -> Floats:
        """Length (f,), m, of each undeformed facet; in space the side of a square or half one."""
        return self._corners_apart().max(axis=(1, 2)) / np.sqrt(self.shape.directions)

    def widths(self) -> Floats:
        """Shortest side (f,), m, of each undeformed facet."""
        apart = self._corners_apart()
        return np.where(apart > 0.0, apart, np.inf).min(axis=(1, 2))

    def own(self) -> MasterFacets:
        """The same without images and planes of symmetry."""
        if self.images is None:
            return replace(self, planes=())
        own = len(self.nodes) - len(self.images.of)
        nodes, position = self.nodes[:own], self.position[:own]
        return replace(self, nodes=nodes, position=position, images=None, planes=())

    def _corners_apart(self) -> Floats:
        """Distances (f, c, c), m, of the corners of each undeformed facet."""
        corners = self.position[self.facets[:, : self.shape.corners]]
        return np.linalg.norm(corners[:, :, None] - corners[:, None], axis=3)


@dataclass(frozen=True, slots=True)
class FacetRows:
    """Facets as ranks send them."""

    nodes: Longs  # (f, a) global
    position: Floats  # (f, a, i), m, reference
    part: SurfacePart  # what else is known of them

    def of(self, take: Longs) -> FacetRows:
        """The same of the facets ``take``."""
        return FacetRows(self.nodes[take], self.position[take], self.part.of(take))

    @classmethod
    def joined(cls, rows: Sequence[FacetRows]) -> FacetRows:
        """All of some."""
        nodes = np.concatenate([one.nodes for one in rows])
        position = np.concatenate([one.position for one in rows])
        return cls(nodes, position, SurfacePart.joined([one.part for one in rows]))


def own_facets(
    space: dolfinx.fem.FunctionSpace, shape: FacetShape, facets: NDArray[np.int32]
) -> tuple[Longs, Floats]:
    """Global nodes (g, a) and places (g, a, i), m, of this rank's master facets; collective."""
    require_facets(space.mesh, facets, "master")
    local, position = outward_facets(space, shape, owned_facets(space.mesh, facets))
    nodes = space.dofmap.index_map.local_to_global(local.reshape(-1).astype(np.int32))
    return nodes.reshape(local.shape).astype(np.int64), position


def continued(
    master: MasterFacets, held: Held | None, smoothing_angle: float | None, rings: bool = False
) -> MasterFacets:
    """A surface with its planes of symmetry, and its images beyond them if it is to be smooth.

    Args:
        held: nodes of the mesh that stay where they are along axes; None: not known.
        smoothing_angle: rad, from which on an angle is sharp; None: the facets are as they are.
        rings: whether it is one of rings: their axis is no plane of symmetry.
    """
    if held is None or not len(master.facets):
        return master
    here, position = held_along(held.nodes, master.nodes), master.position
    whole = None if master.part is None else master.part.is_open, master.extent
    known = master.shape, master.facets, position
    planes = planes_of_symmetry(*known, here, None, *whole)
    master = replace(master, planes=held.shared(planes, position, master.extent))
    smooth = master.shape.degree == 1 and master.shape.cell != "triangle"
    if smoothing_angle is None or not smooth:
        return master
    if rings:
        here[on_axis(position), 0] = False
    images = images_beyond(*known, here, smoothing_angle, *whole)
    none: Bools = np.zeros(len(images.of), dtype=bool)
    return replace(
        master,
        nodes=np.concatenate([master.nodes, master.nodes[images.of]]),
        position=np.concatenate([position, images.position]),
        images=images,
        planes=[(axis, np.append(on, none)) for axis, on in master.planes],
    )


def whole_master(
    shape: FacetShape, gathered: Sequence[tuple[Longs, Floats]]
) -> tuple[MasterFacets, Longs]:
    """The whole surface from all ranks' own facets, and which of these each of its facets is."""
    nodes = np.concatenate([g for g, _ in gathered])
    where = np.concatenate([p for _, p in gathered])
    order = order_by_place(where[:, : shape.corners].mean(axis=1))
    nodes, where = nodes[order], where[order]
    unique, first, inverse = np.unique(nodes.reshape(-1), return_index=True, return_inverse=True)
    position = where.reshape(-1, where.shape[-1])[first]
    whole = MasterFacets(
        nodes=unique.astype(np.int64),
        facets=inverse.reshape(nodes.shape).astype(np.int32),
        position=position,
        shape=shape,
        extent=float(np.ptp(position, axis=0).max()),
    )
    return whole, order


class MasterSource:
    """This rank's own facets of a master, and which of them, and of others, are within reach.

    ``ends``: smoothing angle and length of fading; ``extent``: m, the largest of all along an axis.
    """

    def __init__(
        self,
        space: dolfinx.fem.FunctionSpace,
        shape: FacetShape,
        own: tuple[Longs, Floats],
        ends: tuple[float | None, float | None],
        slave_length: float,
        held: Held | None = None,
    ) -> None:
        """Look at the surface as a whole, on the rank that has read the mesh; collective.

        ``own``: of :func:`own_facets`; ``ends``: smoothing angle and fading, see ``FacetSurface``,
        whose ValueError comes on every rank; ``slave_length``: m, mean; ``held``: nodes along axes.
        """
        self.comm, self._space, self._shape, self.ends = space.mesh.comm, space, shape, ends
        self.held = held
        part, self.extent, self._anywhere = self._survey(own)
        self.own = FacetRows(*own, part)
        bulge = BULGE if ends[0] is not None else 1.0
        self._size, self._share = bulge * shape.lebesgue, bulge * shape.lebesgue
        radius = self._spheres(own[1])[1]
        largest, total, count = radius.max(initial=0.0), radius.sum(), len(radius)
        largest = self.comm.allreduce(float(largest), op=MPI.MAX)
        total, count = self.comm.allreduce(np.array([total, count]))
        self._reach = REACH * max(2.0 * float(total / count), slave_length)
        # m = 2 s + h with h the diameter of the largest sphere and a fifth, as facets stretch.
        self._margin = 2.0 * self._reach + 2.4 * largest
        # Owned local nodes that are the master's, whichever rank has the facet; collective.
        index = self._space.dofmap.index_map
        marks = dolfinx.la.vector(index, 1, dtype=np.float64)
        marks.array[index.global_to_local(np.unique(self.own.nodes))] = 1.0
        marks.scatter_reverse(dolfinx.la.InsertMode.add)
        self._mine = np.nonzero(marks.array[: index.size_local] > 0.0)[0]
        self._at: tuple[Floats, Floats] | None = None  # displacements when facets were fetched

    def _survey(self, own: tuple[Longs, Floats]) -> tuple[SurfacePart, float, Floats]:
        """What the facets are on the whole surface, its extent, and a place on it; collective."""
        comm, parts, problem = self.comm, None, None
        about: tuple[float, Floats] = (0.0, np.empty((0, 3)))
        if (gathered := comm.gather(own)) is not None:
            whole, order = whole_master(self._shape, gathered)
            try:
                planes = continued(whole, self.held, None).planes
                facets = whole.facets, whole.position
                surface = FacetSurface(self._shape, *facets, *self.ends, planes=planes)
            except ValueError as error:
                problem = str(error)
            else:
                part = surface.part().of(np.argsort(order))  # as the ranks have them
                bounds = np.cumsum([0, *(len(nodes) for nodes, _ in gathered)])
                parts = [part.of(np.arange(*ends)) for ends in itertools.pairwise(bounds)]
                about = (whole.extent, whole.position[:1])
        if (problem := comm.bcast(problem)) is not None:
            raise ValueError(problem)
        mine: SurfacePart = comm.scatter(parts)
        return mine, *comm.bcast(about)

    def _spheres(self, facets: Floats) -> tuple[Floats, Floats]:
        """Centres (g, i) and radii (g,), m, of spheres that hold facets (g, a, i)."""
        centre = facets.mean(axis=1)
        reach = np.linalg.norm(facets - centre[:, None], axis=2).max(axis=1, initial=0.0)
        return centre, self._size * reach

    def has_moved(self, x: PETSc.Vec, slave: Floats) -> bool:
        """Whether facets that are not known may have become the closest; collective.

        By displacements x (global) and of the slave's nodes (n, i), m.
        """
        assert self._at is not None
        master = x.array_r.reshape(-1, slave.shape[1])[self._mine]
        changes = [now - then for now, then in zip((slave, master), self._at, strict=True)]
        ends = np.full((2, 2, slave.shape[1]), -np.inf)
        for end, change in zip(ends, changes, strict=True):
            if len(change):
                end[:] = change.max(axis=0), -change.min(axis=0)
        self.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        # Per axis the ranges of displacements of slave and master, each a middle and a half: what
        # the middles move against each other, and both halves, bounds the way of any two points. A
        # common motion of both costs nothing.
        middle = 0.5 * (ends[:, 0] - ends[:, 1])
        half = 0.5 * (ends[:, 0] + ends[:, 1]) * self._share
        moved = float(np.linalg.norm(np.abs(middle[0] - middle[1]) + half.sum(axis=0)))
        return moved > self._reach

    def fetch(
        self, points: Floats, slave: Floats, known: Longs, x: PETSc.Vec | None = None
    ) -> FacetRows:
        """Facets within reach that are not ``known`` (f,), by number; collective.

        Of slave points (q, i) and displacements (n, i), m; x: global, m, None: undeformed.
        """
        place, owned = self.own.position, np.zeros((len(self._mine), points.shape[1]))
        if x is not None:
            owned = x.array_r.reshape(-1, points.shape[1])[self._mine].copy()
            place = place + self._displacements(x)
        self._at = slave.copy(), owned
        # Who has no points knows some facets all the same, so that nothing is empty.
        boxes = self.comm.allgather(_boxes(points if len(points) else self._anywhere))
        found = self._sent([self.own.of(take) for take in self._within(boxes, place)], known)
        return found.of(np.argsort(found.part.number))

    def numbered(self, wanted: Longs, known: Longs) -> FacetRows:
        """Facets with the numbers ``wanted``, in their order, that are not known; collective."""
        asked = self.comm.allgather(np.setdiff1d(wanted, known))
        takes = [np.nonzero(np.isin(self.own.part.number, numbers))[0] for numbers in asked]
        found = self._sent([self.own.of(take) for take in takes], known)
        place = {int(number): row for row, number in enumerate(found.part.number)}
        order = [place[n] for n in dict.fromkeys(map(int, wanted)) if n in place]
        return found.of(np.array(order, dtype=np.int64))

    def _sent(self, rows: Sequence[FacetRows], known: Longs) -> FacetRows:
        """What all ranks send to this one, without what it knows; collective."""
        got = FacetRows.joined(self.comm.alltoall(rows))
        return got.of(np.nonzero(~np.isin(got.part.number, known))[0])

    def _displacements(self, x: PETSc.Vec) -> Floats:
        """Of the own facets' nodes (g, a, i), m, whoever owns these; collective."""
        nodes, inverse = np.unique(self.own.nodes, return_inverse=True)
        dim = self._space.dofmap.index_map_bs
        scatter, here = node_scatter(x, nodes, dim)
        scatter.scatter(x, here, addv=False, mode=False)
        out: Floats = here.array_r.reshape(-1, dim)[inverse.reshape(self.own.nodes.shape)]
        for part in (here, scatter):
            part.destroy()
        return out

    def _within(self, boxes: Sequence[Floats], place: Floats) -> list[Longs]:
        """Rows of the own facets at ``place`` (g, a, i), m, that each rank wants; collective."""
        centre, radius = self._spheres(place)
        corner = place[:, 0]
        most = [np.full(len(box), np.inf) for box in boxes]
        least = []
        for upper, box in zip(most, boxes, strict=True):
            low, high = box[:, :1], box[:, 1:]
            far = np.maximum(np.abs(corner - low), np.abs(high - corner))
            upper[:] = np.linalg.norm(far, axis=2).min(axis=1, initial=np.inf)
            # Distance of a sphere from a box, 0 where its centre is inside, less the radius: a
            # lower bound.
            outside: Floats = np.maximum(low - centre, centre - high)
            near: Floats = np.maximum(outside, 0.0)
            least.append(np.linalg.norm(near, axis=2) - radius)
        every = np.concatenate(most)
        self.comm.Allreduce(MPI.IN_PLACE, every, op=MPI.MIN)
        bounds = np.split(every, np.cumsum([len(box) for box in boxes])[:-1])
        return [
            np.nonzero((below <= bound[:, None] + self._margin).any(axis=0))[0]
            for below, bound in zip(least, bounds, strict=True)
        ]


def node_scatter(x: PETSc.Vec, nodes: Longs, dim: int) -> tuple[PETSc.Scatter, PETSc.Vec]:
    """What takes values at global nodes (n,) of a vector to this rank, and where; collective."""
    index = PETSc.IS().createBlock(dim, nodes.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
    here = PETSc.Vec().createSeq(dim * len(nodes))
    scatter = PETSc.Scatter().create(x, index, here, None)
    index.destroy()
    return scatter, here


def _boxes(points: Floats) -> Floats:
    """Lower and upper corners (b, 2, i), m, of boxes round groups of points (q, i), m."""
    groups = [_boxed(points)] if len(points) else []
    while groups and len(groups) < BOXES:
        size, box, group = max(groups, key=lambda one: one[0])
        if len(group) == 1 or size == 0.0:
            break
        groups = [one for one in groups if one[2] is not group]
        order = np.argsort(group[:, int(np.argmax(box[1] - box[0]))], kind="stable")
        # Halves across the longest side: boxes close round the points keep the bounds sharp.
        groups += map(_boxed, np.array_split(group[order], 2))
    boxes = [box for _, box, _ in groups]
    return np.stack(boxes) if boxes else np.empty((0, 2, points.shape[1]))


def _boxed(points: Floats) -> tuple[float, Floats, Floats]:
    """Longest side, m, and corners (2, i), m, of the box round points (q, i), m, and these."""
    box = np.stack([points.min(axis=0), points.max(axis=0)])
    return float((box[1] - box[0]).max()), box, points


def grown(master: MasterFacets, rows: FacetRows) -> MasterFacets:
    """The facets with more behind them."""
    flat = rows.nodes.reshape(-1)
    every = np.concatenate([master.nodes, flat])
    where = np.concatenate([master.position, rows.position.reshape(len(flat), -1)])
    _, first, inverse = np.unique(every, return_index=True, return_inverse=True)
    kept = np.sort(first)  # by first appearance: known nodes keep their rows
    facets = np.searchsorted(kept, first[inverse.reshape(-1)[len(master.nodes) :]])
    more = facets.reshape(rows.nodes.shape).astype(np.int32)
    return replace(
        master,
        nodes=every[kept],
        facets=np.concatenate([master.facets, more]),
        position=where[kept],
        part=rows.part if master.part is None else SurfacePart.joined([master.part, rows.part]),
    )


def no_facets(shape: FacetShape, extent: float) -> MasterFacets:
    """None of a surface yet."""
    facets, place = np.empty((0, shape.count), dtype=np.int32), np.empty((0, 3))
    none: Longs = np.empty(0, dtype=np.int64)
    return MasterFacets(none, facets, place, shape, extent)
