"""Writes a run into its results directory: history, fields, contact points, summary."""

from __future__ import annotations

import math
import resource
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, astuple, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model
from tribox.app.case.stage import LoadStep, solver_of
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.explicit.energies import energy_roundoff
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.implicit.stepper import StepResult
from tribox.app.results.claim import command
from tribox.app.results.directory import GrowingTable, write_json
from tribox.app.results.inputs import NOTHING, KeptInputs, host, kernels, versions, write_case
from tribox.app.results.output_files import OutputFiles
from tribox.app.results.probes import final_shapes
from tribox.app.results.saving import Saving
from tribox.app.simulation.energy_balance import notes_on_inertia
from tribox.app.simulation.explicit_stage import notes_on_bouncing
from tribox.app.simulation.history import COLUMNS, UNBALANCED, Row, energy_gap
from tribox.app.simulation.run_state import Interval, Observer, RunState
from tribox.app.simulation.simulation import Simulation
from tribox.app.simulation.watches import Watches
from tribox.forms.contact.penalty import ContactTerm, ContactTrial
from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.projection import FacetSurface

TINY = 1e-30  # J/m², below any dissipation
LOST_FILM = 0.01  # share of the friction lost below a film's onset from which a run is warned of
UNBALANCED_FORCE = 1e-4  # resultant on a body over the largest force from which it is


class Recorder(Observer):
    """Observer that writes files; all ranks take part, the first one writes.

    ``load_steps``: what each ended with; ``resumed``: steps at which an ended run was gone on with.
    """

    def __init__(
        self,
        model: Model,
        directory: Path,
        given: Sequence[str] = (),
        kept: KeptInputs = NOTHING,
        saving: Saving | None = None,
        resumed: Snapshot | None = None,
    ) -> None:
        """Open the outputs and write the resolved case; collective.

        ``given``: dotted keys of the case file, for the summary; ``kept``: copies of files that the
        resolved case names; ``saving``: keeps errors of writing; ``resumed``: what :meth:`snapshot`
        has seen, of a run that goes on: what was written after it is dropped.
        """
        self.model = model
        self.directory = directory
        self.saving = saving or Saving(directory)
        self.given = list(given)
        self._kept = kept
        self.comm = model.problem.comm
        self.first = self.comm.rank == 0
        self.load_steps: list[dict[str, Any]] = []
        self.resumed: list[int] = []
        self.every = model.case.output.fields_every
        self._started, self._begun = time.perf_counter(), datetime.now(UTC)
        self._watches = Watches(model, None if resumed is None else resumed["watches"])
        self._counted = (0, 0, 0)  # steps, Newton and linear iterations so far
        self._penalty = [_extent(self.comm, t.penalty) for t in model.problem.contacts]
        self.warnings: list[str] = list(model.notes)
        self._tables: RunTables | None = None
        if resumed is not None:
            self.load_steps = list(resumed["load_steps"])
            self.warnings += resumed["warnings"]
            self.resumed = list(resumed["resumed"])
        with self.saving:
            if self.first:
                write_case(self.model.case, self.directory, kept)
                # Of a run that was killed at that moment; with it no status would be written.
                (self.directory / "summary.json.part").unlink(missing_ok=True)
                self.mark("running")
        times = None if resumed is None else {int(step): time for step, time in resumed["times"]}
        self._files = OutputFiles(model, directory, self.saving, times)

    def mark(self, status: str, failure: str | None = None) -> None:
        """Write a summary, status and why it failed, as far as the first rank knows it."""
        path = self.directory / "summary.json"
        # From the handler of a signal this may come while such a summary is being written.
        if self.first and not path.with_name(path.name + ".part").exists():
            self.saving.place.check()
            write_json(path, self._known(status) | {"failure": failure})

    def attempt(
        self, state: RunState, load_step: LoadStep, dt: float, result: StepResult | Interval
    ) -> None:
        """Write how a step went that has been tried."""
        with self.saving:
            if self.first:
                attempt = attempt_row(state, load_step, dt, result)
                self._begun_tables(state).attempts.extend([attempt])

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """Write the outputs that are due and look for a negative dissipation."""
        if self.every and row.step % self.every == 0:
            self._output(state)
        self._watch(state, row)
        self._count([row])
        sampled = state.energy_balance.sampled * self.model.thickness
        self._watches.step(row, result, sampled)
        with self.saving:
            self._write_tables(state)

    def _count(self, rows: Sequence[Row]) -> None:
        """Count the steps of further rows, and their iterations."""
        _, newton, linear = self._counted
        newton += sum(row.newton_iterations for row in rows)
        linear += sum(row.linear_iterations for row in rows)
        self._counted = (rows[-1].step if rows else 0, newton, linear)

    def load_step(
        self, state: RunState, load_step: LoadStep, row: Row, steady: bool | None
    ) -> None:
        """Write the fields at the end of a load step and keep its last row."""
        self._output(state)
        self._watches.end(load_step.label)
        self.load_steps.append({"label": load_step.label, "steady": steady, **asdict(row)})
        if load_step.stage.rate_dependent:
            # Once for each contact whose film loses force below its onset.
            problem = self.model.problem
            pairs = zip(self.model.film_onset, problem.contacts, problem.committed, strict=True)
            for index, (onset, term, trial) in enumerate(pairs):
                lost = lost_below_onset(term, trial, onset, self.comm)
                if lost > 0.0 and self._watches.first_time(f"onset {index}"):
                    self.warnings.append(
                        f"contact.{index}: stage {load_step.label}: {100.0 * lost:.2g} % of the "
                        "film's force is lost where the pressure is below film_onset_pressure = "
                        f"{onset:.3g} Pa: the film carries less than eta_b V/D (a lower "
                        "film_onset_pressure)"
                    )
        if isinstance(state.stepper, ExplicitStepper):
            masses, inertia = state.stepper.masses, state.inertia[-1]
            added = masses.added / masses.original
            self.warnings += notes_on_inertia(self.model.case, load_step, inertia, added)
            self.warnings += notes_on_bouncing(state, load_step)
        if steady is False:
            self.warnings.append(
                f"stage {load_step.label}: not steady after {load_step.stage.max_steps} steps: "
                f"{state.steadiness.reason} (raise max_steps or slip_step)"
            )
        with self.saving:
            self.mark("running")

    def close(self, simulation: Simulation, status: str, failure: str | None = None) -> None:
        """Write history, summary and its status, or failure and the last state; collective.

        OutputError if something could not be written, and nothing else had failed.
        """
        unwritten = self.saving.problem_of_all(self.comm)
        balance = force_balance(simulation)
        if simulation.state.step:
            if unwritten is None:
                self._output(simulation.state)
            self.warnings.extend(self._watches.warnings(simulation.rows[-1].stage))
            self.warnings.extend(_unbalanced(simulation, balance))
            self.warnings.extend(self._watches.roundoff.warnings())
        explicit = {} if simulation.explicit is None else simulation.explicit.summary()
        shares = self.comm.gather(self._share())
        with self.saving:
            self._write_tables(simulation.state)
        self._files.write_indices()
        problem = self.saving.problem_of_all(self.comm)
        if problem is not None and failure is None:
            status, failure = "failed", problem
        if self.first:
            summary = self._summary(simulation, status, shares or [], balance)
            parts = {"explicit": explicit} if explicit else {}
            with self.saving:
                self.saving.place.check()
                write_json(self.directory / "summary.json", summary | parts | {"failure": failure})
        if failure is None or failure == problem:
            self.saving.raise_together(self.comm)

    def snapshot(self) -> Snapshot:
        """What the results so far hold, beside files; collective."""
        return {
            "load_steps": self.load_steps,
            "warnings": self.warnings[len(self.model.notes) :],
            "watches": self._watches.snapshot(),
            "times": list(self._files.times.items()),
            "resumed": self.resumed,
        }

    @property
    def inputs(self) -> dict[str, str]:
        """SHA-256 of the copies of what the case reads, by name; on the first rank."""
        return dict(self._kept.sums)

    def go_on(self, state: RunState) -> None:
        """Take up the tables after the last step of a run that goes on."""
        self.resumed.append(state.step)
        self._counted = (0, 0, 0)
        self._count(state.rows)
        if self.first:
            with self.saving:
                self._tables = RunTables(self.directory, state, state.step)
                self.mark("running")

    def sync(self) -> None:
        """See that the rows written so far are on the disk; for the first rank."""
        if self._tables is not None:
            self._tables.sync()

    def rescue(self, simulation: Simulation, status: str, failure: str | None = None) -> None:
        """Write the history after an error of this rank alone, its status and why."""
        with self.saving:
            self._write_tables(simulation.state)
            if self.first:
                self._files.write_indices()
            self.mark(status, failure)

    def _write_tables(self, state: RunState) -> None:
        if self.first:
            self.saving.place.check()
            self._begun_tables(state).write(state)

    def _begun_tables(self, state: RunState) -> RunTables:
        """The tables; begun when there is something to be written."""
        if self._tables is None:
            self._tables = RunTables(self.directory, state)
        return self._tables

    @property
    def last_output(self) -> tuple[float, str]:
        """Time, s, and files of the last output; there must be one."""
        step, when = next(reversed(self._files.times.items()))
        return when, self._files.described(step)

    def _output(self, state: RunState) -> None:
        if state.step in self._files.times:
            return
        problem = self.model.problem
        with problem.timer("output"):
            problem.spread(state.stepper.x)
            self._files.write(state.step, state.time)

    def _watch(self, state: RunState, row: Row) -> None:
        """Warn once of a negative dissipation beyond round-off."""
        for pair in state.resultants:
            if pair.area <= 0.0 or not pair.worst:
                continue
            scale = abs(row.dissipation) + abs(row.external_work) + abs(row.interface_energy)
            allowed = max(1e-12 * scale / (pair.area * self.model.thickness), TINY)
            if pair.least_dissipation < -allowed and self._watches.first_time("dissipation"):
                where = ", ".join(f"{c:.4g}" for c in pair.worst)
                self.warnings.append(
                    f"negative dissipation {pair.least_dissipation:.3g} J/m² at ({where}) m, "
                    f"{row.when}"
                )

    def _share(self) -> dict[str, Any]:
        """What this rank has of the work."""
        problem = self.model.problem
        return {
            "memory_MiB": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0, 1),
            "cells": sum(len(solid.cells) for solid in problem.solids),
            "contact_points": sum(len(term.surface.slave.weight) for term in problem.contacts),
            "contact_nodes": sum(len(term.surface.nodes) for term in problem.contacts),
        }

    def _known(self, status: str) -> dict[str, Any]:
        """What a summary says that the first rank knows at any moment."""
        return {
            "title": self.model.case.title,
            "status": status,
            "warnings": self.warnings,
            "notes": len(self.model.notes),
            "steps": self._counted[0],
            "newton_iterations": self._counted[1],
            "linear_iterations": self._counted[2],
            "load_steps": self.load_steps,
            "ranks": self.comm.size,
            "given": self.given,
            "inputs": self.inputs,
            "resumed": self.resumed,
            "started": self._begun.isoformat(timespec="seconds"),
            "command": command(),
            "host": host(),
            "versions": versions(),
            "kernels": kernels(),
        }

    def shapes(self) -> dict[str, dict[str, float | None]]:
        """What :func:`final_shapes` says; on the first rank."""
        ends = {int(one["step"]): float(one["normal_force"]) for one in self.load_steps}
        return final_shapes(self.directory, ends)

    def _summary(
        self,
        simulation: Simulation,
        status: str,
        shares: list[dict[str, Any]],
        balance: float | None,
    ) -> dict[str, Any]:
        rows, problem, implicit = simulation.rows, self.model.problem, simulation.implicit
        assembled = implicit.stepper.solver.assembled if implicit else 0
        wall, worst = time.perf_counter() - self._started, self._watches.roundoff.worst
        timings = {key: round(value, 4) for key, value in simulation.stepper.seconds().items()}
        return self._known(status) | {
            "steps": len(rows),
            "factorisations": assembled,
            "attempts": sum(row.attempts for row in rows),
            "energy_error_relative": energy_gap(rows),
            "force_balance_relative": balance,
            "residual_at_roundoff": worst.share if worst else None,
            "penalty": self._penalty,
            "film_onset_pressure": self.model.film_onset,
            "penetration_over_facet": self._watches.contacts.over_facet,
            "penetration_over_approach": self._watches.contacts.over_approach,
            "penetration_over_film": [
                pair.penetration / pair.film if pair.film > 0.0 else None
                for pair in simulation.state.resultants
            ],
            "bodies": [solid.name for solid in problem.solids],
            **({"tools": simulation.state.tools.last()} if problem.tools else {}),
            **({"shapes": self.shapes()} if self.model.lines else {}),
            "dofs": int(problem.space.dofmap.index_map.size_global * problem.dim),
            "seconds": {"run": round(wall, 4), **timings},
            **{f"{part}_per_rank": [share[part] for share in shares] for part in shares[0]},
        }


def lost_below_onset(term: ContactTerm, trial: ContactTrial, onset: float, comm: MPI.Comm) -> float:
    """Share of the film's force that pressures below the ``onset``, Pa, take away; collective.

    By the work of a step; 0 where less than `LOST_FILM` of the friction is missing.
    """
    if onset <= 0.0:
        return 0.0
    weight, parts = term.surface.slave.weight, trial.response.dissipation
    share = np.where(trial.pressure > 0.0, np.minimum(trial.pressure / onset, 1.0), 1.0)
    sums = [(weight * work).sum() for work in (parts.viscous, parts.viscous / share, parts.total)]
    felt, whole, friction = comm.allreduce(np.array(sums))
    lost = whole - felt
    return float(lost / whole) if lost > LOST_FILM * (friction + lost) else 0.0


def _extent(comm: MPI.Comm, values: Floats) -> list[float]:
    """Smallest and largest of values of all ranks; collective."""
    least = comm.allreduce(float(np.min(values, initial=np.inf)), op=MPI.MIN)
    return [least, comm.allreduce(float(np.max(values, initial=0.0)), op=MPI.MAX)]


def force_balance(simulation: Simulation) -> float | None:
    """Largest resultant on a body in equilibrium over the largest force; None: rounding only."""
    case, problem = simulation.model.case, simulation.model.problem
    still = [s.name for s in case.stage if solver_of(s, case.solver.kind) == "implicit"]
    problem.spread(simulation.state.stepper.x)  # not what a failed step left
    noise = max(problem.roundoff * simulation.model.thickness, simulation.state.springs)
    largest = simulation.state.tools.largest_force(still)
    return simulation.state.motion.force_balance(still, noise, largest)


def _unbalanced(simulation: Simulation, balance: float | None) -> Iterator[str]:
    """Warnings on a run whose forces or energies do not add up; its :func:`force_balance`."""
    if balance is None and simulation.explicit is None:
        return  # nothing but rounding acts
    if balance is not None and balance > UNBALANCED_FORCE:
        yield (
            f"forces on a body add up to zero only to {balance:.2g} of the largest: "
            "solver.tolerance is too large for them, or rounding leaves no less"
        )
    gap = abs(energy_gap(simulation.rows))
    noise = energy_roundoff(simulation.model.problem) * simulation.model.thickness
    error = abs(simulation.rows[-1].energy_error)
    if gap <= UNBALANCED or error <= noise:
        return
    # Contacts store nothing at the start, but for surfaces that overlap; what these press with is
    # no force of an equilibrium, and a press fit's work is counted with it.
    given = -min(row.interface_energy for row in simulation.rows)
    if given > 0.5 * error or (given > 0.01 * error and _mostly_first(simulation.rows)):
        steps = "smaller steps change nothing" if given > 0.5 * error else "or a short first step"
        cause = (
            "surfaces that overlap at the start give back what they press with there, which counts "
            f'as no work (leave a gap, or interference = "drawn"; {steps})'
        )
    else:
        cause = (
            "the steps are too long for what happens in them, or for the trapezoidal rule under "
            f"forces that rise steeply (smaller steps){_faceted(simulation)}"
            f"{_cornered(simulation)}{_worst_step(simulation.rows)}"
        )
    yield f"energy is balanced only to {gap:.2g} of the work: {cause}"


def _mostly_first(rows: Sequence[Row]) -> bool:
    """Whether the first step makes more than half of the energy error."""
    return rows[0].energy_error / rows[-1].energy_error > 0.5


def _faceted(simulation: Simulation) -> str:
    """Words on masters of facets."""
    masters = [term.surface.target for term in simulation.model.problem.contacts]
    if not any(isinstance(m, FacetSurface) and m.extraction is None for m in masters):
        return ""
    return ", or facets of a curved master catch (a finer master, or smoothing_angle)"


def _cornered(simulation: Simulation) -> str:
    """Words on tools with sharp corners, which the slave's normals decide the pressures' way at."""
    tools = simulation.model.case.tools
    names = {
        table.master: None
        for table, term in zip(
            simulation.model.case.contact, simulation.model.problem.contacts, strict=True
        )
        if table.master in tools and term.surface.normals is not None
    }
    if not names:
        return ""
    return (
        f", or the slave slides past sharp corners of {', '.join(names)}, where pressures act "
        "along its normals (fillet_radius, or a finer slave; no number of steps changes that)"
    )


def _worst_step(rows: Sequence[Row]) -> str:
    """Words on the step that the larger part of the energy error is from, if it is one step."""
    errors = np.array([0.0, *(row.energy_error for row in rows)])
    grown = np.diff(errors)
    at = int(np.argmax(np.abs(grown)))
    if abs(grown[at]) < 0.5 * abs(errors[-1]) or grown[at] * errors[-1] < 0.0 or len(rows) == 1:
        return ""
    row = rows[at]
    first = at == 0 or rows[at - 1].stage != row.stage
    where = (
        "a load that begins more gently there follows the way that the trapezoidal rule has to "
        "guess"
    )
    if first:
        where += (
            "; one that stands in full from the stage's start comes on within its first step, "
            "however short: let it grow over the stage (a table over time)"
        )
    return f"; {100.0 * grown[at] / errors[-1]:.0f} % of it is from the step to {row.when}: {where}"


# -- The tables of a run: a row for each converged step, and each pair, surface, body, tool at it
#
# ``progress.csv`` has a row for each attempt at an implicit step, whether it converged or not, and
# for each interval of an explicit stage, also the one in which a run fails.

ATTEMPT_COLUMNS = (
    *("step", "stage", "attempt", "time", "dt", "fraction", "converged"),
    *("iterations", "factorisations", "residual", "reason", "cuts"),
    *("time_steps", "time_step", "kinetic_ratio"),
)


def attempt_row(
    state: RunState, load_step: LoadStep, dt: float, result: StepResult | Interval
) -> tuple[int | float | str, ...]:
    """A row of ``progress.csv``: an attempt of ``dt`` (s) at the step after the last one."""
    failures = state.position.failures
    case = state.model.case
    stepped = {s.name for s in case.stage if solver_of(s, case.solver.kind) == "implicit"}
    cuts = sum(row.attempts - 1 for row in state.rows if row.stage in stepped) + failures
    if isinstance(result, Interval):
        return (
            *(state.step + 1, load_step.label, 1),
            *(state.time, dt, dt / load_step.dt, int(not result.failed)),
            *(0, 0, math.nan, 0, cuts),
            *(result.steps, result.dt, result.kinetic_ratio),
        )
    return (
        *(state.step + 1, load_step.label, failures + 1),
        *(state.time + dt, dt, dt / load_step.dt, int(result.converged)),
        *(result.iterations, result.factorisations),
        result.residuals[-1] if result.residuals else math.nan,
        result.reason,
        cuts + (not result.converged),
        *(0, math.nan, math.nan),
    )


def tables_of(state: RunState) -> dict[str, tuple[Sequence[str], int, list[Any]]]:
    """Columns, rows of each step, and the rows so far of each table, by its name."""
    motion, model = state.motion, state.model
    surfaces, bodies, tools = len(motion.surfaces), len(model.problem.solids), model.problem.tools
    tables: dict[str, tuple[Sequence[str], int, list[Any]]] = {
        "history": (COLUMNS, 1, state.rows),
        "surfaces": (motion.surface_columns, surfaces, motion.surface_rows),
        "bodies": (motion.body_columns, bodies, motion.body_rows),
    }
    if tools:
        tables["tools"] = (state.tools.columns, len(tools), state.tools.rows)
    if model.case.contact:
        tables["contacts"] = (state.pair_columns, len(model.case.contact), state.pair_rows)
    return tables


class RunTables:
    """``history.csv``, ``surfaces.csv``, ``bodies.csv``; others where there is what they tell."""

    def __init__(self, directory: Path, state: RunState, after: int | None = None) -> None:
        """Begin the files, or go on with those of a run ``after`` a step of it."""
        self._driven = {stage.name for stage in state.model.case.stage if stage.is_driven}
        self._tables = {
            name: GrowingTable(directory / f"{name}.csv", columns, after)
            for name, (columns, _, _) in tables_of(state).items()
        }
        path, tried = directory / "progress.csv", state.position.failures
        self.attempts = GrowingTable(path, ATTEMPT_COLUMNS, after, tried)

    def write(self, state: RunState) -> None:
        """Append the rows that are new."""
        for name, (_, _, rows) in tables_of(state).items():
            table = self._tables[name]
            new = rows[table.written :]
            table.extend([self._values(row) for row in new] if name == "history" else new)

    def _values(self, row: Row) -> tuple[Any, ...]:
        """A row of the history; without a velocity where nothing is driven."""
        return astuple(row if row.stage in self._driven else replace(row, velocity=math.nan))

    def sync(self) -> None:
        """See that the rows are on the disk."""
        for table in (*self._tables.values(), self.attempts):
            table.sync()
