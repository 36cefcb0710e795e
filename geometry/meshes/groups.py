"""Named groups of points and edges of a mesh, and their nodes."""

from __future__ import annotations

from dataclasses import dataclass

import dolfinx
import numpy as np
import numpy.typing as npt

from tribox.geometry.compat import cell_nodes, entity_nodes

Ints = npt.NDArray[np.int32]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Group:
    """Points, or in space edges, of a mesh.

    Attributes:
        dim: 0 for points, 1 for edges.
        entities: (e,) local points or edges, ghosts included.
        vertices: (n,) local points of the group, ghosts included.
    """

    dim: int
    entities: Ints
    vertices: Ints

    def shares(self, space: dolfinx.fem.FunctionSpace) -> Floats:
        """Shares (n,) of the owned nodes in a load spread evenly over the group; collective.

        Over edges it is spread by their length, over points equally.
        """
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
        shares: Floats = np.asarray(owned / total, dtype=np.float64)
        return shares


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
    original = np.asarray(geometry.input_global_indices, dtype=np.int64)
    topology.create_connectivity(topology.dim, 0)
    links = topology.connectivity(topology.dim, 0)
    corner_of = links.array.reshape(links.num_nodes, -1)
    nodes = original[cell_nodes(mesh)[:, : corner_of.shape[1]]]
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
    out: npt.NDArray[np.int64] = pairs.min(axis=1) * (1 << 31) + pairs.max(axis=1)
    return out


def _edge_weights(space: dolfinx.fem.FunctionSpace, edges: Ints) -> tuple[Ints, Floats]:
    """Local nodes, and the integrals of their shape functions over the owned ones of edges."""
    mesh, topology = space.mesh, space.mesh.topology
    edges = edges[edges < topology.index_map(1).size_local]
    topology.create_connectivity(1, topology.dim)
    topology.create_connectivity(topology.dim, 1)
    cells, inside = topology.connectivity(1, topology.dim), topology.connectivity(topology.dim, 1)
    layout, quadratic = space.dofmap.dof_layout, space.element.basix_element.degree == 2
    ends = mesh.geometry.x[entity_nodes(mesh, 1, edges)]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) if len(edges) else np.empty(0)
    share = np.array([1.0, 1.0, 4.0]) / 6.0 if quadratic else np.array([0.5, 0.5])
    nodes = []
    for edge in edges:
        cell = int(cells.links(edge)[0])
        at = int(np.nonzero(inside.links(cell) == edge)[0][0])
        closure = layout.entity_closure_dofs(1, at)
        nodes.append(space.dofmap.cell_dofs(cell)[closure])
    found = np.array(nodes, dtype=np.int32).reshape(-1)
    return found, np.outer(lengths, share).reshape(-1)
