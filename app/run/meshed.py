"""The mesh of a run's drawing: made when it begins, and the same one when it goes on."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from mpi4py import MPI

from tribox.app.case.case import Case
from tribox.app.case.geometry import MeshGeometry
from tribox.app.case.reading import load_past_case
from tribox.app.errors import InputError
from tribox.app.results.inputs import INPUTS, sha256_of
from tribox.app.results.saving import on_first
from tribox.geometry.meshes.drawing import mesh_drawing
from tribox.geometry.meshes.gmsh_model import MeshError


@contextmanager
def meshed(case: Case, directory: Path | None, comm: MPI.Comm) -> Iterator[Case]:
    """Context with the case whose drawing, if it has one, is meshed; collective.

    The mesh is that of the results in ``directory`` where they are of the same drawing, so that a
    run goes on with the mesh it began with, whatever gmsh would make of the drawing today. Within
    the context the mesh is a file, which may be copied.

    Args:
        case: What is run; whether its drawing may do more than draw is for the caller to see to.
        directory: Of the results of a run that goes on; None: the drawing is meshed.
        comm: Ranks that work together.

    Raises:
        InputError: The drawing cannot be meshed.
    """
    geometry = case.geometry
    if not isinstance(geometry, MeshGeometry) or not geometry.is_drawing or geometry.meshed:
        yield case
        return
    with TemporaryDirectory() as place:
        where = Path(place) / f"{geometry.mesh.stem}.msh"

        def make() -> Path:
            kept = None if directory is None else _kept(geometry, directory)
            if kept is not None:
                return kept
            source = "" if case.source is None else f"{case.source}: "
            try:
                mesh_drawing(geometry.mesh, where, geometry.meshing())
            except MeshError as error:
                raise InputError(f"{source}geometry.mesh: {error}") from None
            return where

        path = comm.bcast(on_first(comm, make))
        yield case.with_mesh(path)


def _kept(geometry: MeshGeometry, directory: Path) -> Path | None:
    """The mesh in a results directory, if it is one of this drawing."""
    began = load_past_case(directory / "case.toml").geometry
    if not isinstance(began, MeshGeometry) or began.meshed is None or not began.meshed.is_file():
        return None
    copy = directory / INPUTS / began.mesh.name
    same = copy.is_file() and sha256_of(copy) == sha256_of(geometry.mesh)
    return began.meshed if same else None
