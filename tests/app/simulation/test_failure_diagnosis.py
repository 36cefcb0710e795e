"""What a failed step is explained by, finding by finding, without a run."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI

from tests.laws import coulomb
from tests.solved import built
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.equilibrium.supports import loose_directions
from tribox.app.implicit.stepper import StepResult
from tribox.app.simulation.failure_diagnosis import explain, is_unstable, most_squeezed
from tribox.app.simulation.run_state import Observer

LAW = coulomb(0.2)


def test_a_residual_that_rounding_leaves_is_not_laid_on_anything_else(pair):
    bodies = pair()
    problem = bodies.problem(LAW)
    x = bodies.displaced(lambda x: x * 0.0 + [0.0, -0.01], lambda x: x * 0.0)
    problem.residual(None, x, problem.new_vector())
    noise = problem.roundoff / problem.reference_force
    loose = loose_directions(problem)
    for share, alone in ((1.5, True), (30.0, False)):
        problem.residual(None, x, problem.new_vector())
        text = explain(problem, StepResult(False, 30, 30, -5, [share * noise]), x, loose)
        assert ("rounding in body aluminium alone leaves a residual of up to" in text) is alone
        assert ("smaller steps" in text) is not alone


def test_numbers_that_overflow_are_said_to_turn_an_element_inside_out(pair):
    bodies = pair()
    problem = bodies.problem(LAW)
    x = bodies.displaced(lambda x: x * 0.0, lambda x: x * 0.0)
    tried = x.copy()
    tried.array[0] = np.nan
    problem.spread(tried)
    found = most_squeezed(problem)
    assert found.ratio == -np.inf and found.collapsed
    text = explain(problem, StepResult(False, 3, 3, -4, [0.5]), x, [])
    assert "is turned inside out by the last iteration" in text


@pytest.mark.parametrize("strayed", [True, False])
def test_a_first_step_that_failed_is_not_said_to_lack_contact(pair, strayed):
    """The bodies touch, and no step has been solved: what the iterations tried says nothing."""
    bodies = pair()
    held = [bodies.held("bottom", 0), bodies.held("bottom", 1), bodies.held("top", 1)]
    problem = bodies.problem(LAW, prescribed=held)
    result = StepResult(False, 30, 30, -5, [0.5], strayed=strayed)
    for depth, tried in ((0.01, True), (-0.01, False)):
        x = bodies.displaced(lambda x, d=depth: x * 0.0 + [0.0, -d], lambda x: x * 0.0)
        problem.residual(None, x, problem.new_vector())
        text = explain(problem, result, x, loose_directions(problem))
        assert "no contact presses on it" not in text
        assert ("elastomer has no support in x, and no step has been solved yet" in text) is (
            strayed or not tried
        )


@pytest.mark.parametrize(
    ("residual", "shift", "said"), [(3e-8, 0.03, True), (3e-8, 0.0, False), (0.3, 0.03, False)]
)
def test_a_residual_that_edges_of_the_master_keep_up_is_explained(pair, residual, shift, said):
    """Points in the middle of slave facets stand on nodes of the master, or 0.03 beside them."""
    made = pair(upper=(5, 2), lower=(10, 2))
    problem = made.problem(LAW)
    x = made.displaced(lambda x: x * 0.0 + [shift, -0.01], lambda x: x * 0.0)
    problem.residual(None, x, problem.new_vector())
    result = StepResult(False, 30, 30, -5, [residual])
    assert ("rest on edges between facets" in explain(problem, result, x, [])) is said


@pytest.mark.parametrize(("shift", "said"), [(0.03, True), (1e-5, False)])
def test_longer_steps_are_offered_where_all_slid_at_the_last_solved_step(pair, shift, said):
    made = pair()
    problem = made.problem(LAW)
    x = made.displaced(lambda x: x * 0.0 + [shift, -0.01], lambda x: x * 0.0)
    problem.residual(None, x, problem.new_vector())
    problem.commit()
    problem.residual(None, x, problem.new_vector())
    text = explain(problem, StepResult(False, 30, 30, -5, [0.3]), x, [])
    assert ("or longer steps where a load slides elastomer along, up to" in text) is said


@pytest.mark.parametrize(("strain", "said"), [(-0.05, True), (0.05, False), (-0.0005, False)])
def test_a_strut_past_its_buckling_load_is_told_to_snap(strain, said):
    """A strip clamped at both ends buckles from a strain of π² t²/(3 L²) = 0.002 on."""
    data = {
        "geometry": {
            "kind": "blocks",
            "blocks": {"strut": {"x": [0, 1.0], "y": [0, 0.025], "elements": [10, 1]}},
        },
        "bodies": {"strut": {"material": "neo-hookean", "E": 1e6, "nu": 0.0, "formulation": "q2"}},
        "boundary": [
            {"surface": f"strut_{side}", "displacement": {"x": 0, "y": 0}}
            for side in ("left", "right")
        ],
        "stage": [{"name": "press", "duration": 1}],
    }
    stepper = built(data).stepper
    problem, x = stepper.problem, stepper.trial
    at = problem.space.tabulate_dof_coordinates()
    x.array[::2] = strain * at[:, 0]
    x.array[1::2] = 1e-6 * at[:, 0] * (1.0 - at[:, 0])  # no more than noise for a direction
    unstable = is_unstable(stepper.solver, x, StepMode())
    assert unstable is said
    result = StepResult(False, 30, 30, -5, [0.5])
    text = explain(problem, result, stepper.x, [], unstable=lambda: unstable)
    assert ('([solver] kind = "explicit" with' in text) is said
    assert ("snaps through" in text) is said


RING = """
bodies.elastomer = { material = "neo-hookean", E = "5 MPa", nu = 0.45 }
bodies.aluminium = { material = "hencky", E = "70 GPa", nu = 0.33 }
boundary = [
 { surface = "bottom", displacement = { y = 0 } },
 { surface = "top", displacement = { y = 0 } },
 { surface = "elastomer_right", pressure = [["0 s", "0 MPa"], ["1 s", "0.1 MPa"]] },
]
stage = [{ name = "squeeze", duration = "1 s", steps = 1 }]
[geometry]
kind = "two-blocks"
section = "axisymmetric"
gap = "0.1 mm"
offset = "1 mm"
upper = { width = "2 mm", height = "1 mm", elements = [3, 2] }
lower = { width = "4 mm", height = "1 mm", elements = [5, 2] }
[[contact]]
slave = "elastomer_contact"
master = "aluminium_contact"
friction = { law = "coulomb", mu = 0.2 }
"""


def test_a_body_of_revolution_may_shrink_before_it_touches():
    """Its radial displacement is no drift: pressed from outside it is held by its hoop stress."""
    simulation = built(tomllib.loads(RING))
    assert {
        (one.body, one.component) for one in loose_directions(simulation.model.problem)
    } == set()
    simulation.run(Observer())
    assert simulation.rows[-1].normal_force == 0.0
    assert simulation.rows[-1].external_work > 0.0


def test_a_load_into_a_contact_does_not_lack_a_support(block):
    """A platen presses the upper body on the lower one, and no step has been tried yet."""
    data = tomllib.loads(block)
    data["boundary"][1] = {
        "surface": "top",
        "displacement": {"x": 0.0},
        "platen": {"direction": "y", "pressure": [[0.0, 0.4e6], [1.0, 0.4e6]]},
    }
    model = build_model(Case.model_validate(data), MPI.COMM_SELF)
    problem, result = model.problem, StepResult(False, 30, 30, -5, [0.5])
    loose = loose_directions(problem)
    said = {}
    for sign in (1.0, -1.0):
        model.set_loads(0.5, 0.0)
        problem.platens[0].force *= sign
        x = problem.new_vector()
        problem.residual(None, x, problem.new_vector())
        said[sign] = explain(problem, result, x, loose)
    assert "the load on body elastomer presses it on contact.0" in said[1.0]
    assert "try to bring the bodies together by displacement first" in said[1.0]
    assert "body elastomer has no support in y and no contact presses on it" in said[-1.0]
    assert "no support" not in said[1.0] and "presses it on" not in said[-1.0]
