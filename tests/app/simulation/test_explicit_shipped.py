"""The explicit cases that are shipped."""

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from tribox.app.case.reading import load_case
from tribox.app.run.run import run_case
from tribox.forms.closed_forms import threshold_speed

CASES = Path(__file__).parents[3] / "cases"


def run(name: str, directory: Path, *overrides: str, label: str | None = None):
    case = load_case(CASES / name, overrides)
    if label is not None:
        case = dict(case.sweep_cases())[label]
    simulation = run_case(case, directory / "out", quiet=True, comm=MPI.COMM_SELF)
    return simulation, simulation.state.motion


def column(rows: list, name: str) -> np.ndarray:
    return np.array([row[name] if isinstance(row, dict) else getattr(row, name) for row in rows])


@pytest.mark.long
def test_stick_slip(tmp_path):
    """A lighter platen on a stiffer spring and a thinner layer: it slips in a third of the time."""
    quick = "boundary.1.spring.stiffness=80 N/mm", "boundary.1.spring.mass=0.25 g"
    thin = "geometry.upper.height=0.05 mm", "geometry.upper.elements=[16, 1]"
    more = "solver.damping=6000 1/s", "stage.1.velocity=4 mm/s", "stage.1.duration=3 ms"
    more += ("stage.1.steps=200",)
    simulation, motion = run("stick-slip.toml", tmp_path, *quick, *thin, *more)
    slid = np.array([row.stage != "press" for row in simulation.rows])
    force, speed = (motion.of_surface("top", f"{n}_x")[slid] for n in ("force", "velocity"))
    contact = simulation.model.case.contact[0]
    star = float(threshold_speed(30e-9, contact.friction.parameters()))
    # Stick up to (1 - alpha) mu N and the film's share, with a little vibration on top.
    dry = 0.95 * 0.2 * 1.0
    assert dry < force.max() < 1.1 * dry
    # Then the block leaps, several times faster than V*, and the spring goes slack.
    leap = int(np.argmax(speed))
    assert speed[leap] > 4.0 * star and force[leap] < 0.6 * force.max()
    assert force[leap:].min() < 0.0
    assert np.all(speed[: leap - 15] < star)
    # It sticks again and the spring is loaded once more.
    assert force[-1] > 0.0 and np.abs(speed[-20:]).max() < 1.5 * star
    assert column(simulation.rows, "viscous_fraction").max() == 1.0
    assert np.all(np.diff(column(simulation.rows, "dissipation")) >= 0.0)
    error = np.abs(column(simulation.rows, "energy_error")).max()
    assert error < 0.01 * column(simulation.rows, "external_work").max()
