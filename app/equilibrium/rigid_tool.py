"""A rigid tool as a member of the equilibrium: where its unknowns are, and what it weighs."""

from __future__ import annotations

from dataclasses import dataclass

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
from tribox.geometry.surfaces.rigid import RigidSurface
from tribox.geometry.surfaces.rigid_motion import RigidMotion


@dataclass(frozen=True, slots=True, eq=False)
class RigidTool:
    """A rigid tool; its unknowns, the slots k, are the components of c and then θL.

    Attributes:
        name: of the tool; surface: its shape; motion: of its control points.
        nodes: (2,) global numbers of its reference nodes.
        dofs: (k,) local unknowns of the slots; here: (k,) whether this rank owns them.
        free: (k,) whether a force or a moment moves the slot, in some stage at least.
        idle: whether no moment drives the angle, so that nothing may hold it.
        mass: (k,) kg per unit thickness: the mass, and the moment of inertia over L².
    """

    name: str
    surface: RigidSurface
    motion: RigidMotion
    nodes: Longs
    dofs: Ints
    here: Bools
    free: Bools
    idle: bool
    mass: Floats

    @property
    def slots(self) -> int:
        """Number of its unknowns."""
        return len(self.dofs)

    @property
    def reach(self) -> float:
        """Distance, m, of its surface from the axis that it turns about.

        Along axes of coordinates, and no farther than the mesh is long: a plane has no end.
        """
        arms = np.abs(self.surface.extent - self.motion.centre).max(axis=0)
        if self.motion.axis is not None:
            axis = np.asarray(self.motion.axis) / np.linalg.norm(self.motion.axis)
            across = np.sqrt(np.maximum(1.0 - axis**2, 0.0))
            arms = np.where(across > 0.0, np.minimum(arms, self.motion.length) * across, 0.0)
        return float(min(arms.max(), self.motion.length))

    def node(self, slot: int) -> Ints:
        """Local number of a slot's node, on the rank that owns it; none (0,) elsewhere."""
        dim = self.slots - 1
        return (self.dofs[[slot]] // dim)[self.here[[slot]]]

    def at(self, values: Floats, comm: MPI.Comm) -> Floats:
        """Its part (k,) of values (n,) of the owned unknowns, on all ranks; collective."""
        mine = np.where(self.here, values[np.where(self.here, self.dofs, 0)], 0.0)
        total = np.empty_like(mine)
        comm.Allreduce(mine, total, op=MPI.SUM)
        return total

    def control_points(self, slots: Floats) -> Floats:
        """Control points (a, i), m, at the values (k,), m, of its slots."""
        return self.motion.control_points(slots[:-1], float(slots[-1]) / self.motion.length)


def reference_dofs(space: dolfinx.fem.FunctionSpace, cell: Ints) -> tuple[Longs, Ints, Bools, Ints]:
    """The unknowns of a carrier cell that a tool takes, and the others; collective.

    Args:
        space: of the displacement.
        cell: (1,) local number of the carrier cell; none on ranks without it.

    Returns:
        Global numbers (2,) of the reference nodes; local unknowns (k,) of the slots and whether
        this rank owns them; owned local unknowns of the cell's nodes that are no slots.
    """
    index, dim = space.dofmap.index_map, space.dofmap.index_map_bs
    local = np.asarray(space.dofmap.list[cell], dtype=np.int32).reshape(-1)
    mine = None
    if len(local):
        mine = index.local_to_global(local[:2]).astype(np.int64)
    nodes: Longs = next(n for n in space.mesh.comm.allgather(mine) if n is not None)
    slots = np.zeros(dim + 1, dtype=np.int32)
    here = np.zeros(dim + 1, dtype=bool)
    rest = np.empty(0, dtype=np.int32)
    if len(local):
        every = (local[:, None] * dim + np.arange(dim)).reshape(-1).astype(np.int32)
        slots, rest = every[: dim + 1], every[dim + 1 :]
        here = slots < index.size_local * dim
        rest = rest[rest < index.size_local * dim]
    return nodes, slots, here, rest
