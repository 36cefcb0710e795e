"""Parts with equal numbers of cells and of slave facets, and what touches in the same part."""

import dolfinx
import numpy as np
import pytest
from mpi4py import MPI

from tribox.geometry.compat import cell_nodes
from tribox.geometry.generators.two_blocks import Block, Box, TwoBlocks
from tribox.geometry.meshes.mesh import generate
from tribox.geometry.meshes.partition import share_out


def blocks(cell):
    """The upper block is off the middle of the lower one, whose surface is far wider."""
    return TwoBlocks(Block(1.0, 0.5, (24, 12)), Block(4.0, 0.5, (60, 10)), 2.8, cell=cell)


def boxes(cell):
    upper, lower = Box(1.0, 0.5, 1.0, elements=(8, 4, 8)), Box(3.0, 0.5, 1.5, elements=(18, 4, 9))
    return TwoBlocks(upper, lower, offset=(1.8, 0.3), cell=cell)


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
        self.bodies = [mesh.cells(name) for name in mesh.bodies]
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


@pytest.mark.parametrize("parts", [2, 3, 8])
def test_cells_of_each_body_are_shared_out_evenly(mesh, parts):
    """Bodies are solved for one after the other."""
    found = mesh.shared_out(parts)
    for body in mesh.bodies:
        shares = np.bincount(found[body], minlength=parts)
        assert shares.max() <= 1.1 * len(body) / parts


def test_many_small_bodies_are_shared_out_together():
    cells = np.arange(400).reshape(100, 4)
    position = np.repeat(np.arange(100.0)[:, None], 4, axis=0) * [1.0, 0.0]
    assert list(np.bincount(share_out(cells, position, [], 4))) == [25, 25, 25, 25]


def test_slave_facets_of_a_column_are_shared_out():
    """Cells alone are cut across the column, which leaves all slave facets to one part."""
    column = Parts(TwoBlocks(Block(1.0, 4.0, (8, 32)), Block(2.0, 0.5, (16, 4))))
    without, found = (
        np.bincount(column.shared_out(2, contacts)[column.behind[0]], minlength=2)
        for contacts in ([], None)
    )
    assert sorted(without) == [0, 8]
    assert list(found) == [4, 4]


@pytest.mark.parametrize("parts", [2, 4])
def test_facets_that_touch_are_mostly_in_one_part(mesh, parts):
    found = mesh.shared_out(parts)
    slaves, masters = (mesh.position[facets].mean(axis=1) for facets in mesh.facets)
    apart = np.linalg.norm(slaves[:, None] - masters[None], axis=2)
    beside = mesh.behind[1][np.argmin(apart, axis=1)]
    assert np.mean(found[mesh.behind[0]] == found[beside]) > 0.75


def test_each_contact_is_shared_out_for_itself(mesh):
    """Two pairs with a body in between: the second one's slaves are the first one's masters."""
    slave, master = mesh.facets
    found = mesh.shared_out(2, [(slave, master), (master, slave)])
    for behind in mesh.behind:
        shares = np.bincount(found[behind], minlength=2)
        assert shares.max() <= 0.54 * shares.sum()


def slaves_of_a_tool(comm, directory):
    """Slave facets that each rank owns, where the master is no surface of the mesh."""
    named = generate(SHAPES["quadrilateral"], comm, [("elastomer_contact", "punch")])
    owned = named.mesh.topology.index_map(1).size_local
    return comm.allgather(int(np.count_nonzero(named.facets("elastomer_contact") < owned)))


@pytest.mark.mpi(slaves_of_a_tool, 2)
def test_ranks_share_the_slave_of_a_tool(on_ranks):
    assert on_ranks(slaves_of_a_tool, 2) == [12, 12]


def test_more_parts_than_cells():
    """A part may be empty."""
    block = Block(1.0, 1.0, (2, 1))
    parts = Parts(TwoBlocks(block, block))
    for count in (4, 12):
        assert sorted(parts.shared_out(count)) == [0, 1, 2, 3]
