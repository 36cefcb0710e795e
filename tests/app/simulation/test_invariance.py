"""What must not matter: the frame that turns, the units, and how a step was cut."""

import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace

import numpy as np
import pytest

from tests.laws import FILM, coulomb, film_map
from tests.solved import built, solved
from tribox.app.equilibrium.constraints import Prescribed
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.implicit.newton import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.app.simulation.contact_resultants import (
    ContactResultants,
    measure_contact,
    turned_right,
)
from tribox.app.simulation.energy_balance import EnergyBalance
from tribox.app.simulation.history import Row
from tribox.app.simulation.simulation import Simulation
from tribox.forms.friction.friction_map import FrictionMap

SAME = 1e-8
CENTRE = np.array([0.3, 1.1])  # of the turns, away from everything that could be special


def film_of(mu: float) -> FrictionMap:
    return film_map(mu_s=1.5 * mu, mu_d=mu, eta_b=0.5, film_onset_pressure=0.01)


LAWS = {"coulomb": (coulomb, 0.0), "film": (film_of, FILM)}
# Coefficient of friction, and how far the upper grip is moved in the end.
MODES = {"stuck": (5.0, 0.04), "sliding": (0.2, 0.2)}
DEPTH = 0.05


def rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@dataclass
class State:
    """What a step left, in axes that turn with the bodies."""

    pressure: np.ndarray
    friction: np.ndarray
    slip: np.ndarray
    position: np.ndarray
    measure: ContactResultants
    strain: float
    interface: float
    dissipated: float
    worked: float
    couple: float


@dataclass
class Grip:
    """A node that is held: where it was, on which block, and its two components."""

    where: np.ndarray
    upper: bool
    held: list[Prescribed]


@dataclass
class Turntable:
    """Two blocks gripped at top and bottom, where every node is moved by itself."""

    problem: Equilibrium
    grips: list[Grip]
    stepper: ImplicitStepper = field(init=False)
    energy_balance: EnergyBalance = field(init=False)
    states: list[State] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.stepper = ImplicitStepper(self.problem, ImplicitOptions(tolerance=1e-12))
        self.energy_balance = EnergyBalance(self.problem, self.stepper.x)

    def step(self, shift: Sequence[float], angle: float = 0.0, dt: float = 1.0) -> State:
        """Solve one step: the upper grip shifted, in axes that turn with both grips."""
        for grip in self.grips:
            moved = grip.where + (np.array(shift) if grip.upper else 0.0)
            target = rotation(angle) @ (moved - CENTRE) + CENTRE - grip.where
            for part, value in zip(grip.held, target, strict=True):
                part.value = float(value)
        result = self.stepper.attempt(dt)
        assert result.converged, (shift, angle, result)
        [term], [trial] = self.problem.contacts, self.problem.trials
        measure = measure_contact(term, trial, self.problem.comm)
        self.stepper.commit()
        self.energy_balance.add(self.stepper.x, [measure])
        right = turned_right(trial.kinematics.normal)
        friction = np.einsum("qi,qi->q", trial.response.traction, right)
        weight = term.surface.slave.weight
        self.states.append(
            State(
                pressure=trial.pressure,
                friction=friction,
                slip=np.einsum("qi,qi->q", trial.kinematics.slip, right),
                position=(trial.position - CENTRE) @ rotation(angle),
                measure=measure,
                strain=self.energy_balance.strain,
                interface=self.energy_balance.interface,
                dissipated=self.energy_balance.dissipation,
                worked=self.energy_balance.work,
                couple=-float(weight @ (trial.kinematics.gap * friction)),
            )
        )
        return self.states[-1]


def turntable(pair: Callable, law: str, mu: float, penalty: float = 50.0) -> Turntable:
    """The blocks pressed on each other in two steps."""
    bodies = pair()
    where = bodies.u.function_space.tabulate_dof_coordinates()[:, :2]
    grips = []
    for surface, upper in (("top", True), ("bottom", False)):
        for node in np.unique(bodies.held(surface, 0).dofs // 2):
            held = [Prescribed(np.array([2 * node + i], dtype=np.int32)) for i in (0, 1)]
            grips.append(Grip(where[node], upper, held))
    parts = [part for grip in grips for part in grip.held]
    make, film = LAWS[law]
    table = Turntable(bodies.problem(make(mu), penalty, film, prescribed=parts), grips)
    for share in (0.5, 1.0):
        table.step((0.0, -share * DEPTH))
    return table


def assert_same(mine: State, theirs: State) -> None:
    """Everything at the points and of the whole contact, to 1e-8 of the largest pressure."""
    load = np.max(theirs.pressure)
    for name in ("pressure", "friction", "slip", "position"):
        a, b = getattr(mine, name), getattr(theirs, name)
        scale = load if name in ("pressure", "friction") else 1.0
        assert np.max(np.abs(a - b)) <= SAME * scale, name
    for name in ("normal_force", "tangential_force", "drag", "area", "stick", "penetration"):
        expected = getattr(theirs.measure, name)
        assert getattr(mine.measure, name) == pytest.approx(expected, rel=SAME, abs=1e-12), name
    for name in ("strain", "interface", "dissipated"):
        expected = getattr(theirs, name)
        assert getattr(mine, name) == pytest.approx(expected, rel=SAME), name


@pytest.mark.parametrize(("law", "mode"), [("coulomb", "stuck"), ("film", "sliding")])
def test_a_quarter_turn_changes_nothing_between_the_bodies(pair, law, mode):
    """Sheared, then turned by 90° in steps of 9°: as if it had stood still for the same time."""
    mu, shift = MODES[mode]
    turned, still = (turntable(pair, law, mu) for _ in range(2))
    for table in (turned, still):
        for k in range(1, 5):
            table.step((0.25 * k * shift, -DEPTH))
    before = turned.states[-1]
    assert before.measure.stick == (1.0 if mode == "stuck" else 0.0)
    assert np.max(np.abs(before.friction)) > 0.1 * np.max(before.pressure)
    for k in range(1, 11):
        after = turned.step((shift, -DEPTH), angle=np.pi / 20.0 * k)
        assert_same(after, still.step((shift, -DEPTH)))
    if law == "coulomb":  # a film creeps on while nothing moves
        assert np.max(np.abs(after.slip)) <= 1e-12
        assert after.dissipated == pytest.approx(before.dissipated, rel=SAME)
        for name in ("pressure", "friction", "position"):
            assert getattr(after, name) == pytest.approx(getattr(before, name), abs=SAME * 0.3)
        # At rest, each point on its threshold but for round-off, they all count as stuck.
        assert after.measure.stick == pytest.approx(1.0, rel=1e-9)


def test_turning_costs_the_moment_of_friction_over_the_penetration(pair):
    """The tractions on slave and master are g apart: a couple that vanishes with g.

    A turn by the angle φ works against it, ∫ −g T dA φ (trapezoidal rule: sin φ), and this is all
    that the turn leaves in the energy balance.
    """
    couples = []
    mu, shift = MODES["sliding"]
    for penalty in (50.0, 500.0):
        table = turntable(pair, "coulomb", mu, penalty)
        for k in range(1, 5):
            before = table.step((0.25 * k * shift, -DEPTH))
        error = table.energy_balance.error
        for k in range(1, 11):
            after = table.step((shift, -DEPTH), angle=np.pi / 20.0 * k)
        worked = after.worked - before.worked
        assert worked == pytest.approx(10.0 * np.sin(np.pi / 20.0) * before.couple, rel=1e-6)
        assert table.energy_balance.error - error == pytest.approx(worked, rel=1e-6)
        couples.append(before.couple / before.measure.tangential_force)
    assert 0.0 < couples[0] < 0.02  # the length of a lever, on blocks 0.5 high
    assert 0.08 < couples[1] / couples[0] < 0.15


# -- steps that are cut ---------------------------------------------------------------------------

# The same pieces start from the same states, but the tangent factorised last may be another: what
# the tolerance of 1e-11 leaves differs.
LEFT = 1e-9


def leaves(value: object, name: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Every array and number in nested dataclasses, by its name."""
    if is_dataclass(value):
        for part in fields(value):
            yield from leaves(getattr(value, part.name), f"{name}.{part.name}")
    else:
        yield name, np.array(value, dtype=float)


def remembered(run: Simulation) -> dict[str, np.ndarray]:
    """All that the next step starts from: unknowns, contact history, loads and energies."""
    problem, energy_balance = run.model.problem, run.state.energy_balance
    state = dict(item for term in problem.contacts for item in leaves(term.state))
    loads = [p.force for p in problem.platens] + [float(p.value) for p in problem.prescribed]
    energies = [
        energy_balance.work,
        energy_balance.strain,
        energy_balance.interface,
        energy_balance.dissipation,
    ]
    return {
        **state,
        "x": run.stepper.x.array_r.copy(),
        "loads": np.array(loads),
        "energies": np.array(energies),
    }


def retake(data: dict, rows: list[Row]) -> Simulation:
    """The steps of a history taken directly."""
    run = built(data)
    problem = run.model.problem
    rated = {stage.name: stage.rate_dependent for stage in run.model.case.stage}
    for row in rows:
        run.stepper.rate_dependent = rated[row.stage]
        run.model.set_loads(row.time, row.driven_displacement)
        result = run.stepper.attempt(row.dt)
        assert result.converged
        pairs = zip(problem.contacts, problem.trials, strict=True)
        resultants = [measure_contact(term, trial, problem.comm) for term, trial in pairs]
        run.stepper.commit()
        run.state.energy_balance.add(run.stepper.x, resultants)
    return run


def of_solution(attempt: Callable, stepper: ImplicitStepper, dt: float):
    """The step is solved, and denied."""
    return replace(attempt(stepper, dt), converged=False)


def of_iterations(attempt: Callable, stepper: ImplicitStepper, dt: float):
    """The step is left half solved, after one iteration."""
    options = stepper.options
    stepper.options = replace(options, max_iterations=1)
    result = attempt(stepper, dt)
    stepper.options = options
    return replace(result, converged=False)


def of_numbers(attempt: Callable, stepper: ImplicitStepper, dt: float):
    """The residual overflows after two evaluations."""
    problem = stepper.problem
    whole, calls = problem.residual, []

    def broken(snes, x, f, step):
        whole(snes, x, f, step)
        calls.append(1)
        if len(calls) > 2:
            f.set(np.nan)

    problem.residual = broken
    result = attempt(stepper, dt)
    problem.residual = whole
    assert not result.converged
    return result


@pytest.mark.parametrize(
    ("kind", "want"), [("film", of_solution), ("coulomb", of_iterations), ("film", of_numbers)]
)
def test_failed_attempts_leave_nothing_behind(monkeypatch, block, film, kind, want):
    """Cut twice at the onset of slip and once in sliding; then the same pieces taken directly."""
    data = tomllib.loads(block if kind == "coulomb" else film)
    data["solver"] = {"tolerance": 1e-11}
    if kind == "film":
        data["stage"][1] = {"name": "slide", "velocity": 2e-4, "duration": 0.1, "steps": 6}
    attempt = ImplicitStepper.attempt
    calls: list[float] = []

    def stumbling(stepper, dt):
        calls.append(dt)
        if len(calls) not in (5, 6, 10):
            return attempt(stepper, dt)
        return want(attempt, stepper, dt)

    monkeypatch.setattr(ImplicitStepper, "attempt", stumbling)
    cut = solved(data)
    monkeypatch.undo()
    assert sum(row.attempts - 1 for row in cut.rows) == 3 and len(cut.rows) > 9
    mine, theirs = remembered(cut), remembered(retake(data, cut.rows))
    for name, expected in theirs.items():
        finite = np.isfinite(expected)
        assert np.array_equal(np.isfinite(mine[name]), finite), name
        largest = np.max(np.abs(expected), where=finite, initial=0.0)
        apart = np.max(np.abs(mine[name] - expected), where=finite, initial=0.0)
        assert apart <= LEFT * largest, name
