"""Runs explicit load steps: many short time steps between two rows of the history.

What an implicit run calls a step is here an *interval*: a piece of the stage that ends with a row.
It is cut into equal time steps no longer than the stable one. Forces in the row are means over the
interval, so that they do not depend on where in an oscillation it ends; energies are added up step
by step, on each rank by itself, and put together once an interval.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model, failures_as, initial_velocity
from tribox.app.case.solver import Solver
from tribox.app.case.stage import LoadStep, load_steps_of, solver_of
from tribox.app.equilibrium.snapshot import Partial, Snapshot, to_bodies, to_contacts
from tribox.app.errors import InputError, SolutionError
from tribox.app.explicit.energies import ExplicitError
from tribox.app.explicit.stable_step import ExplicitOptions, ScaledMass
from tribox.app.explicit.stepper import ExplicitStepper, MassScaling
from tribox.app.simulation import contact_resultants
from tribox.app.simulation.history import time_text
from tribox.app.simulation.motion_history import OutsideForces, OutsideMean
from tribox.app.simulation.run_state import Interval, Observer, RunState
from tribox.forms.contact.law_faults import law_fault
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.forms.friction.guarded_law import LawError
from tribox.geometry.surfaces.facets import Floats

CHECK_EVERY = 100  # time steps between two looks at the stable step and for an interruption
MANY_STEPS = 1e6  # time steps of a stage that deserve a word of advice
MOST_STEPS = 10**9  # time steps of one interval from which the run would never end
OPEN = 0.15  # share of the area at the start of a stage that may be open in the mean
LOADED = 0.9  # of the force at the start, from which on the load counts as the same
# A patch that shrinks evenly loses in all twice what it lacks in the mean; one that goes up and
# down more than this many times as much flickers.
FLICKER = 4.0


def explicit_options(solver: Solver) -> ExplicitOptions:
    """The stepper's options from the [solver] table."""
    scaling = solver.mass_scaling
    return ExplicitOptions(
        dt_safety=solver.step_safety,
        damping=solver.damping,
        mass_scaling=None
        if scaling is None
        else MassScaling(scaling.kind, scaling.factor, scaling.step),
    )


@failures_as(InputError, "the start")
def notes_on_steps(model: Model) -> list[str]:
    """How long and how many the time steps of explicit stages are; collective.

    Sets the new model's loads to the start; InputError if a law or an element fails there.
    """
    case = model.case
    if not case.is_explicit:
        return []
    model.set_loads(0.0, 0.0)
    try:
        stepper = ExplicitStepper(model.problem, explicit_options(case.solver))
    except LawError as error:
        raise InputError(str(error)) from None
    dt = case.solver.step_safety * stepper.stable_step()
    notes = [f"explicit: time step {dt:.3g} s, limited by {stepper.limit}"]
    if stepper.masses.added > 0.0:
        share = stepper.masses.added / stepper.masses.original
        added = f"{100.0 * share:.3g} % of" if share < 1.0 else f"{share:.3g} times"
        notes[0] += f"; mass_scaling adds {added} the mass"
    for stage in case.stage:
        if solver_of(stage, case.solver.kind) == "implicit":
            continue
        load_steps = list(load_steps_of(stage, case.film_conductance))
        count = (
            sum(
                load_step.dt * (load_step.steps or load_step.stage.min_steps)
                for load_step in load_steps
            )
            / dt
        )
        least = "at least" if stage.velocities else "about"
        notes.append(f"explicit: stage {stage.name} takes {least} {count:.2g} time steps")
        if count > MANY_STEPS:
            notes[-1] += ' (shorten it, scale the mass, or give it solver = "implicit")'
    return notes


def notes_on_bouncing(state: RunState, load_step: LoadStep) -> Iterator[str]:
    """Warnings after an explicit load step: contact that flickers while its load stays."""
    columns = ("stage", "contact_area", "normal_force")
    at = [state.pair_columns.index(name) for name in columns]
    pairs, count = len(state.resultants), state.position.count
    for index, term in enumerate(state.model.problem.contacts):
        rows = [tuple(row[i] for i in at) for row in state.pair_rows[index::pairs]]
        before = [row for row in rows if row[0] != load_step.stage.name]
        if term.tied or not before:
            continue
        first, load = float(before[-1][1]), float(before[-1][2])
        area = np.array([first, *(row[1] for row in rows[-count:])], dtype=np.float64)
        force = float(np.mean([row[2] for row in rows[-count:]]))
        lacks = first - float(area[1:].mean())
        moved = float(np.abs(np.diff(area)).sum())
        stays = LOADED * load < force < load / LOADED
        hops = float(np.mean(area == 0.0)) > OPEN  # what carries the load and is often off bounces
        if stays and lacks > OPEN * first and (hops or moved > FLICKER * lacks):
            yield (
                f"contact.{index}: stage {load_step.label}: the contact bounces: of the area at "
                f"the start of the stage {100.0 * (1.0 - lacks / first):.2g} % are closed in the "
                f"mean, at times {100.0 * area.min() / first:.2g} %, under "
                f"{100.0 * force / load:.3g} % of the force: viscous friction and film are too "
                "small by about what is open (a longer ramp, damping, a lower penalty_factor)"
            )


class ExplicitStage:
    """Runs the explicit load steps of a simulation.

    ``averages``: of contacts over the interval at hand; ``steps``: so far; ``shortest``,
    ``longest``: s, stable steps met.
    """

    def __init__(
        self,
        state: RunState,
        displacement: Floats,
        rate_dependent: bool = True,
        masses: ScaledMass | None = None,
    ) -> None:
        """Take over displacements (n,), m, and masses, None: scaled anew; collective.

        A law that fails at once is an InputError, or later in the run a SolutionError.
        """
        self.state, self.model = state, state.model
        try:
            self.stepper = ExplicitStepper(
                self.model.problem,
                explicit_options(self.model.case.solver),
                displacement=displacement,
                velocity=initial_velocity(self.model),
                rate_dependent=rate_dependent,
                masses=masses,
            )
        except LawError as error:
            raise (SolutionError if state.step else InputError)(str(error)) from None
        state.stepper = self.stepper
        self.averages = IntervalAverages(self.stepper)
        self.steps = 0
        self.shortest, self.longest = math.inf, 0.0
        state.energy_balance.set_initial_kinetic_energy(self.stepper.kinetic_energy())
        self._peak = 0.0
        self._stable = self._dt = 0.0

    @classmethod
    def resumed(cls, state: RunState, kept: Snapshot) -> ExplicitStage:
        """Go on from what :meth:`snapshot` has seen, under the loads of that time; collective."""
        problem, stepper = state.model.problem, kept["stepper"]
        for term, history in zip(
            problem.contacts, to_contacts(problem.contacts, stepper["contacts"]), strict=True
        ):
            term.adopt(history)
        problem.u.x.array[: problem.owned] = stepper["u"]
        problem.u.x.scatter_forward()
        to_bodies(problem.solids, stepper["bodies"])
        for solid in problem.solids:
            solid.repeat_step()
        masses = ExplicitStepper.masses_in(stepper)
        stage = cls(state, stepper["u"], kept["rate_dependent"], masses)
        stage.stepper.restore(stepper)
        problem.committed = list(problem.trials)
        stage.steps, stage.shortest, stage.longest, stage._peak, stage._stable = kept["numbers"]
        stage.averages = IntervalAverages(stage.stepper)
        stage.averages.restore(kept["averages"])
        return stage

    def snapshot(self) -> Snapshot:
        """All that the next step depends on, beside the loads; collective."""
        return {
            "stepper": self.stepper.snapshot(),
            "rate_dependent": self.stepper.rate_dependent,
            "numbers": [self.steps, self.shortest, self.longest, self._peak, self._stable],
            "averages": self.averages.snapshot(),
        }

    def advance(self, load_step: LoadStep, observer: Observer) -> None:
        """Steps up to the next row, and it; SolutionError if a cell folds, or energy runs away."""
        state, at, before = self.state, self.state.position, self.steps
        start, within = at.time + at.count * load_step.dt, at.within
        try:
            self._steps(load_step, observer)
        except SolutionError:
            made = self.steps - before + within
            lost = Interval(made, self._dt, self._stable, self.steps, math.nan, failed=True)
            observer.attempt(state, load_step, state.time - start, lost)
            raise

    def _steps(self, load_step: LoadStep, observer: Observer) -> None:
        """What :meth:`advance` does, if nothing fails."""
        at = self.state.position
        start, driven, end = at.time, at.driven, (at.count + 1) * load_step.dt
        if at.within == 0:
            at.elapsed = at.count * load_step.dt
            self.averages.open()
        while True:
            observer.ready(self.state)
            left, dt = self._division(load_step, end - at.elapsed)
            chunk = min(left, CHECK_EVERY)
            last = chunk == left
            for k in range(1, chunk + 1):
                now = end if last and k == chunk else at.elapsed + k * dt
                self.model.set_loads(start + now, driven + load_step.travel(now))
                self._advance(load_step, dt, start + now)
            at.within += chunk
            self.steps += chunk
            if last:
                break
            at.elapsed += chunk * dt
            self.state.time = start + at.elapsed
            observer.within(self.state, load_step, self.steps)
        self.state.time = start + end
        self.state.driven = driven + load_step.travel(end)
        made, at.count, at.within = at.within, at.count + 1, 0
        self._row(load_step, dt, made, observer)

    def _division(self, load_step: LoadStep, left: float) -> tuple[int, float]:
        """Number and length (s) of equal steps in the rest of an interval, none too long."""
        with self.model.problem.timer("stable step"):
            self._stable = self.stepper.stable_step()
        self.shortest = min(self.shortest, self._stable)
        self.longest = max(self.longest, self._stable)
        longest = self.model.case.solver.step_safety * self._stable
        # Steps of a length that is met but for round-off are not cut in two.
        share = left / longest * (1.0 - 1e-9) if longest > 0.0 else math.inf
        if not share < MOST_STEPS:
            when = time_text(self.state.time, self._stable)
            raise SolutionError(
                f"stage {load_step.label}, time {when}: the stable step has "
                f"shrunk to {self._stable:.3g} s; an element is about to fold, or the stage is far "
                "too long for explicit dynamics"
            )
        count = max(1, math.ceil(share))
        self._dt = left / count
        return count, self._dt

    def _advance(self, load_step: LoadStep, dt: float, time: float) -> None:
        before = self.stepper.steps
        try:
            self.stepper.advance(dt)
        except ExplicitError as error:
            # What is saved is the last state without a folded element.
            self.state.time = time if self.stepper.steps > before else time - dt
            raise SolutionError(
                f"stage {load_step.label}, time {time_text(time, dt)}: {error}; check the loads "
                "and the mesh there, try a smaller step_safety or a higher penalty"
            ) from None
        except LawError as error:
            self.state.time = time - dt
            when = time_text(time, dt)
            raise SolutionError(f"stage {load_step.label}, time {when}: {error}") from None
        with self.model.problem.timer("averages"):
            self.averages.enter(dt)
        if load_step.stage.relax:
            self._calm()

    def _calm(self) -> None:
        """Kinetic damping: stop all motion where the kinetic energy has passed a peak."""
        energy = self.stepper.kinetic_energy()
        if energy < self._peak:
            self.stepper.rest()
            self.averages.removed += energy - self.stepper.kinetic_energy()
            energy = 0.0
        self._peak = energy

    def _row(self, load_step: LoadStep, dt: float, steps: int, observer: Observer) -> None:
        """Take the contacts' resultants, enter the energies and add a row; collective."""
        state, problem = self.state, self.model.problem
        if fault := law_fault(problem.contacts, problem.committed):
            when = time_text(state.time, dt)
            raise SolutionError(f"stage {load_step.label}, time {when}: {fault}")
        problem.spread(self.stepper.x)
        with problem.timer("resultants"):
            ends = state.resultants_of(problem.committed)
            driven, kinetic = state.driven_direction(), self.stepper.kinetic_energy()
            state.resultants, work, damping, outside = self.averages.close(ends, driven)
            state.energy_balance.add_interval(state.resultants, work, damping, kinetic)
        inertia = state.inertia[-1]
        inertia.add(kinetic, state.energy_balance.strain)
        interval = Interval(steps, dt, self._stable, self.steps, inertia.last)
        observer.attempt(state, load_step, load_step.dt, interval)
        velocity = self.stepper.whole_step_velocity
        row = state.add_row(
            load_step,
            dt,
            iterations=0,
            attempts=steps,
            linear=0,
            velocity=velocity,
            outside=outside,
        )
        observer.step(state, row, interval)

    def summary(self) -> dict[str, Any]:
        """What a results summary says of the explicit part of a run; collective."""
        t, stepper = self.model.thickness, self.stepper
        return {
            "time_steps": self.steps,
            "stable_step": {"shortest": self.shortest, "longest": self.longest},
            "limited_by": stepper.limit,
            "added_mass": stepper.masses.added * t,
            "kinetic_over_strain": {one.label: one.ratio for one in self.state.inertia},
        }


# -- What the contacts and loads do over many explicit steps, added up without communication -------


@dataclass(slots=True)
class _Tally:
    """Sums over the steps of an interval for one pair, this rank's part."""

    time: float = 0.0  # s, length of the interval so far
    # ∫ dt of the pair's vector integrals (i), by name
    vectors: dict[str, Floats] = field(default_factory=dict)
    dissipated: float = 0.0  # J/m, energy dissipated
    numerical: float = 0.0  # J/m, energy by the time integration
    least: float = np.inf  # J/m², least dissipation met
    worst: tuple[float, ...] = ()  # where, m

    def add(self, term: ContactTerm, trial: ContactTrial, before: Floats, dt: float) -> None:
        """Add a step of ``dt`` (s) after tractions ``before`` (q, i), Pa."""
        weight, parts = term.surface.slave.weight, trial.response.dissipation
        lost = parts.total
        self.time += dt
        for name, vector in contact_resultants.vector_integrals(term, trial).items():
            self.vectors[name] = dt * vector + self.vectors.get(name, 0.0)
        self.dissipated += float(weight @ lost) + contact_resultants.fading_loss(term, trial)
        self.numerical += contact_resultants.lost_by_rule(term, trial, before)
        lost -= parts.numerical
        at = int(np.argmin(lost)) if len(lost) else -1
        if at >= 0 and lost[at] < self.least:
            self.least, self.worst = float(lost[at]), tuple(map(float, trial.position[at]))

    def over(
        self,
        end: contact_resultants.ContactResultants,
        driven: Sequence[float] | None,
        ring: bool,
        comm: MPI.Comm,
    ) -> contact_resultants.ContactResultants:
        """Resultants at the end, with mean forces and the interval's dissipation; collective."""
        work = np.zeros(len(self.vectors["force"]))
        work[:2] = self.dissipated, self.numerical
        total = comm.allreduce(np.array([*self.vectors.values(), work]))
        means: dict[str, Floats] = dict(zip(self.vectors, total[:-1] / self.time, strict=True))
        least, worst = min(comm.allgather((self.least, self.worst)))
        return replace(
            end,
            **contact_resultants.resultants(means, driven, ring),
            dissipated=float(total[-1, 0]),
            numerical=float(total[-1, 1]),
            least_dissipation=least,
            worst=worst,
        )


class IntervalAverages:
    """Adds up forces, work and dissipation step by step.

    Attributes:
        removed: J/m, kinetic energy taken by relaxation, the same on all ranks.
    """

    def __init__(self, stepper: ExplicitStepper) -> None:
        self.stepper = stepper
        self.problem = stepper.problem
        self.removed = 0.0
        self._tractions = [t.state.friction_traction for t in self.problem.contacts]
        self._taken = (stepper.energies.work, stepper.energies.damped)
        self.open()

    def open(self) -> None:
        """Begin an interval."""
        self._tallies = [_Tally() for _ in self.problem.contacts]
        self._outside = OutsideMean(self.stepper)

    def snapshot(self) -> Snapshot:
        """The sums of the interval at hand; collective."""
        comm = self.problem.comm
        tallies = []
        for tally in self._tallies:
            sums = {name: Partial(vector) for name, vector in tally.vectors.items()}
            least, worst = min(comm.allgather((tally.least, tally.worst)))
            tallies.append(
                {
                    "time": tally.time,
                    "vectors": sums,
                    "work": Partial(np.array([tally.dissipated, tally.numerical])),
                    "least": [least, list(worst)],
                }
            )
        return {
            "tallies": tallies,
            "outside": self._outside.snapshot(),
            "removed": self.removed,
            "taken": Partial(np.array(self._taken)),
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._tallies = []
        for one in kept["tallies"]:
            dissipated, numerical = map(float, one["work"])
            least, worst = one["least"]
            self._tallies.append(
                _Tally(one["time"], one["vectors"], dissipated, numerical, least, tuple(worst))
            )
        self._outside.restore(kept["outside"])
        self.removed = kept["removed"]
        self._taken = (float(kept["taken"][0]), float(kept["taken"][1]))

    def enter(self, dt: float) -> None:
        """Enter the step of ``dt`` (s) just made; local to the rank."""
        pairs = zip(self.problem.contacts, self.problem.committed, self._tallies, strict=True)
        for number, (term, trial, tally) in enumerate(pairs):
            tally.add(term, trial, self._tractions[number], dt)
            self._tractions[number] = trial.response.traction
        self._outside.enter(dt)

    def close(
        self,
        ends: Sequence[contact_resultants.ContactResultants],
        driven: Sequence[float] | None = None,
    ) -> tuple[list[contact_resultants.ContactResultants], float, float, OutsideForces]:
        """End it; resultants with means, work and damping (J/m), outside forces; collective."""
        comm = self.problem.comm
        parts = zip(self.problem.contacts, ends, self._tallies, strict=True)
        means = [
            tally.over(end, driven, term.surface.axisymmetric, comm) for term, end, tally in parts
        ]
        taken = (self.stepper.energies.work, self.stepper.energies.damped)
        local = np.subtract(taken, self._taken)
        self._taken = taken
        work, damped = map(float, comm.allreduce(local))
        damped += self.removed
        self.removed = 0.0
        return means, work, damped, self._outside.close()
