"""What holds the angle of a tool that turns freely while nothing else does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from petsc4py import PETSc

from tribox.app.equilibrium.holding_springs import HoldingSprings
from tribox.app.equilibrium.rigid_tool import RigidTool
from tribox.forms.bodies.solid import Solid
from tribox.geometry.surfaces.facets import Floats

SLIGHT = 1e-9
"""Stiffness over that of a body of the size of the mesh: far below any contact, and above rounding.

A roller that nothing touches, or without friction, has any angle: the tangent would be singular.
"""
NOTHING = 1e-6
"""Force of such a spring, over the reference force, that is too much for a solution."""
SLIPPING = 1e-3
"""Stiffness of the contact against a turn, over that of a body, below which nothing sticks."""


def holding_of_idle_tools(
    tools: Sequence[RigidTool], solids: Sequence[Solid], owned: int
) -> HoldingSprings | None:
    """Springs, without force at the last converged state, on the angles that no moment drives.

    Args:
        tools: all of them.
        solids: the bodies.
        owned: number of unknowns on this rank.

    Returns:
        None if no tool is idle; the same kind on all ranks.
    """
    idle = [tool for tool in tools if tool.idle]
    if not idle or not solids:
        return None
    modulus = min(solid.material.shear_modulus for solid in solids)
    stiffness = np.zeros(owned)
    for tool in idle:
        size = tool.motion.length if tool.motion.dim == 3 else 1.0
        stiffness[tool.dofs[-1:][tool.here[-1:]]] = SLIGHT * modulus * size
    return HoldingSprings(stiffness, np.zeros(owned))


def held_fast(springs: HoldingSprings) -> HoldingSprings:
    """Springs as stiff as a body: friction without stiffness says nothing of how a tool turns."""
    stiffness: Floats = np.asarray(springs.stiffness / SLIGHT, dtype=np.float64)
    return replace(springs, stiffness=stiffness)


def hold_what_slips(A: PETSc.Mat, springs: HoldingSprings, first: int) -> None:
    """Raise the diagonal of idle angles that the contacts do not resist; collective.

    Where all points slip, the tangent knows of no way back: a Newton step would turn the tool round
    and round. The residual is as it is, so that the solution does not change.

    Args:
        A: the tangent, assembled.
        springs: on the idle angles.
        first: global number of this rank's first unknown.
    """
    fast = held_fast(springs).stiffness
    rows = np.nonzero(fast)[0]
    diagonal = A.getDiagonal().array_r[rows]
    for row, value in zip(rows, diagonal, strict=True):  # a few tools at most
        if value < SLIPPING * fast[row]:
            at = int(row) + first
            A.setValue(at, at, fast[row], addv=PETSc.InsertMode.ADD_VALUES)
    A.assemble()
