"""Explicit dynamics from the case: keys, smooth ramps, springs, masses, load steps."""

import re
import tomllib

import numpy as np
import pytest
from mpi4py import MPI
from scipy.integrate import quad

import tribox.forms.contact.explicit
from tests.solved import solved
from tribox.app.build.model import build_model
from tribox.app.case.case import Case, resolved_toml
from tribox.app.case.reading import check_case, load_case
from tribox.app.case.stage import LoadStep, Stage, load_steps_of
from tribox.app.case.time_tables import TimeTable
from tribox.app.simulation.energy_balance import Inertia, notes_on_inertia
from tribox.app.simulation.explicit_stage import notes_on_bouncing
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

DENSE = {"elastomer": 1100.0, "aluminium": 2700.0}
SPRING = {"direction": "x", "stiffness": 2000.0, "end": [[1.0, 0.0], [2.0, 3e-4]]}


def explicit(text: str, **solver) -> dict:
    """The case as plain data, explicit after an implicit first stage."""
    data = tomllib.loads(text)
    for name, density in DENSE.items():
        data["bodies"][name]["density"] = density
    data["stage"][0]["solver"] = "implicit"
    data["solver"] = {"kind": "explicit", **solver}
    return data


# -- programs -------------------------------------------------------------------------------------


def test_a_smooth_table_goes_through_its_points_and_integrates_exactly():
    table = TimeTable((1.0, 3.0, 4.0), (2.0, 6.0, -1.0), smooth=True)
    assert [table(t) for t in (0.0, 1.0, 2.0, 3.0, 4.0, 9.0)] == [2.0, 2.0, 4.0, 6.0, -1.0, -1.0]
    assert table(1.2) < 2.0 + 4.0 * 0.1  # slower than linear at first
    for time in (0.5, 1.0, 1.7, 3.3, 6.0):
        exact, _ = quad(table, 0.0, time, points=[1.0, 3.0, 4.0], limit=200)
        assert table.integral(time) == pytest.approx(exact, rel=1e-9)
    later = TimeTable((-2.0, 2.0), (0.0, 4.0), smooth=True)
    assert later.integral(2.0) == pytest.approx(quad(later, 0.0, 2.0)[0], rel=1e-9)


def test_velocity_goes_over_smoothly_to_the_next():
    stage = Stage(name="s", velocities=(1.0, 3.0), slip_step=0.1, ramp=0.5)
    first, second = load_steps_of(stage, before=0.0)
    assert (first.before, second.before) == (0.0, 1.0)
    for load_step in (first, second):
        for time in (0.2, 0.5, 2.0):
            exact, _ = quad(load_step.speed, 0.0, time, points=[0.5])
            assert load_step.travel(time) == pytest.approx(exact, rel=1e-10)
    assert second.speed(0.0) == 1.0 and second.speed(0.5) == 3.0
    sudden = LoadStep(Stage(name="s", duration=1.0), 2.0, 0.1, 10, before=5.0)
    assert sudden.speed(0.0) == 2.0 and sudden.travel(0.25) == 0.5


# -- case -----------------------------------------------------------------------------------------


def test_an_explicit_case_reads_back_to_itself(film, tmp_path):
    data = explicit(film, damping="1e3 1/s", step_safety=0.8)
    data["solver"]["mass_scaling"] = {"step": "10 ns"}
    data["bodies"]["elastomer"]["velocity"] = {"x": "2 mm/s"}
    pressure = {"table": [["0 s", 0], ["1 s", "0.5 MPa"]], "ramp": "smooth"}
    data["boundary"][1]["platen"] |= {"pressure": pressure, "mass": "3 g"}
    data["stage"][1]["ramp"] = "10 us"
    case = Case.model_validate(data)
    path = tmp_path / "again.toml"
    path.write_text(resolved_toml(case))
    assert load_case(path) == case
    assert case.solver.damping == 1e3 and case.solver.mass_scaling.step == 1e-8
    assert case.boundary[1].platen.mass == 3e-3
    # An implicit case has none of the explicit keys in its resolved file.
    implicit = Case.model_validate(tomllib.loads(film))
    path.write_text(resolved_toml(implicit))
    assert "step_safety" not in path.read_text() and load_case(path) == implicit


@pytest.mark.parametrize(
    ("scaling", "expected"),
    [
        ({}, "solver.mass_scaling.step: missing; the step to reach"),
        ({"factor": 2}, 'mass_scaling.factor = 2.0: goes with kind = "uniform" only'),
        ({"kind": "uniform"}, "solver.mass_scaling: give either factor or step, found neither"),
        ({"kind": "uniform", "factor": 0.5}, "mass_scaling.factor = 0.5: must be >= 1"),
        ({"kind": "uniform", "factor": 2, "step": 1}, "give either factor or step, found both"),
    ],
)
def test_mass_scaling_that_says_nothing(film, case_file, scaling, expected):
    path = case_file(film.replace("[output]", "\n[solver]\nkind = 'explicit'\n[output]"))
    words = [f"bodies.{name}.density={value}" for name, value in DENSE.items()]
    words += [f"solver.mass_scaling.{key}={value}" for key, value in scaling.items()]
    [line] = (
        check_case(path, words or ["solver.mass_scaling={}"])
        if scaling
        else check_case(path, [*words, "solver.mass_scaling={}"])
    )
    assert expected in line


def test_implicit_stages_come_first(film):
    data = explicit(film)
    data["stage"].append({"name": "hold", "duration": 1.0, "solver": "implicit"})
    with pytest.raises(ValueError, match=r'stage.2.solver: "implicit" cannot follow the explicit'):
        Case.model_validate(data)
    data["stage"] = data["stage"][:1]
    with pytest.raises(ValueError, match=r"never moves"):
        Case.model_validate(data)


def test_relaxation_has_nothing_to_do_where_something_is_driven(film):
    data = explicit(film)
    data["stage"][1]["relax"] = True
    with pytest.raises(ValueError, match=r"stage.1.relax: does not go with a velocity"):
        Case.model_validate(data)


# -- model ----------------------------------------------------------------------------------------


def sprung(text: str, **changes) -> Simulation:
    """The block case with its top drawn by a spring, run to the end."""
    data = tomllib.loads(text)
    data["solver"] = {"tolerance": 1e-11}
    pressure = [["0 s", 0.0], ["1 s", 3e5]]
    top = {"surface": "top", "platen": {"direction": "y", "pressure": pressure}}
    data["boundary"][1] = {**top, "spring": SPRING | changes}
    return solved(data)


def test_a_spring_draws_the_surface_until_friction_gives_way(block):
    run = sprung(block)
    problem, last = run.model.problem, run.rows[-1]
    names = run.model.platen_names
    assert names == ["top_y", "top_x"]
    moved = run.stepper.x.array_r[problem.platens[1].dofs]
    assert np.ptp(moved) == 0.0
    # The friction, mu N, is what the spring is stretched by.
    assert last.tangential_force == pytest.approx(0.2 * last.normal_force, rel=1e-6)
    assert 2000.0 * (3e-4 - moved[0]) == pytest.approx(last.tangential_force, rel=1e-5)
    assert last.stick_fraction == 0.0 and moved[0] > 1e-4
    assert abs(last.energy_error) < 2e-3 * last.external_work
    # With the spring in the tangent Newton stays quadratic; without it takes many more.
    assert sum(row.newton_iterations for row in run.rows[3:]) < 45


# -- advice ---------------------------------------------------------------------------------------


def test_scaled_mass_that_is_felt_is_a_warning(film):
    data = explicit(film, mass_scaling={"kind": "uniform", "factor": 4}, kinetic_limit=0.1)
    case = Case.model_validate(data)
    [load_step, *_] = load_steps_of(case.stage[1])
    inertia = Inertia(load_step.label)
    inertia.add(kinetic=0.05, strain=1.0)
    assert list(notes_on_inertia(case, load_step, inertia, 3.0)) == []
    inertia.add(kinetic=0.25, strain=1.0)
    assert inertia.ratio == pytest.approx(0.15) and inertia.last == 0.25
    [line] = notes_on_inertia(case, load_step, inertia, 3.0)
    assert "0.15 of the strain energy, above kinetic_limit = 0.1" in line
    assert list(notes_on_inertia(case, load_step, inertia, 1e-4)) == []  # fast by its own mass


def test_a_relaxed_stage_that_still_moves_is_a_warning(film):
    case = Case.model_validate(explicit(film))
    [load_step] = load_steps_of(Stage(name="settle", duration=1.0, relax=True))
    moving, resting = Inertia("settle"), Inertia("settle")
    moving.add(0.1, 1.0)
    resting.add(1e-5, 1.0)
    [line] = notes_on_inertia(case, load_step, moving, 0.0)
    assert "stage settle: not at rest at its end, kinetic energy is 0.1" in line
    assert list(notes_on_inertia(case, load_step, resting, 0.0)) == []


def test_a_stiff_penalty_is_noted_where_steps_are_explicit(film):
    def said(data: dict) -> list[str]:
        model = build_model(Case.model_validate(data), MPI.COMM_SELF)
        return [note for note in model.notes if "penalty" in note]

    data, implicit = explicit(film), tomllib.loads(film)
    [line] = said(data)
    assert line.startswith("contact.0: a penalty of penalty_factor = 30, ")
    body = data["bodies"]["elastomer"]
    C10, C01, K = (float(body[name].removesuffix(" MPa")) for name in ("C10", "C01", "K"))
    G = 2.0 * (C10 + C01)
    stiffness = 30.0 * 10.0 * G / (K + 4.0 / 3.0 * G)
    assert f"{stiffness:.3g} times the oedometric modulus over the length" in line
    data["contact"][0]["penalty_factor"] = 3.0
    assert said(data) == []
    assert said(implicit) == []


# -- contact that bounces -------------------------------------------------------------------------

DRAWN = """
geometry = { kind = "blocks", blocks.block = { x = [0, 2e-3], y = [0, 5e-4], elements = [8, 2] } }
tools.plane = { shape = "plane", point = [0, 0], normal = [0, 1] }
[bodies]
block = { material = "neo-hookean", E = "5 MPa", nu = 0.45, density = "1100 kg/m^3" }
[[contact]]
slave = "block_bottom"
master = "plane"
friction = { law = "stribeck", mu_s = 0.5, mu_d = 0.1, V_s = "0.1 m/s", viscous = "1e4 Pa*s/m" }
[[boundary]]
surface = "block_top"
platen = { direction = "y", pressure = "50 kPa" }
displacement = { x = "driven" }
[[stage]]
name = "press"
solver = "implicit"
duration = "1 s"
steps = 1
rate_dependent = false
[[stage]]
name = "slide"
velocities = ["2 m/s"]
slip_step = "4 um"
ramp = "20 us"
min_steps = 149
max_steps = 150
[solver]
kind = "explicit"
"""


class Bouncing(Observer):
    said: tuple[str, ...] = ()

    def load_step(self, state, load_step, row, steady):
        self.said += tuple(notes_on_bouncing(state, load_step))


@pytest.mark.parametrize("share", [None, 0.0], ids=["dashpots", "springs alone"])
def test_a_block_stays_on_the_plane_that_it_is_drawn_over(share, monkeypatch):
    """Where it bounces all the same, the run says how much of the contact is open."""
    if share is not None:
        monkeypatch.setattr(tribox.forms.contact.explicit, "DAMPING", share)
    told = Bouncing()
    first, *rows = solved(tomllib.loads(DRAWN), observer=told).rows
    half = rows[len(rows) // 2 :]
    area = np.mean([row.contact_area for row in half]) / first.contact_area
    friction = np.mean([row.tangential_force for row in half]) / first.normal_force
    assert max(abs(row.energy_error) for row in rows) < 1e-3 * rows[-1].external_work
    if share is None:
        assert told.said == () and area > 0.9
        assert friction == pytest.approx(0.1 + 0.4 * area, rel=0.05)  # viscous: 2 m/s 1e4 Pa s/m
        return
    assert area < 0.6 and friction < 0.7 * 0.5
    [line] = told.said
    assert line.startswith("contact.0: stage slide 2 m/s: the contact bounces: of the area at the")
    closed = re.search(r"stage ([0-9.]+) % are closed", line)
    mean = np.mean([row.contact_area for row in rows]) / first.contact_area
    assert closed is not None and float(closed[1]) == pytest.approx(100.0 * mean, rel=0.02)


def test_a_block_that_hops_is_told_of_though_next_to_nothing_is_ever_closed():
    """Soft, and stopped from 0.4 m/s by mu = 0.8, it stands on its nose, then in the air."""
    data = tomllib.loads(DRAWN)
    data["geometry"]["blocks"]["block"] = {"x": [0, 40e-3], "y": [0, 10e-3], "elements": [6, 2]}
    soft = {"E": "3 MPa", "density": "1000 kg/m^3", "velocity": {"x": "0.4 m/s"}}
    data |= {"gravity": {"y": "-9.81 m/s^2"}, "boundary": []}
    data["bodies"]["block"] |= soft
    friction = {"law": "coulomb", "mu": 0.8}
    data["contact"][0] |= {"friction": friction, "penalty_factor": 3.0}
    data["stage"] = [data["stage"][0], {"name": "slide", "duration": "40 ms", "steps": 40}]
    told = Bouncing()
    solved(data, observer=told)
    [line] = told.said
    assert "the contact bounces" in line and "at times 0 %" in line
