"""What is noticed of a run's steps while they are made, to be told to the user at its end.

Steps that ended at round-off, and so did not reach the tolerance that was asked for; bodies that
float, held by weak springs (:mod:`tribox.app.implicit.loose_bodies`); linear solves that take too
long; steps in which tools turned or metal flowed far, or that were long for a branch that relaxes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from tribox.app.build.model import Model
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Kept, KeptAtPoints, Remembers, Snapshot
from tribox.app.implicit.factor import Effort
from tribox.app.implicit.stepper import ROUND, StepResult
from tribox.app.simulation.contact_warnings import ContactWarnings
from tribox.app.simulation.energy_balance import SampledForces
from tribox.app.simulation.failure_diagnosis import most_squeezed
from tribox.app.simulation.film_watch import FilmWatch
from tribox.app.simulation.history import Row
from tribox.app.simulation.run_state import Interval
from tribox.app.simulation.surface_ends import FoldedSides, LeftMaster, OneSidedEnds, PressedEnds
from tribox.forms.bodies.elastoplastic import ElastoPlastic
from tribox.forms.bodies.materials import oedometric_modulus
from tribox.forms.bodies.memory_solid import MemorySolid
from tribox.forms.bodies.viscous_points import Viscoelastic
from tribox.geometry.surfaces.facets import Bools, Floats
from tribox.geometry.surfaces.rigid import RigidSurface

TOUCHING = 1e-9  # penetration over a facet's length up to which bodies only touch
RIGID = 1e4  # stiffness over that of another body beyond which a body need not go to be rigid


@dataclass(frozen=True, slots=True)
class AtRoundOff:
    """A load step whose residual fell no further than round-off."""

    share: float  # largest residual of its steps over its largest contact or reaction force
    stage: str  # its label
    body: str  # whose rounding leaves most, "" of gaps
    carried: bool  # whether because it has moved far


class RoundOffWatch(Remembers):
    """Compares what Newton's method ended with, step by step, with what was asked for.

    Against the largest force of a load step: of bodies that carry nothing rounding is all there is;
    ``worst``: the load step with the largest share; None: within the tolerance.
    """

    worst: Kept[AtRoundOff | None]
    _residual: Kept[float]
    _force: Kept[float]
    _loaded: Kept[bool]

    def __init__(self, problem: Equilibrium, tolerance: float) -> None:
        self.worst = None
        self._problem, self._tolerance = problem, tolerance
        lengths = [term.surface.facet_length for term in problem.contacts]
        self._touching = TOUCHING * min(lengths, default=0.0)
        self._begin()

    def _begin(self) -> None:
        self._residual = self._force = 0.0
        self._loaded = False

    def step(self, row: Row, result: StepResult) -> None:
        """Look at a converged step; collective."""
        force = self._problem.reference_force
        self._force = max(self._force, force)
        pressed = bool(self._problem.contacts) and row.max_penetration > self._touching
        self._loaded |= pressed or force > self._problem.roundoff
        last = result.residuals[-1] if result.residuals else 0.0
        if last > self._tolerance and not result.carried:  # with forces to compare it with
            self._residual = max(self._residual, last * force)

    def end(self, label: str) -> None:
        """A load step has ended, with or without a solution; collective."""
        share = self._residual / self._force if self._force > 0.0 else 0.0
        worse = self.worst is None or share > self.worst.share
        if self._loaded and share > self._tolerance and worse:
            self.worst = AtRoundOff(share, label, *self._noisiest())
        self._begin()

    def _noisiest(self) -> tuple[str, bool]:
        """The body whose rounding leaves most, or "" for gaps; whether by motion; collective."""
        rounding = self._problem.rounding
        at_rest, carried = rounding.squares()
        at = int((at_rest + carried).argmax())
        if self._problem.roundoff_of_contacts() ** 2 > at_rest[at] + carried[at]:
            return "", False
        return rounding.names[at], bool(carried[at] > at_rest[at])

    def warnings(self) -> Iterator[str]:
        """One line if some load step ended at round-off."""
        if self.worst is None:
            return
        where = f"in body {self.worst.body}" if self.worst.body else "of gaps"
        yield (
            f"stage {self.worst.stage}: a residual of {self.worst.share:.1e} of the contact or "
            f"reaction force was accepted, not solver.tolerance = {self._tolerance:.3g}: rounding "
            f"{where} leaves no less; the results are no better than that; try "
            f"{self._cure(self.worst)}"
        )

    def _cure(self, worst: AtRoundOff) -> str:
        if not worst.body:
            return (
                "to place the bodies near the origin (and tools no larger than they need be), or "
                "a larger solver.tolerance if this is enough"
            )
        moduli = {s.name: oedometric_modulus(s.material) for s in self._problem.solids}
        ratio = moduli[worst.body] / min(moduli.values())
        if worst.carried and len(moduli) > 1:
            return f"letting the other body move, as {worst.body} has moved far"
        if ratio > RIGID:
            return (
                f"a lower modulus of {worst.body}, which is {ratio:.1g} times as stiff as the "
                f"softest body (1000 times is as good as rigid)"
            )
        return "a larger load, or a larger solver.tolerance if this is enough"


# -- Bodies that float, held by weak springs -------------------------------------------------------


@dataclass(slots=True)
class Floating:
    """The steps in which a body floated."""

    when: str  # the first of them, in words
    steps: int = 0  # their number
    # largest force of the springs of a step over the largest force of the run till then
    holding: float = 0.0
    carried: float = 0.0  # N (N/m), largest force of the springs before there was any other


class FloatingWatch(Remembers):
    """Keeps which bodies floated, and what held them."""

    found: Kept[dict[str, Floating]]  # by name of the body

    def __init__(self, thickness: float) -> None:
        self.found, self._thickness = {}, thickness

    def step(self, row: Row, result: StepResult) -> None:
        """Look at a converged step."""
        for body in result.floating:
            when = f"first at {row.when}"
            one = self.found.setdefault(body, Floating(when))
            one.steps += 1
            one.holding = max(one.holding, result.holding)
            one.carried = max(one.carried, result.carried)

    def warnings(self) -> Iterator[str]:
        """A line for each body that floated."""
        for name, one in self.found.items():
            held = f"at most {one.holding:.1e} of the largest force"
            if one.carried:
                force = one.carried * self._thickness
                held = (
                    f"up to {force:.2g} N, which are the contact forces where a tool carries it"
                    + (f", and {held}" if one.holding else "")
                )
            yield (
                f"body {name} floats in {one.steps} steps ({one.when}): no support and no contact "
                "force holds it; its place is where it was before, or where a tool moved it, kept "
                f"by weak springs with {held}"
            )


class RelaxationWatch(Remembers):
    """Keeps in which steps bodies were relaxed."""

    _steps: Kept[int]
    _when: Kept[str]

    def __init__(self) -> None:
        self._steps, self._when = 0, ""

    def step(self, row: Row, result: StepResult) -> None:
        """Look at a converged step."""
        if result.relaxed:
            self._steps += 1
            self._when = self._when or row.when

    def warnings(self) -> Iterator[str]:
        """A line if there was such a step."""
        if self._steps:
            yield (
                f"bodies were relaxed by springs in {self._steps} steps (first at {self._when}): "
                "no path of equilibria was found there, as where it snaps; there may be others "
                "than the one that was found: compare with shorter steps, or a stage of dynamics"
            )


# -- Linear solves by iterations that take longer than factorisations would ------------------------

DIRECT = 'solver.linear = "direct"'


class LinearWatch:
    """Notes how many iterations solves took at most, and since when they are too many."""

    def __init__(self) -> None:
        self._effort, self._when = Effort(), {"most": "", "stiff": ""}

    def step(self, row: Row, result: StepResult) -> None:
        """Look at a converged step."""
        self._effort = result.effort
        for name, when in self._when.items():
            if getattr(self._effort, name) and not when:
                self._when[name] = row.when

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        return {"effort": list(self._effort), "when": dict(self._when)}

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        if "effort" in kept:  # not of checkpoints that know less
            self._effort, self._when = Effort(*kept["effort"]), dict(kept["when"])

    def warnings(self) -> Iterator[str]:
        """A line for each kind of solve that took too long."""
        most, turned, stiff = self._effort
        took = f"linear solves took up to {most} iterations ({self._when['most']})"
        if turned:
            yield f"{took}: systems were factorised from there on, as {DIRECT} does from the start"
        elif most:
            yield f"{took}: {DIRECT} is faster, and surer, if memory allows"
        if stiff:
            yield (
                f"the multigrid of the stiff bodies did not converge ({self._when['stiff']}): "
                f"their {stiff} unknowns were factorised from there on, which takes more memory"
            )


# -- Tools that turn far in one step ---------------------------------------------------------------


class TurnWatch(Remembers):
    """Steps in which tools that press turn too far for the slip that is found from two places."""

    _angles: Kept[Floats]  # (tools,), rad, at the last step
    _found: Kept[dict[str, tuple[float, str]]]  # by tool: rad, and when

    def __init__(self, problem: Equilibrium) -> None:
        self._problem, self._found = problem, {}
        self._angles = np.zeros(len(problem.tools))

    def step(self, row: Row, result: StepResult | Interval) -> None:
        """Look at a converged step, or at what explicit ones led to; collective."""
        problem, tools = self._problem, self._problem.tools
        if not tools:
            return
        mine = [sum(problem.u.x.array[t.block.dofs[-1:]]) / t.motion.length for t in tools]
        angles = np.empty(len(tools))
        problem.comm.Allreduce(np.array(mine), angles)
        turned, self._angles = np.abs(angles - self._angles), angles
        for tool, turn in zip(tools, turned, strict=True):
            most, _ = self._found.get(tool.name, (ROUND, ""))
            implicit = isinstance(result, StepResult)
            if implicit and turn > 1.001 * most and self._presses(tool.surface):
                self._found[tool.name] = float(turn), row.when

    def _presses(self, surface: RigidSurface) -> bool:
        """Whether a tool of this shape presses; collective."""
        sliding = self._problem.sliding(self._problem.committed)
        pressed = [one.pressure.any() for _, term, one in sliding if term.surface.target is surface]
        return bool(self._problem.comm.allreduce(any(pressed), op=MPI.LOR))

    def warnings(self) -> Iterator[str]:
        """One line for each tool."""
        for name, (turn, when) in self._found.items():
            yield (
                f"tool {name} turns by {turn:.3g} rad in one step ({when}): the slip of its rim is "
                f"measured for turns of up to {ROUND:g} rad, by 16 % too short at 1 rad, 34 % "
                "at 1.5, and friction is wrong beyond 3 (steps, slip_step)"
            )


# -- How far bodies flow, past the data of their hardening and in one step, and creep -------------

SHORT = 3e-3  # share of the friction that films may lack at points that come under pressure
LONG = 0.1  # equivalent plastic strain of one step from which on it is warned of
SHARE = 0.1  # of a branch's relaxation time from which on a step is long
COUNTS = 0.01  # of what a body stores and loses from which on a branch matters


class FlowWatch(Remembers):
    """Largest equivalent plastic strains of each body that flows."""

    _found: Kept[dict[str, str]]  # warnings, by a word for each and its body
    _creep: Kept[_CreepWatch]

    def __init__(self, problem: Equilibrium) -> None:
        self._comm = problem.comm
        self._bodies = [
            (body, body.material.hardening.largest_strain)
            for body in problem.solids
            if isinstance(body, MemorySolid) and isinstance(body.material, ElastoPlastic)
        ]
        self._creep = _CreepWatch(problem)
        self._found = {}

    def step(self, row: Row) -> None:
        """Look at a converged step; collective."""
        self._creep.step(row)
        if not self._bodies:
            return
        local = np.array([body.largest_flow() for body, _ in self._bodies])
        largest = np.empty_like(local)
        self._comm.Allreduce(local, largest, op=MPI.MAX)
        when = f"first at {row.when}"
        for (body, end), (strain, growth) in zip(self._bodies, largest, strict=True):
            if strain > end:
                self._found.setdefault(
                    f"table {body.name}",
                    f"body {body.name}: equivalent plastic strain beyond {end:.3g}, where its "
                    f"hardening table ends and the yield stress stays level ({when}); add points",
                )
            if growth > LONG:
                self._found.setdefault(
                    f"step {body.name}",
                    f"body {body.name}: equivalent plastic strain grew by {growth:.3g} in one step "
                    f"({when}): where principal axes turn, stresses normal to the shear are of "
                    "first order in the step; take more steps",
                )

    def warnings(self) -> Iterator[str]:
        """One line for each body and reason."""
        yield from self._found.values()
        yield from self._creep.warnings()


class _CreepWatch(Remembers):
    """What branches dissipate in steps that are long for them, over what their body stores."""

    _lost: Kept[Floats]
    _in_long: Kept[Floats]
    _longest: Kept[Floats]
    _stored: Kept[Floats]

    def __init__(self, problem: Equilibrium) -> None:
        self._problem = problem
        self._bodies = [
            (number, body, body.material.branches)
            for number, body in enumerate(problem.solids)
            if isinstance(body, MemorySolid) and isinstance(body.material, Viscoelastic)
        ]
        self._times = np.array([b.time for _, _, branches in self._bodies for b in branches])
        self._lost, self._in_long, self._longest = np.zeros((3, len(self._times)))
        self._stored = np.zeros(len(self._bodies))

    def step(self, row: Row) -> None:
        """Look at a converged step; collective."""
        if not self._bodies:
            return
        felt = [body.felt_step for _, body, branches in self._bodies for _ in branches]
        long = np.isfinite(felt) & (row.dt > SHARE * self._times)
        energies = self._problem.bodies.strain_energies()
        own = [energies[n] for n, _, _ in self._bodies]
        local = np.concatenate([own, *(b.dissipated_by_part for _, b, _ in self._bodies)])
        stored, lost = np.split(self._problem.comm.allreduce(local), [len(self._bodies)])
        # What a branch has lost since the row before counts if this step was long for it.
        self._in_long += np.where(long, lost - self._lost, 0.0)
        self._longest = np.maximum(self._longest, np.where(long, row.dt, 0.0))
        self._lost, self._stored = lost, np.maximum(self._stored, stored)

    def warnings(self) -> Iterator[str]:
        """A line for each branch that matters and had long steps."""
        at = 0
        for (_, body, branches), stored in zip(self._bodies, self._stored, strict=True):
            its = slice(at, at := at + len(branches))
            whole = stored + self._lost[its].sum()
            found = zip(branches, self._in_long[its], self._longest[its], strict=True)
            for number, (branch, lost, step) in enumerate(found, start=1):
                if lost > COUNTS * whole:
                    yield (
                        f"body {body.name}: steps of {step:.3g} s are {step / branch.time:.2g} of "
                        f"the relaxation time of branch {number}, {branch.time:.3g} s, which "
                        f"dissipates {100.0 * lost / whole:.2g} % of what the body stores and "
                        "loses: its stress is of first order in the step; take steps of at most "
                        f"{SHARE * branch.time:.2g} s"
                    )


class CollapseWatch(Remembers):
    """Elements that were squeezed to next to nothing in steps that were solved, stage by stage."""

    _found: Kept[dict[str, tuple[float, str, str]]]  # by stage: J, the element, when

    def __init__(self, problem: Equilibrium) -> None:
        self._problem, self._found = problem, {}

    def step(self, row: Row) -> None:
        """Look at a converged step; collective."""
        worst = most_squeezed(self._problem)
        if worst.collapsed and worst.ratio < self._found.get(row.stage, (np.inf,))[0]:
            self._found[row.stage] = worst.ratio, worst.text, row.when

    def warnings(self) -> Iterator[str]:
        """A line for each stage with such elements."""
        for ratio, text, when in self._found.values():
            yield (
                f"{text} has nearly collapsed (volume ratio {ratio:.2g}, {when}), far more than "
                "those around it: stress and strain there mean nothing, and forces may be off; "
                "less load, a rounder corner or another mesh there"
            )


# -- What watches over a run and has its say at the end of it --------------------------------------


class LateFilm(Remembers):
    """Watches for steps so long that the film of points that come under pressure counts too little.

    The law takes the slip of a step for its speed, and such a point has slipped under pressure, or
    along the surface, for a part of the step. Its neighbours that pressed before lack about as
    much together, by the slip's change along the contact, so what is told is a lower bound.
    """

    _pressed: KeptAtPoints[list[Bools]]
    # By pair: share that lacks, facets of slip in the step, length of a facet (m), when.
    _found: Kept[dict[int, tuple[float, float, float, str]]]

    def __init__(self, model: Model) -> None:
        self._problem = model.problem
        self._pressed = [term.state.friction.closed for term in self._problem.contacts]
        self._found = {}

    def step(self, row: Row, result: StepResult | Interval) -> None:
        """Look at a converged step; collective."""
        trials, before = self._problem.committed, self._pressed
        self._pressed = [trial.pressure > 0.0 for trial in trials]
        if isinstance(result, Interval):  # of explicit steps, which are short
            return
        sums = np.array([self._sums(index, before[index]) for index in range(len(trials))])
        self._problem.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        when = row.when
        for index, (area, slip, length, friction, *deficit) in enumerate(sums):
            if not (area > 0.0 and friction > 0.0 and slip > length):
                continue
            # Of a slip as long as the mean one, less what they have made.
            share = max(deficit[0] * slip / area - deficit[1], 0.0) / friction
            if share > max(SHORT, self._found.get(index, (0.0,))[0]):
                self._found[index] = share, slip / length, length / area, when

    def _sums(self, index: int, before: Bools) -> tuple[float, ...]:
        """This rank's area that pressed before and does, its slip and facets; friction; deficit."""
        term, trial = self._problem.contacts[index], self._problem.committed[index]
        slip = np.linalg.norm(trial.kinematics.slip, axis=1)
        viscous = trial.response.dissipation.viscous
        if term.tied or not viscous.any():
            return (0.0,) * 6
        surface, weight = term.surface.slave, term.surface.slave.weight
        stays, comes = weight * (before & self._pressed[index]), ~before & self._pressed[index]
        traction = np.linalg.norm(trial.response.traction, axis=1)
        # A film's traction goes with the slip of the step: work over slip² is traction per slip.
        per_slip = np.divide(viscous, slip**2, out=np.zeros_like(slip), where=comes & (slip > 0.0))
        return (
            float(stays.sum()),
            float(stays @ slip),
            float(stays @ surface.facet_length),
            float(weight @ traction),
            float(weight @ per_slip),
            float(weight @ (per_slip * slip)),
        )

    def warnings(self) -> Iterator[str]:
        """One line for each pair whose film was late."""
        for index, (share, facets, length, when) in self._found.items():
            yield (
                f"contact.{index}: a step slides {facets:.2g} facets of the slave, and the film of "
                f"points that come under pressure in it counts for a part of it only: friction is "
                f"at least {share:.1%} too low ({when}); slide at most a facet, {length:.3g} m, in "
                "a step (slip_step, steps)"
            )


class Watches:
    """The watches of a run, told of every step; ``told``: warnings given once that have been.

    ``roundoff``: of Newton's method; ``contacts``: depth, evenness; ``sampled``: forces at ends.
    """

    def __init__(self, model: Model, kept: Snapshot | None = None) -> None:
        """Begin before the first step, or go on with what :meth:`snapshot` has seen; collective."""
        problem = model.problem
        self._thickness = model.thickness
        self.roundoff = RoundOffWatch(problem, model.case.solver.tolerance)
        self.contacts = ContactWarnings(problem, None if kept is None else kept["contacts"])
        # Points that run past the end of their master, contact at ends, sides that fold, films of
        # points that come under pressure in too long a step, bodies that nothing holds, how far
        # bodies flow, films that are found.
        self._of_rows: dict[str, Any] = {
            "left": LeftMaster(model),
            "ends": PressedEnds(model),
            "one_sided": OneSidedEnds(model),
            "folds": FoldedSides(model),
            "flow": FlowWatch(problem),
            "collapse": CollapseWatch(problem),
            "films": FilmWatch(problem),
        }
        self._of_both: dict[str, Any] = {"late": LateFilm(model), "turn": TurnWatch(problem)}
        self._of_steps: dict[str, Any] = {  # implicit ones
            "roundoff": self.roundoff,
            "floating": FloatingWatch(model.thickness),
            "relaxation": RelaxationWatch(),
            "linear": LinearWatch(),
        }
        self.sampled = SampledForces()
        self._named = {**self._of_rows, **self._of_both, **self._of_steps, "sampled": self.sampled}
        self.told: set[str] = set() if kept is None else set(kept["told"])
        if kept is not None:
            for name, watch in self._named.items():
                if name in kept:  # not of checkpoints that know less
                    watch.restore(kept[name])

    def step(self, row: Row, result: StepResult | Interval, sampled: float) -> None:
        """Look at a converged step, ``sampled`` as :class:`SampledForces` has it; collective."""
        self.sampled.step(row, sampled)
        self.contacts.step(row, self._thickness, balanced=isinstance(result, StepResult))
        for watch in self._of_rows.values():
            watch.step(row)
        for both in self._of_both.values():
            both.step(row, result)
        if isinstance(result, StepResult):
            for other in self._of_steps.values():
                other.step(row, result)

    def first_time(self, what: str) -> bool:
        """Whether this has not been told yet; it counts as told from now on."""
        new = what not in self.told
        self.told.add(what)
        return new

    def end(self, label: str) -> None:
        """A load step has ended, with or without a solution; collective."""
        self.roundoff.end(label)
        self.sampled.end(label)

    def warnings(self, stage: str) -> Iterator[str]:
        """What there is to say at the end, in stage ``stage``; collective."""
        for name in ("left", "ends", "one_sided", "late"):
            yield from self._named[name].warnings()
        yield from self._named["folds"].warnings(self._named["ends"].short_slaves)
        yield from self.contacts.warnings()
        self.end(stage)
        for name in ("floating", "relaxation", "linear", "turn", "flow", "collapse", "films"):
            yield from self._named[name].warnings()
        yield from self.sampled.warnings()

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        seen = {name: watch.snapshot() for name, watch in self._named.items()}
        return {"told": sorted(self.told), **seen, "contacts": self.contacts.snapshot()}
