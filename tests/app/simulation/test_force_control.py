"""Bodies that a given force presses on each other, from their first touch or a gap on."""

import re

import numpy as np
import pytest

import tribox.app.build.model
from tests.solved import Cuts, solved
from tribox.app.build.mesh import make_mesh
from tribox.app.case.case import Case
from tribox.app.errors import InputError, SolutionError
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation

MOST = 20  # iterations of a step
CYLINDERS = {
    "kind": "two-cylinders", "thickness": 1e-3, "contact_width": 0.6e-3, "contact_size": 50e-6,
    "growth": 2.0, "upper": {"radius": 20e-3},
    "lower": {"radius": 20e-3, "contact_size": 60e-6},
}  # fmt: skip
SPHERE = {
    "kind": "sphere-on-block", "part": "axisymmetric", "sphere": {"radius": 10e-3},
    "block": {"radius": 8e-3, "height": 8e-3}, "contact_width": 0.65e-3, "contact_size": 40e-6,
    "growth": 2.0,
}  # fmt: skip
QUARTER = SPHERE | {"part": "quarter", "contact_size": 110e-6}
# Of an elongated pad with a slightly round face: all of its width comes to bear.
PAD = CYLINDERS | {
    "contact_width": 4e-3,
    "contact_size": 0.4e-3,
    "lower": {"radius": 20e-3, "contact_size": 0.5e-3},
}
SHAPES = {
    "cylinders": (CYLINDERS, 0.02),
    "sphere": (SPHERE, 0.01),
    "quarter": (QUARTER, 0.0025),
    "pad": (PAD, 1.0),
}


def pressed(shape: str, nu: float, steps: int, top: dict | None = None) -> dict:
    """A case: the upper body pressed on the lower by a platen; ``top``: what else moves it."""
    geometry, force = SHAPES[shape]
    elastomer = {"material": "neo-hookean", "E": 5e6, "nu": nu, "formulation": "q1-sri"}
    held = dict.fromkeys("xz" if shape == "quarter" else "x", 0)
    platen = {"direction": "y", "force": [[0.0, 0.0], [1.0, force]]}
    boundaries = [
        {"surface": "bottom", "displacement": held | {"y": 0}},
        {"surface": "top", "displacement": held} | (top or {"platen": platen}),
    ]
    if shape == "quarter":
        for body in ("elastomer", "aluminium"):
            for axis in "xz":
                here = {"surface": f"{body}_symmetry_{axis}", "displacement": {axis: 0}}
                boundaries.append(here)
    pair = {"slave": "elastomer_contact", "master": "aluminium_contact", "penalty_factor": 3}
    return {
        "title": shape,
        "geometry": geometry,
        "bodies": {"elastomer": elastomer, "aluminium": elastomer | {"E": 5e9, "nu": 0.3}},
        "contact": [pair | {"friction": {"law": "frictionless"}}],
        "boundary": boundaries,
        "stage": [{"name": "press", "duration": 1.0, "steps": steps}],
    }


def simulate(data: dict) -> tuple[Simulation, int]:
    """The case solved, and how often a step was cut."""
    cuts = Cuts()
    return solved(data, observer=cuts), cuts.count


@pytest.fixture
def apart(monkeypatch):
    """Lets the upper body start some way (m) above the other."""

    def lift(gap: float) -> None:
        def lifted(case, comm, *more):
            named = make_mesh(case, comm, *more)
            geometry = named.mesh.geometry
            geometry.x[np.unique(geometry.dofmap[named.cells("elastomer")]), 1] += gap
            return named

        monkeypatch.setattr(tribox.app.build.model, "make_mesh", lifted)

    return lift


@pytest.mark.parametrize(
    ("shape", "nu", "steps", "gap"),
    [
        ("cylinders", 0.45, 1, 30e-6), ("cylinders", 0.495, 3, 0.0), ("sphere", 0.4999, 1, 30e-6),
        ("sphere", 0.45, 3, 0.0), ("quarter", 0.495, 1, 30e-6), ("pad", 0.495, 3, 0.0),
        ("pad", 0.495, 3, 30e-6),
    ],
)  # fmt: skip
def test_a_force_finds_the_contact_and_is_met(apart, shape, nu, steps, gap):
    apart(gap)
    run, cuts = simulate(pressed(shape, nu, steps))
    force, noise = SHAPES[shape][1], run.model.problem.roundoff
    assert cuts == 0 and max(row.newton_iterations for row in run.rows) <= MOST
    for count, row in enumerate(run.rows, 1):
        assert row.normal_resultant == pytest.approx(force * count / steps, rel=1e-7, abs=noise)


def test_a_pressure_finds_the_contact_too(apart):
    """No platen: the springs act on all of the body."""
    apart(30e-6)
    pressure = [[0.0, 0.0], [1.0, SHAPES["pad"][1] / (40e-3 * 1e-3)]]
    run, cuts = simulate(pressed("pad", 0.45, 1, {"pressure": pressure}))
    assert cuts == 0 and run.rows[0].newton_iterations <= MOST
    assert run.rows[0].force_y == pytest.approx(SHAPES["pad"][1], rel=0.02)


def pulled_apart(*forces):
    """What is said of cylinders under such times their force, one a step; cuts and iterations."""
    data, unit, cuts = pressed("cylinders", 0.45, 2), SHAPES["cylinders"][1], Cuts()
    data["boundary"][1]["platen"]["force"] = [[0.5 * n, f * unit] for n, f in enumerate(forces)]
    with pytest.raises(SolutionError) as error:
        solved(data, observer=cuts)
    return str(error.value), cuts


def test_a_force_that_pulls_bodies_apart_is_named_after_two_cuts():
    said, cuts = pulled_apart(0.0, -1.0, -2.0)
    assert re.search(r"no contact presses on it, and a load of .* N in y moves it away; try", said)
    assert cuts.count == 2 and cuts.iterations <= 24


def test_a_force_that_pulls_apart_what_it_pressed_before_is_named_where_nothing_presses():
    """The cut before ends where the force is zero: the body floats there."""
    said, cuts = pulled_apart(0.0, 1.0, -1.0)
    assert re.search(r"no contact presses on it, and a load of .* N in y moves it away; try", said)
    assert cuts.iterations <= 52


def test_what_a_force_lets_go_floats_and_is_pressed_again():
    data, unit = pressed("cylinders", 0.45, 3), SHAPES["cylinders"][1]
    times = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0]
    data["boundary"][1]["platen"]["force"] = [
        [time, force * unit] for time, force in zip(times, (0.0, 1.0, 0.0, 0.5), strict=True)
    ]
    run, cuts = simulate(data)
    assert cuts == 0 and max(row.newton_iterations for row in run.rows) <= 10
    forces = [row.normal_resultant for row in run.rows]
    assert forces == pytest.approx([unit, 0.0, 0.5 * unit], rel=1e-6, abs=1e-6 * unit)


# -- a platen's displacement first, its force afterwards -------------------------------------------

DEPTH = 3e-6


def switched(shape: str = "sphere") -> dict:
    """Pressed by displacement, and from there by the force."""
    force = SHAPES[shape][1]
    platen = {
        "direction": "y",
        "force": force,
        "displacement": [[0.0, 0.0], [1.0, DEPTH]],
        "displacement_stages": ["press"],
    }
    data = pressed(shape, 0.45, 2, {"platen": platen})
    data["stage"].append({"name": "load", "duration": 1.0, "steps": 2})
    return data


@pytest.fixture(scope="module")
def both() -> tuple[Simulation, list[float]]:
    """The switched case, and the platen's displacement after each step."""
    seen: list[float] = []

    class Watch(Observer):
        def step(self, simulation, row, result):
            (platen,) = simulation.model.problem.platens
            seen.append(float(simulation.stepper.x.array_r[platen.dofs].mean()))

    return solved(switched(), observer=Watch()), seen


def test_displacement_is_met_in_its_stage_and_force_in_the_next(both):
    run, seen = both
    assert seen[:2] == pytest.approx([-0.5 * DEPTH, -DEPTH], rel=1e-12)
    force = SHAPES["sphere"][1]
    assert 0.0 < run.rows[1].normal_force < 0.9 * force
    assert [row.normal_resultant for row in run.rows[2:]] == pytest.approx([force] * 2, rel=1e-7)
    assert seen[3] == pytest.approx(seen[2], rel=1e-6) and seen[3] < 1.2 * seen[1]


def test_both_controls_come_to_the_same_state(both):
    run, _ = both
    plain, _ = simulate(pressed("sphere", 0.45, 2))
    for name in ("strain_energy", "contact_area", "max_penetration"):
        mine, other = (getattr(r.rows[-1], name) for r in (run, plain))
        assert mine == pytest.approx(other, rel=1e-6), name


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"displacement_stages": []}, "boundary.1.platen.displacement_stages: missing"),
        ({"displacement": None}, "boundary.1.platen.displacement: missing"),
        ({"displacement_stages": ["slide"]}, "no stage has this name; there are press, load"),
    ],
)
def test_what_does_not_fit_is_named(change, said):
    data = switched()
    platen = data["boundary"][1]["platen"] | change
    data["boundary"][1]["platen"] = {k: v for k, v in platen.items() if v is not None}
    with pytest.raises((InputError, ValueError), match=said):
        Case.model_validate(data)


def test_explicit_stages_refuse_a_displacement():
    data = switched() | {"solver": {"kind": "explicit"}}
    with pytest.raises((InputError, ValueError), match="does not go with explicit stages"):
        Case.model_validate(data)


def deny(monkeypatch, *numbers: int) -> list[float]:
    """Have attempts of these numbers solved and then denied; the lengths of all, as they go."""
    attempt, calls = ImplicitStepper.attempt, []

    def fail(stepper, dt):
        result = attempt(stepper, dt)
        calls.append(dt)
        if len(calls) in numbers:
            result.converged = False
        return result

    monkeypatch.setattr(ImplicitStepper, "attempt", fail)
    return calls


def test_first_steps_of_stages_that_are_cut_ramp_what_changes_at_once(monkeypatch):
    """Half of it with half the step; what begins at nothing, and later steps, follow the time."""
    data = pressed("pad", 0.3, 2, {"pressure": [[0.0, 3e4], [1.0, 5e4], [2.0, 6e4]]})
    data["boundary"][1]["displacement"]["y"] = [[0.0, -1e-5], [1.0, -3e-5]]
    pulled = {"surface": "top", "traction": {"y": [[1.0, 2e4], [2.0, 1e4]]}, "stages": ["hold"]}
    data["boundary"].append(pulled)
    data["gravity"] = {"y": -9.81, "stages": ["press"]}
    data["bodies"] = {name: body | {"density": 1e3} for name, body in data["bodies"].items()}
    data["stage"].append({"name": "hold", "duration": 1.0, "steps": 2})
    whole, seen = solved(data), []

    class Loads(Observer):
        def step(self, state, row, result) -> None:
            problem = state.model.problem
            moved = problem.constraints.prescribed[-1].value
            amounts = [float(load.amount.reshape(-1)[-1]) for load in problem.loads]
            seen.append((row.time, *amounts, moved))

    deny(monkeypatch, 1, 4, 7, 10)
    solved(data, observer=Loads())
    times = np.arange(0.25, 2.1, 0.25)
    share, then = np.minimum(times / 0.5, 1.0), np.clip((times - 1.0) / 0.5, 0.0, 1.0)
    columns = dict(enumerate(np.array(seen).T))
    np.testing.assert_allclose(columns[0], times)
    np.testing.assert_allclose(columns[1], 3e4 * share + 2e4 * times - 1e4 * (times - 1).clip(0.0))
    np.testing.assert_allclose(columns[2], (times > 1.0) * (2e4 * then - 1e4 * (times - 1.0)))
    for body in (3, 4):
        np.testing.assert_allclose(columns[body], -9.81 * share * (1.0 - then), atol=1e-12)
    place = -1e-5 - 2e-5 * np.minimum(times, 1.0)
    np.testing.assert_allclose(columns[5], place)  # where it begins is a place
    assert whole.rows[-1].time == 2.0


@pytest.mark.parametrize("by", ["platen", "spring", "traction"])
def test_a_force_or_spring_takes_over_from_what_a_displacement_has_led_to(monkeypatch, by):
    """By half with half of the step: the first touch is not lost in between."""
    data, force = switched(), SHAPES["sphere"][1]
    spring = by == "spring"
    then = {"displacement": {"x": 0}, "force": {"y": -force}}
    if spring:
        then = {"spring": {"direction": "y", "stiffness": 1e4, "end": -2.0 * DEPTH}}
    if by != "platen":
        held = {"surface": "top", "displacement": {"x": 0, "y": -DEPTH}, "stages": ["press"]}
        data["boundary"][1:] = [held, {"surface": "top", "stages": ["load"]} | then]
    deny(monkeypatch, 3)
    pieces = solved(data).rows[1:]
    got = [row.normal_resultant for row in pieces]
    assert got[2] == pytest.approx(got[3], rel=1e-6)
    assert got[1] == pytest.approx(0.5 * (got[0] + got[2]), rel=0.02 if spring else 1e-6)
    assert got[0] < 0.9 * got[2] and (spring or got[2] == pytest.approx(force, rel=1e-6))
    assert abs(pieces[-1].energy_error) < 0.02 * pieces[-1].external_work


def test_pieces_of_a_first_step_bear_their_share_of_a_force():
    """A hundred times the force is too much for one step: it is as if it had been ramped."""
    data, force = pressed("cylinders", 0.45, 1), 100.0 * SHAPES["cylinders"][1]
    data["boundary"][1]["platen"]["force"], seen = force, Cuts()
    pieces = solved(data, observer=seen)
    assert seen.count
    times = [row.time for row in pieces.rows]
    np.testing.assert_allclose([r.normal_force for r in pieces.rows], force * np.array(times), 1e-3)
    data["boundary"][1]["platen"]["force"] = [[0.0, 0.0], [1.0, force]]
    data["stage"] = [
        {"name": f"to {end}", "duration": length, "steps": 1}
        for end, length in zip(times, np.diff([0.0, *times]).tolist(), strict=True)
    ]
    ramped = {round(row.time, 12): row for row in solved(data).rows}
    for row in pieces.rows:
        for name in ("normal_force", "contact_area", "strain_energy"):
            other = getattr(ramped[round(row.time, 12)], name)
            assert getattr(row, name) == pytest.approx(other, rel=1e-6), name
