"""Mesh files and pictures of cases and drawings: what ``tribox mesh`` does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from tribox.app.build.mesh import make_mesh
from tribox.app.case.geometry import GeneratedGeometry, MeshGeometry
from tribox.app.case.reading import load_case
from tribox.app.case.trust import drawings_of, require_drawing
from tribox.app.errors import InputError
from tribox.app.results.directory import default_directory
from tribox.app.run.meshed import meshed
from tribox.geometry.compat import cell_nodes, entity_nodes
from tribox.geometry.meshes.drawing import AS_DRAWN, STEP, Meshing, mesh_drawing
from tribox.geometry.meshes.gmsh_model import MeshError, write_msh
from tribox.geometry.meshes.mesh import NamedMesh, read
from tribox.geometry.pictures.plane import length_unit, save_picture


def write_case_mesh(
    case_file: Path, overrides: Sequence[str], out: Path | None, force: bool, trust: bool
) -> None:
    """Write a picture of a case's mesh, and the mesh where it is not a file already.

    Args:
        case_file: The case.
        overrides: Keys that are changed.
        out: Directory; None: beside the results.
        force: Whether files that are there are replaced.
        trust: Whether a drawing may do more than draw.

    Raises:
        InputError: The case or its mesh cannot be used, or a file is there.
    """
    case = load_case(case_file, overrides)
    default = default_directory(case_file)
    directory = out or default.with_name(default.name + "-mesh")
    msh, picture = directory / "mesh.msh", directory / "mesh.png"
    _see_free((msh, picture), force)
    geometry, drawings = case.geometry, drawings_of(case)
    for drawing in drawings if not trust else ():
        require_drawing(drawing)
    with meshed(case, None, MPI.COMM_SELF) as whole:
        named = make_mesh(whole, MPI.COMM_SELF)
        directory.mkdir(parents=True, exist_ok=True)
        if isinstance(geometry, GeneratedGeometry):
            write_msh(geometry.shape(), msh)
            print(f"wrote {msh}")
        elif drawings and isinstance(whole.geometry, MeshGeometry) and whole.geometry.meshed:
            msh.write_bytes(whole.geometry.meshed.read_bytes())
            print(f"wrote {msh}")
    for note in named.notes:
        print(f"note: {note}")
    save_picture(named, picture, case.title)
    print(f"wrote {picture}")


def write_drawing_mesh(drawing: Path, out: Path | None, force: bool, trust: bool) -> None:
    """Write the mesh of a drawing; of a STEP file with a name for each part, and a picture.

    Args:
        drawing: The drawing.
        out: The mesh file; None: beside the drawing.
        force: Whether files that are there are replaced.
        trust: Whether it may do more than draw.

    Raises:
        InputError: The drawing cannot be meshed, or a file is there or cannot be written.
    """
    if not trust:
        require_drawing(drawing)
    path = out or drawing.with_suffix(".msh")
    step = drawing.suffix.lower() in STEP
    if path.suffix != ".msh":
        raise InputError(f"--out {path}: name the mesh of a drawing as a file ending in .msh")
    picture = path.with_suffix(".png")
    _see_free((path, picture) if step else (path,), force)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        cells = mesh_drawing(drawing, path, Meshing(every=True) if step else AS_DRAWN)
        told = ", ".join(f"{name} {count}" for name, count in cells.items())
        print(f"wrote {path} (cells: {told})")
        if step:
            named = read(path, MPI.COMM_SELF)
            save_picture(named, picture, f"the parts of {drawing.name}")
            for line in _parts(named):
                print(line)
            print(f"wrote {picture}, with the numbers for geometry.bodies and geometry.surfaces")
    except MeshError as error:
        raise InputError(str(error)) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None


def _parts(named: NamedMesh) -> Iterator[str]:
    """Where each body and surface of a mesh on one process lies."""
    mesh = named.mesh
    x, dim = mesh.geometry.x, mesh.topology.dim
    factor, unit = length_unit(float(np.ptp(x, axis=0).max()))
    nodes = {name: cell_nodes(mesh)[named.cells(name)] for name in named.bodies}
    nodes |= {name: entity_nodes(mesh, dim - 1, named.facets(name)) for name in named.surfaces}
    for name, rows in nodes.items():
        places = factor * x[np.unique(rows), :dim]
        low, high = places.min(axis=0), places.max(axis=0)
        ends = zip("xyz", low, high, strict=False)
        yield f"{name}: " + ", ".join(f"{i} {a:.4g} to {b:.4g}" for i, a, b in ends) + f" {unit}"


def _see_free(paths: Sequence[Path], force: bool) -> None:
    for path in paths:
        if path.exists() and not force:
            raise InputError(f"{path}: exists already; replace it with --force")
