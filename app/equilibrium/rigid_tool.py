"""A rigid tool as a member of the equilibrium: where its unknowns are, and what it weighs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from tribox.geometry.meshes.blocks import Block
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
from tribox.geometry.surfaces.rigid import RigidSurface
from tribox.geometry.surfaces.rigid_motion import RigidMotion


@dataclass(frozen=True, slots=True, eq=False)
class RigidTool:
    """A rigid tool; its unknowns, the slots k, are the components of c and then θL.

    Attributes:
        name: of the tool; surface: its shape; motion: of its control points.
        block: of the slots.
        free: (k,) whether a force or a moment moves the slot, in some stage at least.
        idle: whether no moment drives the angle, so that nothing may hold it.
        mass: (k,) kg per unit thickness: the mass, and the moment of inertia over L².
    """

    name: str
    surface: RigidSurface
    motion: RigidMotion
    block: Block
    free: Bools
    idle: bool
    mass: Floats

    @property
    def slots(self) -> int:
        """Number of its unknowns."""
        return len(self.block.nodes)

    @property
    def nodes(self) -> Longs:
        """Global numbers (2,) of the nodes that hold c and θL."""
        return self.block.nodes[[0, -1]]

    @property
    def here(self) -> Bools:
        """Whether this rank owns the slots (k,)."""
        return np.full(self.slots, len(self.block.dofs) > 0)

    @property
    def dofs(self) -> Ints:
        """Local unknowns (k,) of the slots, on the rank that owns them."""
        return self.block.dofs if len(self.block.dofs) else np.zeros(self.slots, dtype=np.int32)

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
        return self.block.on_all_ranks(values, comm)

    def control_points(self, slots: Floats) -> Floats:
        """Control points (a, i), m, at the values (k,), m, of its slots."""
        return self.motion.control_points(slots[:-1], float(slots[-1]) / self.motion.length)
