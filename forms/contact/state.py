"""What a contact is evaluated under, what the evaluation gives, and what a converged step leaves.

Axis letters: q points, i space, α surface directions.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tribox.forms.contact.interior_point import InteriorPoint, SoftenedPoint
from tribox.forms.contact.kinematics import Anchor, Carried, ContactKinematics
from tribox.forms.film.places import FilmPart
from tribox.forms.film.reynolds import FilmSolution, FilmStep, ReynoldsFilm
from tribox.forms.friction.law import FrictionResponse, FrictionState
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
from tribox.geometry.surfaces.projection import Projection


@dataclass(frozen=True, slots=True)
class Dashpots:
    r"""Dashpots beside the springs of the penalty, at vertices (v,) or, point by point, (q,).

    A node that meets a stiff spring bounces on it. Central differences err by K d g/2 per area in
    every step that begins at an overlap d and ends at a gap g, or the other way round, and friction
    has no pressure to act under while the node is open. So where an explicit step ends closed

    .. math:: p = K \langle -g \rangle + c \, r, \quad r = (g_n - g_{n+1})/\Delta t, \quad
       c = 2 \zeta \sqrt{K m}

    with the mass m per area that gives way. The dashpot pulls at most as much as the spring
    pushes, and pushes at most until all of it stops the node in one step, p <= m r/Δt: by itself
    it never turns a node round.

    Attributes:
        damping: c, Pa s/m, and mass: m, kg/m².
        before: m, the gaps g_n at the start of the step, infinite where none is known; dt: s, its
            length.
    """

    damping: Floats
    mass: Floats
    before: Floats
    dt: float

    def pressure(self, gap: Floats, spring: Floats) -> Floats:
        """What the dashpots add to ``spring``, Pa, at gaps, m."""
        rate = self.way(gap) / self.dt
        most = np.maximum(self.mass / self.dt * rate - spring, 0.0)
        out: Floats = np.maximum(np.minimum(self.damping * rate, most), -spring)
        out[spring <= 0.0] = 0.0
        return out

    def way(self, gap: Floats) -> Floats:
        """By how much gaps have closed in the step, m."""
        out: Floats = self.before - gap
        out[np.isinf(out)] = 0.0
        return out


@dataclass(frozen=True, slots=True)
class ContactMode:
    """How a contact is evaluated; the default is the contact as it is.

    The other modes serve the search for a solution: what is committed was evaluated at a penalty
    scale of one (but for bodies that tools only carry along), with oil that is not thinned, without
    an adhesive gap, and with friction that has its stiffness.
    """

    # whether the friction law feels time; without, the film carries no stress
    rate_dependent: bool = True
    penalty_scale: float = 1.0  # factor of the penalty K_N
    thinned: float = 1.0  # factor of the viscosity of films that are found
    # m; points with a gap up to this count as closed and are pulled together
    adhesive_gap: float = 0.0
    # (q,) master facets that the points do not leave for a neighbour as soon as they pass an edge;
    # None where the closest point decides
    frozen_facets: Ints | None = field(default=None, compare=False)
    friction_as_load: bool = False  # whether friction is a given load without stiffness
    only_pressed: bool = False  # whether what touches without a pressure has no stiffness
    # pressures that take the place of the penalty's law; None: that law
    interior: InteriorPoint | SoftenedPoint | None = field(default=None, compare=False)
    # beside the penalty, in explicit steps
    dashpots: Dashpots | None = field(default=None, compare=False)

    def equals(self, other: ContactMode) -> bool:
        """Whether both are the same mode; what holds arrays must be the same object."""
        same = self.frozen_facets is other.frozen_facets and self.interior is other.interior
        return self == other and same


AS_IS = ContactMode()


@dataclass(frozen=True, slots=True)
class FilmHistory:
    """The film of a pair after a converged step, at places (n,), vertices (v,) and facets (f,)."""

    unknown: Floats  # w (n,)
    film: Floats  # h_T (n,), m, infinite with no master opposite
    volume: Floats  # (n,), m² or m³, oil
    pressure: Floats  # p_f (v,), Pa
    gap: Floats  # (v,), m
    felt: Floats  # (v,), m, the same averaged as pressures are spread
    length: Floats  # (f,), m, current
    parts: Floats  # (f, 2), m² or of rings, current, that each vertex has of a facet
    supplied: float  # m² or m³, oil that came in from the reservoirs since the start


@dataclass(frozen=True, slots=True)
class Lubrication:
    """The film of one set of gaps, at vertices (v,), facets (f,) and points (q,).

    Attributes:
        members: (v,) vertices that the film has; film: h_T (v,), m, and d_film: dh_T/dg (v,).
        asperity: p_a (v,), Pa, and d_asperity: dp_a/dg (v,), Pa/m; pressure: p_f (v,), Pa;
            filled: θ (v,). Pressures are per current area; ratio: (v,), of it to the undeformed
            area that gaps are averaged over, which ends before an edge of the master.
        along: (q, i) unit vectors from the first end of the points' faces to the second;
            turned: (q,) 1 or −1, whether they are the normals turned to the right; sign: 1 where
            the normal is the slave's, −1 where it is the master's.
        pulled: (f,), Pa, mean of h ∂p_f/∂s, per current area.
        drawn: (q,), Pa, traction along them from the gradient of the film's pressure.
        by_film, by_filled, by_pressure: ∂T/∂h (q, i), Pa/m, ∂T/∂θ, Pa, and ∂T/∂p_f.
        part: places that the film has; solver, step, solution: what was solved for them;
            None where the film does not feel time, or its equations have no solution.
    """

    members: Bools
    film: Floats
    d_film: Floats
    asperity: Floats
    d_asperity: Floats
    pressure: Floats
    filled: Floats
    ratio: Floats
    along: Floats
    turned: Floats
    sign: float
    pulled: Floats
    drawn: Floats
    by_film: Floats
    by_filled: Floats
    by_pressure: Floats
    part: FilmPart
    solver: ReynoldsFilm | None
    step: FilmStep | None
    solution: FilmSolution | None

    @property
    def is_unsolved(self) -> bool:
        """Whether the film's equations were not solved: then its pressure is no number."""
        return self.step is not None and self.solution is None

    @property
    def share(self) -> float:
        """What the film carries of the load that it bears with the asperities."""
        carried = float(self.ratio @ np.where(self.members, self.pressure, 0.0))
        both = carried + float(self.ratio @ np.where(self.members, self.asperity, 0.0))
        return carried / both if both > 0.0 else 0.0


@dataclass(slots=True)
class NormalContact:
    """Normal contact of one set of gaps."""

    closed: Bools  # (q,) points that carry pressure, or touch; all have a master below them
    spring: Floats  # (q,), Pa: t_N, negative where an adhesive gap pulls
    pressure: Floats  # (q,), Pa, t_N ≥ 0
    gap: Floats | None = None  # (v,), m, mean gaps of the vertices
    nodal_pressure: Floats | None = None  # (v,), Pa, s_A ≥ 0
    # (v,) whether a vertex carries pressure, or touches. None point by point
    active: Bools | None = None
    # (q,) share of each point's piece of the surface that touches: less than 1 only at the rim
    # (:mod:`tribox.forms.contact.pressure`), None as long as nobody has asked ``ContactTerm.cover``
    # for it
    cover: Floats | float | None = 1.0
    # (q, k), 1/m, its derivatives for the gaps of the facet's vertices, None where nothing asks for
    # them
    cover_slope: Floats | None = None
    rim: Bools | None = None  # (v,) open vertices that it depends on
    area: Floats | None = None  # (v,) that the gaps are averaged over; None: m_A
    # (v,) where that is what the master has below the vertex now; None: nowhere
    grows: Bools | None = None
    whole: Bools | None = None  # (q,) points whose gaps count, None: all with a master below
    # Pa/m, −∂t_N/∂g, of points (q,), or −∂s_A/∂g_A of vertices (v,); None where nobody will ask for
    # the tangent
    stiffness: Floats | None = None
    # Pa, part of s_A (v,), or of t_N (q,), that is the dashpots'; None without any
    damping: Floats | None = None
    # the film, part of the pressure, where it is an unknown; None elsewhere
    lubrication: Lubrication | None = None

    def opened(self) -> NormalContact:
        """The same gaps of surfaces that do not feel each other."""
        none = np.zeros_like(self.pressure)
        nothing = np.zeros_like(self.closed)
        if self.gap is None:
            return NormalContact(nothing, none, none.copy(), stiffness=none.copy())
        nodal, active = np.zeros(len(self.gap)), np.zeros(len(self.gap), dtype=bool)
        return NormalContact(
            nothing, none, none.copy(), self.gap, nodal, active, stiffness=nodal.copy()
        )

    def needs(self) -> Bools:
        """Vertices (v,) whose gaps the tractions depend on."""
        assert self.active is not None
        return self.active if self.rim is None else self.active | self.rim


@dataclass(frozen=True, slots=True)
class Fading:
    """The end of a master at the points."""

    share: Floats  # (q,), σ, 0 with no master below
    sunk: Floats  # (q,), J/m², s g ≤ 0
    lost: Floats  # (q,), J/m², in the step


@dataclass(slots=True)
class ContactState:
    """The history at the points: all that the next step knows of the converged ones.

    Attributes:
        facet: (q,) and xi: (q, α): the master material point Ȳ_n.
        ahead: (q, α), the way from there to the place that an open point is opposite
            (:func:`tribox.forms.contact.kinematics.opposite`), in components of the tangents; 0 of
            closed points.
        slip_components: (q, α), e^α = τ^α·g_e on that facet; slip_length: (q,), m, L = |g_e|. Of an
            open point past the end, which the asperities touch from there on only, the way ahead:
            it takes the slip up to the end away.
        gap: (q,), m; +inf where there was no projection on the surface.
        area_ratio: (q,) area ratio da/dA of the slave surface.
        share: (q,) and sunk: (q,), J/m²: see :mod:`tribox.forms.contact.pressure`.
        friction: the law's own state; friction_traction: (q, i), Pa, T.
        film: the film, where it is an unknown.
    """

    facet: Ints
    xi: Floats
    ahead: Floats
    slip_components: Floats
    slip_length: Floats
    gap: Floats
    area_ratio: Floats
    share: Floats
    sunk: Floats
    friction: FrictionState
    friction_traction: Floats
    film: FilmHistory | None = None

    @classmethod
    def undeformed(
        cls, at: Projection, ahead: Floats, way: Floats, friction: FrictionState
    ) -> ContactState:
        """Before the first step: all points are open.

        Args:
            at: the points (q,) on the master.
            ahead: (q, α), and
            way: (q,), m, see :func:`tribox.forms.contact.kinematics.opposite`.
            friction: the law's state.
        """
        return cls(
            facet=at.facet,
            xi=at.xi,
            ahead=ahead,
            slip_components=np.where(way[:, None] > 0.0, ahead, 0.0),
            slip_length=way,
            gap=np.where(at.on_surface, at.gap, np.inf),
            area_ratio=np.ones(len(way)),
            share=np.where(at.on_surface, 1.0, 0.0),
            sunk=np.zeros(len(way)),
            friction=friction,
            friction_traction=np.zeros_like(at.foot),
        )


@dataclass(slots=True)
class ContactTrial:
    """The contact of one set of displacements, against the last converged state.

    Attributes:
        position: (q, i), m, current; area_ratio: (q,), current.
        normal_contact: pressure and what it comes from.
        film: (q,), m: D at that pressure.
        traction: (q, i), Pa, on the slave: t = t_N n − T, per reference area.
        response: the law's; its derivative for the pressure holds that through the film too.
        penalty_scale: factor of the penalty that it was evaluated with.
        anchor: places of the last converged step, moved with the current master; None where nobody
            will ask for the tangent; of_point: (q, k) vertices of the points' facets, likewise.
        carried: how the control points of a tool follow its unknowns; None: no tool.
        pull: (v, i), Pa, s_A of a tie, and moved: (n, i), m, the displacements it is of; None of
            others.
        slave_tangents: (q, α, i), current, of the slave facets; None of ties, and where steps are
            so short that closest points serve as the places opposite; nodes: (n, i), m, current,
            that move the master, likewise.
        faded: (q,) and more of points at the end of the master; None point by point, and of ties.
    """

    position: Floats
    area_ratio: Floats
    projection: Projection
    kinematics: ContactKinematics
    normal_contact: NormalContact
    film: Floats
    traction: Floats
    response: FrictionResponse
    dt: float
    penalty_scale: float = 1.0
    anchor: Anchor | None = None
    of_point: Longs | None = None
    carried: Carried | None = None
    pull: Floats | None = None
    moved: Floats | None = None
    faded: Fading | None = None
    slave_tangents: Floats | None = None
    nodes: Floats | None = None

    def coupled(self) -> Bools:
        """Points (q,) whose gaps the tractions of some point depend on."""
        normal = self.normal_contact
        if normal.rim is None or not normal.rim.any() or self.of_point is None:
            return self.kinematics.closed
        near = normal.rim[self.of_point].any(axis=1)
        met = self.projection.on_surface if normal.whole is None else normal.whole
        return self.kinematics.closed | (near & met)

    @property
    def pressure(self) -> Floats:
        """Contact pressure t_N (q,), Pa."""
        return self.normal_contact.pressure

    @property
    def nodal_pressure(self) -> Floats | None:
        """Coefficients s_A (v,), Pa, of the contact pressure, linear between them; None pointwise.

        The pressure to show is :func:`tribox.forms.contact.pressure.nodal_pressure`.
        """
        return self.normal_contact.nodal_pressure

    @property
    def nodal_gap(self) -> Floats | None:
        """Mean gap of the slave vertices (v,), m; None point by point."""
        return self.normal_contact.gap
