"""Stress output against linear elasticity at small strain and closed forms at large strain."""

from pathlib import Path

import adios2
import dolfinx
import numpy as np
import pytest

from tests.contact_boxes import Scene
from tests.grid import grid
from tribox.app.results.fields import StressField
from tribox.app.results.output_files import BpWriter
from tribox.forms.bodies.materials import Hencky, MooneyRivlin, NeoHookean, shear_and_bulk
from tribox.forms.bodies.solid import Solid
from tribox.forms.friction.coulomb import FrictionlessLaw

E, NU = 3.0e6, 0.4


def stretched(gradient: np.ndarray, material: object) -> StressField:
    """Stress of a square under the displacement gradient (2, 2)."""
    mesh = grid("quadrilateral", (2, 2))
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", 1, (2,))))
    u.interpolate(lambda x: gradient @ x[:2])
    cells = np.arange(4, dtype=np.int32)
    field = StressField(u, [Solid("body", u, cells, material, "q1-sri")])  # type: ignore[arg-type]
    field.update()
    return field


@pytest.mark.parametrize(
    "material",
    [
        NeoHookean(*shear_and_bulk(E, NU)),
        Hencky(*shear_and_bulk(E, NU)),
        MooneyRivlin(
            0.3 * shear_and_bulk(E, NU)[0], 0.2 * shear_and_bulk(E, NU)[0], shear_and_bulk(E, NU)[1]
        ),
    ],
    ids=lambda m: type(m).__name__,
)
def test_small_strain_is_linear_elasticity_with_its_out_of_plane_stress(material: object) -> None:
    gradient = 1e-6 * np.array([[1.0, 0.4], [0.2, -0.7]])
    strain = np.zeros((3, 3))
    strain[:2, :2] = 0.5 * (gradient + gradient.T)
    shear, bulk = shear_and_bulk(E, NU)
    trace = np.trace(strain)
    expected = 2.0 * shear * (strain - trace / 3.0 * np.eye(3)) + bulk * trace * np.eye(3)
    field = stretched(gradient, material)
    sigma = field.stress.x.array.reshape(-1, 3, 3)
    assert np.allclose(sigma, expected, atol=1e-5 * np.abs(expected).max())
    assert sigma[0, 2, 2] == pytest.approx(NU * (sigma[0, 0, 0] + sigma[0, 1, 1]), rel=1e-4)
    deviator = expected - np.trace(expected) / 3.0 * np.eye(3)
    assert field.von_mises.x.array == pytest.approx(np.sqrt(1.5 * np.sum(deviator**2)), rel=1e-4)
    assert field.pressure.x.array == pytest.approx(-bulk * trace, rel=1e-4)


def test_hencky_stress_at_large_strain_is_linear_in_logarithmic_strain() -> None:
    shear, bulk = shear_and_bulk(E, NU)
    stretch = np.array([1.5, 0.8, 1.0])
    logs = np.log(stretch)
    kirchhoff = 2.0 * shear * (logs - logs.mean()) + bulk * logs.sum()
    field = stretched(np.diag(stretch[:2] - 1.0), Hencky(shear, bulk))
    sigma = field.stress.x.array.reshape(-1, 3, 3)[0]
    assert np.diag(sigma) == pytest.approx(kirchhoff / stretch.prod(), rel=1e-10)
    assert np.abs(sigma - np.diag(np.diag(sigma))).max() < 1e-6 * np.abs(kirchhoff).max()


def strained(cell: str, gradient: np.ndarray, material: object, section: str, degree: int = 1):
    """Stress of two cells a side under the displacement gradient (i, i)."""
    mesh = grid(cell, (2, 2, 2) if section == "3D" else (2, 2))
    dim = mesh.geometry.dim
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", degree, (dim,))))
    u.name = "displacement"
    u.interpolate(lambda x: gradient @ x[:dim])
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    formulation = "q1" if degree == 1 else "q2"
    field = StressField(u, [Solid("body", u, cells, material, formulation, section=section)])  # type: ignore[arg-type]
    field.update()
    return u, field


def test_hencky_stress_in_space() -> None:
    """Kirchhoff stress 2 G dev ln V + K tr ln V, of a stretch turned and sheared at will."""
    shear, bulk = shear_and_bulk(E, NU)
    F = np.array([[1.2, 0.15, -0.1], [0.05, 0.9, 0.2], [0.1, -0.1, 1.1]])
    values, axes = np.linalg.eigh(F @ F.T)
    logs = 0.5 * np.log(values)
    kirchhoff = axes @ np.diag(2.0 * shear * (logs - logs.mean()) + bulk * logs.sum()) @ axes.T
    _, field = strained("hexahedron", F - np.eye(3), Hencky(shear, bulk), "3D")
    sigma = field.stress.x.array.reshape(-1, 3, 3)
    assert len(sigma) == 8
    expected = kirchhoff / np.linalg.det(F)
    assert sigma == pytest.approx(np.broadcast_to(expected, sigma.shape), rel=1e-7, abs=1.0)


def test_hoop_stress_of_a_ring() -> None:
    """A cylinder stretched evenly: the hoop stress is the radial one."""
    shear, bulk = shear_and_bulk(E, NU)
    gradient = np.diag([0.2, -0.1])
    _, field = strained("quadrilateral", gradient, Hencky(shear, bulk), "axisymmetric", degree=2)
    logs = np.log([1.2, 0.9, 1.2])
    kirchhoff = 2.0 * shear * (logs - logs.mean()) + bulk * logs.sum()
    sigma = field.stress.x.array.reshape(-1, 3, 3)
    expected = np.diag(kirchhoff / np.exp(logs.sum()))
    assert sigma == pytest.approx(np.broadcast_to(expected, sigma.shape), rel=1e-9, abs=1e-3)


@pytest.mark.parametrize("cell", ["tetrahedron", "quadrilateral"])
def test_files_of_second_order_displacements(cell: str, tmp_path: Path) -> None:
    section = "3D" if cell == "tetrahedron" else "axisymmetric"
    dim = 3 if section == "3D" else 2
    material = NeoHookean(*shear_and_bulk(E, NU))
    u, _ = strained(cell, 0.1 * np.eye(dim), material, section, degree=2)
    cells = np.arange(u.function_space.mesh.topology.index_map(dim).size_local, dtype=np.int32)
    solid = Solid("body", u, cells, material, "q2", section=section)  # type: ignore[arg-type]
    writer = BpWriter(u, [solid], tmp_path)
    writer.write(0.0)
    writer.close()
    with adios2.FileReader(str(tmp_path / "fields.bp")) as file:
        written = file.read("displacement", block_id=0).reshape(-1, 3)
        where = file.read("geometry", block_id=0).reshape(-1, 3)
    assert len(written) == len(u.x.array) // dim
    assert written == pytest.approx(0.1 * where, abs=1e-12)


@pytest.mark.parametrize("shape", ["Q4", "Q9", "tet4", "hex27"])
def test_contact_pressure_at_the_nodes_of_the_slave(shape: str, tmp_path: Path) -> None:
    """Linear between the vertices of a facet, at its inner nodes too; nothing elsewhere."""
    surface = Scene(shape, FrictionlessLaw(), fine=True).surface
    u = dolfinx.fem.Function(surface.space, name="displacement")
    writer = BpWriter(u, [], tmp_path, [surface, surface])
    slope = np.array([3.0, -2.0, 5.0])[: surface.dim]
    at_vertices = 1.0 + surface.vertices.position @ slope
    # Where both have a node the larger counts.
    writer.write(0.0, [at_vertices, 0.5 * at_vertices])
    writer.close()
    with adios2.FileReader(str(tmp_path / "fields.bp")) as file:
        written = file.read("contact_pressure", block_id=0).reshape(-1)
        where = file.read("geometry", block_id=0).reshape(-1, 3)[:, : surface.dim]
    nodes = np.unique(surface.slave.nodes)
    place = surface.space.tabulate_dof_coordinates()[nodes, : surface.dim]
    on = np.array([np.linalg.norm(place - x, axis=1).min() < 1e-12 for x in where])
    assert on.sum() == len(nodes)
    assert written[on] == pytest.approx(1.0 + where[on] @ slope, rel=1e-12)
    assert not written[~on].any()
