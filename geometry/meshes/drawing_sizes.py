"""Element sizes of a drawing by the names of its parts; inside gmsh's process."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from math import prod
from types import ModuleType

from tribox.geometry.meshes.gmsh_model import MeshError

GROWTH = 0.2
"""By how much the size grows over a distance away from a surface with a size of its own."""

SAMPLES = 200  # of a curve, for distances from it
FILLED = 0.1  # share of its bounding box that a body is taken to fill at least


def set_sizes(gmsh: ModuleType, dim: int, size: float | None, sizes: Mapping[str, float]) -> None:
    """Set the largest size, and those on surfaces and in bodies.

    Args:
        gmsh: The module, with the drawing and its physical groups.
        dim: Dimension of the bodies.
        size: Largest size, in units of the drawing; None: as drawn.
        sizes: Sizes by name of a surface or body.

    Raises:
        MeshError: There is no part of a name.
    """
    if size is None:
        return
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.MeshSizeMin", min([size, *sizes.values()]) * 1e-3)
    points = gmsh.model.getEntities(0)
    drawn = gmsh.model.mesh.getSizes(points)
    # Where none is drawn gmsh would take a tenth of the whole.
    gmsh.model.mesh.setSize([p for p, own in zip(points, drawn, strict=True) if own <= 0.0], size)
    if not sizes:
        return
    field = gmsh.model.mesh.field
    made = [_field(gmsh, dim, name, value, size) for name, value in sizes.items()]
    least = field.add("Min")
    field.setNumbers(least, "FieldsList", made)
    field.setAsBackgroundMesh(least)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)


def refuse_too_many(
    gmsh: ModuleType, dim: int, size: float | None, sizes: Mapping[str, float], most: int | None
) -> None:
    """Refuse sizes that gmsh would mesh for hours, as where the unit of a drawing is forgotten.

    Args:
        gmsh: The module, with the drawing and its physical groups.
        dim: Dimension of the bodies.
        size: Largest size, in units of the drawing; None: as drawn.
        sizes: Sizes by name of a surface or body.
        most: Largest number of cells; None: any.

    Raises:
        MeshError: There would be more, as far as bounding boxes of bodies tell.
    """
    if size is None or most is None:
        return
    cells = 0.0
    for _, tag in gmsh.model.getPhysicalGroups(dim):
        own = min(size, sizes.get(gmsh.model.getPhysicalName(dim, tag), size))
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, tag):
            box = gmsh.model.getBoundingBox(dim, int(entity))
            cells += FILLED * prod((box[3 + i] - box[i]) / own for i in range(dim))
    if cells > most:
        raise MeshError(
            f"these sizes make some {cells:.0e} cells, and geometry.max_cells = {most} allows no "
            'more; is scale missing, such as scale = "mm", or is a size too small?'
        )


def _field(gmsh: ModuleType, dim: int, name: str, value: float, size: float) -> int:
    """The field of one part."""
    groups = {
        gmsh.model.getPhysicalName(d, tag): (d, tag)
        for d in (dim - 1, dim)
        for d, tag in gmsh.model.getPhysicalGroups(d)
    }
    if name not in groups:
        near = get_close_matches(name, groups, n=1)
        hint = f'did you mean "{near[0]}"?' if near else f"there are: {', '.join(groups)}"
        raise MeshError(f'sizes: no body or surface named "{name}"; {hint}')
    d, tag = groups[name]
    entities = [int(e) for e in gmsh.model.getEntitiesForPhysicalGroup(d, tag)]
    field, lists = gmsh.model.mesh.field, {1: "CurvesList", 2: "SurfacesList", 3: "VolumesList"}
    if d == dim:
        inside = int(field.add("Constant"))
        field.setNumber(inside, "VIn", value)
        field.setNumber(inside, "VOut", size)
        field.setNumbers(inside, lists[d], entities)
        return inside
    distance = field.add("Distance")
    field.setNumbers(distance, lists[d], entities)
    field.setNumber(distance, "Sampling", SAMPLES if d == 1 else 40)
    threshold = int(field.add("Threshold"))
    values = {"SizeMin": value, "SizeMax": size, "DistMin": 0.0}
    values["DistMax"] = max((size - value) / GROWTH, 1e-3 * value)
    field.setNumber(threshold, "InField", distance)
    for key, number in values.items():
        field.setNumber(threshold, key, number)
    return threshold
