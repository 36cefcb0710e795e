"""Meshes and drawings made by others, read and meshed by gmsh in a process of its own.

gmsh overwrites memory on some damaged files and ends the process it runs in. There it costs that
process only, and what the program gets to see are arrays that it has checked, or one line.

    python3 -m tribox.geometry.meshes.foreign read FILE MOST_CELLS
    python3 -m tribox.geometry.meshes.foreign draw DRAWING JSON

write the arrays of a mesh file, or the number of cells of a drawing's bodies, to standard output.
"""

from __future__ import annotations

import json
import os
import re
import resource
import sys
from pathlib import Path
from types import ModuleType

from tribox.geometry.meshes.drawing import write_mesh_of
from tribox.geometry.meshes.extraction import arrays_of
from tribox.geometry.meshes.gmsh_model import MeshError, gmsh_session
from tribox.geometry.meshes.mesh_arrays import MeshArrays
from tribox.geometry.meshes.neighbours import check_neighbours
from tribox.geometry.meshes.own_process import REFUSED


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
            _open_msh(gmsh, path)
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


def _open_msh(gmsh: ModuleType, path: Path) -> None:
    """Read a ``.msh`` file into the current model.

    The header is checked first: gmsh would run the commands of a script.

    Args:
        gmsh: The module, from ``gmsh_session``.
        path: The file.

    Raises:
        MeshError: If the file is missing, is not a mesh file of version 2 or 4, or is damaged.
    """
    formats = "meshes are read from gmsh's .msh files, version 2 or 4"
    if not path.is_file():
        raise MeshError(f"{path}: no such file")
    if path.suffix.lower() != ".msh":
        raise MeshError(f"{path}: {formats}")
    with path.open("rb") as file:
        version = _msh_version(file.read(1 << 16))
        if version is None:
            raise MeshError(f"{path}: not a gmsh mesh ($MeshFormat is missing); {formats}")
        if version.split(".")[0] not in ("2", "4"):
            raise MeshError(f"{path}: a .msh file of version {version}; {formats}")
        # Under its own name gmsh would run a file beside it too, of the name with ".opt" added.
        nameless = f"/proc/self/fd/{file.fileno()}"
        try:
            gmsh.merge(nameless)
        # gmsh raises nothing more specific than Exception.
        except Exception as error:
            said = " ".join(str(error).replace(nameless, path.name).split())
            raise MeshError(
                f"{path}: gmsh cannot read it: {said or 'it does not say why'}"
            ) from error


def _msh_version(start: bytes) -> str | None:
    """The version in the ``$MeshFormat`` line; None for what does not begin as a mesh does.

    Of anything else gmsh runs the commands, also where it holds a mesh further down.
    """
    if not start.startswith((b"$MeshFormat", b"$Comments")):
        return None
    words = start.partition(b"$MeshFormat")[2].split(maxsplit=1)
    found = re.match(rb"[0-9.]{1,9}$", words[0]) if words else None
    return found[0].decode() if found else None


def _answer(task: str, source: str, last: str) -> bytes:
    """What a task leads to, as bytes."""
    if task == "read":
        return read_msh(Path(source), int(last)).packed()
    return json.dumps(write_mesh_of(Path(source), last)).encode()


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
