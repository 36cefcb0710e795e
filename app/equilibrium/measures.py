"""Forces that a solution is judged by: round-off, reference of the residual, worst place."""

from __future__ import annotations

from collections.abc import Iterable

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.constraints import Constraints
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Floats

FAR = 1e6  # displacement over the extent of the mesh from which on nothing is evaluated
CARRIED = 1e-6  # residual over the force that the motion of bodies may leave at most


class RoundOff:
    """Norm of the residual that rounding alone leaves, at any displacement.

    The deformation gradient is rounded by ε, however small the strain, and the displacement u by
    ε|u|. The first leaves forces of norm b, the second forces of norm c
    (:meth:`tribox.forms.bodies.solid.Solid.roundoff_squares`):

        r² = Σ_solids b² + c².

    Newton's method carried on without end stays between 0.15 and 0.5 of r: blocks, boxes, a sphere,
    of 1 kPa to 70 GPa, moved by up to 600 cells; in bodies stretched, sheared and thinned 5 to 8
    times between 0.03 and 0.9. Rounded gaps are left out: they count where the contact is the
    stiffest thing there is, and are 1e-12 of its force then.

    Attributes:
        names: of the solids.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace, solids: Iterable[Solid]) -> None:
        """Take the solids; collective."""
        self._comm = space.mesh.comm
        self._farthest = FAR * _extent(space.mesh)
        self._solids = list(solids)
        self.names = [solid.name for solid in self._solids]

    def is_within_reach(self, x: PETSc.Vec) -> bool:
        """Whether displacements x, m, are numbers, and such that more than rounding is left.

        Iterations that diverge would else come to rest where all forces are; collective.
        """
        return bool(x.norm(PETSc.NormType.NORM_INFINITY) < self._farthest)

    def squares(self) -> tuple[Floats, Floats]:
        """b² and c² of each solid at the displacement evaluated last; collective."""
        local = np.array([solid.roundoff_squares() for solid in self._solids]).reshape(-1, 2)
        at_rest, carried = self._comm.allreduce(local).T
        return at_rest, carried

    def norm(self, force: float) -> float:
        """Norm r of all solids at the displacement evaluated last, N (N/m); collective.

        The part of the motion is ``CARRIED`` of ``force`` at most: a body that nothing holds any
        more may be put so far away that nothing but rounding is left of its forces.
        """
        at_rest, carried = (float(part.sum()) for part in self.squares())
        return float(np.sqrt(at_rest + min(carried, (CARRIED * force) ** 2)))


def reference_force(
    unbalanced: Floats, loads: Floats, contact_squared: float, constraints: Constraints
) -> float:
    """Force that the convergence test compares with: the largest of contact, reactions and loads.

    Collective.

    Args:
        unbalanced: (n,), N, out-of-balance forces of the owned unknowns, reactions included.
        loads: (n,), N, forces of the loads on the owned unknowns.
        contact_squared: norm of this rank's contact forces, squared.
        constraints: where the reactions are.
    """
    reactions = float(np.sum(unbalanced[constraints.dofs] ** 2))
    given = [p for p in constraints.slanted if p.acts and p.displacement is not None]
    reactions += sum(float(np.sum(platen.along(unbalanced) ** 2)) for platen in given)
    local = np.array([contact_squared, reactions, float(loads @ loads)])
    total = np.empty_like(local)
    constraints.unknowns.comm.Allreduce(local, total, op=MPI.SUM)
    return max(
        float(np.sqrt(total.max())), *(abs(p.force) for p in constraints.platens if p.acts), 0.0
    )


def worst_place(unbalanced: Floats, constraints: Constraints) -> tuple[float, ...]:
    """Where the largest out-of-balance force (n,) of a free unknown is, m; collective."""
    unknowns = constraints.unknowns
    free = np.abs(unbalanced)
    free[constraints.dofs] = 0.0
    for platen in (p for p in constraints.platens if p.acts):
        free[platen.dofs] = 0.0
    free = np.where(np.isfinite(free), free, np.inf)
    mine: tuple[float, tuple[float, ...]] = (-1.0, ())
    if unknowns.owned:
        at = int(np.argmax(free))
        where = unknowns.space.tabulate_dof_coordinates()[at // unknowns.dim, : unknowns.dim]
        mine = (float(free[at]), tuple(map(float, where)))
    place: tuple[float, ...] = max(unknowns.comm.allgather(mine))[1]
    return place


def _extent(mesh: dolfinx.mesh.Mesh) -> float:
    """Largest extent along an axis, m; collective."""
    x = mesh.geometry.x
    ends = np.stack([x.max(axis=0, initial=-np.inf), -x.min(axis=0, initial=np.inf)])
    mesh.comm.Allreduce(MPI.IN_PLACE, ends, op=MPI.MAX)
    return float(ends.sum(axis=0).max())
