"""Explicit dynamics against closed forms and against the implicit solution."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.solved import solved
from tests.two_blocks import press, pressed, two_blocks
from tribox.app.simulation.simulation import Simulation

FRICTIONLESS = {"law": "frictionless"}


def simulate(data: dict) -> Simulation:
    return solved(data | {"output": {"figures": False}})


def history(run: Simulation, name: str) -> np.ndarray:
    return np.array([getattr(row, name) for row in run.rows])


def motion(run: Simulation, body: str, name: str) -> np.ndarray:
    return run.state.motion.of_body(body, name)


# -- bars -----------------------------------------------------------------------------------------

G, K, RHO, LENGTH, SPEED, CELLS = 5e6, 10e6, 1100.0, 10e-3, 0.1, 100
WAVE = float(np.sqrt((K + 4.0 * G / 3.0) / RHO))  # m/s, of uniaxial strain
IMPEDANCE = RHO * WAVE  # Pa s/m
CROSSING = LENGTH / WAVE  # s
BAR = {"material": "neo-hookean", "G": G, "K": K, "density": RHO}
# Four times as stiff and 9/4 as heavy: three times the impedance, 4/3 of the wave speed.
OTHER = {"material": "neo-hookean", "G": 4 * G, "K": 4 * K, "density": 2.25 * RHO}


def bars(other: bool, cells: int = CELLS, **contact) -> Simulation:
    """A bar thrown along its length on a rigid wall, or on another bar at rest."""
    width = 2.0 * LENGTH / cells
    sides = ["elastomer_left", "elastomer_right"]
    lower = (2 * width, width, [2, 1])
    if other:  # as long in time
        lower = (width, LENGTH * 4 / 3, [2, cells])
        sides += ["aluminium_left", "aluminium_right"]
    wall = {"surface": "aluminium_contact", "displacement": {"x": 0, "y": 0}}
    data = two_blocks(
        ((width, LENGTH, [2, cells]), lower),
        ({**BAR, "velocity": {"y": -SPEED}}, OTHER if other else BAR),
        {"friction": FRICTIONLESS, **contact},
        [*({"surface": name, "displacement": {"x": 0}} for name in sides), *[wall] * (not other)],
        [{"name": "impact", "duration": 2.2 * CROSSING, "steps": 220}],
        solver={"kind": "explicit"},
    )
    if other:
        del data["boundary"][0]  # free to move on
    return simulate(data)


@pytest.mark.parametrize(("other", "pressure"), [(False, "averaged"), (True, "pointwise")])
def test_bars_meet_on_the_default_penalty(other, pressure):
    """90 M/h, or 30 point by point: dashpots keep the nodes from bouncing, and are paid for."""
    run = bars(other, 50, pressure=pressure)
    time, force = history(run, "time") / CROSSING, history(run, "normal_force")
    expected = (0.75 if other else 1.0) * IMPEDANCE * SPEED * 2.0 * LENGTH / 50
    plateau = (time > 0.2) & (time < 1.8)
    assert np.mean(force[plateau]) == pytest.approx(expected, rel=2e-3)
    assert np.std(force[plateau]) < 0.01 * expected  # 0.8 without them
    energy = 0.5 * RHO * SPEED**2 * LENGTH * 2.0 * LENGTH / 50
    assert np.max(np.abs(history(run, "energy_error"))) < 5e-3 * energy
    # The nodes at the surface, half an element of 50, stop; no more than that is lost.
    assert 0.0 < run.rows[-1].damping_dissipation < 0.02 * energy


@pytest.mark.parametrize("other", [False, True], ids=["wall", "bar"])
def test_bars_in_impact(other):
    run = bars(other, penalty_factor=1.0)  # 3 M/h
    time, force = history(run, "time") / CROSSING, history(run, "normal_force")
    second = 3.0 * IMPEDANCE
    stress = IMPEDANCE * second / (IMPEDANCE + second) if other else IMPEDANCE
    expected = stress * SPEED * 2.0 * LENGTH / CELLS
    plateau = (time > 0.2) & (time < 1.8)
    assert np.mean(force[plateau]) == pytest.approx(expected, rel=5e-3)
    # The contact lasts while the wave runs to the free end and back.
    pressed = np.nonzero(force > 0.5 * expected)[0]
    assert (pressed[-1] - pressed[0] + 1) * time[0] == pytest.approx(2.0, rel=0.02)
    assert np.sum(force) * time[0] == pytest.approx(2.0 * expected, rel=0.01)
    energy = 0.5 * RHO * SPEED**2 * LENGTH * 2.0 * LENGTH / CELLS
    assert np.max(np.abs(history(run, "energy_error"))) < 0.01 * energy
    # Momentum: what one bar loses the other gains, or the wall takes.
    mass = RHO * LENGTH * 2.0 * LENGTH / CELLS
    lost = mass * (motion(run, "elastomer", "velocity_y")[-1] + SPEED)
    assert lost == pytest.approx(np.sum(force) * run.rows[0].time, rel=2e-3)
    if other:
        heavy = mass * 2.25 * 4 / 3
        assert heavy * motion(run, "aluminium", "velocity_y")[-1] == pytest.approx(-lost, rel=1e-9)


# -- a block that slides to rest ------------------------------------------------------------------

HEIGHT, DENSITY, PRESSURE, START = 0.5e-3, 7800.0, 2e5, 2.0
MASS = DENSITY * HEIGHT  # kg/m² of contact
MAP = {
    "law": "friction-map", "D_max": 2.5e-6, "K_T": 1e13, "eta_b": 0.02, "V_star": 100.0,
    "V_star_at": 5e-7,
}  # fmt: skip
FILM = 5e-7  # m


@dataclass
class Slide:
    """A nearly rigid block (of steel) thrown along the surface: time, displacement, velocity."""

    run: Simulation
    time: np.ndarray
    place: np.ndarray
    speed: np.ndarray


def slide(friction: dict, duration: float) -> Slide:
    steel = {"material": "neo-hookean", "E": 70e9, "nu": 0.0, "density": DENSITY}
    metal = {"material": "hencky", "E": 70e9, "nu": 0.33, "density": 2700}
    # Holds the block while it is pressed; 1e-4 of the friction later.
    spring = {"direction": "x", "stiffness": 10.0, "end": 0.0}
    data = two_blocks(
        ((2e-3, HEIGHT, [2, 1]), (4e-3, 1e-3, [5, 1])),
        (steel | {"velocity": {"x": START}}, metal),
        {"penalty": 3e12, "film": {"thickness": FILM}, "friction": friction},
        [pressed(PRESSURE, spring=spring)],
        [press(solver="implicit"), {"name": "slide", "duration": duration, "steps": 60}],
        solver={"kind": "explicit"},
    )
    run = simulate(data)
    slid = np.array([row.stage == "slide" for row in run.rows])
    names = ("time", "displacement_x", "velocity_x")
    time, place, speed = (motion(run, "elastomer", name)[slid] for name in names)
    return Slide(run, time - 1.0, place, speed)


CLOSE = 5e-3  # of the starting speed, or of the way


def test_a_block_on_friction_and_film_comes_to_rest():
    friction = 0.5 * 0.2 * PRESSURE  # (1 - alpha) mu p
    drag = 0.5 * MAP["eta_b"] / FILM  # alpha eta_b/D
    log = np.log1p(drag * START / friction)
    stop = MASS / drag * log
    way = MASS / drag * (START - friction / drag * log)
    found = slide({**MAP, "mu_s": 0.2, "alpha": 0.5}, 1.2 * stop)
    exact = (START + friction / drag) * np.exp(-drag / MASS * found.time) - friction / drag
    moving = found.time < 0.99 * stop
    assert np.max(np.abs(found.speed - exact)[moving]) < CLOSE * START
    assert found.place[-1] == pytest.approx(way, rel=CLOSE)
    # Near rest the speed falls in proportion to time: the line through it ends at the stop.
    last = np.nonzero(found.speed > 0.02 * START)[0][-3:]
    slope, height = np.polyfit(found.time[last], found.speed[last], 1)
    assert -height / slope == pytest.approx(stop, rel=CLOSE)


def test_a_block_on_friction_that_weakens_with_slip():
    mu_s, mu_d, length, B = 0.3, 0.1, 2e-5, 5e4

    def work(s: float) -> float:
        """Friction's work per mass on the way s."""
        beyond = np.log1p(B * max(s - length, 0.0)) / B
        return PRESSURE / MASS * (mu_d * s + (mu_s - mu_d) * (min(s, length) + beyond))

    stop = brentq(lambda s: work(s) - 0.5 * START**2, 0.0, 1e-2)
    # A film thinner than D_min is none: Coulomb friction with mu(d).
    law = {**MAP, "mu_s": mu_s, "mu_d": mu_d, "A_d": length, "B": B, "alpha": 0.5, "D_min": 2e-6}
    found = slide(law, 2.9e-4)
    exact = np.sqrt([max(START**2 - 2.0 * work(s), 0.0) for s in found.place])
    moving = found.place < 0.97 * stop
    assert moving[0] and not moving[-1]
    assert np.max(np.abs(found.speed - exact)[moving]) < CLOSE * START
    assert found.place[-1] == pytest.approx(stop, rel=CLOSE)


# -- explicit and implicit ------------------------------------------------------------------------

REGIMES = {  # film thickness, film fraction below V*, V*
    "mixed": ("30 nm", 0.5, "1 m/s"),
    "viscous": ("180 nm", 0.9999, "1 cm/s"),
}


def sliding(regime: str, kind: str, velocity: float = 0.2, **solver) -> Simulation:
    """The sliding test on a small mesh: pressed with 3 MPa, then driven for 8 um."""
    film, alpha, threshold = REGIMES[regime]
    slip, rows = 1e-6, 8
    rubber = {"material": "mooney-rivlin", "C10": "0.738 MPa", "C01": "0.184 MPa"}
    metal = {"material": "hencky", "E": "7 GPa", "nu": 0.33, "density": 2700}
    friction = {"law": "friction-map", "mu_s": 0.1, "K_T": "1e12 Pa/m", "eta_b": "0.02 Pa*s"}
    friction |= {"D_max": "250 nm", "alpha": alpha, "V_star": threshold, "V_star_at": film}
    slide = {"name": "slide", "velocity": velocity, "duration": rows * slip / velocity}
    data = two_blocks(
        ((0.5e-3, 0.02e-3, [8, 1]), (0.8e-3, 0.1e-3, [9, 1])),
        (rubber | {"K": "0.3 GPa", "density": 1100}, metal),
        {"penalty_factor": 1.0, "film": {"thickness": film}, "friction": friction},
        [pressed(3e6, displacement={"x": "driven"})],
        [
            press(solver="implicit", steps=4),
            slide | {"steps": rows, "ramp": 2.0 * slip / velocity},
        ],
        {"thickness": "1 mm"},
        solver={"kind": kind, **solver},
    )
    return simulate(data)


@pytest.mark.parametrize("regime", REGIMES)
def test_explicit_and_implicit_slide_alike(regime):
    explicit, implicit = sliding(regime, "explicit"), sliding(regime, "implicit")
    mine, theirs = explicit.rows[-1], implicit.rows[-1]
    assert mine.time == pytest.approx(theirs.time, rel=1e-12)
    assert mine.tangential_force == pytest.approx(theirs.tangential_force, rel=5e-3)
    assert mine.normal_force == pytest.approx(theirs.normal_force, rel=1e-3)
    assert mine.viscous_fraction == theirs.viscous_fraction == float(regime == "viscous")
    assert abs(mine.energy_error) < 0.01 * mine.external_work
    assert np.all(np.diff(history(explicit, "dissipation")) >= 0.0)
    ratio = explicit.explicit.summary()["kinetic_over_strain"]
    assert 0.0 < ratio["slide"] < 0.01
