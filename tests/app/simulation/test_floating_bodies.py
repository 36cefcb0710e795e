"""Bodies that nothing holds any more: weak springs keep them, and the run says so."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.read_log import read_log
from tribox.app.case.case import Case
from tribox.app.errors import SolutionError
from tribox.app.run.run import run_case

UNLOAD = """
bodies.elastomer = { material = "neo-hookean", E = "5 MPa", nu = 0.45 }
bodies.aluminium = { material = "hencky", E = "70 MPa", nu = 0.33 }
stage = [
 { name = "press", duration = "1 s", steps = 2 },
 { name = "unload", duration = "2 s", steps = 4 },
]
[geometry]
kind = "two-blocks"
upper = { width = "2 mm", height = "1 mm", elements = [4, 2] }
lower = { width = "4 mm", height = "1 mm", elements = [6, 2] }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "coulomb", mu = 0.3 }
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0 }
[[boundary]]
surface = "top"
platen = { direction = "y", pressure = [["0 s", "0 MPa"], ["1 s", "1 MPa"], ["2 s", "0 MPa"]] }
"""


def run(tmp_path, **changed):
    """The rows, the log and the final displacement of the upper body's nodes (n, i), m."""
    data = tomllib.loads(UNLOAD)
    for boundary in changed.get("boundaries", ()):
        data["boundary"].append(boundary)
    case = Case.model_validate(data)
    simulation = run_case(case, tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    model = simulation.model
    nodes = np.unique(model.problem.space.dofmap.list[model.named.cells("elastomer")])
    u = model.problem.u.x.array.reshape(-1, model.problem.dim)[nodes]
    return simulation.rows, read_log(tmp_path / "out"), u


@pytest.fixture(scope="module")
def unloaded(tmp_path_factory):
    """The run in which the load goes back to zero."""
    return run(tmp_path_factory.mktemp("unloaded"))


def test_an_unloaded_body_is_stress_free_and_stays_where_it_was(unloaded):
    rows, _, u = unloaded
    pressed = max(row.strain_energy for row in rows)
    assert rows[-1].strain_energy < 1e-9 * pressed
    # Turned and moved as a whole, by less than it was pressed.
    assert np.abs(u - u.mean(axis=0)).max() < 1e-4 * 2e-4
    assert np.abs(u).max() < 2e-4


def test_the_force_of_the_springs_fades(unloaded):
    rows, log, _ = unloaded
    assert "body elastomer floats in 3 steps (first at time 2 s, stage unload)" in log
    assert all(row.normal_force <= 1e-6 * rows[1].normal_force for row in rows[3:])
    assert rows[-1].normal_force < rows[3].normal_force


def test_a_load_that_nothing_balances_is_not_held_by_weak_springs(tmp_path):
    away = {"surface": "elastomer_left", "pressure": [["2 s", "0 Pa"], ["2.5 s", "0.01 MPa"]]}
    with pytest.raises(SolutionError, match="elastomer"):
        run(tmp_path, boundaries=[away])
