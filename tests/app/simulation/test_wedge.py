"""A sharp wedge in metal: its force is too large, or turned, and that is told."""

import json
import math

import numpy as np
import pytest
from mpi4py import MPI

from tests.solved import solved as run
from tribox.app.case.case import Case
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.run.run import run_case
from tribox.app.simulation.contact_warnings import ContactWarnings
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.surface_ends import slid_off

YIELD, DEEP, THICK = 100e6, 0.6e-3, 1e-3


def case(cells, **tool):
    """Half of a block that a frictionless wedge of 45 degrees to either side goes into."""
    hardening = {"law": "linear", "yield_stress": YIELD, "modulus": "1 MPa"}
    metal = {"material": "elastoplastic", "E": "70 GPa", "nu": 0.33, "hardening": hardening}
    spans = {"x": [0, "4 mm"], "y": ["-4 mm", 0], "elements": cells, "grading": [3, 1 / 3]}
    wedge = {"shape": "polyline", "points": [["9 mm", "9 mm"], [0, 0], ["-9 mm", "9 mm"]]}
    wedge["displacement"] = {"y": [[0.0, 0.0], [1.0, -DEEP]]}
    return {
        "geometry": {"kind": "blocks", "thickness": THICK, "blocks": {"metal": spans}},
        "bodies": {"metal": metal},
        "tools": {"wedge": wedge | tool},
        "contact": [{"slave": "metal_top", "master": "wedge", "friction": {"law": "frictionless"}}],
        "boundary": [
            {"surface": "metal_left", "symmetry": True},
            {"surface": "metal_bottom", "displacement": {"x": 0, "y": 0}},
        ],
        "stage": [{"name": "press", "duration": 1.0, "steps": 24}],
    }


class Watch(Observer):
    """Looks at every step, as the recorder does."""

    def __init__(self):
        self.warnings = None

    def step(self, state, row, result):
        self.warnings = self.warnings or ContactWarnings(state.model.problem)
        self.warnings.step(row, state.model.thickness)


def pressed(data):
    """Force on the tool, N, and the warnings."""
    watch = Watch()
    tools = run(data, observer=watch).state.tools
    last = dict(zip(tools.columns, tools.rows[-1], strict=True))
    return last["force_x"], last["force_y"], list(watch.warnings.warnings())


def hill():
    r"""Force on one face, N, in x as in y (Hill, Lee & Tupper 1947).

    With :math:`\cos(2\beta - \theta) = \cos\theta/(1 + \sin\theta)` the pressure is
    :math:`2k(1 + \theta)` over the length l, :math:`l(\cos\beta - \sin(\beta - \theta))`
    being the depth; here :math:`\beta = 45°`.
    """
    low, high = 0.0, math.pi / 4
    for _ in range(60):
        theta = 0.5 * (low + high)
        turned = math.cos(math.pi / 2 - theta) - math.cos(theta) / (1 + math.sin(theta))
        low, high = (theta, high) if turned < 0.0 else (low, theta)
    length = DEEP / (math.cos(math.pi / 4) - math.sin(math.pi / 4 - theta))
    return 2 / math.sqrt(3) * YIELD * (1 + theta) * length * math.cos(math.pi / 4) * THICK


def test_a_sharp_wedge_draws_out_a_facet_and_is_told_of():
    """The facet at its point spans its whole face, whatever the mesh: the force is too large."""
    across, up, warnings = pressed(case([24, 20]))
    assert 1.05 < up / hill() < 1.2 and 1.04 < -across / hill() < 1.2
    assert any("times its area" in line for line in warnings)


def test_a_sharp_wedge_on_few_facets_is_told_of():
    data = case([8, 8])
    data["bodies"]["metal"]["formulation"] = "q2"
    across, up, warnings = pressed(data)
    assert abs(up + across) > 0.03 * up
    assert any("off what the master's faces can be pressed with" in line for line in warnings)


@pytest.mark.parametrize(
    ("folded", "said"),
    [
        (True, "have turned away from wedge at (0.0003643, 0) m"),
        (False, "slide off the end of wedge at (-0.001, 0) m"),
    ],
)
def test_points_that_miss_a_face_are_not_said_to_be_past_its_end(folded, said):
    """A facet on its edge looks past the face beside it, which goes from its corner to -1 mm."""
    data = case([12, 10])
    data["tools"]["wedge"]["points"] = [["2 mm", "3 mm"], ["2 mm", 0], ["-1 mm", 0]]
    data["tools"]["wedge"]["displacement"] = {"y": [[0.0, 0.0], [1.0, -1e-6]]}
    data["stage"][0]["steps"] = 1
    simulation = run(data)
    problem, contacts = simulation.model.problem, simulation.model.case.contact
    assert not list(slid_off(problem, contacts))
    x, vertices = simulation.stepper.x.copy(), problem.contacts[0].surface.vertices
    if folded:  # beyond the two before it
        x.array[2 * vertices.nodes[np.argsort(vertices.position[:, 0])[3]]] -= 6e-4
    else:
        x.array[2 * vertices.nodes] -= 1.5e-3
    problem.residual(None, x, problem.new_vector(), StepMode.of_stage(1.0, problem.contacts, True))
    found = list(slid_off(problem, contacts))
    assert len(found) == 1 and said in found[0][0]


@pytest.mark.parametrize(("fillet", "warned"), [(0.0, True), ("2 mm", False)])
def test_work_at_a_sharp_corner_of_a_die_is_told_to_be_its(tmp_path, fillet, warned):
    """A billet that is pushed out of a channel into a wedge of 15 degrees, without friction."""
    data = case([15, 5])
    data["geometry"]["blocks"]["metal"] = {"x": ["-6 mm", 0], "y": [0, "2 mm"], "elements": [15, 5]}
    slope, high = math.tan(math.radians(15)), 2.02 if fillet else 2.0
    data["tools"]["wedge"] = {
        "shape": "polyline",
        "points": [["4 mm", f"{high - 4 * slope} mm"], [0, f"{high} mm"], ["-9 mm", f"{high} mm"]],
        "fillet_radius": fillet,
    }
    way = {"x": [[0.0, 0.0], [1.0, "2 mm"]]}
    data["boundary"] = [
        {"surface": "metal_bottom", "symmetry": True},
        {"surface": "metal_left", "displacement": way},
    ]
    data["stage"][0]["steps"] = 12
    data["output"] = {"figures": False}
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    found = [w for w in summary["warnings"] if "slides past sharp corners of wedge" in w]
    assert len(found) == warned
    assert (abs(summary["energy_error_relative"]) > 0.01) is warned
