"""The sphere on a block: twisted in space, and the pressures of its section of revolution."""

import tomllib

import numpy as np
import pytest

from tests.solved import built, solved
from tribox.app.results.contact_points import contact_nodes
from tribox.app.simulation.run_state import Observer

SPHERE = """
bodies.elastomer = { material = "neo-hookean", E = "5 MPa", nu = 0.3 }
bodies.aluminium = { material = "hencky", E = "50 GPa", nu = 0.3 }
boundary = [
 { surface = "bottom", displacement = { x = 0, y = 0 } },
 { surface = "top", displacement = { x = 0, y = [["0 s", "0 mm"], ["1 s", "-0.06 mm"]] } },
]
stage = [{ name = "press", duration = "1 s", steps = 2 }]
[geometry]
kind = "sphere-on-block"
sphere = { radius = "10 mm" }
block = { radius = "10 mm", height = "10 mm" }
contact_width = "2 mm"
contact_size = "0.2 mm"
growth = 1.6
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "frictionless" }
"""


def test_sphere_pressed_and_twisted():
    """Stuck but for its rim and turned: the torque follows the angle, force and height stay.

    Stuck all over it would be 16/3 G a³ θ (Reissner and Sagoci); there are two facets over a.
    """
    data = tomllib.loads(SPHERE)
    data["geometry"]["part"] = "full"
    data["contact"][0]["friction"] = {"law": "coulomb", "mu": 2.0}
    data["boundary"][0]["displacement"]["z"] = 0
    data["boundary"][1] = {
        "surface": "top",
        "displacement": {"y": [["0 s", "0 mm"], ["1 s", "-0.06 mm"]]},
        "rotation": {"axis": "y", "angle": [["1 s", "0 deg"], ["2 s", "0.1 deg"]]},
    }
    data["geometry"] |= {"contact_size": "0.35 mm", "growth": 2.0}
    data["stage"].append({"name": "twist", "duration": "1 s", "steps": 2})
    simulation = built(data)
    torques = []

    class Torque(Observer):
        def step(self, simulation, row, result):
            problem = simulation.model.problem
            x = problem.space.tabulate_dof_coordinates()
            force = problem.unbalanced.reshape(-1, 3)
            held = x[:, 1] > 10e-3 - 1e-9
            torques.append(float(np.sum(x[held, 2] * force[held, 0] - x[held, 0] * force[held, 2])))

    simulation.run(Torque())
    rows = simulation.rows
    assert abs(torques[1]) < 1e-3 * torques[3]
    assert 0.0 < torques[2] < torques[3]
    assert torques[3] == pytest.approx(2.0 * torques[2], rel=0.15)
    assert rows[3].normal_force == pytest.approx(rows[1].normal_force, rel=1e-3)
    stuck = 16.0 / 3.0 * 5e6 / 2.6 * hertz(rows[1].normal_force)[0] ** 3 * np.radians(0.1)
    assert torques[3] == pytest.approx(stuck, rel=0.2)
    assert rows[3].external_work > rows[1].external_work


def hertz(force: float) -> tuple[float, float]:
    """Radius of the contact, m, and peak pressure, Pa, of Hertz at a force."""
    E = 1.0 / (0.91 / 5e6 + 0.91 / 50e9)
    a = (3.0 * force * 10e-3 / (4.0 * E)) ** (1.0 / 3.0)
    return float(a), float(3.0 * force / (2.0 * np.pi * a**2))


def means_of_hertz(r: np.ndarray, a: float, peak: float) -> np.ndarray:
    """Hertz's pressure in the mean over the area of each node of a section, at radii r (v,)."""
    fine = np.linspace(0.0, r.max(), 40_001)
    shapes = np.array([np.interp(fine, np.sort(r), row) for row in np.eye(len(r))[np.argsort(r)].T])
    pressure = peak * np.sqrt(np.maximum(1.0 - (fine / a) ** 2, 0.0))
    return shapes @ (fine * pressure) / (shapes @ fine)


def test_nodal_pressure_under_the_sphere_is_hertz():
    """Of the force found, at all nodes in the contact but that on the axis."""
    data = tomllib.loads(SPHERE)
    data["geometry"] |= {"part": "axisymmetric", "contact_size": "0.1 mm"}
    ring = solved(data)
    found = contact_nodes(ring.model)
    assert found is not None
    r, pressure = found["position"][:, 0], found["pressure"]
    a, peak = hertz(ring.rows[-1].normal_force)
    inside = (r > 0.05e-3) & (r < a - 0.05e-3)
    assert inside.sum() >= 7
    expected = means_of_hertz(r, a, peak)[inside]
    np.testing.assert_allclose(pressure[inside], expected, rtol=0.0, atol=0.02 * peak)
    # Rings of the sections' areas carry the force.
    carried = float(found["area"] @ pressure)
    assert carried == pytest.approx(ring.rows[-1].normal_force, rel=1e-3)
