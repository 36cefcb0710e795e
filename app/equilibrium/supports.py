"""The directions in which no boundary supports a body, found from the constrained unknowns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from app.equilibrium.equilibrium import Equilibrium
from geometry.surfaces.facets import Bools, Ints


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
    nodes = [body_nodes(problem, solid.cells) for solid in problem.solids]
    axes = np.arange(problem.dim)
    here = [[np.isin(n * problem.dim + axis, supports).any() for axis in axes] for n in nodes]
    held: Bools = np.zeros((len(nodes), problem.dim), dtype=bool)
    problem.comm.Allreduce(np.array(here, dtype=bool), held, op=MPI.LOR)
    for some in _bonded(problem):  # as often as it takes to go from each body to each
        held[some] |= held[some].any(axis=0)
    found = []
    for number, solid in enumerate(problem.solids):
        for axis in range(1 if solid.section == "axisymmetric" else 0, problem.dim):
            if not held[number, axis]:
                found.append(Loose(solid.name, axis, nodes[number]))
    return found


def _bonded(problem: Equilibrium) -> list[Ints]:
    """Numbers of the bodies that hold together by ties, pair by pair, repeated; collective."""
    ties = [term for term in problem.contacts if term.tied and term.active]
    if not ties:
        return []
    index = problem.space.dofmap.index_map
    mine = [
        index.local_to_global(np.unique(problem.space.dofmap.list[s.cells]).astype(np.int32))
        for s in problem.solids
    ]
    here = [
        [np.isin(n, term.surface.nodes[: term.surface.first_master]).any() for n in mine]
        + [np.isin(n, term.surface.master.nodes).any() for n in mine]
        for term in ties
    ]
    touched = np.zeros((len(ties), 2 * len(mine)), dtype=bool)
    problem.comm.Allreduce(np.array(here, dtype=bool), touched, op=MPI.LOR)
    count = len(mine)
    pairs = [np.nonzero(t[:count] | t[count:])[0].astype(np.int32) for t in touched]
    return pairs * count


def body_nodes(problem: Equilibrium, cells: Ints) -> Ints:
    """Local nodes of a body's owned cells, those that this rank owns."""
    nodes = np.unique(problem.space.dofmap.list[cells])
    out: Ints = nodes[nodes < problem.owned // problem.dim]
    return out


def sprung_dofs(problem: Equilibrium) -> Ints:
    """Owned local unknowns that a support or a spring holds."""
    sprung: Iterable[Ints] = (p.dofs for p in problem.platens if p.stiffness > 0.0)
    return np.concatenate([problem.constrained_dofs(), *sprung]).astype(np.int32)
