"""Runs the stages of a case, one load step after the other."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from app.build.load_steps import LoadStep, load_steps_of
from app.build.model import Model
from app.build.numbers import failures_as
from app.case.stage import Stage, solver_of
from app.errors import InputError, SolutionError
from app.explicit.stepper import ExplicitStepper
from app.implicit.stepper import ImplicitStepper
from app.simulation.explicit_stage import ExplicitStage
from app.simulation.history import Row
from app.simulation.implicit_stage import ImplicitStage
from app.simulation.observer import Observer
from app.simulation.run_state import RunState


class StageRunner(Protocol):
    """What runs load steps: from the state of the run as it is, to the state at their end."""

    def run(self, load_step: LoadStep, observer: Observer) -> None:
        """Run one load step to its end, or until steady; collective.

        Raises:
            SolutionError: there is no way on; the state is the last valid one.
        """


class Simulation:
    """One case being run.

    Attributes:
        state: how far it has come.
        implicit: what runs implicit stages; None without any.
        explicit: what runs explicit stages; None before the first of them.
    """

    @failures_as(InputError, "the start")
    def __init__(self, model: Model) -> None:
        """Make ready to start; collective.

        Raises:
            InputError: PETSc refuses an option of the case, or has no use for it; an element is
                inside out at the start of an explicit run, or numbers are out of range.
        """
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
        """Run all stages.

        Raises:
            SolutionError: a step failed however short it was made; the state is the last
                converged one.
        """
        case, velocity = self.model.case, 0.0
        for stage in case.stage:
            self.model.begin_stage(stage.name)
            with failures_as(SolutionError, f"stage {stage.name}"):
                runner = self._runner(stage)
                for load_step in load_steps_of(stage, case.film_conductance, velocity):
                    runner.run(load_step, observer)
                    velocity = load_step.velocity

    def _runner(self, stage: Stage) -> StageRunner:
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
