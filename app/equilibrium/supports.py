"""The directions in which nothing supports a body or a tool, from the constrained unknowns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from app.equilibrium.bonded import bonded_groups
from app.equilibrium.equilibrium import Equilibrium
from geometry.surfaces.facets import Ints


@dataclass(frozen=True, slots=True)
class Loose:
    """A direction in which no boundary supports a body, bodies that are bonded, or a tool.

    Attributes:
        bodies: their names; component: 0 for x, 1 for y.
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
    """The directions in which a body, bonded bodies, or a tool have no support; collective.

    A body of revolution cannot move away from its axis: it has to widen for that.

    Args:
        problem: the equilibrium.
        supports: owned local unknowns that count as supported; None: those with a prescribed
            displacement.
    """
    supports = problem.constrained_dofs() if supports is None else supports
    found = []
    for group in bonded_groups(problem):
        names = tuple(solid.name for solid in group)
        nodes = body_nodes(problem, np.concatenate([solid.cells for solid in group]))
        for component in range(1 if group[0].section == "axisymmetric" else 0, problem.dim):
            here = bool(np.isin(nodes * problem.dim + component, supports).any())
            if not problem.comm.allreduce(here, op=MPI.LOR):
                found.append(Loose(names, component, nodes))
    return [*found, *_loose_tools(problem)]


def _loose_tools(problem: Equilibrium) -> Iterator[Loose]:
    """Slots of tools that a force or a moment drives; an idle angle has a spring of its own."""
    for tool in problem.tools:
        for slot in np.nonzero(tool.free)[0]:
            turns = bool(slot == tool.slots - 1)
            if not (turns and tool.idle):
                component = 0 if turns else int(slot)
                yield Loose((tool.name,), component, tool.node(int(slot)), "tool", turns)


def body_nodes(problem: Equilibrium, cells: Ints) -> Ints:
    """Local nodes of a body's owned cells, those that this rank owns."""
    nodes = np.unique(problem.space.dofmap.list[cells])
    out: Ints = nodes[nodes < problem.owned // problem.dim]
    return out


def sprung_dofs(problem: Equilibrium) -> Ints:
    """Owned local unknowns that a support or a spring holds."""
    sprung: Iterable[Ints] = (p.dofs for p in problem.platens if p.stiffness > 0.0)
    return np.concatenate([problem.constrained_dofs(), *sprung]).astype(np.int32)
