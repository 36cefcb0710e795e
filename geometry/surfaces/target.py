"""What a master is to the contact: closest points, and the nodes that move them.

Axis letters: q slave points, f facets, m nodes that move a facet, n nodes, i space, α, β surface
directions. A facet here is any piece of a surface with coordinates ξ of its own: one facet of a
mesh (:mod:`tribox.geometry.surfaces.projection`), or one smooth piece of a rigid shape
(:mod:`tribox.geometry.surfaces.rigid`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # rigid shapes are made without DOLFINx
    import scipy.sparse

    from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
    from tribox.geometry.surfaces.slave_points import PointNormals


@dataclass(slots=True)
class Projection:
    """The closest master point of every slave point.

    Attributes:
        facet: (q,) master facet that carries the closest point.
        xi: (q, α) its reference coordinates.
        foot: (q, i), m, current: the closest point ȳ.
        normal: (q, i) unit outward normal of the master at ȳ; along x − ȳ where clamped.
        tangents: (q, α, i), m, current: τ_α = ∂ȳ/∂ξ^α.
        gap: (q,), m: g = (x − ȳ)·n, negative in penetration.
        clamped: (q,) the closest point is on an edge or a corner and cannot leave it.
        on_surface: (q,) False past the end of the master, where there is no contact.
        curvature: (q, α, β, i), m, current: ∂²ȳ/∂ξ^α∂ξ^β; None where all facets are flat.
        along: (q, α) reference direction of the edge that a clamped point can move along, zero at a
            corner; None in the plane, where there are corners only.
        share: (q,) how much of each point counts: less than 1 only beside the open end of a master,
            or where rays hardly face it; share_slope: (q, α) its derivatives for ξ. None: 1
            everywhere. share_turn: (q, i) that for the ray's normal over a master that does not
            turn; None: zero.
        rays: the slave's normals, where ȳ lies along them; None where it is the closest point.
    """

    facet: Ints
    xi: Floats
    foot: Floats
    normal: Floats
    tangents: Floats
    gap: Floats
    clamped: Bools
    on_surface: Bools
    curvature: Floats | None = None
    along: Floats | None = None
    share: Floats | None = None
    share_slope: Floats | None = None
    share_turn: Floats | None = None
    rays: PointNormals | None = None
    offset: Floats | None = None

    @property
    def distance(self) -> Floats:
        """(x − ȳ)·n (q,), m, the way between the surfaces as they lie, whatever is felt of it."""
        return self.gap if self.offset is None else self.gap - self.offset

    def shift(self, offset: Floats) -> None:
        """Let contact feel gaps that are wider by ``offset`` (q,), m: the master is set back."""
        self.gap, self.offset = self.gap + offset, offset

    def of(self, take: Longs) -> Projection:
        """The same of the points ``take`` (p,)."""
        return Projection(
            self.facet[take],
            self.xi[take],
            self.foot[take],
            self.normal[take],
            self.tangents[take],
            self.gap[take],
            self.clamped[take],
            self.on_surface[take],
            None if self.curvature is None else self.curvature[take],
            None if self.along is None else self.along[take],
            None if self.share is None else self.share[take],
            None if self.share_slope is None else self.share_slope[take],
            None if self.share_turn is None else self.share_turn[take],
            None if self.rays is None else self.rays.of(take),
            None if self.offset is None else self.offset[take],
        )


class Search(Protocol):
    """Which facets can hold the closest points, kept while little moves."""

    @property
    def slack(self) -> float:
        """A length, m, of the order of a facet."""
        ...

    @property
    def searches(self) -> int:
        """How often it was searched."""
        ...

    @property
    def searched_at(self) -> tuple[Floats, Floats] | None:
        """Points (q, i) and facets (f, a, i), m, of the last search; None: there was none."""
        ...

    def search(self, points: Floats, facets: Floats) -> None:
        """Search at these places, as :attr:`searched_at` gives them."""
        ...


class Target(Protocol):
    """A master: where its closest points are, and how they move with some nodes.

    The place ξ of a facet is ȳ = Σ_m N_m(ξ) y_m, with y_m the nodes of its stencil, for ever: a
    place of the last converged step can be asked for at any later time.
    """

    @property
    def stencil(self) -> Ints:
        """(f, m) rows of the nodes that move each facet."""
        ...

    @property
    def neighbours(self) -> scipy.sparse.csr_matrix:
        """(f, f), facets that a point may pass between, and each facet itself."""
        ...

    @property
    def search(self) -> Search:
        """For candidate facets."""
        ...

    @property
    def has_kinks(self) -> bool:
        """Whether facets in the plane meet at an angle: projected along the slave's normals."""
        ...

    def project(
        self,
        points: Floats,
        nodes: Floats,
        frozen_facets: Ints | None = None,
        rays: PointNormals | None = None,
        fading: Floats | None = None,
    ) -> Projection:
        """Closest points on the whole surface.

        Args:
            points: (q, i), m, current: slave points.
            nodes: (n, i), m, current: nodes that move the surface.
            frozen_facets: (q,) facets that the points do not leave for a neighbour at once.
            rays: normals of the slave at the points, to project along in the plane; None: closest
                points.
            fading: (q,), m, way up to an open end in the plane over which a point fades; None:
                points count in full up to there.
        """
        ...

    def places(self, facet: Ints, xi: Floats, nodes: Floats) -> tuple[Floats, Floats]:
        """Points ȳ (q, i) and tangents (q, α, i) of material places, on current nodes (n, i)."""
        ...

    def smooth_normals(self, facet: Ints, xi: Floats, nodes: Floats) -> Floats:
        """Normals (q, i), of any length, of a smooth surface through the facets, there."""
        ...

    def weights(self, facet: Ints, xi: Floats) -> Floats:
        """Shares N (q, m) of the nodes ``stencil`` in the place ξ (q, α) of each facet (q,)."""
        ...

    def slopes(self, facet: Ints, xi: Floats) -> Floats:
        """Derivatives (q, α, m) of :meth:`weights` for ξ."""
        ...

    def excess(self, facet: Ints, xi: Floats) -> Floats:
        """How far (q,), in ξ, places are past an edge where the normal jumps; ≤ 0: not past it."""
        ...
