"""A metal pressed by a round tool: frame, units, cut steps, ranks and the solver do not count."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.solved import solved as run
from tests.tool_cases import HEIGHT, block_mesh
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.app.simulation.simulation import Simulation

DEPTH, DRAG, RADIUS = 60e-6, 40e-6, 1.5e-3  # m
VOCE = {"law": "voce", "yield_stress": 60e6, "saturation_stress": 160e6, "exponent": 12}
STAGES = [
    {"name": "press", "duration": "1 s", "steps": 4},
    {"name": "drag", "duration": "1 s", "steps": 3},
]


def turned_mesh(path: Path, angle: float, metre: float = 1.0) -> Path:
    """The block, turned about the origin, with lengths in units of ``metre``."""
    lines = block_mesh(path).read_text().splitlines()
    c, s = np.cos(angle), np.sin(angle)
    first, last = lines.index("$Nodes") + 2, lines.index("$EndNodes")
    for k in range(first, last):
        number, x, y, _ = lines[k].split()
        at = np.array([float(x), float(y)]) / metre
        lines[k] = f"{number} {float(c * at[0] - s * at[1])!r} {float(s * at[0] + c * at[1])!r} 0"
    path.write_text("\n".join(lines) + "\n")
    return path


def pressed(path: Path, angle: float = 0.0, metre: float = 1.0, pascal: float = 1.0) -> dict:
    """A round tool pressed into the block and drawn along, all turned by an angle, rad."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def moved(x: float, y: float) -> list[float]:
        return [float(value) for value in turn @ np.array([x, y]) / metre]

    down, along = moved(0.0, -DEPTH), moved(DRAG, -DEPTH)
    hardening = VOCE | {key: VOCE[key] / pascal for key in ("yield_stress", "saturation_stress")}
    metal = {"material": "elastoplastic", "E": 70e9 / pascal, "nu": 0.33, "hardening": hardening}
    path_of = {
        key: [["0 s", 0.0], ["1 s", down[k]], ["2 s", along[k]]] for k, key in enumerate("xy")
    }
    punch = {"shape": "circle", "centre": moved(1.9e-3, HEIGHT + RADIUS), "radius": RADIUS / metre}
    return {
        "geometry": {"mesh": str(turned_mesh(path, angle, metre)), "thickness": 2e-3 / metre},
        "bodies": {"block": metal | {"density": 2700.0 * metre**2 / pascal}},
        "tools": {"punch": punch | {"displacement": path_of}},
        "contact": [{"slave": "top", "master": "punch", "friction": {"law": "coulomb", "mu": 0.1}}],
        "boundary": [{"surface": "bottom", "displacement": {"x": 0, "y": 0}}],
        "stage": [dict(stage) for stage in STAGES],
        "solver": {"tolerance": 1e-12},
    }


def forces(simulation: Simulation) -> np.ndarray:
    """Force on the block along x and y, N, and normal and tangential ones, after each step."""
    names = ("force_x", "force_y", "normal_force", "tangential_force")
    return np.array([[getattr(row, name) for name in names] for row in simulation.rows])


def points(simulation: Simulation) -> np.ndarray:
    """What the material points remember (k, s)."""
    (solid,) = simulation.model.problem.solids
    return np.array(solid.points.committed)


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Simulation:
    return run(pressed(tmp_path_factory.mktemp("still") / "block.msh"))


def test_the_metal_flows_far_and_the_tool_sticks_and_slips(still):
    strain = points(still)[:, -1]
    assert strain.max() > 0.05 and (strain == 0.0).any()
    sticking = [row.stick_fraction for row in still.rows]
    assert min(sticking) < 0.5 and forces(still)[-1, 3] != 0.0


def test_a_case_that_is_turned_gives_turned_forces(still, tmp_path):
    angle = np.deg2rad(30.0)
    found = run(pressed(tmp_path / "block.msh", angle))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    expected = forces(still)
    expected[:, :2] = expected[:, :2] @ turn.T
    scale = np.abs(expected).max()
    np.testing.assert_allclose(forces(found), expected, rtol=0, atol=1e-9 * scale)
    assert found.rows[-1].plastic_dissipation == pytest.approx(
        still.rows[-1].plastic_dissipation, rel=1e-9
    )
    np.testing.assert_allclose(
        np.sort(points(found)[:, -1]), np.sort(points(still)[:, -1]), rtol=0, atol=1e-9
    )


def test_numbers_in_millimetres_and_tonnes_give_the_same_forces(still, tmp_path):
    """Lengths in mm, stresses in MPa, densities in t/mm³: forces in N, energies in mJ."""
    found = run(pressed(tmp_path / "block.msh", metre=1e-3, pascal=1e6))
    expected = forces(still)
    np.testing.assert_allclose(forces(found), expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    for name, unit in (("plastic_dissipation", 1e-3), ("strain_energy", 1e-3)):
        expected = getattr(still.rows[-1], name)
        assert getattr(found.rows[-1], name) * unit == pytest.approx(expected, rel=1e-9)
    iterations = [[row.newton_iterations for row in one.rows] for one in (found, still)]
    assert iterations[0] == iterations[1]


def test_steps_that_are_cut_end_as_these_steps_taken_directly(still, tmp_path, monkeypatch):
    """The second step and the first of dragging are denied once: halves of them follow."""
    attempt, calls = ImplicitStepper.attempt, []

    def denied(stepper: ImplicitStepper, dt: float) -> Any:
        calls.append(dt)
        result = attempt(stepper, dt)
        return replace(result, converged=result.converged and len(calls) not in (2, 7))

    case = pressed(tmp_path / "block.msh")
    with monkeypatch.context() as patch:
        patch.setattr(ImplicitStepper, "attempt", denied)
        cut = run(case)
    assert len(cut.rows) > len(still.rows) and len(calls) == len(cut.rows) + 2
    # The same steps, from a list of stages as long as they were.
    direct = run(case | {"stage": stages_of(cut)})
    scale = np.abs(forces(cut)).max()
    np.testing.assert_allclose(forces(direct), forces(cut), rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(points(direct), points(cut), rtol=0, atol=1e-9)
    assert not np.allclose(forces(direct)[-1], forces(still)[-1], rtol=1e-6)


def stages_of(simulation: Simulation) -> list[dict[str, Any]]:
    """One stage of one step for each row of a run."""
    return [{"name": f"step {row.step}", "duration": row.dt, "steps": 1} for row in simulation.rows]
