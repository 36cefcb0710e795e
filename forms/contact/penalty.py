"""Penalty contact of one pair with a friction law at its quadrature points.

Per point of the slave surface the traction t = t_N n − T acts on the slave and −t on the master,
with t_N from the gaps (:mod:`tribox.forms.contact.pressure`) and T from the friction law. The
virtual work ∫ t·(δu¹ − δu²(ξ̄)) dΓ₀ gives the residual R_c = −Gᵀ(w t), with G the rows a of the
generalised coordinates of :mod:`tribox.forms.contact.kinematics`; the tangent is in
:mod:`tribox.forms.contact.tangent`. Everything is vectorised over the points q.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.forms.contact.interior_point import InteriorSlip
from tribox.forms.contact.kinematics import (
    Anchor,
    Carried,
    ContactKinematics,
    on_facet,
    opposite,
)
from tribox.forms.contact.pair_loops import Entries
from tribox.forms.contact.pressure import (
    ROUNDOFF_DEPTH,
    AveragedPressure,
    PressureKind,
    fading,
    normal_rule,
    rim_cover,
)
from tribox.forms.contact.shared_slave import Left, Neighbour, left_by_others
from tribox.forms.contact.state import (
    AS_IS,
    ContactMode,
    ContactState,
    ContactTrial,
    NormalContact,
)
from tribox.forms.contact.tangent import Coupling, PairTangent
from tribox.forms.friction.film import FilmThickness, film_thickness
from tribox.forms.friction.law import (
    FrictionLaw,
    FrictionResponse,
    FrictionState,
    presliding_length,
    without_stiffness,
)
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs, solve_small
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.surface import QUADRATURE_DEGREE, ContactSurface, RigidMaster

__all__ = ["AS_IS", "ContactMode", "ContactState", "ContactTerm", "ContactTrial"]


ROUNDED = 0.25
"""Residual that rounded gaps leave over ε K times the largest coordinate, all points alike.

Newton's method carried on stays between 0.2 and 0.5 of it, under tools of 10 m radius.
"""


@dataclass(frozen=True, slots=True)
class _Evaluation:
    """The last evaluation of a contact: what was asked, and the answer."""

    dt: float
    mode: ContactMode
    values: Floats
    trial: ContactTrial

    def answers(self, dt: float, mode: ContactMode, values: Floats) -> bool:
        same = np.array_equal(self.values, values)
        return self.dt == dt and self.mode.equals(mode) and same


class ContactTerm:
    """Residual, tangent, history and energy of one contact pair.

    Attributes:
        state: the committed :class:`ContactState`; changed by :meth:`commit` only.
        surface, law, film: of the pair; modulus: Pa, E*, or None.
        active: whether the surfaces feel each other; changed, as ``law`` may be, by :meth:`renew`.
        offset: (q,), m, by which the gap that is felt is wider than that between the surfaces:
            less than 0 where one is to be larger than it is drawn; None: nowhere.
        rule: from gaps to pressure, with the penalty; linearised: loops for slip, forces, tangent.
        neighbours: other contacts with the same slave (:mod:`tribox.forms.contact.shared_slave`).
        beside: (v, b) global nodes of the entries of blocks that belong to the slave's vertices,
            and couple with all that these do; None without any.
        tied: whether the surfaces are bonded (:mod:`tribox.forms.contact.tie`).
        bounds_steps: whether :meth:`bearable` may be less than 1.
        forgets: whether the way of the last steps says nothing of the next, as where each is the
            steady state of its speed.
    """

    tied = bounds_steps = forgets = False
    beside: Longs | None = None

    def __init__(
        self,
        surface: ContactSurface,
        law: FrictionLaw,
        penalty: float | Floats,
        film: FilmThickness | Floats | float = 0.0,
        pressure: PressureKind = "averaged",
        modulus: float | None = None,
    ) -> None:
        """Set up the undeformed contact.

        Args:
            penalty: Pa/m: one number, or one for each slave vertex (v,), or, with pressure point
                by point, for each point (q,).
            film: film thickness D, m: one for all points, one for each, or a film.
            pressure: "averaged" over the slave's vertices, or "pointwise".
            modulus: Pa, E* of both bodies together, 1/E* = Σ (1 − ν)/2G, from which the end of the
                contact within a facet is found; None: facets with some pressure count whole.

        Raises:
            ValueError: a thickness or a penalty is not one, or missing at a point; another kind of
                pressure.
        """
        self.surface = surface
        self.law, self.active, self.modulus = law, True, modulus
        self.offset: Floats | None = None
        self.neighbours: list[Neighbour] = []
        self.rule = normal_rule(pressure, surface, penalty)
        self._known_parts = -1  # none
        self._prepare_tangent()
        q = len(surface.slave.weight)
        self.film = film_thickness(film)
        self.film.at(np.zeros(q))  # Refuses a field that is not one of these points.
        points, nodes = surface.slave.position, surface.master.position
        at = surface.project(points, nodes)
        normals = surface.smooth_normals(at, nodes, surface.slave.tangents)
        ahead, way = opposite(at, points, *normals)
        history = law.initial_state(q, surface.dim)
        self.state = ContactState.undeformed(at, ahead, way, history)
        self._last: _Evaluation | None = None
        self._left: Left | None = None  # by neighbours, at the last step

    def _prepare_tangent(self) -> None:
        """Lay out the tangent over the master's facets that are known, where these are others."""
        if self._known_parts != self.surface.parts:
            self._known_parts = self.surface.parts
            self.linearised = PairTangent(self.surface, self.rule)

    @classmethod
    def between(
        cls,
        u: dolfinx.fem.Function,
        slave_facets: Ints,
        master_facets: Ints,
        law: FrictionLaw,
        penalty: float,
        quadrature_degree: int | None = None,
        pressure: PressureKind = "averaged",
        film: FilmThickness | float = 0.0,
    ) -> ContactTerm:
        """The contact of two surfaces of bodies that move by ``u`` (m); collective.

        Args:
            slave_facets: local facets (owned and ghosts) of the slave surface.
            master_facets: likewise, of the master surface.
            penalty: Pa/m.
            quadrature_degree: degree integrated exactly on an affine slave facet; None: 9 in the
                plane, 5 in space, as for cases.
            pressure: "averaged" over the slave's vertices, or "pointwise".
            film: film thickness D, m, or a film; for laws that ask for one.
        """
        space = u.function_space
        degree = quadrature_degree or QUADRATURE_DEGREE[space.mesh.geometry.dim]
        surface = ContactSurface(space, slave_facets, master_facets, degree)
        return cls(surface, law, penalty, film, pressure)

    @property
    def penalty(self) -> Floats:
        """Penalty, Pa/m, of each slave vertex (v,), or of each point (q,) if point by point."""
        return self.rule.penalty

    def evaluate(self, x: PETSc.Vec, dt: float, mode: ContactMode = AS_IS) -> ContactTrial:
        """The contact at the displacements ``x`` (m) after a step of ``dt`` (s); collective.

        Nothing is changed; the evaluation of the same ``x`` twice in a row costs one gather.
        """
        values = self.surface.gather(x)
        self._prepare_tangent()
        last = self._last
        # An averaged pressure is summed over the ranks: they must all evaluate, or none.
        known = last is not None and last.answers(dt, mode, values)
        if last is not None and self.surface.vertices.on_all_ranks(known):
            return last.trial
        trial = self._evaluate(values, dt, mode)
        self._last = _Evaluation(dt, mode, values, trial)
        return trial

    def _evaluate(self, values: Floats, dt: float, mode: ContactMode) -> ContactTrial:
        surface = self.surface
        slave = values[surface.slave_rows]
        points = surface.slave_positions(slave)
        nodes = surface.master_positions(values)
        averaged = isinstance(self.rule, AveragedPressure)
        normals = surface.slave_normals(values) if averaged else None
        tangents = surface.slave_tangents(slave)
        self.leave_to_others()
        current = surface.project(points, nodes, mode.frozen_facets, normals, averaged)
        if self.offset is not None:
            current.shift(self.offset)
        # Friction under the pressure of a rounded gap would tell at random where points stick.
        normal = self.rule.evaluate(current, mode, ROUNDOFF_DEPTH)
        if not self.active:
            normal = normal.opened()
        anchor, kinematics = self.related(points, nodes, current, normal.closed)
        film, response = self._loaded(normal, current, kinematics, dt, mode)
        return ContactTrial(
            position=points,
            area_ratio=surface.slave_area_ratio(tangents, points),
            projection=current,
            kinematics=kinematics,
            normal_contact=normal,
            film=film,
            traction=normal.spring[:, None] * kinematics.normal - response.traction,
            response=response,
            dt=dt,
            penalty_scale=mode.penalty_scale,
            anchor=anchor,
            of_point=surface.vertices.of_point,
            carried=carried_by(surface, values),
            faded=fading(current, normal, surface.vertices, self.state),
            slave_tangents=tangents,
            nodes=nodes,
        )

    def related(
        self, points: Floats, nodes: Floats, at: Projection, closed: Bools
    ) -> tuple[Anchor, ContactKinematics]:
        """Places of the last step, and slip, of points (q, i), m, over nodes (n, i), m."""
        self._prepare_tangent()
        brought = None if self._left is None else self._left.brought
        return self.linearised.relate(points, nodes, at, self.state, closed, brought)

    def _loaded(
        self,
        normal: NormalContact,
        at: Projection,
        kinematics: ContactKinematics,
        dt: float,
        mode: ContactMode,
    ) -> tuple[Floats, FrictionResponse]:
        """Complete the normal contact; film thickness (q,), m, and friction; collective."""
        if self.has_film:
            linearise, inside = not mode.friction_as_load, mode.interior is not None
            self.cover_rim(normal, at, mode.penalty_scale, linearise, inside)
        else:
            normal.cover = None
        return self._friction(kinematics, dt, normal, mode)

    def leave_to_others(self) -> None:
        """Find what other masters of the slave had at the last step; collective."""
        self._left = left_by_others(self, self._left)
        if self._left is not None and isinstance(self.rule, AveragedPressure):
            self.rule.others = self._left.area

    def cover_rim(
        self,
        normal: NormalContact,
        at: Projection,
        penalty_scale: float = 1.0,
        linearise: bool = False,
        inside: bool = False,
    ) -> None:
        """Find how much of the facets at the rim of the contact touches; collective.

        Args:
            normal: contact to be completed.
            at: projections of the points.
            penalty_scale: factor of the penalty that it was found with.
            linearise: whether the tangent will be asked for.
            inside: whether the pressures are interior points, so that open vertices carry some: a
                film that rubs on all of them would be of another problem.
        """
        stiffness = penalty_scale * self.rule.penalty
        normal.cover, slope = rim_cover(self.surface, normal, stiffness, self.modulus, inside)
        if at.share is not None:
            normal.cover = normal.cover * at.share
            slope = None if slope is None else slope * at.share[:, None]
        if not (linearise and self.has_film) or normal.active is None:
            return
        normal.cover_slope = slope
        felt = np.zeros(len(normal.active))
        if slope is not None:
            felt[self.surface.vertices.of_point[slope != 0.0]] = 1.0
        normal.rim = (self.surface.vertices.total(felt) > 0.0) & ~normal.active

    def cover(self, trial: ContactTrial) -> Floats | float:
        """Share (q,) of each point's piece of the surface that touches, see ``NormalContact``."""
        normal = trial.normal_contact
        if normal.cover is None:
            self.cover_rim(normal, trial.projection, trial.penalty_scale)
        assert normal.cover is not None
        return normal.cover

    @property
    def has_film(self) -> bool:
        """Whether the law has a part that acts on the covered area only."""
        return bool(getattr(self.law, "takes_film_cover", False))

    def _friction(
        self, kinematics: ContactKinematics, dt: float, normal: NormalContact, mode: ContactMode
    ) -> tuple[Floats, FrictionResponse]:
        """Film thickness (q,), m, and the law's answer, its derivatives through the film too."""
        film, d_film = self.film.at(normal.pressure)
        inside = None if mode.interior is None else mode.interior.slip
        response = self.respond(kinematics, dt, normal, film, mode.rate_dependent, inside=inside)
        if d_film.any():
            # D follows the pressure: its derivative joins that for the pressure by the chain rule.
            through_film = d_film[:, None] * response.d_traction_d_film
            response = replace(
                response, d_traction_d_pressure=response.d_traction_d_pressure + through_film
            )
        return film, without_stiffness(response) if mode.friction_as_load else response

    def respond(
        self,
        kinematics: ContactKinematics,
        dt: float,
        normal: NormalContact,
        film: Floats,
        rate_dependent: bool = True,
        look_inside: bool = True,
        inside: InteriorSlip | None = None,
    ) -> FrictionResponse:
        """The law's answer to kinematics and pressure at film thickness (q,), m.

        The committed state holds the elastic slip of the last step; the law sees it transported.
        Into a short, explicit step it need not look. ``inside``: in place of the onset of slip.
        """
        state, elastic = self.state.friction, kinematics.elastic_slip
        entering = ~state.closed & (self.state.slip_length > 0.0) & (normal.pressure > 0.0)
        # What was open and stays so has no elastic slip to lose.
        none = ~state.closed & (normal.pressure <= 0.0)
        if self._left is not None and self._left.brought is not None:
            state, taken = self._left.brought
            entering &= ~taken
        elastic = np.where(none[:, None], 0.0, elastic)
        more: dict[str, Any] = {}
        if self.has_film:
            more["film_cover"] = normal.cover
        if (inside or not look_inside) and getattr(self.law, "looks_inside", False):
            more["look_inside"] = False

        def answer(pressure: Floats, state: FrictionState) -> FrictionResponse:
            return self.law.update(
                kinematics.slip,
                dt,
                pressure,
                film,
                state,
                area_ratio=self.state.area_ratio,
                rate_dependent=rate_dependent,
                **more,
            )

        pressure, start = normal.pressure, replace(state, elastic_slip=elastic)
        if inside is not None:
            threshold = presliding_length(self.law, state, pressure)
            return inside.respond(answer, threshold, kinematics.slip, start, pressure)
        response = answer(pressure, start)
        if not entering.any():
            return response
        return _entered(response, entering, kinematics.slip, self.law.stored_energy(response.state))

    def coupled_pairs(self) -> Longs | None:
        """Pairs (p, 2) of global nodes that are coupled wherever bodies move, if they are known."""
        return None

    def roundoff_squared(self, x: PETSc.Vec, trial: ContactTrial) -> float:
        """Square, N², of what rounding leaves of the forces of a trial at ``x``; collective.

        This rank's part, per unit thickness.
        """
        force = self.rule.point_stiffness() * self.surface.slave.weight * (trial.pressure > 0.0)
        return float(force @ force) * self.rounded_gap**2

    @cached_property
    def rounded_gap(self) -> float:
        """What gaps are rounded by, m; collective.

        That is about ε times the largest undeformed coordinate they come from, which is the radius
        of a tool that is nearly flat.
        """
        places = (self.surface.slave.position, self.surface.master.position)
        span = max(float(np.abs(at).max(initial=0.0)) for at in places)
        span = self.surface.vertices.comm.allreduce(span, op=MPI.MAX)
        return float(ROUNDED * np.finfo(float).eps * span)

    def bearable(self, trial: ContactTrial, there: PETSc.Vec) -> float:
        """Share of a step of Newton's method to the displacements ``there`` (m) that is taken.

        Collective.

        Args:
            trial: at its start.
            there: at its end.
        """
        return 1.0

    def commit(self, trial: ContactTrial) -> None:
        """Make a converged trial the state that the next step starts from."""
        at = trial.projection
        slip = trial.response.state.elastic_slip
        metric = np.einsum("qai,qbi->qab", at.tangents, at.tangents)
        covariant = np.einsum("qai,qi->qa", at.tangents, on_facet(slip, at))
        # Contravariant components e^α: the elastic slip is convected with the master's tangents, as
        # if it were drawn on the facet, and comes back in `anchor`.
        components, length = solve_small(metric, covariant), np.linalg.norm(slip, axis=1)
        ahead = np.zeros_like(at.xi)
        if trial.slave_tangents is not None:
            opened = trial.pressure <= 0.0
            assert trial.nodes is not None
            normals = self.surface.smooth_normals(at, trial.nodes, trial.slave_tangents)
            there, way = opposite(at, trial.position, *normals)
            ahead = np.where(opened[:, None], there, 0.0)
            components = np.where((opened & (way > 0.0))[:, None], there, components)
            length = np.where(opened, way, length)
        self.state = ContactState(
            facet=at.facet,
            xi=at.xi,
            ahead=ahead,
            slip_components=components,
            slip_length=length,
            gap=np.where(at.on_surface, at.gap, np.inf),
            area_ratio=trial.area_ratio,
            share=self.state.share if trial.faded is None else trial.faded.share,
            sunk=self.state.sunk if trial.faded is None else trial.faded.sunk,
            friction=trial.response.state,
            friction_traction=trial.response.traction,
        )
        self._last = None

    def renew(
        self,
        active: bool | None = None,
        law: FrictionLaw | None = None,
        offset: Floats | None = None,
    ) -> None:
        """Take what a stage or a program of time has changed, from the next evaluation on.

        Args:
            active: whether the surfaces feel each other; None: as before.
            law: friction law with the same kind of state; None: as before.
            offset: (q,), m, see above; None: as before.
        """
        self.active = self.active if active is None else active
        self.law = self.law if law is None else law
        self.offset = self.offset if offset is None else offset
        self._last = None

    def adopt(self, state: ContactState) -> None:
        """Continue from a state that was found by other means than :meth:`evaluate`."""
        self.state = state
        self._last = None

    def forces_at_nodes(self, trial: ContactTrial) -> tuple[Longs, Floats, float]:
        """The residual summed up at global nodes, (n,) and (n, i), N per unit thickness.

        The third is the sum of the squares of what each point adds, but for moments on a tool,
        which grow with how far off its centre lies. A node may occur twice.
        """
        return self.surface.nodes, *self.linearised.forces(trial)

    def add_tangent(self, trial: ContactTrial, entries: Entries) -> list[Coupling]:
        """Add the tangent to a part of a matrix; what is not in that part; collective.

        Args:
            trial: whose tangent is to be added.
            entries: part of the matrix.
        """
        return self.linearised.add(self.state, trial, entries)

    def interface_energy(self, trial: ContactTrial) -> float:
        """Penalty and elastic-slip energy of this rank's points, J per unit thickness."""
        pressed = self.rule.energy(trial.normal_contact, trial.penalty_scale)
        stored = self.law.stored_energy(trial.response.state)
        return pressed + float(self.surface.slave.weight @ stored)


def carried_by(surface: ContactSurface, values: Floats) -> Carried | None:
    """How a tool's control points follow it, at values (m, i), m, of the pair's nodes.

    None without a tool.
    """
    master = surface.master
    if not isinstance(master, RigidMaster):
        return None
    return Carried.at(master.motion, values[surface.first_master :])


def _entered(
    response: FrictionResponse, entering: Bools, slip: Floats, stored: Floats
) -> FrictionResponse:
    """The work of points that come over the end: nothing was stored in the way up to there.

    Args:
        response: the law's.
        entering: (q,) such points.
        slip: (q, i), m, of the step.
        stored: (q,), J/m², after it.
    """
    parts = response.dissipation
    rest = np.einsum("qi,qi->q", response.traction, slip) - stored - parts.coulomb - parts.viscous
    return replace(
        response,
        dissipation=replace(
            parts,
            switching=np.where(entering, 0.0, parts.switching),
            numerical=np.where(entering, rest, parts.numerical),
        ),
    )
