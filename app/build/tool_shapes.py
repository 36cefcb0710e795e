"""From a `[tools.NAME]` table to the rigid surface that it describes."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from app.case.tools import CircleTool, PlaneTool, Tool
from geometry.surfaces.facets import Floats
from geometry.surfaces.rigid import RigidSurface
from geometry.surfaces.rigid_circle import Circle
from geometry.surfaces.rigid_plane import Plane


def tool_surface(table: Tool, box: Floats, comm: MPI.Comm) -> RigidSurface:
    """The surface of a tool; collective.

    Args:
        table: what the case says.
        box: (2, i), m, least and largest coordinates of the mesh.
        comm: of the mesh.

    Raises:
        ValueError: there is no such surface.
    """
    if isinstance(table, PlaneTool):
        size = float(np.linalg.norm(box[1] - box[0]))
        return Plane(np.array(table.point), np.array(table.normal), size)
    if isinstance(table, CircleTool):
        return Circle(np.array(table.centre), table.radius, table.inside)
    raise ValueError(f'shape = "{table.shape}" is not available')
