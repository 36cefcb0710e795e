"""Meshes with named bodies and surfaces, generated or read from a gmsh file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import combinations
from pathlib import Path
from types import ModuleType

import dolfinx
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from geometry.compat import (
    CellPartitioner,
    cell_nodes,
    cell_partitioner,
    integration_facets,
    model_to_mesh,
)
from geometry.meshes import metis
from geometry.meshes.gmsh_model import (
    MeshError,
    NamedGroups,
    Shape,
    gmsh_session,
    named_groups,
    open_msh,
    vertices_and_facets,
)
from geometry.meshes.partition import share_out

__all__ = ["MeshError", "NamedMesh", "bodies_sharing_nodes", "generate", "read"]

Contacts = Sequence[tuple[str, str]]  # names of the slave and the master surface of each pair


@dataclass(frozen=True, slots=True)
class NamedMesh:
    """A distributed mesh whose bodies and surfaces have names.

    Attributes:
        mesh: The mesh, of straight first-order cells; coordinates in m, 2 in the plane, 3 in space.
        cell_tags: The body's tag of every cell.
        facet_tags: The surface's tag of every facet on a named surface.
        bodies: Tag of each body.
        surfaces: Tag of each surface.
    """

    mesh: dolfinx.mesh.Mesh
    cell_tags: dolfinx.mesh.MeshTags
    facet_tags: dolfinx.mesh.MeshTags
    bodies: dict[str, int]
    surfaces: dict[str, int]

    def body_tag(self, name: str) -> int:
        """The tag of a body in ``cell_tags``.

        Raises:
            MeshError: If there is no such body; the nearest name is offered.
        """
        return _look_up("body", name, self.bodies)

    def surface_tag(self, name: str) -> int:
        """The tag of a surface in ``facet_tags``.

        Raises:
            MeshError: If there is no such surface; the nearest name is offered.
        """
        return _look_up("surface", name, self.surfaces)

    def cells(self, name: str) -> npt.NDArray[np.int32]:
        """Local indices (c,) of a body's cells on this process, ghosts included.

        Raises:
            MeshError: If there is no such body.
        """
        return np.asarray(self.cell_tags.find(self.body_tag(name)), dtype=np.int32)

    def facets(self, name: str) -> npt.NDArray[np.int32]:
        """Local indices (f,) of a surface's facets on this process, ghosts included.

        Raises:
            MeshError: If there is no such surface.
        """
        return np.asarray(self.facet_tags.find(self.surface_tag(name)), dtype=np.int32)

    def body_of(self, surface: str) -> str:
        """The body that a surface lies on; collective.

        Raises:
            MeshError: On all processes, if there is no such surface, or it is not on one body.
        """
        cells = integration_facets(self.mesh, self.facets(surface))[::2]
        mine = set(self.cell_tags.values[np.isin(self.cell_tags.indices, cells)].tolist())
        found = set().union(*self.mesh.comm.allgather(mine))
        names = [name for name, tag in self.bodies.items() if tag in found]
        if len(names) != 1:
            raise MeshError(
                f'surface "{surface}" must lie on one body; it lies on {", ".join(names) or "none"}'
            )
        return names[0]


def generate(shape: Shape, comm: MPI.Comm, contacts: Contacts = ()) -> NamedMesh:
    """Mesh a built-in geometry on one process and distribute it; collective.

    Args:
        shape: The geometry.
        comm: Communicator of the mesh.
        contacts: Pairs whose slave facets are shared out evenly, like the cells; without any (or
            without METIS) only the cells are.

    Returns:
        The mesh, with the names that the shape's ``build`` gives.
    """
    return _load(lambda gmsh: shape.build(), type(shape).__name__, comm, contacts)


def read(path: Path, comm: MPI.Comm, contacts: Contacts = ()) -> NamedMesh:
    """Read a gmsh file (``.msh``, version 2 or 4) on one process and distribute it; collective.

    Every cell must be in a named physical group (a body); named groups of facets become surfaces,
    and groups of lower dimension are ignored. Cells are triangles or quadrilaterals in the plane
    z = 0, or tetrahedra or hexahedra, of first order and of one kind. Coordinates are taken as m.

    Args:
        path: The file.
        comm: Communicator of the mesh.
        contacts: As in ``generate``; names that the file does not have are ignored.

    Returns:
        The mesh with the file's names.

    Raises:
        MeshError: On all processes, if the file cannot be used; the message names it.
    """
    return _load(lambda gmsh: open_msh(gmsh, Path(path)), str(path), comm, contacts)


def bodies_sharing_nodes(named: NamedMesh) -> list[tuple[str, str]]:
    """Pairs of bodies with common nodes; collective.

    Bodies in contact must not have any: they could neither slide nor separate there.

    Args:
        named: The mesh.

    Returns:
        Names of the bodies of each such pair, in the order of ``named.bodies``; the same on all
        processes.
    """
    geometry = named.mesh.geometry
    comm = named.mesh.comm
    used = {}
    for name in named.bodies:
        marks = dolfinx.la.vector(geometry.index_map(), 1, dtype=np.float64)
        marks.array[np.unique(cell_nodes(named.mesh)[named.cells(name)])] = 1.0
        # A body may use a node only on a process that does not own it.
        marks.scatter_reverse(dolfinx.la.InsertMode.add)
        used[name] = marks.array[: geometry.index_map().size_local] > 0.0
    return [
        (a, b)
        for a, b in combinations(named.bodies, 2)
        if comm.allreduce(bool(np.any(used[a] & used[b])), op=MPI.LOR)
    ]


def _load(
    fill: Callable[[ModuleType], None], source: str, comm: MPI.Comm, contacts: Contacts
) -> NamedMesh:
    """Fill a gmsh model on the first process, check it there, and distribute it."""
    with ExitStack() as stack:
        gmsh, groups, problem = None, None, None
        if comm.rank == 0:
            try:
                gmsh = stack.enter_context(gmsh_session(source))
                fill(gmsh)
                groups = named_groups(gmsh, source)
            except Exception as error:
                problem = error
        groups = _agreed(comm, groups, problem)
        model = None if gmsh is None else gmsh.model
        partitioner = _partitioner(gmsh, groups, comm, contacts)
        mesh, cell_tags, facet_tags = model_to_mesh(model, comm, 0, groups.dim, partitioner)
    mesh.topology.create_entities(groups.dim - 1)
    named = NamedMesh(mesh, cell_tags, facet_tags, groups.bodies, groups.surfaces)
    _check_facets_found(named, groups, source)
    return named


def _partitioner(
    gmsh: ModuleType | None, groups: NamedGroups, comm: MPI.Comm, contacts: Contacts
) -> CellPartitioner | None:
    """Shares out cells and slave facets; None where DOLFINx's own is used; collective."""
    known = [pair for pair in contacts if groups.surfaces.keys() >= set(pair)]
    if comm.size == 1 or not known or not comm.bcast(metis.is_available(), root=0):
        return None

    def parts_of(vertices: npt.NDArray[np.int64], parts: int) -> npt.NDArray[np.int32]:
        assert gmsh is not None, "the cells are where the model is"
        tags = [groups.surfaces[name] for pair in known for name in pair]
        position, facets = vertices_and_facets(gmsh, groups.dim, tags)
        pairs = list(zip(facets[::2], facets[1::2], strict=True))
        return share_out(vertices.reshape(-1, groups.cell_vertices), position, pairs, parts)

    return cell_partitioner(parts_of)


def _agreed(comm: MPI.Comm, groups: NamedGroups | None, problem: Exception | None) -> NamedGroups:
    """The first process's result on all; or an error on all, so that none waits for the others."""
    own = (groups, None if problem is None else str(problem), isinstance(problem, MeshError))
    agreed, message, expected = comm.bcast(own, root=0)
    if problem is not None:
        raise problem
    if message is not None:
        raise MeshError(message) if expected else RuntimeError(message)
    return agreed


def _check_facets_found(named: NamedMesh, groups: NamedGroups, source: str) -> None:
    """An error for facets that bound no cell, which DOLFINx leaves out silently; collective."""
    owned = named.mesh.topology.index_map(named.mesh.topology.dim - 1).size_local
    for name, expected in groups.facet_counts.items():
        local = int(np.count_nonzero(named.facets(name) < owned))
        found = named.mesh.comm.allreduce(local)
        if found != expected:
            raise MeshError(
                f"{source}: {expected - found} of the {expected} facets of surface {name!r} are "
                "not on the boundary of any cell"
            )


def _look_up(kind: str, name: str, tags: Mapping[str, int]) -> int:
    """The tag of a name, or an error that offers the nearest one."""
    if name in tags:
        return tags[name]
    near = get_close_matches(name, tags, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"there are: {', '.join(tags) or 'none'}"
    raise MeshError(f"no {kind} named {name!r}; {hint}")
