"""Whether a slave and its master face each other at the start, and what to do if they do not."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from tribox.app.case.tools import Tool
from tribox.geometry.surfaces.body_facets import outward_facets
from tribox.geometry.surfaces.facets import Floats, unit_normals
from tribox.geometry.surfaces.projection import Projection
from tribox.geometry.surfaces.surface import ContactSurface

SAME = 0.5  # cosine of the angle between outward normals from which they point the same way

TURN = {
    "plane": "its normal points out of it, towards the body",
    "polyline": "going along it, the body is on the left",
    "circle": "inside = true is for a body inside it",
    "cylinder": "inside = true is for a body inside it",
    "sphere": "inside = true is for a body inside it",
    "mesh": "turned_over = true turns it over",
}
"""How each shape of a tool says on which side the body is."""


def faces_away(surface: ContactSurface, at: Projection) -> bool:
    """Whether the slave looks the way its master looks where they are nearest to each other.

    They then never press on each other, unless one is turned over first. Collective.

    Args:
        surface: the pair, undeformed.
        at: the slave's points on the master.
    """
    cosine = np.einsum("qi,qi->q", _outward(surface), at.normal)
    comm, beside = surface.space.mesh.comm, at.on_surface & ~at.clamped
    apart = np.abs(at.gap)
    nearest = comm.allreduce(float(np.min(apart, where=beside, initial=np.inf)), op=MPI.MIN)
    beside &= apart <= nearest + surface.facet_length
    counts = np.array([np.count_nonzero(beside), np.count_nonzero(beside & (cosine < SAME))])
    all_beside, facing = comm.allreduce(counts, op=MPI.SUM)
    return bool(all_beside > 0 and facing == 0)


def _outward(surface: ContactSurface) -> Floats:
    """Outward normals (q, i) of the slave's facets at their middles, undeformed."""
    shape = surface.shape
    _, position = outward_facets(surface.space, shape, surface.slave.mesh_facet)
    middle = np.mean(shape.points[: shape.corners], axis=0)
    tangents = np.einsum("ba,qai->qbi", shape.first(middle[None])[0], position)
    return unit_normals(tangents)


def facing_problem(slave: str, master: str, tool: Tool | None) -> str:
    """What is wrong with surfaces that face the same way.

    Args:
        slave: name of the surface.
        master: name of the other, or of the tool.
        tool: the master, if it is one.
    """
    hint = "" if tool is None else f", or {master} is the wrong way round: {TURN[tool.shape]}"
    return (
        f"{slave} and {master} face the same way, so they cannot press on each other; another "
        f"surface is the slave{hint}"
    )
