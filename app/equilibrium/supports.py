"""The directions in which no boundary supports a body, found from the constrained unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.equilibrium.equilibrium import Equilibrium
from forms.bodies.loads import Foundation
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
        return f"body {self.body} has no support in {'xyz'[self.component]}"


def loose_directions(problem: Equilibrium, supports: Ints | None = None) -> list[Loose]:
    """The directions in which a body has no support; collective.

    A body of revolution cannot move away from its axis: it has to widen for that.

    Args:
        problem: the equilibrium.
        supports: owned local unknowns that count as supported; None: those with a prescribed
            displacement.
    """
    supports = problem.constrained_dofs() if supports is None else supports
    found = []
    for solid in problem.solids:
        nodes, dim = body_nodes(problem, solid.cells), problem.dim
        held = np.zeros((dim, dim))
        for component in range(dim):
            held[component, component] = np.isin(nodes * dim + component, supports).any()
        for platen in problem.constraints.slanted:
            if platen.acts and (platen.displacement is not None or platen.stiffness > 0.0):
                here = np.isin(nodes * dim, platen.dofs).any()
                held += here * np.outer(platen.normal, platen.normal)
        held = problem.comm.allreduce(held)
        free = np.eye(dim) - np.linalg.pinv(held) @ held  # onto the directions nothing holds
        for component in range(1 if solid.section == "axisymmetric" else 0, dim):
            if free[component, component] > 1e-9:
                found.append(Loose(solid.name, component, nodes))
    return found


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
