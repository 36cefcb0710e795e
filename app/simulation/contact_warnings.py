"""Looks at every recorded step whether a contact is stiff, even and fine enough, pair by pair.

What is judged, and against what:

- **penetration** against the local length of the slave facets, and, weighted by pressure, against
  the approach of the bodies 2 U/N, U being their strain energy: where displacements are prescribed
  N is too small by about that share (by 1.2 times it for Hertz's contact, U = 2/5 N δ, N ~ δ^3/2).
  What bodies that flow dissipate is added once: their force changes little while they do.
  Where the force is given it flattens uneven pressures, by the penetration's standard deviation.
- **elastic slip** of points that stick, by its energy over that of the bodies: likewise.
- **evenness**, with the pressure point by point: a straight facet touches a curved master at a few
  points as soon as its sagitta h²/8R exceeds the penetration. Seen are the sagitta itself, the
  range of the gap along a facet less its linear part, which is that of both surfaces as they are
  deformed; the share of open points inside the pressed patch; the scatter of the pressure within
  facets.
- **resolution**: the facets that the rim of the contact crosses, whose length is what its place is
  uncertain by, against the half-width: from the rim to where it is furthest away.

Nothing depends on the number of ranks: a facet's points are on one of them, and what is known of
vertices is summed over all.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Kept, Remembers, Snapshot
from tribox.app.equilibrium.unknowns import place_text
from tribox.app.simulation.contact_resultants import over
from tribox.app.simulation.history import Row
from tribox.app.simulation.pair_bodies import GivenForces, penalty_factor
from tribox.app.simulation.surface_faults import (
    BENT,
    SHARP,
    WAVES,
    Sunk,
    SunkVertices,
    bend,
    softer_factor,
    waves,
    waves_text,
)
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import facet_length_along
from tribox.forms.contact.state import ContactTrial
from tribox.forms.friction.coulomb import StickingLaw
from tribox.forms.friction.factored_law import FactoredLaw
from tribox.forms.friction.law import Regime
from tribox.geometry.surfaces.facets import Bools, Floats, Longs, unit_normals
from tribox.geometry.surfaces.master import MasterFacets
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.smoothing import corner_spacing
from tribox.geometry.surfaces.surface import ContactSurface

# Largest penetration over the local facet length, and mean one over the approach, from which on
# they are warned of. On blocks of 10 elements forces are 0.1 % too small at 0.001 of the facet and
# 1.2 % at 0.009, in proportion.
PENETRATION = 0.02
APPROACH = 0.01
OPEN_INSIDE = 0.05  # share of open points inside a pressed patch
SCATTER = 0.2  # standard deviation over mean of the pressure within facets
FEW = 4.0  # facets as long as those at the rim, up to the middle, below which a contact is coarse
NEAR = 1.5  # facets at the rim count that are up to so many half-widths from the middle
SLACK = 0.02  # energy of what sticks over that of the bodies
SUNK = 0.05  # depth of a vertex of the master in a slave facet, over the length of the facet
ASTRAY = 0.03  # resultant of pressures along the slave's normals, off that along the master's
HIDDEN = 0.15  # depth of a point beyond that of the mean gaps, over the facet's length
STRETCHED = 4.0  # area of a pressed point over what it was undeformed
# Error of pressures over their peak, by what the penetration's standard deviation is of the
# approach: 2.1 to 3.9 for Hertz's lines, whose area has up to twice as much, 1 to 7 for blocks.
FLATTENED, UNEVEN = 4.0, 0.02  # and what of it is warned of
WHOLE = 1.0 - 1e-9  # share of a vertex's area that counts as all of it


@dataclass(frozen=True, slots=True)
class PairState:
    """One contact after a step."""

    force: float  # N (N/m), integral of the pressure
    area: float  # m or m², pressed
    deepest: float  # m, largest penetration
    over_facet: float  # the largest over the local facet length
    mean: float  # m, penetration weighted by pressure
    spread: float  # standard deviation of the penetration over the area, over that mean
    # m, from the rim of the contact to where it is furthest away; 0 without a rim: the end of a
    # surface is none
    half_width: float = 0.0
    rim: float = 0.0  # m, mean length of the facets that the rim crosses
    uncertain: float = 0.0  # half the area of all such facets over that of the contact
    # Point by point, 0 where the pressure is averaged:
    open_inside: float = 0.0  # share of open points inside the patch
    scatter: float = 0.0  # of the pressure within facets
    sagitta: float = 0.0  # m, mean over the pressed facets
    # of the pressure from vertex to vertex over its mean, where the master has corners; 0 point by
    # point
    waves: float = 0.0
    corners: float = 0.0  # m, how far these are apart
    # how far the resultant of the pressures is off that along the master's own normals, over it
    astray: float = 0.0
    hidden: float = 0.0  # m, depth of the deepest point beyond the mean gaps'
    hidden_share: float = 0.0  # the same over the length of its facet, undeformed
    stretched: float = 0.0  # largest da/dA that is pressed

    def is_wider(self, other: PairState) -> bool:
        """Whether more presses, or as much with a rim that is further away, or without one."""
        return (self.area, self.facets) > (other.area, other.facets)

    @property
    def facets(self) -> float:
        """How many facets as long as those at the rim the contact is wide, from there inwards."""
        return self.half_width / self.rim if self.rim > 0.0 else np.inf


class PairProbe:
    """Measures one contact."""

    def __init__(self, term: ContactTerm) -> None:
        self.term, self.surface = term, term.surface
        self._comm = term.surface.vertices.comm
        facet = term.surface.slave.facet
        self._order: Longs = np.argsort(facet, kind="stable")
        count = len(np.unique(facet))
        self._shape = (count, len(facet) // max(count, 1))
        xi = self._by_facet(term.surface.slave.xi)
        linear = np.concatenate([np.ones((*xi.shape[:2], 1)), xi], axis=2)
        self._corners, self._parts = _corner_spacing(self.surface), self.surface.parts
        # Takes values at the points of a facet to what is left of them beside a linear function.
        self._bent = np.eye(xi.shape[1]) - linear @ np.linalg.pinv(linear)

    def _by_facet(self, values: Any) -> Floats:
        """Point values (q, …) as (f, p, …), p being the points of a facet."""
        return values[self._order].reshape(*self._shape, *values.shape[1:])

    def _total(self, *values: float) -> Floats:
        return self._comm.allreduce(np.array(values))

    def measure(self, trial: ContactTrial) -> PairState:
        """The contact at a converged state; collective."""
        weight, pressure = self.surface.slave.weight, trial.pressure
        pressed = pressure > 0.0
        force, area = self._total(float(weight @ pressure), float(weight @ pressed))
        patch = self._pressed_facets(trial)
        depth = self._depths(trial)
        rim = self._rim(trial, patch)
        if trial.nodal_gap is None or trial.nodal_pressure is None:
            uneven = self._unevenness(trial, patch)
            return PairState(float(force), float(area), *depth, *rim, *uneven)
        inside = self._inside(self._inside(patch))
        found = dict(zip(("waves", "corners"), self._waves(trial, inside), strict=True))
        found["astray"] = self._astray(trial)
        found |= zip(("hidden_share", "hidden"), self._hidden(trial, depth[0]), strict=True)
        largest = float(np.max(trial.area_ratio, where=pressed, initial=0.0))
        found["stretched"] = self._comm.allreduce(largest, op=MPI.MAX)
        return PairState(float(force), float(area), *depth, *rim, **found)

    def _astray(self, trial: ContactTrial) -> float:
        """How far pressures along the slave's normals are off those along the master's; collective.

        Over sharp corners the slave's normals are taken. Without friction a face can only be
        pressed along its own, but where facets lie on it these are the same, or off it to either
        side in turn.
        """
        at, load = trial.projection, self.surface.slave.weight * trial.pressure
        if self.surface.normals is None:
            return 0.0
        own = unit_normals(at.tangents)
        own *= np.sign(np.einsum("qi,qi->q", own, at.normal))[:, None]
        local = np.concatenate([load @ (at.normal - own), load @ own])
        off, whole = np.split(self._total(*map(float, local)), 2)
        return over(float(np.linalg.norm(off)), float(np.linalg.norm(whole)))

    def _hidden(self, trial: ContactTrial, penetration: float) -> tuple[float, float]:
        """Depth of the deepest pressed point beyond the mean gaps'; over its facet's length, and m.

        Collective.
        """
        felt = trial.projection.on_surface & (trial.pressure > 0.0)
        beyond = np.where(felt, -trial.kinematics.gap - penetration, 0.0)
        share = beyond / self.surface.slave.facet_length
        at = int(np.argmax(share)) if len(share) else -1
        mine = (float(share[at]), float(beyond[at])) if at >= 0 else (0.0, 0.0)
        return max((0.0, 0.0), *self._comm.allgather(mine))

    def _depths(self, trial: ContactTrial) -> tuple[float, float, float, float]:
        """Largest penetration, the largest over facet length, mean and spread; collective."""
        surface, pressure, gap = self.surface, trial.nodal_pressure, trial.nodal_gap
        nodal = gap is not None and pressure is not None  # the same on every rank
        if gap is None or pressure is None:
            pressure, gap = trial.pressure, trial.kinematics.gap
        length = surface.vertices.length if nodal else surface.slave.facet_length
        area = (surface.vertices.area if nodal else surface.slave.weight) * (pressure > 0.0)
        depth = np.where(pressure > 0.0, -gap, 0.0)
        load = area * pressure
        sums = np.array([load @ depth, load.sum(), area.sum(), area @ depth, area @ depth**2])
        moment, force, closed, first, second = sums if nodal else self._total(*sums)
        variance = over(second, closed) - over(first, closed) ** 2
        most = self._comm.allreduce(float(np.max(depth / length, initial=0.0)), op=MPI.MAX)
        deepest = self._comm.allreduce(float(np.max(depth, initial=0.0)), op=MPI.MAX)
        mean = over(moment, force)
        return deepest, most, mean, over(float(np.sqrt(max(variance, 0.0))), mean)

    def _pressed_facets(self, trial: ContactTrial) -> Bools:
        """Points (q,) of the facets that press: all their vertices do, or any of their points."""
        vertices, nodal = self.surface.vertices, trial.nodal_pressure
        if nodal is not None:
            return np.min(nodal[vertices.of_point], axis=1) > 0.0
        count = np.bincount(self.surface.slave.facet, trial.pressure > 0.0)
        return np.greater(count, 0)[self.surface.slave.facet]

    def _waves(self, trial: ContactTrial, inside: Bools) -> tuple[float, float]:
        """Waves of the vertices' pressure over its mean, and how far corners are apart; collective.

        Corners are those of the undeformed master, or where it has none those between its facets,
        which may have bent since.
        """
        if self._parts != self.surface.parts:
            self._corners, self._parts = _corner_spacing(self.surface), self.surface.parts
        if self._corners is None or trial.nodal_pressure is None:
            return 0.0, 0.0
        weight = self.surface.slave.weight * inside
        sums = self._total(
            float(weight @ self._corners[trial.projection.facet]), float(weight.sum())
        )
        spacing = over(sums[0], sums[1])
        return waves(self.surface, trial.nodal_pressure, inside, spacing), spacing

    def _inside(self, patch: Bools) -> Bools:
        """Points (q,) of the facets of a patch all of whose neighbours are in it; collective."""
        return patch & self._whole(patch)[self.surface.vertices.of_point].all(axis=1)

    def _whole(self, patch: Bools) -> Bools:
        """Vertices (v,) all of whose facets are in a patch (q,); collective."""
        vertices = self.surface.vertices
        return vertices.sums(self.surface.slave.weight * patch) >= WHOLE * vertices.area

    def _rim(self, trial: ContactTrial, patch: Bools) -> tuple[float, float, float]:
        """Half-width, m, length of the facets at its rim, m, their share of the area; collective.

        The rim crosses the facets between a vertex that presses and one that does not; point by
        point a vertex presses if something does on all facets around. It is taken in the middle of
        such facets, and the half-width from the vertex or point that is furthest from it.
        """
        surface, vertices = self.surface, self.surface.vertices
        weight, nodal = surface.slave.weight, trial.nodal_pressure
        pressing: Bools = self._whole(patch) if nodal is None else nodal > 0.0
        ends = pressing[vertices.of_point]
        crossed = ends.any(axis=1) & ~ends.all(axis=1)
        if nodal is None:
            crossed = patch & ~ends.all(axis=1)
        if not self._comm.allreduce(bool(crossed.any()), op=MPI.LOR):
            return 0.0, 0.0, 0.0
        rim = cKDTree(vertices.position[~pressing])
        inside = [vertices.position[pressing], surface.slave.position[ends.all(axis=1)]]
        # The place deepest inside tells the widest patch: two patches are not one wide contact.
        places = np.concatenate(inside)
        depth = rim.query(places)[0] if len(places) else np.empty(0)
        deepest = int(np.argmax(depth)) if len(depth) else -1
        mine = (float(depth[deepest]), *places[deepest]) if len(depth) else (0.0,)
        half, *middle = max(self._comm.allgather(mine))
        # The rim around that place alone: other patches may be meshed otherwise.
        near: Bools = np.asarray(crossed)
        if middle:
            apart = np.linalg.norm(surface.slave.position - middle, axis=1)
            near = crossed & (apart < NEAR * half)
        length = np.zeros(len(near))
        length[near] = facet_length_along(surface, near, ends[near].astype(np.float64))[0]
        parts = (near, length, crossed, ends.all(axis=1))
        sums = self._total(*(float(weight @ part) for part in parts))
        # Somewhere within the facets that it crosses, in the mean half-way, the contact ends.
        rim_length, half_crossed = over(sums[1], sums[0]), 0.5 * sums[2]
        half_width = max(half - 0.5 * rim_length, 0.5 * rim_length)
        return half_width, rim_length, over(half_crossed, sums[3] + half_crossed)

    def _unevenness(self, trial: ContactTrial, patch: Bools) -> tuple[float, float, float]:
        """Open share inside the patch, scatter within its facets, mean sagitta, m; collective."""
        weight, pressure = self.surface.slave.weight, trial.pressure
        inside = self._inside(patch)
        # The standard deviation of the pressure about the mean of its own facet; and what of the
        # gaps along a facet is not linear, which is how far it bows away from the master.
        area = self._by_facet(weight)
        total = area.sum(axis=1)
        mean = (area * self._by_facet(pressure)).sum(axis=1) / total
        apart = self._by_facet(pressure) - mean[:, None]
        spread = np.sqrt((area * apart**2).sum(axis=1) / total)
        gap = np.where(trial.projection.on_surface, trial.kinematics.gap, 0.0)
        bow = np.ptp(np.einsum("fpq,fq->fp", self._bent, self._by_facet(gap)), axis=1)
        # Pressures count away from the rim alone, where they fall to nothing in any contact; the
        # bow wherever a facet presses.
        some, deep = (area * self._by_facet(part) for part in (patch, inside))
        sums = self._total(
            float(weight @ (inside & (pressure <= 0.0))),
            float(weight @ inside),
            float(deep.sum(axis=1) @ spread),
            float(deep.sum(axis=1) @ mean),
            float(some.sum(axis=1) @ bow),
            float(some.sum()),
        )
        return over(sums[0], sums[1]), over(sums[2], sums[3]), over(sums[4], sums[5])


class ContactWarnings(Remembers):
    """Keeps of every pair what the warnings at the end of a run are about.

    Attributes:
        over_facet: of each pair the largest penetration over the local facet length.
        over_approach: of each pair the mean penetration over the approach, at its largest force;
            of a tie the same ratio by energies, stored in it over those of the bodies, where it
            stores most.
    """

    over_facet: Kept[list[float]]
    over_approach: Kept[list[float]]
    _answering: Kept[list[float]]  # share of the largest force that is not given
    _deepest: Kept[list[tuple[float, float, str]]]
    _strongest: Kept[list[PairState | None]]
    _widest: Kept[list[PairState | None]]
    _stored: Kept[list[float]]
    _slack: Kept[list[float]]  # as over_approach of a tie, of what sticks
    _sunk: Kept[list[tuple[Sunk, str]]]

    def __init__(self, problem: Equilibrium, resumed: Snapshot | None = None) -> None:
        """Make ready; collective.

        Args:
            resumed: what :meth:`snapshot` has seen, of a run that goes on; None: nothing has
                pressed yet.
        """
        self._problem = problem
        self._probes = [PairProbe(term) for term in problem.contacts]
        self._sunk_in = [SunkVertices.of(term) for term in problem.contacts]
        self._factor = [penalty_factor(problem, term) for term in problem.contacts]
        count = len(self._probes)
        self.over_facet, self.over_approach = [0.0] * count, [0.0] * count
        self._deepest = [(0.0, 0.0, "")] * count
        self._strongest, self._widest = [None] * count, [None] * count
        self._stored, self._slack = [0.0] * count, [0.0] * count
        self._sunk = [(Sunk(), "")] * count
        self._answering = [1.0] * count
        if resumed is not None:
            self.restore(resumed)

    def step(self, row: Row, thickness: float, balanced: bool = True) -> None:
        """Look at a converged step of a slab of ``thickness`` (m, or 1); collective.

        Forces are ``balanced`` in all but explicit steps.
        """
        trials = self._problem.committed
        states = [self._measured(index, trial) for index, trial in enumerate(trials)]
        terms = self._problem.contacts
        loose = [state for state, term in zip(states, terms, strict=True) if not term.tied]
        force = sum(state.force for state in loose) * thickness
        spent = 2.0 * row.strain_energy + row.plastic_dissipation + row.viscous_dissipation
        approach = spent / force if force > 0.0 else 0.0
        answering = [1.0] * len(terms)
        if self._is_stronger(states):
            answering = GivenForces(self._problem).answering(trials, approach, balanced)
        for index, state in enumerate(states):
            here = (state.deepest, row.time, row.when)
            self._deepest[index] = max(self._deepest[index], here)
            self.over_facet[index] = max(self.over_facet[index], state.over_facet)
            strongest, widest = self._strongest[index], self._widest[index]
            if strongest is None or state.force > strongest.force:
                self._strongest[index] = state
                if not terms[index].tied:
                    self.over_approach[index] = over(state.mean, approach)
                    self._answering[index] = answering[index]
            if widest is None or state.is_wider(widest):
                self._widest[index] = state
        self._look_at_what_sticks(trials, spent / thickness)
        self._look_at_edges(row, states)

    def _is_stronger(self, states: Sequence[PairState]) -> bool:
        """Whether any pair that is not tied presses more than ever before."""
        triples = zip(self._problem.contacts, states, self._strongest, strict=True)
        return any(
            not t.tied and now.force > (old.force if old else 0.0) for t, now, old in triples
        )

    def _look_at_edges(self, row: Row, states: Sequence[PairState]) -> None:
        """Find the vertices of masters that are inside facets of their slaves; collective."""
        terms, x = self._problem.contacts, self._problem.u.x.petsc_vec
        for index, (term, state) in enumerate(zip(terms, states, strict=True)):
            probe = self._sunk_in[index]
            if probe is None or not term.active or state.force <= 0.0:
                continue
            sunk = probe.deepest(term.surface.gather(x), state.deepest, term.offset)
            if sunk.share > self._sunk[index][0].share:
                self._sunk[index] = (sunk, row.when)

    def _measured(self, index: int, trial: ContactTrial) -> PairState:
        """A pair at a converged step; corners of the master alone make waves; collective."""
        state = self._probes[index].measure(trial)
        if state.waves > WAVES:
            angle = bend(self._problem, self._problem.contacts[index], trial)
            return state if angle > BENT else replace(state, waves=0.0)
        return state

    def _look_at_what_sticks(self, trials: Sequence[ContactTrial], spent: float) -> None:
        """Hold what ties and stick store against ``spent``, J per unit thickness; collective.

        ``spent`` is that of the bodies. Twice the energy of a tie, or of what sticks, is its force
        times its jump, in tension and shear too.
        """
        for index, (term, trial) in enumerate(zip(self._problem.contacts, trials, strict=True)):
            mine = _held(term, trial) if term.active else 0.0
            stored = self._problem.comm.allreduce(mine, op=MPI.SUM)
            if stored > self._stored[index]:
                self._stored[index] = stored
                largest = self.over_approach if term.tied else self._slack
                largest[index] = over(2.0 * stored, spent)

    def warnings(self) -> Iterator[str]:
        """The lines of all pairs."""
        for index, state in enumerate(self._strongest):
            if self._problem.contacts[index].tied:
                yield from self._of_tie(index)
                continue
            if state is None or state.force <= 0.0:
                yield (
                    f"contact.{index}: the bodies never pressed on each other (does what is "
                    "prescribed point into the body? y < 0 presses down)"
                )
                continue
            comb = self._is_comb(state)
            if comb:
                yield self._comb(index, state)
            if state.waves > WAVES:
                yield waves_text(index, state.waves, state.corners)
            lost, flat = self._cost(index), self._flattened(index)
            if self.over_facet[index] > PENETRATION or lost > APPROACH or flat > UNEVEN:
                yield self._soft(index, comb)
            if self._slack[index] > SLACK:
                yield _slack_text(index, self._slack[index])
            if self._sunk[index][0].share > SUNK:
                yield self._edge(index)
            yield from _of_facets(index, state)
            widest = self._widest[index]
            if widest is not None and widest.facets < FEW:
                yield _few_facets(index, widest)

    def _cost(self, index: int) -> float:
        """What penetration takes off the largest normal force, over what is left of it."""
        return self.over_approach[index] * self._answering[index]

    def _flattened(self, index: int) -> float:
        """What penetration takes off the peak of the pressure, over what is left of it."""
        state = self._strongest[index]
        return FLATTENED * self.over_approach[index] * (state.spread if state else 0.0)

    def _of_tie(self, index: int) -> Iterator[str]:
        if self.over_facet[index] > PENETRATION:
            depth, _, when = self._deepest[index]
            yield (
                f"contact.{index}: what is tied moves apart by up to {depth:.3g} m ({when}), "
                f"{self.over_facet[index]:.2g} of the local slave facet's length; raise the "
                "penalty (penalty_factor)"
            )
        share = self.over_approach[index]
        if share > APPROACH:
            yield (
                f"contact.{index}: what is tied gives way by {share:.2g} of the deformation of the "
                f"bodies: under prescribed displacements its force is about {_lost(share)} too "
                "small; raise the penalty (penalty_factor)"
            )

    def _edge(self, index: int) -> str:
        sunk, when = self._sunk[index]
        return (
            f"contact.{index}: a vertex of the master, at {place_text(sunk.place)}, sinks up to "
            f"{sunk.depth:.3g} m into a slave facet ({when}), "
            f"{sunk.share:.2g} of its length more than the penetration: the mean gap, which the "
            "pressure answers to and max_penetration tells of, does not see an edge between the "
            "slave's vertices; round the edge, make the other surface the slave, or refine the "
            "slave there (less deep)"
        )

    @staticmethod
    def _is_comb(state: PairState) -> bool:
        """Whether facets touch with a few of their points only."""
        uneven = state.open_inside > OPEN_INSIDE or state.scatter > SCATTER
        return uneven or state.sagitta > state.mean > 0.0

    def _comb(self, index: int, state: PairState) -> str:
        factor = self._factor[index]
        softer = softer_factor(factor, state.mean, state.sagitta, self._cost(index) / APPROACH)
        penalty = "" if softer is None else f", or penalty_factor = {softer:g} (now {factor:.3g})"
        return (
            f"contact.{index}: combed pressures: with the pressure point by point, slave facets "
            f"touch the master with some of their points: sagitta of the facets "
            f"{state.sagitta:.2g} m beside a penetration of {state.mean:.2g} m, "
            f"{_percent(state.open_inside)} of the points inside the contact open, pressures "
            f"within facets scatter by {_percent(state.scatter)}: contact area and film are "
            f'too small; use pressure = "averaged"{penalty}, or a finer slave; a higher penalty '
            "makes it worse"
        )

    def _soft(self, index: int, comb: bool) -> str:
        depth, _, when = self._deepest[index]
        share, lost, flat = self.over_approach[index], self._cost(index), self._flattened(index)
        cost = "the bodies come that much too close under the given force"
        if lost > min(APPROACH, 0.5 * share):
            cost = f"the normal force is about {_lost(lost)} too small"
        elif flat > UNEVEN:
            cost = (
                f"under the given force pressures are off by about {_lost(flat)} of their peak, "
                "and the area, where roundness ends it, by up to twice that"
            )
        cure = "raise the penalty (penalty_factor) or refine the surface"
        if comb:
            cure = 'use pressure = "averaged", then raise penalty_factor'
        return (
            f"contact.{index}: penetration up to {depth:.3g} m ({when}), "
            f"up to {self.over_facet[index]:.2g} of the local slave facet's length, and "
            f"on average {share:.2g} of the approach of the bodies: {cost}; {cure}"
        )


def _held(term: ContactTerm, trial: ContactTrial) -> float:
    """What a tie stores on this rank, or stick that is a penalty, J per unit thickness."""
    if term.tied:
        return term.interface_energy(trial)
    law = term.law.law if isinstance(term.law, FactoredLaw) else term.law
    if not isinstance(law, StickingLaw):  # its stiffness is that of asperities, or not known
        return 0.0
    sticks = trial.response.regime == Regime.STICK
    stored = term.law.stored_energy(trial.response.state)
    return float((term.surface.slave.weight * sticks) @ stored)


def _slack_text(index: int, share: float) -> str:
    return (
        f"contact.{index}: what sticks gives way, before it slips, by {share:.2g} of the "
        f"deformation of the bodies: under prescribed displacements forces are up to {_lost(share)}"
        " too small; raise K_T (default 10 G/h, of the facets' length h), or refine the slave"
    )


def _percent(share: float) -> str:
    """A share with two digits, without a power of ten."""
    return f"{100.0 * share:.2g} %" if share < 0.995 else f"{100.0 * share:.0f} %"


def _lost(share: float) -> str:
    """What is missing of the whole, from what is missing over what is left."""
    return _percent(share / (1.0 + share))


def _of_facets(index: int, state: PairState) -> Iterator[str]:
    """Slave facets that lie across corners, are drawn out, or cannot follow the master."""
    if state.astray > ASTRAY:
        yield (
            f"contact.{index}: at its largest the contact force is {_percent(state.astray)} off "
            "what the master's faces can be pressed with, as facets of the slave lie across its "
            "sharp corners and pressures act along the slave's normals: its components are off by "
            "about as much; round the corners (fillet_radius), or refine the slave there"
        )
    if state.stretched > STRETCHED:
        yield (
            f"contact.{index}: at the largest force a facet of the slave that presses is stretched "
            f"to {state.stretched:.2g} times its area: pressure and flow there are those of few "
            "cells, so that forces may be off by tens of per cent, and a finer mesh does not help "
            "where a sharp tool draws it out without bound (a wedge of 45 degrees in metal: 17 % "
            "too much); round the tool over several facets, or take less depth"
        )
    if state.hidden_share > HIDDEN:
        yield (
            f"contact.{index}: at the largest force points of the slave lie {state.hidden:.3g} m "
            f"deeper in the master, {state.hidden_share:.2g} of a slave facet's length, than the "
            "mean gaps that the pressure answers to and max_penetration tells of: the facets are "
            "too long for its shape, or have been stretched; refine the slave there"
        )


def _few_facets(index: int, state: PairState) -> str:
    near = f", and how near the bodies are by {state.hidden:.2g} m" if state.hidden > 0.0 else ""
    return (
        f"contact.{index}: the contact is {state.facets:.2g} slave facets wide from its rim to its "
        f"middle ({state.half_width:.3g} m; those at its rim are {state.rim:.3g} m long): its "
        f"area, and what a film carries, are uncertain by {_percent(state.uncertain)}{near}; "
        "refine the slave there"
    )


def _corner_spacing(surface: ContactSurface) -> Floats | None:
    """How far corners are apart (f,), m, of a master that is made of facets; None of others."""
    master, target = surface.master, surface.target
    if not isinstance(master, MasterFacets) or not isinstance(target, FacetSurface):
        return None
    if target.extraction is not None:
        return None
    spacing, _ = corner_spacing(surface.shape, master.facets, master.position, BENT, SHARP)
    return np.where(spacing > 0.0, spacing, master.sizes())
