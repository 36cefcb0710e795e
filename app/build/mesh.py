"""The mesh of a case, generated or read, and whether the case goes with it."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

from app.build.boundary_conditions import ON_AXIS
from app.case.case import Case
from app.case.geometry import GeneratedGeometry
from app.case.validation import format_problem
from app.errors import InputError
from geometry.meshes.gmsh_model import MeshError
from geometry.meshes.mesh import NamedMesh, bodies_sharing_nodes, generate, read


def make_mesh(case: Case, comm: MPI.Comm) -> NamedMesh:
    """The case's mesh, generated or read, with every name the case uses; collective.

    Raises:
        InputError: no such file, body or surface, or bodies that are glued together.
    """
    geometry = case.geometry
    shared = case.solver.partition == "contact"
    contacts = [(contact.slave, contact.master) for contact in case.contact] if shared else []
    try:
        if isinstance(geometry, GeneratedGeometry):
            return generate(geometry.shape(), comm, contacts)
        try:
            named = read(Path(geometry.mesh), comm, contacts, geometry.max_cells)
        except MeshError as error:
            raise MeshError(f"geometry.mesh: {error}") from None
        try:
            _check_names(case, named)
            _check_section(case, named)
        except MeshError as error:
            raise MeshError(f"{error} (mesh {geometry.mesh})") from None
        glued = bodies_sharing_nodes(named)
    except MeshError as error:
        raise InputError(str(error)) from None
    if glued:
        first, second = glued[0]
        raise InputError(
            f'{geometry.mesh}: bodies "{first}" and "{second}" share nodes, so they cannot slide; '
            "mesh them apart (no common points between the bodies)"
        )
    _check_owners(case, named)
    return named


def _check_names(case: Case, named: NamedMesh) -> None:
    place = ""
    try:
        for name in case.bodies:
            place = f"bodies.{name}: "
            named.body_tag(name)
        for index, contact in enumerate(case.contact):
            for key in ("slave", "master"):
                place = f"contact.{index}.{key}: "
                named.surface_tag(getattr(contact, key))
        for index, boundary in enumerate(case.boundary):
            place = f"boundary.{index}.surface: "
            named.surface_tag(boundary.surface)
    except MeshError as error:
        raise MeshError(f"{place}{error}") from None
    for name in named.bodies:
        if name not in case.bodies:
            raise MeshError(f'the mesh has a body "{name}", the case has no [bodies.{name}]')


def _check_owners(case: Case, named: NamedMesh) -> None:
    """See that every surface in use lies on one body; collective."""
    pairs = [(contact.slave, contact.master) for contact in case.contact]
    used = [name for pair in pairs for name in pair] + [part.surface for part in case.boundary]
    for surface in dict.fromkeys(used):
        try:
            named.body_of(surface)
        except MeshError as error:
            raise InputError(str(error)) from None


def _check_section(case: Case, named: NamedMesh) -> None:
    """See that what the case says of a mesh in the plane, or in space, goes with this mesh."""
    try:
        section = case.geometry.section_in(named.mesh.geometry.dim)
    except ValueError as error:
        raise MeshError(f"geometry.{error}") from None
    for index, boundary in enumerate(case.boundary):
        for problem in boundary.section_problems(section, ("boundary", index)):
            raise MeshError(format_problem(problem))
    for name, body in case.bodies.items():
        if body.velocity is not None:
            for problem in body.velocity.section_problems(section, ("bodies", name, "velocity")):
                raise MeshError(format_problem(problem))
    if section == "axisymmetric":
        x = named.mesh.geometry.x[:, 0]
        low, high = float(x.min(initial=0.0)), float(x.max(initial=0.0))
        low = named.mesh.comm.allreduce(low, op=MPI.MIN)
        if low < -ON_AXIS * named.mesh.comm.allreduce(high, op=MPI.MAX):
            raise MeshError(
                f'geometry.section = "axisymmetric": the mesh reaches x = {low:g} m; x is the '
                "distance from the axis of symmetry and must be >= 0 m"
            )
