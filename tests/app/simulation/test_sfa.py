"""cases/sfa.toml: steady points on the closed form, from almost dry to Newtonian."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.case.reading import load_case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation
from tribox.forms.closed_forms import (
    effective_viscosity,
    film_fraction,
    threshold_speed,
)
from tribox.forms.friction.parameters import FrictionMapParameters

CASE = Path(__file__).parents[3] / "cases" / "sfa.toml"
CLOSE = 5e-3  # agreement asked for between computed points and closed forms


@dataclass(frozen=True)
class Point:
    """One steady state of one film thickness."""

    thickness: float
    parameters: FrictionMapParameters
    row: dict

    @property
    def speed(self) -> float:
        return abs(self.row["velocity"])

    @property
    def viscosity(self) -> float:
        return self.row["effective_viscosity"]

    @property
    def star(self) -> float:
        return float(threshold_speed(self.thickness, self.parameters))

    @property
    def newtonian(self) -> bool:
        """Whether the film carries everything at every speed."""
        return self.thickness >= self.parameters.D_max

    @property
    def alpha(self) -> float:
        return float(film_fraction(self.speed, self.thickness, self.parameters))

    @property
    def in_transition(self) -> bool:
        width = 3.0 * self.parameters.transition_width * self.star
        return not self.newtonian and abs(self.speed - self.star) <= width

    @property
    def friction_share(self) -> float:
        """Share of the traction that friction, not the film, carries."""
        film = self.alpha * self.parameters.eta_b * self.speed / self.thickness
        return 1.0 - film * self.row["contact_area"] / abs(self.row["tangential_force"])

    def closed_form(self) -> float:
        pressure = self.row["normal_force"] / self.row["contact_area"]
        arguments = (self.speed, self.thickness, pressure, self.row["mu"], self.parameters)
        return float(effective_viscosity(*arguments))


class Ends(Observer):
    """Keeps the last row of each load step, and whether it was steady."""

    def __init__(self) -> None:
        self.found: list[tuple[dict, bool | None]] = []

    def load_step(self, simulation, load_step, row, steady) -> None:
        self.found.append((asdict(row), steady))


def slid(case: Case) -> list[Point]:
    """The points of one film: steady, under the load, with energies in balance."""
    simulation, ends = Simulation(build_model(case, MPI.COMM_SELF)), Ends()
    simulation.run(ends)
    (pressed, asked), *steps = ends.found
    assert asked is None and all(steady for _, steady in steps)
    load = pytest.approx(3e6 * 6e-3 * 1e-3, rel=1e-6)
    assert pressed["normal_force"] == load and all(row["normal_force"] == load for row, _ in steps)
    work = max(abs(row.external_work) for row in simulation.rows)
    assert max(abs(row.energy_error) for row in simulation.rows) <= 1e-3 * work
    assert np.all(np.diff([row.dissipation for row in simulation.rows]) >= 0.0)
    contact = case.contact[0]
    parameters = contact.friction.parameters()
    return [Point(contact.film.thickness, parameters, row) for row, _ in steps]


COARSE = ("geometry.upper.elements=[60, 2]", "geometry.lower.elements=[65, 4]", "stage.0.steps=2")
# Up to where the film drags as much as friction: the last of each is left out, being beyond.
VELOCITIES = {
    "thickness=10nm": "[1e-8, 1e-5, 1e-2]",
    "thickness=30nm": "[1e-8, 1e-5, 3e-4, 2e-3, 1.1e-2, 3e-2]",
    "thickness=250nm": "[1e-8, 9.3e-2, 1]",
}


@pytest.mark.parametrize("label", VELOCITIES)
def test_films_on_a_coarse_mesh_lie_on_the_closed_form(label):
    case = load_case(CASE, [*COARSE, f"stage.1.velocities={VELOCITIES[label]}"])
    found = slid(dict(case.sweep_cases())[label])
    assert len(found) == VELOCITIES[label].count(",")
    for p in found:
        assert not p.in_transition
        assert p.viscosity == pytest.approx(p.closed_form(), rel=CLOSE)
        assert p.row["contact_area"] == pytest.approx(6e-3 * 1e-3, rel=0.02)
    slow, fast = found[0], found[-1]
    if label == "thickness=10nm":  # almost Coulomb's: T/N is (1 - alpha) mu, and mu within 5 %
        ratio = slow.row["friction_coefficient"]
        assert ratio == pytest.approx((1.0 - slow.alpha) * slow.row["mu"], rel=CLOSE)
        assert ratio == pytest.approx(slow.row["mu"], rel=0.05) and slow.friction_share > 0.99
        return
    assert fast.viscosity == pytest.approx(fast.parameters.eta_b, rel=CLOSE)
    assert fast.row["viscous_fraction"] > 0.999
    if slow.newtonian:
        assert slow.viscosity == pytest.approx(slow.parameters.eta_b, rel=CLOSE)
    else:
        shares = [p.friction_share for p in found if p.speed < p.star]
        assert shares[0] > 0.99 and len(shares) == 3 and np.all(np.diff(shares) < 0.0)
