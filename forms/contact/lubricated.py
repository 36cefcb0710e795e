r"""Contact with a film that follows from pressure, speed, oil and roughness.

Axis letters: q, p points, v vertices of the slave, f its facets, the faces of the film, k vertices
of a facet, i space, m nodes of the pair. In the plane and with axial symmetry.

At each vertex the mean gap g_A between the mean planes gives the film h_T(g) and the pressure of
the asperities p_a(g), which takes the place of the penalty (:mod:`tribox.forms.film.roughness`),
and the balance of the oil gives the film's pressure p_f (:mod:`tribox.forms.film.reynolds`):

.. math:: t_N = j (p_a + p_f), \qquad T = T_{dry}(j p_a) + \theta j \eta \frac{V}{h}
   \pm j \frac{h}{2} \frac{\partial p_f}{\partial s}

per reference area, with the area ratio j = da/dA of the last converged step. The last term is the
shear on the wall whose normal carries the pressure, + of the slave's and − of the master's: with it
the film's momentum balances.

Newton's method of the bodies has no unknown of the film. Its equations are solved at every
evaluation, from the last w; their derivatives join the tangent
(:mod:`tribox.forms.contact.lubricated_tangent`). A film has few places: on several ranks each of
them solves for all of it, from sums over the points of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.forms.contact.asperities import AsperityPressure, FilmModel
from tribox.forms.contact.kinematics import ContactKinematics
from tribox.forms.contact.lubricated_tangent import LubricatedTangent, felt_speeds
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import (
    ContactMode,
    ContactTrial,
    Fading,
    FilmHistory,
    Lubrication,
    NormalContact,
)
from tribox.forms.film.places import FilmCells, FilmPart
from tribox.forms.film.reynolds import (
    UNFILLED,
    FilmError,
    FilmSolution,
    FilmStep,
    ReynoldsFilm,
    wedge_film,
)
from tribox.forms.friction.film_rheology import FilmRheology
from tribox.forms.friction.law import (
    FrictionLaw,
    FrictionResponse,
    Regime,
    without_stiffness,
)
from tribox.geometry.surfaces.facets import Bools, Floats, Longs, facet_shape
from tribox.geometry.surfaces.images import planes_of_symmetry
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.surface import ContactSurface

_LOADED = 1e-3  # of the largest pressure: less counts as no contact in results
_LEAST = 1e-3  # of a facet, that a film goes on by to an edge of the master
_DRY = 1e-3  # share of the asperities from which on a point counts as carried by the film
_TRACE = 1e-9  # of the pressure scale: the law of a map takes a film without asperities as closed


class LubricatedTerm(ContactTerm):
    """A contact pair whose film is an unknown.

    Attributes:
        model: of the film; asperities: the rule; faces: (f, 2) vertices of the slave's facets.
    """

    bounds_steps = True

    def __init__(
        self,
        surface: ContactSurface,
        law: FrictionLaw,
        model: FilmModel,
        modulus: float | None = None,
        held: Sequence[Longs] = (),
    ) -> None:
        """Set up the undeformed contact; collective.

        Args:
            surface: the pair's surfaces, in the plane.
            law: friction of the asperities, or a map.
            model: of the film.
            modulus: Pa, E* of both bodies together.
            held: by axis, global nodes that stay where they are along it: where the slave ends in a
                plane of symmetry nothing flows.

        Raises:
            ValueError: the pair is in space.
        """
        if surface.dim != 2:
            raise ValueError("a film as an unknown needs the plane or axial symmetry")
        super().__init__(surface, law, 1.0, modulus=modulus)
        self.model = model
        self.forgets = model.steady
        self.rule = self.asperities = AsperityPressure(surface, model)
        self.linearised = LubricatedTangent(surface, self.rule)
        self.places, self._face = self.rule.places, self.rule.facet_of
        self.faces: Longs = self.places.facets
        self._reference = np.linalg.norm(surface.slave.tangents[:, 0], axis=1)
        ends = surface.vertices.position[self.faces]
        self._length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        self._own = self._parts(np.ones(len(self._face)))
        self.places.close(self._unfed_ends(held))
        self._guess: Floats | None = None
        self._known: tuple[FilmHistory | None, list[tuple[FilmPart, FilmCells, Floats]]] = None, []
        self.state.film = self._initial()
        self._start_below()

    def _unfed_ends(self, held: Sequence[Longs]) -> Bools:
        """Vertices (v,) on the axis of revolution or at planes of symmetry, where nothing flows."""
        vertices, found = self.surface.vertices, np.zeros(self.surface.vertices.count, dtype=bool)
        if self.surface.axisymmetric:
            found |= vertices.position[:, 0] < 1e-9 * self._length.max()
        if held:
            here = np.stack([np.isin(vertices.nodes, nodes) for nodes in held], axis=1)
            line = facet_shape("interval", 1), self.faces.astype(np.int32), vertices.position
            for _, on in planes_of_symmetry(*line, here):
                found |= on
        return found

    def _start_below(self) -> None:
        """Let the next slip begin at the place below, pressed or not: films feel it in open gaps.

        Only past the end of the master it begins at that opposite, as if the master went on.
        """
        self.state.ahead[np.isfinite(self.state.gap)] = 0.0

    # -- film ---------------------------------------------------------------------------------

    def _initial(self) -> FilmHistory:
        """Before the first step."""
        vertices, places = self.surface.vertices, self.places
        at = self.surface.project(self.surface.slave.position, self.surface.master.position)
        gap = self.asperities.gaps(at)[0]
        part = places.part(np.isfinite(gap), self.asperities.covered(at))
        film: Floats = np.full(places.count, np.inf)
        film[part.here] = self.model.rough.film(part.gaps(gap, self._length[part.inside]))[0]
        content = np.full(places.count, self.model.oil)
        content = np.minimum(content, np.minimum(film, self.model.reach))
        film = np.where(np.isfinite(film), np.minimum(film, self.model.reach), np.inf)
        content = content if self._flooded else np.full(places.count, self.model.oil)
        volume = content * places.cells(self._length, self._own).area
        none, pressure = np.zeros(places.count), np.zeros(vertices.count)
        felt = self.asperities.gaps(at, self.asperities.spread)[0]
        return FilmHistory(none, film, volume, pressure, gap, felt, self._length, self._own, 0.0)

    def _parts(self, area_ratio: Floats) -> Floats:
        """Areas (f, 2), m² or of rings, that vertices have of facets at da/dA (q,); collective."""
        weighted = (self.surface.slave.weight * area_ratio)[:, None] * self.surface.vertices.shape
        return self.asperities.facet_sums(weighted.T).T

    @property
    def _flooded(self) -> bool:
        return not np.isfinite(self.model.oil)

    @property
    def _fed(self) -> bool:
        """Whether reservoirs feed the film at its ends."""
        return self._flooded or self.model.steady

    def _loaded(
        self,
        normal: NormalContact,
        at: Projection,
        kinematics: ContactKinematics,
        dt: float,
        mode: ContactMode,
    ) -> tuple[Floats, FrictionResponse]:
        """See :class:`ContactTerm`; the film's pressure joins that of the asperities."""
        history, vertices = self.state.film, self.surface.vertices
        assert history is not None and normal.gap is not None and normal.area is not None
        assert normal.nodal_pressure is not None and normal.stiffness is not None
        along, turned = self._along(kinematics, at)
        # A pair that is switched off has neither asperities nor film.
        none: Floats = np.zeros(vertices.count)
        members = normal.active if normal.active is not None else none > 0.0
        thickness, d_film = self.model.rough.film(normal.gap)
        part, cells, area = self._extent(at, members)
        film = Lubrication(
            members=members,
            film=np.where(members, thickness, self.model.reach),
            d_film=d_film,
            asperity=normal.nodal_pressure,
            d_asperity=-normal.stiffness,
            pressure=none,
            filled=np.ones_like(none),
            ratio=area / (vertices.area if normal.area is None else normal.area),
            along=along,
            turned=turned,
            sign=-1.0 if at.rays is None else 1.0,
            pulled=np.zeros(len(self.faces)),
            drawn=np.zeros(len(along)),
            by_film=np.zeros_like(along),
            by_filled=np.zeros_like(along),
            by_pressure=np.zeros_like(along),
            part=part,
            solver=None,
            step=None,
            solution=None,
        )
        if mode.rate_dependent and members.any():
            film = self._with_film(film, normal, kinematics, dt, (cells, self._oil(mode)))
        film, response = self._rubbed(film, normal, kinematics, dt, mode)
        self._press(normal, film)
        thickness = np.where(normal.closed, vertices.at_points(film.film), 0.0)
        return thickness, response

    def _extent(self, at: Projection, members: Bools) -> tuple[FilmPart, FilmCells, Floats]:
        """Places of the film on ``members`` (v,), their cells, and areas (v,) of the vertices, m².

        These are of the facets with the master below, and what goes on from there to its edge.
        """
        history, covered, size = self.state.film, self.asperities.covered(at), len(members)
        assert history is not None
        part = self.places.part(members, covered, self._fed)
        if self._known[0] is not history:
            self._known = history, []
        for known in self._known[1]:
            if known[0] is part:
                return known
        cells = self.places.cells(history.length, history.parts, covered if self._fed else None)
        cells, added = part.of(cells, self._beyond(at, part)), slice(len(part.faces), None)
        vertex, own = self.faces[covered].reshape(-1), history.parts[covered].reshape(-1)
        now: Floats = np.bincount(vertex, own, size).astype(np.float64)
        now = np.where(now > 0.0, now, self.surface.vertices.area)
        more = np.bincount(part.last, cells.length[added] * cells.width[added], size)
        found = part, cells, now + more
        if not len(part.edges):  # until the next step nothing changes but the way to the edges
            self._known[1].append(found)
        return found

    def _along(self, kinematics: ContactKinematics, at: Projection) -> tuple[Floats, Floats]:
        """Unit vectors (q, i) from the first end of the faces to the second, and their turn (q,).

        Vertices and facets keep their order, so that the undeformed facets tell where that is,
        turned with the normals.
        """
        right = np.stack([kinematics.normal[:, 1], -kinematics.normal[:, 0]], axis=1)
        turned = np.where(np.einsum("qi,qi->q", right, self._tangents) < 0.0, -1.0, 1.0)
        return turned[:, None] * right, turned

    def _evaluate(self, values: Floats, dt: float, mode: ContactMode) -> ContactTrial:
        displacement = values[self.surface.slave_rows]
        self._points = self.surface.slave_positions(displacement)
        self._tangents = self.surface.slave_tangents(displacement)[:, 0]
        trial = super()._evaluate(values, dt, mode)
        trial.faded = self._lost(trial)
        return trial

    def _oil(self, mode: ContactMode) -> FilmRheology:
        """The oil, thinned as the mode says."""
        oil = self.model.rheology
        if mode.thinned == 1.0:
            return oil
        return replace(oil, eta_b=mode.thinned * oil.eta_b, eta_inf=mode.thinned * oil.eta_inf)

    def speeds(self, along: Floats, slip: Floats, dt: float) -> Floats:
        """Half the master's velocity (f,) over the slave along the faces, m/s; collective."""
        moved = self.surface.slave.weight * np.einsum("qi,qi->q", slip, along)
        return self.asperities.facet_sums(moved) / self.asperities.whole * (-0.5 / dt)

    def _with_film(
        self,
        film: Lubrication,
        normal: NormalContact,
        kinematics: ContactKinematics,
        dt: float,
        given: tuple[FilmCells, FilmRheology],
    ) -> Lubrication:
        """The same with the pressure of the film; not a number where there is no solution."""
        model, history, part, (cells, oil) = self.model, self.state.film, film.part, given
        assert history is not None and normal.gap is not None and normal.area is not None
        solver = ReynoldsFilm(cells, oil, model.rough, model.scale)
        length = history.length[part.inside]
        thickness, by_gap = model.rough.film(part.gaps(normal.gap, length))
        fixed = cells.last() & self._fed
        fixed[: np.count_nonzero(part.members)] &= ~self.places.closed[part.members]
        unfed = np.bincount(part.ring, fixed) == 0
        if model.steady and unfed.any():  # nothing else says how much oil a ring has
            fixed |= part.widest(thickness, unfed)
        before, volume = (None,) * 2 if model.steady else self._at_start(part, thickness, cells)
        number, share, sense = felt_speeds(model.steady, part, self.asperities.whole)
        moved = self.speeds(film.along, kinematics.slip, dt)
        speed: Floats = np.bincount(number, share * moved[part.inside]).astype(np.float64)
        step = FilmStep(
            film=thickness,
            speed=(sense * speed[number])[part.feels],
            fixed=fixed,
            content=np.full(len(thickness), model.oil),
            dt=np.inf if model.steady else dt,
            before=before,
            volume=volume,
            by_gap=by_gap,
        )
        solution = self._solved(solver, step, part)
        if solution is None:
            none = np.where(film.members, np.nan, 0.0)
            return replace(film, solver=solver, step=step, pressure=none)
        pulled, faces = np.zeros(len(self.faces)), wedge_film(thickness[cells.ends])[0]
        pulled[part.inside] = part.pulls(faces, solution.pressure, length)
        parts = np.stack([np.ones(len(thickness)), solution.pressure, solution.filled], axis=1)
        whole, pressed, full = part.sums(cells.area, parts).T
        return replace(
            film,
            solver=solver,
            step=step,
            solution=solution,
            pressure=pressed / (film.ratio * normal.area),
            filled=np.where(film.members, full / np.where(film.members, whole, 1.0), 1.0),
            pulled=pulled,
        )

    def _at_start(self, part: FilmPart, film: Floats, cells: FilmCells) -> tuple[Floats, Floats]:
        """Film (m,), m, and oil (m,), m² or m³, of the places at the start of a step.

        Where the master was not yet below there is no film to be squeezed: it begins as it is.
        """
        history, count = self.state.film, part.count
        assert history is not None
        before, volume = film.copy(), film * cells.area
        known = np.isfinite(history.film[part.here])
        before[:count] = np.where(known, history.film[part.here], film[:count])
        before[count:] = before[part.inner]
        if self._fed:  # of a place at the end of the film it has a part, as full as the whole
            whole = self.places.cells(history.length, history.parts).area[part.here]
            held = history.volume[part.here] * (cells.area[:count] / whole)
            volume[:count] = np.where(known, held, volume[:count])
        else:
            volume[:count] = history.volume[part.here]
        return before, volume

    def _beyond(self, at: Projection, part: FilmPart) -> Floats:
        """Ways (x,), m, from the last vertices of a film to where the master ends; collective.

        That is where points past the end are projected to. Points that fade before it tell how far
        it is.
        """
        history, places, slave = self.state.film, self.places, self.surface.slave
        assert history is not None
        if not len(part.edges):
            return np.zeros(0)
        tangent = self._tangents / np.linalg.norm(self._tangents, axis=1)[:, None]
        share = np.ones(len(self._face)) if at.share is None else at.share
        to_end = np.einsum("qi,qi->q", at.foot - self._points, tangent)
        within = self.surface.vertices.shape[:, ::-1] * history.length[self._face][:, None]
        faded = np.where(share < 1.0, share * slave.reach, np.inf)[:, None]
        past = np.stack([to_end, -to_end], axis=1)
        way = within + np.where(at.on_surface[:, None], faded, past)
        nearest = np.full((len(self.faces), 2), np.inf)
        np.minimum.at(nearest, self._face, way)
        self.surface.vertices.comm.Allreduce(MPI.IN_PLACE, nearest, op=MPI.MIN)
        facet = np.nonzero(part.inside)[0][part.edges[:, 0]]
        next_facet, turned = (a[facet, part.edges[:, 1]] for a in (places.beside, places.turned))
        end = np.where(turned > 0.0, 1 - part.edges[:, 1], part.edges[:, 1])
        length = history.length[next_facet]
        return np.clip(nearest[next_facet, end], _LEAST * length, length)

    def _solved(self, solver: ReynoldsFilm, step: FilmStep, part: FilmPart) -> FilmSolution | None:
        """The film from the last w, that of the last step, or from full and empty places."""
        history, here = self.state.film, part.here
        assert history is not None
        number = solver.cells.band.number
        first = number < number[np.argmin(step.film)]
        ends = np.full(len(part.edges), -UNFILLED)
        starts = [np.concatenate([history.unknown[here], ends])]
        starts += [np.where(first == up, 0.05, -0.1) for up in (True, False)]
        if self._guess is not None:
            starts.insert(0, np.concatenate([self._guess[here], ends]))
        for start in starts:
            try:
                solution = solver.solve(step, start)
            except FilmError:
                continue
            self._guess = np.zeros(len(here))
            self._guess[here] = solution.unknown[: part.count]
            return solution
        return None

    def _press(self, normal: NormalContact, film: Lubrication) -> None:
        """Give the pair the pressure of asperities and film, per reference area."""
        vertices = self.surface.vertices
        nodal = np.where(film.members, film.ratio * (film.asperity + film.pressure), 0.0)
        normal.nodal_pressure, normal.lubrication = nodal, film
        spread = vertices.at_points(nodal, self.asperities.spread)
        normal.spring = np.where(normal.closed, spread, 0.0)
        at_points = np.where(normal.closed, vertices.at_points(nodal), 0.0)
        normal.pressure = at_points
        largest = vertices.comm.allreduce(float(np.max(at_points, initial=0.0)), op=MPI.MAX)
        normal.cover = np.where(at_points > _LOADED * largest, 1.0, 0.0)

    def bearable(self, trial: ContactTrial, there: PETSc.Vec) -> float:
        """See :class:`ContactTerm`.

        No gap closes by more than 0.7 h or 4 σ, nor opens by more than 2 h or 4 σ where it carries
        load, whichever is more: beyond that the tangent says nothing of film and asperities. What
        is sunk in, where they are crushed flat, opens to there besides.
        """
        film, surface = trial.normal_contact.lubrication, self.surface
        if film is None or trial.nodal_gap is None:
            return 1.0
        values = surface.gather(there)
        points = surface.slave_positions(values[surface.slave_rows])
        normals = surface.slave_normals(values)
        at = surface.project(points, surface.master_positions(values), None, normals, True)
        gap = self.asperities.gaps(at)[0]
        change = np.where(np.isfinite(gap), gap - trial.nodal_gap, np.inf)
        rough = 4.0 * self.model.rough.sigma
        here = film.members & np.isfinite(change)
        carried = film.asperity + film.pressure
        loaded = here & (carried > 0.01 * np.max(carried, initial=0.0))
        closed: Floats = change / np.maximum(0.7 * film.film, rough)
        closing = np.where(here, -closed, 0.0)
        opened: Floats = np.maximum(2.0 * film.film, rough) + np.maximum(-trial.nodal_gap, 0.0)
        opening = np.where(loaded, change / opened, 0.0)
        return float(1.0 / max(1.0, np.max(closing, initial=0.0), np.max(opening, initial=0.0)))

    # -- friction -----------------------------------------------------------------------------

    def _rubbed(
        self,
        film: Lubrication,
        normal: NormalContact,
        kinematics: ContactKinematics,
        dt: float,
        mode: ContactMode,
    ) -> tuple[Lubrication, FrictionResponse]:
        """Friction of asperities and film; the film with its derivatives."""
        vertices, closed = self.surface.vertices, normal.closed
        p_a = np.where(closed, vertices.at_points(film.ratio * film.asperity), 0.0)
        filled = vertices.at_points(film.filled)
        thickness = vertices.at_points(film.film)
        dry = replace(normal, pressure=p_a, cover=filled)
        if self.model.share == "map":
            dry.pressure = np.where(closed, p_a + _TRACE * self.model.scale, 0.0)
        response = self.respond(kinematics, dt, dry, thickness, mode.rate_dependent)
        film = replace(film, by_film=response.d_traction_d_film)
        if film.solution is not None:
            oil = self._oil(mode)
            film, response = self._sheared(film, response, kinematics, closed, dt, oil)
        if mode.friction_as_load:
            response = without_stiffness(response)
            flat = np.zeros_like(film.by_film)
            film = replace(film, by_film=flat, by_filled=flat, by_pressure=flat)
        return film, response

    def _sheared(
        self,
        film: Lubrication,
        response: FrictionResponse,
        kinematics: ContactKinematics,
        closed: Bools,
        dt: float,
        oil: FilmRheology,
    ) -> tuple[Lubrication, FrictionResponse]:
        """The friction with the film's shear, and its derivatives."""
        vertices, slip = self.surface.vertices, kinematics.slip
        h, pulled = vertices.at_points(film.film), film.pulled[self._face]
        p_f, filled = vertices.at_points(film.pressure), vertices.at_points(film.filled)
        drawn = np.where(closed, film.sign * 0.5 * self.state.area_ratio * pulled, 0.0)
        traction = response.traction + drawn[:, None] * film.along
        parts = response.dissipation
        if self.model.share == "map":
            squared = np.einsum("qi,qi->q", slip, slip) * filled
            resistance = np.zeros_like(squared)
            np.divide(parts.viscous, squared, out=resistance, where=squared > 0.0)
            film = replace(film, drawn=drawn, by_filled=resistance[:, None] * slip)
            return film, replace(response, traction=traction)
        rate = np.linalg.norm(slip, axis=1) / (dt * h)
        eta = oil.viscosity(rate, p_f)
        # Where all oil has flowed away θ is 0, and yet its derivative is not.
        per_filled = np.where(closed, vertices.at_points(film.ratio) / (dt * h), 0.0)
        per_slip = per_filled * filled
        sheared = (per_slip * eta.value)[:, None] * slip
        viscous = parts.viscous + np.einsum("qi,qi->q", sheared, slip)
        steeper = per_slip * eta.d_rate * rate
        d_slip = steeper[:, None, None] * film.along[:, :, None] * film.along[:, None, :]
        for i in range(slip.shape[1]):
            d_slip[:, i, i] += per_slip * eta.value
        thinner = (per_slip * (eta.value + eta.d_rate * rate) / h)[:, None] * slip
        p_a = vertices.at_points(film.asperity)
        wet = closed & (p_a < _DRY * (p_a + p_f))
        film = replace(
            film,
            drawn=drawn,
            by_film=film.by_film - thinner,
            by_filled=(per_filled * eta.value)[:, None] * slip,
            by_pressure=(per_slip * eta.d_pressure)[:, None] * slip,
        )
        return film, replace(
            response,
            traction=traction + sheared,
            d_traction_d_slip=response.d_traction_d_slip + d_slip,
            regime=np.where(wet, np.int8(Regime.VISCOUS), response.regime),
            dissipation=replace(parts, viscous=viscous),
        )

    def _felt(self, trial: ContactTrial) -> tuple[Floats, Floats]:
        """Gaps (v,), m, averaged as pressures are spread, and their way in the step but for them.

        That is what pressures do work on. Along normals of the slave a gap also closes as its place
        on the master moves on to a higher one, against which no pressure works.
        """
        at, spread = trial.projection, self.asperities.spread
        gap, area = self.asperities.gaps(at, spread)
        if at.rays is None or trial.anchor is None:
            return gap, np.zeros_like(gap)
        climbed = np.einsum("qi,qi->q", at.normal, at.foot - trial.anchor.foot)
        climbed *= self.surface.slave.weight * self.asperities.covered(at)[self._face]
        return gap, self.surface.vertices.sums(climbed, spread) / area

    def _lost(self, trial: ContactTrial) -> Fading | None:
        """What is not stored of the pressures' work in a step, and what drawing the film takes.

        By the trapezoidal rule: the film stores nothing, asperities do by the vertices' gaps.
        """
        normal, history = trial.normal_contact, self.state.film
        film = normal.lubrication
        assert history is not None
        if film is None or normal.gap is None or normal.area is None:
            return None
        known = film.members & np.isfinite(history.gap)
        felt, climbed = self._felt(trial)
        with np.errstate(invalid="ignore"):  # of vertices that are not known
            taken, stored = felt + climbed - history.felt, normal.gap - history.gap
        before = self.model.asperities.pressure(np.where(known, history.gap, 0.0))[0]
        mean = (film.pressure + history.pressure) * taken
        mean += (film.asperity + before) * (taken - stored)
        below = normal.area / self.surface.vertices.area  # share that has the master below it
        squeezed = np.where(known, -0.5 * film.ratio * below * mean, 0.0)
        drawn = film.drawn * np.einsum("qi,qi->q", film.along, trial.kinematics.slip)
        lost = self.surface.vertices.at_points(squeezed) + drawn
        return Fading(np.ones_like(lost), np.zeros_like(lost), lost)

    def commit(self, trial: ContactTrial) -> None:
        """See :class:`ContactTerm`; the film's content joins the history."""
        after = self.film_after(trial)
        super().commit(trial)
        self._start_below()
        self.state.film = after
        self._guess = None  # a run that goes on from a checkpoint has none either

    def film_after(self, trial: ContactTrial) -> FilmHistory:
        """The film that a step after this one starts from; collective."""
        history, film = self.state.film, trial.normal_contact.lubrication
        assert history is not None and film is not None
        weight, summed = self.surface.slave.weight, self.asperities.facet_sums
        here, gap, count = film.part.here, trial.normal_contact.gap, film.part.count
        assert gap is not None and trial.slave_tangents is not None
        longer = np.linalg.norm(trial.slave_tangents[:, 0], axis=1) / self._reference
        longer = summed(weight * longer) / self.asperities.whole
        length, parts = self._length * longer, self._parts(trial.area_ratio)
        area = self.places.cells(length, parts).area
        covered = self.places.part_of(self.asperities.covered(trial.projection))
        thickness = np.where(covered, self.model.reach, np.inf)
        before = history.length[film.part.inside]
        thickness[here] = self.model.rough.film(film.part.gaps(gap, before))[0][:count]
        volume, unknown = history.volume.copy(), history.unknown.copy()
        supplied = history.supplied
        if film.solution is not None:
            volume[here] = film.solution.volume[:count]
            if self._fed:  # what a place at an edge has besides is as full
                whole = self.places.cells(history.length, history.parts).area[here]
                volume[here] = (film.solution.filled[:count] * thickness[here]) * whole
            unknown[here] = film.solution.unknown[:count]
            supplied += float(film.solution.supply.sum()) * trial.dt
        if self._flooded:  # what no film has is under oil
            flooded = area * np.minimum(thickness, self.model.reach)
            volume = np.where(here & (film.solution is not None), volume, flooded)
        elif film.solution is None:
            volume = np.where(here, np.minimum(volume, area * thickness), volume)
            supplied += float(np.sum(volume - history.volume))  # pressed out
        return FilmHistory(
            unknown=unknown,
            film=thickness,
            volume=volume,
            pressure=film.pressure,
            gap=np.where(film.members, gap, np.inf),
            felt=self._felt(trial)[0],
            length=length,
            parts=parts,
            supplied=supplied,
        )
