"""Runs the stages of a case step by step, with steps that are cut where they fail."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from app.build.model import Model
from app.case.boundary import solver_of
from app.errors import InputError, SolutionError
from app.explicit.stepper import ExplicitStepper
from app.implicit.stepper import ImplicitOptions, ImplicitStepper, StepResult
from app.simulation.contact_resultants import ContactResultants, measure_contact
from app.simulation.energy_balance import EnergyBalance
from app.simulation.explicit_stage import ExplicitStage, Interval
from app.simulation.failure_diagnosis import body_adrift, explain, loose_directions, not_finite
from app.simulation.history import Row
from app.simulation.load_steps import LoadStep, load_steps_of

STEADY_WINDOW = 3  # steps over which the tangential force must hold still
EASY_ITERATIONS = 6  # up to here a cut step may grow back


class Observer:
    """What wants to know of a run; the default does nothing."""

    def step(self, simulation: Simulation, row: Row, result: StepResult | Interval) -> None:
        """A step has converged and is committed, or an explicit interval is over; collective."""

    def within(self, simulation: Simulation, load_step: LoadStep, steps: int) -> None:
        """Called now and then between two rows of an explicit run, after ``steps``; collective."""

    def load_step(
        self, simulation: Simulation, load_step: LoadStep, row: Row, steady: bool | None
    ) -> None:
        """A load step has ended; ``steady`` is None where nobody asked for it; collective."""

    def cut(self, simulation: Simulation, dt: float, result: StepResult) -> None:
        """A step of ``dt`` (s) has failed and is tried again shorter; collective."""


class Simulation:
    """One case being run.

    Attributes:
        model: what is solved; energy_balance: its energies.
        implicit: the stepper of implicit stages; None without any.
        explicit: what carries explicit stages; None before the first of them.
        time: s; driven: m, displacement of driven boundaries; step: converged steps so far.
        rows: the history.
        resultants: the contacts after the last step.
    """

    implicit: ImplicitStepper | None
    explicit: ExplicitStage | None

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
        self._load_step_start = 0.0
        self.resultants: list[ContactResultants] = []
        model.set_loads(0.0, 0.0)
        self._loose = loose_directions(model.problem)
        self.implicit = self.explicit = None
        start = model.problem.new_vector()
        self.energy_balance = EnergyBalance(model.problem, start)
        if any(solver_of(stage, solver.kind) == "implicit" for stage in model.case.stage):
            options = ImplicitOptions(
                solver.tolerance, solver.max_iterations, solver.linear, solver.petsc
            )
            try:
                self.implicit = ImplicitStepper(model.problem, options)
            except ValueError as error:
                raise InputError(f"solver.petsc: {error}") from None
        else:
            self.explicit = ExplicitStage(self, start.array_r)

    @property
    def stepper(self) -> ImplicitStepper | ExplicitStepper:
        """What makes the steps at present."""
        if self.explicit is not None:
            return self.explicit.stepper
        assert self.implicit is not None
        return self.implicit

    def run(self, observer: Observer) -> None:
        """Run all stages.

        Raises:
            SolutionError: a step failed however short it was made; the state is the last
                converged one.
        """
        case, velocity = self.model.case, 0.0
        for stage in case.stage:
            for contact in self.model.problem.contacts:
                contact.rate_dependent = stage.rate_dependent
            run_load_step = self._run_load_step
            if solver_of(stage, case.solver.kind) == "explicit":
                run_load_step = self._explicit_stage().run_load_step
            for load_step in load_steps_of(stage, case.film_conductance, velocity):
                run_load_step(load_step, observer)
                velocity = load_step.velocity

    def _explicit_stage(self) -> ExplicitStage:
        """What carries explicit stages; it takes over where the implicit ones ended."""
        if self.explicit is None:
            self.explicit = ExplicitStage(self, self.stepper.x.array_r)
        return self.explicit

    def _run_load_step(self, load_step: LoadStep, observer: Observer) -> None:
        self._load_step_start = self.time
        if load_step.steps is not None:
            for _ in range(load_step.steps):
                self._advance(load_step, observer)
            observer.load_step(self, load_step, self.rows[-1], None)
            return
        self._whole = []
        steady = False
        for count in range(1, load_step.stage.max_steps + 1):
            self._advance(load_step, observer)
            steady = count >= load_step.stage.min_steps and self.is_steady(load_step, self._whole)
            if steady:
                break
        observer.load_step(self, load_step, self.rows[-1], steady)

    def is_steady(self, load_step: LoadStep, whole: Sequence[int]) -> bool:
        """Whether the tangential force has held still over the last steps of this load step.

        Args:
            load_step: the load step.
            whole: numbers of the load step's rows; of a step made in pieces only the last.
        """
        ends = whole[-STEADY_WINDOW - 1 :]
        if len(ends) <= STEADY_WINDOW:
            return False
        force = np.array([self.rows[end].tangential_force for end in ends])
        allowed = load_step.stage.steady_tolerance * float(np.abs(force[-1]))
        return bool(np.all(np.abs(np.diff(force)) <= allowed))

    def _advance(self, load_step: LoadStep, observer: Observer) -> None:
        """One step of the load step, in as many pieces as it takes.

        The pieces end exactly where the whole step would have.
        """
        assert self.implicit is not None
        start, driven = self.time, self.driven
        since = start - self._load_step_start
        done, piece, failures, wasted = 0.0, 1.0, 0, 0
        while done < 1.0:
            end = min(1.0, done + piece)
            moved = driven + load_step.travel(since + end * load_step.dt) - load_step.travel(since)
            self.model.set_loads(start + end * load_step.dt, moved)
            dt = (end - done) * load_step.dt
            result = self.implicit.attempt(dt)
            if not result.converged:
                failures += 1
                wasted += result.iterations
                piece = 0.5 * (end - done)
                if piece < self.model.case.solver.min_step_fraction:
                    self._give_up(load_step, dt, result)
                observer.cut(self, dt, result)
                continue
            self._measure(load_step)
            self.time = start + end * load_step.dt
            self.driven = moved
            easy = result.iterations <= EASY_ITERATIONS
            result.iterations += wasted
            self._commit(load_step, dt, result, failures, observer)
            done, failures, wasted = end, 0, 0
            if easy:
                piece = 2.0 * piece
        self._whole.append(len(self.rows) - 1)

    def _commit(
        self, load_step: LoadStep, dt: float, result: StepResult, failures: int, observer: Observer
    ) -> None:
        assert self.implicit is not None
        self.implicit.commit()
        self.energy_balance.add(self.stepper.x, self.resultants)
        self.add_row(load_step, dt, result, failures + 1, observer)

    def add_row(
        self,
        load_step: LoadStep,
        dt: float,
        result: StepResult | Interval,
        attempts: int,
        observer: Observer,
    ) -> None:
        """Add a row of the present measures and energies to the history and tell of it."""
        self.step += 1
        iterations = result.iterations if isinstance(result, StepResult) else 0
        row = self._row(load_step, dt, iterations, attempts)
        self.rows.append(row)
        observer.step(self, row, result)

    def _row(self, load_step: LoadStep, dt: float, iterations: int, attempts: int) -> Row:
        t, energy_balance, all_ = self.model.thickness, self.energy_balance, self.resultants
        normal = sum(m.normal_force for m in all_)
        tangential = sum(m.tangential_force for m in all_)
        area = sum(m.area for m in all_)

        def mean(value: Callable[[ContactResultants], float]) -> float:
            return sum(value(m) * m.area for m in all_) / area if area > 0.0 else 0.0

        film = mean(lambda m: m.film)
        sliding = load_step.velocity != 0.0 and area > 0.0
        return Row(
            step=self.step,
            time=self.time,
            stage=load_step.stage.name,
            dt=dt,
            velocity=load_step.velocity,
            slip_speed=mean(lambda m: m.speed) if load_step.stage.rate_dependent else 0.0,
            driven_displacement=self.driven,
            normal_force=normal * t,
            tangential_force=tangential * t,
            drag=sum(m.drag for m in all_) * t,
            friction_coefficient=abs(tangential / normal) if normal != 0.0 else 0.0,
            mu=mean(lambda m: m.friction_coefficient),
            film_thickness=film,
            effective_viscosity=abs(tangential * film / (load_step.velocity * area))
            if sliding
            else 0.0,
            contact_area=area * t,
            area_ratio=mean(lambda m: m.area_ratio),
            stick_fraction=mean(lambda m: m.stick),
            viscous_fraction=mean(lambda m: m.viscous),
            max_penetration=max((m.penetration for m in all_), default=0.0),
            newton_iterations=iterations,
            attempts=attempts,
            strain_energy=energy_balance.strain * t,
            kinetic_energy=energy_balance.kinetic * t,
            interface_energy=energy_balance.interface * t,
            dissipation=energy_balance.dissipation * t,
            numerical_dissipation=energy_balance.numerical * t,
            damping_dissipation=energy_balance.damping * t,
            external_work=energy_balance.work * t,
            energy_error=energy_balance.error * t,
            **self._resultants(),
        )

    def _measure(self, load_step: LoadStep) -> None:
        """Measure a solved step before it is committed; collective.

        Raises:
            SolutionError: a number is not finite, or a body has been moved that nothing holds.
        """
        problem = self.model.problem
        pairs = zip(problem.contacts, problem.trials, strict=True)
        driven = self.driven_direction()
        resultants = [measure_contact(term, trial, problem.comm, driven) for term, trial in pairs]
        wrong = not_finite(resultants)
        pressed = any(m.normal_force > problem.roundoff for m in (*self.resultants, *resultants))
        if wrong is None and not pressed:
            assert self.implicit is not None
            x, trial = self.implicit.x.array_r, self.implicit.trial.array_r
            wrong = body_adrift(problem, self._loose, x, trial)
        if wrong is not None:
            raise SolutionError(f"stage {load_step.label}, time {self.time:.6g} s: {wrong}")
        self.resultants = resultants

    def driven_direction(self) -> list[float] | None:
        """Direction of the first driven boundary, None without."""
        for boundary in self.model.case.boundary:
            components = boundary.driven_components()
            if components and boundary.displacement is not None:
                share = boundary.displacement.driven_share
                axes = "xyz"[: self.model.problem.dim]
                return [share(axis) if axis in components else 0.0 for axis in axes]
        return None

    def _resultants(self) -> dict[str, float]:
        """Columns of force vectors and of the twisting moment, summed over the pairs."""
        t, out = self.model.thickness, {}
        for kind in ("force", "friction"):
            vectors = [getattr(m, kind) for m in self.resultants]
            for axis, values in zip("xyz", zip(*vectors, strict=True), strict=False):
                out[f"{kind}_{axis}"] = sum(values) * t
        return {**out, "twist_moment": sum(m.twist_moment for m in self.resultants) * t}

    def _give_up(self, load_step: LoadStep, dt: float, result: StepResult) -> None:
        why = explain(self.model.problem, result, self.stepper.x, self._loose)
        raise SolutionError(
            f"stage {load_step.label}, time {self.time:.6g} s: no solution even with a step of "
            f"{dt:.3g} s: {why}"
        )
