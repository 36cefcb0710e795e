"""Stress output against linear elasticity at small strain and closed forms at large strain."""

import csv

import dolfinx
import meshio
import numpy as np
import pytest

from tests.app.checkpoint.going_on import case_of, run
from tests.contact_boxes import Scene
from tests.flowing import soft_block
from tests.forms.bodies.in_forms import forms_of
from tests.grid import grid
from tribox.app.figures.body_shapes import read_bodies
from tribox.app.results.fields import ContactPressureField, StressField
from tribox.app.results.output_files import FieldSeries
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.hardening import Linear
from tribox.forms.bodies.memory_solid import make_solid
from tribox.forms.bodies.point_stress import triaxiality
from tribox.forms.friction.coulomb import FrictionlessLaw

E, NU = 3.0e6, 0.4


@pytest.mark.parametrize("shape", ["Q4", "Q9", "tet4", "hex27"])
def test_contact_pressure_at_the_nodes_of_the_slave(shape: str) -> None:
    """Linear between the vertices of a facet, at its inner nodes too; nothing elsewhere."""
    surface = Scene(shape, FrictionlessLaw(), fine=True).surface
    u = dolfinx.fem.Function(surface.space)
    slope = np.array([3.0, -2.0, 5.0])[: surface.dim]
    at_vertices = 1.0 + surface.vertices.position @ slope
    # Where both have a node the larger counts.
    found = ContactPressureField(u, [surface, surface]).at([at_vertices, 0.5 * at_vertices])
    nodes = np.unique(surface.slave.nodes)
    place = surface.space.tabulate_dof_coordinates()[:, : surface.dim]
    on = np.isin(np.arange(len(place)), nodes)
    assert found[on] == pytest.approx(1.0 + place[on] @ slope, rel=1e-12)
    assert len(found) == len(place) and not found[~on].any()


# -- What is written of bodies that flow: against values by hand and the forces on the body --------

G, K, Y, H = 1.0, 5.0, 0.02, 0.1


@pytest.mark.parametrize(
    ("cell", "section", "degree", "formulation"),
    [
        ("quadrilateral", "axisymmetric", 1, "q1-sri"),
        ("triangle", "axisymmetric", 2, "q2"),
        ("hexahedron", "3D", 1, "q1"),
    ],
)
def test_compression_between_smooth_plates(tmp_path, cell, section, degree, formulation):
    """Free to widen: α, σ_m/σ_vM = −1/3 and the strain of the height, of every cell."""
    dim = 3 if section == "3D" else 2
    mesh = grid(cell, (2,) * dim)
    u = dolfinx.fem.Function(dolfinx.fem.functionspace(mesh, ("Lagrange", degree, (dim,))))
    cells = np.arange(mesh.topology.index_map(dim).size_local, dtype=np.int32)
    material = ElastoPlastic(G, K, Linear(Y, H))
    solid = make_solid("billet", u, cells, material, formulation, section=section)
    series = FieldSeries(u, [solid], tmp_path)
    E, nu = 9.0 * K * G / (3.0 * K + G), (3.0 * K - 2.0 * G) / (2.0 * (3.0 * K + G))
    alpha = (0.3 - Y / E) / (1.0 + H / E)
    stress = Y + H * alpha
    across = nu * stress / E + 0.5 * alpha
    stretch = np.exp(np.where(np.arange(dim) == 1, -0.3, across))
    x = u.function_space.tabulate_dof_coordinates()[:, :dim]
    u.x.array[:] = (x * (stretch - 1.0)).reshape(-1)
    solid.evaluate(1.0)
    solid.commit()
    series.write(1, 1.0)
    data = {k: v[0] for k, v in meshio.read(tmp_path / "fields" / "000001.vtu").cell_data.items()}
    J = np.exp(2.0 * across - 0.3)
    hand = {
        "equivalent_plastic_strain": alpha,
        "triaxiality": -1.0 / 3.0,
        "thickness_strain": -0.3,
        "von_mises_stress": stress / J,
        "pressure": stress / J / 3.0,
    }
    for name, value in hand.items():
        # Rounded to single precision in the file.
        np.testing.assert_allclose(data[name], value, rtol=np.finfo(np.float32).eps)
    own = StressField(u, [solid]).evaluate()
    before = {
        "von_mises_stress": own.von_mises,
        "pressure": own.pressure,
        "equivalent_plastic_strain": own.plastic_strain,
    }
    for name, found in before.items():
        np.testing.assert_allclose(found, hand[name], rtol=1e-9)


def test_triaxiality_of_no_stress_is_nothing():
    stress = np.stack([np.zeros((3, 3)), -2.0 * np.eye(3), np.diag([3.0, 0.0, 0.0])])
    np.testing.assert_allclose(triaxiality(stress), [0.0, 0.0, 1.0 / 3.0])


@pytest.fixture(scope="module")
def pressed(tmp_path_factory):
    """A run with a metal that flows, and its directory."""
    directory = tmp_path_factory.mktemp("pressed")
    probes = [
        {"name": "upper", "body": "elastomer"},
        {"name": "lower", "body": "aluminium"},
        {"name": "inside", "point": ["1 mm", "-0.1 mm"]},
        {"name": "above", "point": ["1 mm", "0.3 mm"]},
    ]
    simulation = run(case_of(soft_block(probe=probes), fields_every=1), directory / "out")
    return simulation, directory / "out"


def table(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_mean_stress_is_the_moment_of_the_forces(pressed):
    """v σ̄ = Σ f ⊗ x over the nodal forces that strain the body, with its own points' stress."""
    simulation, directory = pressed
    problem = simulation.model.problem
    [solid] = [solid for solid in problem.solids if solid.flows]
    x = problem.space.tabulate_dof_coordinates()[:, :2] + problem.u.x.array.reshape(-1, 2)
    force = sum(dolfinx.fem.assemble_vector(part.residual).array for part in forms_of(solid))
    solid.add_point_forces(force)
    moment = 1e-3 * force.reshape(-1, 2).T @ x
    row = [r for r in table(directory / "body_probes.csv") if r["probe"] == "lower"][-1]
    found = np.array([float(row[f"cauchy_{ij}"]) for ij in ("xx", "yy", "xy")])
    mean = np.array([moment[0, 0], moment[1, 1], moment[0, 1]]) / float(row["volume"])
    np.testing.assert_allclose(found, mean, atol=1e-9 * np.abs(mean).max())
    strain = solid.plastic_strain()
    assert float(row["max_equivalent_plastic_strain"]) == strain.max() > 0.01
    assert float(row["equivalent_plastic_strain"]) == pytest.approx(strain.mean(), rel=1e-9)
    energies = [float(r["strain_energy"]) for r in table(directory / "body_probes.csv")[-2:]]
    assert sum(energies) == pytest.approx(simulation.rows[-1].strain_energy, rel=1e-9)


def test_tables_fields_and_figures_say_how_far_it_flowed(pressed):
    simulation, directory = pressed
    [solid] = [solid for solid in simulation.model.problem.solids if solid.flows]
    last = sorted((directory / "fields").iterdir())[-1]
    data = {k: v[0] for k, v in meshio.read(last).cell_data.items()}
    flowed = data["equivalent_plastic_strain"]
    lower = data["body"] == 1
    assert (flowed[~lower] == 0.0).all()
    np.testing.assert_allclose(
        np.sort(flowed[lower]), np.sort(solid.plastic_strain().mean(axis=1)), atol=1e-12
    )
    logs = np.linalg.eigvalsh(data["log_strain"].reshape(-1, 3, 3).astype(float))
    rounding = np.finfo(np.float32).eps * np.abs(logs).max()
    np.testing.assert_allclose(data["thickness_strain"], logs[:, 0], rtol=0, atol=2.0 * rounding)
    inside, above = table(directory / "probes.csv")[-2:]
    assert (inside["probe"], above["probe"]) == ("inside", "above")
    assert 0.0 < float(inside["equivalent_plastic_strain"]) <= flowed.max() * 1.5
    assert float(above["equivalent_plastic_strain"]) == 0.0
    row = table(directory / "history.csv")[-1]
    spent = simulation.model.problem.plastic_dissipation()[0] * 1e-3
    assert float(row["plastic_dissipation"]) == pytest.approx(spent, rel=1e-9)
    names = ["elastomer", "aluminium"]
    shown = read_bodies(meshio.read(last), names, "equivalent_plastic_strain")
    assert shown.field.unit == "" and shown.field.values.max() == flowed.max()
