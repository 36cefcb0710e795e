"""Parts with equal numbers of cells and of slave facets, and what touches in the same part."""

from __future__ import annotations

import dolfinx
import numpy as np
import pytest
import scipy.sparse
from mpi4py import MPI

from tribox.geometry.compat import cell_nodes
from tribox.geometry.generators.two_blocks import Block, TwoBlocks
from tribox.geometry.generators.two_boxes import Box, TwoBoxes
from tribox.geometry.meshes import partition
from tribox.geometry.meshes.extraction import arrays_of
from tribox.geometry.meshes.gmsh_model import gmsh_session
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.meshes.partition import share_out


def blocks(cell):
    """The upper block is off the middle of the lower one, whose surface is far wider."""
    return TwoBlocks(Block(1.0, 0.5, (24, 12)), Block(4.0, 0.5, (60, 10)), 2.8, cell=cell)


def boxes(cell):
    upper, lower = Box(1.0, 0.5, 1.0, elements=(8, 4, 8)), Box(3.0, 0.5, 1.5, elements=(18, 4, 9))
    return TwoBoxes(upper, lower, offset=(1.8, 0.3), cell=cell)


SHAPES = {
    "quadrilateral": blocks("quadrilateral"),
    "triangle": blocks("triangle"),
    "hexahedron": boxes("hexahedron"),
    "tetrahedron": boxes("tetrahedron"),
}


class Parts:
    """Cells and contact facets of two bodies, with the cell behind each facet."""

    def __init__(self, shape):
        mesh = generate(shape, MPI.COMM_SELF)
        self.position = mesh.mesh.geometry.x[:, : mesh.mesh.geometry.dim]
        self.cells = cell_nodes(mesh.mesh).astype(np.int64)
        self.facets, self.behind = [], []
        dim = mesh.mesh.topology.dim
        mesh.mesh.topology.create_connectivity(dim - 1, dim)
        to_cell = mesh.mesh.topology.connectivity(dim - 1, dim)
        for name in ("elastomer_contact", "aluminium_contact"):
            facets = mesh.facets(name)
            nodes = dolfinx.mesh.entities_to_geometry(mesh.mesh, dim - 1, facets)
            self.facets.append(nodes.astype(np.int64))
            self.behind.append(np.array([to_cell.links(facet)[0] for facet in facets]))

    def shared_out(self, parts, contacts=None):
        pairs = [tuple(self.facets)] if contacts is None else contacts
        return share_out(self.cells, self.position, pairs, parts)


@pytest.fixture(scope="module", params=SHAPES)
def mesh(request):
    return Parts(SHAPES[request.param])


@pytest.mark.parametrize("parts", [2, 3, 4, 9])
def test_cells_and_slave_facets_are_shared_out_evenly(mesh, parts):
    found = mesh.shared_out(parts)
    cells = np.bincount(found, minlength=parts)
    slaves = np.bincount(found[mesh.behind[0]], minlength=parts)
    assert len(found) == len(mesh.cells) and len(cells) == parts
    # Whole facets cannot be shared out evenly, and METIS takes their grain as a measure for all.
    mean = len(mesh.behind[0]) / parts
    grain = np.ceil(mean) / mean
    assert slaves.max() <= np.ceil(1.06 * mean)
    assert cells.max() <= 1.06 * grain * len(mesh.cells) / parts


def test_without_contacts_slave_facets_are_not_shared_out(mesh):
    slaves = np.bincount(mesh.shared_out(2, [])[mesh.behind[0]], minlength=2)
    assert slaves.max() > 0.9 * slaves.sum()


@pytest.mark.parametrize("parts", [2, 4])
def test_facets_that_touch_are_mostly_in_one_part(mesh, parts):
    found = mesh.shared_out(parts)
    slaves, masters = (mesh.position[facets].mean(axis=1) for facets in mesh.facets)
    apart = np.linalg.norm(slaves[:, None] - masters[None], axis=2)
    beside = mesh.behind[1][np.argmin(apart, axis=1)]
    assert np.mean(found[mesh.behind[0]] == found[beside]) > 0.75


def test_neighbours_are_mostly_in_one_part(mesh):
    """Pieces are whole: few pairs of cells with a common vertex are apart."""
    found = mesh.shared_out(4)
    first = np.full(len(mesh.position), -1)
    first[mesh.cells] = found[:, None]
    assert np.mean(first[mesh.cells] != found[:, None]) < 0.2


def test_same_parts_every_time(mesh):
    np.testing.assert_array_equal(mesh.shared_out(3), mesh.shared_out(3))


def test_each_contact_is_shared_out_for_itself(mesh):
    """Two pairs with a body in between: the second one's slaves are the first one's masters."""
    slave, master = mesh.facets
    found = mesh.shared_out(2, [(slave, master), (master, slave)])
    for behind in mesh.behind:
        shares = np.bincount(found[behind], minlength=2)
        assert shares.max() <= 0.54 * shares.sum()


def test_the_slave_of_a_tool_is_shared_out(mesh):
    """A tool has no facets in the mesh; a second one on the same slave asks for nothing more."""
    slave, none = mesh.facets[0], mesh.facets[1][:0]
    found = mesh.shared_out(2, [(slave, none)])
    shares = np.bincount(found[mesh.behind[0]], minlength=2)
    assert shares.max() <= 0.54 * shares.sum()
    np.testing.assert_array_equal(mesh.shared_out(2, [(slave, none), (slave, none)]), found)


def slaves_of_a_tool(comm, directory):
    """Slave facets that each rank owns, where the master is no surface of the mesh."""
    named = generate(SHAPES["quadrilateral"], comm, [("elastomer_contact", "punch")])
    owned = named.mesh.topology.index_map(1).size_local
    return comm.allgather(int(np.count_nonzero(named.facets("elastomer_contact") < owned)))


@pytest.mark.mpi(slaves_of_a_tool, 2)
def test_ranks_share_the_slave_of_a_tool(on_ranks):
    assert on_ranks(slaves_of_a_tool, 2) == [12, 12]


def test_facets_of_no_cell_are_passed_over():
    """They are reported later, by name."""
    parts = Parts(SHAPES["triangle"])
    slave, master = parts.facets
    odd = np.concatenate([slave, [[slave[0, 0], master[0, 0]]]])
    found = parts.shared_out(2, [(odd, master)])
    np.testing.assert_array_equal(found, parts.shared_out(2))
    none = odd[-1:]
    np.testing.assert_array_equal(parts.shared_out(2, [(none, none)]), parts.shared_out(2, []))


def test_more_parts_than_cells():
    """A part may be empty."""
    block = Block(1.0, 1.0, (2, 1))
    parts = Parts(TwoBlocks(block, block))
    for count in (4, 12):
        assert sorted(parts.shared_out(count)) == [0, 1, 2, 3]


def test_vertices_are_numbered_as_dolfinx_does():
    """The positions go with the vertices that DOLFINx hands to a partitioner."""
    shape = SHAPES["hexahedron"]
    with gmsh_session("vertices") as gmsh:
        shape.build()
        arrays = arrays_of(gmsh, "vertices")
    slave, top = (arrays.surfaces[name].nodes for name in ("elastomer_contact", "top"))
    position = arrays.position
    assert slave.shape == top.shape == (64, 4)
    np.testing.assert_allclose(position[slave][:, :, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(position[top][:, :, 1], 0.5, atol=1e-12)
    mesh = generate(shape, MPI.COMM_SELF).mesh
    # original input numbers of the nodes
    np.testing.assert_allclose(
        mesh.geometry.x, position[mesh.geometry.input_global_indices], atol=1e-12
    )


# -- METIS ----------------------------------------------------------------------------------------


def ring(count):
    """Vertices in a circle, each joined to the next."""
    return scipy.sparse.csr_matrix(
        (
            np.ones(2 * count),
            (np.arange(2 * count) % count, np.r_[1 : count + 1, -1 : count - 1] % count),
        ),
        shape=(count, count),
    )


def test_light_edges_are_cut():
    graph = ring(40)
    heavy = graph.multiply(100).tolil()
    for a, b in ((4, 5), (24, 25)):
        heavy[a, b] = heavy[b, a] = 1
    found = partition.partition(heavy.tocsr(), np.ones((40, 1), dtype=np.int32), 2, 0.02)
    assert len(set(found[5:25])) == 1 and len(set(found[[*range(25, 40), *range(5)]])) == 1
    assert found[0] != found[10]


def test_several_weights_are_balanced_at_once():
    """The second weight sits in one quarter of the ring."""
    weights = np.ones((80, 2), dtype=np.int32)
    weights[20:, 1] = 0
    found = partition.partition(ring(80), weights, 2, 0.02)
    np.testing.assert_array_equal(np.bincount(found), [40, 40])
    np.testing.assert_array_equal(np.bincount(found[:20]), [10, 10])


def test_without_metis(monkeypatch):
    monkeypatch.setattr(partition, "_LIBRARY", "no-such-library.so")
    monkeypatch.setattr(partition.ctypes.util, "find_library", lambda name: None)
    partition._library.cache_clear()
    try:
        assert not partition.metis_is_available()
        with pytest.raises(partition.PartitionError, match="not installed"):
            partition.partition(ring(4), np.ones((4, 1), dtype=np.int32), 2, 0.02)
    finally:
        partition._library.cache_clear()


def test_a_graph_that_metis_refuses():
    with pytest.raises(partition.PartitionError, match="error -2 for 4 cells in 0 parts"):
        partition.partition(ring(4), np.ones((4, 1), dtype=np.int32), 0, 0.02)
