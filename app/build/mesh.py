"""The mesh of a case, whether the case goes with it, and which bodies it bonds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from tribox.app.build.boundary_conditions import ON_AXIS
from tribox.app.case.case import Case, of_a_tool
from tribox.app.case.geometry import GeneratedGeometry
from tribox.app.case.validation import format_problem
from tribox.app.equilibrium.supports import connected, sharing
from tribox.app.errors import InputError
from tribox.geometry.compat import cell_nodes, entity_nodes
from tribox.geometry.meshes.gmsh_model import MeshError
from tribox.geometry.meshes.mesh import NamedMesh, generate, read


def make_mesh(case: Case, comm: MPI.Comm) -> NamedMesh:
    """The case's mesh, made or read, with all names that the case uses; InputError; collective."""
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
            # Of second-order cells the corners alone are taken where first order is asked for.
            given = [body.formulation for body in case.bodies.values()]
            named = read(
                geometry.meshed or geometry.mesh,
                comm,
                contacts,
                geometry.max_cells,
                geometry.unit,
                case.is_explicit or any(one not in (None, "q2") for one in given),
                geometry.meshing(),
            )
        except MeshError as error:
            raise MeshError(f"geometry.mesh: {error}") from None
        wrong = [*_name_problems(case, named), *_section_problems(case, named)]
        if wrong:
            first, *more = (f"{line} (mesh {geometry.mesh})" for line in wrong)
            raise InputError(first, more)
    except MeshError as error:
        raise InputError(str(error)) from None
    _check_surfaces(case, named)
    return named


def _name_problems(case: Case, named: NamedMesh) -> Iterator[str]:
    """Names of the case that the mesh has not, and bodies the other way round."""
    wanted: list[tuple[str, Callable[[str], object], str]] = [
        (f"bodies.{name}", named.body_tag, name) for name in case.bodies
    ]
    for index, contact in enumerate(case.contact):
        wanted.append((f"contact.{index}.slave", named.surface_tag, contact.slave))
        if contact.master not in case.tools:
            wanted.append((f"contact.{index}.master", named.surface_tag, contact.master))
    for index, boundary in enumerate(case.boundary):
        surface = boundary.surface
        if surface in case.tools and surface not in named.surfaces:
            yield f'boundary.{index}.surface = "{surface}": {of_a_tool(surface)}'
        else:
            wanted.append((f"boundary.{index}.surface", named.heed_place, surface))
    for place, tag_of, name in wanted:
        try:
            tag_of(name)
        except MeshError as error:
            yield f"{place}: {error}"
    for name in case.tools:
        if name in named.surfaces:
            yield f"tools.{name}: a surface of the mesh has this name already"
    for name in named.bodies:
        if name not in case.bodies:
            yield f'the mesh has a body "{name}", the case has no [bodies.{name}]'


def _check_surfaces(case: Case, named: NamedMesh) -> None:
    """See that a contact is between two bodies that are not bonded there; collective.

    A boundary may spread over bodies that are bonded.
    """
    try:
        for index, contact in enumerate(case.contact):
            pair = (contact.slave, contact.master)
            if contact.master in case.tools:
                named.body_of(contact.slave)
                continue
            first, second = map(named.body_of, pair)
            if shared := surfaces_sharing_nodes(named, pair):
                raise InputError(
                    f'contact.{index}: slave "{pair[0]}" and master "{pair[1]}" share {shared} '
                    f'nodes, so bodies "{first}" and "{second}" cannot slide there; mesh them apart'
                    if first != second
                    else f'contact.{index}: slave "{pair[0]}" and master "{pair[1]}" share '
                    f'{shared} nodes, so body "{first}" cannot close there; leave a facet between'
                )
        groups = bonded_groups(named)
        for boundary in case.boundary:
            on = set(named.bodies_of(boundary.surface))
            if not any(on <= set(group) for group in groups):
                named.body_of(boundary.surface)
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
    for name, tool in case.tools.items():
        yield from map(format_problem, tool.section_problems(section, ("tools", name)))
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


# -- Nodes that bodies or surfaces of a mesh share: there bodies are bonded ------------------------


def bodies_sharing_nodes(named: NamedMesh) -> dict[tuple[str, str], int]:
    """Number of common nodes, by names, of bodies that have any: they are bonded; collective."""
    nodes = {name: cell_nodes(named.mesh)[named.cells(name)] for name in named.bodies}
    return _sharing(named, nodes)


def bonded_groups(named: NamedMesh) -> list[list[str]]:
    """Names of all bodies, those together that shared nodes connect; collective."""
    names = list(named.bodies)
    pairs = [(names.index(a), names.index(b)) for a, b in bodies_sharing_nodes(named)]
    return [[names[k] for k in group] for group in connected(len(names), pairs)]


def surfaces_sharing_nodes(named: NamedMesh, surfaces: tuple[str, str]) -> int:
    """Number of the common nodes of two surfaces; collective."""
    mesh = named.mesh
    nodes = {
        name: entity_nodes(mesh, mesh.topology.dim - 1, named.facets(name)) for name in surfaces
    }
    return sum(_sharing(named, nodes).values())


def _sharing(
    named: NamedMesh, nodes: Mapping[str, npt.NDArray[np.int32]]
) -> dict[tuple[str, str], int]:
    """How many of the mesh's nodes two of several sets, by local numbers, share; collective."""
    names, mesh = list(nodes), named.mesh
    counts = sharing(mesh.geometry.index_map(), mesh.comm, list(nodes.values()))
    return {(names[a], names[b]): count for (a, b), count in counts.items()}
