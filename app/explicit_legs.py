"""Carries a simulation through explicit stages: many short steps between two rows of the history.

What an implicit run calls a step is here an *interval*: a piece of the stage that ends with a row.
It is cut into equal time steps no longer than the stable one. Forces in the row are means over the
interval, so that no oscillation is sampled askew; energies are added up step by step, on each rank
by itself, and put together once an interval.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from app.books import Books
from app.case_boundary import solver_of
from app.case_run import Solver
from app.errors import SolutionError
from app.explicit import ExplicitError, ExplicitOptions, ExplicitStepper, MassScaling
from app.legs import Inertia, Leg, legs_of
from app.measure import measure_contact
from app.model import Model, initial_velocity
from app.motion import Motion
from geometry.facets import Floats

if TYPE_CHECKING:
    from app.simulation import Observer, Simulation

CHECK_EVERY = 100  # time steps between two looks at the stable step and at the user's wishes
MANY_STEPS = 1e6  # time steps of a stage that deserve a word of advice
MOST_STEPS = 10**9  # time steps of one interval from which the run would never end


@dataclass(frozen=True, slots=True)
class Interval:
    """How an explicit run got from one row to the next.

    Attributes:
        steps: time steps; dt: s, of the last of them; stable: s, stable step at the end.
        total: time steps of the run so far.
        kinetic_ratio: kinetic over strain energy at the end; 0 without strain energy.
    """

    steps: int
    dt: float
    stable: float
    total: int
    kinetic_ratio: float


def explicit_options(solver: Solver) -> ExplicitOptions:
    """The stepper's options from the [solver] table."""
    scaling = solver.mass_scaling
    return ExplicitOptions(
        dt_safety=solver.step_safety,
        damping=solver.damping,
        mass_scaling=None
        if scaling is None
        else MassScaling(scaling.kind, scaling.factor, scaling.step),
        viscous=solver.viscous,
    )


def notes_on_steps(model: Model) -> list[str]:
    """How long the time steps of a case's explicit stages are, and how many; collective.

    The model must be as it was built; its loads are set to those of the start.
    """
    case = model.case
    if not case.is_explicit:
        return []
    model.set_loads(0.0, 0.0)
    stepper = ExplicitStepper(model.problem, explicit_options(case.solver))
    dt = case.solver.step_safety * stepper.stable_step()
    notes = [f"explicit: time step {dt:.3g} s, limited by {stepper.limit}"]
    if stepper.added_mass > 0.0:
        share = stepper.added_mass / stepper.original_mass
        notes[0] += f"; mass_scaling adds {share:.3g} of the mass"
    for stage in case.stage:
        if solver_of(stage, case.solver.kind) == "implicit":
            continue
        legs = list(legs_of(stage, case.film_conductance))
        count = sum(leg.dt * (leg.steps or leg.stage.min_steps) for leg in legs) / dt
        least = "at least" if stage.velocities else "about"
        notes.append(f"explicit: stage {stage.name} takes {least} {count:.2g} time steps")
        if count > MANY_STEPS:
            notes[-1] += ' (shorten it, scale the mass, or give it solver = "implicit")'
    return notes


class ExplicitLegs:
    """Runs the explicit legs of a simulation.

    Attributes:
        stepper: central differences; motion: mean motion of bodies and platens, by row.
        steps: time steps so far; shortest, longest: s, stable steps met.
        inertia: kinetic against strain energy of each leg.
    """

    def __init__(self, simulation: Simulation, displacement: Floats) -> None:
        """Take over from the state that the simulation is in; collective.

        Args:
            simulation: the run; its contacts hold the history.
            displacement: (n,), m, of the owned unknowns.
        """
        model = simulation.model
        self.simulation, self.model = simulation, model
        velocity = initial_velocity(model)
        self.stepper = ExplicitStepper(
            model.problem,
            explicit_options(model.case.solver),
            displacement=displacement,
            velocity=velocity,
        )
        self.books = Books(self.stepper)
        self.motion = Motion(model, self.stepper)
        self.steps = 0
        self.shortest, self.longest = math.inf, 0.0
        self.inertia: list[Inertia] = []
        simulation.ledger.throw(self.stepper.kinetic_energy())
        self._peak = 0.0
        self._stable = 0.0

    def run_leg(self, leg: Leg, observer: Observer) -> None:
        """Run one leg to its end, or until steady; collective.

        Raises:
            SolutionError: an element is turned inside out, or the energy runs away.
        """
        simulation = self.simulation
        self.inertia.append(Inertia(leg.label))
        start, driven = simulation.time, simulation.driven
        steady: bool | None = None
        first = len(simulation.rows)
        for count in range(1, (leg.steps or leg.stage.max_steps) + 1):
            self._interval(leg, start, driven, count, observer)
            if leg.steps is None:
                enough = count >= leg.stage.min_steps and count * leg.dt >= leg.stage.ramp
                steady = enough and simulation.is_steady(leg, range(first, len(simulation.rows)))
                if steady:
                    break
        observer.leg(simulation, leg, simulation.rows[-1], steady)

    def _interval(
        self, leg: Leg, start: float, driven: float, count: int, observer: Observer
    ) -> None:
        """The steps up to the ``count``-th row of the leg, and that row."""
        elapsed, end = (count - 1) * leg.dt, count * leg.dt
        done = 0
        self.books.open()
        while True:
            left, dt = self._division(leg, end - elapsed)
            chunk = min(left, CHECK_EVERY)
            last = chunk == left
            for k in range(1, chunk + 1):
                now = end if last and k == chunk else elapsed + k * dt
                self.model.set_loads(start + now, driven + leg.travel(now))
                self._advance(leg, dt, start + now)
            done += chunk
            self.steps += chunk
            if last:
                break
            elapsed += chunk * dt
            self.simulation.time = start + elapsed
            observer.within(self.simulation, leg, self.steps)
        self.simulation.time = start + end
        self.simulation.driven = driven + leg.travel(end)
        self._row(leg, dt, done, observer)

    def _division(self, leg: Leg, left: float) -> tuple[int, float]:
        """Number and length (s) of equal steps in the rest of an interval, none too long."""
        with self.model.problem.timer("stable step"):
            self._stable = self.stepper.stable_step()
        self.shortest = min(self.shortest, self._stable)
        self.longest = max(self.longest, self._stable)
        longest = self.model.case.solver.step_safety * self._stable
        # Steps of a length that is met but for round-off are not cut in two.
        share = left / longest * (1.0 - 1e-9) if longest > 0.0 else math.inf
        if not share < MOST_STEPS:
            raise SolutionError(
                f"stage {leg.label}, time {self.simulation.time:.9g} s: the stable step has shrunk "
                f"to {self._stable:.3g} s; an element is about to fold, or the stage is far too "
                "long for explicit dynamics"
            )
        count = max(1, math.ceil(share))
        return count, left / count

    def _advance(self, leg: Leg, dt: float, time: float) -> None:
        before = self.stepper.steps
        try:
            self.stepper.advance(dt)
        except ExplicitError as error:
            # What is saved is the last state without a folded element.
            self.simulation.time = time if self.stepper.steps > before else time - dt
            raise SolutionError(
                f"stage {leg.label}, time {time:.9g} s: {error}; check the loads and the mesh "
                "there, try a smaller step_safety or a higher penalty"
            ) from None
        with self.model.problem.timer("books"):
            self.books.enter(dt)
        if leg.stage.relax:
            self._calm()

    def _calm(self) -> None:
        """Kinetic damping: stop all motion where the kinetic energy has passed a peak."""
        energy = self.stepper.kinetic_energy()
        if energy < self._peak:
            self.stepper.rest()
            self.books.removed += energy - self.stepper.kinetic_energy()
            energy = 0.0
        self._peak = energy

    def _row(self, leg: Leg, dt: float, steps: int, observer: Observer) -> None:
        """Measure, enter the energies and add a row; collective."""
        simulation, problem = self.simulation, self.model.problem
        problem.spread(self.stepper.x)
        with problem.timer("measures"):
            pairs = zip(problem.contacts, problem.committed, strict=True)
            driven = simulation.driven_direction()
            ends = [measure_contact(term, trial, problem.comm, driven) for term, trial in pairs]
            measures, flow = self.books.close(ends, driven)
            simulation.measures = measures
            simulation.ledger.add_interval(measures, flow)
        inertia = self.inertia[-1]
        inertia.add(flow.kinetic, simulation.ledger.strain)
        self.motion.add(simulation.time)
        interval = Interval(steps, dt, self._stable, self.steps, inertia.last)
        simulation.add_row(leg, dt, interval, steps, observer)

    def summary(self) -> dict[str, Any]:
        """What a results summary says of the explicit part of a run; collective."""
        t, stepper = self.model.thickness, self.stepper
        return {
            "time_steps": self.steps,
            "stable_step": {"shortest": self.shortest, "longest": self.longest},
            "limited_by": stepper.limit,
            "added_mass": stepper.added_mass * t,
            "kinetic_over_strain": {one.label: one.ratio for one in self.inertia},
        }
