"""Where a contact ends: surfaces that end there, slaves that run past them, sides that fold in.

A message that speaks of an end says of which surface, and where it lies undeformed. Axis letters: q
points, v vertices of the slave, k vertices of its facet, e ends (in space: edges), f facets of the
master, s their sides.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model
from tribox.app.case.contact import Contact
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Kept, KeptAtPoints, Remembers, Snapshot
from tribox.app.equilibrium.supports import bodies_of
from tribox.app.equilibrium.unknowns import place_text
from tribox.app.simulation.contact_resultants import penetration_of
from tribox.app.simulation.history import Row
from tribox.app.simulation.surface_faults import SAME, Findings, names_of
from tribox.forms.contact.pressure import nodal_pressure
from tribox.forms.contact.shared_slave import covered_by_others
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.body_facets import OuterFacets, facet_nodes
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs, facet_shape
from tribox.geometry.surfaces.master import MasterFacets
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.rigid import RigidSurface
from tribox.geometry.surfaces.surface import ContactSurface
from tribox.geometry.surfaces.target import Projection

DEEP = 0.05  # depth over the length of a slave facet from which on a fold is told
TOUCHES = 1e-6  # of that length, up to which a node may start inside
FEW = 0.05  # share of the area above the master that may leave it without a word
SOME = 0.2  # share of the points past any end from which on an end is named
FELT = 0.05  # pressure at an end over its mean from which on the contact wants to go on there
MOST = 0.9  # of the largest pressure at any end, from which on an end is named
ON_END = 1e-6  # of a facet, within which a place is at its end


def ends_text(surface: ContactSurface, at: Projection, off: Bools) -> str:
    """Where the master of points ``at`` ends that are past it (``off``, (q,)); collective."""
    places, _ = surface.target.places(at.facet[off], at.xi[off], surface.master.position)
    master = surface.master
    extent = master.extent if isinstance(master, MasterFacets) else _extent(master.position)
    return _places_text(np.concatenate(surface.space.mesh.comm.allgather(places)), extent)


def _places_text(found: Floats, extent: float) -> str:
    """Places (n, i), m, in words: two where they lie at two ends that are far from each other."""
    if not len(found):
        return "an end"
    found = np.round(found / (SAME * extent)) * (SAME * extent) + 0.0  # round-off, and no −0
    found = found[np.lexsort(found.T[::-1])]
    apart = np.linalg.norm(found - found[0], axis=1) > 0.5 * extent
    ends = [part for part in (found[~apart], found[apart]) if len(part) >= SOME * len(found)]
    return " and ".join(place_text(part[len(part) // 2]) for part in ends)


# -- contact that reaches an end ------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PressedEnd:
    """Contact at an end of one of a pair's surfaces."""

    pressure: float = 0.0  # Pa, the largest there
    share: float = 0.0  # of the mean pressure; 0 where it is not reached
    where: str = ""  # the place, undeformed, in words

    def text(self, index: int, surface: str, of_tool: bool, when: str = "") -> str:
        """The end in words."""
        behind = "where a round part is cut off" if of_tool else "behind which its body goes on"
        return (
            f"contact.{index}: the contact reaches the end of {surface} at {self.where}, "
            f"undeformed, {behind}: {self.pressure:.3g} Pa there, "
            f"{100.0 * self.share:.3g} % of the mean pressure{when}; what lies beyond cannot "
            "press: force, area and pressures are wrong"
        )


class SmoothEnds:
    """Ends of a pair's surfaces behind which its bodies go on, so that contact may want to.

    Of a rigid tool, which has no body, they are those of its round parts.
    """

    def __init__(self, surface: ContactSurface, slave: Longs, master: Longs) -> None:
        """Find them by global nodes of corners: of the slave's ends (e, k), and the master's."""
        self._surface, vertices = surface, surface.vertices
        self._at_end: Bools = np.isin(vertices.nodes, slave)
        share = np.sum(vertices.shape * self._at_end[vertices.of_point], axis=1)
        facet = surface.slave.facet
        nearest = np.zeros(int(facet.max(initial=-1)) + 1)
        np.maximum.at(nearest, facet, share)
        # (q,) the points of each facet that are nearest to an end.
        self._last: Bools = (share > 0.0) & (share > nearest[facet] - ON_END)
        self._master, self._parts = master, surface.parts
        self._sides = self._find_sides()

    def _find_sides(self) -> list[Bools]:
        """(s, f) whether a side of the master's facets that are known is an end."""
        surface, master = self._surface, self._surface.master
        if not isinstance(master, MasterFacets):
            return []
        nodes = master.nodes[master.facets]
        sides = [np.sort(nodes[:, side.nodes[:2]], axis=1) for side in surface.shape.sides]
        return [(of[:, None] == self._master[None]).all(axis=2).any(axis=1) for of in sides]

    def pressed(self, trial: ContactTrial) -> tuple[PressedEnd, PressedEnd]:
        """Contact at the ends of the slave and of the master; collective.

        The slave's end is pressed where its last vertex is, or point by point the points next to
        it; the master's where a pressed facet of the slave has points past it, inside the body.
        """
        surface, comm, pressure = self._surface, self._surface.space.mesh.comm, trial.pressure
        weight, vertices = surface.slave.weight, surface.vertices
        own = [float(weight @ pressure), float(weight @ (pressure > 0.0))]
        force, area = comm.allreduce(np.array(own))
        if force <= 0.0:
            return PressedEnd(), PressedEnd()
        shown, mean = nodal_pressure(surface, pressure), float(force / area)
        nodal = trial.nodal_pressure
        last = self._touched(self._last & (pressure > 0.0)) if nodal is None else nodal > 0.0
        ends = last & self._at_end & (shown > FELT * mean)
        past = self._past(trial)
        beside = self._touched(past) & ((shown if nodal is None else nodal) > 0.0)
        beside &= shown > FELT * mean
        past &= _largest(shown, beside)[vertices.of_point].any(axis=1)
        places = vertices.position[_largest(shown, ends)]
        said = _places_text(places, _extent(vertices.position))
        both = (shown[ends], said), (shown[beside], ends_text(surface, trial.projection, past))
        of_slave, of_master = (
            PressedEnd(float(found.max()), float(found.max()) / mean, where)
            if len(found)
            else PressedEnd()
            for found, where in both
        )
        return of_slave, of_master

    def _touched(self, points: Bools) -> Bools:
        """Vertices (v,) of the facets of some points (q,) of all ranks; collective."""
        vertices = self._surface.vertices
        mine = np.bincount(vertices.of_point[points].reshape(-1), minlength=vertices.count)
        return vertices.total(mine.astype(np.float64)) > 0.0

    def _past(self, trial: ContactTrial) -> Bools:
        """Points (q,) past the master's ends, within what would be its body."""
        at, surface = trial.projection, self._surface
        off = ~at.on_surface & (trial.kinematics.gap < 0.0)
        corners = facet_shape(surface.shape.cell, 1).values(at.xi)
        if isinstance(surface.target, RigidSurface):
            return off & surface.target.cut_off(at.facet, at.xi)
        past = np.zeros_like(off)
        if self._parts != surface.parts:
            self._parts, self._sides = surface.parts, self._find_sides()
        for side, is_end in zip(surface.shape.sides, self._sides, strict=True):
            if is_end.any():
                on_side = corners[:, side.nodes[:2]].sum(axis=1) > 1.0 - ON_END
                past |= off & on_side & is_end[at.facet]
        return past


def _largest(values: Floats, among: Bools) -> Bools:
    """Which (v,) of some values are nearly as large as the largest of them."""
    return among & (values >= MOST * np.max(values, where=among, initial=0.0))


def _extent(places: Floats) -> float:
    return float(np.ptp(places, axis=0).max())


def _own_master(surface: ContactSurface) -> Longs:
    """Global nodes (f, a) of this rank's facets of the master; none of a tool."""
    meshed = isinstance(surface.master, MasterFacets)
    return surface.own_master if meshed else surface.slave.nodes[:0]


def _is_tool(problem: Equilibrium, index: int) -> bool:
    """Whether the master of a pair is a rigid tool."""
    return isinstance(problem.contacts[index].surface.target, RigidSurface)


def smooth_ends(problem: Equilibrium) -> list[SmoothEnds]:
    """The ends of each pair behind which its bodies go on smoothly; collective.

    A surface goes on in that of another pair whose other side is on the same body.
    """
    outer, terms = OuterFacets(problem.space), problem.contacts
    pairs = [(term.surface, bodies_of(problem, term)) for term in terms]
    # Of each pair: facets of slave and master, each with the body that it meets.
    both = [
        ((surface.slave.nodes, of.master), (_own_master(surface), of.slave))
        for surface, of in pairs
    ]
    out = []
    for index, (surface, _) in enumerate(pairs):
        ends = []
        for mine, meets in both[index]:
            others = (two for number, two in enumerate(both) if number != index)
            more = [facets for two in others for facets, met in two if met is meets]
            ends.append(outer.smooth_ends(mine, np.concatenate([mine[:0], *more])))
        out.append(SmoothEnds(surface, *ends))
    return out


class PressedEnds(Remembers):
    """Watches for contact that reaches the end of a surface where the body goes on."""

    # By pair, and 0 for the slave or 1 for the master: the most pressed end, and since when.
    _found: Kept[dict[tuple[int, int], tuple[PressedEnd, str]]]

    def __init__(self, model: Model) -> None:
        """Find the ends; collective."""
        self._problem, self._contacts = model.problem, model.case.contact
        self._ends = smooth_ends(model.problem)
        pairs = range(len(model.problem.contacts))
        self._tools = {pair for pair in pairs if _is_tool(model.problem, pair)}
        self._found = {}

    def step(self, row: Row) -> None:
        """Look at a converged step; collective."""
        for index, _, trial in self._problem.sliding(self._problem.committed):
            for side, end in enumerate(self._ends[index].pressed(trial)):
                now = f", from {row.when}, on"
                most, since = self._found.get((index, side), (PressedEnd(), now))
                if end.share > most.share:
                    self._found[index, side] = end, since

    @property
    def short_slaves(self) -> set[int]:
        """Pairs whose contact has reached the end of the slave."""
        return {index for index, side in self._found if side == 0}

    def warnings(self) -> Iterator[str]:
        """One line for each end that was reached."""
        for (index, side), (end, since) in sorted(self._found.items(), key=lambda one: one[0]):
            name = names_of(self._contacts, index)[side]
            of_tool = side == 1 and index in self._tools
            yield f"{end.text(index, name, of_tool, since)}; let {name} reach further"


class OneSidedEnds(Remembers):
    """Watches for contact at the ends of smooth masters that no plane of symmetry continues.

    A patch there has its last tangent from one side, and hands 3/8 of a facet's load to its last
    node instead of a half, 7/6 to the next.
    """

    _found: Kept[dict[int, str]]  # since when, by pair

    def __init__(self, model: Model) -> None:
        self._problem, self._contacts = model.problem, model.case.contact
        self._found = {}

    def step(self, row: Row) -> None:
        """Look at a converged step; collective."""
        for index, term, trial in self._problem.sliding(self._problem.committed):
            target, at = term.surface.target, trial.projection
            if index in self._found or not isinstance(target, FacetSurface):
                continue
            pressed = (trial.pressure > 0.0) & at.on_surface
            there = bool(target.is_smooth_end(at.facet[pressed]).any())
            if self._problem.comm.allreduce(there, op=MPI.LOR):
                when = f"from {row.when}, on"
                self._found[index] = when

    def warnings(self) -> Iterator[str]:
        """One line for each pair."""
        for index, when in sorted(self._found.items()):
            slave, master = names_of(self._contacts, index)
            yield (
                f"contact.{index}: {slave} presses on an end of {master} ({when}), where "
                "smoothing hands on too little of the load: on any mesh the last vertex has 10 to "
                "25 % too much pressure, the next is off by up to 10 %; forces are right. A mesh "
                "of second order has no such end; neither has one that symmetry = true holds"
            )


def reaches_end(problem: Equilibrium, contacts: Sequence[Contact]) -> Findings:
    """Contact that reaches the end of a surface where the body goes on; collective."""
    ends, found = smooth_ends(problem), dict[tuple[int, int], PressedEnd]()
    for trials in (problem.committed, problem.trials):
        for index, _, trial in problem.sliding(trials):
            for side, end in enumerate(ends[index].pressed(trial)):
                most = found.get((index, side), PressedEnd())
                found[index, side] = max(most, end, key=lambda one: one.share)
    for (index, side), end in sorted(found.items(), key=lambda one: one[0]):
        if end.share > 0.0:
            name = names_of(contacts, index)[side]
            of_tool = side == 1 and _is_tool(problem, index)
            reaching = f"a surface {name} that reaches further there"
            yield end.text(index, name, of_tool), reaching


# -- slaves that run past an end ------------------------------------------------------------------


def slid_off(problem: Equilibrium, contacts: Sequence[Contact]) -> Findings:
    """A point that leaves the master loses its force at once: there may be no equilibrium.

    Along the slave's normals a point also misses a master that it is beside, where the slave has
    been folded or turned: the closest points tell one from the other.
    """
    for index, (now, before) in enumerate(zip(problem.trials, problem.committed, strict=False)):
        pressed = before.pressure > 0.0
        off, missing = pressed & ~now.projection.on_surface, np.zeros_like(pressed)
        surface = problem.contacts[index].surface
        if now.projection.rays is not None and now.nodes is not None:
            missing = off & surface.project(now.position, now.nodes).on_surface
        local = np.array([np.count_nonzero(a) for a in (off, now.pressure, pressed, missing)])
        count, pressing, all_, astray = problem.comm.allreduce(local)
        if not (count and pressing):
            continue
        slave, master = names_of(contacts, index)
        if 2 * astray > count:
            where = ends_text(surface, now.projection, missing)
            yield (
                f"contact.{index}: points of {slave} that pressed have turned away from {master} "
                f"at {where}, undeformed: it does not lie along their normals any more ({astray} "
                f"of {all_} points)",
                f"smaller steps, facets of {slave} that are shorter there, or a rounder corner of "
                f"{master}",
            )
            continue
        where = ends_text(surface, now.projection, off & ~missing)
        yield (
            f"contact.{index}: points of {slave} that pressed slide off the end of {master} at "
            f"{where}, undeformed ({count - astray} of {all_} points)",
            f"a master surface {master} that reaches further there, or less sliding",
        )


class LeftMaster(Remembers):
    """Watches the points that were above the master at some row of the history.

    Those that were beside it from the start, as where a slave is simply the longer one, do not
    count, nor do points that lie above the plane of the master's end; nor a few that leave it as a
    pressed slave spreads.
    """

    _above: KeptAtPoints[list[Bools]]
    _found: Kept[dict[int, str]]  # where and when, by pair

    def __init__(self, model: Model) -> None:
        self._problem, self._contacts = model.problem, model.case.contact
        self._above = [np.isfinite(term.state.gap) for term in self._problem.contacts]
        self._found = {}

    def step(self, row: Row) -> None:
        """Look at a converged step; collective."""
        lost, whole = np.zeros(len(self._above)), np.zeros(len(self._above))
        gone: dict[int, Bools] = {}
        for index, term, trial in self._problem.sliding(self._problem.committed):
            here = trial.projection.on_surface
            left = self._above[index] & ~here & (trial.kinematics.gap < 0.0)
            self._above[index] |= here
            gone[index] = left
            weight, sums = term.surface.slave.weight, term.surface.vertices.sums
            whole[index] = sums(weight * self._above[index]).sum()
            # What another master has below it now has not run off.
            others = covered_by_others(term.neighbours, term.surface.vertices.count)
            lost[index] = np.maximum(sums(weight * left) - others, 0.0).sum()
        when = f"first at {row.when}"
        for index in map(int, np.nonzero(lost > FEW * whole)[0]):
            if index not in self._found:
                surface, at = self._problem.contacts[index].surface, self._problem.committed[index]
                where = ends_text(surface, at.projection, gone[index])
                self._found[index] = f"at {where}, undeformed: no contact there ({when})"

    def warnings(self) -> Iterator[str]:
        """One line for each pair that has lost points."""
        for index, where in self._found.items():
            pair = self._contacts[index]
            yield f"{pair.slave} runs past the end of {pair.master} {where}"


# -- sides that fold over the end of a slave ------------------------------------------------------
#
# Only surfaces that a contact names are kept out of its master. Where a billet is upset its side
# rolls over onto the die; with no contact of its own it goes through.


@dataclass(frozen=True, slots=True)
class Fold:
    """The node that is deepest in a master, none at a depth of 0."""

    depth: float = 0.0  # m
    place: tuple[float, ...] = ()  # m, undeformed
    side: str = ""  # the named surface that goes in, or ""
    since: str = ""  # when a fold was first seen, in words


class _Beside:
    """Nodes (n) on the boundary of a slave's body, and which of them went through its master."""

    def __init__(
        self, model: Model, index: int, nodes: Longs, kept: Mapping[int, Bools], around: Ints
    ) -> None:
        """Begin with local ``nodes`` (n,) and facets ``around`` as they lie undeformed; collective.

        ``kept``: by pair with this master, the nodes (n,) that it keeps out while it acts.
        """
        self._named, self._problem, self._index = model.named, model.problem, index
        surface, self._nodes, self._kept = model.problem.contacts[index].surface, nodes, kept
        self._length = surface.facet_length
        name = model.case.contact[index].master
        master = model.named.facets(name) if name in model.named.surfaces else around[:0]
        self._surface = surface.for_others(around, master)
        places = model.problem.space.tabulate_dof_coordinates()[nodes, : surface.dim]
        self._reference: Floats = places
        self._outside: Bools = np.zeros(len(nodes), dtype=bool)
        self._outside = self._look(self._surface.master.position, places)[0]

    def _look(self, master: Floats, places: Floats) -> tuple[Bools, Floats]:
        """Which nodes are in front of the master or have gone through it; depths, m, of the latter.

        What goes round the end of an open master has not gone through it.
        """
        if not len(places):
            return self._outside, np.zeros(0)
        at = self._surface.target.project(places, master)
        through: Bools = at.on_surface & (at.gap < 0.0) & self._outside
        front = at.on_surface & (at.gap >= -TOUCHES * self._length)
        return front | through, np.where(through, -at.gap, 0.0)

    def deepest(self) -> Fold:
        """The deepest node of all ranks at the last converged step; collective.

        Nodes as deep as the contact itself are on what has turned over with its last facet.
        """
        problem, surface, found = self._problem, self._surface, Fold()
        master = surface.master_positions(surface.gather(problem.u.x.petsc_vec))
        moved = problem.u.x.array.reshape(-1, surface.dim)[self._nodes]
        self._outside, depth = self._look(master, self._reference + moved)
        for pair, nodes in self._kept.items():
            if problem.contacts[pair].active:
                depth[nodes] = 0.0
        if depth.any():
            # The same of as many that are as deep, whichever rank has them.
            steps = np.round(depth / (TOUCHES * self._length))
            at = int(np.lexsort((*self._reference.T[::-1], steps))[-1])
            place = tuple(map(float, self._reference[at]))
            found = Fold(float(steps[at]) * TOUCHES * self._length, place)
        own = penetration_of(problem.committed[self._index])
        folds, depths = zip(*problem.comm.allgather((found, own)), strict=True)
        most = max(folds, key=lambda one: (one.depth, one.place))
        if most.depth <= max(depths) + DEEP * self._length:
            return Fold()
        return replace(most, side=self._side(self._nodes[depth > 0.0]))

    def _side(self, through: Longs) -> str:
        """The named surface that most nodes are on, (n,) on this rank, if any is; collective."""
        space, count = self._problem.space, dict[str, int]()
        mine = through[through < space.dofmap.index_map.size_local]
        for name in self._named.surfaces:
            facets = self._named.facets(name)
            on = facet_nodes(space, facets) if len(facets) else facets
            count[name] = space.mesh.comm.allreduce(int(np.isin(mine, on).sum()))
        most = max(count, key=lambda name: count[name], default="")
        return most if count.get(most) else ""

    def forget(self) -> None:
        """See anew which nodes are in front of the master."""
        self._outside = np.zeros_like(self._outside)


class FoldedSides(Remembers):
    """Watches for sides of bodies that fold over the end of a slave into its master."""

    _found: Kept[dict[int, Fold]]  # the deepest, by pair

    def __init__(self, model: Model) -> None:
        """Find the nodes of each slave's body; collective."""
        self._problem, self._contacts = model.problem, model.case.contact
        self._beside = _all_beside(model)
        self._found = {}

    def step(self, row: Row) -> None:
        """Look at a converged step; collective."""
        for index, beside in self._beside.items():
            if not self._problem.contacts[index].active:
                beside.forget()
                continue
            fold, before = beside.deepest(), self._found.get(index, Fold())
            if fold.depth > before.depth:
                now = f"first at {row.when}"
                self._found[index] = replace(fold, since=before.since or now)

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        super().restore(kept)
        for beside in self._beside.values():
            beside.forget()  # what is in front of the master is seen at the next step

    def warnings(self, short: Collection[int] = ()) -> Iterator[str]:
        """One line for each pair with a fold.

        Args:
            short: pairs of which it is told that the slave is to reach further: what goes on behind
                it without a name is that.
        """
        for index, fold in sorted(self._found.items()):
            if index in short and not fold.side:
                continue
            pair = self._contacts[index]
            side = fold.side or f"the boundary of the body of {pair.slave}"
            cure = fold.side or "what lies there a name and"
            yield (
                f"contact.{index}: {side} goes through {pair.master} beyond the end of "
                f"{pair.slave}, {fold.depth:.3g} m deep at {place_text(fold.place)}, undeformed "
                f"({fold.since}): no contact keeps it out, and forces are wrong; give {cure} a "
                f"[[contact]] with {pair.master} too"
            )


def _all_beside(model: Model) -> dict[int, _Beside]:
    """By pair, but for fits that overlap, the nodes of its slave's body; collective."""
    problem, contacts, found = model.problem, model.case.contact, dict[int, _Beside]()
    space, comm = problem.space, problem.comm
    outer, own, topology = OuterFacets(space).nodes, space.dofmap.index_map, space.mesh.topology
    facets = dolfinx.mesh.exterior_facet_indices(topology)
    cells = topology.connectivity(topology.dim - 1, topology.dim)
    behind = cells.array[cells.offsets[facets]]
    slaves = [
        np.concatenate(comm.allgather(np.unique(term.surface.slave.nodes)))
        for term in problem.contacts
    ]
    for index, term in enumerate(problem.contacts):
        if term.offset is not None:
            continue
        solid = bodies_of(problem, term).slave
        body = np.unique(space.dofmap.list[solid.cells])
        nodes = np.intersect1d(outer, body).astype(np.int64)
        number = own.local_to_global(nodes.astype(np.int32))
        kept = {
            pair: np.isin(number, slave)
            for pair, slave in enumerate(slaves)
            if contacts[pair].master == contacts[index].master
        }
        around = facets[np.isin(behind, solid.cells)]
        found[index] = _Beside(model, index, nodes, kept, around)
    return found
