"""Runs the stages of a case, one load step after the other."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from tribox.app.build.load_steps import LoadStep, all_load_steps
from tribox.app.build.model import Model
from tribox.app.build.numbers import failures_as
from tribox.app.case.stage import Stage, solver_of
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.errors import InputError, SolutionError
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.implicit.stepper import ImplicitStepper
from tribox.app.simulation.contact_resultants import begin_stage
from tribox.app.simulation.explicit_stage import ExplicitStage
from tribox.app.simulation.history import Row
from tribox.app.simulation.implicit_stage import ImplicitStage
from tribox.app.simulation.run_state import Observer, RunState


class StageRunner(Protocol):
    """What runs load steps: from the state of the run as it is, to the state at their end."""

    def begin(self, load_step: LoadStep) -> None:
        """A load step begins that :meth:`run` will be asked for, perhaps more than once."""

    def run(self, load_step: LoadStep, observer: Observer) -> None:
        """Run one load step, or what is left of it, to its end, or until steady; collective.

        Raises:
            SolutionError: there is no way on; the state is the last valid one.
        """

    def snapshot(self) -> Snapshot:
        """All that the next step depends on, beside the loads; collective."""


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
        """Run all stages, from where the run stands.

        Raises:
            SolutionError: a step failed however short it was made; the state is the last
                converged one.
        """
        state, at = self.state, self.state.position
        for load_step in all_load_steps(self.model.case)[at.load_step :]:
            released = begin_stage(self.model, load_step.stage.name, state.stepper.x)
            state.energy_balance.take_over(released)
            with failures_as(SolutionError, f"stage {load_step.stage.name}"):
                runner = self._runner(load_step.stage)
                if at.begin(state.time, state.driven, len(state.rows)):
                    runner.begin(load_step)
                runner.run(load_step, observer)
            at.end()
        observer.ready(state)

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

    # -- restart ------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """All that the rest of the run depends on, but for the rows; collective.

        To be taken where an observer's ``ready`` is called. Arrays are views, not copies.
        """
        runner = self.explicit or self.implicit
        assert runner is not None
        return {
            "factorisations": self._factorisations(),
            "force": self.model.problem.reference_force,
            "solver": "implicit" if runner is self.implicit else "explicit",
            "model": self.model.snapshot(),
            "runner": runner.snapshot(),
            "state": self.state.snapshot(),
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen; collective.

        The rows must have been put back.
        """
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

    def _factorisations(self) -> int:
        return self.implicit.stepper.solver.assembled if self.implicit else 0
