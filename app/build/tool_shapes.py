"""From a `[tools.NAME]` table to the rigid surface that it describes."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from typing import assert_never

import numpy as np
from mpi4py import MPI

from tribox.app.case.tools import (
    AnyTool,
    CircleTool,
    CylinderTool,
    MeshTool,
    PlaneTool,
    PolylineTool,
    SphereTool,
)
from tribox.geometry.surfaces.facets import Floats, Ints
from tribox.geometry.surfaces.rigid import RigidSurface
from tribox.geometry.surfaces.rigid_mesh import MeshSurface
from tribox.geometry.surfaces.rigid_polyline import Polyline
from tribox.geometry.surfaces.rigid_shapes import Circle, Cylinder, Plane, Sphere

# Facets by meshio's names: dimension of space, and the place of each of a Lagrange element's nodes
# among those of gmsh.
_ORDER = {
    "line": (2, (0, 1)),
    "line3": (2, (0, 1, 2)),
    "triangle": (3, (0, 1, 2)),
    "triangle6": (3, (0, 1, 2, 4, 5, 3)),
    "quad": (3, (0, 1, 3, 2)),
    "quad9": (3, (0, 1, 3, 2, 4, 7, 5, 6, 8)),
}
# The same of facets that run the other way round: ξ reversed, or ξ and η exchanged.
_TURNED = {
    "line": (1, 0),
    "line3": (1, 0, 2),
    "triangle": (0, 2, 1),
    "triangle6": (0, 2, 1, 3, 5, 4),
    "quad": (0, 2, 1, 3),
    "quad9": (0, 2, 1, 3, 5, 4, 7, 6, 8),
}
_CLOSE = 1e-9  # z of nodes over the extent of a mesh in the plane that is rounding


def tool_surface(table: AnyTool, box: Floats, comm: MPI.Comm) -> RigidSurface:
    """The surface of a tool; collective.

    Args:
        table: what the case says.
        box: (2, i), m, least and largest coordinates of the mesh.
        comm: of the mesh.

    Raises:
        ValueError: there is no such surface, on all ranks.
    """
    match table:
        case PlaneTool():
            return _plane(table, box)
        case CircleTool():
            return Circle(np.array(table.centre), table.radius, table.inside)
        case SphereTool():
            return Sphere(np.array(table.centre), table.radius, table.inside)
        case CylinderTool():
            axis = np.array(table.axis)
            return Cylinder(np.array(table.centre), axis, table.radius, table.inside)
        case PolylineTool():
            radius = table.fillet_radius
            fillets = radius if isinstance(radius, float) else np.array(radius)
            return Polyline(np.array(table.points), fillets, table.closed, table.continued)
        case MeshTool():
            dim = box.shape[1]
            nodes, facets = _on_first(lambda: facets_of(table, dim), comm)
            return MeshSurface(nodes, facets, table.smoothing_angle)
        case _:
            assert_never(table)


def _plane(table: PlaneTool, box: Floats) -> Plane:
    """A plane with its point moved to where it is next to the mesh."""
    normal = np.array(table.normal) / np.linalg.norm(table.normal)
    middle, point = box.mean(axis=0), np.array(table.point)
    near = middle - ((middle - point) @ normal) * normal
    return Plane(near, normal, float(np.linalg.norm(box[1] - box[0])))


def _on_first(read: Callable[[], tuple[Floats, Ints]], comm: MPI.Comm) -> tuple[Floats, Ints]:
    """What the first rank reads, or its error on all; collective."""
    found: tuple[Floats, Ints] | str = ""
    if comm.rank == 0:
        try:
            found = read()
        except ValueError as error:
            found = str(error)
    found = comm.bcast(found)
    if isinstance(found, str):
        raise ValueError(found)
    return found


def facets_of(table: MeshTool, dim: int) -> tuple[Floats, Ints]:
    """Nodes (n, i), m, and facets (f, a), in the order of a Lagrange element, of a mesh file.

    Args:
        table: what the case says.
        dim: of space.

    Raises:
        ValueError: the file cannot be read, or has no such surface in this space.
    """
    import meshio

    where = f"file = {str(table.file)!r}"
    try:
        mesh = meshio.gmsh.read(table.file)
    except Exception as error:  # meshio fails on damaged files in many ways
        raise ValueError(f"{where}: is no gmsh file ({type(error).__name__}: {error})") from None
    groups = {name: int(tag) for name, (tag, d) in mesh.field_data.items() if d == dim - 1}
    if table.surface not in groups:
        near = difflib.get_close_matches(table.surface, groups, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"there are: {', '.join(groups) or 'none'}"
        raise ValueError(f"{where}: no group of facets named {table.surface!r}; {hint}")
    tags = mesh.cell_data.get("gmsh:physical", [])
    parts = [
        (block.type, np.asarray(block.data)[np.asarray(tag) == groups[table.surface]])
        for block, tag in zip(mesh.cells, tags, strict=False)
        if _ORDER.get(block.type, (0, ()))[0] == dim
    ]
    kinds = {kind for kind, cells in parts if len(cells)}
    if len(kinds) != 1:
        raise ValueError(
            f"{where}: the facets of {table.surface!r} must be of one kind, found "
            f"{', '.join(sorted(kinds)) or 'none'}"
        )
    kind = kinds.pop()
    cells = np.concatenate([cells for name, cells in parts if name == kind])
    facets = cells[:, _ORDER[kind][1]]
    if table.turned_over:
        facets = facets[:, _TURNED[kind]]
    points = table.scale * np.asarray(mesh.points, dtype=np.float64)
    used = points[np.unique(facets)]
    if dim == 2 and np.abs(used[:, 2:]).max(initial=0.0) > _CLOSE * np.ptp(used, axis=0).max():
        raise ValueError(f"{where}: {table.surface!r} does not lie in the plane z = 0")
    return points[:, :dim], facets.astype(np.int32)
