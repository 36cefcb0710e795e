"""What holds the angle of a tool that turns freely while nothing else does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.equilibrium.holding_springs import HoldingSprings
from app.equilibrium.rigid_tool import RigidTool
from forms.bodies.solid import Solid

SLIGHT = 1e-9
"""Stiffness over that of a body of the size of the mesh: far below any contact, and above rounding.

A roller that nothing touches, or without friction, has any angle: the tangent would be singular.
"""


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
