"""The linear solvers agree, and the Krylov one knows how bodies move as rigid ones."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI

from app.case import Case
from app.linear_solver import DIRECT, DIRECT_LIMIT, KRYLOV, linear_options, rigid_modes
from app.model import build_model
from app.simulation import Observer, Simulation
from tests.app.conftest import BLOCK


def test_rigid_modes_strain_nothing():
    rng = np.random.default_rng(1)
    for dim, count in ((2, 3), (3, 6)):
        position = rng.normal(size=(40, dim))
        modes = rigid_modes(position)
        assert modes.shape == (count, 40, dim)
        assert np.linalg.matrix_rank(modes.reshape(count, -1)) == count
        for mode in modes:
            # Of a motion u(x) = a + G x only the skew part of G may be there.
            gradient, *_ = np.linalg.lstsq(position - position[0], mode - mode[0], rcond=None)
            np.testing.assert_allclose(gradient + gradient.T, 0.0, atol=1e-12)


def simulated(linear):
    data = tomllib.loads(BLOCK)
    data["solver"] = {"linear": linear, "tolerance": 1e-10}
    sim = Simulation(build_model(Case.model_validate(data), MPI.COMM_SELF))

    sim.run(Observer())
    return sim


def test_krylov_and_direct_agree():
    direct, krylov = simulated("direct"), simulated("krylov")
    assert direct.stepper.solver.direct and not krylov.stepper.solver.direct
    assert krylov.stepper.snes.getKSP().getPC().getType() == "gamg"
    for a, b in zip(direct.rows, krylov.rows, strict=True):
        assert b.normal_force == pytest.approx(a.normal_force, rel=1e-8)
        assert b.tangential_force == pytest.approx(a.tangential_force, rel=1e-7, abs=1e-9)
    # An inexact solve costs Newton's method little: its tolerance is below what a step gains.
    spent = [sum(row.newton_iterations for row in sim.rows) for sim in (direct, krylov)]
    assert spent[1] <= spent[0] + 2 * len(direct.rows)


BOXES = """
[geometry]
kind = "two-boxes"
upper = { width = "1 mm", height = "0.5 mm", depth = "1 mm", elements = [4, 2, 4] }
lower = { width = "1.5 mm", height = "0.5 mm", depth = "1.5 mm", elements = [6, 2, 6] }
[bodies.elastomer]
material = "neo-hookean"
E = "5 MPa"
nu = 0.49
[bodies.aluminium]
material = "neo-hookean"
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
displacement = { x = [["1 s", "0 mm"], ["2 s", "0.1 mm"]], z = 0 }
platen = { direction = "y", pressure = [["0 s", "0 MPa"], ["1 s", "0.4 MPa"]] }
[[stage]]
name = "press"
duration = "1 s"
steps = 2
[[stage]]
name = "slide"
duration = "1 s"
steps = 1
"""


def test_nearly_incompressible_in_space_with_friction_and_a_platen():
    """The multigrid neither breaks down nor creeps: the force is right, and no step is cut."""
    data = tomllib.loads(BOXES)
    data["solver"] = {"linear": "direct"}
    direct = Simulation(build_model(Case.model_validate(data), MPI.COMM_SELF))
    data["solver"] = {"linear": "krylov"}
    sim = Simulation(build_model(Case.model_validate(data), MPI.COMM_SELF))
    counts = []

    def count(ksp, iteration, norm):
        counts.append(iteration)

    sim.stepper.solver.ksp.setMonitor(count)

    sim.run(Observer())
    direct.run(Observer())
    assert [row.attempts for row in sim.rows] == [1, 1, 1]
    assert 5 < max(counts) < 60
    assert sim.rows[-1].normal_force == pytest.approx(0.4, rel=1e-4)
    for a, b in zip(sim.rows, direct.rows, strict=True):
        assert a.tangential_force == pytest.approx(b.tangential_force, rel=1e-5, abs=1e-8)


def test_auto_factorises_up_to_a_number_of_unknowns():
    class Size:
        def __init__(self, size, dim):
            self.size, self.dim = size, dim

    for dim, limit in DIRECT_LIMIT.items():
        assert linear_options(Size(limit, dim), "auto") == DIRECT
        assert linear_options(Size(limit + 1, dim), "auto") == KRYLOV
        assert linear_options(Size(limit + 1, dim), "direct") == DIRECT
        assert linear_options(Size(1, dim), "krylov") == KRYLOV
