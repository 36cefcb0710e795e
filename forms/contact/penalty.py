"""Penalty contact of one pair with a friction law at its quadrature points.

Per point of the slave surface the traction t = t_N n − T acts on the slave and −t on the master,
with t_N = K_N⟨−g⟩ and T from the friction law. The virtual work ∫ t·(δu¹ − δu²(ξ̄)) dΓ₀ gives

    residual  R_c = −Gᵀ(w t)  (rows a only),      tangent  K_c = −Gᵀ C G,

with G the rows of the generalised coordinates z = (a, b_α, c, d) of
:mod:`forms.contact.kinematics` and C block diagonal per point: its rows a hold w ∂t/∂z, its rows
b_β hold −w t ⊗ ∂ξ^β/∂z, since the closest point moves under the load. Everything is vectorised
over the points q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import dolfinx
import numpy as np
import scipy.sparse
from petsc4py import PETSc

from forms.contact.kinematics import Anchor, ContactKinematics, Variations, relate, vary
from forms.contact.state import AS_IS, ContactMode, ContactState, ContactTrial
from forms.friction.film import FilmThickness, film_thickness
from forms.friction.law import FrictionLaw, FrictionResponse
from geometry.surfaces.closest_point import solve_small
from geometry.surfaces.facets import Floats, Ints, Longs, unit_normals
from geometry.surfaces.projection import Projection
from geometry.surfaces.surface import QUADRATURE_DEGREE, ContactSurface

__all__ = ["AS_IS", "ContactMode", "ContactState", "ContactTerm", "ContactTrial"]

# Entries of point blocks that must be saved for a second group of them to pay for its overhead.
WORTH_FOLDING = 50_000


@dataclass(frozen=True, slots=True)
class _Evaluation:
    """The last evaluation of a contact: what was asked, and the answer."""

    dt: float
    mode: ContactMode
    slave: Floats
    master: Floats
    trial: ContactTrial

    def answers(self, dt: float, mode: ContactMode, slave: Floats, master: Floats) -> bool:
        return (
            self.dt == dt
            and self.mode.equals(mode)
            and np.array_equal(self.slave, slave)
            and np.array_equal(self.master, master)
        )


class ContactTerm:
    """Residual, tangent, history and energy of one contact pair.

    Attributes:
        state: the committed :class:`ContactState`; changed by :meth:`commit` only.
        penalty: K_N, Pa/m.
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
        q = len(surface.slave.weight)
        self.film = film_thickness(film)
        self.film.at(np.zeros(q))  # Refuses a field that is not one of these points.
        points, nodes = surface.slave.position, surface.master.position
        at = surface.project(points, nodes)
        self.state = ContactState(
            facet=at.facet,
            xi=at.xi,
            slip_components=np.zeros_like(at.xi),
            slip_length=np.zeros(q),
            gap=np.where(at.on_surface, at.gap, np.inf),
            area_ratio=np.ones(q),
            friction=law.initial_state(q, surface.dim),
            friction_traction=np.zeros((q, surface.dim)),
        )
        self._last: _Evaluation | None = None

    @classmethod
    def between(
        cls,
        u: dolfinx.fem.Function,
        slave_facets: Ints,
        master_facets: Ints,
        law: FrictionLaw,
        penalty: float,
        quadrature_degree: int | None = None,
    ) -> ContactTerm:
        """The contact of two surfaces of bodies that move by ``u`` (m); collective.

        Args:
            u: displacement.
            slave_facets: local facets (owned and ghosts) of the slave surface.
            master_facets: likewise, of the master surface.
            law: friction law.
            penalty: K_N, Pa/m.
            quadrature_degree: degree integrated exactly on an affine slave facet; None: 9 in the
                plane, 5 in space, as for cases.
        """
        space = u.function_space
        degree = quadrature_degree or QUADRATURE_DEGREE[space.mesh.geometry.dim]
        return cls(ContactSurface(space, slave_facets, master_facets, degree), law, penalty)

    def evaluate(self, x: PETSc.Vec, dt: float, mode: ContactMode = AS_IS) -> ContactTrial:
        """The contact at the displacements ``x`` (m) after a step of ``dt`` (s); collective.

        Nothing is changed; the evaluation of the same ``x`` twice in a row costs one gather.
        """
        slave, master = self.surface.displacements(x)
        last = self._last
        if last is not None and last.answers(dt, mode, slave, master):
            return last.trial
        trial = self._evaluate(slave, master, dt, mode)
        self._last = _Evaluation(dt, mode, slave, master, trial)
        return trial

    def _evaluate(
        self, slave: Floats, master: Floats, dt: float, mode: ContactMode
    ) -> ContactTrial:
        points = self.surface.slave_positions(slave)
        nodes = self.surface.master.position + master
        current = self.surface.project(points, nodes, mode.frozen_facets)
        anchor = self.anchor(nodes)
        kinematics = relate(points, current, anchor, mode.adhesive_gap)
        pull = np.inf if mode.adhesive_gap > 0.0 else 0.0  # depth that a closed point may pull with
        depth = np.where(kinematics.closed, np.maximum(-kinematics.gap, -pull), 0.0)
        stiffness = mode.penalty_scale * self.penalty
        spring = stiffness * depth
        pressure = np.maximum(spring, 0.0)
        film, response = self._friction(kinematics, dt, pressure, mode)
        return ContactTrial(
            position=points,
            area_ratio=self.surface.slave_area_ratio(slave),
            projection=current,
            kinematics=kinematics,
            pressure=pressure,
            film=film,
            traction=spring[:, None] * kinematics.normal - response.traction,
            response=response,
            dt=dt,
            stiffness=stiffness,
            anchor=anchor,
        )

    def _friction(
        self, kinematics: ContactKinematics, dt: float, pressure: Floats, mode: ContactMode
    ) -> tuple[Floats, FrictionResponse]:
        """Film thickness (q,), m, and the law's answer, its derivatives through the film too."""
        film, d_film = self.film.at(pressure)
        response = self.respond(kinematics, dt, pressure, film, mode.rate_dependent)
        if d_film.any():
            through_film = d_film[:, None] * response.d_traction_d_film
            response = replace(
                response, d_traction_d_pressure=response.d_traction_d_pressure + through_film
            )
        return film, _without_stiffness(response) if mode.friction_as_load else response

    def respond(
        self,
        kinematics: ContactKinematics,
        dt: float,
        pressure: Floats,
        film: Floats,
        rate_dependent: bool = True,
    ) -> FrictionResponse:
        """The law's answer to kinematics and pressure (q,), Pa, at film thickness (q,), m.

        The committed state holds the elastic slip of the last step; the law sees it transported.
        """
        return self.law.update(
            kinematics.slip,
            dt,
            pressure,
            film,
            replace(self.state.friction, elastic_slip=kinematics.elastic_slip),
            area_ratio=self.state.area_ratio,
            rate_dependent=rate_dependent,
        )

    def anchor(self, nodes: Floats) -> Anchor:
        """Places of the last converged step on the master's current ``nodes`` (n, i), m."""
        state = self.state
        foot, tangents = self.surface.target.places(state.facet, state.xi, nodes)
        return Anchor(
            foot=foot,
            slip_image=np.einsum("qb,qbi->qi", state.slip_components, tangents),
            slip_length=state.slip_length,
            gap=state.gap,
        )

    def commit(self, trial: ContactTrial) -> None:
        """Make a converged trial the state that the next step starts from."""
        at = trial.projection
        slip = trial.response.state.elastic_slip
        metric = np.einsum("qai,qbi->qab", at.tangents, at.tangents)
        covariant = np.einsum("qai,qi->qa", at.tangents, _on_facet(slip, at))
        self.state = ContactState(
            facet=at.facet,
            xi=at.xi,
            slip_components=solve_small(metric, covariant),
            slip_length=np.linalg.norm(slip, axis=1),
            gap=np.where(at.on_surface, at.gap, np.inf),
            area_ratio=trial.area_ratio,
            friction=trial.response.state,
            friction_traction=trial.response.traction,
        )
        self._last = None

    def adopt(self, state: ContactState) -> None:
        """Continue from a state that was found by other means than :meth:`evaluate`."""
        self.state = state
        self._last = None

    def nodal_forces(self, trial: ContactTrial) -> tuple[Longs, Floats]:
        """Global nodes (q, m) and the residual −Gᵀ(w t) there (q, m, i), N per unit thickness."""
        slave = self.surface.slave
        at = trial.projection
        master = self.surface.target.weights(at.facet, at.xi)
        shape = np.concatenate([slave.shape, -master], axis=1)
        nodes = np.concatenate([slave.nodes, self._master_nodes(at.facet)], axis=1)
        force = -(slave.weight[:, None] * trial.traction)
        return nodes, shape[:, :, None] * force[:, None, :]

    def _master_nodes(self, facet: Ints) -> Longs:
        nodes: Longs = self.surface.master.nodes[self.surface.target.stencil[facet]]
        return nodes

    def traction_variation(self, trial: ContactTrial, take: Longs) -> tuple[Floats, Variations]:
        """∂t/∂z (p, i, r·j) of the closed points ``take`` (p,), and that of their kinematics.

        t = t_N n − T changes through gap, normal, slip and elastic slip.
        """
        assert trial.anchor is not None
        v = vary(trial.position[take], trial.projection.of(take), trial.anchor.of(take))
        r, normal = trial.response, trial.kinematics.normal[take]
        d_pressure = -self._stiffness(trial) * v.d_gap
        out: Floats = (normal - r.d_traction_d_pressure[take])[:, :, None] * d_pressure[:, None, :]
        out += trial.pressure[take][:, None, None] * v.d_normal
        out -= r.d_traction_d_slip[take] @ v.d_slip
        out -= r.d_traction_d_elastic[take] @ v.d_elastic
        return out, v

    def tangent(self, trial: ContactTrial) -> list[tuple[Longs, Floats]]:
        """Global nodes (p, m) and the blocks K_c = −Gᵀ C G (p, m, i, n, j) of closed points.

        Points with the same nodes are added up where that saves much, and points that are still on
        the master facet of the last step need its nodes once only, so there may be two groups of
        blocks. Open points contribute nothing and are left out.
        """
        take = np.nonzero(trial.kinematics.closed)[0]
        size = self.surface.target.stencil.shape[1] * self.surface.dim
        stayed = trial.projection.facet[take] == self.state.facet[take]
        if 5 * np.count_nonzero(stayed) * size**2 < WORTH_FOLDING:
            return [self._blocks(trial, take)] if len(take) else []
        parts = [(take[stayed], True), (take[~stayed], False)]
        return [
            _added_up(self._point_facets(trial, part), *self._blocks(trial, part, folded))
            for part, folded in parts
            if len(part)
        ]

    def _blocks(
        self, trial: ContactTrial, take: Longs, folded: bool = False
    ) -> tuple[Longs, Floats]:
        """Nodes and blocks of points; ``folded``: their facet is still that of the last step."""
        rows, nodes = self._generalised_rows(trial, take)
        if folded:
            m = self.surface.target.stencil.shape[1]
            rows[:, :, -2 * m : -m] += rows[:, :, -m:]
            rows, nodes = rows[:, :, :-m], nodes[:, :-m]
        q, coordinates, m = rows.shape
        dim = self.surface.dim
        weight = self.surface.slave.weight[take]
        # Rows c and d carry no virtual work: they are left out of the left product.
        load = np.empty((q, coordinates - 2, dim, coordinates * dim))
        d_traction, v = self.traction_variation(trial, take)
        load[:, 0] = weight[:, None, None] * d_traction
        moved = weight[:, None] * trial.traction[take]
        load[:, 1:] = -moved[:, None, :, None] * v.d_xi[:, :, None, :]
        left = rows[:, :-2].transpose(0, 2, 1) @ load.reshape(q, coordinates - 2, -1)
        left = left.reshape(q, m * dim, coordinates, dim).transpose(0, 1, 3, 2)
        blocks = -(left.reshape(q, m * dim * dim, coordinates) @ rows)
        return nodes, blocks.reshape(q, m, dim, dim, m).transpose(0, 1, 2, 4, 3)

    def _point_facets(self, trial: ContactTrial, take: Longs) -> Longs:
        """Number (p,) of the facets that a point couples: its own, the present and the last."""
        masters = np.int64(len(self.surface.master.facets))
        slave, before = self.surface.slave.facet[take], self.state.facet[take]
        return (slave * masters + trial.projection.facet[take]) * masters + before

    def _generalised_rows(self, trial: ContactTrial, take: Longs) -> tuple[Floats, Longs]:
        """Coefficients (q, r, m) of z = (a, b_α, c, d) on the nodes (q, m) of each point."""
        slave, state = self.surface.slave, self.state
        target = self.surface.target
        xi, facet = trial.projection.xi[take], trial.projection.facet[take]
        mine = slave.shape[take]
        count, a = mine.shape
        surface, m = xi.shape[1], target.stencil.shape[1]
        rows = np.zeros((count, 3 + surface, a + 2 * m))
        now, before = slice(a, a + m), slice(a + m, a + 2 * m)
        rows[:, 0, :a] = mine
        rows[:, 0, now] = -target.weights(facet, xi)
        rows[:, 1 : 1 + surface, now] = target.slopes(facet, xi)
        rows[:, -2, :a] = mine
        last = state.facet[take], state.xi[take]
        rows[:, -2, before] = -target.weights(*last)
        components = state.slip_components[take]
        rows[:, -1, before] = np.einsum("qb,qbm->qm", components, target.slopes(*last))
        nodes = np.concatenate(
            [slave.nodes[take], self._master_nodes(facet), self._master_nodes(state.facet[take])],
            axis=1,
        )
        return rows, nodes

    def interface_energy(self, trial: ContactTrial) -> float:
        """Penalty and elastic-slip energy of this rank's points, J per unit thickness."""
        pressed = 0.5 * trial.pressure**2 / self._stiffness(trial)
        stored = self.law.stored_energy(trial.response.state)
        return float(self.surface.slave.weight @ (pressed + stored))

    def _stiffness(self, trial: ContactTrial) -> float:
        """The penalty that a trial was evaluated with, Pa/m."""
        return self.penalty if trial.stiffness is None else trial.stiffness


def _without_stiffness(response: FrictionResponse) -> FrictionResponse:
    """The same traction, as a load that does not change with motion and pressure."""
    none = np.zeros_like(response.d_traction_d_slip)
    return replace(
        response,
        d_traction_d_slip=none,
        d_traction_d_elastic=none,
        d_traction_d_pressure=np.zeros_like(response.d_traction_d_pressure),
    )


def _on_facet(slip: Floats, at: Projection) -> Floats:
    """Vectors (q, i) in the facets' planes whose images in the plane across n are ``slip`` (q, i).

    Where the projection is clamped, n is not the facet's normal n_f: q = g_e − n (n_f·g_e)/(n_f·n)
    gives (I − n⊗n) q = g_e again. A normal almost in the facet's plane
    changes nothing.
    """
    rows = np.nonzero(at.clamped)[0]
    if not len(rows):
        return slip
    out = slip.copy()
    n, facet = at.normal[rows], unit_normals(at.tangents[rows])
    between = np.einsum("qi,qi->q", n, facet)
    share = np.where(
        np.abs(between) > 0.1,
        np.einsum("qi,qi->q", slip[rows], facet) / np.where(between == 0.0, 1.0, between),
        0.0,
    )
    out[rows] -= share[:, None] * n
    return out


def _added_up(key: Longs, nodes: Longs, blocks: Floats) -> tuple[Longs, Floats]:
    """Nodes (p, m) and blocks (p, m, i, n, j) of points with the same ``key`` (q,), added up."""
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    ones, points = np.ones(len(key)), np.arange(len(key))
    adding = scipy.sparse.csr_matrix((ones, (group.reshape(-1), points)))
    # The order of the axes in memory, so that nothing is copied.
    plain = blocks.transpose(0, 1, 2, 4, 3)
    added = (adding @ plain.reshape(len(key), -1)).reshape(len(first), *plain.shape[1:])
    return nodes[first], added.transpose(0, 1, 2, 4, 3)
