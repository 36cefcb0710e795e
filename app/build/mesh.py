"""The mesh of a case, generated or read, and whether the case goes with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
        InputError: no such file, body or surface, or bodies that are glued together; the message
            names the case file.
    """
    try:
        return _made_mesh(case, comm)
    except InputError as error:
        raise of_case(case, error) from None


def of_case(case: Case, error: InputError) -> InputError:
    """The error with the case file before each of its lines, where it is not there yet."""
    source = "" if case.source is None else f"{case.source}: "
    first, *more = (line if line.startswith(source) else source + line for line in error.lines)
    return InputError(first, more)


def _made_mesh(case: Case, comm: MPI.Comm) -> NamedMesh:
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
        wrong = [*_name_problems(case, named), *_section_problems(case, named)]
        if wrong:
            first, *more = (f"{line} (mesh {geometry.mesh})" for line in wrong)
            raise InputError(first, more)
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


def _name_problems(case: Case, named: NamedMesh) -> Iterator[str]:
    """Names of the case that the mesh has not, and bodies the other way round."""
    wanted: list[tuple[str, Callable[[str], object], str]] = [
        (f"bodies.{name}", named.body_tag, name) for name in case.bodies
    ]
    for index, contact in enumerate(case.contact):
        wanted.append((f"contact.{index}.slave", named.surface_tag, contact.slave))
        wanted.append((f"contact.{index}.master", named.surface_tag, contact.master))
    for index, boundary in enumerate(case.boundary):
        wanted.append((f"boundary.{index}.surface", named.heed_place, boundary.surface))
    for place, tag_of, name in wanted:
        try:
            tag_of(name)
        except MeshError as error:
            yield f"{place}: {error}"
    for name in named.bodies:
        if name not in case.bodies:
            yield f'the mesh has a body "{name}", the case has no [bodies.{name}]'


def _check_owners(case: Case, named: NamedMesh) -> None:
    """See that every surface in use lies on one body; collective."""
    pairs = [(contact.slave, contact.master) for contact in case.contact]
    used = [name for pair in pairs for name in pair] + [part.surface for part in case.boundary]
    for surface in dict.fromkeys(used):
        try:
            named.body_of(surface)
        except MeshError as error:
            raise InputError(str(error)) from None


def _section_problems(case: Case, named: NamedMesh) -> Iterator[str]:
    """What does not go with this mesh being in the plane or in space; collective."""
    try:
        section = case.geometry.section_in(named.mesh.geometry.dim)
    except ValueError as error:
        yield f"geometry.{error}"
        return
    for index, boundary in enumerate(case.boundary):
        yield from map(format_problem, boundary.section_problems(section, ("boundary", index)))
        if boundary.surface in named.groups:
            yield from map(format_problem, boundary.group_problems(("boundary", index)))
    if case.gravity is not None:
        yield from map(format_problem, case.gravity.section_problems(section, ("gravity",)))
    for name, body in case.bodies.items():
        if body.velocity is not None:
            place = ("bodies", name, "velocity")
            yield from map(format_problem, body.velocity.section_problems(section, place))
    if section == "axisymmetric":
        x = named.mesh.geometry.x[:, 0]
        low, high = float(x.min(initial=0.0)), float(x.max(initial=0.0))
        low = named.mesh.comm.allreduce(low, op=MPI.MIN)
        if low < -ON_AXIS * named.mesh.comm.allreduce(high, op=MPI.MAX):
            yield (
                f'geometry.section = "axisymmetric": the mesh reaches x = {low:g} m; x is the '
                "distance from the axis of symmetry and must be >= 0 m"
            )
