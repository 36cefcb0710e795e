"""Forces that a solution is judged by: round-off, reference of the residual, worst place."""

from __future__ import annotations

from collections.abc import Iterable

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.constraints import Constraints
from tribox.forms.bodies.materials import oedometric_modulus
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Floats, Ints

FAR = 1e6  # displacement over the extent of the mesh from which on nothing is evaluated
CARRIED = 1e-6  # residual over the force that the motion of bodies may leave at most


class RoundOff:
    """Norm of the residual that rounding alone leaves, at any displacement.

    The deformation gradient is rounded by ε, however small the strain, and the displacement u by
    ε|u|. The first leaves forces of norm b
    (:meth:`tribox.forms.bodies.solid.Solid.roundoff_force`), the second ε M s u at an unknown, with
    the oedometric modulus M and s = 1 in plane strain, 2πR for rings and the size of the cells in
    space:

        r² = Σ_solids b² + (ε M)² Σ s² u².

    Newton's method carried on without end stays between 0.15 and 0.5 of r: blocks, boxes, a sphere,
    of 1 kPa to 70 GPa, moved by up to 600 cells. Rounded gaps are left out: they count where
    the contact is the stiffest thing there is, and are 1e-12 of its force then.

    Attributes:
        names: of the solids.
    """

    def __init__(self, space: dolfinx.fem.FunctionSpace, solids: Iterable[Solid]) -> None:
        """Find b and s of each solid; collective."""
        self._comm, self._dim = space.mesh.comm, space.dofmap.index_map_bs
        self._farthest = FAR * _extent(space.mesh)
        self.names: list[str] = []
        self._parts: list[tuple[Ints, Floats]] = []
        squares = []
        for solid in solids:
            self.names.append(solid.name)
            squares.append(solid.roundoff_force())
            self._parts.append(self._scaled_nodes(space, solid))
        self._at_rest: Floats = self._comm.allreduce(np.array(squares))

    def is_within_reach(self, x: PETSc.Vec) -> bool:
        """Whether displacements x, m, are numbers, and such that more than rounding is left.

        Iterations that diverge would else come to rest where all forces are; collective.
        """
        return bool(x.norm(PETSc.NormType.NORM_INFINITY) < self._farthest)

    def _scaled_nodes(self, space: dolfinx.fem.FunctionSpace, solid: Solid) -> tuple[Ints, Floats]:
        """Owned nodes (n,) of a solid, and ε M s of each; collective."""
        nodes = np.unique(space.dofmap.list[solid.cells])
        nodes = nodes[nodes < space.dofmap.index_map.size_local]
        size = np.ones(len(nodes))
        if solid.section == "axisymmetric":
            size = 2.0 * np.pi * space.tabulate_dof_coordinates()[nodes, 0]
        elif solid.section == "3D":
            squared = space.mesh.h(3, solid.cells) ** 2 / 3.0
            total, count = self._comm.allreduce(np.array([squared.sum(), float(len(squared))]))
            size *= np.sqrt(total / count)
        return nodes, np.finfo(float).eps * oedometric_modulus(solid.material) * size

    def squares(self, u: Floats) -> tuple[Floats, Floats]:
        """Squares of the first and the second part of r, solid by solid; collective.

        Args:
            u: (n,), m, owned unknowns.
        """
        moved = u.reshape(-1, self._dim)
        local = [float(np.sum((size[:, None] * moved[nodes]) ** 2)) for nodes, size in self._parts]
        carried: Floats = self._comm.allreduce(np.array(local))
        return self._at_rest, carried

    def norm(self, u: Floats, force: float) -> float:
        """Norm r of all solids at the owned unknowns (n,), m, as a force in N (N/m); collective.

        The part of the motion is ``CARRIED`` of ``force`` at most: a body that nothing holds any
        more may be put so far away that nothing but rounding is left of its forces.
        """
        at_rest, carried = (float(part.sum()) for part in self.squares(u))
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
