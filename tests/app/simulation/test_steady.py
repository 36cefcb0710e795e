"""Steadiness is judged by slip distances: synthetic rows, and a layer on a plateau of friction."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI

from tests.laws import coulomb
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation
from tribox.app.simulation.steady import SlidWay
from tribox.forms.closed_forms import steady_traction
from tribox.forms.friction.return_mapping import SlipWeakening

STIFFNESS = 2e6  # N/m, of the bodies in shear
LOAD = 10.0  # N
PRESLIDING = 2e-7  # m
TOLERANCE = 1e-4
COULOMB = coulomb(0.1, 1e12)


class Telling:
    """What a weakening law says of itself; the numbers themselves are given row by row."""

    settling_slip = 0.0

    def __init__(self, slip: float) -> None:
        self.settling_slip = slip

    def unsettled(self, state, pressure):
        return pressure


class Half:
    """A law that knows a slip but not its end."""

    def __init__(self, slip: float) -> None:
        self.settling_slip = slip


def weakening_rows(friction: SlipWeakening, step: float, end: float):
    """Way, force and what is left of it, of a spring that drags a load with weakening friction."""
    way = np.arange(1, round(end / step) + 1) * step
    force = np.minimum(STIFFNESS * way, friction.mu_s * LOAD)
    path = np.zeros_like(way)
    for _ in range(60):  # way = path + force/stiffness
        slides = STIFFNESS * way > friction.mu_s * LOAD
        path = np.where(slides, np.maximum(way - force / STIFFNESS, 0.0), 0.0)
        force = np.where(slides, friction.coefficient(path) * LOAD, force)
    return way, force, friction.above_end(path) * LOAD


def steady_after(rows, law, tolerance=TOLERANCE, before=()):
    """Way at which rows are steady for the first time; None if never."""
    record = SlidWay([law])
    for driven, force in before:
        record.add(driven, force, 0.0, PRESLIDING)
    offset = before[-1][0] if before else 0.0
    for way, force, left in zip(*rows, strict=True):
        record.add(offset + way, force, left, PRESLIDING)
        if record.judge(len(before), tolerance).steady:
            return float(way)
    return None


@pytest.mark.parametrize(("A_d", "B"), [(5e-6, 1e5), (5e-6, 1e7), (5e-5, 2e6), (0.0, 1e6)])
def test_a_plateau_is_steady_when_weakening_is_over_whatever_the_step(A_d, B):
    friction = SlipWeakening(mu_s=0.2, mu_d=0.1, A_d=A_d, B=B)
    settled = friction.settling_slip(1e-3 * friction.mu_d)
    end = min(1.2 * settled, 8e-4)
    found = []
    for step in (5e-7, 1e-6, 2e-6):
        rows = weakening_rows(friction, step, end)
        way = steady_after(rows, Telling(settled))
        found.append(way)
        if way is not None:
            force = rows[1][np.argmin(np.abs(rows[0] - way))]
            assert force / (friction.mu_d * LOAD) - 1.0 < 1.1e-3
    if settled > end:
        assert found == [None, None, None]
    else:
        assert None not in found
        assert max(found) - min(found) <= 2e-6 * (1.0 + 1e-9)


def test_a_law_that_knows_only_a_slip_must_keep_its_force_over_that():
    friction = SlipWeakening(mu_s=0.2, mu_d=0.1, A_d=2e-5, B=1e8)
    way, force, _ = weakening_rows(friction, 1e-6, 2e-4)
    rows = way, force, np.zeros_like(way)
    assert steady_after(rows, COULOMB) < 2e-5  # says nothing: the plateau passes for the end
    found = steady_after(rows, Half(6e-5))
    assert found is not None and found > 2e-5 + 6e-5
    assert steady_after(rows, Half(3e-4)) is None


def test_fresh_points_that_keep_coming_count_when_the_force_stays():
    # Rolling: friction has still to lose 5 % at the points that happen to be pressed, for ever.
    way = np.arange(1, 101) * 1e-6
    rows = way, np.minimum(STIFFNESS * way, 1.0), np.full_like(way, 0.05)
    assert steady_after(rows, Telling(np.inf)) is None
    found = steady_after(rows, Telling(4e-5))
    assert found is not None and found >= 4e-5


@pytest.mark.parametrize("step", [1e-10, 1e-8, 1e-6])
def test_what_still_sticks_is_never_steady(step):
    way = np.arange(1, 201) * step
    rows = way, STIFFNESS * way, np.zeros_like(way)
    assert steady_after(rows, COULOMB) is None


@pytest.mark.parametrize("step", [1e-9, 1e-7, 1e-6])
def test_a_film_that_builds_up_its_drag_is_steady_at_its_end_only(step):
    # The first velocity dragged with 0.1 N; the second drags with 1 N in the end.
    before = [(k * 1e-7, min(STIFFNESS * k * 1e-7, 0.1)) for k in range(1, 10)]
    end, length = 1.0, 1.0 / STIFFNESS
    way = np.arange(1, 1000) * step
    force = end - 0.9 * np.exp(-way / length)
    found = steady_after((way, force, np.zeros_like(way)), COULOMB, before=before)
    if way[-1] < 5.0 * length:
        assert found is None
    else:
        assert np.exp(-found / length) < 2e-4
        assert found < 20.0 * max(length, step)


def test_a_slow_tail_is_caught():
    way = np.geomspace(1e-6, 1e-2, 400)
    force = 1.0 + 1e-6 / way
    found = steady_after((way, force, np.zeros_like(way)), COULOMB)
    assert 1e-6 / found < 7.0 * TOLERANCE


def test_dry_friction_at_the_next_velocity_is_steady_at_once():
    before = [(k * 1e-6, min(STIFFNESS * k * 1e-6, 1.0)) for k in range(1, 10)]
    way = np.array([1e-6, 2e-6])
    assert steady_after((way, np.ones(2), np.zeros(2)), COULOMB, before=before) == 1e-6
    back = np.array([-1e-6, -2e-6, -3e-6, -4e-6])
    force = np.array([-0.2, -1.0, -1.0, -1.0])
    found = steady_after((back, force, np.zeros(4)), COULOMB, before=before)
    assert found == -3e-6


@pytest.mark.parametrize(("presliding", "steady"), [(1e-6, False), (1e-8, True)])
def test_a_force_must_stay_over_the_pre_sliding_length(presliding, steady):
    """It falls by 0.75 of the tolerance over an eighth of the way, by three over the length."""
    way = np.linspace(0.0, 2e-6, 41)[1:]
    force = 1.0 - 3e-4 * (way - way[-1]) / 1e-6
    record = SlidWay([COULOMB])
    record.add(1e-12, force[0], 0.0, presliding)  # at once: no length but the pre-sliding one
    for at, value in zip(way, force, strict=True):
        record.add(at, value, 0.0, presliding)
    assert record.judge(0, TOLERANCE).steady is steady


def test_nothing_slid_is_not_steady_and_reasons_are_given():
    record = SlidWay([Telling(1.0)])
    assert not record.judge(0, 1.0).steady
    record.add(1e-6, 1.0, 0.02, PRESLIDING)
    assert "friction has still to change by 0.02 of" in record.judge(0, 1e-4).reason
    record.add(2e-6, 2.0, 0.0, PRESLIDING)
    assert "changes by 1 of itself in 2e-06 m" in record.judge(0, 1e-4).reason


def slid(film: str, control: str, step: float, end: float):
    """Verdict and relative distance from the end, of a flat block with friction on a plateau."""
    data = tomllib.loads(film)
    data["geometry"]["upper"]["elements"] = [4, 1]
    data["geometry"]["lower"]["elements"] = [7, 1]
    data["contact"][0]["friction"] |= {"A_d": 2e-5, "B": 1e7}
    if control == "displacement":
        pressed = {"x": "driven", "y": [["0 s", "0 mm"], ["1 s", "-1 um"]]}
        data["boundary"][1] = {"surface": "top", "displacement": pressed}
    data["stage"][1] |= {"velocities": [1e-5], "slip_step": step, "max_steps": round(end / step)}
    verdicts = []

    class Verdict(Observer):
        def load_step(self, simulation, load_step, row, steady):
            verdicts.append((steady, row))

    case = Case.model_validate(data)
    Simulation(build_model(case, MPI.COMM_SELF)).run(Verdict())
    steady, row = verdicts[-1]
    law, area = case.contact[0].friction.parameters(), row.contact_area
    tends = area * steady_traction(1e-5, 30e-9, row.normal_force / area, law.mu_dynamic, law)
    return steady, row.tangential_force / tends - 1.0, row.driven_displacement


@pytest.mark.parametrize(("control", "steps"), [("force", (2e-6, 4e-6)), ("displacement", (4e-6,))])
def test_a_layer_on_a_plateau_of_friction_is_not_steady(film, control, steps):
    for step in steps:
        steady, off, _ = slid(film, control, step, 2e-5)
        assert not steady and off > 0.1
        steady, off, way = slid(film, control, step, 1e-4)
        assert steady and abs(off) < 5e-3
        assert way < 5e-5
