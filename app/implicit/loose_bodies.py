"""The bodies that contact alone holds, and springs that hold them meanwhile."""

from __future__ import annotations

from dataclasses import dataclass, field

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.step_mode import HoldingSprings
from tribox.app.equilibrium.supports import (
    Loose,
    body_nodes,
    bonded_groups,
    loose_directions,
    sprung_dofs,
)
from tribox.geometry.surfaces.facets import Floats


@dataclass(slots=True)
class LooseBodies:
    """The bodies that contact alone holds, each in one direction.

    Attributes:
        problem: the equilibrium; directions: in which bodies are loose.
        shares: (m,) of the owned nodes in the volume of their bodies.
    """

    problem: Equilibrium
    directions: list[Loose] = field(init=False)
    shares: Floats = field(init=False)

    def __post_init__(self) -> None:
        """Find them; collective."""
        self.directions = loose_directions(self.problem, sprung_dofs(self.problem))
        self.shares = nodal_shares(self.problem) if self.directions else np.empty(0)

    def sums(self, values: Floats) -> Floats:
        """Sum of ``values`` (n,) of the owned unknowns in each direction (d,); collective."""
        dim = self.problem.dim
        local = [values[one.nodes * dim + one.component].sum() for one in self.directions]
        total: Floats = self.problem.comm.allreduce(np.array(local, dtype=float), op=MPI.SUM)
        return total

    def moved(self, increment: Floats) -> Floats:
        """Mean displacement (d,), m, in each direction; collective."""
        dim = self.problem.dim
        return self.sums(np.repeat(self.shares, dim) * increment)

    def size(self) -> float:
        """Largest extent of the mesh along an axis, m; collective."""
        at = self.problem.space.tabulate_dof_coordinates()[: self.problem.owned // self.problem.dim]
        ends = np.stack([at.max(axis=0, initial=-np.inf), -at.min(axis=0, initial=np.inf)])
        self.problem.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
        return float(np.max(ends.sum(axis=0)))

    def held(self, stiffness: Floats, place: Floats) -> HoldingSprings:
        """Springs of a total stiffness (d,), N/m, without force at ``place`` (n,), m."""
        values, dim = np.zeros_like(place), self.problem.dim
        for one, total in zip(self.directions, stiffness, strict=True):
            values[one.nodes * dim + one.component] = total * self.shares[one.nodes]
        return HoldingSprings(values, place)


def nodal_shares(problem: Equilibrium) -> Floats:
    """Share (n,) of each owned node in the volume of its body, about: without units; collective.

    Bodies that are bonded count as one.

    The volume of a cell is taken as that of a cube on its longest edge, and every node of the cell
    has the same part of it.
    """
    mesh, space = problem.space.mesh, problem.space
    scalar = dolfinx.la.vector(space.dofmap.index_map, 1)
    totals = []
    groups = bonded_groups(problem)
    for group in groups:
        cells = np.concatenate([solid.cells for solid in group])
        size = mesh.h(mesh.topology.dim, cells) ** mesh.topology.dim
        table = space.dofmap.list[cells]
        volume = np.repeat(size / table.shape[1], table.shape[1])
        np.add.at(scalar.array, table.reshape(-1), volume)
        totals.append(problem.comm.allreduce(float(size.sum()), op=MPI.SUM))
    scalar.scatter_reverse(dolfinx.la.InsertMode.add)
    shares: Floats = scalar.array[: problem.owned // problem.dim].copy()
    for group, total in zip(groups, totals, strict=True):
        shares[body_nodes(problem, np.concatenate([solid.cells for solid in group]))] /= total
    for tool in problem.tools:
        shares[tool.node(0)] = shares[tool.node(tool.slots - 1)] = 1.0
    return shares
