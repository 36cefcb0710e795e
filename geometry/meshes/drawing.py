"""Meshes of drawings: of gmsh's own ``.geo`` files, and of STEP files from CAD programs."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from difflib import get_close_matches
from math import prod
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from tribox.geometry.meshes.gmsh_model import MeshError, ask, gmsh_session, named_groups

LONGEST = 3600.0  # processor time of a drawing, s

GEO, STEP = (".geo",), (".step", ".stp")
DRAWINGS = (*GEO, *STEP)  # endings of the names of drawings

Spot = int | Sequence[float]
"""A part of a drawing: its number, or a point (3,) on it, in the drawing's units."""


@dataclass(frozen=True, slots=True)
class Meshing:
    """How a drawing is meshed; lengths in its own units, those of STEP files in m."""

    size: float | None = None  # largest element size; None: the drawing's own
    # element sizes on surfaces and in bodies, by name
    sizes: Mapping[str, float] = field(default_factory=dict)
    order: int | None = None  # of the cells; None: the drawing's own
    cell: str | None = None  # their shape; None: the drawing's own, or simplices
    # parts of the drawing by the name they are to have
    bodies: Mapping[str, Sequence[Spot]] = field(default_factory=dict)
    surfaces: Mapping[str, Sequence[Spot]] = field(default_factory=dict)  # likewise
    every: bool = False  # whether each body and surface gets a name of its own, from its number
    most: int | None = None  # largest number of cells; None: any


AS_DRAWN = Meshing()


def mesh_drawing(drawing: Path, path: Path, how: Meshing = AS_DRAWN) -> dict[str, int]:
    """Mesh a drawing and write it as a gmsh file of version 4.1, on one process.

    Of a script (``.geo``) or ``.step``, ``.stp``, in the dimension of the highest physical group.
    The file appears under its name only when it is complete, and only with what
    `tribox.geometry.meshes.mesh.read` needs: named bodies, whose cells are counted by name. gmsh
    runs in a process of its own, which may break down or be told to exit by the drawing. MeshError
    if it cannot draw or mesh it, or a body has no name; OSError.
    """
    if not drawing.is_file():
        raise MeshError(f"{drawing}: no such file")
    partial = path.with_name(f".{path.stem}.partial.msh")
    task = json.dumps({"path": str(partial), "how": asdict(how)})
    try:
        partial.touch()
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")  # bytes: all there is
        counts = json.loads(ask("draw", drawing, task, LONGEST, memory))
        partial.replace(path)
    except json.JSONDecodeError:
        raise MeshError(f"{drawing}: gmsh ended without a mesh") from None
    finally:
        partial.unlink(missing_ok=True)
    return {str(name): int(count) for name, count in counts.items()}


def write_mesh_of(drawing: Path, task: str) -> dict[str, int]:
    """What `mesh_drawing` does, here, told in JSON; MeshError as there, or if it cannot write."""
    told: dict[str, Any] = json.loads(task)
    how, path = Meshing(**told["how"]), str(told["path"])
    try:
        with gmsh_session(drawing.stem) as gmsh:
            _mesh(gmsh, drawing, how)
            gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
            gmsh.option.setNumber("Mesh.SaveAll", 0)
            named = named_groups(gmsh, str(drawing))
            for name, (low, entities) in named.groups.items():  # which it took away
                gmsh.model.addPhysicalGroup(low, entities, name=name)
            cells = {name: _count(gmsh, named.dim, tag) for name, tag in named.bodies.items()}
            gmsh.write(path)
    except MeshError:
        raise
    except Exception as error:  # gmsh raises nothing more specific
        words = " ".join(str(error).split())
        raise MeshError(f"{drawing}: gmsh cannot write its mesh: {words}") from error
    return cells


def _mesh(gmsh: ModuleType, drawing: Path, how: Meshing) -> None:
    """Draw and mesh in the current model."""
    gmsh.logger.start()
    try:
        _draw(gmsh, drawing, how)
        dim = max((d for d, _ in gmsh.model.getPhysicalGroups()), default=0)
        if dim >= 2:
            _set_sizes(gmsh, dim, how)
            _refuse_too_many(gmsh, dim, how)
            _set_cells(gmsh, dim, how)
            gmsh.model.mesh.generate(dim)
            _refuse_other_cells(gmsh, dim, how)
    except MeshError as error:
        raise MeshError(f"{drawing}: {error}") from None
    # gmsh raises nothing more specific than Exception; its log tells the line of the drawing.
    except Exception as error:
        said = [line for line in gmsh.logger.get() if line.startswith("Error")]
        words = " ".join((said[0].partition(":")[2] if said else str(error)).split())
        raise MeshError(f"{drawing}: gmsh cannot mesh it: {words}") from error
    finally:
        gmsh.logger.stop()
    if dim < 2:
        raise MeshError(
            f"{drawing}: no physical groups of faces or volumes; name the bodies, such as "
            'Physical Surface("pad") = {1};'
        )


def _draw(gmsh: ModuleType, drawing: Path, how: Meshing) -> None:
    """Draw in the current model, and name parts."""
    if drawing.suffix.lower() in STEP:
        gmsh.option.setString("Geometry.OCCTargetUnit", "M")
        # Not merged, as then a file of options beside it would be run.
        gmsh.model.occ.importShapes(str(drawing))
        gmsh.model.occ.synchronize()
    else:
        gmsh.merge(str(drawing))
    if how.every:
        _name_every_part(gmsh)
    else:
        _name_parts(gmsh, how, plain=drawing.suffix.lower() in STEP)


def _set_cells(gmsh: ModuleType, dim: int, how: Meshing) -> None:
    """Shape and order of the cells."""
    if how.cell is not None:
        fitting = ("triangle", "quadrilateral") if dim == 2 else ("tetrahedron", "hexahedron")
        if how.cell not in fitting:
            raise MeshError(f'cell = "{how.cell}": here "{fitting[0]}" or "{fitting[1]}"')
        if how.cell == "hexahedron" and how.order == 2:
            raise MeshError('cell = "hexahedron" is of order 1; tetrahedra can be of order 2')
        four = how.cell == "quadrilateral"
        gmsh.option.setNumber("Mesh.RecombineAll", int(four))
        if four:
            gmsh.option.setNumber("Mesh.Algorithm", 8)  # fronts of right angles
            gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)  # quadrilaterals alone
        # By dividing tetrahedra into four hexahedra each, which it can in any body.
        gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 2 * (how.cell == "hexahedron"))
    if how.order is not None:
        gmsh.option.setNumber("Mesh.ElementOrder", how.order)
    # With nodes at the middle of faces: DOLFINx reads no second-order cells without.
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0)


def _refuse_other_cells(gmsh: ModuleType, dim: int, how: Meshing) -> None:
    """A drawing that recombines triangles, or draws out layers, has its own way."""
    if how.cell not in ("triangle", "tetrahedron"):
        return
    kinds, _, _ = gmsh.model.mesh.getElements(dim)
    if any(gmsh.model.mesh.getElementProperties(kind)[5] != dim + 1 for kind in kinds):
        raise MeshError(
            f'cell = "{how.cell}": the drawing itself asks for other cells (Recombine); leave '
            "one of them out"
        )


def _count(gmsh: ModuleType, dim: int, tag: int) -> int:
    """Number of the cells of a body."""
    entities = gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
    return sum(sum(map(len, gmsh.model.mesh.getElements(dim, e)[1])) for e in entities)


# -- Names for the parts of a drawing that has none, such as a STEP file; inside gmsh's process ----
#
# Parts are chosen by gmsh's numbers of them, which `tribox mesh` shows, or by points on them, which
# stay the same where the drawing is made anew.

OFF = 1e-3  # distance over the extent of the drawing up to which a point counts as on a part

_KIND = {1: "curve", 2: "face", 3: "volume"}


def _name_parts(gmsh: ModuleType, how: Meshing, plain: bool) -> None:
    """Name bodies and surfaces as asked; MeshError if a part is not there, or named twice.

    ``plain``: the drawing has no names; bodies are then "body 1", ..., unless they are named.
    """
    if not (how.bodies or how.surfaces or plain):
        return
    dim = 3 if gmsh.model.getEntities(3) else 2
    for d, kind, parts in ((dim, "bodies", how.bodies), (dim - 1, "surfaces", how.surfaces)):
        taken: dict[int, str] = {}
        for name, spots in parts.items():
            tags = sorted({_tag_of(gmsh, d, spot, f"{kind}.{name}") for spot in spots})
            for tag in tags:
                if (other := taken.setdefault(tag, name)) != name:
                    raise MeshError(f'{kind}: {_KIND[d]} {tag} is "{other}" and "{name}"')
            gmsh.model.addPhysicalGroup(d, tags, name=name)
    if plain and not how.bodies:
        for _, tag in gmsh.model.getEntities(dim):
            gmsh.model.addPhysicalGroup(dim, [tag], name=f"body {tag}")


def _name_every_part(gmsh: ModuleType) -> None:
    """Name every body "body N" and every surface "surface N", by their numbers."""
    gmsh.model.removePhysicalGroups()
    dim = 3 if gmsh.model.getEntities(3) else 2
    for d, word in ((dim, "body"), (dim - 1, "surface")):
        for _, tag in gmsh.model.getEntities(d):
            gmsh.model.addPhysicalGroup(d, [tag], name=f"{word} {tag}")


def _tag_of(gmsh: ModuleType, dim: int, spot: Spot, place: str) -> int:
    """The number of a part, by itself or by a point."""
    tags = [int(tag) for _, tag in gmsh.model.getEntities(dim)]
    if not tags:
        raise MeshError(f"{place}: the drawing has no {_KIND[dim]}s")
    if isinstance(spot, int):
        if spot not in tags:
            raise MeshError(f"{place}: no {_KIND[dim]} {spot}; there are {_listed(tags)}")
        return spot
    point = [*map(float, spot), 0.0, 0.0][:3]
    away = [_distance(gmsh, dim, tag, point) for tag in tags]
    box = np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3))
    best = int(np.argmin(away))
    if away[best] > OFF * float(np.ptp(box, axis=0).max()):
        where = ", ".join(f"{value:g}" for value in point)
        raise MeshError(
            f"{place}: no {_KIND[dim]} at ({where}); the nearest is {tags[best]}, {away[best]:.3g} "
            "away, in units of the drawing"
        )
    return tags[best]


def _distance(gmsh: ModuleType, dim: int, tag: int, point: list[float]) -> float:
    """Distance of a point from a part; of a volume 0 inside and infinite outside."""
    if dim == 3:
        return 0.0 if gmsh.model.isInside(3, tag, point) else np.inf
    nearest = gmsh.model.getClosestPoint(dim, tag, point)[0]
    away = float(np.linalg.norm(np.subtract(nearest, point)))
    # What is nearest on the whole curve or plane may be beyond its ends.
    low, high = np.reshape(gmsh.model.getBoundingBox(dim, tag), (2, 3))
    outside = np.maximum(np.maximum(low - point, np.subtract(point, high)), 0.0)
    inside = gmsh.model.isInside(dim, tag, list(map(float, nearest)))
    return max(away, float(np.linalg.norm(outside))) if inside else np.inf


def _listed(tags: Sequence[int]) -> str:
    """Numbers, where many the first and the last."""
    return ", ".join(map(str, tags)) if len(tags) <= 12 else f"{tags[0]} to {tags[-1]}"


# -- Element sizes of a drawing by the names of its parts; inside gmsh's process -------------------

GROWTH = 0.2
"""By how much the size grows over a distance away from a surface with a size of its own."""

SAMPLES = 200  # of a curve, for distances from it
FILLED = 0.1  # share of its bounding box that a body is taken to fill at least


def _set_sizes(gmsh: ModuleType, dim: int, how: Meshing) -> None:
    """Set the largest size, and sizes on surfaces and in bodies; MeshError of unknown names."""
    size, sizes = how.size, how.sizes
    if size is None:
        return
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    # Far below any that is asked for, as narrow parts of the drawing may need smaller cells.
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
    # Sizes inside are those of the fields, and not what gmsh would extend from cells of surfaces.
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)


def _refuse_too_many(gmsh: ModuleType, dim: int, how: Meshing) -> None:
    """MeshError if boxes of bodies tell that gmsh would mesh these sizes for hours."""
    if how.size is None or how.most is None:
        return
    cells = 0.0
    for _, tag in gmsh.model.getPhysicalGroups(dim):
        own = min(how.size, how.sizes.get(gmsh.model.getPhysicalName(dim, tag), how.size))
        for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, tag):
            box = gmsh.model.getBoundingBox(dim, int(entity))
            cells += FILLED * prod((box[3 + i] - box[i]) / own for i in range(dim))
    if cells > how.most:
        raise MeshError(
            f"these sizes make some {cells:.0e} cells, and geometry.max_cells = {how.most} allows "
            'no more; is scale missing, such as scale = "mm", or is a size too small?'
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
    # The size of the surface on it, growing linearly to the largest away from it.
    threshold = int(field.add("Threshold"))
    values = {"SizeMin": value, "SizeMax": size, "DistMin": 0.0}
    values["DistMax"] = max((size - value) / GROWTH, 1e-3 * value)
    field.setNumber(threshold, "InField", distance)
    for key, number in values.items():
        field.setNumber(threshold, key, number)
    return threshold
