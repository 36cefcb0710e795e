"""A contact pair in an explicit step: forces without tangents, search only when it is due.

The kinematics, the law and the history are those of :mod:`tribox.forms.contact.penalty`; the step
leaves out all variations. What an explicit step adds is the film's viscous traction c v, with v the
slip speed and c = alpha eta_b/D (da/dA). Taken at the speed of the last half step it would bound
the time step, hard for thin films. The semi-implicit treatment carries the film's traction τ from
step to step and corrects it, point by point, by what an implicit dashpot would add,

    δτ_q = (c_q v*_q − τ_q)/(1 + Δt c_q s_q),   s_q = Σ_a N_a(q) A_a/m_a   (both surfaces),

with v* the slip speed that follows if τ stays, and A_a = Σ_q w_q N_a(q) the area of node a. By
Jensen's inequality Σ_q w_q s_q τ_q² is at least the square of all points' impulses together over
the nodes' masses: the correction is one step of a contraction towards the implicit solution of all
points, whatever c. Impulses are equal and opposite; τ = c v is its fixed point, so that steady
sliding is exact; and the film's dissipation τ²/c is never negative.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tribox.forms.contact.kinematics import Carried, in_plane
from tribox.forms.contact.penalty import ContactTerm, carried_by
from tribox.forms.contact.pressure import (
    ROUNDOFF_DEPTH,
    AveragedPressure,
    PointwisePressure,
    fading,
)
from tribox.forms.contact.state import (
    AS_IS,
    ContactMode,
    ContactTrial,
    Dashpots,
    NormalContact,
)
from tribox.forms.contact.tie import TieTerm
from tribox.geometry.surfaces.facets import Floats, Longs
from tribox.geometry.surfaces.surface import NodalVector, SurfaceExchange

# Share of critical damping ζ_∞ of the dashpots beside a stiff penalty.
DAMPING = 0.3


class ExplicitContact:
    """One pair's forces on the bodies, and its history, step by step.

    Attributes:
        term: the pair, whose state is kept up to date.
        trial: the pair at the last evaluation.
        film_traction: (q, i), Pa, τ; film: (q,), Pa s/m, c of the last evaluation.
        dashpots: damping, Pa s/m, and mass, kg/m², of the vertices (v,), or point by point (q,);
            None: there are none. damped: (v,) or (q,), Pa, their pressure at the last evaluation.
        lost: J per unit thickness, what they took in the last step, this rank's part.
    """

    def __init__(self, term: ContactTerm) -> None:
        """Allocate the values at the points and nodes of ``term``; collective."""
        self.term = term
        surface = term.surface
        q, dim = len(surface.slave.weight), surface.dim
        self.film_traction = np.zeros((q, dim))
        self.film: Floats = np.zeros(q)
        self.compliance = np.zeros(q)
        self.trial: ContactTrial | None = None
        self._make_room()
        self._dry = np.zeros((q, dim))
        self.dashpots: tuple[Floats, Floats] | None = None
        self.damped: Floats = np.zeros(len(term.rule.penalty))
        self.lost = 0.0
        # Of the points of this rank, so that what is added up over vertices counts once.
        vertices, weight = surface.vertices, surface.slave.weight
        own = np.zeros(vertices.count)
        np.add.at(own, vertices.of_point, vertices.shape * weight[:, None])
        self._own_area: Floats = weight if self.by_points else own

    def _make_room(self) -> None:
        """For values at the pair's nodes."""
        self.exchange = SurfaceExchange(self.term.surface)
        self._values = np.zeros((len(self.exchange.nodes), self.term.surface.dim))
        self._other = np.zeros_like(self._values)

    def _gather(self, u: NodalVector) -> bool:
        """Gather displacements ``u``, m; whether there are more nodes now; collective."""
        self.exchange.gather(u, self._values)
        more = self.term.surface.follow(u.vec, self._values)
        if more:
            self._make_room()
            self.exchange.gather(u, self._values)
        return more

    @property
    def searches(self) -> int:
        """How often candidate facets were searched for."""
        return self.term.surface.target.search.searches

    @property
    def by_points(self) -> bool:
        """Whether each point has a pressure of its own, not each vertex of the slave."""
        return isinstance(self.term.rule, PointwisePressure)

    def film_arrays(self) -> dict[str, Floats]:
        """What is carried from step to step beside the state of the pair: (q, …), in place."""
        return {
            "film_traction": self.film_traction,
            "film": self.film,
            "compliance": self.compliance,
        }

    @property
    def searched_at(self) -> tuple[Floats, Floats] | None:
        """Places of points and facets, m, at the last search; None before it."""
        return self.term.surface.target.search.searched_at

    def search_at(self, points: Floats, facets: Floats) -> None:
        """Search for candidate facets where :attr:`searched_at` says."""
        self.term.surface.target.search.search(points, facets)

    # -- evaluation ---------------------------------------------------------------------------

    def evaluate(self, u: NodalVector, dt: float, rate_dependent: bool = True) -> ContactTrial:
        """The contact at the displacements ``u`` (m) after a step of ``dt`` (s); collective.

        Args:
            u: displacements, m.
            dt: s, length of the step.
            rate_dependent: whether rates count in the law. Where they do, :meth:`hold_film` and
                :meth:`correct_film` may follow.
        """
        self._gather(u)
        term, surface, mode = self.term, self.term.surface, self._mode(dt)
        slave = self._values[self.exchange.slave_rows]
        points = surface.slave_positions(slave)
        nodes = surface.master_positions(self._values)
        averaged = isinstance(term.rule, AveragedPressure)
        term.leave_to_others()
        projection = surface.project(points, nodes, fading=averaged)
        # Pressures first: they say which points are closed, and only these slip.
        normal = term.rule.evaluate(projection, mode, ROUNDOFF_DEPTH)
        if not term.active:
            normal = normal.opened()
        self._enter_damping(normal, projection.gap, mode)
        kinematics = term.related(points, nodes, projection, normal.closed)[1]
        film = term.film.at(normal.pressure)[0]
        normal.cover = None
        if term.has_film:
            term.cover_rim(normal, projection)
        response = term.respond(kinematics, dt, normal, film, rate_dependent, look_inside=False)
        self.trial = ContactTrial(
            position=points,
            area_ratio=surface.slave_area_ratio(surface.slave_tangents(slave), points),
            projection=projection,
            kinematics=kinematics,
            normal_contact=normal,
            film=film,
            traction=normal.pressure[:, None] * kinematics.normal - response.traction,
            response=response,
            dt=dt,
            carried=carried_by(surface, self._values),
            faded=fading(projection, normal, surface.vertices, term.state),
        )
        return self.trial

    def add_forces(self, out: NodalVector) -> None:
        """Add the residual −Gᵀ(w t), N per unit thickness, of the last evaluation; collective."""
        assert self.trial is not None
        self.spread(self.trial.traction, out)

    def spread(self, traction: Floats, out: NodalVector) -> None:
        """Add −Gᵀ(w t) of tractions ``traction`` (q, i), Pa, to ``out``; collective."""
        rows, shape = self._operator()
        load = -(self.term.surface.slave.weight[:, None] * traction)
        flat = rows.reshape(-1)
        # Points share nodes: bincount adds up what `values[rows] += …` would overwrite.
        for i in range(load.shape[1]):  # two or three components
            self._values[:, i] = np.bincount(
                flat, (shape * load[:, i, None]).reshape(-1), minlength=len(self._values)
            )
        # A tool: forces at its control points, taken to its displacement and angle.
        if self._carried is not None:
            self._values[-2:] = self._carried.forces(self._master_weights(), -load).sum(axis=0)
        self.exchange.add(self._values, out)

    def spread_weights(self, factor: float | Floats, out: NodalVector) -> None:
        """Add Σ_q w |N_a| Σ_b |N_b| of the points, times ``factor``, at every node a; collective.

        As a diagonal this bounds Σ_q w Nᵀ N. Both surfaces' shape functions add up to one, so that
        half of it is the area of the node. Beside a tool that turns the sums are larger.
        """
        rows, share = self._shares()
        every = np.maximum(2.0, share.sum(axis=1)) if self._carried is not None else 2.0
        share = share * (every * factor * self.term.surface.slave.weight)[:, None]
        area = np.bincount(rows.reshape(-1), share.reshape(-1), minlength=len(self._values))
        self._values[:] = area[:, None]
        self.exchange.add(self._values, out, sizes=True)

    def jump(self, values: Floats) -> Floats:
        """Slave less master (q, i) of values (m, i) at the pair's nodes."""
        rows, shape = self._operator()
        out: Floats = np.einsum("qm,qmi->qi", shape, values[rows])
        if self._carried is not None:
            out -= self._master_weights() @ self._carried.motions(values[-2:])
        return out

    @property
    def _carried(self) -> Carried | None:
        """How a tool's control points follow it, at the last evaluation; None without a tool."""
        return None if self.trial is None else self.trial.carried

    def _master_weights(self) -> Floats:
        """Shares (q, m) of the points that move the master in the closest points."""
        assert self.trial is not None
        at = self.trial.projection
        return self.term.surface.target.weights(at.facet, at.xi)

    def _operator(self) -> tuple[Longs, Floats]:
        """Rows (q, m) of the pair's nodes and their coefficients, of slave less master.

        Those of a tool, which are no numbers, are left out.
        """
        assert self.trial is not None
        at, surface = self.trial.projection, self.term.surface
        if self._carried is not None:
            return self.exchange.slave_rows, surface.slave.shape
        # The mortar operator G at the points: N¹ of the slave, −N²(ξ̄) of the master, so that one
        # set of coefficients gives jumps (G v) and forces (Gᵀ t).
        master = surface.target.stencil[at.facet] + self.exchange.first_master
        rows = np.concatenate([self.exchange.slave_rows, master], axis=1)
        return rows, np.concatenate([surface.slave.shape, -self._master_weights()], axis=1)

    def _shares(self) -> tuple[Longs, Floats]:
        """Rows (q, m) of the pair's nodes, and the size of their coefficients.

        A tool's displacement moves a point by as much, its angle by the arm over the length.
        """
        rows, shape = self._operator()
        if self._carried is None:
            return rows, np.abs(shape)
        count, carried = len(rows), self._carried
        turned = self._master_weights() @ carried.tangent[:, :, carried.dim]
        arm = np.linalg.norm(turned, axis=1)
        tool = self.exchange.first_master + np.broadcast_to(np.arange(2), (count, 2))
        share = np.concatenate([np.abs(shape), np.ones((count, 1)), arm[:, None]], axis=1)
        return np.concatenate([rows, tool], axis=1), share

    # -- film -----------------------------------------------------------------------------------

    def hold_film(self) -> None:
        """Replace the film's traction of the last evaluation by that of the step before."""
        assert self.trial is not None
        trial, response = self.trial, self.trial.response
        slip = trial.kinematics.slip
        squared = np.einsum("qi,qi->q", slip, slip)
        moving = squared > 0.0
        # A dashpot c dissipates c |Δg_T|²/Δt in a step: what the law says is viscous gives c back.
        resistance = np.zeros_like(squared)
        np.divide(response.dissipation.viscous, squared, out=resistance, where=moving)
        # The law gives no viscosity at a point that has not moved: the last one is kept.
        still = ~moving & (trial.pressure > 0.0)
        self.film = np.where(still, self.film, resistance * trial.dt)
        self._dry = response.traction - resistance[:, None] * slip
        self.film_traction = in_plane(trial.kinematics.normal, self.film_traction)
        self._apply_film()

    def _apply_film(self) -> None:
        assert self.trial is not None
        trial = self.trial
        friction = self._dry + self.film_traction
        trial.traction = trial.pressure[:, None] * trial.kinematics.normal - friction

    def correct_film(
        self,
        velocity: NodalVector,
        keep: float,
        acceleration: NodalVector,
        gain: float,
        out: NodalVector,
    ) -> None:
        """Correct the film's traction for the velocities that would follow; collective.

        Args:
            velocity: m/s, of the last half step.
            keep: how much of it is left at the next half step.
            acceleration: m/s², if the film's traction stayed.
            gain: s, what it adds to the velocity.
            out: residual that the change of the forces is added to.
        """
        assert self.trial is not None
        trial = self.trial
        self._gather_next(velocity, keep, acceleration, gain)
        relative = in_plane(trial.kinematics.normal, self.jump(self._values))
        change = self.film[:, None] * relative - self.film_traction
        # The implicit dashpot at a point alone: its own impulse changes v by −Δt s_q δτ.
        change /= (1.0 + trial.dt * self.film * self.compliance)[:, None]
        self.film_traction = self.film_traction + change
        self._apply_film()
        self._enter_film_work()
        self.spread(-change, out)

    def _gather_next(
        self, velocity: NodalVector, keep: float, acceleration: NodalVector, gain: float
    ) -> None:
        """Velocities of the next half step at the pair's nodes, into the values; collective."""
        self.exchange.gather(acceleration, self._values)
        self._values *= gain
        self.exchange.gather(velocity, self._other)
        self._other *= keep
        self._values += self._other

    def _enter_film_work(self) -> None:
        """Split the work of the traction τ that was applied: τ²/c is dissipated by the film.

        The rest, τ·slip − τ²/c, belongs to the time integration and is entered as numerical.
        """
        assert self.trial is not None
        trial, tau = self.trial, self.film_traction
        parts = trial.response.dissipation
        lost = np.einsum("qi,qi->q", tau, tau) * trial.dt
        viscous = np.zeros_like(lost)
        np.divide(lost, self.film, out=viscous, where=self.film > 0.0)
        work = np.einsum("qi,qi->q", tau, trial.kinematics.slip)
        trial.response = replace(
            trial.response,
            traction=self._dry + tau,
            dissipation=replace(
                parts, viscous=viscous, numerical=parts.numerical + (work - viscous)
            ),
        )

    def refresh_compliance(self, inverse_mass: Floats, work: NodalVector) -> None:
        """Find s_q: each point's area over the mass that it moves, m²/kg; collective.

        Args:
            inverse_mass: (n,), 1/m of the owned unknowns, 0 at constrained ones.
        """
        self.compliance[:] = self._compliance(inverse_mass, work)

    def _compliance(self, inverse_mass: Floats, work: NodalVector) -> Floats:
        work.owned[:] = 0.0
        self.spread_weights(0.5, work)
        work.owned[:] *= inverse_mass
        self.exchange.gather(work, self._values)
        rows, share = self._shares()
        return np.einsum("qm,qm->q", share, np.abs(self._values).max(axis=1)[rows])

    # -- dashpots -------------------------------------------------------------------------------

    def set_dashpots(self, modulus: float, inverse_mass: Floats, work: NodalVector) -> None:
        r"""Give the penalty dashpots, from the next step on; collective.

        .. math:: \zeta = \zeta_\infty \langle 1 - 2 M/(K h) \rangle

        of critical damping. Central differences need 4 − Δt² ω² − 4 ζ Δt ω_c > 0 with the frequency
        ω_c of the contact and ω of contact and elements. At Δt ω_c = √2, the limit for contacts
        that open and close, that is ζ < (2 − (ω/ω_c)²)/√8, or ζ < 1/√8 beside stiff contacts, where
        ω is ω_c. Beside soft ones the elements take that room. So dashpots shorten no step.

        Args:
            modulus: M, Pa, of the softer body; its elements answer to waves with M/h.
            inverse_mass: (n,), 1/m of the owned unknowns, 0 at constrained ones.
        """
        rule, slave = self.term.rule, self.term.surface.slave
        give, length = self._compliance(inverse_mass, work), slave.facet_length
        if isinstance(rule, AveragedPressure):
            length = rule.vertices.length
            give = rule.vertices.sums(slave.weight * give) / rule.vertices.area
        # Of the two bodies together, by action and reaction: 1/m = Σ over both surfaces.
        mass = np.divide(1.0, give, out=np.zeros_like(give), where=give > 0.0)
        left: Floats = 1.0 - 2.0 * modulus / (rule.penalty * length)
        ratio: Floats = DAMPING * np.maximum(left, 0.0)
        self.dashpots = 2.0 * ratio * np.sqrt(rule.penalty * mass), mass

    def dashpot_arrays(self) -> dict[str, Floats]:
        """What is known of the dashpots: (v,), the same on all ranks, or point by point (q,)."""
        if self.dashpots is None:
            return {}
        return {"damping": self.dashpots[0], "mass": self.dashpots[1], "damped": self.damped}

    def restore_dashpots(self, **kept: Floats) -> None:
        """Go on with the dashpots that :meth:`dashpot_arrays` has seen."""
        if kept:
            self.dashpots, self.damped = (kept["damping"], kept["mass"]), kept["damped"]

    def _mode(self, dt: float) -> ContactMode:
        """How a step of ``dt`` (s) is evaluated that starts at the last evaluation."""
        before = self._gap_before()
        if self.dashpots is None or before is None:
            return AS_IS
        return ContactMode(dashpots=Dashpots(*self.dashpots, before, dt))

    def _gap_before(self) -> Floats | None:
        """Gaps (v,), or point by point (q,), m, at the last evaluation; infinite off the master."""
        if self.trial is None:
            return None
        gap = self.trial.normal_contact.gap
        at = self.trial.projection
        return np.where(at.on_surface, at.gap, np.inf) if gap is None else gap

    def _enter_damping(self, normal: NormalContact, gap: Floats, mode: ContactMode) -> None:
        """What the dashpots take in the step that ends at gaps (q,), m, of the points.

        It follows the trapezoidal rule, as all work that the energy balance of a run knows.
        """
        self.lost = 0.0
        if mode.dashpots is None:
            return
        now = np.zeros_like(self.damped) if normal.damping is None else normal.damping
        way = mode.dashpots.way(gap if normal.gap is None else normal.gap)
        if normal.area is not None:
            way *= normal.area / self.term.surface.vertices.area
        self.lost = 0.5 * float((self.damped + now) @ (self._own_area * way))
        self.damped = now

    # -- history --------------------------------------------------------------------------------

    def commit(self) -> None:
        """Make the last evaluation the state that the next step starts from."""
        assert self.trial is not None
        self.term.commit(self.trial)


# -- A tied pair in an explicit step: the same forces as in an implicit one, and no history --------


class ExplicitTie(ExplicitContact):
    """See :class:`tribox.forms.contact.explicit.ExplicitContact`.

    Attributes:
        tie: the pair.
    """

    def __init__(self, tie: TieTerm) -> None:
        """Allocate the values at the nodes; collective."""
        super().__init__(tie)
        self.tie = tie

    def evaluate(self, u: NodalVector, dt: float, rate_dependent: bool = True) -> ContactTrial:
        self.exchange.gather(u, self._values)
        self.trial = self.tie.evaluate_at(self._values.copy(), dt)
        return self.trial

    def add_forces(self, out: NodalVector) -> None:
        assert self.trial is not None
        self.exchange.add(self.tie.forces(self.trial), out)

    def set_dashpots(self, modulus: float, inverse_mass: Floats, work: NodalVector) -> None:
        """See ``ExplicitContact.set_dashpots``; what is tied does not bounce, and has none."""
