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
from tribox.geometry.surfaces.target import Projection, fade_at_ends

__all__ = ["FacetSurface", "Projection"]

# Reference distance past the edge of a facet up to which a point may stay on it.
OVERRUN = 1e-4


@dataclass(frozen=True, slots=True)
class SurfacePart:
    """What some facets in space are on a whole surface that is not at hand.

    Attributes:
        number: (f,) of each on the whole surface.
        is_open: (f, s) whether a side is at an end of the whole surface.
        slack: m, of the search; ends: (f, v), m, of the corners from the open end, or None.
    """

    number: Longs
    is_open: Bools
    slack: float
    ends: Floats | None

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
        fade_length: m, way before an open end over which points fade; None: as each point asks.
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
        self.fade_length, self._undeformed = fade_length, nodes
        known = () if part is None else (part.number, part.slack)
        self.search = FacetSearch(self.shape, self._controls(nodes), self._code, *known)
        self._connect(shape, nodes, None if part is None else part.is_open)
        self._fading_ends = self._open.copy()
        self._joined = np.zeros_like(self._open)
        if part is None or part.ends is None or fade_length is None:
            self._measure_ends()
        else:
            self._end = EndDistance(facet_shape(shape.cell, 1), fade_length, part.ends)

    def _connect(self, shape: FacetShape, nodes: Floats, is_open: Bools | None) -> None:
        """Find neighbours and open ends of facets of a shape on nodes (n, i), m, undeformed.

        Of a part of a surface it is known which sides (f, s) are open.
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
            _require_one_each(corners)
            self._open = np.count_nonzero(self._around >= 0, axis=1) < 2
            self._rays = RaySearch(self.shape, self.facets, self._controls(nodes))
            ends = nodes[self.facets[:, :2]]
            self._length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        else:
            self._across, self._across_side = _facets_across(shape, corners)
            self._open = np.zeros(count, dtype=bool)
            open_sides = self._across < 0 if is_open is None else is_open
            for number, side in enumerate(shape.sides):
                free = open_sides[:, number]
                self._open[corners[free][:, side.nodes[:2]]] = True
        incidence = scipy.sparse.csr_matrix(
            (
                np.ones(corners.size, dtype=np.int32),
                corners.reshape(-1),
                np.arange(0, corners.size + 1, shape.corners),
            ),
            shape=(len(corners), count),
        )
        self.neighbours = (incidence @ incidence.T).tocsr()
        self.neighbours.data[:] = 1

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
        ends = None if self.fade_length is None else self._end.corners
        number = np.arange(len(self.facets))
        return SurfacePart(number, self._across < 0, self.search.slack, ends)

    def _measure_ends(self) -> None:
        if self.fade_length is not None:
            shape, nodes = facet_shape(self.shape.cell, 1), self._undeformed
            ends = self._fading_ends
            self._end = EndDistance.measured(shape, self.facets, nodes, ends, self.fade_length)

    def join(self, others: Floats, within: float) -> None:
        """Let nothing fade at open ends, in the plane, that meet those of another surface.

        Args:
            others: (m, i), m, undeformed nodes of the other surface.
            within: m, distance up to which ends meet.
        """
        if self.shape.directions == 2:
            return
        ends = np.nonzero(self._fading_ends)[0]
        apart = np.linalg.norm(self._undeformed[ends][:, None] - others, axis=2)
        self._fading_ends[ends[apart.min(axis=1) <= within]] = False
        self._joined = self._open & ~self._fading_ends
        self._measure_ends()

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
        facet, xi, entity = self._closest(points, controls, frozen_facets)
        if fading is not None and self._joined.any():
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
        self._fade(out, fading)
        self._share_ends(out, fading)
        return out

    def _go_on(
        self, found: tuple[Ints, Floats, Ints], points: Floats, controls: Floats, reach: Floats
    ) -> tuple[Ints, Floats, Ints]:
        """Facets, ξ and entities of points just past an end where another surface begins.

        Up to ``reach`` (q,), m, they lie as if the last facet went on.
        """
        facet, xi, entity = found
        rows = np.nonzero(entity >= CORNER)[0]
        rows = rows[self._joined[self.facets[facet[rows], entity[rows] - CORNER]]]
        if not len(rows):
            return found
        there, known = self._as_if_going_on(points[rows], controls, facet[rows])
        past = self.shape.excess(there) * self._length[facet[rows]]
        near = known & (past <= reach[rows])
        xi, entity = xi.copy(), entity.copy()
        xi[rows[near]], entity[rows[near]] = there[near], INTERIOR
        return facet, xi, entity

    def _as_if_going_on(
        self, points: Floats, controls: Floats, facet: Ints
    ) -> tuple[Floats, Bools]:
        """Places ξ (q, α) nearest to points on endless facets (q,); whether there are any."""
        count = np.arange(len(points) + 1)
        among = Candidates(count, facet, np.zeros(len(points)), 0.0)
        _, xi, entity = self._code.closest(points, controls, among, 0.0, (facet, np.inf))
        return xi, entity == INTERIOR

    def _share_ends(self, out: Projection, reach: Floats | None) -> None:
        """Let points pass from one surface to the next, over twice ``reach`` (q,), m."""
        if reach is None or self.shape.directions == 2 or not self._joined.any():
            return
        ends = self._joined[self.facets[out.facet, :2]]
        at = np.nonzero(ends.any(axis=1) & out.on_surface)[0]
        length, xi = self._length[out.facet[at]], out.xi[at, 0]
        # ½ at the end itself, where both surfaces have the same point: the shares of both add up to
        # 1 over ± reach.
        per_length = 0.5 * length / np.minimum(reach[at], length)
        inside = np.stack([xi, 1.0 - xi], axis=1) * per_length[:, None] + 0.5
        inside = np.where(ends[at], inside, np.inf)
        end = np.argmin(inside, axis=1)
        share = np.clip(inside[np.arange(len(at)), end], 0.0, 1.0)
        slope = np.where(end == 0, 1.0, -1.0) * per_length * ((share > 0.0) & (share < 1.0))
        if out.share is None or out.share_slope is None:
            out.share, out.share_slope = np.ones(len(reach)), np.zeros((len(reach), 1))
        # Product rule: a point may fade at an end and pass over to a neighbour at another.
        out.share_slope[at] *= share[:, None]
        out.share_slope[at, 0] += out.share[at] * slope
        out.share[at] *= share

    def _closest(
        self, points: Floats, controls: Floats, frozen_facets: Ints | None
    ) -> tuple[Ints, Floats, Ints]:
        """Facets (q,), ξ (q, α) and entities (q,) of the closest points."""
        among = self.search.candidates(points, controls)
        kept = None if frozen_facets is None else (frozen_facets, OVERRUN)
        return self._code.closest(points, controls, among, TIE * self.search.slack, kept)

    def _fade(self, out: Projection, reach: Floats | None) -> None:
        """Let points fade over the last way ``reach`` (q,), m, up to the end of the surface.

        A point that loses its force at once when it runs past the end may leave no equilibrium.
        """
        if reach is None:
            return
        if self.fade_length is not None:
            out.share, out.share_slope = self._end.share(out.facet, out.xi)
            return
        if self.shape.directions == 2:
            return
        open_ends = self._fading_ends[self.facets[out.facet, :2]]
        at = np.nonzero(open_ends.any(axis=1) & out.on_surface)[0]
        if not len(at):
            return
        out.share, out.share_slope = np.ones(len(reach)), np.zeros((len(reach), 1))
        out.share[at], out.share_slope[at, 0] = fade_at_ends(
            open_ends[at], out.xi[at, 0], self._length[out.facet[at]], reach[at]
        )

    @property
    def extraction(self) -> Floats | None:
        """Control points (f, c, m) of smooth patches from the nodes of their stencils, or None."""
        return None if self._patches is None else self._patches.extraction

    @property
    def connectivity(self) -> tuple[Ints, Ints, Ints, Ints, Bools]:
        """In space: how the facets hang together.

        Returns:
            Facets (n, v) around each node, −1 beyond, and which of their corners it is (n, v);
            facets (f, s) across each side, −1 at an end, and which of their sides it is (f, s);
            nodes (n,) at an open end.
        """
        return self._around, self._corner, self._across, self._across_side, self._open

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
        share = facet_shape(self.shape.cell, 1).values(xi)
        out: Floats = np.einsum("qv,qvi->qi", share, normal.reshape(*corner.shape, nodes.shape[1]))
        return out

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
            out.on_surface[rows] = ~self._open[vertex]
        if not corner.all():
            rows, side = at[~corner], entity[~corner]
            other = self._across[out.facet[rows], side]
            outward[~corner] = self._edge_outward(out, rows, side, controls)
            out.on_surface[rows] = other >= 0
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
        unit: Floats = outward / np.linalg.norm(outward, axis=1)[:, None]
        return unit

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
        unit: Floats = outward / np.linalg.norm(outward, axis=1)[:, None]
        return unit


def _require_one_each(corners: Ints) -> None:
    """In the plane at most one segment starts and one ends at each node."""
    for column, word in ((0, "start"), (1, "end")):
        if len(np.unique(corners[:, column])) != len(corners):
            raise ValueError(f"the master surface branches: two of its facets {word} at one node")


def _facets_across(shape: FacetShape, corners: Ints) -> tuple[Ints, Ints]:
    """Facet (f, side) across each edge, −1 at the end of the surface, and which of its sides."""
    ends = np.stack([corners[:, side.nodes[:2]] for side in shape.sides], axis=1).reshape(-1, 2)
    largest = int(corners.max(initial=0)) + 1
    key = ends[:, 0].astype(np.int64) * largest + ends[:, 1]
    # With outward normals on one side the neighbour runs along the common edge the other way.
    back = ends[:, 1].astype(np.int64) * largest + ends[:, 0]
    order = np.argsort(key)
    if np.any(np.diff(key[order]) == 0):
        raise ValueError(
            "the master surface branches: more than two of its facets meet at an edge, or two "
            "whose outward sides differ"
        )
    at = np.minimum(np.searchsorted(key, back, sorter=order), len(key) - 1)
    match = order[at]
    found = key[match] == back
    across = np.where(found, match // len(shape.sides), -1).astype(np.int32)
    side = np.where(found, match % len(shape.sides), 0).astype(np.int32)
    return across.reshape(-1, len(shape.sides)), side.reshape(-1, len(shape.sides))


# -- How far places on a surface are from its open end, and how much of a contact counts there -----
#
# Axis letters: n nodes, f facets, v corners, q places, i space, α surface directions. Distances are
# those of the undeformed surface: in the plane along it, in space straight to the nearest open
# edge, both linear between the corners of a facet.


class EndDistance:
    """Distances of the corners from the open end of a surface.

    Attributes:
        length: m, way over which a contact fades; corners: (f, v), m, distances of the corners.
    """

    def __init__(self, shape: FacetShape, length: float, corners: Floats) -> None:
        """Take the distances; ``shape`` is that of facets of the first degree."""
        self.length, self.corners, self._shape = length, corners, shape

    @classmethod
    def measured(
        cls, shape: FacetShape, facets: Ints, nodes: Floats, is_open: Bools, length: float
    ) -> EndDistance:
        """Measure them.

        Args:
            facets: (f, a) their nodes; corners come first.
            nodes: (n, i), m, undeformed.
            is_open: (n,) whether a corner lies at an open end.
            length: m, way over which a contact fades.

        Raises:
            ValueError: no part of the surface would count in full.
        """
        corners = facets[:, : shape.corners]
        distance: Floats
        if not is_open.any():
            distance = np.full(len(nodes), np.inf)
        elif shape.directions == 1:
            distance = _along(corners, nodes, is_open)
        else:
            distance = _to_edges(_open_edges(shape, corners), nodes)
        largest = float(distance[corners].max())
        if largest < length:
            raise ValueError(
                f"fade_length = {length:g} m: no part of the master is so far from its ends "
                f"({largest:.3g} m at most)"
            )
        far = 1e3 * length  # without an open end all counts
        found: Floats = np.where(np.isfinite(distance), distance, far)[corners]
        return cls(facet_shape(shape.cell, 1), length, found)

    def share(self, facet: Ints, xi: Floats) -> tuple[Floats, Floats]:
        """How much counts (q,) at places ξ (q, α) of facets (q,), and its derivatives (q, α) for ξ.

        s² (3 − 2 s) of s = d/L at the distance d from the end, 1 from L on.
        """
        mine = self.corners[facet]
        s = np.einsum("qv,qv->q", self._shape.values(xi), mine) / self.length
        slope = np.einsum("qav,qv->qa", self._shape.first(xi), mine) / self.length
        s = np.clip(s, 0.0, 1.0)
        return s * s * (3.0 - 2.0 * s), (6.0 * s * (1.0 - s))[:, None] * slope


def _along(corners: Ints, nodes: Floats, is_open: Bools) -> Floats:
    """Way (n,), m, along segments to the nearest open end."""
    from scipy.sparse.csgraph import dijkstra

    length = np.linalg.norm(nodes[corners[:, 1]] - nodes[corners[:, 0]], axis=1)
    size = (len(nodes), len(nodes))
    graph = scipy.sparse.csr_matrix((length, (corners[:, 0], corners[:, 1])), shape=size)
    ends = np.nonzero(is_open)[0]
    out: Floats = dijkstra(graph, directed=False, indices=ends, min_only=True)
    return out


def _open_edges(shape: FacetShape, corners: Ints) -> Ints:
    """Corners (e, 2) of the edges that one facet alone has."""
    edges = np.concatenate([corners[:, side.nodes[:2]] for side in shape.sides])
    _, first, count = np.unique(
        np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
    )
    out: Ints = edges[first[count == 1]]
    return out


def _to_edges(edges: Ints, nodes: Floats) -> Floats:
    """Distance (n,), m, of nodes from the nearest of some edges (e, 2)."""
    start, way = nodes[edges[:, 0]], nodes[edges[:, 1]] - nodes[edges[:, 0]]
    squared = np.einsum("ei,ei->e", way, way)
    out = np.empty(len(nodes))
    # A million pairs at once, for memory's sake.
    for rows in np.array_split(np.arange(len(nodes)), max(1, len(nodes) * len(edges) // 10**6)):
        apart = nodes[rows][:, None] - start
        along = np.clip(np.einsum("nei,ei->ne", apart, way) / squared, 0.0, 1.0)
        rest = apart - along[..., None] * way
        out[rows] = np.sqrt(np.einsum("nei,nei->ne", rest, rest).min(axis=1))
    return out
