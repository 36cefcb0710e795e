"""The picture of the deformed bodies: corners where the displacement puts them, in any element."""

from __future__ import annotations

import tomllib

import matplotlib.pyplot as plt
import numpy as np
import pytest
from mpi4py import MPI

from app.build.model import Model, build_model
from app.case.case import Case
from app.figures.deformed import _deformed_cells, _deformed_facets, _figure, draw_deformed
from app.results.contact_nodes import ContactNodes
from app.simulation.observer import Observer
from app.simulation.simulation import Simulation

CASE = """
[geometry]
kind = "two-boxes"
upper = { width = "1 mm", height = "0.5 mm", depth = "0.6 mm", elements = [2, 1, 2] }
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
displacement = { x = 0, z = 0, y = [["0 s", "0 mm"], ["1 s", "-0.02 mm"]] }
[[stage]]
name = "press"
duration = "1 s"
steps = 1
"""


def model(block: str, kind: str) -> Model:
    """A small case in space, or in the plane with second-order elements."""
    data = tomllib.loads(CASE if kind == "space" else block)
    if kind == "space":
        data["geometry"]["cell"] = "tetrahedron"
    else:
        data["bodies"]["elastomer"]["formulation"] = "q2"
    return build_model(Case.model_validate(data), MPI.COMM_SELF)


@pytest.mark.parametrize("kind", ["space", "plane"])
def test_corners_move_with_the_displacement(block, kind):
    made = model(block, kind)
    dim = made.problem.dim
    gradient = np.array([[0.1, 0.3, -0.2], [0.0, -0.2, 0.1], [0.2, 0.1, 0.3]])[:dim, :dim]
    before = (_deformed_facets if dim == 3 else _deformed_cells)(made)
    made.problem.u.interpolate(lambda x: gradient @ x[:dim])
    after = (_deformed_facets if dim == 3 else _deformed_cells)(made)
    for name, corners in before.items():
        assert corners.shape[2] == dim and len(corners) > 10
        np.testing.assert_allclose(after[name], corners + corners @ gradient.T, atol=1e-15)


def test_picture_in_space(block, tmp_path):
    simulation = Simulation(model(block, "space"))
    simulation.run(Observer())
    draw_deformed(simulation.model, tmp_path / "deformed.png")
    assert (tmp_path / "deformed.png").stat().st_size > 10_000


@pytest.mark.parametrize(("width", "height"), [(1.0, 3.0), (1.0, 0.6), (5.0, 1.0), (20.0, 1.0)])
def test_picture_shows_the_bodies_whole(width, height):
    """Neither tall nor long bodies are cut off at the edges of the frame."""
    corners = np.array([[0.0, -height], [width, -height], [width, 0.0], [0.0, 0.0]])[None]
    points = {
        "position": np.array([[0.0, 0.0], [width, 0.0]]),
        "pressure": np.array([1e6, 2e6]),
        "tangential_traction": np.zeros(2),
        "pair": np.zeros(2),
    }
    nodes = ContactNodes(points, np.array([[0, 1]]), "line")
    figure = _figure({"body": corners}, points, nodes, "title")
    figure.draw_without_rendering()
    (left, right), (low, high) = figure.axes[0].get_xlim(), figure.axes[0].get_ylim()
    plt.close(figure)
    assert left < 0.0 and right > 1e3 * width
    assert low < -1e3 * height and high > 0.0
