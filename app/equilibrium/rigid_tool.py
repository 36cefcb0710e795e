"""A rigid tool in the equilibrium: its unknowns, and what holds an angle that nothing drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.step_mode import HoldingSprings
from tribox.app.equilibrium.unknowns import NodalLoad
from tribox.forms.bodies.solid import Solid
from tribox.geometry.meshes.blocks import Block
from tribox.geometry.surfaces.facets import Bools, Floats, Ints, Longs
from tribox.geometry.surfaces.rigid import RigidMotion, RigidSurface


@dataclass(frozen=True, slots=True, eq=False)
class Stop:
    """Blocks that a tool driven by a force comes to rest on."""

    low: Floats  # (k,) m, least displacements of the slots; minus infinity: no block
    high: Floats  # (k,) m, largest ones; infinity: no block
    stiffness: Floats  # (k,) N/m per unit thickness


@dataclass(frozen=True, slots=True, eq=False)
class RigidTool:
    """A rigid tool; its unknowns, the slots k, are the components of c and then θL."""

    name: str  # of the tool
    surface: RigidSurface  # its shape
    motion: RigidMotion  # of its control points
    block: Block  # of the slots
    free: Bools  # (k,) whether a force or a moment moves the slot, in some stage at least
    idle: bool  # whether no moment drives the angle, so that nothing may hold it
    mass: Floats  # (k,) kg per unit thickness: the mass, and the moment of inertia over L²
    stop: Stop | None = None  # blocks that take over the forces that drive it; None: there are none

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

        Along axes of coordinates, and no farther than the mesh reaches: a plane has no end.
        """
        arms = np.abs(self.surface.extent - self.motion.centre).max(axis=0)
        if self.motion.axis is not None:
            # An arm along the axis of rotation turns nothing; of one along x √(1 − a_x²) is across.
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


def rests_of_tools(tools: Sequence[RigidTool], at: Floats, given: Ints) -> list[HoldingSprings]:
    """Springs of the stops that tools have passed at displacements (n,) of owned unknowns, m.

    Returns none if no tool has a stop; as many on all ranks.

    Args:
        given: owned unknowns that are prescribed, and that no stop holds.
    """
    if all(tool.stop is None for tool in tools):
        return []
    stiffness, place = np.zeros(len(at)), np.zeros(len(at))
    for tool in tools:
        if tool.stop is not None:
            here = tool.dofs[tool.here]
            place[here] = np.clip(at[here], tool.stop.low[tool.here], tool.stop.high[tool.here])
            passed = place[here] != at[here]
            stiffness[here] = np.where(passed, tool.stop.stiffness[tool.here], 0.0)
    stiffness[given] = 0.0
    return [HoldingSprings(stiffness, place)]


# -- What holds the angle of a tool that turns freely while nothing else does ----------------------

SLIGHT = 1e-9
"""Stiffness over that of a body of the size of the mesh: far below any contact, and above rounding.

A roller that nothing touches, or without friction, has any angle: the tangent would be singular.
"""
NOTHING = 1e-6  # force of such a spring, over the reference force, that is too much for a solution
SLIPPING = 1e-3
"""Stiffness of the contact against a turn, over that of a body, below which nothing sticks."""


def holding_of_idle_tools(
    tools: Sequence[RigidTool], solids: Sequence[Solid], owned: int
) -> HoldingSprings | None:
    """Springs, without force at the last converged state, on the angles that no moment drives.

    Returns None if no tool is idle; the same kind on all ranks.
    """
    idle = [tool for tool in tools if tool.idle]
    if not idle or not solids:
        return None
    modulus, stiffness = _softest(solids), np.zeros(owned)
    for tool in idle:
        stiffness[tool.dofs[-1:][tool.here[-1:]]] = SLIGHT * modulus * _size(tool)
    return HoldingSprings(stiffness, np.zeros(owned))


def held_fast(springs: HoldingSprings) -> HoldingSprings:
    """Springs as stiff as a body: friction without stiffness says nothing of how a tool turns."""
    stiffness: Floats = np.asarray(springs.stiffness / SLIGHT, dtype=np.float64)
    return replace(springs, stiffness=stiffness)


def hold_what_slips(
    A: PETSc.Mat,
    tools: Sequence[RigidTool],
    solids: Sequence[Solid],
    loads: Sequence[NodalLoad],
    first: int,
) -> None:
    """Raise the diagonal of slots that nothing drives and contacts do not resist; collective.

    Where all points slip or are open, the tangent knows of no way back: a Newton step would turn
    the tool round and round, or there is none. The residual is as it is, so that the solution does
    not change.

    Args:
        loads: forces on single unknowns, those that drive the tools among them.
        first: global number of this rank's first unknown.
    """
    free = [tool for tool in tools if tool.free.any()]
    if not free or not solids:
        return
    modulus, diagonal = _softest(solids), A.getDiagonal().array_r
    forces = np.zeros(len(diagonal))
    for load in loads:
        load.add_to(forces)
    for tool in free:
        fast = modulus * _size(tool)
        slots = np.flatnonzero(tool.free & tool.here)
        for slot in slots:  # a few tools at most
            row, turns = tool.dofs[slot], slot == tool.slots - 1
            if forces[row] != 0.0 or (turns and not tool.idle):
                continue
            if diagonal[row] < (SLIPPING if turns else SLIGHT) * fast:
                at = int(row) + first
                A.setValue(at, at, fast, addv=PETSc.InsertMode.ADD_VALUES)
    A.assemble()


def _softest(solids: Sequence[Solid]) -> float:
    """Least shear modulus, Pa."""
    return min(solid.material.shear_modulus for solid in solids)


def _size(tool: RigidTool) -> float:
    """What makes a stiffness per unit thickness of a modulus: m in space, else 1."""
    return tool.motion.length if tool.motion.dim == 3 else 1.0
