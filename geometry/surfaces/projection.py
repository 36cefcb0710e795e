"""A surface of facets: which facets are neighbours, and the closest point of every slave point.

Notation (axis letters): q slave points, f facets, n nodes, a nodes of a facet, v corners, i, j
space, α, β surface directions (one in the plane, two in space). The outward normal is the tangent
τ turned left by 90° in the plane, and τ_1 × τ_2 in space, given by the order of a
facet's nodes.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.compiled_facets import CORNER, INTERIOR, Candidates, CompiledFacets
from tribox.geometry.surfaces.ends import SurfaceEnds
from tribox.geometry.surfaces.facet_search import TIE, FacetSearch, RaySearch
from tribox.geometry.surfaces.facets import (
    Bools,
    FacetShape,
    Floats,
    Ints,
    Longs,
    facet_shape,
    unit_normals,
)
from tribox.geometry.surfaces.images import Images
from tribox.geometry.surfaces.slave_points import PointNormals
from tribox.geometry.surfaces.smoothing import Patches, smooth_patches
from tribox.geometry.surfaces.target import Projection

__all__ = ["FacetSurface", "Projection"]

# Reference distance past the edge of a facet up to which a point may stay on it.
OVERRUN = 1e-4


@dataclass(frozen=True, slots=True)
class SurfacePart:
    """What some facets in space are on a whole surface that is not at hand."""

    number: Longs  # (f,) of each on the whole surface
    is_open: Bools  # (f, s) whether a side is at an end of the whole surface
    slack: float  # m, of the search
    ends: Floats | None  # (f, v), m, of the corners from the open end, or None

    def of(self, take: Longs) -> SurfacePart:
        """The same of the facets ``take``."""
        ends = None if self.ends is None else self.ends[take]
        return SurfacePart(self.number[take], self.is_open[take], self.slack, ends)

    @classmethod
    def joined(cls, parts: Sequence[SurfacePart]) -> SurfacePart:
        """All facets of some."""
        ends = [part.ends for part in parts if part.ends is not None]
        return cls(
            np.concatenate([part.number for part in parts]),
            np.concatenate([part.is_open for part in parts]),
            parts[0].slack,
            np.concatenate(ends) if ends else None,
        )


class FacetSurface:
    """Master facets, their neighbours, and the search for the closest point on them.

    Attributes:
        facets: (f, a) node numbers; shape: of all facets, or of the smooth patches over them.
        stencil: (f, m) nodes that move each facet: its own, or those of its patch.
        ends: where it ends, and how points fade there.
        neighbours: (f, f) sparse; facets that share a corner, and each facet itself.
    """

    def __init__(
        self,
        shape: FacetShape,
        facets: Ints,
        nodes: Floats,
        smoothing_angle: float | None = None,
        fade_length: float | None = None,
        part: SurfacePart | None = None,
        images: Images | None = None,
        rings: bool = False,
        planes: Sequence[tuple[int, Bools]] = (),
    ) -> None:
        """Prepare the connectivity.

        Args:
            shape: of all facets.
            facets: (f, a) node numbers, ordered so that the normal points out of the body.
            nodes: (n, i), m, reference.
            smoothing_angle: rad; the surface is made smooth but for sides where the normals
                of neighbours differ by more. Without it the facets themselves are the surface.
            fade_length: m, undeformed, way before an open end over which points fade.
            part: in space, of which surface these are some of the facets; None: it is whole.
            images: what continues it beyond planes of symmetry; theirs are the last of the nodes.
            rings: whether it is a line of rings, x being the distance from their axis.
            planes: of symmetry, each with the nodes (n,) on it: there it does not end.

        Raises:
            ValueError: more than two facets meet at a side, or two with opposite normals; or
                facets that cannot be made smooth; or a surface that would fade everywhere.
        """
        self.facets = np.asarray(facets, dtype=np.int32)
        self.shape, self.stencil = shape, self.facets
        self._patches: Patches | None = None
        self._last: tuple[Floats, Floats] | None = None  # nodes, and what they make
        if smoothing_angle is not None:
            asked = smoothing_angle, rings, images
            self._patches = smooth_patches(shape, self.facets, nodes, *asked)
            self.shape, self.stencil = self._patches.shape, self._patches.stencil
        self._code = CompiledFacets(self.shape, len(self.facets))
        self._undeformed = nodes
        known = () if part is None else (part.number, part.slack)
        self.search = FacetSearch(self.shape, self._controls(nodes), self._code, *known)
        is_open = self._connect(shape, nodes, None if part is None else part.is_open, planes)
        known_ends = None if part is None else part.ends
        line = facet_shape(shape.cell, 1), self.facets, nodes
        self.ends = SurfaceEnds(*line, is_open, fade_length, planes, known_ends)

    def _connect(
        self,
        shape: FacetShape,
        nodes: Floats,
        is_open: Bools | None,
        planes: Sequence[tuple[int, Bools]],
    ) -> Bools:
        """Find neighbours of facets on nodes (n, i), m, undeformed; nodes at open ends.

        Of a part it is known which sides (f, s) are; those on ``planes`` of symmetry are left out.
        """
        count = len(nodes)
        corners = self.facets[:, : shape.corners]
        # Facets (n, v) that meet at each node, −1 beyond, and which of their corners it is (n,
        # v).
        flat = corners.reshape(-1)
        order = np.argsort(flat, kind="stable")
        # Sorted by node, an entry's column is its place among those of its node.
        valence = np.bincount(flat, minlength=count)
        column = np.arange(len(flat)) - np.repeat(np.cumsum(valence) - valence, valence)
        facet = np.full((count, max(int(valence.max(initial=0)), 1)), -1, dtype=np.int32)
        corner = np.zeros_like(facet)
        facet[flat[order], column] = order // corners.shape[1]
        corner[flat[order], column] = order % corners.shape[1]
        self._around, self._corner = facet, corner
        self._rays: RaySearch | None = None
        if shape.directions == 1:
            for at, word in ((0, "start"), (1, "end")):
                if len(np.unique(corners[:, at])) != len(corners):
                    why = f"two of its facets {word} at one node"
                    raise ValueError(f"the master surface branches: {why}")
            at_end = np.count_nonzero(self._around >= 0, axis=1) < 2
            for _, on in planes:
                at_end &= ~on
            self._rays = RaySearch(self.shape, self.facets, self._controls(nodes))
        else:
            self._across, self._across_side = _facets_across(shape, corners)
            at_end = np.zeros(count, dtype=bool)
            open_sides = self._across < 0 if is_open is None else is_open
            self._goes_on = self._across >= 0
            for number, side in enumerate(shape.sides):
                ends = corners[:, side.nodes[:2]]
                for _, on in planes:
                    self._goes_on[:, number] |= open_sides[:, number] & on[ends].all(axis=1)
                at_end[ends[open_sides[:, number] & ~self._goes_on[:, number]]] = True
        self.neighbours = _sharing_corners(corners, count)
        return at_end

    def for_others(self) -> FacetSurface:
        """The same for other points than those whose search goes on from the last one."""
        other = copy.copy(self)
        other._code = CompiledFacets(self.shape, len(self.facets))
        other.search = FacetSearch(self.shape, self._controls(self._undeformed), other._code)
        return other

    def is_smooth_end(self, facet: Ints) -> Bools:
        """Which facets (q,) are smooth patches at an open end that hands on its load wrongly."""
        if self._patches is None:
            return np.zeros(len(facet), dtype=bool)
        return self._patches.one_sided[facet]

    def part(self) -> SurfacePart:
        """All facets of a whole surface in space, as parts of it."""
        ends = None if self.ends.distance is None else self.ends.distance.corners
        number = np.arange(len(self.facets))
        return SurfacePart(number, self._across < 0, self.search.slack, ends)

    def project(
        self,
        points: Floats,
        nodes: Floats,
        frozen_facets: Ints | None = None,
        rays: PointNormals | None = None,
        fading: Floats | None = None,
    ) -> Projection:
        """Closest points on the whole surface.

        Of facets equally close the first is taken, one that holds the point inside before one that
        holds it on its edge, so the answer does not depend on the order of the search.

        Args:
            points: (q, i), m, current: slave points.
            nodes: (n, i), m, current: master nodes.
            frozen_facets: (q,) facets that the points stay on as long as they are no more than
                ``OVERRUN`` past an edge, as if the facet continued there.
            rays: normals of the slave at the points, to project along in the plane; None: closest
                points.
            fading: (q,), m, way up to the open end of a master in the plane over which a point
                fades; None: points count in full up to there.
        """
        controls = self._controls(nodes)
        among, tie = self.search.candidates(points, controls), TIE * self.search.slack
        stay = None if frozen_facets is None else (frozen_facets, OVERRUN)
        facet, xi, entity = self._code.closest(points, controls, among, tie, stay)
        if fading is not None and self.ends.joined.any():
            facet, xi, entity = self._go_on((facet, xi, entity), points, controls, fading)
        if rays is not None:
            assert self._rays is not None
            facet, xi, met = self._rays.hits(points, rays.normal, controls, facet, xi)
            entity = np.full_like(entity, INTERIOR)
        out = self._at(points, controls, facet, xi, entity)
        if rays is not None:
            out.normal = rays.normal
            out.gap = np.einsum("qi,qi->q", points - out.foot, out.normal)
            out.on_surface, out.rays = met, rays
        if fading is not None:
            self.ends.fade(out, fading)
        return out

    def _go_on(
        self, found: tuple[Ints, Floats, Ints], points: Floats, controls: Floats, reach: Floats
    ) -> tuple[Ints, Floats, Ints]:
        """Facets, ξ and entities of points just past an end where another surface begins.

        Up to ``reach`` (q,), m, they lie as if the last facet went on.
        """
        facet, xi, entity = found
        rows = np.nonzero(entity >= CORNER)[0]
        rows = rows[self.ends.joined[self.facets[facet[rows], entity[rows] - CORNER]]]
        if not len(rows):
            return found
        there, known = self._as_if_going_on(points[rows], controls, facet[rows])
        past = self.shape.excess(there) * self.ends.length[facet[rows]]
        near = known & (past <= reach[rows])
        xi, entity = xi.copy(), entity.copy()
        xi[rows[near]], entity[rows[near]] = there[near], INTERIOR
        return facet, xi, entity

    def _as_if_going_on(
        self, points: Floats, controls: Floats, facet: Ints
    ) -> tuple[Floats, Bools]:
        """Places ξ (q, α) nearest to points on endless facets (q,); whether there are any."""
        among = Candidates(np.arange(len(points) + 1), facet, np.zeros(len(points)), 0.0)
        _, xi, entity = self._code.closest(points, controls, among, 0.0, (facet, np.inf))
        return xi, entity == INTERIOR

    @property
    def extraction(self) -> Floats | None:
        """Control points (f, c, m) of smooth patches from the nodes of their stencils, or None."""
        return None if self._patches is None else self._patches.extraction

    @property
    def connectivity(self) -> tuple[Ints, Ints, Ints, Ints, Bools]:
        """In space: how the facets hang together.

        Returns:
            Facets (n, v) around each node, −1 beyond, and which of their corners it is (n, v);
            facets (f, s) across each side, −1 at an end, themselves at a plane of symmetry, and
            which of their sides it is (f, s); nodes (n,) at an open end.
        """
        image, (facets, sides) = self._goes_on & (self._across < 0), self._across.shape
        own, side = np.arange(facets)[:, None], np.arange(sides)
        across = np.where(image, own, self._across).astype(self._across.dtype)
        other = np.where(image, side, self._across_side).astype(self._across_side.dtype)
        return self._around, self._corner, across, other, self.ends.is_open

    @property
    def has_kinks(self) -> bool:
        """Whether facets of a master in the plane meet at an angle."""
        return self._rays is not None and self._rays.has_kinks

    def excess(self, facet: Ints, xi: Floats) -> Floats:
        """How far (q,) places ξ (q, α) are past an edge of their facets (q,); ≤ 0 inside."""
        return self.shape.excess(xi)

    def places(self, facet: Ints, xi: Floats, nodes: Floats) -> tuple[Floats, Floats]:
        """Points ȳ (q, i) and tangents (q, α, i) of material places, on current nodes (n, i)."""
        return self._code.places(self._controls(nodes), facet, xi)

    def smooth_normals(self, facet: Ints, xi: Floats, nodes: Floats) -> Floats:
        """Normals (q, i), of any length, of a smooth surface through the facets, there."""
        if self._patches is not None:
            return unit_normals(self.places(facet, xi, nodes)[1])
        corner = self.facets[facet, : self.shape.corners]
        normal = self._corner_outward(corner.reshape(-1), self._controls(nodes))
        for axis, on in self.ends.planes:  # where the surface goes on as its image
            normal[on[corner.reshape(-1)], axis] = 0.0
        length = np.linalg.norm(normal, axis=1)[:, None]
        normal /= np.where(length > 0.0, length, 1.0)
        share = facet_shape(self.shape.cell, 1).values(xi)
        return np.einsum("qv,qvi->qi", share, normal.reshape(*corner.shape, nodes.shape[1]))

    def weights(self, facet: Ints, xi: Floats) -> Floats:
        """Shares (q, m) of the nodes ``stencil`` in the place ξ (q, α) of each facet (q,)."""
        values = self.shape.values(xi)
        if self._patches is None:
            return values
        return np.einsum("qc,qcm->qm", values, self._patches.extraction[facet])

    def slopes(self, facet: Ints, xi: Floats) -> Floats:
        """Derivatives (q, α, m) of :meth:`weights` for ξ."""
        first = self.shape.first(xi)
        return first if self._patches is None else first @ self._patches.extraction[facet]

    def _controls(self, nodes: Floats) -> Floats:
        """Nodes (f, a, i) of the facets, or control points of the patches over them.

        The same array as before while the nodes (n, i), m, are where they were.
        """
        if self._last is None or not np.array_equal(self._last[0], nodes):
            images = None if self._patches is None else self._patches.images
            own = len(self._undeformed) - (0 if images is None else len(images.of))
            # A part that has grown since they were found has more of them.
            missing = self._undeformed[len(nodes) : own]
            every = np.concatenate([nodes[:own], missing]) if len(missing) else nodes[:own]
            every = every if images is None else images.behind(every)
            moved: Floats = every[self.stencil]
            controls = moved if self._patches is None else self._patches.extraction @ moved
            controls.flags.writeable = False
            self._last = nodes.copy(), controls
        return self._last[1]

    def _at(
        self, points: Floats, controls: Floats, facet: Ints, xi: Floats, entity: Ints
    ) -> Projection:
        """Geometry at the closest points on the chosen facets."""
        foot, tangents, normal, gap, curvature = self._code.geometry(points, controls, facet, xi)
        out = Projection(
            facet=facet,
            xi=xi,
            foot=foot,
            normal=normal,
            tangents=tangents,
            gap=gap,
            clamped=entity != INTERIOR,
            on_surface=np.ones(len(points), dtype=bool),
            curvature=curvature,
        )
        if self.shape.directions == 2:
            out.along = np.zeros_like(xi)
        at: Ints = np.nonzero(out.clamped)[0].astype(np.int32)
        if len(at):
            self._clamp(out, at, entity[at], points[at], controls)
        return out

    def _clamp(
        self, out: Projection, at: Ints, entity: Ints, points: Floats, controls: Floats
    ) -> None:
        """Normal, gap and freedom of the points ``at`` that are on an edge or a corner."""
        outward = np.empty_like(points)
        corner = entity >= CORNER
        if corner.any():
            rows = at[corner]
            vertex = self.facets[out.facet[rows], entity[corner] - CORNER]
            outward[corner] = self._corner_outward(vertex, controls)
            out.on_surface[rows] = ~self.ends.is_open[vertex]
        if not corner.all():
            rows, side = at[~corner], entity[~corner]
            outward[~corner] = self._edge_outward(out, rows, side, controls)
            out.on_surface[rows] = self._goes_on[out.facet[rows], side]
            assert out.along is not None
            out.along[rows] = np.array([s.direction for s in self.shape.sides])[side]
        out.clamp(at, points, outward)

    def _corner_outward(self, vertex: Ints, controls: Floats) -> Floats:
        """Outward directions (p, i) at corners: normals of the facets there, by their angles.

        Baerentzen & Aanaes, IEEE Trans. Vis. Comput. Graph. 11 (2005) 243: the sign of the distance
        from a corner is that against this mean.
        """
        distinct, of_point = np.unique(vertex, return_inverse=True)
        if len(distinct) < len(vertex):  # many points beside few corners
            return self._corner_outward(distinct, controls)[of_point]
        around, corner = self._around[vertex], self._corner[vertex]
        present = around >= 0
        derivative = self.shape.first(self.shape.points[: self.shape.corners])[corner]
        tangents = np.einsum("pvba,pvai->pvbi", derivative, controls[around])
        weight = np.where(present, 1.0, 0.0)
        if self.shape.directions == 2:
            # Angles as weights: the mean does not change where a facet is divided.
            edges = np.einsum("pvdb,pvbi->pvdi", self.shape.corner_directions[corner], tangents)
            edges /= np.linalg.norm(edges, axis=3)[..., None]
            cosine = np.einsum("pvi,pvi->pv", edges[:, :, 0], edges[:, :, 1])
            weight *= np.arccos(np.clip(cosine, -1.0, 1.0))
        outward = np.einsum("pv,pvi->pi", weight, unit_normals(tangents))
        return outward / np.linalg.norm(outward, axis=1)[:, None]

    def _edge_outward(self, out: Projection, rows: Ints, side: Ints, controls: Floats) -> Floats:
        """Outward directions (p, i) on edges: the mean of both facets' normals there."""
        facet, xi = out.facet[rows], out.xi[rows]
        origin = np.array([s.origin for s in self.shape.sides])
        direction = np.array([s.direction for s in self.shape.sides])
        way = direction[side]
        along = np.einsum("pb,pb->p", xi - origin[side], way) / np.einsum("pb,pb->p", way, way)
        other = self._across[facet, side]
        there = self._across_side[facet, side]
        # Both facets run round their own side of the edge: in opposite directions.
        opposite = origin[there] + (1.0 - along)[:, None] * direction[there]
        tangents = np.einsum("pba,pai->pbi", self.shape.first(opposite), controls[other])
        beyond = np.where((other >= 0)[:, None], unit_normals(tangents), 0.0)
        outward = out.normal[rows] + beyond
        return outward / np.linalg.norm(outward, axis=1)[:, None]


def _sharing_corners(corners: Ints, count: int) -> scipy.sparse.csr_matrix:
    """Facets (f, f) with a node of the ``count`` in common, by their corners (f, v)."""
    start = np.arange(0, corners.size + 1, corners.shape[1])
    given = np.ones(corners.size, dtype=np.int32), corners.reshape(-1), start
    incidence = scipy.sparse.csr_matrix(given, shape=(len(corners), count))
    out = (incidence @ incidence.T).tocsr()
    out.data[:] = 1
    return out


def _facets_across(shape: FacetShape, corners: Ints) -> tuple[Ints, Ints]:
    """Facet (f, side) across each edge, −1 at the end of the surface, and which of its sides."""
    ends = np.stack([corners[:, side.nodes[:2]] for side in shape.sides], axis=1).reshape(-1, 2)
    largest = int(corners.max(initial=0)) + 1
    key: Longs = ends[:, 0].astype(np.int64) * largest + ends[:, 1]
    # With outward normals on one side the neighbour runs along the common edge the other way.
    back = ends[:, 1].astype(np.int64) * largest + ends[:, 0]
    order = np.argsort(key)
    if np.any(np.diff(key[order]) == 0):
        raise ValueError(
            "the master surface branches: more than two of its facets meet at an edge, or two "
            "whose outward sides differ"
        )
    match = order[np.minimum(np.searchsorted(key, back, sorter=order), len(key) - 1)]
    found = key[match] == back
    across = np.where(found, match // len(shape.sides), -1).astype(np.int32)
    side = np.where(found, match % len(shape.sides), 0).astype(np.int32)
    return across.reshape(-1, len(shape.sides)), side.reshape(-1, len(shape.sides))
