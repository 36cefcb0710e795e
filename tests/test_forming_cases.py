"""The forming cases of ``cases/forming`` in reduced form: each runs, and obeys what is known by hand.

Coarse meshes and few steps, so that forces are those of a coarse body; the pages in
``docs/forming`` have the numbers of the cases as they are.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from app.build.model import build_model
from app.case.reading import load_case
from app.results.recorder import force_balance
from app.simulation.energy_balance import energy_gap
from app.simulation.observer import Observer
from app.simulation.simulation import Simulation
from forms.bodies.hardening import Swift

CASES = Path(__file__).parents[1] / "cases" / "forming"


def reduced(name: str, **changes: str) -> Simulation:
    """A forming case with keys changed (two underscores for a dot), solved to its end.

    Its energies and forces add up, and none of its first three steps is cut.
    """
    overrides = [f"{key.replace('__', '.')}={value}" for key, value in changes.items()]
    case = load_case(CASES / f"{name}.toml", [*overrides, "output.figures=false"])
    simulation = Simulation(build_model(case, MPI.COMM_SELF))
    simulation.run(Observer())
    assert abs(energy_gap(simulation.rows)) < 1e-2
    assert force_balance(simulation) < 1e-8
    assert [row.attempts for row in simulation.rows[:3]] == [1, 1, 1]
    return simulation


def of_tool(simulation: Simulation, tool: str, column: str) -> np.ndarray:
    """History of a column of a tool."""
    columns = list(simulation.state.tools.columns)
    which, what = columns.index("tool"), columns.index(column)
    return np.array([row[what] for row in simulation.state.tools.rows if row[which] == tool])


def test_a_strip_drawn_through_a_die_takes_the_gap_and_the_work_of_its_flow():
    """The force is between homogeneous flow alone, and that with friction and the two shears.

    Slab: sigma = 2k (1 + B)/B (1 - r^B), B = mu cot(angle); the velocity turns by the angle, in
    the mean by half of it, where the strip enters and where it leaves: k angle more.
    """
    done = reduced(
        "ironing",
        geometry__blocks__strip__elements="[50, 3]",
        stage__0__steps="12",
        stage__1__steps="5",
        stage__2__duration='"5 s"',
        stage__2__steps="50",
        stage__3__steps="1",
        stage__3__duration='"0.05 s"',
    )
    steady = [number for number, row in enumerate(done.rows) if 3.5 < row.time < 5.5]
    pull = -of_tool(done, "die", "force_x")
    edge = done.state.motion.of_surface("strip_right", "force_x")
    np.testing.assert_allclose(edge, pull, atol=1e-6 * pull.max())
    thickness, exit_height, angle, mu = 50e-3, 0.8e-3, np.radians(10.0), 0.05
    strain = 2.0 / np.sqrt(3.0) * np.log(1.0 / 0.8)
    alpha = np.linspace(0.0, strain, 2001)
    mean = np.trapezoid(Swift(201.2e6, 0.002, 0.2545).stress(alpha), alpha) / strain
    double_shear, ratio = 2.0 / np.sqrt(3.0) * mean, mu / np.tan(angle)
    slab = double_shear * (1.0 + ratio) / ratio * (1.0 - 0.8**ratio)
    measured = pull[steady].mean() / (exit_height * thickness)
    assert slab < measured < 1.05 * (slab + 0.5 * double_shear * angle)
