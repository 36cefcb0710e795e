"""Penalty contact of one pair with a friction law at its quadrature points.

Per point of the slave surface the traction t = t_N n − T acts on the slave and −t on the master,
with t_N = K_N⟨−g⟩ and T from the friction law. The virtual work ∫ t·(δu¹ − δu²(ξ̄)) dΓ₀ gives

    residual  R_c = −Gᵀ(w t)  (rows a only),      tangent  K_c = −Gᵀ C G,

with G the rows of the generalised coordinates z = (a, b_α, c, d) of
:mod:`forms.contact_kinematics` and C block diagonal per point: its rows a hold w ∂t/∂z, its rows
b_β hold −w t ⊗ ∂ξ^β/∂z, since the closest point moves under the load. Everything is vectorised
over the points q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from petsc4py import PETSc

from forms.contact_kinematics import Anchor, ContactKinematics, relate
from forms.film import FilmThickness, film_thickness
from forms.friction import FrictionLaw, FrictionResponse, FrictionState
from geometry.projection import (
    Floats,
    Ints,
    Projection,
    segment_shape,
    segment_shape_derivative,
)
from geometry.surface import ContactSurface, Longs


@dataclass(slots=True)
class ContactState:
    """What a converged step leaves at the points; nothing else is remembered.

    Attributes:
        facet: (q,) and xi: (q, α): the master material point Ȳ_n.
        slip_components: (q, α), e^α = τ^α·g_e on that facet; slip_length: (q,), m, L = |g_e|.
        gap: (q,), m; +inf where there was no projection on the surface.
        stretch: (q,) area stretch da/dA of the slave surface.
        friction: the law's own state; friction_traction: (q, i), Pa, T.
    """

    facet: Ints
    xi: Floats
    slip_components: Floats
    slip_length: Floats
    gap: Floats
    stretch: Floats
    friction: FrictionState
    friction_traction: Floats


@dataclass(slots=True)
class ContactTrial:
    """The contact of one set of displacements, against the last converged state.

    Attributes:
        position: (q, i), m, current; stretch: (q,) of today; pressure: (q,), Pa: t_N.
        film: (q,), m: D at that pressure.
        traction: (q, i), Pa, on the slave: t = t_N n − T, per reference area.
        response: the law's; its derivative for the pressure holds that through the film too.
    """

    position: Floats
    stretch: Floats
    projection: Projection
    kinematics: ContactKinematics
    pressure: Floats
    film: Floats
    traction: Floats
    response: FrictionResponse
    dt: float


class ContactTerm:
    """Residual, tangent, history and energy of one contact pair.

    Attributes:
        state: the committed :class:`ContactState`; changed by :meth:`commit` only.
    """

    def __init__(
        self,
        surface: ContactSurface,
        law: FrictionLaw,
        penalty: float,
        film: FilmThickness | Floats | float = 0.0,
    ) -> None:
        """Set up the undeformed contact.

        Args:
            surface: the pair's surfaces.
            law: friction law.
            penalty: K_N, Pa/m.
            film: film thickness D, m: one for all points, one for each, or a film.

        Raises:
            ValueError: a thickness is negative, not finite, or missing at a point.
        """
        self.surface = surface
        self.law = law
        self.penalty = penalty
        self.rate_dependent = True
        q = len(surface.slave.weight)
        self.film = film_thickness(film)
        self.film.at(np.zeros(q))  # Refuses a field that is not one of these points.
        points, nodes = surface.slave.position, surface.master.position
        at = surface.polyline.project(points, nodes, surface.polyline.candidates(points, nodes))
        self.state = ContactState(
            facet=at.facet,
            xi=at.xi,
            slip_components=np.zeros_like(at.xi),
            slip_length=np.zeros(q),
            gap=np.where(at.on_surface, at.gap, np.inf),
            stretch=np.ones(q),
            friction=law.initial_state(q, surface.dim),
            friction_traction=np.zeros((q, surface.dim)),
        )
        self._last: tuple[tuple[float, bool, float], Floats, Floats, ContactTrial] | None = None

    def evaluate(self, x: PETSc.Vec, dt: float) -> ContactTrial:
        """The contact at the displacements ``x`` (m) after a step of ``dt`` (s); collective.

        Nothing is changed; the evaluation of the same ``x`` twice in a row costs one gather.
        """
        slave, master = self.surface.displacements(x)
        key = (dt, self.rate_dependent, self.penalty)
        if self._last is not None and self._last[0] == key:
            _, last_slave, last_master, trial = self._last
            if np.array_equal(slave, last_slave) and np.array_equal(master, last_master):
                return trial
        trial = self._evaluate(slave, master, dt)
        self._last = (key, slave, master, trial)
        return trial

    def _evaluate(self, slave: Floats, master: Floats, dt: float) -> ContactTrial:
        polyline = self.surface.polyline
        points = self.surface.slave_positions(slave)
        nodes = self.surface.master.position + master
        today = polyline.project(points, nodes, polyline.candidates(points, nodes))
        kinematics = relate(points, today, self._anchor(nodes))
        pressure = self.penalty * np.where(kinematics.closed, np.maximum(-kinematics.gap, 0.0), 0.0)
        film, d_film = self.film.at(pressure)
        # State.friction holds the elastic slip of the last step; today's law sees it transported.
        response = self.law.update(
            kinematics.slip,
            dt,
            pressure,
            film,
            replace(self.state.friction, elastic_slip=kinematics.elastic_slip),
            area_stretch=self.state.stretch,
            rate_dependent=self.rate_dependent,
        )
        if d_film.any():
            through_film = d_film[:, None] * response.d_traction_d_film
            response = replace(
                response, d_traction_d_pressure=response.d_traction_d_pressure + through_film
            )
        return ContactTrial(
            position=points,
            stretch=self.surface.slave_stretch(slave),
            projection=today,
            kinematics=kinematics,
            pressure=pressure,
            film=film,
            traction=pressure[:, None] * kinematics.normal - response.traction,
            response=response,
            dt=dt,
        )

    def _anchor(self, nodes: Floats) -> Anchor:
        state = self.state
        ends = nodes[self.surface.master.facets[state.facet]]
        tangents = np.einsum("qba,qai->qbi", segment_shape_derivative(state.xi), ends)
        return Anchor(
            foot=np.einsum("qa,qai->qi", segment_shape(state.xi), ends),
            slip_image=np.einsum("qb,qbi->qi", state.slip_components, tangents),
            slip_length=state.slip_length,
            gap=state.gap,
        )

    def commit(self, trial: ContactTrial) -> None:
        """Make a converged trial the state that the next step starts from."""
        at = trial.projection
        slip = trial.response.state.elastic_slip
        metric = np.einsum("qai,qbi->qab", at.tangents, at.tangents)
        covariant = np.einsum("qai,qi->qa", at.tangents, slip)
        self.state = ContactState(
            facet=at.facet,
            xi=at.xi,
            slip_components=np.linalg.solve(metric, covariant[..., None])[..., 0],
            slip_length=np.linalg.norm(slip, axis=1),
            gap=np.where(at.on_surface, at.gap, np.inf),
            stretch=trial.stretch,
            friction=trial.response.state,
            friction_traction=trial.response.traction,
        )
        self._last = None

    def nodal_forces(self, trial: ContactTrial) -> tuple[Longs, Floats]:
        """Global nodes (q, m) and the residual −Gᵀ(w t) there (q, m, i), N per unit thickness."""
        slave = self.surface.slave
        at = trial.projection
        shape = np.concatenate([slave.shape, -segment_shape(at.xi)], axis=1)
        nodes = np.concatenate([slave.nodes, self._master_nodes(at.facet)], axis=1)
        force = -(slave.weight[:, None] * trial.traction)
        return nodes, shape[:, :, None] * force[:, None, :]

    def _master_nodes(self, facet: Ints) -> Longs:
        nodes: Longs = self.surface.master.nodes[self.surface.master.facets[facet]]
        return nodes

    def traction_variation(self, trial: ContactTrial) -> Floats:
        """∂t/∂z (q, i, r·j) with t = t_N n − T, through gap, normal, slip and elastic slip."""
        k, r = trial.kinematics, trial.response
        d_pressure = np.where(k.closed, -self.penalty, 0.0)[:, None] * k.d_gap
        out: Floats = (k.normal - r.d_traction_d_pressure)[:, :, None] * d_pressure[:, None, :]
        out += trial.pressure[:, None, None] * k.d_normal
        out -= r.d_traction_d_slip @ k.d_slip
        out -= r.d_traction_d_elastic @ k.d_elastic
        return out

    def tangent(self, trial: ContactTrial) -> tuple[Longs, Floats]:
        """Global nodes (q, m) and the blocks K_c = −Gᵀ C G (q, m, i, n, j) of closed points.

        Open points contribute nothing and are left out of both arrays.
        """
        take = np.nonzero(trial.kinematics.closed)[0]
        rows, nodes = self._generalised_rows(trial, take)
        q, dim = len(take), self.surface.dim
        coordinates = rows.shape[1]
        weight = self.surface.slave.weight[take]
        load = np.zeros((q, coordinates, dim, coordinates * dim))
        load[:, 0] = weight[:, None, None] * self.traction_variation(trial)[take]
        moved = weight[:, None] * trial.traction[take]
        d_xi = trial.kinematics.d_xi[take]
        load[:, 1:-2] = -moved[:, None, :, None] * d_xi[:, :, None, :]
        # Rows c and d carry no virtual work: leave them out of the left product.
        left = np.einsum("qrm,qris->qmis", rows[:, :-2], load[:, :-2], optimize=True)
        left = left.reshape(q, rows.shape[2] * dim, coordinates, dim)
        blocks = -np.einsum("qasj,qsn->qanj", left, rows, optimize=True)
        return nodes, blocks.reshape(q, rows.shape[2], dim, rows.shape[2], dim)

    def _generalised_rows(self, trial: ContactTrial, take: Longs) -> tuple[Floats, Longs]:
        """Coefficients (q, r, m) of z = (a, b_α, c, d) on the nodes (q, m) of each point."""
        slave, state = self.surface.slave, self.state
        xi, facet = trial.projection.xi[take], trial.projection.facet[take]
        mine = slave.shape[take]
        count, a = mine.shape
        surface = xi.shape[1]
        rows = np.zeros((count, 3 + surface, a + 4))
        now, before = slice(a, a + 2), slice(a + 2, a + 4)
        rows[:, 0, :a] = mine
        rows[:, 0, now] = -segment_shape(xi)
        rows[:, 1 : 1 + surface, now] = segment_shape_derivative(xi)
        rows[:, -2, :a] = mine
        rows[:, -2, before] = -segment_shape(state.xi[take])
        rows[:, -1, before] = np.einsum(
            "qb,qba->qa", state.slip_components[take], segment_shape_derivative(state.xi[take])
        )
        nodes = np.concatenate(
            [slave.nodes[take], self._master_nodes(facet), self._master_nodes(state.facet[take])],
            axis=1,
        )
        return rows, nodes

    def interface_energy(self, trial: ContactTrial) -> float:
        """Penalty and elastic-slip energy of this rank's points, J per unit thickness."""
        pressed = 0.5 * trial.pressure**2 / self.penalty
        stored = self.law.stored_energy(trial.response.state)
        return float(self.surface.slave.weight @ (pressed + stored))
