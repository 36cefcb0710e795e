r"""Rigid surfaces as masters: undeformed shapes that control points carry along.

Axis letters: q slave points, f facets, a control points, i, j space, α, β surface directions.

A rigid surface is moved by dim + 1 control points, the corners of a regular simplex,

.. math:: \bar y(\xi) = \sum_a N_a(Y(\xi))\, y_a, \qquad
   N_a(Y) = \tfrac{1}{d + 1} + G_a\cdot(Y - M),

with M their mean. The surface Y(ξ) is curved, but ȳ is linear in y_a, as with the nodes of a facet,
so that variations, forces and momentum of the contact are the same as with a mesh. The control
points move as a rigid body does: slave points are pulled back by the inverse motion, their closest
points are found there, and carried forward. Normals point out of the tool's material.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse

from tribox.geometry.surfaces.target import Projection

if TYPE_CHECKING:
    from tribox.geometry.surfaces.facet_search import FacetSearch
    from tribox.geometry.surfaces.facets import Bools, Floats, Ints
    from tribox.geometry.surfaces.slave_points import PointNormals


RIGID = 1e-6  # strain of the control points up to which they count as moved rigidly
CHORD = np.radians(10.0)  # angle up to which straight pieces are taken for a round surface


@dataclass(slots=True)
class Places:
    """A surface at some of its places, undeformed."""

    place: Floats  # (q, i), m
    tangents: Floats  # (q, α, i), m
    curvature: Floats | None = None  # (q, α, β, i), m, or None if flat


@dataclass(slots=True)
class Feet:
    """Closest points, undeformed."""

    facet: Ints  # (q,)
    xi: Floats  # (q, α)
    # (q, i) at points that are clamped to a corner, edge or end, a direction out of the material
    # there; NaN at others. None: none is clamped
    outward: Floats | None = None
    # (q, α) direction of the edge that a clamped point can move along; None in the plane
    along: Floats | None = None
    on_surface: Bools | None = None  # (q,) False past an open end; None: True everywhere


@dataclass(frozen=True, slots=True)
class Outline:
    """A surface to be drawn."""

    points: Floats  # (n, i), m, undeformed
    cells: Ints  # (c, 2) lines in the plane or (c, 3) triangles


class Unsearched:
    """Stands for the search of a surface on which every facet is looked at."""

    searched_at: tuple[Floats, Floats] | None = None
    searches = 0

    def __init__(self, slack: float) -> None:
        """Take the length, m, of a facet."""
        self.slack = slack

    def search(self, points: Floats, facets: Floats) -> None:
        """Nothing needs to be searched."""


class RigidSurface(ABC):
    """A surface that control points carry along; what all rigid ones have in common.

    Attributes:
        dim: of space; size: m, length that its coordinates ξ are of the order of.
        control_points: (dim + 1, i), m, undeformed.
        stencil: (f, dim + 1) all control points, for each facet; neighbours: all facets are.
        has_kinks: whether facets in the plane meet at an angle.
        extent: (2, i), m, undeformed: least and largest coordinates, infinite where it is.
        least_radius: m, of its tightest rounding, which a slave's facets should be shorter than;
            infinite where none is round, and of meshed surfaces, whose facets say it.
        search: for candidate facets.
    """

    has_kinks: bool = False
    least_radius: float = np.inf
    search: FacetSearch | Unsearched

    def __init__(self, facets: int, centre: Floats, size: float, extent: Floats) -> None:
        """Place the control points of so many facets about ``centre`` (i,), m, near the surface.

        ``size``: m, of it; ``extent``: (2, i), m; ValueError if these are none.
        """
        self._middle = np.array(centre, dtype=np.float64)
        self.dim, self.size, self.extent = len(self._middle), float(size), extent
        if not (np.isfinite(size) and size > 0.0 and np.all(np.isfinite(self._middle))):
            raise ValueError(f"a rigid surface of size {size:g} m at {self._middle}")
        corners = _simplex(self.dim)
        self.control_points = self._middle + self.size * corners
        # Σ_a Z_a Z_aᵀ = (d + 1)/d I for the corners Z_a of the simplex in the unit sphere.
        self._gradients = (self.dim / (self.dim + 1) / self.size) * corners
        self.stencil = np.tile(np.arange(self.dim + 1, dtype=np.int32), (facets, 1))

    @property
    def neighbours(self) -> scipy.sparse.csr_matrix:
        """(f, f): every facet, as all have the same control points."""
        count = len(self.stencil)
        return scipy.sparse.csr_matrix(np.ones((count, count), dtype=np.int32))

    # -- in the undeformed place ----------------------------------------------------------------

    @abstractmethod
    def _project(
        self,
        points: Floats,
        frozen_facets: Ints | None,
        rays: PointNormals | None,
        fading: Floats | None,
    ) -> Projection:
        """:meth:`project` of pulled back points and rays."""

    @abstractmethod
    def at(self, facet: Ints, xi: Floats) -> Places:
        """The undeformed surface at the places ξ (q, α) of facets (q,)."""

    @abstractmethod
    def outline(self, box: Floats, count: int = 64) -> Outline:
        """The undeformed surface as lines or triangles.

        ``box``: (2, i), m, which infinite ones are drawn across; ``count``: of lines a round piece
        has.
        """

    def excess(self, facet: Ints, xi: Floats) -> Floats:
        """No place of a smooth surface is at an edge."""
        return np.full(len(xi), -np.inf)

    def cut_off(self, facet: Ints, xi: Floats) -> Bools:
        """Whether places (q,) are at an open round end, where contact would go on; not an edge."""
        return np.zeros(len(xi), dtype=bool)

    # -- carried along --------------------------------------------------------------------------

    def for_others(self) -> RigidSurface:
        """The same for other points than those whose search goes on from the last one."""
        return self

    def project(
        self,
        points: Floats,
        nodes: Floats,
        frozen_facets: Ints | None = None,
        rays: PointNormals | None = None,
        fading: Floats | None = None,
    ) -> Projection:
        """See :meth:`tribox.geometry.surfaces.projection.FacetSurface.project`.

        ``nodes``: control points; ValueError if they are not moved as a rigid body is.
        """
        turn, shift = self._motion(nodes)
        back = None if rays is None else replace(rays, normal=rays.normal @ turn)
        # Pulled back by Rᵀ, as rows: (Rᵀ v)ᵀ = vᵀ R. Forwards it is vᵀ Rᵀ.
        here = self._middle + (points - shift) @ turn
        out = self._project(here, frozen_facets, back, fading)
        out.foot = shift + (out.foot - self._middle) @ turn.T
        out.tangents = out.tangents @ turn.T
        out.normal = out.normal @ turn.T
        if out.curvature is not None:
            out.curvature = out.curvature @ turn.T
        if out.share_turn is not None:
            out.share_turn = out.share_turn @ turn.T
        if rays is not None:
            out.normal, out.rays = rays.normal, rays
        return out

    def moved(self, points: Floats, nodes: Floats) -> Floats:
        """Undeformed points (p, i), m, of the tool where the control points ``nodes`` are now."""
        turn, shift = self._motion(nodes)
        return shift + (points - self._middle) @ turn.T

    def places(self, facet: Ints, xi: Floats, nodes: Floats) -> tuple[Floats, Floats]:
        """Points ȳ (q, i) and tangents (q, α, i) of material places, on control points (a, i)."""
        turn, shift = self._motion(nodes)
        at = self.at(facet, xi)
        return shift + (at.place - self._middle) @ turn.T, at.tangents @ turn.T

    def smooth_normals(self, facet: Ints, xi: Floats, nodes: Floats) -> Floats:
        """See :meth:`tribox.geometry.surfaces.projection.FacetSurface.smooth_normals`."""
        return normals(self.places(facet, xi, nodes)[1])

    def weights(self, facet: Ints, xi: Floats) -> Floats:
        """N_a (q, a) at the place ξ (q, α) of each facet (q,)."""
        return self.shares(self.at(facet, xi).place)

    def shares(self, places: Floats) -> Floats:
        """N_a (q, a) at undeformed places (q, i), m, of the tool, on its surface or not."""
        return 1.0 / (self.dim + 1) + (places - self._middle) @ self._gradients.T

    def slopes(self, facet: Ints, xi: Floats) -> Floats:
        """∂N_a/∂ξ^α (q, α, a)."""
        return self.at(facet, xi).tangents @ self._gradients.T

    def _motion(self, nodes: Floats) -> tuple[Floats, Floats]:
        """Rotation (i, j) and the place (i,) of M now."""
        # The gradient Σ_a y_a ⊗ G_a of the linear interpolation: of a rigid motion it is the
        # rotation.
        turn: Floats = nodes.T @ self._gradients
        if np.abs(turn.T @ turn - np.eye(self.dim)).max() > RIGID:
            raise ValueError("the control points of a rigid surface are strained")
        return turn, nodes.mean(axis=0)


class RigidShape(RigidSurface):
    """A surface given by formulae."""

    def __init__(self, facets: int, centre: Floats, size: float, extent: Floats) -> None:
        super().__init__(facets, centre, size, extent)
        self.search = Unsearched(0.5 * self.size)

    @abstractmethod
    def closest(self, points: Floats, frozen_facets: Ints | None) -> Feet:
        """Closest points of (q, i), m, all undeformed."""

    def hits(self, points: Floats, normals: Floats, feet: Feet) -> tuple[Feet, Bools]:
        """Where rays from points (q, i) along ± normals (q, i) meet the surface, and whether.

        Only surfaces with kinks are met so.
        """
        raise NotImplementedError(f"{type(self).__name__} has no kinks to be met along rays")

    def fade(self, out: Projection, reach: Floats) -> None:
        """Let points fade over the way ``reach`` (q,), m, up to where a line in the plane ends."""

    def _project(
        self,
        points: Floats,
        frozen_facets: Ints | None,
        rays: PointNormals | None,
        fading: Floats | None,
    ) -> Projection:
        feet = self.closest(points, frozen_facets)
        met = np.ones(len(points), dtype=bool) if feet.on_surface is None else feet.on_surface
        if rays is not None:
            feet, met = self.hits(points, rays.normal, feet)
        at = self.at(feet.facet, feet.xi)
        normal = normals(at.tangents) if rays is None else rays.normal
        out = Projection(
            facet=feet.facet,
            xi=feet.xi,
            foot=at.place,
            normal=normal,
            tangents=at.tangents,
            gap=np.einsum("qi,qi->q", points - at.place, normal),
            clamped=np.zeros(len(points), dtype=bool),
            on_surface=met,
            curvature=at.curvature,
            rays=rays,
        )
        if self.dim == 3:
            out.along = np.zeros_like(feet.xi) if feet.along is None else feet.along
        if feet.outward is not None:
            out.clamped = ~np.isnan(feet.outward[:, 0])
            at_end = np.nonzero(out.clamped)[0]
            out.clamp(at_end, points[at_end], feet.outward[at_end])
        if fading is not None:
            self.fade(out, fading)
        return out


def normals(tangents: Floats) -> Floats:
    """Unit normals (q, i) of tangents (q, α, i): τ turned left by 90°, or τ_1 × τ_2."""
    if tangents.shape[1] == 1:
        across = np.stack([-tangents[:, 0, 1], tangents[:, 0, 0]], axis=1)
    else:
        across = np.cross(tangents[:, 0], tangents[:, 1]).astype(np.float64)
    return across / np.linalg.norm(across, axis=1)[:, None]


def unit(vector: Floats, what: str) -> Floats:
    """A direction (i,) from a vector; ValueError, naming ``what``, if it is zero or not finite."""
    given = np.array(vector, dtype=np.float64)
    size = np.linalg.norm(given)
    if not (np.isfinite(size) and size > 0.0):
        raise ValueError(f"{what} has no direction: {given}")
    return given / size


def _simplex(dim: int) -> Floats:
    """Corners (dim + 1, i) of a regular simplex in the unit sphere."""
    if dim == 2:
        angle = 0.5 * np.pi + np.arange(3) * (2.0 * np.pi / 3.0)
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)


# -- The motion of a rigid tool: a displacement and one angle, as two reference nodes hold them ----
#
# Axis letters: a control points, i, j space. The first reference node carries the displacement c of
# the centre, the second one's first component θL, an angle times a length, so that all unknowns are
# lengths. Control points Y_a are carried along,
#
# .. math:: y_a = C + c + R(\theta)(Y_a - C), \qquad
#    R = I + \sin\theta\, W + (1 - \cos\theta)\, W^2,
#
# with W the cross product with the axis (Rodrigues); in the plane the axis points out of it.


@dataclass(frozen=True, slots=True, eq=False)
class RigidMotion:
    """How control points follow the displacement c and the angle θ of a tool."""

    centre: Floats  # (i,), m, reference: C, about which the tool turns; it moves with c
    points: Floats  # (a, i), m, reference: Y_a
    length: float  # m: L, that the angle is multiplied by as an unknown
    axis: Floats | None = None  # (3,) of the rotation in space, of any length; None in the plane
    _spin: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Find W; ValueError for no length, or an axis missing in space or given in the plane."""
        if not (np.isfinite(self.length) and self.length > 0.0):
            raise ValueError(f"the length of a rotation must be positive, not {self.length:g}")
        if (self.axis is None) != (self.dim == 2):
            raise ValueError("a rotation has an axis in space, and none in the plane")
        object.__setattr__(self, "_spin", self._cross())

    def _cross(self) -> Floats:
        """W (i, j)."""
        if self.axis is None:
            return np.array([[0.0, -1.0], [1.0, 0.0]])
        size = np.linalg.norm(self.axis)
        if not (np.isfinite(size) and size > 0.0):
            raise ValueError(f"the axis of a rotation has no direction: {self.axis}")
        x, y, z = np.asarray(self.axis) / size
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])

    @property
    def dim(self) -> int:
        """Of space."""
        return int(np.shape(self.points)[1])

    def read(self, values: Floats) -> tuple[Floats, float]:
        """Displacement c (i,), m, and angle θ, rad, from the reference nodes' values (2, i), m."""
        return values[0], float(values[1, 0]) / self.length

    def rotation(self, theta: float) -> Floats:
        """R (i, j)."""
        w = self._spin
        return np.eye(self.dim) + np.sin(theta) * w + (1.0 - np.cos(theta)) * (w @ w)

    def control_points(self, displacement: Floats, theta: float) -> Floats:
        """y_a (a, i), m, current, for c (i,), m, and θ, rad, about the axis or anticlockwise."""
        return self.centre + displacement + self._arms() @ self.rotation(theta).T

    def tangent(self, theta: float) -> Floats:
        """T = ∂y_a/∂(c, θL) (a, i, 2 · i), no unit, for all components of both nodes in turn.

        Those of the second node but the first do nothing.
        """
        out = np.zeros((len(self.points), self.dim, 2 * self.dim))
        out[:, :, : self.dim] = np.eye(self.dim)
        w = self._spin
        slope = np.cos(theta) * w + np.sin(theta) * (w @ w)
        out[:, :, self.dim] = self._arms() @ slope.T / self.length
        return out

    def bend(self, theta: float) -> Floats:
        """∂²y_a/∂(θL)² (a, i), 1/m; all other second derivatives are zero."""
        w = self._spin
        second = np.cos(theta) * (w @ w) - np.sin(theta) * w
        return self._arms() @ second.T / self.length**2

    def _arms(self) -> Floats:
        """Y_a − C (a, i), m."""
        return self.points - self.centre
