"""How far a run has come: what one stage leaves to the next, whatever solves it."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tribox.app.build.model import Model
from tribox.app.case.boundary import COMPONENTS, DRIVEN
from tribox.app.case.stage import LoadStep
from tribox.app.equilibrium.snapshot import Kept, Remembers
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.implicit.stepper import ImplicitStepper, StepResult
from tribox.app.simulation import contact_resultants
from tribox.app.simulation.energy_balance import EnergyBalance, Inertia
from tribox.app.simulation.history import PAIR_COLUMNS, Row
from tribox.app.simulation.motion_history import KEYS, MotionHistory, OutsideForces
from tribox.app.simulation.steady import NOT_SLID, SlidWay, Steadiness, measure_settling
from tribox.forms.contact.shared_slave import keep_what_went_over
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.facets import Floats, Ints

STILL = 1e-9  # of the bodies' extent: what moves less in a step rests


class RunState(Remembers):
    """History, energies and loads of a run so far.

    Attributes:
        model: what is solved; energy_balance: its energies.
        stepper: what makes the steps at present; its ``x`` are the unknowns, m.
        time: s; driven: m, displacement of driven boundaries; step: converged steps so far.
        rows: the history; pair_rows: of each pair in turn, for each row of it, by pair_columns;
            motion: surfaces and bodies, tools: rigid tools, likewise.
        resultants: the contacts after the last step.
        inertia: kinetic against strain energy, of each explicit load step.
        springs: N, largest force of weak springs on bodies that float, which no table has.
        speed: m/s, of driven boundaries; where the stage drives none, of the fastest support,
            platen or tool, and 0 where these do not move.
        way: tangential force over the way of driven boundaries; steadiness: as last judged.
        position: where the loops over load steps and steps stand.
    """

    # How far the run has come, without the rows, which are in its tables.
    time: Kept[float]
    driven: Kept[float]
    step: Kept[int]
    resultants: Kept[list[contact_resultants.ContactResultants]]
    inertia: Kept[list[Inertia]]
    way: Kept[SlidWay]
    steadiness: Kept[Steadiness]
    position: Kept[Position]
    energy_balance: Kept[EnergyBalance]
    springs: Kept[float]
    _last: Kept[tuple[float, float]]

    stepper: ImplicitStepper | ExplicitStepper

    def __init__(self, model: Model) -> None:
        """Begin at rest, under the loads of the start; collective."""
        self.model = model
        self.time = self.driven = self.speed = self.springs = 0.0
        self.step = 0
        self.rows: list[Row] = []
        dim = model.problem.dim
        vectors = [f"{kind}_{axis}" for kind in ("force", "friction") for axis in COMPONENTS[:dim]]
        self._columns = (*PAIR_COLUMNS, *vectors, *["twist_moment"] * (dim == 3))
        self.pair_columns = (*KEYS, "pair", *self._columns, *contact_resultants.FILM_COLUMNS)
        self.pair_rows: list[tuple[int | float | str, ...]] = []
        self.resultants = []
        self.inertia = []
        self._last = (0.0, 0.0)
        self.way = SlidWay(term.law for term in model.problem.contacts)
        self.steadiness = NOT_SLID
        self.position = Position()
        model.set_loads(0.0, 0.0)
        self.energy_balance = EnergyBalance(model.problem, model.problem.new_vector())
        self.motion = MotionHistory(model)
        self.tools = ToolHistory(model, self.motion.held)

    def resultants_of(
        self, trials: Iterable[ContactTrial]
    ) -> list[contact_resultants.ContactResultants]:
        """The resultants of all contacts at converged trials; collective."""
        problem, driven = self.model.problem, self.driven_direction()
        trials = list(trials)
        keep_what_went_over(problem.contacts, trials)
        pairs = zip(problem.contacts, trials, strict=True)
        found = [
            contact_resultants.measure_contact(term, trial, problem.comm, driven)
            for term, trial in pairs
        ]
        return contact_resultants.with_released_energy(found, self.resultants, self.model)

    def driven_direction(self) -> list[float] | None:
        """Direction of the first driven boundary, spring or tool, None without."""
        axes = COMPONENTS[: self.model.problem.dim]
        case = self.model.case
        for table in (*case.boundary, *case.tools.values()):
            components = table.driven_components()
            if components and table.displacement is not None:
                share = table.displacement.driven_share
                return [share(axis) if axis in components else 0.0 for axis in axes]
            if table.spring is not None and table.spring.end == DRIVEN:
                return [float(axis == table.spring.direction) for axis in axes]
        return None

    def add_row(
        self,
        load_step: LoadStep,
        dt: float,
        iterations: int,
        attempts: int,
        linear: int,
        velocity: Floats,
        outside: OutsideForces,
    ) -> Row:
        """Add a row of the present resultants and energies to the history; collective.

        Args:
            dt: s, length of the step; iterations: of Newton's method.
            attempts: at the step; in an explicit run the time steps of the row.
            linear: iterations of linear solves that are iterative.
            velocity: (n,), m/s, of the owned unknowns; outside: forces on the bodies.
        """
        self.step += 1
        t, stage = self.model.thickness, load_step.stage
        rates, speed = stage.rate_dependent, self._mean_speed(load_step)
        noise = self.model.problem.roundoff
        row = Row(
            step=self.step,
            time=self.time,
            stage=stage.name,
            dt=dt,
            velocity=load_step.velocity,
            driven_displacement=self.driven,
            newton_iterations=iterations,
            linear_iterations=linear,
            attempts=attempts,
            **contact_resultants.contact_columns(self._loose_resultants(), speed, rates, t, noise),
            **self.energy_balance.columns(t),
        )
        self.rows.append(row)
        if isinstance(self.stepper, ImplicitStepper):
            self.springs = max(self.springs, self.model.problem.held_weakly() * t)
        at = (row.step, row.time, row.stage)
        for contact, pair in zip(self.model.case.contact, self.resultants, strict=True):
            columns = contact_resultants.contact_columns([pair], speed, rates, t, noise)
            values = (columns[name] for name in self._columns)
            film = contact_resultants.film_columns(pair, t)
            self.pair_rows.append((*at, contact.label, *values, *film))
        motion = (self.stepper.x.array_r, velocity)
        self.motion.add(at, motion, outside, self.resultants)
        self.tools.add(at, motion, outside, self.resultants)
        self._add_to_way(row)
        self.speed = row.velocity if stage.is_driven else self._fastest(velocity, dt)
        return row

    def _loose_resultants(self) -> list[contact_resultants.ContactResultants]:
        """The resultants of the contacts that are not tied, whose sums are those of friction."""
        terms = self.model.problem.contacts
        return [m for m, term in zip(self.resultants, terms, strict=True) if not term.tied]

    def last_of_pairs(self) -> list[dict[str, Any]]:
        """The last row of each pair, by column."""
        rows = self.pair_rows[-len(self.resultants) :] if self.resultants else []
        return [dict(zip(self.pair_columns, row, strict=True)) for row in rows]

    def _mean_speed(self, load_step: LoadStep) -> float:
        """Speed of the driven boundaries in the mean since the last row, m/s.

        Of components that are each driven, without a common direction, the vector counts.
        """
        (time, driven), self._last = self._last, (self.time, self.driven)
        direction = self.driven_direction()
        length = 1.0 if direction is None else float(np.linalg.norm(direction))
        if load_step.stage.ramp <= 0.0:
            return length * load_step.velocity
        return length * (self.driven - driven) / (self.time - time)

    def _fastest(self, velocity: Floats, dt: float) -> float:
        """Speed, m/s, of the fastest support, platen or tool; 0 of those that do not move."""
        fastest = max(self.motion.fastest(velocity), self.tools.fastest())
        return fastest if fastest * dt > STILL * self.motion.extent else 0.0

    def _add_to_way(self, row: Row) -> None:
        problem = self.model.problem
        unsettled, presliding = measure_settling(problem.contacts, problem.committed, problem.comm)
        unsettled *= self.model.thickness
        along = contact_resultants.along_force(self._loose_resultants()) * self.model.thickness
        self.way.add(row.driven_displacement, along, unsettled, presliding)

    def run(
        self, load_step: LoadStep, observer: Observer, advance: Callable[[LoadStep, Observer], None]
    ) -> None:
        """Make rows by ``advance`` to the end of a load step, or until it is steady; collective.

        It is where the tangential force has come to where it tends at the present velocity.
        """
        stage, at = load_step.stage, self.position
        steady: bool | None = None
        while not steady and at.count < (load_step.steps or stage.max_steps):
            advance(load_step, observer)
            if load_step.steps is None:
                enough = at.count >= stage.min_steps and at.count * load_step.dt >= stage.ramp
                if enough:
                    self.steadiness = self.way.judge(at.row, stage.steady_tolerance)
                steady = enough and self.steadiness.steady
        observer.load_step(self, load_step, self.rows[-1], steady)


# -- Where a run stands between two steps: what its loops need to go on from there -----------------


CALM = 3  # steps in shorter pieces after which longer ones are tried, easy or not
ROOM = 3  # times at least that the first piece of a step may be cut


@dataclass(slots=True)
class Position:
    """Which load step a run is in, and how far."""

    load_step: int = 0  # number of it among all of the case, from 0; after the last one their count
    begun: bool = False  # whether it has begun; else the next four belong to the one before
    count: int = 0  # steps, or rows of an explicit stage, that are made
    time: float = 0.0  # s, at its start
    driven: float = 0.0  # m, likewise
    row: int = 0  # number of its first row, from 0
    done: float = 0.0  # share of the present implicit step that is made, above 0 if it has been cut
    piece: float = 1.0  # share that is tried next
    calm: int = 0  # steps since an attempt failed, or since pieces last became longer
    failures: int = 0  # attempts at it that did not converge
    wasted: int = 0  # their iterations
    step_time: float = 0.0  # s, at the step's start
    step_driven: float = 0.0  # m, likewise
    elapsed: float = 0.0  # s, of the load step, at which the next explicit time steps begin
    within: int = 0  # how many the present interval has had

    def begin(self, time: float, driven: float, row: int) -> bool:
        """Begin the load step here, unless it has begun; returns whether it has not."""
        if self.begun:
            return False
        self.begun, self.count, self.elapsed, self.within = True, 0, 0.0, 0
        self.time, self.driven, self.row, self.done = time, driven, row, 0.0
        self.piece = 1.0
        return True

    def begin_step(self, time: float, driven: float) -> None:
        """Begin an implicit step here, unless a part of it is made or has been tried."""
        if self.done == 0.0 and not self.failures:
            self.step_time, self.step_driven = time, driven

    def end_step(self, least: float) -> None:
        """Count an implicit step; after a cut one the next begins as short, unless below ``least``.

        What failed mostly fails again.
        """
        self.count, self.done, self.calm = self.count + 1, 0.0, self.calm + 1
        if self.calm >= CALM:
            self.piece, self.calm = 2.0 * self.piece, 0
        while self.piece < min(2.0**ROOM * least, 1.0):
            self.piece *= 2.0
        self.piece = min(self.piece, 1.0)

    def try_again(self) -> None:
        """Forget the attempts at the rest of the present implicit step, which was given up."""
        self.piece, self.failures, self.wasted = 1.0, 0, 0

    def end(self) -> None:
        """Go on to the next load step."""
        self.load_step += 1
        self.begun = False


# -- Motion of rigid tools, and the forces on them: ``tools.csv`` ----------------------------------
#
# Forces and moments "on the tool" are those of the bodies that it presses; what drives it is what
# its surroundings do to it, so that both add up to zero where no mass is accelerated. Moments are
# about the centre of its rotation, where that is now.


class ToolHistory:
    """Rows of the table.

    Attributes:
        columns: their names; rows: a row for each tool and step.
    """

    def __init__(self, model: Model, held: Ints) -> None:
        self._model, self._held = model, held
        self._tools, dim = model.problem.tools, model.problem.dim
        axes = COMPONENTS[:dim]
        moments = [f"moment_{axis}" for axis in ("xyz" if dim == 3 else "z")]
        self.columns = (
            *(*KEYS, "tool"),
            *(f"displacement_{axis}" for axis in axes),
            "rotation",
            *(f"velocity_{axis}" for axis in axes),
            "angular_velocity",
            *(f"force_{axis}" for axis in axes),
            *moments,
            *(f"driving_force_{axis}" for axis in axes),
            "driving_moment",
            "power",
            *(f"centre_{axis}" for axis in axes),
        )
        self.rows: list[tuple[int | float | str, ...]] = []

    def add(
        self,
        key: tuple[int, float, str],
        motion: tuple[Floats, Floats],
        outside: OutsideForces,
        pairs: Sequence[contact_resultants.ContactResultants],
    ) -> None:
        """Add a step's rows: ``key`` of number, time, stage; u, m, and velocities, m/s, (n,)."""
        if not self._tools:
            return
        contacts, t = self._model.case.contact, self._model.thickness
        slots, dim = self._slots(motion, outside), self._model.problem.dim
        for number, tool in enumerate(self._tools):
            moved, speed, drive = slots[number]
            length = tool.motion.length
            mine = [m for m, c in zip(pairs, contacts, strict=True) if c.master == tool.name]
            force = sum((-t * np.array(pair.force) for pair in mine), np.zeros(dim))
            moments = (t * np.array(pair.tool_moment) for pair in mine)
            moment = sum(moments, np.zeros(3 if dim == 3 else 1))
            drive = drive * t
            if self._model.section == "axisymmetric":
                drive[0] = drive[-1] = 0.0  # what points outwards cancels round the ring
            power = float(drive @ speed)
            drive[-1] *= length
            values = (
                *(*moved[:-1], moved[-1] / length),
                *(*speed[:-1], speed[-1] / length),
                *force,
                *moment,
                *drive,
                power,
                *(tool.motion.centre + moved[:-1]),
            )
            self.rows.append((*key, tool.name, *map(float, values)))

    def fastest(self) -> float:
        """Speed of the fastest tool at the last rows, m/s; of one that turns, at its surface."""
        names = [self.columns.index(n) for n in self.columns if n.startswith("velocity_")]
        turning = self.columns.index("angular_velocity")
        speeds = [
            math.hypot(*(float(row[at]) for at in names), float(row[turning]) * tool.reach)
            for row, tool in zip(self.rows[-len(self._tools) :], self._tools, strict=True)
        ]
        return max(speeds, default=0.0)

    def last(self) -> dict[str, dict[str, int | float | str]]:
        """The last row of each tool by its name: numbers by column."""
        found = {}
        for row in self.rows[-len(self._tools) :]:
            named = dict(zip(self.columns, row, strict=True))
            found[str(named.pop("tool"))] = named
        return found

    def largest_force(self, stages: Collection[str]) -> float:
        """Largest component of a force on a tool at the rows of some stages, N; 0 without any."""
        columns = [number for number, name in enumerate(self.columns) if name.startswith("force_")]
        rows = [row for row in self.rows if row[KEYS.index("stage")] in stages]
        return max((abs(float(row[at])) for row in rows for at in columns), default=0.0)

    def _slots(self, motion: tuple[Floats, Floats], outside: OutsideForces) -> Floats:
        """Displacement, velocity and drive (t, 3, k) of each tool's slots, m, m/s, N; collective.

        What is prescribed is driven by what holds it, the rest by the loads on it and its stops.
        """
        loads = np.sum(outside.loads, axis=0) if outside.loads else np.zeros_like(motion[0])
        problem = self._model.problem
        for rest in problem.rests():
            loads[: problem.owned] -= rest.force(motion[0])
        out = np.zeros((len(self._tools), 3, problem.dim + 1))
        springs = [platen.dofs for platen in problem.platens]
        given = np.concatenate([problem.constrained_dofs(), *springs])
        for number, tool in enumerate(self._tools):
            for slot in np.nonzero(tool.here)[0]:
                dof = tool.dofs[slot]
                drive = loads[dof]
                if dof in given:
                    drive = outside.held[np.searchsorted(self._held, dof)]
                out[number, :, slot] = motion[0][dof], motion[1][dof], drive
        return problem.comm.allreduce(out)


# -- What wants to know of a run while it goes on --------------------------------------------------


@dataclass(frozen=True, slots=True)
class Interval:
    """How an explicit run got from one row to the next."""

    steps: int  # time steps
    dt: float  # s, of the last of them
    stable: float  # s, stable step at the end
    total: int  # time steps of the run so far
    kinetic_ratio: float  # kinetic over strain energy at the end; 0 without strain energy
    failed: bool = False  # whether the run ends within it, without the row


class Observer:
    """What wants to know of a run; the default does nothing."""

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """A step has converged and is committed, or an explicit interval is over; collective."""

    def ready(self, state: RunState) -> None:
        """All of the last step has been told, and another is about to begin; collective.

        A run can be stopped here, and gone on with later. Explicit runs come by between two rows
        too.
        """

    def within(self, state: RunState, load_step: LoadStep, steps: int) -> None:
        """Called now and then between two rows of an explicit run, after ``steps``; collective."""

    def load_step(
        self, state: RunState, load_step: LoadStep, row: Row, steady: bool | None
    ) -> None:
        """A load step has ended; ``steady`` is None where nobody asked for it; collective."""

    def attempt(
        self, state: RunState, load_step: LoadStep, dt: float, result: StepResult | Interval
    ) -> None:
        """A step or interval of ``dt`` (s) has been tried; what comes of it follows; collective.

        The time of the state is that before a step, and that at the end of an interval.
        """

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """A step of ``dt`` (s) has failed and is tried again shorter; collective."""
