"""What is said of ends and facets of masters: which, where, and only where it can be the cause."""

import tomllib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tests.laws import coulomb
from tribox.app.case.case import Case
from tribox.app.implicit.stepper import StepResult
from tribox.app.run.run import run_case
from tribox.app.simulation.failure_diagnosis import explain
from tribox.app.simulation.surface_ends import ends_text
from tribox.app.simulation.surface_faults import _deepest

LAW = coulomb(0.2)
NAMES = [SimpleNamespace(slave="pad", master="strip")]
PAD = Path(__file__).parents[3] / "cases" / "forming" / "pad.toml"
FAR = StepResult(False, 30, 30, -5, [0.3])  # a residual far from zero


def bent(amount):
    """A motion of the lower block: its top becomes a parabola."""

    def motion(x):
        y = -0.01 - amount * (x[:, 0] - 1.0) ** 2
        return np.stack([0.0 * y, y], axis=1)

    return motion


@pytest.mark.parametrize(("amount", "said"), [(0.2, True), (0.0, False)])
def test_facets_of_a_bent_master_are_named_where_the_residual_is(pair, amount, said):
    """The upper block overlaps the lower one's middle; flat facets catch nothing."""
    made = pair(upper=(5, 2), lower=(10, 2))
    problem = made.problem(LAW)
    x = made.displaced(lambda x: x * 0.0 + [0.03, -0.05], bent(amount))
    problem.residual(None, x, problem.new_vector())
    assert abs(problem.worst_place()[1]) < 1e-12  # on the interface
    text = explain(problem, FAR, x, [], contacts=NAMES)
    assert ("contact.0: pad catches on the facets of strip, which meet at up to" in text) is said
    assert ('try smoothing_angle = "30 deg" for contact.0, or a tenth of' in text) is said
    assert ("a finer mesh, or a tenth of the penalty (" in text) is not said
    assert ("where bodies may have snapped, a stage of dynamics" in text) is not said


@pytest.mark.parametrize(("amount", "said"), [(0.2, True), (0.005, False)])
def test_facets_may_be_the_cause_where_the_residual_is_elsewhere(pair, amount, said):
    """A node inside the upper block is out of its place by far more; only clear angles count."""
    made = pair(upper=(5, 2), lower=(10, 2))
    problem = made.problem(LAW)
    x = made.displaced(lambda x: x * 0.0 + [0.03, -0.05], bent(amount))
    where = made.u.function_space.tabulate_dof_coordinates()
    inside = np.nonzero(np.isclose(where[:, 1], 0.25) & np.isclose(where[:, 0], 0.67))[0]
    x.array[2 * inside] += 0.1
    problem.residual(None, x, problem.new_vector())
    assert problem.worst_place()[1] > 0.2
    text = explain(problem, FAR, x, [], contacts=NAMES)
    assert ("pad may catch on the facets of strip" in text) is said
    assert ('smoothing_angle = "30 deg" for contact.0' in text) is said


@pytest.mark.parametrize(
    ("shift", "spread", "where"),
    [(1.2, 0.0, "(2, 0) m"), (-1.2, 0.0, "(0, 0) m"), (0.03, 2.0, "(0, 0) m and (2, 0) m")],
)
def test_ends_are_told_by_where_they_are_undeformed(pair, shift, spread, where):
    """The lower block is 2 long; the upper one hangs over its right end, its left, or both."""
    made = pair()
    problem = made.problem(LAW)
    x = made.displaced(
        lambda x: np.stack([shift + spread * (x[:, 0] - 1.0), 0.0 * x[:, 0] - 0.01], axis=1),
        lambda x: x * 0.0,
    )
    problem.residual(None, x, problem.new_vector())
    [trial], [term] = problem.trials, problem.contacts
    off = ~trial.projection.on_surface
    assert off.any() and ends_text(term.surface, trial.projection, off) == where


def begun(directory, smoothing_angle=None):
    """The first three steps of a rubber pad that bends a strip, both coarse, on two attempts."""
    data = tomllib.loads(PAD.read_text(encoding="utf-8"))
    data["geometry"]["blocks"]["strip"]["elements"] = [30, 2]
    data["geometry"]["blocks"]["pad"]["elements"] = [21, 5]
    for key in ("smoothing_angle", "film"):
        del data["contact"][0][key]
    data["contact"][0]["friction"] = {"law": "coulomb", "mu": 0.1}
    if smoothing_angle:
        data["contact"][0]["smoothing_angle"] = smoothing_angle
    data["stage"] = [{"name": "press", "duration": 0.15, "steps": 3}]
    data |= {
        "solver": {"min_step_fraction": 0.4, "max_iterations": 15},
        "output": {"figures": False, "fields_every": 0},
    }
    del data["probe"]
    return run_case(Case.model_validate(data), directory, quiet=True)


@pytest.mark.long
def test_a_pad_that_catches_on_the_strip_it_bends_is_brought_over_its_facets(tmp_path):
    """On facets as on the smooth surface, with nearly the same force."""
    faceted, smooth = begun(tmp_path / "faceted"), begun(tmp_path / "smooth", "30 deg")
    assert faceted.rows[-1].time == smooth.rows[-1].time == pytest.approx(0.15)
    assert faceted.rows[-1].normal_force == pytest.approx(smooth.rows[-1].normal_force, rel=0.05)


def test_depth_of_a_sunk_vertex_counts_by_its_piece_whichever_corner_comes_first():
    """In a triangle of 10 by 1 m and 0.1 m deep: over the shortest side."""
    corners = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    inside, down = np.array([[2.0, 0.3, -0.1]]), np.array([[0.0, 0.0, -1.0]])
    for first in range(3):
        found = _deepest(np.roll(corners, first, axis=0)[None], inside, down, inside, 0.0, 0.0)
        assert found.share == pytest.approx(0.1)
