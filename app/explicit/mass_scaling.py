"""Lumped masses of a problem, raised where a longer step is wanted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.rigid_tool import RigidTool
from tribox.app.explicit.options import MassScaling
from tribox.forms.bodies.element_frequency import element_frequencies
from tribox.forms.bodies.lumped_mass import cell_field, lumped_mass
from tribox.forms.contact.stiffness import PairStiffness
from tribox.geometry.surfaces.exchange import NodalVector
from tribox.geometry.surfaces.facets import Floats

ROUNDS = 20  # at most; an element's own factor changes the masses of its neighbours too


@dataclass(frozen=True, slots=True)
class ScaledMass:
    """Masses with what the scaling added.

    Attributes:
        mass: (n,), kg per unit thickness, of the owned unknowns.
        added, original: kg per unit thickness, by scaling and without, of all ranks.
        scaled: share of the elements whose mass was raised.
    """

    mass: Floats
    added: float
    original: float
    scaled: float


def scaled_mass(
    problem: Equilibrium, scaling: MassScaling | None, pairs: Sequence[PairStiffness]
) -> ScaledMass:
    """Lumped masses with what the scaling adds; collective.

    Args:
        problem: bodies and supports.
        scaling: its settings; None: no scaling.
        pairs: stiffness of the contacts, which limits the elements at their nodes too.

    Raises:
        ValueError: a body has no density.
    """
    plain = lumped_mass(problem.space, problem.solids)
    if scaling is None:
        return _result(problem, plain, plain, np.ones(1))
    if scaling.factor is not None:
        return _result(problem, plain, scaling.factor * plain, np.full(1, scaling.factor))
    assert scaling.step is not None
    highest = 4.0 / scaling.step**2  # 1/s², of an oscillation that the step can just follow
    limits = _Limits(problem, pairs)
    if scaling.kind == "uniform":
        worst = problem.comm.allreduce(limits.of(plain).max(initial=0.0), op=MPI.MAX)
        factor = max(float(worst) / highest, 1.0)
        return _result(problem, plain, factor * plain, np.full(1, factor))
    field = cell_field(problem.space.mesh, 1.0)
    mass = plain
    for _ in range(ROUNDS):
        excess = limits.of(mass, field) / highest
        if not problem.comm.allreduce(bool(np.any(excess > 1.0 + 1e-9)), op=MPI.LOR):
            break
        owned = field.x.array[: len(excess)]
        owned *= np.maximum(excess, 1.0)
        field.x.scatter_forward()
        mass = lumped_mass(problem.space, problem.solids, field)
    return _result(problem, plain, mass, field.x.array[: len(excess)])


def with_tools(mass: Floats, tools: Sequence[RigidTool]) -> Floats:
    """Masses (n,), kg per unit thickness, of the owned unknowns with those of tools, unscaled.

    Where a tool's motion is prescribed its mass is of no account.
    """
    out = mass.copy()
    for tool in tools:
        moves = tool.here & tool.free
        out[tool.dofs[moves]] = tool.mass[moves]
    return out


def _result(problem: Equilibrium, plain: Floats, mass: Floats, factors: Floats) -> ScaledMass:
    n, dim = problem.owned, problem.dim
    counts = [mass[:n].sum() - plain[:n].sum(), plain[:n].sum()]
    total = problem.comm.allreduce(np.array(counts)) / dim
    raised = problem.comm.allreduce(
        np.array([np.count_nonzero(factors > 1.0), len(factors)], dtype=float)
    )
    return ScaledMass(mass[:n].copy(), float(total[0]), float(total[1]), raised[0] / raised[1])


class _Limits:
    """Bounds ω² of the oscillations of each owned cell and of the contacts at its nodes."""

    def __init__(self, problem: Equilibrium, pairs: Sequence[PairStiffness]) -> None:
        space = problem.space
        mesh = space.mesh
        cells = mesh.topology.index_map(mesh.topology.dim).size_local
        self._nodes = np.asarray(space.dofmap.list)[:cells]
        self._alone = np.zeros(cells)
        for solid in problem.solids:
            self._alone[solid.cells] = element_frequencies(space, solid)
        stiffness = NodalVector(space)
        for pair in pairs:
            pair.add_bound(stiffness)
        stiffness.update_ghosts()
        self._stiffness = stiffness.array.copy()
        self._dim = problem.dim

    def of(self, mass: Floats, scale: dolfinx.fem.Function | None = None) -> Floats:
        """ω² (c,) of the cells for nodal masses (local unknowns) and a factor per cell."""
        bound = np.zeros_like(mass)  # carriers' nodes, which no body has, are without mass
        np.divide(self._stiffness, mass, out=bound, where=mass > 0.0)
        per_node = bound.reshape(-1, self._dim).max(axis=1)
        factor = scale.x.array[: len(self._alone)] if scale is not None else 1.0
        out: Floats = self._alone / factor + per_node[self._nodes].max(axis=1, initial=0.0)
        return out
