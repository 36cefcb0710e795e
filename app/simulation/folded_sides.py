"""Sides of a body that fold over the end of a slave, and go into its master unfelt.

Only surfaces that a contact names are kept out of its master. Where a billet is upset its side
rolls over onto the die; with no contact of its own it goes through. Axis letters: n nodes of a
body's boundary beside a slave, i space.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from tribox.app.build.model import Model
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.equilibrium.supports import bodies_of
from tribox.app.equilibrium.unknowns import place_text
from tribox.app.simulation.history import Row, time_text
from tribox.forms.contact.penalty import ContactTerm
from tribox.geometry.surfaces.body_facets import OuterFacets, facet_nodes
from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.master import MasterFacets
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.rigid import RigidSurface
from tribox.geometry.surfaces.rigid_mesh import MeshSurface
from tribox.geometry.surfaces.surface import ContactSurface

DEEP = 0.05  # depth over the length of a slave facet from which on a fold is told

TOUCHES = 1e-6  # of that length, up to which a node may start inside


@dataclass(frozen=True, slots=True)
class Fold:
    """The node that is deepest in a master, none at a depth of 0.

    Attributes:
        depth: m; place: m, undeformed; side: the named surface that goes in, or "".
        since: when a fold was first seen, in words.
    """

    depth: float = 0.0
    place: tuple[float, ...] = ()
    side: str = ""
    since: str = ""


class _Beside:
    """Nodes of a slave's body on its boundary that no contact keeps out of the master."""

    def __init__(self, model: Model, term: ContactTerm, nodes: Longs) -> None:
        """Begin with all of them as they lie undeformed.

        Args:
            nodes: (n,), this rank's local ones.
        """
        self._named, self._problem, self._term = model.named, model.problem, term
        self._target = _own_target(term.surface)
        self._nodes = nodes
        dim = term.surface.dim
        self._reference: Floats = model.problem.space.tabulate_dof_coordinates()[nodes, :dim]
        self._outside: Bools = np.zeros(len(nodes), dtype=bool)
        self._outside = self._look(term.surface.master.position, self._reference)[0]

    def _look(self, master: Floats, places: Floats) -> tuple[Bools, Floats]:
        """Which nodes are in front of the master or have gone through it; depths, m, of the latter.

        What goes round the end of an open master has not gone through it.
        """
        if not len(places):
            return self._outside, np.zeros(0)
        at = self._target.project(places, master)
        through: Bools = at.on_surface & (at.gap < 0.0) & self._outside
        front = at.on_surface & (at.gap >= -TOUCHES * self._term.surface.facet_length)
        return front | through, np.where(through, -at.gap, 0.0)

    def deepest(self) -> Fold:
        """The deepest node of all ranks at the last converged step; collective."""
        problem, surface, found = self._problem, self._term.surface, Fold()
        master = surface.master_positions(surface.gather(problem.u.x.petsc_vec))
        moved = problem.u.x.array.reshape(-1, surface.dim)[self._nodes]
        self._outside, depth = self._look(master, self._reference + moved)
        if depth.any():
            at = int(np.argmax(depth))
            place = tuple(map(float, self._reference[at]))
            found = Fold(float(depth[at]), place, self._side(self._nodes[depth > 0.0]))
        all_ = problem.comm.allgather(found)
        return max(all_, key=lambda one: (one.depth, one.place, one.side))

    def _side(self, through: Longs) -> str:
        """The named surface that most of this rank's nodes (n,) are on, if any is."""
        count = {
            name: int(np.isin(through, facet_nodes(self._problem.space, facets)).sum())
            for name in self._named.surfaces
            if len(facets := self._named.facets(name))
        }
        most = max(count, key=lambda name: count[name], default="")
        return most if count.get(most) else ""

    def forget(self) -> None:
        """See anew which nodes are in front of the master."""
        self._outside = np.zeros_like(self._outside)


class FoldedSides:
    """Watches for sides of bodies that fold over the end of a slave into its master."""

    def __init__(self, model: Model) -> None:
        """Find the nodes beside each slave; collective."""
        self._problem, self._contacts = model.problem, model.case.contact
        self._beside = _all_beside(model)
        self._found: dict[int, Fold] = {}

    def step(self, row: Row) -> None:
        """Look at a converged step; collective."""
        for index, beside in self._beside.items():
            term = self._problem.contacts[index]
            if not term.active:
                beside.forget()
                continue
            fold, before = beside.deepest(), self._found.get(index)
            deep = row.max_penetration + DEEP * term.surface.facet_length
            if fold.depth > max(deep, 0.0 if before is None else before.depth):
                now = f"first at time {time_text(row.time, row.dt)}, stage {row.stage}"
                since = now if before is None else before.since
                self._found[index] = Fold(fold.depth, fold.place, fold.side, since)

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        rows = self._found.items()
        return {"found": [[i, f.depth, list(f.place), f.side, f.since] for i, f in rows]}

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._found = {
            int(i): Fold(depth, tuple(place), side, since)
            for i, depth, place, side, since in kept["found"]
        }
        for beside in self._beside.values():
            beside.forget()  # what is in front of the master is seen at the next step

    def warnings(self, told: Collection[int]) -> Iterator[str]:
        """One line for each pair, but for those of which it is told that their slave is short."""
        for index, fold in sorted(self._found.items()):
            if index in told:
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


def _own_target(surface: ContactSurface) -> FacetSurface | RigidSurface:
    """A pair's master for other points than the slave's, whose search goes on from the last one."""
    target, master = surface.target, surface.master
    if isinstance(master, MasterFacets):
        return FacetSurface(surface.shape, master.facets, master.position)
    if isinstance(target, MeshSurface):
        return MeshSurface(target.nodes, target.facets)
    return target


def _all_beside(model: Model) -> dict[int, _Beside]:
    """By pair: the nodes beside its slave; collective.

    Not of fits that overlap, nor of masters of which a rank knows but a part.
    """
    problem, found = model.problem, dict[int, _Beside]()
    space, comm = problem.space, problem.comm
    outer, own = OuterFacets(space).nodes(), space.dofmap.index_map
    for index, term in enumerate(problem.contacts):
        surface, master = term.surface, model.case.contact[index].master
        part = isinstance(surface.master, MasterFacets) and surface.dim == 3 and comm.size > 1
        if part or term.offset is not None:
            continue
        kept = [
            other.surface.slave.nodes.reshape(-1)
            for other, table in zip(problem.contacts, model.case.contact, strict=True)
            if table.master == master
        ]
        taken = np.concatenate(comm.allgather(np.unique(np.concatenate(kept))))
        body = np.unique(space.dofmap.list[bodies_of(problem, term).slave.cells])
        nodes = np.intersect1d(outer, body).astype(np.int64)
        number = own.local_to_global(nodes.astype(np.int32))
        found[index] = _Beside(model, term, nodes[~np.isin(number, taken)])
    return found
