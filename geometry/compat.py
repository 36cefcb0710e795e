"""Everything of DOLFINx that is private or differs between its versions 0.9, 0.10 and 0.11.

No other module imports ``dolfinx.cpp``, reads an attribute that begins with an underscore, or
branches on the version; `tests/geometry/test_compat.py` reads the sources and checks it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import basix.ufl
import dolfinx
import dolfinx.fem.petsc
import ffcx
import numpy as np
import ufl
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


def _load_compile_options() -> None:
    """Have DOLFINx and FFCx read their files of options, which they do once, somewhere else.

    They would take those of the working directory, which may be that of anyone's case, and flags of
    the compiler among them. Those of the user's own configuration count.
    """
    here = os.open(".", os.O_PATH)
    try:
        os.chdir("/")
        dolfinx.jit.get_options()
        ffcx.get_options()
    finally:
        os.fchdir(here)
        os.close(here)


_load_compile_options()

# DOLFINx calls it on every process with the communicator, the number of parts, the kinds of cells
# and, for each kind, the vertices of the cells in a row; it returns the part of each cell.
CellPartitioner = Callable[..., Any]

# -- meshes ---------------------------------------------------------------------------------------


def cell_partitioner(
    share_out: Callable[[NDArray[np.int64], int], NDArray[np.int32]],
) -> CellPartitioner:
    """A partitioner for a mesh of one kind of cells that one process holds.

    ``share_out`` gives it parts (c,) from the cells' vertices in a row and the number of parts.
    """

    def partition(comm: Any, parts: int, kinds: Any, cells: Any) -> Any:
        vertices = np.asarray(cells[0], dtype=np.int64)
        found = share_out(vertices, parts) if len(vertices) else np.empty(0, dtype=np.int32)
        return dolfinx.cpp.graph.AdjacencyList_int32(found.reshape(-1, 1))

    return partition


def mesh_of_cells(
    comm: MPI.Comm,
    cells: NDArray[np.int64],
    position: Floats,
    element: Any,
    partitioner: CellPartitioner | None = None,
) -> dolfinx.mesh.Mesh:
    """A mesh from nodes (c, a) of cells and positions (n, i), m; collective."""
    form, more = ufl.Mesh(element), {} if partitioner is None else {"partitioner": partitioner}
    return dolfinx.mesh.create_mesh(comm, cells, x=position, e=form, **more)


Tagged = tuple[NDArray[np.int64], Ints]  # nodes (e, a) of elements in gmsh's order, tags (e,)


def distributed_mesh(
    comm: MPI.Comm,
    kind: tuple[str, int],
    position: Floats,
    cells: Tagged,
    facets: Tagged | None,
    partitioner: CellPartitioner | None = None,
) -> tuple[dolfinx.mesh.Mesh, dolfinx.mesh.MeshTags, dolfinx.mesh.MeshTags]:
    """Distribute a mesh that one process has, with tags of cells and facets; collective.

    ``position``: (n, i), m, none on the others; ``cells``: of a ``kind`` of shape and degree;
    ``facets``: those with tags, None without any; ``partitioner``: None: DOLFINx's own, which
    balances cells.
    """
    variant, dim = basix.LagrangeVariant.equispaced, position.shape[1]
    element = basix.ufl.element("Lagrange", *kind, variant, shape=(dim,))
    nodes = _reordered(kind[0], cells[0])
    mesh = mesh_of_cells(comm, nodes, position, element, partitioner)
    tdim = mesh.topology.dim
    cell_tags = _tags_of(mesh, tdim, nodes, cells[1])
    if facets is None:
        none = np.empty(0, dtype=np.int32)
        return mesh, cell_tags, dolfinx.mesh.meshtags(mesh, tdim - 1, none, none)
    on_facets = _reordered(facet_kind(mesh), facets[0])
    return mesh, cell_tags, _tags_of(mesh, tdim - 1, on_facets, facets[1])


def _reordered(shape: str, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Nodes (e, a) in DOLFINx's order from those in gmsh's."""
    order = dolfinx.cpp.io.perm_gmsh(dolfinx.cpp.mesh.to_type(shape), nodes.shape[1])
    return nodes[:, order].copy()


def _tags_of(
    mesh: dolfinx.mesh.Mesh, dim: int, nodes: NDArray[np.int64], tags: Ints
) -> dolfinx.mesh.MeshTags:
    """Tags of entities, wherever they are now, from their nodes as they were; collective."""
    entities, values = dolfinx.io.distribute_entity_data(mesh, dim, nodes, tags)
    mesh.topology.create_connectivity(dim, mesh.topology.dim if dim < mesh.topology.dim else 0)
    found = dolfinx.graph.adjacencylist(entities)
    return dolfinx.mesh.meshtags_from_entities(mesh, dim, found, values.astype(np.int32))


def cell_nodes(mesh: dolfinx.mesh.Mesh) -> Ints:
    """Rows (c, a) of ``mesh.geometry.x`` of the nodes of each local cell, corners first."""
    geometry = mesh.geometry
    return geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap


def entity_nodes(mesh: dolfinx.mesh.Mesh, dim: int, entities: Ints) -> Ints:
    """Rows (e, a) of ``mesh.geometry.x`` of the nodes of each local edge or face."""
    if not len(entities):  # 0.9 divides by their number
        return np.empty((0, dim + 1), dtype=np.int32)
    return dolfinx.mesh.entities_to_geometry(mesh, dim, entities)


def cell_order(mesh: dolfinx.mesh.Mesh) -> int:
    """Degree of the polynomials that the cells' shape is of: 1 with straight edges."""
    geometry = mesh.geometry
    form = geometry.cmaps[0] if hasattr(geometry, "cmaps") else geometry.cmap
    return int(form.degree)


def facet_kind(mesh: dolfinx.mesh.Mesh) -> str:
    """Name of the shape of the facets of the mesh's cells, for instance "interval"."""
    cell, fdim = mesh.topology.cell_type, mesh.topology.dim - 1
    return str(dolfinx.cpp.mesh.to_string(dolfinx.cpp.mesh.cell_entity_type(cell, fdim, 0)))


def facets_per_cell(mesh: dolfinx.mesh.Mesh) -> int:
    """Number of facets of each cell of the mesh."""
    cell, fdim = mesh.topology.cell_type, mesh.topology.dim - 1
    return int(dolfinx.cpp.mesh.cell_num_entities(cell, fdim))


# -- integrals over surfaces, and spaces on them --------------------------------------------------


def integration_facets(mesh: dolfinx.mesh.Mesh, facets: Ints) -> Ints:
    """(cell, local facet) pairs, flattened, of the owned ones among exterior ``facets``."""
    fdim = mesh.topology.dim - 1
    mesh.topology.create_connectivity(fdim, fdim + 1)
    mesh.topology.create_connectivity(fdim + 1, fdim)
    arguments = [dolfinx.fem.IntegralType.exterior_facet, mesh.topology, np.sort(facets)]
    if not hasattr(dolfinx.mesh, "EntityMap"):
        arguments.append(fdim)  # 0.9
    pairs = dolfinx.fem.compute_integration_domains(*arguments)
    return np.asarray(pairs, dtype=np.int32).reshape(-1)


# -- spaces with more nodes than the mesh has -----------------------------------------------------


def with_more_nodes(space: dolfinx.fem.FunctionSpace, more: int) -> dolfinx.fem.FunctionSpace:
    """The same space with nodes behind this process's own that no cell has; collective.

    All that goes by the index map has room for them then: functions, vectors, matrices. In its
    local order they come between the process's own nodes and its ghosts.
    """
    dofmap, comm = space.dofmap, space.mesh.comm
    index, old = dofmap.index_map, dofmap._cpp_object
    counts = np.array(comm.allgather(more), dtype=np.int64)
    if not counts.any():
        return space
    owners = np.asarray(index.owners, dtype=np.int32)
    ghosts = np.asarray(index.ghosts, dtype=np.int64) + (np.cumsum(counts) - counts)[owners]
    tag = [0] if hasattr(dolfinx.mesh, "EntityMap") else []  # of the messages, asked for from 0.10
    wider = dolfinx.cpp.common.IndexMap(comm, index.size_local + more, ghosts, owners, *tag)
    nodes = np.asarray(dofmap.list)
    nodes = np.where(nodes >= index.size_local, nodes + more, nodes).astype(np.int32)
    table = dolfinx.cpp.graph.AdjacencyList_int32(nodes)
    made = dolfinx.cpp.fem.DofMap(old.dof_layout, wider, old.index_map_bs, table, old.bs)
    mesh, element = space.mesh._cpp_object, getattr(space.element, "_cpp_object", space.element)
    kind, arguments = type(space._cpp_object), (mesh, element, made)
    try:
        whole = kind(*arguments)
    except TypeError:  # 0.9
        whole = kind(*arguments, list(space.value_shape))
    return dolfinx.fem.FunctionSpace(space.mesh, space.ufl_element(), whole)


# -- assembly -------------------------------------------------------------------------------------


def add_matrix(A: PETSc.Mat, form: dolfinx.fem.Form, unrolled: bool) -> None:
    """Add a bilinear form to a matrix, as it is: no rows are replaced and nothing is communicated.

    DOLFINx's public function cannot add a second form to a matrix, since it inserts a diagonal
    after the first, nor address single rows of a blocked matrix.
    """
    dolfinx.cpp.fem.petsc.assemble_matrix(
        A,
        form._cpp_object,
        dolfinx.cpp.fem.pack_constants(form._cpp_object),
        dolfinx.cpp.fem.pack_coefficients(form._cpp_object),
        [],
        unrolled,
    )


# -- compiled code --------------------------------------------------------------------------------


def compiler_cache() -> Path:
    """Directory in which FFCx keeps compiled forms."""
    return Path(dolfinx.jit.get_options()["cache_dir"]).expanduser()
