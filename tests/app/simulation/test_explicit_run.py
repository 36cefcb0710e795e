"""Explicit runs as a user sees them: rows, files, failures, damping and relaxation."""

import json
import os
import re
import signal
import tomllib
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.conftest import FILM, SLID
from tests.solved import solved
from tribox.app.case.case import Case
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.results.reading import read_table
from tribox.app.run import progress
from tribox.app.run.run import run_case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

# A block thrown obliquely on aluminium: it touches, slides, and flies off again.
THROWN = """
title = "thrown block"
[geometry]
kind = "two-blocks"
thickness = "1 mm"
offset = "0.2 mm"
gap = "2 um"
upper = { width = "1.0 mm", height = "0.5 mm", elements = [10, 5] }
lower = { width = "2.0 mm", height = "0.5 mm", elements = [15, 4] }
[bodies.elastomer]
material = "neo-hookean"
E = "5 MPa"
nu = 0.45
density = "1100 kg/m^3"
velocity = { x = "2 m/s", y = "-2 m/s" }
[bodies.aluminium]
material = "hencky"
E = "70 GPa"
nu = 0.33
density = "2700 kg/m^3"
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
penalty_factor = 3
friction = { law = "coulomb", mu = 0.3 }
[[boundary]]
surface = "bottom"
displacement = { x = 0, y = 0 }
[[stage]]
name = "fly"
duration = "30 us"
steps = 30
[solver]
kind = "explicit"
[output]
fields_every = 0
figures = false
"""


def column(run: Simulation, name: str) -> np.ndarray:
    return np.array([getattr(row, name) for row in run.rows])


# -- rows and energies ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def thrown() -> Simulation:
    return solved(tomllib.loads(THROWN))


def test_a_row_stands_for_many_steps(thrown):
    assert len(thrown.rows) == 30
    assert np.allclose(column(thrown, "time"), 1e-6 * np.arange(1, 31), rtol=1e-12)
    attempts, dt = column(thrown, "attempts"), column(thrown, "dt")
    assert np.allclose(attempts * dt, 1e-6, rtol=1e-12)
    assert attempts.sum() == thrown.explicit.steps > 200
    stable = thrown.explicit.summary()["stable_step"]
    assert dt.max() <= 0.9 * stable["longest"] * (1.0 + 1e-8)
    assert dt.min() > 0.5 * 0.9 * stable["shortest"]
    assert np.all(column(thrown, "newton_iterations") == 0)


def test_forces_are_means_so_that_they_add_up_to_the_momentum(thrown):
    speed = {axis: thrown.state.motion.of_body("elastomer", f"velocity_{axis}") for axis in "xy"}
    mass = 1100.0 * 1e-3 * 0.5e-3 * 1e-3
    pushed = 1e-6 * np.cumsum(column(thrown, "normal_force"))
    assert pushed.max() > 0.5 * mass * 2.0
    assert np.allclose(mass * (speed["y"] + 2.0), pushed, atol=2e-2 * pushed.max())
    dragged = 1e-6 * np.cumsum(column(thrown, "drag"))
    assert np.allclose(mass * (2.0 - speed["x"]), dragged, atol=2e-2 * dragged.max())


def test_energies_balance_in_impact_with_friction(thrown):
    energy = 0.5 * 1100.0 * 8.0 * 1e-3 * 0.5e-3 * 1e-3
    # Tight enough to see friction's trapezoidal part: with its sign wrong it is 2e-3.
    assert np.max(np.abs(column(thrown, "energy_error"))) < 2e-4 * energy
    lost = column(thrown, "dissipation")
    assert np.all(np.diff(lost) >= 0.0) and lost[-1] > 0.02 * energy
    assert column(thrown, "kinetic_energy")[0] == pytest.approx(energy, rel=1e-2)
    # Nothing but the bodies themselves: supports that stand still do no work.
    assert np.max(np.abs(column(thrown, "external_work"))) < 1e-12 * energy


def test_velocities_end_when_the_mean_force_is_steady():
    data = tomllib.loads(SLID)
    data["stage"][1] = {
        **{"name": "slide", "velocities": [0.3, 0.6], "slip_step": 1e-6, "ramp": 8e-6},
        **{"min_steps": 2, "max_steps": 30, "steady_tolerance": 0.1},
    }
    load_steps = []

    class LoadSteps(Observer):
        def load_step(self, simulation, load_step, row, steady):
            load_steps.append((load_step.label, steady, row.step, row.time))

    run = solved(data, observer=LoadSteps())
    assert [(label, steady) for label, steady, _, _ in load_steps] == [
        ("press", None),
        ("slide 0.3 m/s", True),
        ("slide 0.6 m/s", True),
    ]
    # Not before four rows to compare, nor before the ramp is over.
    rows = [load_steps[k + 1][2] - load_steps[k][2] for k in (0, 1)]
    assert rows[0] >= 4 and rows[1] * 1e-6 / 0.6 >= 8e-6
    assert min(rows) < 30
    # The driven boundaries lag behind by what the ramps took: half a ramp of each change.
    time = [load_steps[1][3] - load_steps[0][3], load_steps[2][3] - load_steps[1][3]]
    lag = 0.3 * 4e-6 + 0.3 * 4e-6
    moved = 0.3 * time[0] + 0.6 * time[1] - lag
    assert run.rows[-1].driven_displacement == pytest.approx(moved, rel=1e-9)


def test_mass_proportional_damping_slows_a_free_body():
    data = tomllib.loads(THROWN)
    data["bodies"]["elastomer"]["velocity"] = {"x": 2.0, "y": 1.0}  # away from the other
    data["solver"]["damping"] = 2e4
    run = solved(data)
    speed = run.state.motion.of_body("elastomer", "velocity_x")
    time = column(run, "time")
    assert np.allclose(speed, 2.0 * np.exp(-2e4 * time), rtol=1e-2)
    start = 0.5 * 1100.0 * 5.0 * 1e-3 * 0.5e-3 * 1e-3
    lost = column(run, "damping_dissipation")
    assert lost[-1] == pytest.approx(start * -np.expm1(-4e4 * time[-1]), rel=1e-2)
    assert np.max(np.abs(column(run, "energy_error"))) < 1e-6 * start


def test_relaxation_ends_in_the_implicit_equilibrium():
    data = tomllib.loads(SLID)
    ramp = {"table": [["0 s", 0], ["10 us", "0.5 MPa"]], "ramp": "smooth"}
    data["boundary"][1]["platen"]["pressure"] = ramp
    data["stage"] = [
        {"name": "press", "duration": "40 us", "steps": 8, "relax": True, "rate_dependent": False}
    ]
    data["boundary"][1]["displacement"] = {"x": 0.0}
    relaxed = solved(data)
    data["solver"] = {"tolerance": 1e-11}
    del data["stage"][0]["relax"]
    mine, theirs = relaxed.rows[-1], solved(data).rows[-1]
    assert mine.normal_force == pytest.approx(0.5 * 0.6, rel=2e-3)
    assert mine.strain_energy == pytest.approx(theirs.strain_energy, rel=1e-2)
    assert relaxed.state.inertia[-1].last < 1e-3
    assert mine.damping_dissipation > 0.0
    assert abs(mine.energy_error) < 0.01 * mine.external_work


# -- files and failures ---------------------------------------------------------------------------


def test_without_rates_no_viscosity_counts_from_the_first_forces_on():
    """An explicit stage that takes over from an implicit one begins with forces of its own."""
    runs = []
    for viscosity in ("0.8 Pa*s", "80 Pa*s"):
        data = tomllib.loads(FILM)
        for name, density in (("elastomer", 1100.0), ("aluminium", 2700.0)):
            data["bodies"][name]["density"] = density
        data["bodies"]["elastomer"]["velocity"] = {"x": 0.1}
        data["contact"][0]["friction"]["eta_b"] = viscosity
        data["boundary"][1]["displacement"] = {"x": 0}
        data["solver"] = {"kind": "explicit"}
        slide = {"name": "slide", "duration": "20 ns", "steps": 2, "rate_dependent": False}
        data["stage"] = [{**data["stage"][0], "solver": "implicit"}, slide]
        runs.append(solved(data))
    for name in ("tangential_force", "kinetic_energy", "strain_energy", "dissipation"):
        np.testing.assert_array_equal(column(runs[0], name), column(runs[1], name), err_msg=name)
    assert column(runs[0], "kinetic_energy")[-1] > 0.0


@pytest.fixture(scope="module")
def slid(tmp_path_factory) -> tuple[Simulation, Path]:
    """The small sliding case with its results."""
    case = Case.model_validate(tomllib.loads(SLID.replace("figures = false", "figures = true")))
    out = tmp_path_factory.mktemp("slid") / "out"
    return run_case(case, out, quiet=True, comm=MPI.COMM_SELF), out


def test_files_of_an_explicit_run(slid):
    run, out = slid
    summary = json.loads((out / "summary.json").read_text())
    explicit = summary["explicit"]
    assert explicit["time_steps"] == sum(row.attempts for row in run.rows[2:])
    assert explicit["limited_by"] and explicit["added_mass"] == 0.0
    assert list(explicit["kinetic_over_strain"]) == ["slide"]
    assert 0.0 < explicit["stable_step"]["shortest"] <= explicit["stable_step"]["longest"]
    assert [load_step["label"] for load_step in summary["load_steps"]] == ["press", "slide"]
    history, surfaces, bodies = (
        read_table(out / f"{name}.csv") for name in ("history", "surfaces", "bodies")
    )
    top = [row for row in surfaces if row["surface"] == "top"]
    assert [row["time"] for row in top] == [row["time"] for row in history]
    assert top[-1]["force_y"] == pytest.approx(-0.3, rel=1e-12)  # 0.5 MPa, downwards
    at = {row["body"]: row["displacement_x"] for row in bodies[-2:]}
    assert abs(at["aluminium"]) < 1e-8 < at["elastomer"] < 4e-6
    assert (out / "figures" / "energy.png").stat().st_size > 1000
    assert sorted(p.name for p in (out / "contact").iterdir()) == ["000002.vtu", "000012.vtu"]


def assert_momentum(table: Path) -> None:
    """Boundaries and contact change the elastomer's momentum over each explicit row of SLID."""
    elastomer = [row for row in read_table(table) if row["body"] == "elastomer"][1:]
    mass = 1100 * 0.6e-3 * 0.05e-3 * 1e-3
    for axis in "xy":
        pushed = [row[f"boundary_force_{axis}"] + row[f"contact_force_{axis}"] for row in elastomer]
        gained = mass * np.diff([row[f"velocity_{axis}"] for row in elastomer])
        # Half a time step of a force that swings is left between means and velocities.
        assert 2e-6 * np.array(pushed[1:]) == pytest.approx(gained, abs=5e-2 * np.abs(gained).max())


def test_pressures_change_the_momentum(tmp_path):
    data = tomllib.loads(SLID)
    for side, pressure in (("left", "1 MPa"), ("right", "0.2 MPa")):
        ramp = [["1 s", 0], ["1.000005 s", pressure]]
        data["boundary"].append({"surface": f"elastomer_{side}", "pressure": ramp})
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    assert_momentum(tmp_path / "out" / "bodies.csv")
    last = {row["surface"]: row for row in read_table(tmp_path / "out" / "surfaces.csv")[-4:]}
    # 1 and 0.2 MPa on 0.05 mm times 1 mm of the slab, pressed a little flatter.
    left, right = (last[f"elastomer_{side}"]["force_x"] for side in ("left", "right"))
    assert left == pytest.approx(1e6 * 0.05e-6, rel=0.1)
    assert right == pytest.approx(-0.2 * left, rel=0.1)


def test_scaled_mass_is_reported(slid, tmp_path):
    data = tomllib.loads(SLID)
    data["solver"]["mass_scaling"] = {"kind": "uniform", "factor": 9}
    run = run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    mass = (1100 * 0.6 * 0.05 + 2700 * 1.0 * 0.2) * 1e-6 * 1e-3
    assert summary["explicit"]["added_mass"] == pytest.approx(8.0 * mass, rel=1e-9)
    plain, _ = slid
    assert run.explicit.shortest == pytest.approx(3.0 * plain.explicit.shortest, rel=0.01)
    assert run.explicit.steps == pytest.approx(plain.explicit.steps / 3, rel=0.1)


def test_rounding_is_no_energy_that_is_lost(tmp_path):
    """A body at rest that nothing touches: its energies are noise, of whatever sign."""
    data = tomllib.loads(THROWN)
    data["bodies"]["elastomer"] = {
        "material": "ogden",
        "mu": ["0.63 MPa", "0.0012 MPa", "-0.01 MPa"],
        "alpha": [1.3, 5.0, -2.0],
        "K": "5 MPa",
        "density": 1100.0,
    }
    data["geometry"]["upper"]["elements"], data["geometry"]["lower"]["elements"] = [4, 2], [5, 2]
    data["stage"][0] |= {"steps": 2, "duration": "100 us"}
    data["boundary"].append({"surface": "top", "displacement": {"x": 0, "y": 0}})
    run_case(Case.model_validate(data), tmp_path / "rest", quiet=True)
    warnings = json.loads((tmp_path / "rest" / "summary.json").read_text())["warnings"]
    assert any("never pressed" in line for line in warnings)
    assert not any("energy" in line for line in warnings)


def test_check_says_how_many_steps_a_stage_takes(tribox, case_file):
    done = tribox("check", case_file(SLID), "--set", "stage.1.duration=1 s")
    assert done.returncode == 0, done.stderr
    step, count = [line for line in done.stdout.splitlines() if "note: explicit: " in line]
    found = re.fullmatch(r"note: explicit: time step (\S+) s, limited by .+ at \(.+\) m", step)
    assert found
    assert f"stage slide takes about {1.0 / float(found[1]):.1e} time steps"[:38] in count
    assert 'give it solver = "implicit"' in count


def test_an_element_turned_inside_out_ends_with_code_3(tribox, case_file, tmp_path):
    out = tmp_path / "out"
    fast = ("--set", "bodies.elastomer.velocity.y=-300 m/s", "--set", "output.fields_every=0")
    done = tribox("run", case_file(THROWN), "--out", out, *fast)
    assert done.returncode == 3, done.stdout + done.stderr
    [line] = done.stderr.splitlines()
    assert re.match(
        r"tribox: stage fly, time \S+ s: an element has been turned inside out at \(.+\) m", line
    )
    assert json.loads((out / "summary.json").read_text())["status"] == "failed"
    saved = re.search(
        r"the last valid state, step (\d+) at time (\S+) s, is saved .*, (\S+),", done.stdout
    )
    failed = re.search(r"time (\S+) s: an element", line)
    assert saved and failed and float(saved[2]) < float(failed[1])
    assert (out / saved[3]).is_file()
    *rows, last = read_table(out / "progress.csv")
    history = read_table(out / "history.csv")
    assert [row["time"] for row in rows] == [row["time"] for row in history]
    assert all(row["converged"] == 1.0 and row["cuts"] == 0.0 for row in rows)
    assert last["converged"] == 0.0 and last["step"] == len(history) + 1
    assert last["time"] + last["time_step"] == pytest.approx(float(failed[1]), rel=1e-3)
    begun = history[-1]["time"] if history else 0.0
    assert last["dt"] == pytest.approx(last["time"] - begun) and 0.0 < last["fraction"] < 1.0


def test_a_long_interval_can_be_interrupted(case_file, tribox, tmp_path, monkeypatch):
    advance, out = ExplicitStepper.advance, tmp_path / "out"

    def interrupted(stepper: ExplicitStepper, dt: float) -> None:
        advance(stepper, dt)
        if stepper.state.steps == 150:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(ExplicitStepper, "advance", interrupted)
    monkeypatch.setattr(progress, "LINE_EVERY", 0.0)
    words = ("--set", "stage.1.duration=1 s", "--set", "stage.1.steps=1")
    done = tribox("run", case_file(SLID), "--out", out, *words)
    assert done.returncode == 130 and "Traceback" not in done.stdout + done.stderr
    assert re.search(r"^time step .* \d+ steps/s$", done.stdout, re.MULTILINE)
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["status"], summary["steps"]) == ("interrupted", 2)
    assert 150 <= summary["explicit"]["time_steps"] < 1000
