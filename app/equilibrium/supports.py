"""What holds bodies and tools: which of them move as one, and in which directions they are free."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.constraints import Platen
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.rigid_tool import RigidTool
from tribox.app.equilibrium.slanted import SlantedPlaten
from tribox.app.equilibrium.unknowns import box_of
from tribox.forms.bodies.loads import Foundation
from tribox.forms.bodies.materials import contact_shear_modulus
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.penalty import ContactTerm
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs

# -- Bodies that share nodes: they are bonded, and move and balance as one -------------------------


def bonded_groups(problem: Equilibrium) -> list[list[Solid]]:
    """All bodies, those together that are connected by shared nodes; collective.

    They are in the order of the problem's bodies; the same on all ranks.
    """
    solids, dofmap = problem.solids, problem.space.dofmap
    nodes = [dofmap.list[solid.cells] for solid in solids]
    shared = sharing(dofmap.index_map, problem.comm, nodes)
    return [[solids[k] for k in group] for group in connected(len(solids), shared)]


def sharing(
    index: dolfinx.common.IndexMap, comm: MPI.Comm, sets: Sequence[Ints]
) -> dict[tuple[int, int], int]:
    """How many nodes two of several sets, by local numbers, share, where they do; collective."""
    used = []
    for nodes in sets:
        marks = dolfinx.la.vector(index, 1, dtype=np.float64)
        marks.array[np.unique(nodes)] = 1.0
        # A node may be used only on a rank that does not own it.
        marks.scatter_reverse(dolfinx.la.InsertMode.add)
        used.append(marks.array[: index.size_local] > 0.0)
    pairs = list(combinations(range(len(sets)), 2))
    local = np.array([np.count_nonzero(used[a] & used[b]) for a, b in pairs], dtype=np.int64)
    counts = comm.allreduce(local, op=MPI.SUM)
    return {pair: int(count) for pair, count in zip(pairs, counts, strict=True) if count}


def connected(count: int, pairs: Iterable[tuple[int, int]]) -> list[list[int]]:
    """The numbers below ``count``, those together that pairs connect."""
    group = list(range(count))
    for a, b in pairs:
        new, old = group[a], group[b]
        group = [new if of == old else of for of in group]
    return [[k for k, of in enumerate(group) if of == one] for one in dict.fromkeys(group)]


# -- Which bodies a contact is between -------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PairBodies:
    """The bodies of one contact."""

    slave: Solid  # the body whose surface it is
    master: Solid | RigidTool  # likewise, or the tool

    @property
    def softer(self) -> Solid:
        """The body that bends and bulges more easily, whose stiffness the penalty is one of."""
        if isinstance(self.master, RigidTool):
            return self.slave
        return min(self.slave, self.master, key=lambda solid: contact_shear_modulus(solid.material))


def bodies_of(problem: Equilibrium, term: ContactTerm) -> PairBodies:
    """The bodies that a contact's surfaces belong to; collective."""
    owners = [_nodes_of(problem, solid) for solid in problem.solids]
    surface = term.surface

    def owner(nodes: Longs) -> Solid:
        counts = np.array([np.count_nonzero(np.isin(nodes, mine)) for mine in owners])
        return problem.solids[int(np.argmax(problem.comm.allreduce(counts)))]

    slave = owner(np.unique(surface.slave.nodes))
    tools = [t for t in problem.tools if np.array_equal(t.nodes, surface.own_master)]
    return PairBodies(slave, tools[0] if tools else owner(np.unique(surface.own_master)))


def _nodes_of(problem: Equilibrium, solid: Solid) -> Longs:
    """Global nodes of this rank's cells of a solid."""
    dofmap = problem.space.dofmap
    local = np.unique(dofmap.list[solid.cells]).astype(np.int32)
    return dofmap.index_map.local_to_global(local).astype(np.int64)


# -- Bodies that move as one: those that common nodes or ties join ---------------------------------


@dataclass(frozen=True, slots=True)
class Grip:
    """A surface that is tied to a tool."""

    tool: RigidTool  # that grips
    nodes: Ints  # owned local nodes of the surface

    def resisted(self, problem: Equilibrium, moved: Floats, free: Bools) -> Floats:
        """What is left of motions (n, i, r) of the nodes when the tool has followed; collective.

        Args:
            free: (k,) slots of the tool that nothing holds.
        """
        place = problem.space.tabulate_dof_coordinates()[self.nodes, : problem.dim]
        points = self.tool.surface.shares(place)
        carried = np.einsum("na,aik->nik", points, self.tool.motion.tangent(0.0))
        rows, own = place.size, int(np.count_nonzero(free))
        follow = carried[:, :, : len(free)][:, :, free].reshape(rows, own)
        flat = moved.reshape(rows, moved.shape[2])
        sums = problem.comm.allreduce(follow.T @ np.concatenate([follow, flat], axis=1))
        # Least squares: the tool takes the slots that are nearest to the motion; what is left of it
        # the grip resists. The pseudo-inverse, for slots may do the same to a small surface.
        out = flat - follow @ (np.linalg.pinv(sums[:, :own]) @ sums[:, own:])
        return out.reshape(moved.shape)


@dataclass(frozen=True, slots=True)
class JoinedBodies:
    """Bodies that are supported, or not, together."""

    # bodies, those together that share nodes; ties join the groups
    groups: tuple[tuple[Solid, ...], ...]
    grips: tuple[Grip, ...] = ()  # contacts that tie one of them to a tool

    @property
    def of_revolution(self) -> bool:
        """Whether they are bodies of revolution, which go nowhere along the radius."""
        return self.solids[0].section == "axisymmetric"

    @property
    def solids(self) -> tuple[Solid, ...]:
        """All bodies."""
        return tuple(solid for group in self.groups for solid in group)

    @property
    def names(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(solid.name for solid in self.solids)

    @property
    def cells(self) -> Ints:
        """Local cells of all of them."""
        return np.concatenate([solid.cells for solid in self.solids])


def joined_bodies(problem: Equilibrium, tied: Sequence[bool] | None = None) -> list[JoinedBodies]:
    """All bodies, in the order of the first of each; the same on all ranks; collective.

    Args:
        tied: of each contact, whether it is a tie that counts; None: those that act at present.
    """
    if tied is None:
        tied = [term.tied and term.active for term in problem.contacts]
    groups = bonded_groups(problem)
    number = {solid.name: at for at, group in enumerate(groups) for solid in group}
    of, grips = list(range(len(groups))), []
    for term, counts in zip(problem.contacts, tied, strict=True):
        if counts:
            pair = bodies_of(problem, term)
            if isinstance(pair.master, RigidTool):
                grip = Grip(pair.master, _owned(problem, term.surface.slave.nodes))
                grips.append((number[pair.slave.name], grip))
                continue
            first, second = sorted(of[number[one.name]] for one in (pair.slave, pair.master))
            # All groups joined so far take the first one's number, in whatever order ties come.
            of = [first if one == second else one for one in of]
    return [
        JoinedBodies(
            tuple(tuple(group) for at, group in enumerate(groups) if of[at] == first),
            tuple(grip for at, grip in grips if of[at] == first),
        )
        for first in dict.fromkeys(of)
    ]


def _owned(problem: Equilibrium, nodes: Longs) -> Ints:
    """Owned local nodes, each once, of the global ``nodes``, that any rank names; collective."""
    first, last = problem.space.dofmap.index_map.local_range
    every = np.unique(np.concatenate(problem.comm.allgather(np.unique(nodes))))
    return (every[(every >= first) & (every < last)] - first).astype(np.int32)


# -- Directions in which nothing supports a body or a tool -----------------------------------------


@dataclass(frozen=True, slots=True)
class Loose:
    """A direction in which no boundary supports a body, bodies that are bonded, or a tool."""

    bodies: tuple[str, ...]  # their names, or the tool's
    component: int  # 0 for x, 1 for y
    nodes: Ints  # their local nodes, owned by this rank
    kind: str = "body"  # "body" or "tool"
    # whether the direction is the angle of a tool, which the first component of a node of its own
    # holds
    turns: bool = False

    @property
    def name(self) -> str:
        """The body or the tool, in words."""
        return f"{self.kind} {self.body}"

    @property
    def direction(self) -> str:
        """The direction, in words."""
        return "rotation" if self.turns else "xyz"[self.component]

    @property
    def body(self) -> str:
        """The name, or the names of bonded bodies."""
        return " and ".join(self.bodies)

    @property
    def text(self) -> str:
        """The body and the direction, in words."""
        return f"{self.name} has no support in {self.direction}"


def loose_directions(problem: Equilibrium, supports: Ints | None = None) -> list[Loose]:
    """The directions in which a body, several that are bonded, or a tool has no support.

    Collective.

    A body of revolution cannot move away from its axis: it has to widen for that.

    Args:
        supports: owned local unknowns that count as supported; None: those with a prescribed
            displacement.
    """
    supports = problem.constrained_dofs() if supports is None else supports
    whole = joined_bodies(problem)
    loose = {
        name: axes
        for joined in whole
        for axes in [_axes_of(problem, joined, supports)]
        for name in joined.names
    }
    grips = {grip.tool.name for joined in whole for grip in joined.grips}
    found = []
    for group in bonded_groups(problem):
        nodes = body_nodes(problem, np.concatenate([solid.cells for solid in group]))
        names = tuple(solid.name for solid in group)
        for axis in range(1 if group[0].section == "axisymmetric" else 0, problem.dim):
            if loose[names[0]][axis]:
                found.append(Loose(names, axis, nodes))
    return [*found, *(t for t in _loose_tools(problem, supports) if t.bodies[0] not in grips)]


def _axes_of(problem: Equilibrium, joined: JoinedBodies, supports: Ints) -> Bools:
    """Axes (i,) that joined bodies can move along, unknowns ``supports`` being held; collective."""
    nodes, dim = body_nodes(problem, joined.cells), problem.dim
    here = [np.isin(nodes * dim + axis, supports).any() for axis in range(dim)]
    held: Bools = np.zeros(dim, dtype=bool)
    problem.comm.Allreduce(np.array(here, dtype=bool), held, op=MPI.LOR)
    for grip in joined.grips:
        held |= ~free_slots(problem, grip.tool, supports)[:dim]
    return _loose_axes(problem, nodes, held)


def _loose_axes(problem: Equilibrium, nodes: Ints, held: Bools) -> Bools:
    """Axes (i,) that bodies can move along, some supports being along none; collective."""
    given = [p for p in problem.constraints.slanted if p.acts and p.displacement is not None]
    if not given:
        return ~held
    support = np.zeros((problem.dim, problem.dim))
    for platen in given:
        here = bool(np.isin(nodes * problem.dim, platen.dofs).any())
        # Σ n⊗n of the supports that act: its null space is what none of them holds.
        support += here * np.outer(platen.normal, platen.normal)
    support = problem.comm.allreduce(support) + np.diag(held.astype(float))
    free = np.eye(problem.dim) - np.linalg.pinv(support) @ support  # onto what nothing holds
    return np.diag(free) > 1e-9


def _loose_tools(problem: Equilibrium, supports: Ints) -> Iterator[Loose]:
    """Slots of tools that a force or a moment drives at present; collective.

    An idle angle has a spring of its own.
    """
    for tool in problem.tools:
        for slot in np.nonzero(tool.free & free_slots(problem, tool, supports))[0]:
            turns = bool(slot == tool.slots - 1)
            if not (turns and tool.idle):
                component = 0 if turns else int(slot)
                yield Loose((tool.name,), component, tool.node(int(slot)), "tool", turns)


def free_slots(problem: Equilibrium, tool: RigidTool, supports: Ints) -> Bools:
    """Slots (k,) of a tool that are none of the owned unknowns ``supports``; collective."""
    here = tool.here & np.isin(tool.dofs, supports)
    return problem.comm.allreduce(here.astype(np.int32), op=MPI.SUM) == 0


def body_nodes(problem: Equilibrium, cells: Ints) -> Ints:
    """Local nodes of a body's owned cells, those that this rank owns."""
    nodes = np.unique(problem.space.dofmap.list[cells])
    return nodes[nodes < problem.owned // problem.dim]


def sprung_dofs(problem: Equilibrium) -> Ints:
    """Owned local unknowns that a support, a spring or a foundation holds."""
    aligned, loads = problem.constraints.acting, problem.loads
    sprung = [platen.dofs for platen in aligned if platen.stiffness > 0.0]
    sprung += [load.held for load in loads if isinstance(load, Foundation) and load.acts]
    return np.concatenate([problem.constrained_dofs(), *sprung]).astype(np.int32)


# -- Bodies that are free to move as a whole, in any direction or by turning -----------------------

SINGULAR = 1e-9  # least over largest eigenvalue of what supports do to rigid motions of a free body
TAKES_PART = 0.05  # component of a motion in a free one from which on it is named


@dataclass(frozen=True, slots=True)
class FreeBody:
    """A body, or several that are joined, with a rigid motion that no support prevents."""

    joined: JoinedBodies  # the bodies
    nodes: Ints  # local nodes that this rank owns
    extent: float  # m, its largest along an axis
    motions: tuple[str, ...]  # those that are left, in words

    @property
    def name(self) -> str:
        """The name, or the names of joined bodies."""
        return " and ".join(self.joined.names)


def free_bodies(problem: Equilibrium) -> list[FreeBody]:
    """The bodies that the constraints at hand leave free, undeformed; collective.

    Bodies that common nodes or ties join are one, with what supports any of them. A platen under a
    given force keeps its surface from turning, springs and foundations hold, as do tools that a
    surface is tied to.
    """
    return [body for one in joined_bodies(problem) if (body := _free(problem, one)) is not None]


def supports_at_hand(problem: Equilibrium) -> tuple[object, ...]:
    """What :func:`free_bodies` depends on, and stages change; the same on all ranks."""
    ties = tuple(term.active for term in problem.contacts if term.tied)
    beds = tuple(load.acts for load in problem.loads if isinstance(load, Foundation))
    return problem.constraints.controls, ties, beds


def _free(problem: Equilibrium, joined: JoinedBodies) -> FreeBody | None:
    nodes = body_nodes(problem, joined.cells)
    modes, extent = motions_of(problem, nodes, joined.of_revolution)
    mine = nodes[:, None] * problem.dim + np.arange(problem.dim)
    beds = [load.held for load in problem.loads if isinstance(load, Foundation) and load.acts]
    resisted = np.isin(mine, np.concatenate([problem.constrained_dofs(), *beds]))
    # Springs of stiffness 1 at all held unknowns: their energy in rigid motions, Φᵀ Φ over these. A
    # motion without energy is free.
    gram = problem.comm.allreduce(np.einsum("nai,nbi,ni->ab", modes, modes, resisted))
    for platen in problem.platens:
        oblique = isinstance(platen, SlantedPlaten)
        if platen.acts and (oblique or platen.displacement is None):
            gram = gram + _as_one(problem, platen, modes, mine)
    for grip in joined.grips:
        moved = modes.transpose(0, 2, 1)[np.searchsorted(nodes, grip.nodes)]
        free = free_slots(problem, grip.tool, sprung_dofs(problem))
        left = grip.resisted(problem, moved, free)
        gram = gram + problem.comm.allreduce(np.einsum("nia,nib->ab", left, left))
    loose = motions_left(problem, gram, nodes)
    if not loose.any():
        return None
    axes = "xyz"[: problem.dim]
    turns = [f"turning about {axis}" for axis in ("z" if problem.dim == 2 else axes)]
    names = [*(f"moving in {axis}" for axis in axes), *turns]
    names = names[1:2] if len(loose) == 1 else names  # of a ring
    words = tuple(name for name, free in zip(names, loose, strict=True) if free)
    return FreeBody(joined, nodes, extent, words)


def motions_of(
    problem: Equilibrium, nodes: Ints, axisymmetric: bool = False
) -> tuple[Floats, float]:
    """Rigid motions of a body in the measure of its extent; collective.

    Returns the motions (n, r, i), and the body's largest extent along an axis, m.

    Args:
        nodes: (n,) local ones of the body that this rank owns.
    """
    at = problem.space.tabulate_dof_coordinates()[nodes, : problem.dim]
    box = box_of(problem.comm, at)
    extent = float(np.ptp(box, axis=0).max())
    return rigid_motions((at - box.mean(axis=0)) / extent, axisymmetric), extent


def motions_left(problem: Equilibrium, gram: Floats, nodes: Ints) -> Bools:
    """Which motions (r,) take part in those of a body that supports leave free; collective.

    Args:
        gram: (r, r), what the supports do to the motions, summed over all ranks.
    """
    values, vectors = np.linalg.eigh(gram)
    count = problem.comm.allreduce(len(nodes))
    loose = vectors[:, values <= SINGULAR * max(values[-1], 1.0 / max(count, 1))]
    return np.linalg.norm(loose, axis=1) > TAKES_PART


def rigid_motions(place: Floats, axisymmetric: bool = False) -> Floats:
    """Small rigid motions (n, r, i) of places (n, i): along the axes, then about them.

    A body of revolution moves along its axis only.
    """
    count, dim = place.shape
    along = np.broadcast_to(np.eye(dim), (count, dim, dim))
    if axisymmetric:
        return along[:, 1:2]
    if dim == 2:
        # Infinitesimal rotations: e × X.
        about: Floats = np.stack([-place[:, 1], place[:, 0]], axis=1)[:, None]
    else:
        about = np.asarray(np.cross(np.eye(3)[None], place[:, None]), dtype=np.float64)
    return np.concatenate([along, about], axis=1)


def _as_one(problem: Equilibrium, platen: Platen, modes: Floats, mine: Ints) -> Floats:
    """What a platen does (r, r) to the motions of a body: its nodes move alike; collective."""
    here = np.isin(mine, platen.dofs)
    rows: Floats = modes.transpose(0, 2, 1)[here]
    if isinstance(platen, SlantedPlaten):
        rows = modes[here.all(axis=1)] @ platen.normal
    total = problem.comm.allreduce(np.concatenate([rows.sum(axis=0), [len(rows)]]))
    # A platen under a force may move as a whole: what counts is by how much its nodes move apart.
    # Held or on a spring it is their motion itself.
    mean = total[:-1] / max(total[-1], 1.0)
    fixed = platen.stiffness > 0.0 or platen.displacement is not None
    apart = rows if fixed else rows - mean
    return problem.comm.allreduce(apart.T @ apart)
