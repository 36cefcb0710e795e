"""Meshes of gmsh drawings: what the program ``gmsh`` would write from a ``.geo`` file."""

from __future__ import annotations

import json
import os
from pathlib import Path
from types import ModuleType

from geometry.meshes.gmsh_model import MeshError, gmsh_session, named_groups
from geometry.meshes.own_process import ask

LONGEST = 3600.0
"""Processor time of a drawing, s."""


def mesh_drawing(drawing: Path, path: Path) -> dict[str, int]:
    """Mesh a drawing and write it as a gmsh file of version 4.1; to be called on one process.

    The mesh is of the dimension of the highest physical group. The file appears under its name
    only when it is complete, and only with what `geometry.meshes.mesh.read` needs: named bodies.
    gmsh runs in a process of its own, which may break down or be told to exit by the drawing.

    Args:
        drawing: The drawing, ending in ``.geo``: a script that gmsh runs.
        path: The file to write, ending in ``.msh``, in an existing directory.

    Returns:
        Number of cells by name of the body.

    Raises:
        MeshError: If the drawing is missing, gmsh cannot draw or mesh it, or a body has no name.
        OSError: If the file cannot be written.
    """
    if not drawing.is_file():
        raise MeshError(f"{drawing}: no such file")
    partial = path.with_name(f".{path.stem}.partial.msh")
    try:
        partial.touch()
        counts = json.loads(ask("draw", drawing, str(partial), LONGEST, _all_memory()))
        partial.replace(path)
    except json.JSONDecodeError:
        raise MeshError(f"{drawing}: gmsh ended without a mesh") from None
    finally:
        partial.unlink(missing_ok=True)
    return {str(name): int(count) for name, count in counts.items()}


def _all_memory() -> int:
    """Bytes of this machine's memory."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def write_mesh_of(drawing: Path, path: Path) -> dict[str, int]:
    """What `mesh_drawing` does, in this process and under this name.

    Raises:
        MeshError: As there, or the file cannot be written.
    """
    try:
        with gmsh_session(drawing.stem) as gmsh:
            _mesh(gmsh, drawing)
            gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
            gmsh.option.setNumber("Mesh.SaveAll", 0)
            named = named_groups(gmsh, str(drawing))
            cells = {name: _count(gmsh, named.dim, tag) for name, tag in named.bodies.items()}
            gmsh.write(str(path))
    except MeshError:
        raise
    except Exception as error:  # gmsh raises nothing more specific
        words = " ".join(str(error).split())
        raise MeshError(f"{drawing}: gmsh cannot write its mesh: {words}") from error
    return cells


def _mesh(gmsh: ModuleType, drawing: Path) -> None:
    """Draw and mesh in the current model."""
    gmsh.logger.start()
    try:
        gmsh.merge(str(drawing))
        dim = max((d for d, _ in gmsh.model.getPhysicalGroups()), default=0)
        if dim >= 2:
            gmsh.model.mesh.generate(dim)
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


def _count(gmsh: ModuleType, dim: int, tag: int) -> int:
    """Number of the cells of a body."""
    entities = gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
    return sum(len(t) for e in entities for t in gmsh.model.mesh.getElements(dim, e)[1])
