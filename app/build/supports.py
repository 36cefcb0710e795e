"""The directions in which no boundary supports a body, found from the constrained unknowns."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from app.case.boundary import COMPONENTS
from app.equilibrium.equilibrium import Equilibrium
from geometry.surfaces.facets import Ints


@dataclass(frozen=True, slots=True)
class Loose:
    """A direction in which no boundary supports a body.

    Attributes:
        body: the body's name; component: 0 for x, 1 for y.
        nodes: local nodes of the body, owned by this rank.
    """

    body: str
    component: int
    nodes: Ints

    @property
    def text(self) -> str:
        """The body and the direction, in words."""
        return f"body {self.body} has no support in {COMPONENTS[self.component]}"


def loose_directions(problem: Equilibrium, supports: Ints | None = None) -> list[Loose]:
    """The directions in which a body has no support; collective.

    A body of revolution cannot move away from its axis: it has to widen for that.

    Args:
        problem: the equilibrium.
        supports: owned local unknowns that count as supported; None: those with a prescribed
            displacement.
    """
    table = problem.space.dofmap.list
    supports = problem.constrained_dofs() if supports is None else supports
    found = []
    for solid in problem.solids:
        nodes = np.unique(table[solid.cells])
        nodes = nodes[nodes < problem.owned // problem.dim]
        for component in range(1 if solid.section == "axisymmetric" else 0, problem.dim):
            here = bool(np.isin(nodes * problem.dim + component, supports).any())
            if not problem.comm.allreduce(here, op=MPI.LOR):
                found.append(Loose(solid.name, component, nodes))
    return found


def notes_on_supports(problem: Equilibrium, touching: bool) -> Iterator[str]:
    """A line on each body and direction that contact alone supports; collective.

    A spring is a support. A platen is one where the bodies touch from the start, as they are meant
    to then.

    Args:
        problem: the equilibrium.
        touching: whether the bodies touch from the start.
    """
    moved = [p.dofs for p in problem.platens if touching or p.stiffness > 0.0]
    for one in loose_directions(problem, np.concatenate([problem.constrained_dofs(), *moved])):
        yield (
            f"body {one.body}: no boundary prescribes a displacement in "
            f"{COMPONENTS[one.component]}; only contact holds it there"
        )
