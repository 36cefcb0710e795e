"""A rigid surface of facets, such as that of a tool drawn elsewhere."""

from __future__ import annotations

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.facets import FacetShape, Floats, Ints, facet_shape
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.rigid import Outline, Places, RigidSurface
from tribox.geometry.surfaces.slave_normals import PointNormals
from tribox.geometry.surfaces.target import Projection

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

    def at(self, facet: Ints, xi: Floats) -> Places:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`; without curvature."""
        return Places(*self._surface.places(facet, xi, self.nodes))

    def excess(self, facet: Ints, xi: Floats) -> Floats:
        """See :class:`~tribox.geometry.surfaces.target.Target`."""
        return self._surface.excess(facet, xi)

    def outline(self, box: Floats, count: int = 64) -> Outline:
        """See :class:`~tribox.geometry.surfaces.rigid.RigidSurface`; straight lines."""
        corners = self.facets[:, : self.shape.corners]
        if self.shape.corners == 4:
            corners = np.concatenate([corners[:, [0, 1, 3]], corners[:, [0, 3, 2]]])
        return Outline(self.nodes, corners)


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
