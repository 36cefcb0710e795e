"""A coarse twin of cases/sfa.toml: two films, slow and fast, on the closed form."""

from dataclasses import asdict

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.simulation.test_sfa import CASE, CLOSE, Point
from tribox.app.build.model import build_model
from tribox.app.case.reading import load_case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

COARSE = ("geometry.upper.elements=[60, 2]", "geometry.lower.elements=[65, 4]", "stage.0.steps=2")
# Up to where the film drags as much as friction: the last of each is left out, being beyond.
VELOCITIES = {
    "thickness=30nm": "[1e-8, 1e-5, 3e-4, 2e-3, 1.1e-2, 3e-2]",
    "thickness=250nm": "[1e-8, 9.3e-2, 1]",
}


class Ends(Observer):
    """Keeps the last row of each load step, and whether it was steady."""

    def __init__(self) -> None:
        self.found: list[tuple[dict, bool | None]] = []

    def load_step(self, simulation, load_step, row, steady) -> None:
        self.found.append((asdict(row), steady))


@pytest.mark.parametrize("label", VELOCITIES)
def test_steady_points_lie_on_the_closed_form(label):
    case = load_case(CASE, [*COARSE, f"stage.1.velocities={VELOCITIES[label]}"])
    case = dict(case.sweep_cases())[label]
    simulation, ends = Simulation(build_model(case, MPI.COMM_SELF)), Ends()
    simulation.run(ends)
    (pressed, asked), *slid = ends.found
    assert asked is None and all(steady for _, steady in slid)
    assert pressed["normal_force"] == pytest.approx(3e6 * 6e-3 * 1e-3, rel=1e-6)

    contact = case.contact[0]
    thickness, parameters = contact.film.thickness, contact.friction.parameters()
    points = [Point(thickness, parameters, row) for row, _ in slid]
    assert len(points) == VELOCITIES[label].count(",")
    for p in points:
        assert not p.in_transition
        assert p.row["normal_force"] == pytest.approx(pressed["normal_force"], rel=1e-6)
        assert p.viscosity == pytest.approx(p.closed_form(), rel=CLOSE)
    slow, fast = points[0], points[-1]
    assert fast.viscosity == pytest.approx(parameters.eta_b, rel=CLOSE)
    assert fast.row["viscous_fraction"] > 0.999
    if slow.newtonian:
        assert slow.viscosity == pytest.approx(parameters.eta_b, rel=CLOSE)
    else:
        shares = [p.friction_share for p in points if p.speed < p.star]
        assert shares[0] > 0.99 and len(shares) == 3 and np.all(np.diff(shares) < 0.0)

    rows = simulation.rows
    work = max(abs(row.external_work) for row in rows)
    assert max(abs(row.energy_error) for row in rows) <= 1e-3 * work
    assert np.all(np.diff([row.dissipation for row in rows]) >= 0.0)
