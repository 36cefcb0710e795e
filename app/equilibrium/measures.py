"""Forces that a solution is judged by: round-off, reference of the residual, worst place."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from mpi4py import MPI

from app.equilibrium.constraints import Constraints
from forms.bodies.solid import Solid
from geometry.surfaces.facets import Floats


def roundoff_force(solids: Iterable[Solid], comm: MPI.Comm) -> float:
    """Residual norm below which only round-off is left, N/m; collective."""
    noise = sum(solid.roundoff_force() for solid in solids)
    return 4.0 * float(np.sqrt(comm.allreduce(noise)))


def reference_force(unbalanced: Floats, contact_squared: float, constraints: Constraints) -> float:
    """Force that the convergence test compares with: the larger of contact and reactions.

    Collective.

    Args:
        unbalanced: (n,), N, out-of-balance forces of the owned unknowns, reactions included.
        contact_squared: norm of this rank's contact forces, squared.
        constraints: where the reactions are.
    """
    reactions = unbalanced[constraints.dofs]
    local = np.array([contact_squared, float(np.sum(reactions**2))])
    total = np.empty_like(local)
    constraints.unknowns.comm.Allreduce(local, total, op=MPI.SUM)
    return max(float(np.sqrt(total.max())), *(abs(p.force) for p in constraints.platens), 0.0)


def worst_place(unbalanced: Floats, constraints: Constraints) -> tuple[float, ...]:
    """Where the largest out-of-balance force (n,) of a free unknown is, m; collective."""
    unknowns = constraints.unknowns
    free = np.abs(unbalanced)
    free[constraints.dofs] = 0.0
    for platen in constraints.platens:
        free[platen.dofs] = 0.0
    free = np.where(np.isfinite(free), free, np.inf)
    mine: tuple[float, tuple[float, ...]] = (-1.0, ())
    if unknowns.owned:
        at = int(np.argmax(free))
        where = unknowns.space.tabulate_dof_coordinates()[at // unknowns.dim, : unknowns.dim]
        mine = (float(free[at]), tuple(map(float, where)))
    place: tuple[float, ...] = max(unknowns.comm.allgather(mine))[1]
    return place
