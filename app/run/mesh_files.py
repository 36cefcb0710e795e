"""Mesh files and pictures of cases and drawings: what ``tribox mesh`` does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from mpi4py import MPI

from tribox.app.build.mesh import make_mesh
from tribox.app.build.tools import extent, tool_surface
from tribox.app.case.boundary import COMPONENTS, DRIVEN, Boundary, direction_components, unit_vector
from tribox.app.case.case import Case
from tribox.app.case.contact import Contact
from tribox.app.case.geometry import GeneratedGeometry, MeshGeometry
from tribox.app.case.reading import load_case
from tribox.app.case.time_tables import TimeTable
from tribox.app.case.tools import AnyTool
from tribox.app.case.trust import require_drawing, require_trust
from tribox.app.errors import InputError, tell
from tribox.app.figures.mesh_picture import Arrow, Marks, save_picture
from tribox.app.figures.style import fitting
from tribox.app.results.directory import default_directory, unwritable
from tribox.app.run.run import meshed
from tribox.geometry.compat import cell_nodes, entity_nodes
from tribox.geometry.meshes.drawing import AS_DRAWN, STEP, Meshing, mesh_drawing
from tribox.geometry.meshes.gmsh_model import MeshError, write_msh
from tribox.geometry.meshes.mesh import NamedMesh, read


def write_case_mesh(
    case_file: Path, overrides: Sequence[str], out: Path | None, force: bool, trust: bool
) -> None:
    """Write a picture of a case's mesh, and the mesh if it is none of a file, to ``out``.

    InputError if case or mesh cannot be used, or a file is there; OutputError.
    """
    case = load_case(case_file, overrides)
    default = default_directory(case_file)
    directory = out or default.with_name(default.name + "-mesh")
    msh, picture = directory / "mesh.msh", directory / "mesh.png"
    _see_free((msh, picture), force)
    geometry = case.geometry
    require_trust(case, case_file, trust, python=False)
    with meshed(case, None, MPI.COMM_SELF) as whole:
        named = make_mesh(whole, MPI.COMM_SELF)
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(directory, error) from None
        if isinstance(geometry, GeneratedGeometry):
            write_msh(geometry.shape(), msh)
            print(f"wrote {msh}")
        elif (
            whole is not case and isinstance(whole.geometry, MeshGeometry) and whole.geometry.meshed
        ):
            msh.write_bytes(whole.geometry.meshed.read_bytes())
            print(f"wrote {msh}")
    for note in named.notes:
        tell(f"note: {note}")
    save_picture(named, picture, case.title, marks_of(case, named))
    print(f"wrote {picture}")


def marks_of(case: Case, named: NamedMesh) -> Marks:
    """What a mesh picture shows of a case: tools, pairs, deeds; InputError of a tool's shape."""
    words: dict[str, list[str]] = {}
    arrows: dict[str, list[Arrow]] = {}
    for name, table in (*((b.surface, b) for b in case.boundary), *case.tools.items()):
        for word, arrow in _deeds(table, named.mesh.geometry.dim):
            words.setdefault(name, []).extend([word] if word else [])
            arrows.setdefault(name, []).extend([] if arrow is None else [arrow])
    tools, box = {}, extent(named)
    for name, tool in case.tools.items():
        try:
            outline = tool_surface(tool, box, named.mesh.comm).outline(box)
        except ValueError as error:
            raise InputError(f"tools.{name}: {error}") from None
        tools[name] = outline.points, outline.cells
    pairs = [
        (f"{contact.name}: " if contact.name else "")
        + f"{contact.slave} on {contact.master}"
        + (", bonded" if contact.friction is None else f", {law_of(contact)}")
        for contact in case.contact
    ]
    said = {name: ", ".join(dict.fromkeys(w)) for name, w in words.items()}
    return Marks(said, arrows, tools, pairs, [contact.slave for contact in case.contact])


def law_of(contact: Contact) -> str:
    """A friction law in words."""
    friction, mu = contact.friction, getattr(contact.friction, "mu", None)
    name = "" if friction is None else friction.law
    return f"{name} {mu:g}" if isinstance(mu, float) else name


def _deeds(table: Boundary | AnyTool, dim: int) -> Iterator[tuple[str, Arrow | None]]:
    """What a table does, in words and as an arrow."""
    done: dict[str, list[str]] = {}
    for key in ("displacement", "velocity", "force", "traction"):
        part = getattr(table, key, None)
        for axis, component in enumerate(COMPONENTS[:dim]):
            value = getattr(part, component, None)
            if value is None:
                continue
            first = 1.0 if value == DRIVEN else _first(value)
            way = [0.0] * dim
            way[axis] = -1.0 if first < 0.0 else 1.0
            load = key in ("force", "traction")
            kind = "loaded" if load else "moved" if first else "held"
            word = "driven" if value == DRIVEN else key if load else kind
            done.setdefault(word, []).append(component)
            yield "", Arrow(tuple(way), kind)
    for word, components in done.items():
        yield f"{', '.join(components)} {word}", None
    for key in ("platen", "spring"):
        part = getattr(table, key, None)
        if part is not None:
            way = list(unit_vector(part.direction, dim))
            along = "".join(direction_components(part.direction))
            yield f"{key} in {along}", Arrow(tuple(way), "loaded", presses=key == "platen")
    if getattr(table, "pressure", None) is not None:
        yield "pressure", Arrow(None, "loaded")
    for key in ("foundation", "rotation"):
        if getattr(table, key, None) is not None:
            yield key, None
    if getattr(table, "symmetry", False):
        yield "symmetry", Arrow(None, "held")


def _first(table: TimeTable) -> float:
    """The first value of a program but zero; 0 where there is none."""
    return next((value for value in table.values if value), 0.0)


def write_drawing_mesh(drawing: Path, out: Path | None, force: bool, trust: bool) -> None:
    """Write the mesh of a drawing to ``out`` or beside it; of STEP with a name for each part.

    InputError if it cannot be meshed, or a file is there or cannot be written.
    """
    if not drawing.exists():
        raise InputError(f"{drawing}: no such file")
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
    unit = fitting(np.ptp(x, axis=0), "m")
    nodes = {name: cell_nodes(mesh)[named.cells(name)] for name in named.bodies}
    nodes |= {name: entity_nodes(mesh, dim - 1, named.facets(name)) for name in named.surfaces}
    for name, rows in nodes.items():
        places = unit.factor * x[np.unique(rows), :dim]
        low, high = places.min(axis=0), places.max(axis=0)
        ends = zip("xyz", low, high, strict=False)
        yield (
            f"{name}: " + ", ".join(f"{i} {a:.4g} to {b:.4g}" for i, a, b in ends) + f" {unit.name}"
        )


def _see_free(paths: Sequence[Path], force: bool) -> None:
    for path in paths:
        if path.exists() and not force:
            raise InputError(f"{path}: exists already; replace it with --force")
