"""What the Newton iteration does where it does not simply converge."""

import itertools
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

from tests.app.conftest import BOXES
from tests.solved import solved
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.checkpoint.layout import Layout
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit import stepper as stepper_module
from tribox.app.implicit.globalisation import SOFT, PredictedStart, SoftContact, phases_after
from tribox.app.implicit.interior_point import FromInside
from tribox.app.implicit.newton import ImplicitOptions, Inside
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.app.simulation.failure_diagnosis import reason_of
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation
from tribox.forms.contact.interior_point import SoftenedPoint
from tribox.forms.contact.penalty import ContactTerm

# A soft cylinder on a soft block: most of the contact zone closes in the first step, all of it with
# points that open and close against each other's facets.
CYLINDER = """
title = "two soft bodies"
bodies.elastomer = { material = "neo-hookean", E = "5 MPa", nu = 0.49 }
bodies.aluminium = { material = "hencky", E = "5 MPa", nu = 0.49 }
boundary = [
 { surface = "bottom", displacement = { x = 0, y = 0 } },
 { surface = "top", displacement = { x = 0, y = [["0 s", "0 mm"], ["1 s", "-0.05 mm"]] } },
]
stage = [{ name = "press", duration = "1 s", steps = 2 }]
[geometry]
kind = "cylinder-on-block"
thickness = "1 mm"
contact_width = "0.7 mm"
contact_size = "22 um"
growth = 1.5
cylinder = { radius = "10 mm" }
block = { width = "20 mm", height = "10 mm", contact_size = "30 um" }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "frictionless" }
"""


def cylinder():
    return build_model(Case.model_validate(tomllib.loads(CYLINDER)), MPI.COMM_SELF)


def pressed():
    sim = Simulation(cylinder())
    sim.run(Observer())
    return sim


def fail_predicted_starts(monkeypatch):
    """The predicted start fails always, and far from a solution: what comes after it must do."""

    def run(self, attempt):
        attempt.newton.begin(attempt.x)
        attempt.predictor.predict(attempt.x, attempt.trial, attempt.step)
        attempt.start = attempt.trial.array_r.copy()
        return 0, -1

    monkeypatch.setattr(PredictedStart, "run", run)


def test_a_soft_penalty_approaches_what_the_plain_contact_finds(monkeypatch):
    plain = pressed()
    fail_predicted_starts(monkeypatch)
    approached = pressed()
    assert [row.attempts for row in approached.rows] == [1, 1]
    assert all(row.newton_iterations > 0 for row in approached.rows)
    for one, other in zip(plain.rows, approached.rows, strict=True):
        assert one.normal_force == pytest.approx(other.normal_force, rel=1e-6)
        assert one.interface_energy == pytest.approx(other.interface_energy, rel=1e-5)
    stiff = plain.model.problem.contacts[0].penalty
    np.testing.assert_array_equal(approached.model.problem.contacts[0].penalty, stiff)


def test_a_softened_step_leaves_no_trace_even_when_it_fails(monkeypatch):
    """The penalty is a constant; the next evaluation is that of the contact as it is."""
    model = cylinder()
    problem, (term,) = model.problem, model.problem.contacts
    stepper = ImplicitStepper(problem, ImplicitOptions())
    stiff, evaluate, seen = term.penalty.copy(), ContactTerm.evaluate, []

    def fails_softened(self, x, dt, mode):
        trial = evaluate(self, x, dt, mode)
        if mode.penalty_scale == 1.0 and mode.interior is None:
            return trial
        if isinstance(mode.interior, SoftenedPoint):
            seen.append(mode.interior.softness)
        return replace(trial, traction=np.nan * trial.traction)

    model.set_loads(0.5, 0.0)
    with monkeypatch.context() as patch:
        fail_predicted_starts(patch)
        patch.setattr(ContactTerm, "evaluate", fails_softened)
        assert not stepper.attempt(0.5).converged
    assert set(seen) == {SOFT}
    np.testing.assert_array_equal(term.penalty, stiff)
    assert stepper.attempt(0.5).converged
    whole = term.evaluate(stepper.trial, 0.5)
    assert whole is problem.trials[0] and whole.penalty_scale == 1.0
    soft = term.evaluate(
        stepper.trial, 0.5, *StepMode().with_penalty_scale(problem.contacts, 0.1).modes
    )
    assert soft.penalty_scale == 0.1
    np.testing.assert_array_equal(term.penalty, stiff)
    np.testing.assert_allclose(soft.pressure, 0.1 * whole.pressure, rtol=1e-14)


def test_a_force_finds_the_other_body_from_the_first_touch():
    """Nothing is closed at the start, and no support holds the cylinder up."""
    data = tomllib.loads(CYLINDER)
    data["boundary"][1] = {
        "surface": "top",
        "displacement": {"x": 0},
        "platen": {"direction": "y", "force": [["0 s", "0 N"], ["1 s", "0.05 N"]]},
    }
    sim = solved(data)
    assert [row.attempts for row in sim.rows] == [1, 1]
    assert [row.normal_resultant for row in sim.rows] == pytest.approx([0.025, 0.05], rel=1e-6)
    # None of the pull is left in the solution.
    (term,), (trial,) = sim.model.problem.contacts, sim.model.problem.trials
    assert trial.penalty_scale == 1.0
    np.testing.assert_array_equal(trial.traction[trial.pressure == 0.0], 0.0)
    depth = np.maximum(-trial.nodal_gap, 0.0)
    np.testing.assert_allclose(trial.nodal_pressure, term.penalty * depth, rtol=1e-12)


def aligned(**contact):
    """Meshes that line up: some slave points lie exactly on edges between master facets."""
    data = tomllib.loads(BOXES)
    data["geometry"]["upper"]["elements"] = [5, 2, 5]
    data["geometry"]["lower"] |= {"width": 2e-3, "depth": 2e-3, "elements": [8, 2, 8]}
    data["bodies"]["elastomer"]["nu"] = 0.45
    data["boundary"][1]["platen"]["pressure"] = [[0.0, 0.0], [1.0, 0.3e6]]
    data["contact"][0] |= contact
    data["solver"] = {"tolerance": 1e-10}
    return solved(data)


def test_points_on_edges_of_the_master_do_not_stop_the_iteration():
    """Pushed to and fro between two facets, they kept the residual at 1e-8 and steps were cut."""
    sim = aligned()
    assert [row.attempts for row in sim.rows] == [1, 1, 1]
    assert sum(row.newton_iterations for row in sim.rows) <= 28
    last = sim.rows[-1]
    assert last.normal_force == pytest.approx(0.3, rel=1e-6)
    # Staying a little past an edge changes nothing that counts.
    smooth = aligned(smoothing_angle="10 deg").rows[-1]
    assert last.tangential_force == pytest.approx(smooth.tangential_force, rel=1e-6)
    # Nothing of it is left for the next step.
    (term,) = sim.model.problem.contacts
    again = term.evaluate(sim.implicit.stepper.x, 1.0)
    points, nodes = again.position, term.surface.master.position
    nodes = nodes + term.surface.gather(sim.implicit.stepper.x)[term.surface.first_master :]
    closest = term.surface.project(points, nodes)
    np.testing.assert_array_equal(again.projection.facet, closest.facet)


FREE = """
bodies = { strip = { material = "neo-hookean", E = "5 MPa", nu = 0.3 } }
stage = [
 { name = "pull", duration = "1 s", steps = 1 },
 { name = "free", duration = "1 s", steps = 2 },
]
[geometry]
kind = "blocks"
blocks = { strip = { x = [0, 2e-3], y = [0, 1e-3], elements = [4, 2] } }
[[boundary]]
surface = "strip_left"
displacement = { x = 0, y = 0 }
stages = ["pull"]
[[boundary]]
surface = "strip_right"
displacement = { x = [["0 s", 0], ["1 s", "0.1 mm"]] }
stages = ["pull"]
"""


@pytest.mark.parametrize(("pressed", "floating"), [(True, ()), (False, ("strip",))])
def test_a_restored_stepper_knows_what_pressed_and_what_floated(pressed, floating):
    """The next step begins as it would have: soft where nothing pressed, held where it floated."""
    case = Case.model_validate(tomllib.loads(CYLINDER if pressed else FREE))
    simulation = Simulation(build_model(case, MPI.COMM_SELF))
    simulation.run(Observer())
    stepper, layout = simulation.stepper, Layout(simulation.model)
    kept = layout.scatter(*layout.gather(stepper.snapshot()))
    assert (kept["pressed"], tuple(kept["floating"])) == (pressed, floating)
    restored = ImplicitStepper(simulation.model.problem, stepper.options)
    restored.restore(kept)
    again = restored.snapshot()
    assert (again["pressed"], tuple(again["floating"])) == (pressed, floating)
    tried = [one.attempt(0.1) for one in (stepper, restored)]
    assert tried[0].converged and tried[1].converged
    assert tried[0].iterations == tried[1].iterations
    assert tried[0].floating == tried[1].floating == floating


def test_no_state_of_an_attempt_is_evaluated_twice_in_turn(monkeypatch):
    """Neither where the prediction ends, nor where Newton's method begins or asks for a tangent."""
    evaluate, asked = ContactTerm.evaluate, []

    def noted(term, x, dt, mode):
        asked.append((x.array_r.tobytes(), term.state, mode))
        return evaluate(term, x, dt, mode)

    monkeypatch.setattr(ContactTerm, "evaluate", noted)
    sim = pressed()
    assert len(asked) > sum(row.newton_iterations for row in sim.rows) > 0
    pairs = itertools.pairwise(asked[2:])  # the first two are made with the equations
    assert not [one[2] for one, other in pairs if one[0] == other[0] and one[1:] == other[1:]]


@pytest.mark.parametrize("floated", [False, True])
def test_a_failed_attempt_says_only_of_what_floated_before_that_nothing_holds_it(
    monkeypatch, floated
):
    """Where an iteration ended that led away from all contacts is no equilibrium without them."""
    simulation = Simulation(build_model(Case.model_validate(tomllib.loads(FREE)), MPI.COMM_SELF))
    simulation.run(Observer())
    stepper = simulation.stepper
    if not floated:  # as if something had pressed at the last converged step, and not where it ends

        def pressed_before(_weak, _largest, trials=None):
            return ["strip"] if trials is None else []

        monkeypatch.setattr(type(stepper._weak), "floating", pressed_before)

    def lost(attempt):
        attempt.newton.strayed = True
        attempt.newton.residual_of(attempt.step)
        return 1, -6

    monkeypatch.setattr(stepper_module, "solve", lost)
    tried = stepper.attempt(0.1)
    assert not tried.converged and stepper._weak.floating(stepper.newton.largest_force) == ["strip"]
    assert tried.floating == (("strip",) if floated else ())
    assert ("no contact holds body strip" in reason_of(tried)) is floated


def test_what_found_the_last_hard_step_comes_first_in_the_next():
    inside, newton = FromInside(), Inside()
    problem = SimpleNamespace(
        flows=False, comm=MPI.COMM_SELF, contacts=[], constrained_values=lambda x: x.array_r
    )
    attempt = SimpleNamespace(
        has_contacts=True,
        pressed=True,
        failures=0,
        step=SimpleNamespace(holding=None),
        bodies=SimpleNamespace(directions=()),
        predictor=SimpleNamespace(rubbing=lambda: False),
        x=SimpleNamespace(array_r=np.zeros(2)),
        newton=SimpleNamespace(
            is_bounded=False, is_near=lambda within: False, problem=problem, inside=newton
        ),
    )
    assert phases_after(attempt, inside) == (inside, SoftContact())
    newton.softly = True
    assert phases_after(attempt, inside) == (SoftContact(), inside)
