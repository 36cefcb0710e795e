"""Nodal values of the contact: what they add up to, in the plane, in space and of two pairs."""

from __future__ import annotations

import tomllib

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.build.model import Model, build_model
from tribox.app.case.case import Case
from tribox.app.results.contact_points import ContactNodes, contact_arrays, contact_nodes
from tribox.app.results.output_files import ContactSeries
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

SPACE = """
[geometry]
kind = "two-boxes"
upper = { width = "1 mm", height = "0.5 mm", depth = "0.6 mm", elements = [3, 1, 2] }
lower = { width = "2 mm", height = "0.5 mm", depth = "1 mm", elements = [3, 1, 2] }
[bodies.elastomer]
material = "neo-hookean"
E = "5 MPa"
nu = 0.45
[bodies.aluminium]
material = "hencky"
E = "70 GPa"
nu = 0.33
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "coulomb", mu = 0.2 }
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0, z = 0 }
[[boundary]]
surface = "top"
[boundary.displacement]
x = [["0 s", 0], ["1 s", "0.02 mm"]]
y = [["0 s", 0], ["1 s", "-0.02 mm"]]
z = 0
[[stage]]
name = "press"
duration = "1 s"
steps = 2
"""


def solved(text: str, **contact: object) -> tuple[Simulation, ContactNodes]:
    data = tomllib.loads(text)
    data["contact"][0] |= contact
    simulation = Simulation(build_model(Case.model_validate(data), MPI.COMM_SELF))
    simulation.run(Observer())
    found = contact_nodes(simulation.model)
    assert found is not None
    return simulation, found


def own(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Places of the slave's nodes, reference and current, (n, i)."""
    problem = model.problem
    nodes = np.unique(problem.contacts[0].surface.slave.nodes)
    reference = problem.space.tabulate_dof_coordinates()[nodes, : problem.dim]
    return reference, reference + problem.u.x.array.reshape(-1, problem.dim)[nodes]


def matched(places: np.ndarray, among: np.ndarray) -> np.ndarray:
    apart = np.linalg.norm(places[:, None] - among[None], axis=2)
    assert apart.min(axis=1).max() < 1e-12
    return apart.argmin(axis=1)


@pytest.mark.parametrize("pressure", ["averaged", "pointwise"])
@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_forces_and_places_in_space(cell, pressure):
    """Areas times tractions are the forces of the history; vertices are where the body is."""
    text = SPACE.replace('"two-boxes"', f'"two-boxes"\ncell = "{cell}"')
    simulation, nodes = solved(text, pressure=pressure)
    values, row = nodes.values, simulation.rows[-1]
    assert values["area"].sum() == pytest.approx(0.6e-6)
    assert values["area"] @ values["pressure"] == pytest.approx(row.normal_force)
    friction = values["area"] @ values["friction_traction"]
    expected = [row.friction_x, row.friction_y, row.friction_z]
    assert friction == pytest.approx(expected, abs=1e-9 * row.normal_force)
    assert row.friction_x > 0.1 * row.normal_force
    lengths = np.linalg.norm(values["friction_traction"], axis=1)
    assert values["tangential_traction"] == pytest.approx(lengths)
    reference, current = own(simulation.model)
    at = matched(values["reference"], reference)
    assert values["position"] == pytest.approx(current[at], abs=1e-15)
    assert np.max(-values["gap"]) <= row.max_penetration * (1.0 + 1e-12)
    assert (np.max(-values["gap"]) == pytest.approx(row.max_penetration)) == (
        pressure == "averaged"
    )
    if pressure == "pointwise":
        mean = contact_arrays(simulation.model)["pressure"].mean()
        assert np.average(values["pressure"], weights=values["area"]) == pytest.approx(
            mean, rel=0.05
        )


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_facets_go_round(cell):
    """Their corners do not cross: the areas of the polygons add up to that of the surface."""
    text = SPACE.replace('"two-boxes"', f'"two-boxes"\ncell = "{cell}"')
    _, nodes = solved(text)
    assert (nodes.kind, len(nodes.facets)) == (("quad", 6) if cell[0] == "h" else ("triangle", 12))
    corners = nodes.values["reference"][nodes.facets][:, :, [0, 2]]
    following = np.roll(corners, -1, axis=1)
    cross = corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]
    area = 0.5 * np.abs(cross.sum(axis=1))
    np.testing.assert_allclose(area, 0.6e-6 / len(area), rtol=1e-10)


def test_pairs_follow_each_other(block, tmp_path):
    """The side of the upper body is a slave too, which nothing presses. Files hold both."""
    data = tomllib.loads(block)
    data["contact"].append({**data["contact"][0], "slave": "elastomer_left"})
    data["stage"] = data["stage"][:1]
    simulation = Simulation(build_model(Case.model_validate(data), MPI.COMM_SELF))
    simulation.run(Observer())
    nodes = contact_nodes(simulation.model)
    assert nodes is not None
    values = nodes.values
    assert values["pair"].tolist() == [0.0] * 11 + [1.0] * 6
    assert nodes.facets.tolist() == [[i, i + 1] for i in range(16) if i != 10]
    force = values["area"] * values["pressure"] * 1e-3
    assert force[:11].sum() == pytest.approx(simulation.rows[-1].normal_force, rel=1e-2)
    assert force[11:].sum() < 0.01 * force[:11].sum()
    ContactSeries(simulation.model, tmp_path).write(1, 1.0)
    read = meshio.read(tmp_path / "contact" / "000001.vtu")
    assert read.cell_data["pair"][0].tolist() == [0] * 10 + [1] * 5
    assert np.array_equal(read.cells_dict["line"], nodes.facets)
    np.testing.assert_array_equal(read.points[:, :2], values["position"])
    np.testing.assert_array_equal(read.point_data["pressure"], values["pressure"])
