"""Meshes of drawings: of gmsh's own ``.geo`` files, and of STEP files from CAD programs."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from tribox.geometry.meshes.drawing_parts import name_every_part, name_parts
from tribox.geometry.meshes.drawing_sizes import refuse_too_many, set_sizes
from tribox.geometry.meshes.gmsh_model import MeshError, gmsh_session, named_groups
from tribox.geometry.meshes.own_process import ask

LONGEST = 3600.0
"""Processor time of a drawing, s."""

GEO, STEP = (".geo",), (".step", ".stp")
DRAWINGS = (*GEO, *STEP)
"""Endings of the names of drawings."""

Spot = int | Sequence[float]
"""A part of a drawing: its number, or a point (3,) on it, in the drawing's units."""


@dataclass(frozen=True, slots=True)
class Meshing:
    """How a drawing is meshed; lengths in its own units, those of STEP files in m.

    Attributes:
        size: largest element size; None: the drawing's own.
        sizes: element sizes on surfaces and in bodies, by name.
        order: of the cells; None: the drawing's own.
        cell: their shape; None: the drawing's own, or simplices.
        bodies, surfaces: parts of the drawing by the name they are to have.
        every: whether each body and surface gets a name of its own, from its number.
        most: largest number of cells; None: any.
    """

    size: float | None = None
    sizes: Mapping[str, float] = field(default_factory=dict)
    order: int | None = None
    cell: str | None = None
    bodies: Mapping[str, Sequence[Spot]] = field(default_factory=dict)
    surfaces: Mapping[str, Sequence[Spot]] = field(default_factory=dict)
    every: bool = False
    most: int | None = None


AS_DRAWN = Meshing()


def mesh_drawing(drawing: Path, path: Path, how: Meshing = AS_DRAWN) -> dict[str, int]:
    """Mesh a drawing and write it as a gmsh file of version 4.1; to be called on one process.

    The mesh is of the dimension of the highest physical group. The file appears under its name
    only when it is complete, and only with what `tribox.geometry.meshes.mesh.read` needs: named
    bodies. gmsh runs in a process of its own, which may break down or be told to exit by the
    drawing.

    Args:
        drawing: The drawing: a script that gmsh runs (``.geo``), or ``.step``, ``.stp``.
        path: The file to write, ending in ``.msh``, in an existing directory.
        how: Sizes and names.

    Returns:
        Number of cells by name of the body.

    Raises:
        MeshError: If the drawing is missing, gmsh cannot draw or mesh it, or a body has no name.
        OSError: If the file cannot be written.
    """
    if not drawing.is_file():
        raise MeshError(f"{drawing}: no such file")
    partial = path.with_name(f".{path.stem}.partial.msh")
    task = json.dumps({"path": str(partial), "how": asdict(how)})
    try:
        partial.touch()
        counts = json.loads(ask("draw", drawing, task, LONGEST, _all_memory()))
        partial.replace(path)
    except json.JSONDecodeError:
        raise MeshError(f"{drawing}: gmsh ended without a mesh") from None
    finally:
        partial.unlink(missing_ok=True)
    return {str(name): int(count) for name, count in counts.items()}


def _all_memory() -> int:
    """Bytes of this machine's memory."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def write_mesh_of(drawing: Path, task: str) -> dict[str, int]:
    """What `mesh_drawing` does, in this process, told in JSON.

    Raises:
        MeshError: As there, or the file cannot be written.
    """
    told: dict[str, Any] = json.loads(task)
    how, path = Meshing(**told["how"]), str(told["path"])
    try:
        with gmsh_session(drawing.stem) as gmsh:
            _mesh(gmsh, drawing, how)
            gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
            gmsh.option.setNumber("Mesh.SaveAll", 0)
            named = named_groups(gmsh, str(drawing))
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
            set_sizes(gmsh, dim, how.size, how.sizes)
            refuse_too_many(gmsh, dim, how.size, how.sizes, how.most)
            _set_cells(gmsh, dim, how)
            gmsh.model.mesh.generate(dim)
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
        name_every_part(gmsh)
    else:
        plain = drawing.suffix.lower() in STEP
        name_parts(gmsh, how.bodies, how.surfaces, plain)


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
        gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 2 * (how.cell == "hexahedron"))
    if how.order is not None:
        gmsh.option.setNumber("Mesh.ElementOrder", how.order)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0)


def _count(gmsh: ModuleType, dim: int, tag: int) -> int:
    """Number of the cells of a body."""
    entities = gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
    return sum(sum(map(len, gmsh.model.mesh.getElements(dim, e)[1])) for e in entities)
