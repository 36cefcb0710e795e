"""Meshes with named bodies and surfaces, generated or read from a gmsh file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from tempfile import TemporaryDirectory

import dolfinx
import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from tribox.geometry import compat
from tribox.geometry.generators.blocks import Blocks
from tribox.geometry.generators.two_blocks import TwoBlocks
from tribox.geometry.meshes.drawing import AS_DRAWN, DRAWINGS, Meshing, mesh_drawing
from tribox.geometry.meshes.extraction import arrays_of
from tribox.geometry.meshes.gmsh_model import CORNERS, MeshError, Shape, ask, gmsh_session
from tribox.geometry.meshes.mesh_arrays import MeshArrays, Part, unpacked
from tribox.geometry.meshes.partition import metis_is_available, share_out

__all__ = ["MeshError", "NamedMesh", "generate", "read"]

MOST_CELLS = 5_000_000  # cells of a file that are read unless more are asked for

MOST_BYTES = 4000  # of a file, for each cell: ten times what gmsh writes
# For reading a file, ten times what gmsh takes and its start: processor time, and bytes of memory.
# A damaged number may ask for far more.
SECONDS, SECONDS_PER_BYTE = 60.0, 2e-6
MEMORY, MEMORY_PER_BYTE = 2 << 30, 1000

Contacts = Sequence[tuple[str, str]]  # names of the slave and the master surface of each pair


@dataclass(frozen=True, slots=True)
class NamedMesh:
    """A distributed mesh whose bodies and surfaces have names.

    Attributes:
        mesh: The mesh, of one kind of cells; coordinates in m, 2 in the plane, 3 in space. Cells
            are straight (order 1), or curved, of second order.
        cell_tags: The body's tag of every cell.
        facet_tags: The surface's tag of every facet on a named surface.
        bodies: Tag of each body.
        surfaces: Tag of each surface.
        groups: Named points and, in space, edges.
        order: Of the cells, 1 or 2.
        notes: What the reader did to the mesh, one line each.
    """

    mesh: dolfinx.mesh.Mesh
    cell_tags: dolfinx.mesh.MeshTags
    facet_tags: dolfinx.mesh.MeshTags
    bodies: dict[str, int]
    surfaces: dict[str, int]
    groups: dict[str, Group] = field(default_factory=dict)
    order: int = 1
    notes: tuple[str, ...] = ()

    def body_tag(self, name: str) -> int:
        """The tag of a body in ``cell_tags``; MeshError offers the nearest name."""
        return _look_up("body", name, self.bodies)

    def surface_tag(self, name: str) -> int:
        """The tag of a surface in ``facet_tags``; MeshError offers the nearest name."""
        return _look_up("surface", name, self.surfaces)

    def cells(self, name: str) -> npt.NDArray[np.int32]:
        """Local indices (c,) of a body's cells here, with ghosts; MeshError if there is none."""
        return np.asarray(self.cell_tags.find(self.body_tag(name)), dtype=np.int32)

    @property
    def cell_count(self) -> int:
        """Number of the cells of all bodies, on all processes."""
        return int(self.mesh.topology.index_map(self.mesh.topology.dim).size_global)

    def facets(self, name: str) -> npt.NDArray[np.int32]:
        """Local indices (f,) of a surface's facets here, with ghosts; MeshError if it is none."""
        return np.asarray(self.facet_tags.find(self.surface_tag(name)), dtype=np.int32)

    def nodes(self, name: str) -> npt.NDArray[np.int32]:
        """Local points (n,) of a group's topology here, with ghosts; MeshError if there is none."""
        if name not in self.groups:
            _look_up("group", name, dict.fromkeys(self.groups, 0))
        return self.groups[name].vertices

    def heed_place(self, name: str) -> None:
        """See that there is such a surface or group; MeshError offers the nearest name."""
        _look_up("surface", name, {**self.surfaces, **dict.fromkeys(self.groups, 0)})

    def bodies_of(self, surface: str) -> list[str]:
        """Bodies that a surface or group bounds; MeshError if it is none, or inside; collective."""
        if surface in self.groups:
            corners = self.mesh.topology.connectivity(self.mesh.topology.dim, 0)
            table = corners.array.reshape(corners.num_nodes, -1)
            near = np.nonzero(np.isin(table, self.nodes(surface)).any(axis=1))[0]
            return self._bodies_with(near.astype(np.int32))
        facets = self.facets(surface)
        owned = self.mesh.topology.index_map(self.mesh.topology.dim - 1).size_local
        cells = compat.integration_facets(self.mesh, facets)[::2]
        local = np.array([np.count_nonzero(facets < owned), len(cells)])
        count, outside = self.mesh.comm.allreduce(local, op=MPI.SUM)
        if outside < count:
            raise MeshError(
                f'surface "{surface}": {count - outside} of its {count} facets lie inside '
                "the mesh, with cells on both sides; bodies that share nodes are bonded and have "
                "no surface there"
            )
        return self._bodies_with(cells)

    def _bodies_with(self, cells: npt.NDArray[np.int32]) -> list[str]:
        """The bodies that any process's local cells belong to; collective."""
        mine = set(self.cell_tags.values[np.isin(self.cell_tags.indices, cells)].tolist())
        found = set().union(*self.mesh.comm.allgather(mine))
        return [name for name, tag in self.bodies.items() if tag in found]

    def body_of(self, surface: str) -> str:
        """The one body that a surface or group lies on; MeshError if it is not one; collective."""
        names = self.bodies_of(surface)
        if len(names) != 1:
            raise MeshError(
                f'surface "{surface}" must lie on one body; it lies on {", ".join(names)}'
            )
        return names[0]


def generate(shape: Shape, comm: MPI.Comm, contacts: Contacts = ()) -> NamedMesh:
    """Mesh a built-in geometry on one process and distribute it with its names; collective.

    ``contacts``: pairs whose slave facets are shared out like cells; a master may be a tool.
    """
    return _load(lambda: _generated(shape), type(shape).__name__, comm, contacts)


def read(
    path: Path,
    comm: MPI.Comm,
    contacts: Contacts = (),
    most_cells: int = MOST_CELLS,
    scale: float = 1.0,
    straight: bool = False,
    how: Meshing = AS_DRAWN,
) -> NamedMesh:
    """Read a gmsh file, or mesh a drawing, on one process and distribute the mesh; collective.

    gmsh does it in a process of its own, which the first process starts. (Whether a drawing may do
    more than draw is for the caller to see to.)

    Every cell must be in a named physical group (a body); named groups of facets become surfaces,
    and named points, or in space edges, become groups. Cells are triangles and quadrilaterals in
    the plane z = 0, or tetrahedra, hexahedra and prisms; where there are several kinds, or prisms,
    all are divided into quadrilaterals or hexahedra. Cells of one kind may be of second order.

    Args:
        path: The file: ``.msh`` of version 2 or 4, or a drawing.
        contacts: As in ``generate``; slaves that the file does not have are ignored.
        most_cells: More are refused.
        scale: m, of a unit of the file's coordinates.
        straight: Whether of second-order cells only the corners are taken.
        how: A drawing is meshed.

    Returns:
        The mesh with the file's names.

    Raises:
        MeshError: On all processes, if the file cannot be used; the message names it.
    """

    def make() -> MeshArrays:
        drawn = Path(path).suffix.lower() in DRAWINGS
        found = _drawn(Path(path), how, most_cells) if drawn else _read(Path(path), most_cells)
        arrays = found.scaled(scale)
        return (arrays.straightened() if straight else arrays).cuts_noted()

    return _load(make, str(path), comm, contacts)


def _load(
    make: Callable[[], MeshArrays], source: str, comm: MPI.Comm, contacts: Contacts
) -> NamedMesh:
    """Make the arrays on the first process, checked there, and distribute them."""
    arrays = _made(make, comm)
    dim, parts = arrays.dim, (arrays.bodies, arrays.surfaces)
    cells, facets = (_tagged(some) if some else None for some in parts)
    assert cells is not None, "a mesh has a body"
    mesh, cell_tags, facet_tags = compat.distributed_mesh(
        *(comm, (arrays.cell, arrays.order), arrays.position[:, :dim], cells, facets),
        _partitioner(arrays, comm, contacts),
    )
    mesh.topology.create_entities(dim - 1)
    bodies, surfaces = ({name: part.tag for name, part in some.items()} for some in parts)
    groups = {name: found_group(mesh, corners) for name, corners in arrays.groups.items()}
    named = NamedMesh(
        *(mesh, cell_tags, facet_tags, bodies, surfaces, groups),
        order=arrays.order,
        notes=arrays.notes,
    )
    _check_facets_found(named, arrays, source)
    return named


def _tagged(parts: Mapping[str, Part]) -> compat.Tagged:
    """All elements of some parts, with their tags."""
    tags = [np.full(len(part.nodes), part.tag, dtype=np.int32) for part in parts.values()]
    return np.concatenate([part.nodes for part in parts.values()]), np.concatenate(tags)


def _generated(shape: Shape) -> MeshArrays:
    """The mesh of a built-in geometry: by gmsh, which takes long to load, only where need be."""
    regular = shape.regular() if isinstance(shape, Blocks | TwoBlocks) else None
    if regular is not None:
        bodies, surfaces = (
            {name: Part(tag, nodes) for name, (tag, nodes) in parts.items()}
            for parts in (regular.bodies, regular.surfaces)
        )
        return MeshArrays(regular.cell, regular.position, bodies, surfaces)
    source = type(shape).__name__
    with gmsh_session(source) as gmsh:
        try:
            shape.build()
        except Exception as error:  # gmsh raises nothing more specific
            said = " ".join(str(error).split())
            raise MeshError(f"gmsh cannot mesh this geometry: {said}") from error
        return arrays_of(gmsh, source)


def _drawn(drawing: Path, how: Meshing, most_cells: int) -> MeshArrays:
    """The mesh of a drawing."""
    with TemporaryDirectory() as directory:
        path = Path(directory) / f"{drawing.stem}.msh"
        mesh_drawing(drawing, path, how)
        try:
            return _read(path, most_cells)
        except MeshError as error:
            raise MeshError(str(error).replace(str(path), str(drawing))) from None


def _read(path: Path, most_cells: int) -> MeshArrays:
    """The mesh of a file, read in a process of its own."""
    try:
        size = path.stat().st_size
    except FileNotFoundError:
        raise MeshError(f"{path}: no such file") from None
    except OSError as error:
        raise MeshError(f"{path}: cannot be read ({error.strerror})") from None
    if size > MOST_BYTES * most_cells:
        raise MeshError(
            f"{path}: a file of {size / 1e9:.3g} GB; geometry.max_cells = {most_cells} is too few "
            "for it"
        )
    seconds, memory = SECONDS + size * SECONDS_PER_BYTE, MEMORY + size * MEMORY_PER_BYTE
    answer = ask("read", path, str(most_cells), seconds, memory)
    try:
        return unpacked(answer)
    except MeshError as error:
        raise MeshError(f"{path}: gmsh broke down on it: {error}") from None


def _partitioner(
    arrays: MeshArrays, comm: MPI.Comm, contacts: Contacts
) -> compat.CellPartitioner | None:
    """Shares out cells and slave facets; None where DOLFINx's own is used; collective."""
    known = [pair for pair in contacts if pair[0] in arrays.surfaces]
    if comm.size == 1 or not known or not comm.bcast(metis_is_available(), root=0):
        return None

    def parts_of(vertices: npt.NDArray[np.int64], parts: int) -> npt.NDArray[np.int32]:
        pairs = [(arrays.facets(slave), _facets(arrays, master)) for slave, master in known]
        cells = vertices.reshape(-1, CORNERS[arrays.cell])
        return share_out(cells, arrays.position[:, : arrays.dim], pairs, parts)

    return compat.cell_partitioner(parts_of)


def _facets(arrays: MeshArrays, surface: str) -> npt.NDArray[np.int64]:
    """Facets (f, v) of a surface; (0, v) of a tool, which is none of the mesh."""
    if surface in arrays.surfaces:
        return arrays.facets(surface)
    return arrays.facets(next(iter(arrays.surfaces)))[:0]


def _made(make: Callable[[], MeshArrays], comm: MPI.Comm) -> MeshArrays:
    """The arrays, on all but the first process without nodes; or an error on all; collective."""
    arrays, problem = None, None
    if comm.rank == 0:
        try:
            arrays = make()
        except Exception as error:  # which the others shall hear of, and not wait
            problem = error
    # As text: an exception may hold what cannot be sent to another process.
    words = None if problem is None else str(problem)
    own = (None if arrays is None else arrays.emptied(), words, isinstance(problem, MeshError))
    names, message, expected = comm.bcast(own, root=0)
    if problem is not None:
        raise problem
    if message is not None:
        raise MeshError(message) if expected else RuntimeError(message)
    return names if arrays is None else arrays


def _check_facets_found(named: NamedMesh, arrays: MeshArrays, source: str) -> None:
    """An error for facets that bound no cell, which DOLFINx leaves out silently; collective."""
    owned = named.mesh.topology.index_map(named.mesh.topology.dim - 1).size_local
    for name, part in arrays.surfaces.items():
        local = np.array([np.count_nonzero(named.facets(name) < owned), len(part.nodes)])
        found, expected = named.mesh.comm.allreduce(local)
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


# -- Named groups of points and edges of a mesh, and their nodes -----------------------------------

Ints = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Group:
    """Points, or in space edges, of a mesh."""

    dim: int  # 0 for points, 1 for edges
    entities: Ints  # (e,) local points or edges, ghosts included
    vertices: Ints  # (n,) local points of the group, ghosts included

    def shares(self, space: dolfinx.fem.FunctionSpace) -> Floats:
        """Shares (n,) of owned nodes in a load spread by length, or over points; collective."""
        index = space.dofmap.index_map
        vector = dolfinx.la.vector(index, 1)
        if self.dim == 0:
            dofs = group_dofs(space, self, 0) // space.dofmap.index_map_bs
            vector.array[dofs] = 1.0
        else:
            nodes, weights = _edge_weights(space, self.entities)
            np.add.at(vector.array, nodes, weights)
            vector.scatter_reverse(dolfinx.la.InsertMode.add)
        owned: Floats = vector.array[: index.size_local].copy()
        total = float(space.mesh.comm.allreduce(owned.sum()))
        return np.asarray(owned / total, dtype=np.float64)


def group_dofs(space: dolfinx.fem.FunctionSpace, group: Group, component: int) -> Ints:
    """Owned local scalar unknowns of one displacement component of a group; collective."""
    topology = space.mesh.topology
    topology.create_connectivity(group.dim, topology.dim)
    entities = np.sort(group.entities)
    dofs = dolfinx.fem.locate_dofs_topological(space.sub(component), group.dim, entities)
    owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    return np.unique(dofs[dofs < owned]).astype(np.int32)


def found_group(mesh: dolfinx.mesh.Mesh, corners: npt.NDArray[np.int64]) -> Group:
    """The group of points (n, 1) or edges (e, 2), given by the nodes of the mesh's file."""
    topology, geometry = mesh.topology, mesh.geometry
    # DOLFINx numbers nodes anew on every rank: those of the file are the only names in common.
    original = np.asarray(geometry.input_global_indices, dtype=np.int64)
    topology.create_connectivity(topology.dim, 0)
    links = topology.connectivity(topology.dim, 0)
    corner_of = links.array.reshape(links.num_nodes, -1)
    nodes = original[compat.cell_nodes(mesh)[:, : corner_of.shape[1]]]
    count = topology.index_map(0).size_local + topology.index_map(0).num_ghosts
    node_of = np.full(count, -1, dtype=np.int64)  # of the file, of each local point
    node_of[corner_of] = nodes
    vertices = np.nonzero(np.isin(node_of, corners))[0].astype(np.int32)
    if corners.shape[1] == 1:
        return Group(0, vertices, vertices)
    topology.create_entities(1)
    topology.create_connectivity(1, 0)
    ends = topology.connectivity(1, 0).array.reshape(-1, 2)
    chosen = np.isin(_numbers(node_of[ends]), _numbers(corners))
    return Group(1, np.nonzero(chosen)[0].astype(np.int32), vertices)


def _numbers(pairs: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """A number (e,) for each pair (e, 2) of nodes, the same in either order."""
    # Nodes of a file are fewer than 2³¹, by the number of cells that are read.
    return pairs.min(axis=1) * (1 << 31) + pairs.max(axis=1)


def _edge_weights(space: dolfinx.fem.FunctionSpace, edges: Ints) -> tuple[Ints, Floats]:
    """Local nodes, and the integrals of their shape functions over the owned ones of edges."""
    mesh, topology = space.mesh, space.mesh.topology
    edges = edges[edges < topology.index_map(1).size_local]
    topology.create_connectivity(1, topology.dim)
    topology.create_connectivity(topology.dim, 1)
    cells, inside = topology.connectivity(1, topology.dim), topology.connectivity(topology.dim, 1)
    layout, quadratic = space.dofmap.dof_layout, space.element.basix_element.degree == 2
    ends = mesh.geometry.x[compat.entity_nodes(mesh, 1, edges)]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) if len(edges) else np.empty(0)
    # Integrals of shape functions: of second order as in Simpson's rule, with the middle last.
    share = np.array([1.0, 1.0, 4.0]) / 6.0 if quadratic else np.array([0.5, 0.5])
    nodes = []
    for edge in edges:
        cell = int(cells.links(edge)[0])
        at = int(np.nonzero(inside.links(cell) == edge)[0][0])
        nodes.append(space.dofmap.cell_dofs(cell)[layout.entity_closure_dofs(1, at)])
    found = np.array(nodes, dtype=np.int32).reshape(-1)
    return found, np.outer(lengths, share).reshape(-1)
