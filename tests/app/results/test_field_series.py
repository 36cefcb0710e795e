"""Fields of the bodies as pyvista and meshio read them: hand values, volumes, nodes, ranks."""

import hashlib
from pathlib import Path

import dolfinx
import meshio
import numpy as np
import pytest
import pyvista
from mpi4py import MPI
from vtkmodules.vtkCommonCore import reference as reference_to

from tests.grid import grid
from tribox.app.results.fields import StressField
from tribox.app.results.output_files import FieldSeries
from tribox.forms.bodies.materials import NeoHookean
from tribox.forms.bodies.solid import Solid
from tribox.geometry.generators.two_blocks import Block, Box, TwoBlocks
from tribox.geometry.meshes.mesh import generate

G, K = 2.0e6, 5.0e6
MATERIAL = NeoHookean(G, K)
# Cell, degree, section; name in meshio.
KINDS = [
    ("quadrilateral", 1, "plane-strain", "quad"), ("triangle", 1, "plane-strain", "triangle"),
    ("quadrilateral", 1, "axisymmetric", "quad"), ("hexahedron", 1, "3D", "hexahedron"),
    ("tetrahedron", 1, "3D", "tetra"), ("quadrilateral", 2, "axisymmetric", "quad9"),
    ("triangle", 2, "plane-strain", "triangle6"), ("hexahedron", 2, "3D", "hexahedron27"),
    ("tetrahedron", 2, "3D", "tetra10"),
]  # fmt: skip
TURNED = np.array([[1.1, 0.3, -0.2], [-0.1, 0.9, 0.25], [0.2, -0.15, 0.8]])


def displacement(mesh: dolfinx.mesh.Mesh, degree: int, of_place) -> dolfinx.fem.Function:
    dim = mesh.geometry.dim
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", degree, (dim,))))
    u.name = "displacement"
    u.interpolate(of_place)
    return u


def halves(u: dolfinx.fem.Function, section: str) -> list[Solid]:
    """Two bodies: cells left and right of x = ½."""
    mesh = u.function_space.mesh
    cells = np.arange(mesh.topology.index_map(mesh.topology.dim).size_local, dtype=np.int32)
    right = dolfinx.mesh.compute_midpoints(mesh, mesh.topology.dim, cells)[:, 0] > 0.5
    formulation = "q2" if u.function_space.element.basix_element.degree == 2 else "q1"
    return [
        Solid(name, u, of, MATERIAL, formulation, section=section)  # type: ignore[arg-type]
        for name, of in (("left", cells[~right]), ("right", cells[right]))
    ]


def written(path: Path, cell: str, degree: int, section: str, of_place):
    """The first file of a unit square or cube."""
    u = displacement(grid(cell, (2, 2, 2) if section == "3D" else (2, 2)), degree, of_place)
    FieldSeries(u, halves(u, section), path).write(4, 0.25)
    file = path / "fields" / "000004.vtu"
    return pyvista.read(file), meshio.read(file)


@pytest.mark.parametrize(("cell", "degree", "section", "name"), KINDS)
def test_homogeneous_deformation(tmp_path, cell, degree, section, name):
    """Every array against values by hand, F the same everywhere."""
    F = TURNED.copy()
    if section != "3D":
        F[2, :], F[:, 2] = 0.0, 0.0
        F[2, 2] = 1.0
    if section == "axisymmetric":
        F = np.diag([1.2, 0.7, 1.2])
    dim = 3 if section == "3D" else 2
    gradient = (F - np.eye(3))[:dim, :dim]
    grid_, mesh = written(tmp_path, cell, degree, section, lambda x: gradient @ x[:dim])
    [block] = mesh.cells
    assert block.type == name and len(block.data) == grid_.n_cells
    for points, data in ((grid_.points, grid_.point_data), (mesh.points, mesh.point_data)):
        place = points - data["displacement"]
        assert place.min(axis=0) == pytest.approx(0.0, abs=1e-15)
        assert place.max(axis=0)[:dim] == pytest.approx(1.0)
        np.testing.assert_allclose(points, place @ F.T, atol=1e-14)
    J, b = np.linalg.det(F), F @ F.T
    stress = (G * (b - np.eye(3)) + (K - 2.0 / 3.0 * G) * np.log(J) * np.eye(3)) / J
    squares, axes = np.linalg.eigh(b)
    logs = axes @ np.diag(0.5 * np.log(squares)) @ axes.T
    pressure = -np.trace(stress) / 3.0
    deviator = stress + pressure * np.eye(3)
    hand = {
        "cauchy_stress": stress.reshape(-1),
        "von_mises_stress": np.sqrt(1.5 * np.sum(deviator**2)),
        "pressure": pressure,
        "J": J,
        "max_stretch": np.sqrt(squares[-1]),
        "log_strain": logs.reshape(-1),
    }
    assert set(mesh.cell_data) == {*hand, "body"} == set(grid_.cell_data.keys())
    for array, value in hand.items():
        for found in (grid_.cell_data[array], mesh.cell_data[array][0]):
            close_to_hand(found, value)
            assert (found.dtype == np.float64) == (array in ("J", "max_stretch"))
    u = displacement(grid(cell, (2,) * dim), degree, lambda x: gradient @ x[:dim])
    own = StressField(u, halves(u, section)).evaluate()
    before = [own.stress, own.von_mises, own.pressure, own.strain.log_strain]
    names = ("cauchy_stress", "von_mises_stress", "pressure", "log_strain")
    for array, found in zip(names, before, strict=True):  # before they are rounded for the file
        close_to_hand(found.reshape(-1, *np.shape(hand[array])), hand[array])


def close_to_hand(found: np.ndarray, value: np.ndarray) -> None:
    """As close as its digits let it be."""
    digits = np.finfo(found.dtype).eps if found.dtype == np.float32 else 0.0
    expected = np.broadcast_to(value, found.shape)
    atol = max(1e-9, digits) * np.max(np.abs(value))
    np.testing.assert_allclose(found, expected, rtol=max(1e-10, digits), atol=atol)


@pytest.mark.parametrize(("cell", "degree", "section", "name"), KINDS)
def test_volumes_and_bodies(tmp_path, cell, degree, section, name):
    """VTK's volumes of the deformed cells are ∫ J dV; each cell knows its body."""
    dim = 3 if section == "3D" else 2

    def bent(x):
        # Cells stay parallelepipeds, each stretched in its own way.
        u = np.zeros((dim, x.shape[1]))
        u[0] = 0.2 * np.abs(x[0] - 0.5) + 0.1 * x[1]
        u[1] = -0.3 * np.abs(x[1] - 0.5)
        return u

    grid_, _ = written(tmp_path, cell, degree, section, bent)
    of = "Volume" if dim == 3 else "Area"
    if name == "hexahedron27":  # VTK 9.3 finds no volume of these; their sides are plane here
        corners = {pyvista.CellType.HEXAHEDRON: grid_.cells_dict[29][:, :8]}
        arrays, grid_ = grid_, pyvista.UnstructuredGrid(corners, grid_.points)
        grid_.point_data.update(arrays.point_data)
        grid_.cell_data.update(arrays.cell_data)
    deformed = np.asarray(grid_.compute_cell_sizes()[of])
    undeformed = grid_.copy()
    undeformed.points = grid_.points - grid_.point_data["displacement"]
    reference = np.asarray(undeformed.compute_cell_sizes()[of])
    assert reference.sum() == pytest.approx(1.0)
    J = np.asarray(grid_.cell_data["J"])
    if section == "axisymmetric":  # what remains in the plane without the hoop stretch
        J = J / np.exp(grid_.cell_data["log_strain"][:, 8])
    assert deformed == pytest.approx(J * reference, rel=1e-6)
    assert np.ptp(J) > 0.3
    middle = undeformed.cell_centers().points[:, 0]
    assert np.asarray(grid_.cell_data["body"]).tolist() == (middle > 0.5).astype(int).tolist()


@pytest.mark.parametrize(("cell", "degree", "section", "name"), [k for k in KINDS if k[1] == 2])
def test_mid_nodes_are_where_vtk_takes_them_to_be(tmp_path, cell, degree, section, name):
    """VTK interpolates a quadratic displacement exactly, at any place of its cells."""
    dim = 3 if section == "3D" else 2

    def quadratic(x):
        y = np.asarray(x)
        return np.array([0.1 * y[i] * y[(i + 1) % dim] + 0.05 * y[0] ** 2 for i in range(dim)])

    grid_, _ = written(tmp_path, cell, degree, section, quadratic)
    moved = grid_.point_data["displacement"]
    reference = grid_.points - moved
    rng = np.random.default_rng(2)
    for number in range(grid_.n_cells):
        vtk_cell = grid_.GetCell(number)
        nodes = [vtk_cell.GetPointId(i) for i in range(vtk_cell.GetNumberOfPoints())]
        at = rng.random(3) / 3.0
        weights, where = [0.0] * len(nodes), [0.0] * 3
        vtk_cell.EvaluateLocation(reference_to(0), at, where, weights)
        place, found = weights @ reference[nodes], weights @ moved[nodes]
        np.testing.assert_allclose(found[:dim], quadratic(place[:dim]), atol=1e-14)
        assert np.ptp(reference[nodes], axis=0)[:dim] == pytest.approx(0.5)


# -- ranks ----------------------------------------------------------------------------------------


def waves(x):
    dim = 3 if np.any(x[2]) else 2
    return np.array([0.1 * np.sin(3.0 * x[(i + 1) % dim] + i) for i in range(dim)])


def on_each(comm: MPI.Comm, directory: Path) -> dict:
    """Digests of all arrays but those of floats, these."""
    out = {}
    for cell, degree, section, _ in KINDS[-5:]:
        dim = 3 if section == "3D" else 2
        part = Box(1.0, 1.0, 1.0, elements=(3, 2, 2)) if dim == 3 else Block(1.0, 1.0, (4, 3))
        shape = TwoBlocks(part, part, cell=cell)
        named = generate(shape, comm, [("elastomer_contact", "aluminium_contact")])
        u = displacement(named.mesh, degree, waves)
        formulation = "q2" if degree == 2 else "q1"
        solids = [
            Solid(name, u, named.cells(name), MATERIAL, formulation, section=section)  # type: ignore[arg-type]
            for name in named.bodies
        ]
        where = directory / f"{cell}-{degree}"
        if comm.rank == 0:
            where.mkdir()
        comm.barrier()
        FieldSeries(u, solids, where).write(1, 1.0)
        if comm.rank == 0:
            out[where.name] = facts(where)
    return out


def facts(where: Path) -> dict:
    mesh = meshio.read(where / "fields" / "000001.vtu")
    cells = {name: values[0] for name, values in mesh.cell_data.items()}
    body = np.ascontiguousarray(cells.pop("body"))
    raw = [mesh.cells[0].data.tobytes(), body.tobytes()]
    return {
        "digests": [hashlib.sha256(data).hexdigest() for data in raw],
        "bodies": np.bincount(body).tolist(),
        "single": [name for name, values in cells.items() if values.dtype == np.float32],
        "floats": {
            "points": mesh.points.tolist(),
            **{name: values.tolist() for name, values in (mesh.point_data | cells).items()},
        },
    }


@pytest.mark.mpi(on_each, 3)
def test_files_do_not_depend_on_the_ranks(on_ranks):
    """The same cells and bodies to the bit; values but for the rounding of each cell's."""
    alone, found = on_ranks(on_each, 1), on_ranks(on_each, 3)
    assert alone.keys() == found.keys() and len(alone) == 5
    for kind, expected in alone.items():
        assert found[kind]["digests"] == expected["digests"], kind
        assert len(expected["bodies"]) == 2 and found[kind]["single"] == expected["single"]
        for name, values in expected["floats"].items():
            # The last digit of single precision may be rounded the other way.
            share = np.finfo(np.float32).eps if name in expected["single"] else 1e-14
            np.testing.assert_allclose(
                found[kind]["floats"][name],
                values,
                rtol=0,
                atol=share * np.abs(values).max(),
                err_msg=name,
            )
