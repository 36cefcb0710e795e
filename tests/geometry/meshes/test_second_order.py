"""Meshes of second-order cells: round bodies that are round."""

import dolfinx
import gmsh
import numpy as np
import pytest
from mpi4py import MPI

from tests.geometry.meshes.test_mesh import group, resultants, write_built
from tribox.geometry.meshes.foreign import read_msh
from tribox.geometry.meshes.gmsh_model import MeshError
from tribox.geometry.meshes.mesh import read
from tribox.geometry.meshes.places import nodes_of, places_in, shape_functions
from tribox.geometry.surfaces.surface import ContactSurface

CELLS = ("triangle", "quadrilateral", "tetrahedron", "hexahedron")


def round_body(cell, order, incomplete=0):
    """A disk, or in space a cylinder of height 1, of radius 1, of few cells."""
    occ, model = gmsh.model.occ, gmsh.model
    space = cell in CELLS[2:]
    disk = occ.addDisk(0, 0, 0, 1, 1)
    if space:
        structured = cell == "hexahedron"
        more = {"numElements": [1], "recombine": True} if structured else {}
        occ.extrude([(2, disk)], 0, 0, 1, **more)
    occ.synchronize()
    dim = 3 if space else 2
    group(dim, [t for _, t in model.getEntities(dim)], "round body")
    ends = [t for _, t in model.getEntities(dim - 1)]
    if space:
        ends = [t for t in ends if np.ptp(model.getBoundingBox(2, t)[2::3]) > 0.5]
    group(dim - 1, ends, "rim")
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.7)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.7)
    gmsh.option.setNumber("Mesh.ElementOrder", order)
    gmsh.option.setNumber("Mesh.SecondOrderIncomplete", incomplete)
    gmsh.option.setNumber("Mesh.RecombineAll", int(cell in ("quadrilateral", "hexahedron")))
    gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 2)  # quadrilaterals alone
    model.mesh.generate(dim)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Files by cell and order."""
    directory = tmp_path_factory.mktemp("round")

    def write(cell, order, incomplete=0):
        path = directory / f"{cell}{order}{incomplete}.msh"
        if not path.exists():
            write_built(lambda: round_body(cell, order, incomplete), path)
        return path

    return write


@pytest.mark.parametrize("cell", CELLS)
def test_round_bodies_are_round(written, cell):
    """Area and circumference: π and 2π; the error of parabolas is of fourth order."""
    first, second = (read(written(cell, order), MPI.COMM_SELF) for order in (1, 2))
    assert (first.order, second.order) == (1, 2)
    assert second.mesh.topology.cell_name() == cell
    true = {"round body": np.pi, "rim": 2.0 * np.pi}
    for name, value in true.items():
        errors = [abs(resultants(named)[name] / value - 1.0) for named in (first, second)]
        assert errors[1] < 2e-3 < 0.01 < errors[0]
    straight = read(written(cell, 2), MPI.COMM_SELF, straight=True)
    assert straight.order == 1
    assert resultants(straight) == pytest.approx(resultants(first), rel=1e-12)
    assert straight.mesh.geometry.index_map().size_global < 0.6 * (
        second.mesh.geometry.index_map().size_global
    )
    assert len(straight.notes) == 1 and not second.notes


@pytest.mark.parametrize("cell", CELLS)
def test_contact_points_lie_on_the_curve_and_weigh_what_it_measures(written, cell):
    named = read(written(cell, 2), MPI.COMM_SELF)
    dim = named.mesh.geometry.dim
    space = dolfinx.fem.functionspace(named.mesh, ("Lagrange", 2, (dim,)))
    rim = named.facets("rim")
    surface = ContactSurface(space, rim, rim, 5)
    slave, master = surface.slave, surface.master
    radius = np.linalg.norm(slave.position[:, :2], axis=1)
    assert np.abs(radius - 1.0).max() < 0.01  # corners alone: 0.06
    assert np.abs(np.linalg.norm(master.position[:, :2], axis=1) - 1.0).max() < 1e-9
    assert slave.weight.sum() == pytest.approx(resultants(named)["rim"], rel=1e-5)
    # Out of the master, on its side, along the radius.
    outside = slave.position * np.where(np.arange(dim) < 2, 1.05, 1.0)
    found = surface.project(outside, master.position)
    ring = outside[:, :2] / np.linalg.norm(outside[:, :2], axis=1)[:, None]
    assert (np.einsum("qi,qi->q", found.normal[:, :2], ring) > 0.995).all()
    assert found.gap == pytest.approx(0.05, abs=0.01)
    tangents = slave.tangents[:, :, :2]
    assert np.abs(np.einsum("qbi,qi->qb", tangents, ring)).max() < 0.08


@pytest.mark.parametrize("cell", CELLS)
def test_points_are_found_in_curved_cells(written, cell):
    named = read(written(cell, 2), MPI.COMM_SELF)
    mesh, dim = named.mesh, named.mesh.geometry.dim
    angle = np.linspace(0.0, 6.0, 25)
    points = 0.985 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle + 0.4], axis=1)[:, :dim]
    found = places_in(mesh, named.cells("round body"), points)
    assert set(found.point) == set(range(25))  # with straight edges some lie outside
    table = shape_functions(cell, 2, 0, found.xi)[0]
    back = np.einsum("ka,kai->ki", table, nodes_of(mesh, found.cell))
    assert back == pytest.approx(points[found.point], abs=1e-10)


def test_second_order_without_all_nodes_is_refused(written):
    for cell, number in (("quadrilateral", 8), ("hexahedron", 20)):
        with pytest.raises(MeshError, match=rf"{number}\).*Mesh.SecondOrderIncomplete = 0"):
            read_msh(written(cell, 2, incomplete=1))


def facts(comm, directory):
    """Of a curved mesh on some ranks."""
    path = directory / "round.msh"
    if comm.rank == 0:
        write_built(lambda: round_body("quadrilateral", 2), path)
    comm.barrier()
    named = read(path, comm, [("rim", "rim")])
    return {"measures": resultants(named), "count": named.cell_count}


@pytest.mark.mpi(facts, 3)
def test_ranks_agree_on_curved_cells(on_ranks):
    one, three = on_ranks(facts, 1), on_ranks(facts, 3)
    assert three["measures"] == pytest.approx(one["measures"], rel=1e-12)
    assert three["count"] == one["count"]
