"""A rigid surface of facets, such as that of a tool drawn elsewhere."""

from __future__ import annotations

import copy

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.facets import (
    Bools,
    FacetShape,
    Floats,
    Ints,
    facet_shape,
    unit_normals,
)
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.rigid import CHORD, Outline, Places, RigidSurface
from tribox.geometry.surfaces.slave_points import PointNormals
from tribox.geometry.surfaces.target import Projection

ON_END = 1e-6  # of a facet, within which a place is at its end
FLAT = 1e-6  # sine of the angle between facets up to which they lie in one plane
# By the dimension of space and the number of a facet's nodes.
CELLS = {
    (2, 2): ("interval", 1),
    (2, 3): ("interval", 2),
    (3, 3): ("triangle", 1),
    (3, 4): ("quadrilateral", 1),
    (3, 6): ("triangle", 2),
    (3, 9): ("quadrilateral", 2),
}


class MeshSurface(RigidSurface):
    """Facets that do not deform, with the closest points of those that do.

    Attributes:
        nodes: (n, i), m, undeformed; facets: (f, a) their numbers; shape: of all facets.
    """

    def __init__(self, nodes: Floats, facets: Ints, smoothing_angle: float | None = None) -> None:
        """Find the neighbours.

        Args:
            nodes: (n, i), m.
            facets: (f, a) numbers of nodes, in the order of a Lagrange element (a quadrilateral's
                third corner is across from its second), so that the normals point out of the tool.
            smoothing_angle: rad; the surface is made smooth but for sides where the normals of
                neighbours differ by more. None: the facets as they are.

        Raises:
            ValueError: facets of an unknown shape or without extent, or with nodes that do not
                exist; a surface that branches or cannot be made smooth.
        """
        nodes = np.array(nodes, dtype=np.float64)
        facets = np.asarray(facets)
        self.shape = _shape(nodes, facets)
        # Nodes of no facet would be looked at as ends of the surface.
        used, numbers = np.unique(facets, return_inverse=True)
        self.nodes, self.facets = nodes[used], numbers.reshape(facets.shape).astype(np.int32)
        _require_extent(self.shape, self.nodes, self.facets)
        self._surface = FacetSurface(self.shape, self.facets, self.nodes, smoothing_angle)
        low, high = self.nodes.min(axis=0), self.nodes.max(axis=0)
        size = 0.5 * float(np.linalg.norm(high - low))
        super().__init__(len(facets), 0.5 * (low + high), size, np.stack([low, high]))
        self.search, self.has_kinks = self._surface.search, self._surface.has_kinks
        self._cut = self._ends_of_rounds()

    def for_others(self) -> MeshSurface:
        other = copy.copy(self)
        other._surface = self._surface.for_others()
        other.search = other._surface.search
        return other

    def _project(
        self,
        points: Floats,
        frozen_facets: Ints | None,
        rays: PointNormals | None,
        fading: Floats | None,
    ) -> Projection:
        return self._surface.project(points, self.nodes, frozen_facets, rays, fading)

    @property
    def neighbours(self) -> scipy.sparse.csr_matrix:
        """(f, f), those that share a corner: a pair of all with all might be too many."""
        return self._surface.neighbours

    def smooth_normals(self, facet: Ints, xi: Floats, nodes: Floats) -> Floats:
        turn, _ = self._motion(nodes)
        return self._surface.smooth_normals(facet, xi, self.nodes) @ turn.T

    def at(self, facet: Ints, xi: Floats) -> Places:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`; without curvature."""
        return Places(*self._surface.places(facet, xi, self.nodes))

    def excess(self, facet: Ints, xi: Floats) -> Floats:
        return self._surface.excess(facet, xi)

    def cut_off(self, facet: Ints, xi: Floats) -> Bools:
        corners, out = facet_shape(self.shape.cell, 1).values(xi), np.zeros(len(xi), dtype=bool)
        for number, side in enumerate(self.shape.sides):
            on_side = corners[:, side.nodes[:2]].sum(axis=1) > 1.0 - ON_END
            out |= on_side & self._cut[number, facet]
        return out

    def _ends_of_rounds(self) -> Bools:
        """Sides (s, f) of facets at an open end towards which the surface turns.

        It turns about a side by the normals' angle of the facet and those around it, and, curved,
        by that of its own between middle and side.
        """
        shape, nodes = self.shape, self.nodes[self.facets]
        middle = np.mean(shape.points[: shape.corners], axis=0)
        normal = unit_normals(np.einsum("ba,fai->fbi", shape.first(middle[None])[0], nodes))
        pairs = self._surface.neighbours.tocoo()
        across = np.cross(_in_space(normal[pairs.row]), _in_space(normal[pairs.col]))
        out = np.zeros((len(shape.sides), len(nodes)), dtype=bool)
        sides = [np.sort(self.facets[:, side.nodes[:2]], axis=1) for side in shape.sides]
        _, number, count = np.unique(
            np.concatenate(sides), axis=0, return_inverse=True, return_counts=True
        )
        is_open = (count == 1)[number.reshape(len(sides), -1)]
        for at, side in enumerate(shape.sides):
            on = np.mean(shape.points[list(side.nodes[:2])], axis=0)
            there = unit_normals(np.einsum("ba,fai->fbi", shape.first(on[None])[0], nodes))
            axis = _axes(nodes[:, side.nodes[:2]])
            # sin of the angle between two normals, as far as it is about the side: n_1 × n_2 along
            # its axis.
            turn = np.abs(np.einsum("pi,pi->p", across, axis[pairs.row]))
            own = np.cross(_in_space(normal), _in_space(there))
            most = np.abs(np.einsum("fi,fi->f", own, axis))
            np.maximum.at(most, pairs.row, np.where(turn < np.sin(CHORD), turn, 0.0))
            out[at] = is_open[at] & (most > FLAT)
        return out

    def outline(self, box: Floats, count: int = 64) -> Outline:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`; straight lines."""
        corners = self.facets[:, : self.shape.corners]
        if self.shape.corners == 4:
            corners = np.concatenate([corners[:, [0, 1, 3]], corners[:, [0, 3, 2]]])
        return Outline(self.nodes, corners)


def _in_space(vectors: Floats) -> Floats:
    """Vectors (n, i) with three components."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


def _axes(ends: Floats) -> Floats:
    """Unit directions (f, 3) of sides between their ends (f, 2, i); of points (f, 1, i), z."""
    if ends.shape[1] == 1:
        return np.tile([0.0, 0.0, 1.0], (len(ends), 1))
    way = ends[:, 1] - ends[:, 0]
    return way / np.linalg.norm(way, axis=1)[:, None]


def _shape(nodes: Floats, facets: Ints) -> FacetShape:
    """The shape of all facets, from the sizes of the arrays."""
    if nodes.ndim != 2 or nodes.shape[1] not in (2, 3) or not np.isfinite(nodes).all():
        raise ValueError("the nodes of a rigid surface are finite coordinates (n, 2) or (n, 3)")
    if facets.ndim != 2 or not len(facets) or not np.issubdtype(facets.dtype, np.integer):
        raise ValueError("the facets of a rigid surface are numbers of nodes (f, a)")
    known = CELLS.get((nodes.shape[1], facets.shape[1]))
    if known is None:
        allowed = [count for dim, count in CELLS if dim == nodes.shape[1]]
        raise ValueError(
            f"a facet of a rigid surface in {nodes.shape[1]} dimensions has {allowed} nodes, not "
            f"{facets.shape[1]}"
        )
    if facets.min() < 0 or facets.max() >= len(nodes):
        raise ValueError(
            f"the facets of a rigid surface have nodes {facets.min()} to {facets.max()} of "
            f"{len(nodes)}"
        )
    return facet_shape(*known)


def _require_extent(shape: FacetShape, nodes: Floats, facets: Ints) -> None:
    """Refuse facets that have no normal in their middle."""
    middle = shape.points.mean(axis=0)[None]
    tangents = np.einsum("ba,fai->fbi", shape.first(middle)[0], nodes[facets])
    metric = np.einsum("fbi,fci->fbc", tangents, tangents)
    reach = np.linalg.norm(np.ptp(nodes[facets], axis=1), axis=1)
    area = np.sqrt(np.maximum(np.linalg.det(metric), 0.0))
    flat = np.nonzero(area <= 1e-9 * reach**shape.directions)[0]
    if len(flat):
        raise ValueError(
            f"facet {flat[0]} of a rigid surface has no extent, with nodes at "
            f"{nodes[facets[flat[0]]].tolist()} m"
        )
