"""Runs the stages of a case, one load step after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tribox.app.build.model import Model, failures_as
from tribox.app.case.stage import LoadStep, Stage, solver_of
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.equilibrium.supports import Loose, loose_directions, sprung_dofs
from tribox.app.errors import InputError, SolutionError
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.implicit.newton import ImplicitOptions
from tribox.app.implicit.stepper import ImplicitStepper, StepResult
from tribox.app.simulation import failure_diagnosis
from tribox.app.simulation.contact_resultants import begin_stage
from tribox.app.simulation.energy_balance import Inertia
from tribox.app.simulation.explicit_stage import ExplicitStage
from tribox.app.simulation.history import Row, time_text
from tribox.app.simulation.motion_history import OutsideForces
from tribox.app.simulation.run_state import Observer, RunState
from tribox.forms.contact.law_faults import law_fault, law_not_finite
from tribox.forms.contact.state import ContactTrial

EASY_ITERATIONS = 6  # up to here a cut step may grow back
COLLAPSING = 1  # cuts after which a step from a state with a collapsed element is not tried again
ADRIFT = 2  # cuts after which a body that a load moves away is not sought any longer
SHORTEST = 1.0 / 16.0  # piece of a step down to which a friction law may have it cut


class ImplicitStage:
    """Runs the implicit load steps; ``state``: what the run has come to, ``stepper``: solves."""

    def __init__(self, state: RunState) -> None:
        """Make ready to start; collective; InputError if PETSc refuses an option of the case."""
        self.state, self.model = state, state.model
        solver = state.model.case.solver
        options = ImplicitOptions(
            solver.tolerance, solver.max_iterations, state.model.linear, solver.petsc
        )
        try:
            self.stepper = ImplicitStepper(state.model.problem, options)
        except ValueError as error:
            raise InputError(f"solver.petsc: {error}") from None
        state.stepper = self.stepper
        self._counted = 0  # linear iterations that rows hold so far

    @property
    def _loose(self) -> list[Loose]:
        """The directions in which contact alone holds a body at present; collective."""
        return loose_directions(self.model.problem)

    def snapshot(self) -> Snapshot:
        """All that the next step depends on, beside the loads; collective."""
        return self.stepper.snapshot()

    def advance(self, load_step: LoadStep, observer: Observer) -> None:
        """One step of the load step, or the rest of it, in as many pieces as it takes; collective.

        They end where it would have; SolutionError if it failed however short it was made.
        """
        state, at = self.state, self.state.position
        at.begin_step(state.time, state.driven)
        start, driven = at.step_time, at.step_driven
        since = start - at.time
        while at.done < 1.0:
            if not at.failures:
                observer.ready(state)
            end = min(1.0, at.done + at.piece)
            moved = driven + load_step.travel(since + end * load_step.dt) - load_step.travel(since)
            # Parts of a stage's first step carry their share of what changes at once there.
            share = end if at.count == 0 and start == self.model.onset.time else 1.0
            self.model.set_loads(start + end * load_step.dt, moved, share)
            dt = (end - at.done) * load_step.dt
            self.stepper.failures = at.failures
            result = self.stepper.attempt(dt)
            self._heed_laws(load_step)
            half = 0.5 * (end - at.done)
            least = max(SHORTEST, self.model.case.solver.min_step_fraction)
            if result.converged and result.too_long and half >= least:
                result = replace(result, converged=False)
            observer.attempt(state, load_step, dt, result)
            if not result.converged:
                at.failures, at.calm = at.failures + 1, 0
                at.wasted += result.iterations
                at.piece = half
                if self._is_hopeless(result) or at.piece < self.model.case.solver.min_step_fraction:
                    self._give_up(load_step, dt, result)
                observer.cut(state, dt, result)
                continue
            self._take_resultants(load_step, bool(result.floating))
            state.time, state.driven = start + end * load_step.dt, moved
            easy = result.iterations <= EASY_ITERATIONS
            result.iterations += at.wasted
            self._commit(load_step, dt, result, at.failures, observer)
            at.done, at.failures, at.wasted = end, 0, 0
            if easy:
                at.piece = 2.0 * at.piece
        at.end_step(self.model.case.solver.min_step_fraction)

    def _is_hopeless(self, result: StepResult) -> bool:
        """Whether shorter pieces would fail like those that have failed in a row; collective."""
        if result.too_long:  # it was solved
            return False
        if self.state.position.failures <= (ADRIFT if result.adrift else COLLAPSING):
            return False
        if result.adrift:
            return True
        problem, stepper = self.model.problem, self.stepper
        collapsed = failure_diagnosis.has_collapsed(problem, stepper.x)
        problem.spread(stepper.trial)  # what is said of the failure is said of what was tried
        return collapsed

    def _take_resultants(self, load_step: LoadStep, held: bool) -> None:
        """Contact resultants of a solved step, before it is committed; collective."""
        state, problem = self.state, self.model.problem
        self._heed_laws(load_step, problem.trials)
        resultants = state.resultants_of(problem.trials)
        wrong = failure_diagnosis.not_finite(resultants)
        noise = problem.roundoff
        pressed = any(m.normal_force > noise for m in (*state.resultants, *resultants))
        if wrong is None and not pressed and not held:
            x, trial = self.stepper.x.array_r, self.stepper.trial.array_r
            loose = loose_directions(problem, sprung_dofs(problem))
            wrong = failure_diagnosis.body_adrift(problem, loose, x, trial)
        if wrong is not None:
            when = time_text(state.time, load_step.dt)
            raise SolutionError(f"stage {load_step.label}, time {when}: {wrong}")
        state.resultants = resultants

    def _heed_laws(self, load_step: LoadStep, trials: Sequence[ContactTrial] = ()) -> None:
        """End the run where a law of the user's has failed on any rank; collective."""
        if fault := law_fault(self.model.problem.contacts, trials):
            when = time_text(self.state.time, load_step.dt)
            raise SolutionError(f"stage {load_step.label}, time {when}: {fault}")

    def _commit(
        self, load_step: LoadStep, dt: float, result: StepResult, failures: int, observer: Observer
    ) -> None:
        state = self.state
        before = self.stepper.x.array_r.copy()
        self.stepper.commit()
        state.energy_balance.add(self.stepper.x, state.resultants)
        outside = OutsideForces.at(self.model.problem, state.motion.held)
        velocity = (self.stepper.x.array_r - before) / dt
        counted, self._counted = self._counted, self.stepper.solver.iterations
        linear = self._counted - counted
        row = state.add_row(
            load_step,
            dt,
            iterations=result.iterations,
            attempts=failures + 1,
            linear=linear,
            velocity=velocity,
            outside=outside,
        )
        observer.step(state, row, result)

    def _give_up(self, load_step: LoadStep, dt: float, result: StepResult) -> None:
        model = self.model
        why = law_not_finite(model.problem.contacts)
        if why is None:
            contacts, stepper = model.case.contact, self.stepper
            step = StepMode.of_stage(dt, model.problem.contacts, stepper.rate_dependent)
            why = failure_diagnosis.explain(
                *(model.problem, result, stepper.x, self._loose, model.thickness, contacts),
                unstable=lambda: failure_diagnosis.is_unstable(stepper.solver, stepper.trial, step),
                spent=lambda: stepper.predictor.meets_limit(stepper.x, stepper.trial, step),
                look_ahead=lambda: stepper.predictor.look_ahead(stepper.x, stepper.trial, step),
            )
        when = time_text(self.state.time, dt)
        raise SolutionError(
            f"stage {load_step.label}, time {when}: no solution even with a step of "
            f"{dt:.3g} s: {why}"
        )


# -- All stages of a case, one load step after the other -------------------------------------------


class Simulation:
    """One case being run; ``state``: how far it has come.

    ``implicit``, ``explicit``: what runs such stages, if there are any, or have begun.
    """

    @failures_as(InputError, "the start")
    def __init__(self, model: Model) -> None:
        """Make ready; InputError if PETSc refuses options, or cells or numbers fail; collective."""
        self.state = RunState(model)
        self.implicit: ImplicitStage | None = None
        self.explicit: ExplicitStage | None = None
        kind = model.case.solver.kind
        if any(solver_of(stage, kind) == "implicit" for stage in model.case.stage):
            self.implicit = ImplicitStage(self.state)
        elif model.case.solver.petsc:
            names = ", ".join(model.case.solver.petsc)
            raise InputError(f"solver.petsc: {names}: no stage is implicit, so nothing uses it")
        else:
            self.explicit = ExplicitStage(self.state, np.zeros(model.problem.owned))

    @property
    def model(self) -> Model:
        """What is solved."""
        return self.state.model

    @property
    def rows(self) -> list[Row]:
        """The history."""
        return self.state.rows

    @property
    def stepper(self) -> ImplicitStepper | ExplicitStepper:
        """What makes the steps at present."""
        return self.state.stepper

    def run(self, observer: Observer) -> None:
        """Run all stages on; SolutionError, at the last converged state, if a step failed."""
        state, at = self.state, self.state.position
        for load_step in self.model.case.load_steps[at.load_step :]:
            released = begin_stage(self.model, load_step.stage.name, state.stepper.x)
            state.energy_balance.take_over(released)
            with failures_as(SolutionError, f"stage {load_step.stage.name}"):
                runner = self._runner(load_step.stage)
                begins = at.begin(state.time, state.driven, len(state.rows))
                if begins and isinstance(runner, ExplicitStage):
                    state.inertia.append(Inertia(load_step.label))
                state.run(load_step, observer, runner.advance)
            at.end()
        self._require_contact()
        observer.ready(state)

    def _require_contact(self) -> None:
        """End a run in which a free body was carried from begin to end with an error; collective.

        It lacks a support, or the stroke is too short.
        """
        stepper, problem = self.stepper, self.model.problem
        if isinstance(stepper, ImplicitStepper) and stepper.has_carried_only:
            loose = loose_directions(problem, sprung_dofs(problem))
            x = stepper.x.array_r
            if wrong := failure_diagnosis.body_adrift(problem, loose, np.zeros_like(x), x):
                last = self.rows[-1]
                raise SolutionError(f"stage {last.stage}, time {last.time:.6g} s: {wrong}")

    def _runner(self, stage: Stage) -> ImplicitStage | ExplicitStage:
        """The runner of a stage; the first explicit one takes over from the implicit ones."""
        rates = stage.rate_dependent
        if solver_of(stage, self.model.case.solver.kind) == "implicit":
            assert self.implicit is not None
            self.implicit.stepper.rate_dependent = rates
            return self.implicit
        if self.explicit is None:
            self.explicit = ExplicitStage(self.state, self.stepper.x.array_r, rates)
        self.explicit.stepper.rate_dependent = rates
        return self.explicit

    # -- restart ------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """All that the rest of the run depends on, but for the rows; collective.

        To be taken where an observer's ``ready`` is called. Arrays are views, not copies.
        """
        runner = self.explicit or self.implicit
        assert runner is not None
        return {
            "factorisations": self.implicit.stepper.solver.assembled if self.implicit else 0,
            "force": self.model.problem.reference_force,
            "solver": "implicit" if runner is self.implicit else "explicit",
            "model": self.model.snapshot(),
            "runner": runner.snapshot(),
            "state": self.state.snapshot(),
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen, after the rows; collective."""
        self.model.restore(kept["model"])
        if kept["solver"] == "implicit":
            assert self.implicit is not None
            self.implicit.stepper.restore(kept["runner"])
        else:
            self.explicit = ExplicitStage.resumed(self.state, kept["runner"])
            if self.implicit is not None:  # its stages are over
                self.implicit.stepper.solver.assembled = kept["factorisations"]
        self.model.problem.reference_force = kept["force"]  # of the last implicit evaluation
        self.state.restore(kept["state"])
