"""The directions in which nothing supports a body or a tool, from the constrained unknowns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.bonded import bonded_groups
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.joined_bodies import JoinedBodies, joined_bodies
from tribox.app.equilibrium.rigid_tool import RigidTool
from tribox.forms.bodies.loads import Foundation
from tribox.geometry.surfaces.facets import Bools, Ints


@dataclass(frozen=True, slots=True)
class Loose:
    """A direction in which no boundary supports a body, bodies that are bonded, or a tool.

    Attributes:
        bodies: their names, or the tool's; component: 0 for x, 1 for y.
        nodes: their local nodes, owned by this rank.
        kind: "body" or "tool".
        turns: whether the direction is the angle of a tool, which the first component of a node of
            its own holds.
    """

    bodies: tuple[str, ...]
    component: int
    nodes: Ints
    kind: str = "body"
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
        problem: the equilibrium.
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
        support += here * np.outer(platen.normal, platen.normal)
    support = problem.comm.allreduce(support) + np.diag(held.astype(float))
    free = np.eye(problem.dim) - np.linalg.pinv(support) @ support  # onto what nothing holds
    out: Bools = np.diag(free) > 1e-9
    return out


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
    free: Bools = problem.comm.allreduce(here.astype(np.int32), op=MPI.SUM) == 0
    return free


def body_nodes(problem: Equilibrium, cells: Ints) -> Ints:
    """Local nodes of a body's owned cells, those that this rank owns."""
    nodes = np.unique(problem.space.dofmap.list[cells])
    out: Ints = nodes[nodes < problem.owned // problem.dim]
    return out


def sprung_dofs(problem: Equilibrium) -> Ints:
    """Owned local unknowns that a support, a spring or a foundation holds."""
    aligned, loads = problem.constraints.acting, problem.loads
    sprung = [platen.dofs for platen in aligned if platen.stiffness > 0.0]
    sprung += [load.held for load in loads if isinstance(load, Foundation) and load.acts]
    return np.concatenate([problem.constrained_dofs(), *sprung]).astype(np.int32)
