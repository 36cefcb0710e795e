"""Meshes and drawings made by others, read and meshed by gmsh in a process of its own.

gmsh overwrites memory on some damaged files and ends the process it runs in. There it costs that
process only, and what the program gets to see are arrays that it has checked, or one line.

    python3 -m geometry.meshes.foreign read FILE MOST_CELLS
    python3 -m geometry.meshes.foreign draw DRAWING FILE

write the arrays of a mesh file, or the number of cells of a drawing's bodies, to standard output.
"""

from __future__ import annotations

import json
import os
import resource
import sys
from pathlib import Path

from geometry.meshes.drawing import write_mesh_of
from geometry.meshes.extraction import arrays_of
from geometry.meshes.gmsh_model import MeshError, gmsh_session, open_msh
from geometry.meshes.mesh_arrays import MeshArrays
from geometry.meshes.neighbours import check_neighbours
from geometry.meshes.own_process import REFUSED


def read_msh(path: Path, most_cells: int | None = None) -> MeshArrays:
    """Read a gmsh file and check it, in this process.

    Args:
        path: The file.
        most_cells: More are refused; None: any number.

    Raises:
        MeshError: The file cannot be used; the message names it.
    """
    try:
        with gmsh_session("mesh") as gmsh:
            open_msh(gmsh, path)
            mesh = arrays_of(gmsh, str(path))
    except MeshError:
        raise
    # gmsh's errors are plain Exceptions, and a damaged model may be odd in any other way.
    except Exception as error:
        said = " ".join(str(error).split()) or "it does not say why"
        raise MeshError(f"{path}: gmsh cannot read it: {said}") from error
    count = len(mesh.cells)
    if most_cells is not None and count > most_cells:
        raise MeshError(f"{path}: {count} cells; geometry.max_cells = {most_cells} allows no more")
    check_neighbours(mesh, str(path))
    return mesh


def _answer(task: str, source: str, last: str) -> bytes:
    """What a task leads to, as bytes."""
    if task == "read":
        return read_msh(Path(source), int(last)).packed()
    return json.dumps(write_mesh_of(Path(source), Path(last))).encode()


def main(arguments: list[str]) -> int:
    """Do a task and write its answer, or the line that says what is wrong, to standard output."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever else is printed must not stand between the arrays
    try:
        answer, code = _answer(*arguments), 0
    except MeshError as error:
        answer, code = str(error).encode(errors="surrogateescape"), REFUSED
    with out:
        out.write(answer)
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
