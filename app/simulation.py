"""Runs the stages of a case step by step, with steps that are cut where they fail."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from app.case_boundary import Stage
from app.diagnosis import body_adrift, explain, loose_directions, not_finite
from app.errors import InputError, SolutionError
from app.implicit import ImplicitOptions, ImplicitStepper, StepResult
from app.ledger import Ledger
from app.measure import ContactMeasure, Row, measure_contact
from app.model import Model

STEADY_WINDOW = 3  # steps over which the tangential force must hold still
EASY_ITERATIONS = 6  # up to here a cut step may grow back


@dataclass(frozen=True, slots=True)
class Leg:
    """A stretch of a stage with one velocity and one length of step.

    Attributes:
        stage: the stage it belongs to.
        velocity: m/s, of driven boundaries.
        dt: s, the step asked for.
        steps: number of such steps; None: until steady.
    """

    stage: Stage
    velocity: float
    dt: float
    steps: int | None

    @property
    def label(self) -> str:
        """Name for messages and results."""
        return (
            f"{self.stage.name} {self.velocity:g} m/s" if self.stage.velocities else self.stage.name
        )


def legs_of(stage: Stage, film_conductance: float = 0.0) -> Iterator[Leg]:
    """The legs of a stage: one for each velocity, or one for its duration.

    Args:
        stage: the stage.
        film_conductance: largest eta_b/D, Pa s/m, for the limit on the film's stress.
    """
    for velocity in stage.velocities_within(film_conductance):
        assert stage.slip_step is not None
        yield Leg(stage, velocity, stage.slip_step / abs(velocity), None)
    if not stage.velocities:
        assert stage.duration is not None
        dt = stage.duration / stage.steps
        yield Leg(stage, stage.velocity or 0.0, dt, stage.steps)


class Observer:
    """What wants to know of a run; the default does nothing."""

    def step(self, simulation: Simulation, row: Row, result: StepResult) -> None:
        """A step has converged and is committed; collective."""

    def leg(self, simulation: Simulation, leg: Leg, row: Row, steady: bool | None) -> None:
        """A leg has ended; ``steady`` is None where nobody asked for it; collective."""

    def cut(self, simulation: Simulation, dt: float, result: StepResult) -> None:
        """A step of ``dt`` (s) has failed and is tried again shorter; collective."""


class Simulation:
    """One case being run.

    Attributes:
        model: what is solved; stepper: how; ledger: its energies.
        time: s; driven: m, displacement of driven boundaries; step: converged steps so far.
        rows: the history.
        measures: the contacts after the last step.
    """

    def __init__(self, model: Model) -> None:
        """Make ready to start; collective.

        Raises:
            InputError: PETSc refuses an option of the case.
        """
        solver = model.case.solver
        self.model = model
        self.time = self.driven = 0.0
        self.step = 0
        self.rows: list[Row] = []
        self._whole: list[int] = []
        self.measures: list[ContactMeasure] = []
        model.set_loads(0.0, 0.0)
        options = ImplicitOptions(
            solver.tolerance, solver.max_iterations, solver.linear, solver.petsc
        )
        try:
            self.stepper = ImplicitStepper(model.problem, options)
        except ValueError as error:
            raise InputError(f"solver.petsc: {error}") from None
        self.ledger = Ledger(model.problem, self.stepper.x)
        self._loose = loose_directions(model.problem)

    def run(self, observer: Observer) -> None:
        """Run all stages.

        Raises:
            SolutionError: a step failed however short it was made; the state is the last
                converged one.
        """
        for stage in self.model.case.stage:
            for contact in self.model.problem.contacts:
                contact.rate_dependent = stage.rate_dependent
            for leg in legs_of(stage, self.model.case.film_conductance):
                self._run_leg(leg, observer)

    def _run_leg(self, leg: Leg, observer: Observer) -> None:
        if leg.steps is not None:
            for _ in range(leg.steps):
                self._advance(leg, observer)
            observer.leg(self, leg, self.rows[-1], None)
            return
        self._whole = []
        steady = False
        for count in range(1, leg.stage.max_steps + 1):
            self._advance(leg, observer)
            steady = count >= leg.stage.min_steps and self._steady(leg)
            if steady:
                break
        observer.leg(self, leg, self.rows[-1], steady)

    def _steady(self, leg: Leg) -> bool:
        """Whether the tangential force has held still over the last steps of this leg.

        A step made in pieces counts as one: its last piece is compared.
        """
        ends = self._whole[-STEADY_WINDOW - 1 :]
        if len(ends) <= STEADY_WINDOW:
            return False
        force = np.array([self.rows[end].tangential_force for end in ends])
        allowed = leg.stage.steady_tolerance * float(np.abs(force[-1]))
        return bool(np.all(np.abs(np.diff(force)) <= allowed))

    def _advance(self, leg: Leg, observer: Observer) -> None:
        """One step of the leg, in as many pieces as it takes.

        The pieces end exactly where the whole step would have.
        """
        start, driven = self.time, self.driven
        done, piece, failures, wasted = 0.0, 1.0, 0, 0
        while done < 1.0:
            end = min(1.0, done + piece)
            self.model.set_loads(start + end * leg.dt, driven + end * leg.dt * leg.velocity)
            dt = (end - done) * leg.dt
            result = self.stepper.attempt(dt)
            if not result.converged:
                failures += 1
                wasted += result.iterations
                piece = 0.5 * (end - done)
                if piece < self.model.case.solver.min_step_fraction:
                    self._give_up(leg, dt, result)
                observer.cut(self, dt, result)
                continue
            self._measure(leg)
            self.time = start + end * leg.dt
            self.driven = driven + end * leg.dt * leg.velocity
            easy = result.iterations <= EASY_ITERATIONS
            result.iterations += wasted
            self._commit(leg, dt, result, failures, observer)
            done, failures, wasted = end, 0, 0
            if easy:
                piece = 2.0 * piece
        self._whole.append(len(self.rows) - 1)

    def _commit(
        self, leg: Leg, dt: float, result: StepResult, failures: int, observer: Observer
    ) -> None:
        self.stepper.commit()
        self.ledger.add(self.stepper.x, self.measures)
        self.step += 1
        row = self._row(leg, dt, result, failures + 1)
        self.rows.append(row)
        observer.step(self, row, result)

    def _row(self, leg: Leg, dt: float, result: StepResult, attempts: int) -> Row:
        t, ledger, all_ = self.model.thickness, self.ledger, self.measures
        normal = sum(m.normal_force for m in all_)
        tangential = sum(m.tangential_force for m in all_)
        area = sum(m.area for m in all_)

        def mean(value: Callable[[ContactMeasure], float]) -> float:
            return sum(value(m) * m.area for m in all_) / area if area > 0.0 else 0.0

        film = mean(lambda m: m.film)
        sliding = leg.velocity != 0.0 and area > 0.0
        return Row(
            step=self.step,
            time=self.time,
            stage=leg.stage.name,
            dt=dt,
            velocity=leg.velocity,
            slip_speed=mean(lambda m: m.speed) if leg.stage.rate_dependent else 0.0,
            driven_displacement=self.driven,
            normal_force=normal * t,
            tangential_force=tangential * t,
            drag=sum(m.drag for m in all_) * t,
            friction_coefficient=abs(tangential / normal) if normal != 0.0 else 0.0,
            mu=mean(lambda m: m.friction_coefficient),
            film_thickness=film,
            effective_viscosity=abs(tangential * film / (leg.velocity * area)) if sliding else 0.0,
            contact_area=area * t,
            area_stretch=mean(lambda m: m.stretch),
            stick_fraction=mean(lambda m: m.stick),
            viscous_fraction=mean(lambda m: m.viscous),
            max_penetration=max((m.penetration for m in all_), default=0.0),
            newton_iterations=result.iterations,
            attempts=attempts,
            strain_energy=ledger.strain * t,
            kinetic_energy=0.0,
            interface_energy=ledger.interface * t,
            dissipation=ledger.dissipation * t,
            numerical_dissipation=ledger.numerical * t,
            external_work=ledger.work * t,
            energy_error=ledger.error * t,
        )

    def _measure(self, leg: Leg) -> None:
        """Measure a solved step before it is committed; collective.

        Raises:
            SolutionError: a number is not finite, or a body has been moved that nothing holds.
        """
        problem = self.model.problem
        pairs = zip(problem.contacts, problem.trials, strict=True)
        measures = [measure_contact(term, trial, problem.comm) for term, trial in pairs]
        wrong = not_finite(measures)
        pressed = any(m.normal_force > problem.roundoff for m in (*self.measures, *measures))
        if wrong is None and not pressed:
            x, trial = self.stepper.x.array_r, self.stepper.trial.array_r
            wrong = body_adrift(problem, self._loose, x, trial)
        if wrong is not None:
            raise SolutionError(f"stage {leg.label}, time {self.time:.6g} s: {wrong}")
        self.measures = measures

    def _give_up(self, leg: Leg, dt: float, result: StepResult) -> None:
        why = explain(self.model.problem, result, self.stepper.x, self._loose)
        raise SolutionError(
            f"stage {leg.label}, time {self.time:.6g} s: no solution even with a step of "
            f"{dt:.3g} s: {why}"
        )
