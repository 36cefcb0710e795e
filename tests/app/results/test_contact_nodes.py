"""Nodal values of the contact: what they add up to, in the plane, in space and of two pairs."""

import tomllib
from pathlib import Path

import meshio
import numpy as np
import pytest
import pyvista

from tests.solved import solved
from tribox.app.build.model import Model
from tribox.app.results import vtu
from tribox.app.results.contact_points import contact_arrays, contact_nodes, slave_facets
from tribox.app.results.output_files import ContactSeries
from tribox.app.results.vtu import Cells, write_vtu
from tribox.app.simulation.simulation import Simulation

SPACE = """
[geometry]
kind = "two-boxes"
upper = { width = "1 mm", height = "0.5 mm", depth = "0.6 mm", elements = [3, 1, 2] }
lower = { width = "2 mm", height = "0.5 mm", depth = "1 mm", elements = [3, 1, 2] }
[bodies]
elastomer = { material = "neo-hookean", E = "5 MPa", nu = 0.45 }
aluminium = { material = "hencky", E = "70 GPa", nu = 0.33 }
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


def pressed(text: str, **contact: object) -> tuple[Simulation, dict[str, np.ndarray]]:
    data = tomllib.loads(text)
    data["contact"][0] |= contact
    simulation = solved(data)
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
    simulation, nodes = pressed(text, pressure=pressure)
    values, row = nodes, simulation.rows[-1]
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
    simulation, nodes = pressed(text)
    facets = slave_facets(simulation.model)
    assert (facets.kind, len(facets.nodes)) == (("quad", 6) if cell[0] == "h" else ("triangle", 12))
    corners = nodes["reference"][facets.nodes][:, :, [0, 2]]
    following = np.roll(corners, -1, axis=1)
    cross = corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]
    area = 0.5 * np.abs(cross.sum(axis=1))
    np.testing.assert_allclose(area, 0.6e-6 / len(area), rtol=1e-10)


def test_pairs_follow_each_other(block, tmp_path):
    """The side of the upper body is a slave too, which nothing presses. Files hold both."""
    data = tomllib.loads(block)
    data["contact"].append({**data["contact"][0], "slave": "elastomer_left"})
    data["stage"] = data["stage"][:1]
    simulation = solved(data)
    values = contact_nodes(simulation.model)
    assert values is not None
    assert values["pair"].tolist() == [0.0] * 11 + [1.0] * 6
    facets = slave_facets(simulation.model).nodes
    assert facets.tolist() == [[i, i + 1] for i in range(16) if i != 10]
    force = values["area"] * values["pressure"] * 1e-3
    assert force[:11].sum() == pytest.approx(simulation.rows[-1].normal_force, rel=1e-2)
    assert force[11:].sum() < 0.01 * force[:11].sum()
    ContactSeries(simulation.model, tmp_path).write(1, 1.0)
    read = meshio.read(tmp_path / "contact" / "000001.vtu")
    assert read.cell_data["pair"][0].tolist() == [0] * 10 + [1] * 5
    assert np.array_equal(read.cells_dict["line"], facets)
    np.testing.assert_array_equal(read.points[:, :2], values["position"])
    np.testing.assert_array_equal(read.point_data["pressure"], values["pressure"])


# -- VTU files as pyvista and meshio read them -----------------------------------------------------

TRIANGLE = 5


@pytest.fixture
def arrays(monkeypatch) -> dict:
    rng = np.random.default_rng(1)
    monkeypatch.setattr(vtu, "BLOCK", 1 << 15)
    count = vtu.BLOCK // 24 * 3 + 5  # more than three blocks, the last one not full
    return {
        "points": rng.random((count, 3)),
        "nodes": rng.integers(0, count, (4000, 3)),
        "point_data": {
            "vector": rng.random((count, 3)),
            "gap": np.where(rng.random(count) < 0.5, np.nan, -1e-300),
            "pair": rng.integers(0, 9, count).astype(np.int32),
        },
        "cell_data": {
            "tensor": rng.random((4000, 9)),
            "one": np.full((4000, 1), 3.0),
            "long": rng.integers(-(2**40), 2**40, 4000),
        },
    }


def write(path: Path, arrays: dict, time: float = 0.1 + 0.2, step: int = 7) -> None:
    cells = Cells.of_one_kind(arrays["nodes"], TRIANGLE)
    data = arrays["point_data"], arrays["cell_data"]
    write_vtu(path, arrays["points"], cells, *data, time, step)


def test_both_libraries_read_back_every_bit(tmp_path, arrays):
    path = tmp_path / "a.vtu"
    write(path, arrays)
    assert [p.name for p in tmp_path.iterdir()] == ["a.vtu"]
    grid, mesh = pyvista.read(path), meshio.read(path)
    np.testing.assert_array_equal(grid.points, arrays["points"])
    np.testing.assert_array_equal(mesh.points, arrays["points"])
    np.testing.assert_array_equal(grid.cells_dict[TRIANGLE], arrays["nodes"])
    np.testing.assert_array_equal(mesh.cells_dict["triangle"], arrays["nodes"])
    for name, values in arrays["point_data"].items():
        for found in (grid.point_data[name], mesh.point_data[name]):
            np.testing.assert_array_equal(found, values)
            assert found.dtype == values.dtype
    for name, values in arrays["cell_data"].items():
        for found in (grid.cell_data[name], mesh.cell_data[name][0]):
            np.testing.assert_array_equal(np.reshape(found, values.shape), values)
            assert found.dtype == values.dtype
    assert set(grid.array_names) == {
        *arrays["point_data"],
        *arrays["cell_data"],
        "TimeValue",
        "step",
    }
    for data in (grid.field_data, mesh.field_data):
        assert list(data["TimeValue"]) == [0.1 + 0.2] and list(data["step"]) == [7]


def test_vtk_knows_the_time_of_a_file(tmp_path, arrays):
    """As ParaView, which takes it from there where a file is opened without an index."""
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    write(tmp_path / "a.vtu", arrays, time=1.25e-7)
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "a.vtu"))
    reader.UpdateInformation()
    said = reader.GetOutputInformation(0)
    assert said.Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS()) == (1.25e-7,)


def test_a_file_that_cannot_be_finished_leaves_the_old_one(tmp_path, arrays):
    write(tmp_path / "a.vtu", arrays)
    before = (tmp_path / "a.vtu").read_bytes()
    arrays["cell_data"]["text"] = np.array(["a"])
    with pytest.raises(KeyError):
        write(tmp_path / "a.vtu", arrays)
    assert (tmp_path / "a.vtu").read_bytes() == before
