"""Columns of a row that depend on how the run came there."""

import re
import tomllib

import pytest
from mpi4py import MPI

from tests.app.conftest import BOXES
from tests.app.read_log import read_log
from tribox.app.case.case import Case
from tribox.app.results import read
from tribox.app.run.run import run_case
from tribox.app.simulation.history import time_text
from tribox.app.simulation.run_state import CALM, Position


@pytest.mark.parametrize("ramp", ["0 s", "40 ms"])
def test_viscosity_goes_with_the_speed_within_a_ramp(tmp_path, film, ramp):
    """Past V* the film alone carries T = η_b v/D, v being the speed at which the layer slips."""
    data = tomllib.loads(film)
    slide = {"name": "slide", "velocity": "4 mm/s", "duration": "40 ms", "steps": 8, "ramp": ramp}
    data["stage"][1:] = [slide]
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    found = read(tmp_path / "out")
    before, row = found.history.iloc[-5], found.history.iloc[-4]  # half way up
    assert row["viscous_fraction"] == 1.0
    speed = (row["driven_displacement"] - before["driven_displacement"]) / row["dt"]
    eta = found.case.contact[0].friction.eta_b * row["area_ratio"] * row["slip_speed"] / speed
    assert row["effective_viscosity"] == pytest.approx(eta, rel=1e-3)
    assert found.contacts["effective_viscosity"].iloc[-4] == row["effective_viscosity"]


def test_components_that_are_each_driven_go_faster_together(tmp_path, film):
    """Both with the velocity of the stage: the layer slips √2 times as fast, and V says so."""
    friction = tomllib.loads(film)["contact"][0] | {"pressure": "averaged"}
    data = tomllib.loads(BOXES)
    data["geometry"]["upper"]["elements"] = [2, 1, 2]
    data["geometry"]["lower"]["elements"] = [3, 1, 3]
    data["contact"][0] |= {key: friction[key] for key in ("film", "friction")}
    data["boundary"][1]["displacement"] = {"x": "driven", "z": "driven"}
    data["stage"][1] = {"name": "slide", "velocity": "4 mm/s", "duration": "40 ms", "steps": 2}
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    found = read(tmp_path / "out")
    row = found.history.iloc[-1]
    assert row["viscous_fraction"] == 1.0
    eta = found.case.contact[0].friction.eta_b * row["area_ratio"]
    assert row["slip_speed"] == pytest.approx(4e-3 * 2.0**0.5, rel=0.1)
    shared = eta * row["slip_speed"] / (4e-3 * 2.0**0.5)
    assert row["effective_viscosity"] == pytest.approx(shared, rel=1e-2)


def test_rounding_has_no_friction_coefficient(tmp_path, block):
    """A body that is lifted until only rounding presses."""
    data = tomllib.loads(block)
    data["boundary"][1]["displacement"]["y"] = [["0 s", "0 mm"], ["1 s", "1e-19 m"]]
    data["boundary"][1]["displacement"]["x"] = [["1 s", "0 mm"], ["2 s", "1e-15 m"]]
    data["stage"][1]["steps"] = 1
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    found = read(tmp_path / "out")
    assert found.history["friction_coefficient"].tolist() == [0.0] * 4
    assert found.contacts["friction_coefficient"].tolist() == [0.0] * 4
    assert not [w for w in found.summary["warnings"] if "balanced" in w or "add up" in w]


def test_where_nothing_is_driven_the_log_tells_the_speed_of_what_moves(tmp_path, block):
    """Pressed by 50 um and drawn by tables, then held, then driven; and nothing is 0 m/s."""
    data = tomllib.loads(block)
    data["boundary"][1]["displacement"]["x"] = "driven"
    data["stage"] = [
        {"name": "press", "duration": "1 s", "steps": 2},
        {"name": "hold", "duration": "1 s", "steps": 1},
        {"name": "slide", "duration": "1 s", "steps": 1, "velocity": "0.1 mm/s"},
        {"name": "stop", "duration": "1 s", "steps": 1, "velocity": "0 m/s"},
    ]
    run_case(Case.model_validate(data), tmp_path / "out", quiet=True, comm=MPI.COMM_SELF)
    log = read_log(tmp_path / "out").splitlines()
    found = [re.search(r"  V (\S+) m/s  N ", line) for line in log if line.startswith("step ")]
    assert [one and one[1] for one in found] == ["5e-05", "5e-05", None, "0.0001", None]
    velocity = read(tmp_path / "out").history["velocity"]
    assert velocity[:3].isna().all() and velocity[3:].tolist() == [1e-4, 0.0]


# -- Times in messages tell steps apart, however short these are beside the time -------------------


@pytest.mark.parametrize(
    ("time", "dt", "text"),
    [
        (0.1, 0.1, "0.1 s"), (1.0 / 3.0, 0.1, "0.333333 s"), (0.100000001, 1e-9, "0.100000001 s"),
        (1234.5678901, 1e-4, "1234.56789 s"), (0.0, 1e-9, "0 s"), (2.5, 0.0, "2.5 s"),
        (2.5, float("inf"), "2.5 s"),
    ],
)  # fmt: skip
def test_digits_follow_from_the_step(time, dt, text):
    assert time_text(time, dt) == text


def test_steps_after_one_that_was_cut_begin_in_its_pieces_and_become_longer_again():
    at, tried = Position(), []
    at.begin(0.0, 0.0, 0)
    at.piece, at.calm = 0.25, 0  # what a cut of a cut leaves
    for _ in range(2 * CALM + 1):
        at.end_step(0.01)
        tried.append(at.piece)
    assert tried == (CALM - 1) * [0.25] + CALM * [0.5] + 2 * [1.0]
    at.piece = 0.0625
    at.end_step(0.05)
    assert at.piece == 0.5  # from which a step may be cut three times
    at.piece, at.begun = 0.25, False
    at.begin(1.0, 0.0, 9)  # another stage
    assert at.piece == 1.0
