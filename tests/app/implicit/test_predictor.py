"""Where the Newton iteration starts, and what the tangent factorised last is good for."""

import copy
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tribox.app.implicit.predictor
from tests.app.conftest import BLOCK
from tests.solved import built
from tribox.app.case.stage import load_steps_of
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit.predictor import Predictor, lagrange_weights
from tribox.app.simulation.run_state import Observer
from tribox.forms.friction.law import Regime


def test_extrapolation_is_exact_for_a_cubic_on_uneven_parameters():
    nodes, at = np.array([0.0, 0.3, 1.1, 1.5]), 2.2

    def cubic(s):
        return 2.0 - s + 0.5 * s**2 - 3.0 * s**3

    weights = lagrange_weights(nodes, at)
    assert weights @ cubic(nodes) == pytest.approx(cubic(at), rel=1e-12)
    assert weights.sum() == pytest.approx(1.0)
    assert lagrange_weights(np.array([0.0, 1.0]), 1.5) == pytest.approx([-0.5, 1.5])


def simulation(**changes):
    data = tomllib.loads(BLOCK)
    for key, value in changes.items():
        data["stage"][1][key] = value
    return built(data)


class Results(Observer):
    """Keeps what it is told of the steps."""

    def __init__(self):
        self.results = []

    def step(self, simulation, row, result):
        self.results.append(result)


def run(sim):
    seen = Results()
    sim.run(seen)
    return seen.results


@pytest.fixture(scope="module")
def whole():
    """A run with all parts of the predictor, and the results of its steps."""
    sim = simulation(steps=12)
    return sim, run(sim)


def test_gross_sliding_takes_one_factorisation_a_step(whole):
    sim, results = whole
    pairs = zip(results, sim.rows, strict=True)
    gross = [result for result, row in pairs if row.stick_fraction == 0.0]
    assert len(gross) >= 5
    assert all(result.factorisations == 1 for result in gross[2:])
    assert sim.stepper.solver.assembled == sum(result.factorisations for result in results)


@pytest.mark.parametrize("without", ["_correct", "_extrapolate", "continue"])
def test_prediction_saves_iterations_and_changes_no_result(whole, monkeypatch, without):
    """Each part of the predictor is worth iterations; the forces are the same without it."""
    whole, _ = whole
    if without == "_correct":
        monkeypatch.setattr(Predictor, "_correct", lambda self, trial, norm, times, step: norm)
    elif without == "_extrapolate":
        monkeypatch.setattr(Predictor, "_extrapolate", lambda self, trial, ratio, step: np.inf)
        monkeypatch.setattr(Predictor, "_correct", lambda self, trial, norm, times, step: norm)
    else:
        monkeypatch.setattr(Predictor, "_continue", lambda self, x, trial, ratio, step: None)
    part = simulation(steps=12)
    run(part)
    spent = [sum(row.newton_iterations for row in sim.rows) for sim in (whole, part)]
    assert spent[0] < spent[1]
    for a, b in zip(whole.rows, part.rows, strict=True):
        assert a.normal_force == pytest.approx(b.normal_force, rel=1e-6)
        assert a.tangential_force == pytest.approx(b.tangential_force, rel=1e-6, abs=1e-8)


def test_the_path_is_continued_through_uneven_steps():
    """Pressing in steps of other lengths: the extrapolation knows how long each one is."""
    data = tomllib.loads(BLOCK)
    data["stage"] = [
        {"name": f"press {i}", "duration": f"{length} s", "steps": 1}
        for i, length in enumerate((0.1, 0.1, 0.2, 0.05, 0.3, 0.25))
    ]
    results = run(built(copy.deepcopy(data)))
    # Increments repeated without regard to their lengths would start from a third of the force.
    assert all(result.residuals[0] < 2e-2 for result in results[3:]), [
        result.residuals[0] for result in results
    ]


def pressed(sim=None):
    """The small block after its first stage."""
    sim = sim or simulation()
    for load_step in load_steps_of(sim.model.case.stage[0], None, 0.0):
        sim.state.run(load_step, Observer(), sim.implicit.advance)
    return sim


def test_a_body_that_sticks_is_not_predicted_to_slide(monkeypatch):
    """A good start costs one factorisation; where both are tried, the better one stays."""
    sim = pressed()
    stepper = sim.implicit.stepper
    sim.model.set_loads(1.001, 1.5e-7)
    trial = stepper.problem.new_vector()
    assert stepper.predictor.predict(stepper.x, trial) == 1
    start = trial.array_r.copy()
    monkeypatch.setattr(tribox.app.implicit.predictor, "FAR_OFF", 0.0)
    assert stepper.predictor.predict(stepper.x, trial) == 2
    np.testing.assert_array_equal(trial.array_r, start)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_supports_that_move_by_rounding_lead_nowhere(sign):
    """What is let go is unloaded, whichever way round-off moves the supports."""
    predictor = pressed().implicit.stepper.predictor
    last = predictor._drive
    assert predictor._goes_on(last)
    assert not predictor._goes_on(replace(last, constrained=-0.1 * last.constrained))
    still = replace(last, constrained=sign * 1e-13 * last.constrained)
    assert not predictor._goes_on(still)


def test_sliding_start_moves_the_body_as_a_whole(monkeypatch):
    """The foot of the upper body moves by as much as its top, where friction would hold it."""
    sim = pressed()
    stepper, problem = sim.implicit.stepper, sim.model.problem
    sim.model.set_loads(2.0, 1.5e-4)
    trial = problem.new_vector()
    foot = np.unique(problem.contacts[0].surface.slave.nodes)

    def moved():
        return (trial.array_r - stepper.x.array_r).reshape(-1, 2)[foot, 0]

    assert stepper.predictor.predict(stepper.x, trial) == 2
    np.testing.assert_allclose(moved(), 1.5e-4, rtol=0.15)
    monkeypatch.setattr(Predictor, "rubbing", lambda self: False)
    assert stepper.predictor.predict(stepper.x, trial) == 1
    assert np.abs(moved() - 1.5e-4).max() > 0.5e-4


def test_a_platens_force_hides_nothing_that_a_linear_step_leaves():
    """What is left at nodes is small beside a force of all of them, more so on finer meshes."""
    data = tomllib.loads(BLOCK)
    del data["boundary"][1]["displacement"]["y"]
    data["boundary"][1]["platen"] = {
        "direction": "y",
        "pressure": [["0 s", "0 MPa"], ["1 s", "0.2 MPa"]],
    }
    sim = pressed(built(data))
    predictor, x = sim.implicit.stepper.predictor, sim.implicit.stepper.x
    found = []
    for way in (0.05, 0.06):  # mm: 1.9 and 2.5 times the forces at nodes, .33 and .44 of the sum
        sim.model.set_loads(1.0 + way / 0.15, 0.0)
        found.append(predictor.predict(x, sim.model.problem.new_vector()))
    assert found == [1, 2]


def test_friction_as_load_has_no_stiffness_and_only_in_its_mode():
    sim = pressed()
    problem, x = sim.model.problem, sim.implicit.stepper.x
    force, same = problem.new_vector(), problem.new_vector()

    def stiffness():
        return np.abs(problem.trials[0].response.d_traction_d_slip).max()

    problem.residual(None, x, force)
    assert stiffness() > 0.0
    assert np.abs(problem.trials[0].response.traction).max() > 0.0
    problem.residual(None, x, same, StepMode().with_friction_as_load(problem.contacts))
    assert stiffness() == 0.0
    np.testing.assert_array_equal(same.array_r, force.array_r)
    problem.residual(None, x, same)
    assert stiffness() > 0.0


def test_points_on_flat_edges_hold_no_body_that_slides():
    """Middle points of a row of slave facets lie on master edges, to rounding."""
    data = tomllib.loads((Path(__file__).parents[3] / "cases" / "boxes-3d.toml").read_text())
    data["geometry"]["upper"]["elements"] = [5, 2, 4]
    data["geometry"]["lower"]["elements"] = [10, 2, 9]
    data["stage"][0]["steps"] = 1
    sim = pressed(built(data))
    problem, x = sim.model.problem, sim.implicit.stepper.x
    gliding = StepMode().with_friction_as_load(problem.contacts)
    moved, force = problem.new_vector(), problem.new_vector()
    problem.residual(None, x, force, gliding)
    trial = problem.trials[0]
    assert np.any(trial.projection.clamped & trial.kinematics.closed)
    tangent = problem.new_matrix(x)
    problem.assemble_tangent(x, tangent, gliding)
    foot = np.unique(problem.contacts[0].surface.slave.nodes)
    upper = problem.unknowns.node_places()[:, 1] > 1e-9
    upper[foot] = True
    moved.array.reshape(-1, 3)[upper, 0] = 1.0
    tangent.mult(moved, force)
    against = np.abs(force.array_r.reshape(-1, 3)[foot, 0]).max()
    assert against < 1e-6 * tangent.getDiagonal().array_r.reshape(-1, 3)[foot, 1].max()


@pytest.mark.parametrize(("states", "followed"), [([0, 1, 4, 9], True), ([0, 3, 6, 9], False)])
def test_a_path_along_a_curve_is_followed_though_all_contacts_open(
    whole, monkeypatch, states, followed
):
    """Contacts that pull tell how far off a start is; open ones bear next to nothing."""
    stepper = whole[0].stepper
    predictor, problem = copy.copy(stepper.predictor), stepper.problem
    x, free = problem.new_vector(), problem.owned - 1
    path = [np.append(np.zeros(free), state) for state in states]
    predictor.restore({**predictor.snapshot(), "at": np.arange(4.0), "path": path, "drive": None})
    monkeypatch.setattr(Predictor, "_proportion", lambda self, drive: 1.0)

    def left(self, trial, step):
        pulls = any(mode.adhesive_gap > 0.0 for mode in step.modes)
        return float(abs(trial.array_r[free] - 16.0)) if pulls else 1e9

    monkeypatch.setattr(Predictor, "_residual_norm", left)
    # The path has left the contacts open, after steps in which all points slid.
    assert all(np.all(t.response.regime == Regime.SLIP) for t in problem.committed)
    closed = np.zeros_like(problem.committed[0].kinematics.closed)
    monkeypatch.setattr(
        problem,
        "trials",
        [replace(t, kinematics=replace(t.kinematics, closed=closed)) for t in problem.committed],
    )
    monkeypatch.setattr(Predictor, "rubbing", lambda self: False)
    trial, step = problem.new_vector(), StepMode.of_stage(1.0, problem.contacts)
    took = predictor.predict(x, trial, step)
    assert (took == 0) is followed
    if followed:
        assert trial.array_r[free] == pytest.approx(16.0)
