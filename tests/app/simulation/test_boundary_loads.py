"""Loads, foundations and supports that come and go, against closed forms."""

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from scipy.optimize import fsolve

from tests.two_blocks import two_blocks
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

E, NU, WIDTH, HEIGHT, THICKNESS = 5e6, 0.4, 1e-3, 0.5e-3, 2e-3
G, LAMBDA = E / (2.0 * (1.0 + NU)), E * NU / ((1.0 + NU) * (1.0 - 2.0 * NU))
HELD = {"surface": "top", "displacement": {"y": 0}}
SIDE = {"surface": "elastomer_left", "symmetry": True}
BOTTOM = "elastomer_contact"


def case(boundaries: list[dict], stages: list[dict] | None = None, **parts: Any) -> Case:
    """The upper of two blocks, far from the other, under these boundaries."""
    body = {"material": "neo-hookean", "E": E, "nu": NU, "density": 2000.0, "formulation": "q1"}
    data = two_blocks(
        ((WIDTH, HEIGHT, [4, 3]), (2e-3, 0.5e-3, [2, 1])),
        (body, body),
        {"friction": {"law": "frictionless"}},
        boundaries,
        stages or [{"name": "load", "duration": 1.0, "steps": 1}],
        {"thickness": THICKNESS, "gap": 5e-3},
        solver={"tolerance": 1e-11},
    )
    return Case.model_validate(data | parts)


def run(*arguments: Any, **parts: Any) -> Simulation:
    """A finished run of :func:`case`."""
    simulation = Simulation(build_model(case(*arguments, **parts), MPI.COMM_WORLD))
    simulation.run(Observer())
    return simulation


def of_surface(simulation: Simulation, name: str, column: str) -> np.ndarray:
    return simulation.state.motion.of_surface(name, column)


def stretches(traction: float) -> np.ndarray:
    """λ₁, λ₂ of a plane-strain block under a nominal stress along y, free along x."""

    def forces(stretch: np.ndarray) -> np.ndarray:
        rest = G * (stretch - 1.0 / stretch) + LAMBDA * np.log(stretch.prod()) / stretch
        return np.asarray(rest - [0.0, traction]) / G

    return np.asarray(fsolve(forces, [1.0, 1.0], xtol=1e-14))


def corner(simulation: Simulation, x: float, y: float) -> np.ndarray:
    """Displacement of the upper block's node at an undeformed place over its lower left corner."""
    problem = simulation.model.problem
    places = problem.space.tabulate_dof_coordinates()[:, :2]
    upper = places[problem.space.dofmap.list[simulation.model.named.cells("elastomer")]]
    low = upper.reshape(-1, 2).min(axis=0)
    node = int(np.argmin(np.linalg.norm(places - low - [x, y], axis=1)))
    return np.asarray(problem.u.x.array.reshape(-1, 2)[node])


def test_a_traction_stretches_a_block_as_the_closed_form_says_and_a_force_does_the_same():
    pull = 1e6
    total = pull * WIDTH * THICKNESS
    loads = ({"traction": {"y": -pull}}, {"force": {"y": -total}})
    runs = [run([HELD, SIDE, {"surface": BOTTOM, **load}]) for load in loads]
    across, along = stretches(pull)
    moved = WIDTH * (across - 1.0), HEIGHT * (1.0 - along)
    for simulation in runs:
        assert corner(simulation, WIDTH, 0.0) == pytest.approx(moved, rel=1e-9)
        assert of_surface(simulation, "top", "force_y")[-1] == pytest.approx(total, rel=1e-9)
        assert of_surface(simulation, BOTTOM, "force_y")[-1] == pytest.approx(-total, rel=1e-9)


def test_a_column_under_its_weight():
    """Nominal stress ρ g h at every element's middle, and the whole weight at the support."""
    weight = 2000.0 * 1e5 * HEIGHT  # N/m², under a hundred thousand m/s²
    walls = [{"surface": f"elastomer_{side}", "symmetry": True} for side in ("left", "right")]
    simulation = run([HELD, *walls], gravity={"y": [[0, 0], [1, -1e5]]})
    places = np.linspace(0.0, HEIGHT, 4)
    moved = np.array([corner(simulation, 0.0, y)[1] for y in places])
    stretch = 1.0 + np.diff(moved) / np.diff(places)
    stress = G * (stretch - 1.0 / stretch) + LAMBDA * np.log(stretch) / stretch
    middle = 0.5 * (places[1:] + places[:-1])
    assert stress == pytest.approx(weight * middle / HEIGHT, rel=1e-8)
    held = of_surface(simulation, "top", "force_y")[-1]
    assert held == pytest.approx(weight * WIDTH * THICKNESS, rel=1e-9)
    force = simulation.state.motion.of_body("elastomer", "boundary_force_y")
    assert abs(force[-1]) < 1e-9 * held  # the weight is among the forces of the boundaries
    assert abs(simulation.rows[-1].energy_error) < 0.02 * simulation.rows[-1].external_work


@pytest.mark.parametrize("stiffness", [1e8, 1e11])
def test_a_block_on_an_elastic_foundation(stiffness):
    """It sinks in by t/k_n, and goes where the base goes; nothing else holds it upright."""
    press, lift = 2e5, 0.1e-3
    walls = [{"surface": f"elastomer_{side}", "symmetry": True} for side in ("left", "right")]
    base = {"y": [["1 s", 0.0], ["2 s", lift]]}
    bed = {"surface": BOTTOM, "foundation": {"normal": stiffness, "base": base}}
    load = {"surface": "top", "traction": {"y": -press}}
    stages = [{"name": name, "duration": 1.0, "steps": 1} for name in ("press", "lift")]
    simulation = run([*walls, bed, load], stages)
    sunk = -press / stiffness
    found = of_surface(simulation, BOTTOM, "displacement_y")
    assert found == pytest.approx([sunk, sunk + lift], rel=1e-7)
    assert of_surface(simulation, BOTTOM, "force_y") == pytest.approx(press * WIDTH * THICKNESS)
    assert not any("only contact holds it" in note for note in simulation.model.notes)


def test_a_foundation_resists_shear_by_its_tangential_stiffness():
    bed = {"surface": BOTTOM, "foundation": {"normal": 1e12, "tangential": 2e9}}
    simulation = run([{**bed}, {"surface": "top", "traction": {"x": 1e3}}])
    # The mean displacement of the bottom: force over stiffness.
    assert of_surface(simulation, BOTTOM, "displacement_x")[-1] == pytest.approx(5e-7, rel=1e-8)


# -- stages ---------------------------------------------------------------------------------------

THREE = [{"name": name, "duration": 1.0, "steps": 2} for name in ("pull", "hold", "after")]


def test_a_platen_holds_the_force_that_its_displacement_led_to():
    platen = {
        "direction": "y",
        "displacement": [["0 s", 0.0], ["1 s", -0.1 * HEIGHT]],
        "displacement_stages": ["pull"],
        "hold_force": True,
    }
    side = {"surface": BOTTOM, "traction": {"x": [[1, 0], [3, 4e5]]}}
    glued = {"surface": BOTTOM, "displacement": {"y": 0}}
    left = {"surface": "top", "displacement": {"x": 0}, "platen": platen}
    simulation = run([glued, left, side], THREE)
    force, moved = (
        of_surface(simulation, "top", f"{what}_y") for what in ("force", "displacement")
    )
    assert force[1] > 1.0
    assert force[2:] == pytest.approx(force[1], rel=1e-9)
    assert moved[1] == pytest.approx(0.1 * HEIGHT, rel=1e-12)
    # The shear that comes meanwhile changes the length under the same force.
    assert abs(moved[-1] - moved[1]) > 1e-4 * HEIGHT


def test_loads_and_supports_act_in_their_stages_only():
    stop = {"surface": "elastomer_right", "displacement": {"x": 0}, "stages": ["hold"]}
    load = {"surface": BOTTOM, "traction": {"y": -1e6}, "stages": ["pull", "hold"]}
    simulation = run([HELD, SIDE, stop, load], THREE)
    across, along = stretches(1e6)
    height = of_surface(simulation, BOTTOM, "displacement_y")
    assert height[:2] == pytest.approx(HEIGHT * (1.0 - along), rel=1e-9)
    assert of_surface(simulation, "elastomer_right", "displacement_x")[:4] == pytest.approx(
        [WIDTH * (across - 1.0)] * 2 + [0.0] * 2, rel=1e-9, abs=1e-15
    )
    # Held back to its width, it is shorter; let go of and unloaded, it is as it was.
    assert abs(height[2]) < 0.95 * abs(height[1])
    held = of_surface(simulation, "elastomer_right", "force_x")
    assert held[2] > 0.1
    assert np.abs(held[[0, 1, 4, 5]]).max() < 1e-9 * held[2]
    assert np.abs(simulation.stepper.x.array_r).max() < 1e-10 * HEIGHT


def test_a_velocity_that_appears_goes_on_from_where_the_surface_is():
    load = {"surface": BOTTOM, "traction": {"y": -1e6}, "stages": ["pull"]}
    hold = {
        "surface": BOTTOM,
        "velocity": {"y": [[0, 1e-4], [1, 1e-4], [1.5, 0]]},
        "stages": ["hold"],
    }
    height = of_surface(run([HELD, SIDE, load, hold], THREE), BOTTOM, "displacement_y")
    _, along = stretches(1e6)
    start = HEIGHT * (1.0 - along)
    assert height[1] == pytest.approx(start, rel=1e-9)
    # The velocity falls from 0.1 mm/s to nothing within half a second of the stage.
    assert height[2:4] == pytest.approx(start + 0.25e-4, rel=1e-12)


def released(steps: int, **parts: Any) -> Simulation:
    stages = [
        {"name": "pull", "duration": 1.0, "steps": steps},
        {"name": "let go", "duration": 0.5, "steps": steps, "release": [BOTTOM]},
        {"name": "after", "duration": 1.0, "steps": 1},
    ]
    pulled = {
        "surface": BOTTOM,
        "displacement": {"x": [[0, 0], [1, 0.05 * WIDTH]], "y": [[0, 0], [1, -0.2 * HEIGHT]]},
    }
    glued = {"surface": "top", "displacement": {"x": 0, "y": 0}}
    return run([glued, pulled], stages, **parts)


def test_a_stretched_bar_that_is_released_is_free_of_stress():
    """In one step or in four: the same end; half way half of the reactions act."""
    simulation = released(4)
    force = of_surface(simulation, BOTTOM, "force_y")
    assert force[3] < -1.0
    assert force[4:] == pytest.approx(force[3] * np.array([0.75, 0.5, 0.25, 0.0, 0.0]), abs=1e-9)
    assert simulation.rows[-1].strain_energy < 1e-15 * simulation.rows[3].strain_energy
    assert np.abs(simulation.stepper.x.array_r).max() < 1e-8 * HEIGHT
    # The work is given back: the trapezoidal rule's error is all that is left.
    errors = [abs(released(n).rows[-1].external_work) for n in (4, 8)]
    assert errors[1] < 0.3 * errors[0]


def test_a_bar_that_is_let_go_at_both_ends_is_free_of_stress_and_stays_about_where_it_was():
    stages = [
        {"name": "pull", "duration": 1.0, "steps": 2},
        {"name": "let go", "duration": 1.0, "steps": 3, "release": ["top", BOTTOM]},
    ]
    pull = {"surface": BOTTOM, "displacement": {"x": 0, "y": [[0, 0], [1, -0.1 * HEIGHT]]}}
    glued = {"surface": "top", "displacement": {"x": 0, "y": 0}}
    simulation = run([glued, pull], stages)
    (note,) = [note for note in simulation.model.notes if note.startswith("stage")]
    assert note == (
        "stage let go: no boundary holds elastomer against moving in x, moving in y, turning about "
        "z; only contact does, and weak springs where it opens"
    )
    rows = simulation.rows
    assert rows[-1].strain_energy < 1e-12 * rows[1].strain_energy
    moved = of_surface(simulation, "top", "displacement_y")
    assert -0.1 * HEIGHT < moved[-1] < -0.01 * HEIGHT


# -- explicit dynamics ----------------------------------------------------------------------------


def test_explicit_dynamics_settles_where_the_implicit_solution_is():
    """A traction, weight, a total force and a foundation at once, with all kinds' resultants."""
    boundaries = [
        SIDE,
        {"surface": "top", "force": {"y": [[0, 0], [2e-5, -0.2]]}},
        {"surface": "elastomer_right", "traction": {"y": [[0, 0], [2e-5, 5e4]]}},
        {"surface": BOTTOM, "foundation": {"normal": 2e10, "tangential": 1e9}},
    ]
    gravity = {"y": [[0, 0], [2e-5, -5e4]]}
    stages = [{"name": "all", "duration": 4e-4, "steps": 4}]
    still = run(boundaries, stages, gravity=gravity)
    relaxing = [stages[0] | {"relax": True}]
    solver = {"kind": "explicit"}
    moving = run(boundaries, relaxing, gravity=gravity, solver=solver)
    for column, size in (("displacement_y", 1e-6), ("force_y", 0.1)):
        for name in ("top", BOTTOM, "elastomer_right"):
            expected = of_surface(still, name, column)[-1]
            assert of_surface(moving, name, column)[-1] == pytest.approx(expected, abs=2e-4 * size)
    assert abs(of_surface(still, BOTTOM, "displacement_y")[-1]) > 1e-6
    row = moving.rows[-1]
    assert abs(row.energy_error) < 1e-4 * abs(row.external_work)


def test_a_support_that_lets_go_in_explicit_dynamics_leaves_its_momentum():
    """A falling block that is caught in one stage and let go of again: forces are momentum."""
    catch = {"surface": "top", "velocity": {"y": 0}, "stages": ["catch"]}
    stages = [{"name": name, "duration": 2e-5, "steps": 1} for name in ("fall", "catch", "fall on")]
    simulation = run([catch], stages, gravity={"y": -1e4}, solver={"kind": "explicit"})
    forces = of_surface(simulation, "top", "force_y")
    mass = 2000.0 * WIDTH * HEIGHT * THICKNESS
    assert np.abs(forces[[0, 2]]).max() < 1e-9 * mass * 1e4
    assert forces[1] > 0.1 * mass * 1e4
    problem, stepper = simulation.model.problem, simulation.explicit.stepper
    block = np.unique(problem.space.dofmap.list[simulation.model.named.cells("elastomer")])
    carried = stepper.dynamics.mass * stepper.whole_step_velocity
    momentum = float(carried[2 * block + 1].sum()) * THICKNESS
    upwards = forces[1] * 2e-5
    # The mean force is that at the ends of steps: a step at either end of the stage is not exact.
    assert momentum == pytest.approx(upwards - mass * 1e4 * 6e-5, rel=5e-3)
    assert upwards > 0.3 * mass * 1e4 * 6e-5
