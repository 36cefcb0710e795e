"""Looks at every recorded step whether a contact is stiff, even and fine enough, pair by pair.

What is judged, and against what:

- **penetration** against the local length of the slave facets, and, weighted by pressure, against
  the approach of the bodies 2 U/N, U being their strain energy: where displacements are prescribed
  N is too small by about that share (by 1.2 times it for Hertz's contact, U = 2/5 N δ, N ~ δ^3/2).
  What bodies that flow dissipate is added once: their force changes little while they do. Where
  they flow through a contact (rolling, drawing), it counts for what is in it, and N may be too
  large as well: like a flattened roll, soft contact reaches further. Where the force is given it
  flattens uneven pressures, by the penetration's standard deviation.
- **elastic slip** of points that stick, by its energy over that of the bodies: likewise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Kept, KeptAtPoints, Remembers, Snapshot
from tribox.app.equilibrium.supports import bodies_of
from tribox.app.equilibrium.unknowns import place_text
from tribox.app.simulation import surface_faults
from tribox.app.simulation.contact_resultants import over
from tribox.app.simulation.history import Row
from tribox.app.simulation.pair_bodies import GivenForces, penalty_factor
from tribox.app.simulation.pair_probe import PairProbe, PairState
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.forms.friction.coulomb import StickingLaw
from tribox.forms.friction.factored_law import FactoredLaw
from tribox.forms.friction.law import Regime
from tribox.geometry.surfaces.facets import Bools, Floats

# Largest penetration over the local facet length, and mean one over the approach, from which on
# they are warned of. On blocks of 10 elements forces are 0.1 % too small at 0.001 of the facet and
# 1.2 % at 0.009, in proportion.
PENETRATION = 0.02
APPROACH = 0.01
OPEN_INSIDE = 0.05  # share of open points inside a pressed patch
SCATTER = 0.2  # standard deviation over mean of the pressure within facets
FEW = 4.0  # facets as long as those at the rim, up to the middle, below which a contact is coarse
# Share of what has ever pressed, that still does, below which bodies pass a contact; what they
# dissipate over 2 U from which they flow; and error of N over the share of the approach (rolling a
# strip: 1.4 to 2.6).
STAYS, FLOWS, PASSING = 0.8, 0.2, 2.0
SLACK = 0.02  # energy of what sticks over that of the bodies
SUNK = 0.05  # depth of a vertex of the master in a slave facet, over the length of the facet
ASTRAY = 0.03  # resultant of pressures along the slave's normals, off that along the master's
HIDDEN = 0.05  # depth of a point beyond that of the mean gaps, over the length of the facet
STRETCHED = 4.0  # area of a pressed point over what it was undeformed
# Error of pressures over their peak, by what the penetration's standard deviation is of the
# approach: 2.1 to 3.9 for Hertz's lines, whose area has up to twice as much, 1 to 7 for blocks.
FLATTENED, UNEVEN = 4.0, 0.02  # and what of it is warned of


class ContactWarnings(Remembers):
    """Keeps of every pair what the warnings at the end of a run are about."""

    # of each pair the largest penetration over the local facet length
    over_facet: Kept[list[float]]
    # of each pair the mean penetration over the approach, at its largest force; of a tie the same
    # ratio by energies, stored in it over those of the bodies, where it stores most
    over_approach: Kept[list[float]]
    _answering: Kept[list[float]]  # share of the largest force that is not given
    _passed: Kept[list[float]]  # largest force that it had while what flows passed it
    _touched: KeptAtPoints[list[Bools]]  # points that have pressed
    _deepest: Kept[list[tuple[float, float, str]]]
    _strongest: Kept[list[PairState | None]]
    _widest: Kept[list[PairState | None]]
    _stored: Kept[list[float]]
    _slack: Kept[list[float]]  # as over_approach of a tie, of what sticks
    _sunk: Kept[list[tuple[surface_faults.Sunk, str]]]
    _hidden: Kept[list[tuple[surface_faults.Sunk, str]]]
    _nearest: Kept[list[tuple[float, str]]]  # smallest gap, m, and when

    def __init__(self, problem: Equilibrium, resumed: Snapshot | None = None) -> None:
        """Make ready, or go on from what :meth:`snapshot` has seen; collective."""
        self._problem = problem
        self._probes = [PairProbe(term) for term in problem.contacts]
        self._sunk_in = [surface_faults.SunkVertices.of(term) for term in problem.contacts]
        self._factor = [penalty_factor(problem, term) for term in problem.contacts]
        count = len(self._probes)
        self.over_facet, self.over_approach = [0.0] * count, [0.0] * count
        self._deepest = [(0.0, 0.0, "")] * count
        self._strongest, self._widest = [None] * count, [None] * count
        self._stored, self._slack = [0.0] * count, [0.0] * count
        self._sunk, self._hidden = (
            [(surface_faults.Sunk(), "")] * count,
            [(surface_faults.Sunk(), "")] * count,
        )
        self._answering, self._passed = [1.0] * count, [0.0] * count
        self._nearest = [(np.inf, "")] * count
        sizes = [len(term.surface.slave.weight) for term in problem.contacts]
        self._touched = [np.zeros(size, dtype=bool) for size in sizes]
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
        elastic = 2.0 * row.strain_energy
        lost = row.plastic_dissipation + row.viscous_dissipation
        answering, stays = [1.0] * len(terms), self._look_at_what_stays(trials)
        if self._is_stronger(states):
            approach = over(elastic + lost, force)
            answering = GivenForces(self._problem).answering(trials, approach, balanced)
        for index, state in enumerate(states):
            here = (state.deepest, row.time, row.when)
            self._deepest[index] = max(self._deepest[index], here)
            self.over_facet[index] = max(self.over_facet[index], state.over_facet)
            strongest, widest = self._strongest[index], self._widest[index]
            flown = float(stays[index]) * lost
            if strongest is None or state.force > strongest.force:
                self._strongest[index] = strongest = state
                if not terms[index].tied:
                    self.over_approach[index] = over(state.mean * force, elastic + flown)
                    self._answering[index] = answering[index]
            if stays[index] < STAYS and flown > FLOWS * elastic:
                self._passed[index] = max(self._passed[index], state.force)
            if widest is None or state.is_wider(widest):
                self._widest[index] = state
        self._look_at_what_sticks(trials, (elastic + lost) / thickness)
        self._look_at_edges(row, states)
        self._look_at_gaps(row, trials)

    def _is_stronger(self, states: Sequence[PairState]) -> bool:
        """Whether any pair that is not tied presses more than ever before."""
        triples = zip(self._problem.contacts, states, self._strongest, strict=True)
        return any(
            not t.tied and now.force > (old.force if old else 0.0) for t, now, old in triples
        )

    def _look_at_what_stays(self, trials: Sequence[ContactTrial]) -> Floats:
        """Of each pair (k,) what presses over what ever has, by areas; collective."""
        sums = np.zeros((len(trials), 2))
        for index, (term, trial) in enumerate(zip(self._problem.contacts, trials, strict=True)):
            pressed = trial.pressure > 0.0
            self._touched[index] = self._touched[index] | pressed
            areas = np.stack([pressed, self._touched[index]])
            sums[index] = areas @ term.surface.slave.weight
        now, ever = self._problem.comm.allreduce(sums).T
        share: Floats = np.divide(now, ever, out=np.ones(len(trials)), where=ever > 0.0)
        return share

    def _look_at_edges(self, row: Row, states: Sequence[PairState]) -> None:
        """Find points of either surface of a pair that are deep inside the other; collective."""
        terms, x = self._problem.contacts, self._problem.u.x.petsc_vec
        for index, (term, state) in enumerate(zip(terms, states, strict=True)):
            if not term.active:  # the bodies may pass through each other
                continue
            if state.hidden.share > self._hidden[index][0].share:
                self._hidden[index] = (state.hidden, row.when)
            probe = self._sunk_in[index]
            if probe is None or state.force <= 0.0:
                continue
            sunk = probe.deepest(term.surface.gather(x), state.deepest, term.offset)
            if sunk.share > self._sunk[index][0].share:
                self._sunk[index] = (sunk, row.when)

    def _look_at_gaps(self, row: Row, trials: Sequence[ContactTrial]) -> None:
        """Find how near the surfaces come; collective."""
        places = [trial.projection for trial in trials]
        mine = [np.min(at.gap, where=at.on_surface, initial=np.inf) for at in places]
        gaps = np.maximum(np.array(mine), 0.0)
        self._problem.comm.Allreduce(MPI.IN_PLACE, gaps, op=MPI.MIN)
        for index, gap in enumerate(gaps):
            if gap < self._nearest[index][0]:
                self._nearest[index] = (float(gap), row.when)

    def _measured(self, index: int, trial: ContactTrial) -> PairState:
        """A pair at a converged step; corners of the master alone make waves; collective."""
        state = self._probes[index].measure(trial)
        if state.waves > surface_faults.WAVES:
            angle = surface_faults.bend(self._problem, self._problem.contacts[index], trial)
            return state if angle > surface_faults.BENT else replace(state, waves=0.0)
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
                if not self._press_elsewhere(index):
                    gap, when = self._nearest[index]
                    near = f", and came no nearer than {gap:.3g} m ({when})"
                    yield (
                        f"contact.{index}: the bodies never pressed on each other"
                        f"{near if np.isfinite(gap) else ''} (does what is prescribed point into "
                        "the body, and far enough? y < 0 presses down)"
                    )
                continue
            comb = self._is_comb(state)
            if comb:
                yield self._comb(index, state)
            if state.waves > surface_faults.WAVES:
                yield surface_faults.waves_text(index, state.waves, state.corners)
            lost, flat = self._cost(index), self._flattened(index)
            if self.over_facet[index] > PENETRATION or lost > APPROACH or flat > UNEVEN:
                yield self._soft(index, comb)
            if self._slack[index] > SLACK:
                yield _slack_text(index, self._slack[index])
            if self._sunk[index][0].share > SUNK:
                yield self._edge(index)
            if self._hidden[index][0].share > HIDDEN:
                yield self._chord(index)
            yield from _of_facets(index, state)
            widest = self._widest[index]
            if widest is not None and widest.facets < FEW:
                yield _few_facets(index, widest)

    def _press_elsewhere(self, index: int) -> bool:
        """Whether the two bodies of a pair press on each other in another one."""
        terms = self._problem.contacts
        pairs = [bodies_of(self._problem, term) for term in terms]
        names = [{pair.slave.name, pair.master.name} for pair in pairs]
        pressed = [state is not None and state.force > 0.0 for state in self._strongest]
        return any(p and own == names[index] for p, own in zip(pressed, names, strict=True))

    def _cost(self, index: int) -> float:
        """What penetration takes off the largest normal force, or may add, over what is left."""
        factor = PASSING if self._passes(index) else 1.0
        return factor * self.over_approach[index] * self._answering[index]

    def _passes(self, index: int) -> bool:
        """Whether what flows passed the contact at half its largest force or more."""
        strongest = self._strongest[index]
        return strongest is not None and 2.0 * self._passed[index] > strongest.force

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

    def _chord(self, index: int) -> str:
        hidden, when = self._hidden[index]
        return (
            f"contact.{index}: a slave facet, at {place_text(hidden.place)} as drawn, lies up to "
            f"{hidden.depth:.3g} m deeper in the master ({when}), {hidden.share:.2g} of its "
            "length, than the mean gaps that the pressure answers to and max_penetration tells of: "
            "it is too long for the master's shape, or for an edge of it, or has been stretched; "
            "refine the slave there"
        )

    @staticmethod
    def _is_comb(state: PairState) -> bool:
        """Whether facets touch with a few of their points only."""
        uneven = state.open_inside > OPEN_INSIDE or state.scatter > SCATTER
        return uneven or state.sagitta > state.mean > 0.0

    def _comb(self, index: int, state: PairState) -> str:
        factor = self._factor[index]
        softer = surface_faults.softer_factor(
            factor, state.mean, state.sagitta, self._cost(index) / APPROACH
        )
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
            if self._passes(index):
                cost = (
                    "as a body flows through the contact, the normal force may be about "
                    f"{_lost(lost)} too large, or too small"
                )
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
    """Slave facets that lie across corners or are drawn out."""
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


def _few_facets(index: int, state: PairState) -> str:
    depth = state.hidden.depth
    near = f", and how near the bodies are by {depth:.2g} m" if depth > 0.0 else ""
    return (
        f"contact.{index}: the contact is {state.facets:.2g} slave facets wide from its rim to its "
        f"middle ({state.half_width:.3g} m; those at its rim are {state.rim:.3g} m long): its "
        f"area, and what a film carries, are uncertain by {_percent(state.uncertain)}{near}; "
        "refine the slave there"
    )
