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

import numpy as np
import numpy.typing as npt

from tribox.geometry.meshes.drawing import write_mesh_of
from tribox.geometry.meshes.extraction import arrays_of
from tribox.geometry.meshes.gmsh_model import REFUSED, SIDES, MeshError, gmsh_session
from tribox.geometry.meshes.mesh_arrays import MeshArrays


def read_msh(path: Path, most_cells: int | None = None) -> MeshArrays:
    """Read and check a gmsh file in this process; MeshError, also beyond ``most_cells``."""
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
    """
    formats = "meshes are read from gmsh's .msh files, version 2 or 4"
    if not path.is_file():
        raise MeshError(f"{path}: no such file")
    if path.suffix.lower() != ".msh":
        raise MeshError(f"{path}: {formats}{_way_from(path)}")
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


# Formats of other programs, and what makes a mesh or a drawing of them.
_BY_GMSH = (".unv", ".med", ".bdf", ".nas", ".cgns")
_BY_MESHIO = (".inp", ".vtu", ".vtk", ".xdmf", ".e", ".exo", ".ans", ".k", ".f3grid")
_PARTS = (".iges", ".igs", ".brep", ".x_t", ".sat", ".sldprt", ".ipt", ".prt", ".fcstd")
_PAGE = "docs/meshes.md, other formats"


def _way_from(path: Path) -> str:
    """How a file of another format becomes one that is read; empty where none is known."""
    kind, name = path.suffix.lower(), path.name
    if kind in _BY_GMSH:
        return f"; with the names of its groups: gmsh {name} -save -o {path.stem}.msh"
    if kind in _BY_MESHIO:
        return f"; meshio reads {kind} files, and its sets become groups as shown in {_PAGE}"
    if kind in _PARTS:
        return "; export the part as STEP (.step), which is meshed"
    if kind == ".stl":
        return f'; what triangles enclose is meshed by a .geo drawing with Merge "{name}" ({_PAGE})'
    return ""


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


# -- Whether the cells of a mesh lie side by side, as those of a damaged or tangled file may not ---
#
# Axis letters: c cells, f facets of all cells, a corners, i space.

Longs = npt.NDArray[np.int64]

FLAT = 1e-14  # smallest extent of a cell: its determinant over the power of its longest side

# Corners joined to the first one.
_AROUND = {
    "triangle": (1, 2),
    "quadrilateral": (1, 3),
    "tetrahedron": (1, 2, 3),
    "hexahedron": (1, 3, 4),
}


def check_neighbours(mesh: MeshArrays, source: str) -> None:
    """See that a facet is of one cell, or of two, on either side; MeshError if it is not."""
    cells = mesh.cells
    sign = _orientation(mesh, cells, source)
    facets = np.concatenate([cells[:, list(at)] for at in SIDES[mesh.cell]])
    side = np.tile(sign, len(SIDES[mesh.cell])) * _turn(facets)
    order = np.lexsort(np.sort(facets, axis=1).T[::-1])
    same = np.sort(facets[order], axis=1)
    begins = np.flatnonzero(np.r_[True, (same[1:] != same[:-1]).any(axis=1)])
    counts = np.diff(np.r_[begins, len(facets)])
    if (many := int(np.count_nonzero(counts > 2))) > 0:
        raise MeshError(f"{source}: {many} facets are those of more than two cells")
    # Cells on either side go round their facet in opposite senses, so that the two add up to 0.
    sums = np.add.reduceat(side[order], begins)
    if (tangled := int(np.count_nonzero((counts == 2) & (sums != 0)))) > 0:
        raise MeshError(
            f"{source}: at {tangled} facets both cells lie on the same side, so that they overlap; "
            "a node is misplaced or a cell inverted"
        )


def _orientation(mesh: MeshArrays, cells: Longs, source: str) -> Longs:
    """+1 for cells (c,) numbered as gmsh does, −1 for mirrored ones."""
    corners = mesh.position[cells][:, :, : mesh.dim]
    edges = corners[:, list(_AROUND[mesh.cell])] - corners[:, :1]
    extent = np.ptp(corners, axis=1).max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.linalg.det(edges / extent[:, None, None])
    flat = int(np.count_nonzero(~(np.abs(ratio) > FLAT)))
    if flat:
        raise MeshError(f"{source}: {flat} cells are folded or without extent")
    return np.sign(ratio).astype(np.int64)


def _turn(facets: Longs) -> Longs:
    """+1 or −1 (f,): the sense in which the corners go round, whichever comes first."""
    count = facets.shape[1]
    if count == 2:
        return np.where(facets[:, 0] < facets[:, 1], 1, -1)
    first = facets.argmin(axis=1)
    rows = np.arange(len(facets))
    after, before = facets[rows, (first + 1) % count], facets[rows, (first - 1) % count]
    return np.where(after < before, 1, -1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
