"""Quasi-static implicit steps: each from the last converged state.

If a step fails, nothing has been committed: it is cut and tried again from the same state. How a
step is solved is in :mod:`tribox.app.implicit.globalisation`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import (
    Nodal,
    Snapshot,
    of_bodies,
    of_contacts,
    of_step,
    to_bodies,
    to_contacts,
    to_step,
)
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.equilibrium.supports import supports_at_hand
from tribox.app.implicit.factor import NO_EFFORT, Effort
from tribox.app.implicit.globalisation import solve, solve_otherwise
from tribox.app.implicit.linear_solver import LinearSolver
from tribox.app.implicit.loose_bodies import SHARE, LooseBodies, WeakHold
from tribox.app.implicit.newton import ImplicitOptions, Newton
from tribox.app.implicit.predictor import Attempt, Predictor
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.facets import Floats

UNAIDED = 4.0  # contact force over that of weak springs, from which on others press
CARRIED = 0.01  # penalty scale of contacts that carry a body by next to no force
# rad, turn of a tool in a step up to which slip is known from its ends: just below that from which
# on two places show a corner (pair_tangent.h)
ROUND = 0.9
HELD_BACK = 0.05  # share of a contact's friction that a law may leave out in a driven step

__all__ = ["ImplicitOptions", "ImplicitStepper", "NotConvergedError", "StepResult"]


class NotConvergedError(Exception):
    """A step has no solution that Newton's method finds; a shorter one may."""


@dataclass(slots=True)
class StepResult:
    """Outcome of one attempted step.

    Attributes:
        converged: whether the step may be committed.
        iterations: Newton iterations, the predictor's linear solve included.
        factorisations: tangents assembled and factorised for them.
        reason: PETSc's converged reason.
        residuals: residual norm after each iteration, relative to the reference force.
        floating: bodies that nothing presses on or supports; holding: force of the weak springs
            that hold them, over the largest force of the run
            (:mod:`tribox.app.implicit.loose_bodies`); carried: that force, N (N/m), before there
            is any other.
        strayed: whether an iteration led too far away to be evaluated.
        too_long: whether a friction law has left out traction
            (:class:`tribox.forms.friction.law.FrictionResponse`) while the bodies are driven.
        unbalanced: contacts whose film had no solution at the state evaluated last.
        effort: of linear solves by iterations so far.
        relaxed: whether bodies were relaxed (:mod:`tribox.app.implicit.relaxation`).
        spun: freely turning tools that turned by more than slip is known up to.
        adrift: whether a load moves the floating bodies away, as it would in a shorter step.
    """

    converged: bool
    iterations: int
    factorisations: int
    reason: int
    residuals: list[float]
    floating: tuple[str, ...] = ()
    holding: float = 0.0
    carried: float = 0.0
    strayed: bool = False
    too_long: bool = False
    unbalanced: tuple[int, ...] = ()
    effort: Effort = NO_EFFORT
    relaxed: bool = False
    spun: tuple[str, ...] = ()
    adrift: bool = False


class ImplicitStepper:
    """Solves one step at a time and remembers the path that the predictor continues.

    Attributes:
        problem: what is solved; options: how.
        x: the last converged unknowns; trial: those of the last attempt.
        rate_dependent: whether the contacts' friction feels time; set once for each stage.
        failures: attempts that have failed from the last converged state; set before each.
        solver: linear solver; newton: SNES and its phases; predictor: finds starts.
    """

    def __init__(self, problem: Equilibrium, options: ImplicitOptions | None = None) -> None:
        """Make matrix and solvers; collective; ValueError if PETSc refuses one of the options."""
        self.problem, self.options = problem, options or ImplicitOptions()
        self.x, self.trial = problem.new_vector(), problem.new_vector()
        self.rate_dependent, self.failures = True, 0
        self.solver = LinearSolver(problem, self.x)
        self.newton = Newton(problem, self.solver, self.trial, self.options)
        self.predictor = Predictor(problem, self.solver)
        self.newton.turns.spun = self._spun
        self._find_loose_bodies()
        self._carried = 0.0  # N (N/m), of weak springs that alone pressed in the last solution
        self._relaxed = False  # whether springs that give way found the last solution
        self._adrift: tuple[str, ...] = ()  # bodies that the load of the last attempt moves away
        self._pressed = False  # whether anything pressed at the last converged state
        self._floating: tuple[str, ...] = ()  # bodies that nothing held there
        self._trial_floating: tuple[str, ...] = ()
        # How the last converged state was evaluated, and from which contacts.
        self._mode, self._from = StepMode(), [term.state for term in problem.contacts]

    @property
    def snes(self) -> PETSc.SNES:
        """PETSc's nonlinear solver."""
        return self.newton.snes

    @property
    def has_carried_only(self) -> bool:
        """Whether tools have carried free bodies, and nothing else has pressed in the whole run."""
        if not self._carried or self.newton.largest_force > self.problem.roundoff:
            return False
        return self.problem.reference_force <= max(UNAIDED * self._carried, self.problem.roundoff)

    def _find_loose_bodies(self) -> None:
        problem = self.problem
        self._bodies, self._weak = LooseBodies(problem), WeakHold(problem)
        self._held, self.newton.turns.turn = supports_at_hand(problem), self._weak.turn
        problem.rounding.let_go = {n for body in self._weak.bodies for n in body.joined.names}

    def attempt(self, dt: float) -> StepResult:
        """Try a step of ``dt`` (s) under the loads that are set; commits nothing; collective."""
        problem, newton = self.problem, self.newton
        if supports_at_hand(problem) != self._held:
            self._find_loose_bodies()
        step = StepMode.of_stage(dt, problem.contacts, self.rate_dependent)
        assembled, newton.strayed = self.solver.assembled, False
        iterations, reason, holding = self._solve(step)
        spun = self._spun(self.trial)
        if reason > 0 and (spun or not problem.is_held_slightly()):
            reason = PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH
        films = [trial.normal_contact.lubrication for trial in self.problem.trials]
        return StepResult(
            # An element may be turned inside out and its residual finite all the same; the strain
            # energy, with its logarithm of J, is not.
            converged=reason > 0
            and holding <= SHARE
            and bool(np.isfinite(problem.strain_energy())),
            iterations=iterations,
            factorisations=self.solver.assembled - assembled,
            reason=reason,
            residuals=newton.residuals,
            floating=self._adrift or self._trial_floating,
            holding=0.0 if self._carried else holding,
            carried=self._carried,
            strayed=newton.strayed,
            too_long=self._is_too_long(),
            unbalanced=tuple(
                i for i, film in enumerate(films) if film is not None and film.is_unsolved
            ),
            effort=self.solver.effort,
            relaxed=self._relaxed,
            spun=spun,
            adrift=bool(self._adrift),
        )

    def _spun(self, at: PETSc.Vec) -> tuple[str, ...]:
        """Tools that turn freely, and farther in the step to ``at`` than slip is known; collective.

        The rim comes back to a place with each whole turn, and the step is solved by all of them.
        """
        free = [tool for tool in self.problem.tools if tool.free[-1]]
        moved = at.array_r - self.x.array_r if free else np.empty(0)
        comm = self.problem.comm
        turns = [abs(tool.at(moved, comm)[-1]) / tool.motion.length for tool in free]
        return tuple(tool.name for tool, turn in zip(free, turns, strict=True) if turn > ROUND)

    def _is_too_long(self) -> bool:
        """Whether a law leaves out traction that the drive of the bodies brings back; collective.

        A body that nothing drives stays where it came to rest.
        """
        problem = self.problem
        sums = np.zeros((len(problem.contacts), 2))
        for term, trial, into in zip(problem.contacts, problem.trials, sums, strict=True):
            held_back = getattr(trial.response, "held_back", None)
            if held_back is not None:
                traction = np.linalg.norm(trial.response.traction, axis=1)
                into[:] = term.surface.slave.weight @ np.stack([held_back, traction], axis=1)
        problem.comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        left_out, carried = sums.T
        much = (left_out > HELD_BACK * carried) & (left_out > problem.roundoff)
        return bool(much.any()) and self.predictor.is_driven(self.x)

    def _solve(self, step: StepMode) -> tuple[int, int, float]:
        """Solve a step, and what it does not find with loaded bodies kept aside; collective.

        Returns iterations, PETSc's converged reason, force of the springs over the largest.
        """
        weak, newton = self._weak, self.newton
        iterations, reason, share = self._held_where_it_floats(step)
        if reason > 0 or not (weak.slick.any() and weak.is_loaded(newton.largest_force)):
            return iterations, reason, share
        trial = newton.trial.array_r.copy()
        said = newton.residuals, newton.strayed, self._relaxed, self._adrift
        more, found, sideways = self._kept_aside(step)
        if found > 0 and sideways <= SHARE:
            return iterations + more, found, sideways
        newton.trial.array[:] = trial  # why that failed is told
        newton.residuals, newton.strayed, self._relaxed, self._adrift = said
        return iterations + more, reason, share

    def _held_where_it_floats(self, step: StepMode) -> tuple[int, int, float]:
        """Solve a step, with weak springs if a body floats; collective.

        An attempt that fails while contacts press on all bodies fails for another reason, which no
        springs as weak as these would change. Returns iterations, PETSc's converged reason, force
        of the springs over the largest of the run.
        """
        problem, newton, iterations, reason = self.problem, self.newton, 0, 0
        largest, self._trial_floating = newton.largest_force, ()
        weak, trials = self._weak, problem.committed
        self._carried = 0.0
        if weak.firm.any() and largest <= problem.roundoff:  # of what is at rest, that is none
            return self._unpressed(step)
        may_float = self._may_float(largest)
        if may_float and weak.is_let_go(largest):
            iterations, reason, share = self._sprung(step, largest, trials)
            if reason > 0 and self._trial_floating:
                return iterations, reason, share
        # Where nothing presses and a load acts, contact is sought as at first touch.
        anew = bool(self._floating) and weak.is_loaded(largest)
        anew &= len(weak.idle_pairs(largest, trials)) == len(problem.contacts)
        if anew or not (self._floating or (may_float and weak.adrift(largest))):
            more, reason = self._tried(step, self._pressed and not anew, anew=anew)
            iterations += more
            if reason > 0:
                newton.evaluate(step)
                largest = max(largest, problem.reference_force)
            trials = problem.trials
            sure = reason > 0 or not newton.strayed
            held = sure and not weak.floating(largest)
            if not self._may_float(largest) or held or weak.is_loaded(largest):
                return iterations, reason, 0.0
        more, reason, share = self._sprung(step, largest, trials, found=reason > 0)
        return iterations + more, reason, share

    def _kept_aside(self, step: StepMode) -> tuple[int, int, float]:
        """Solve a step with weak springs on loaded bodies that nothing rubs on; collective.

        What lies flush on a flat has no stiffness along it, and goes where rounding sends it.
        """
        problem, weak, newton = self.problem, self._weak, self.newton
        largest = max(newton.largest_force, float(np.linalg.norm(weak.loads(), axis=1).max()))
        firm: Floats = np.where(weak.slick, largest, 0.0)
        held = step.held(weak.springs(self.x.array_r, firm))
        attempt = self._attempt(held, self._pressed)
        attempt.shortly = True
        iterations, reason = self._run(attempt)
        newton.evaluate(held)
        return iterations, reason, problem.held_weakly() / largest

    def _unpressed(self, step: StepMode) -> tuple[int, int, float]:
        """Solve a step of a run in which nothing has pressed yet, see :meth:`_solve`; collective.

        A tool that moves a body through a clearance carries it along by no force, to a place that
        is as good as any other beyond the tool. Weak springs keep it there, of a millionth of the
        stiffness of its contacts. These are softer meanwhile, or rounding would open and close what
        so little presses. Where contacts press by more than these springs do, as between two tools,
        the step is solved as it is, unless these only turn the body.
        """
        problem, weak, iterations = self.problem, self._weak, 0
        trials, short = problem.trials, None
        loaded, carried = weak.is_loaded(0.0), bool(self._floating)
        if loaded or not carried:
            short = self._attempt(step, self._pressed and not carried, anew=carried)
            short.shortly = not loaded
            iterations, reason = self._run(short)
            if loaded or (reason > 0 and not self._leaves_loose(step)):
                return iterations, reason, 0.0
            if reason <= 0:  # where an iteration that leads nowhere ends says nothing
                trials = problem.committed
        most, softly = float(weak.firm.max()), step.with_penalty_scale(problem.contacts, CARRIED)
        more, reason, share = self._sprung(softly, most, trials, weak.firm)
        iterations += more
        if reason <= 0 and short is not None and not carried:
            more, reason = self._run(short, solve_otherwise)
            return iterations + more, reason, 0.0
        others_press = weak.contact_force() > UNAIDED * share * most
        self._carried = 0.0 if others_press else share * most
        if reason <= 0 or not others_press:
            return iterations, reason, share
        if weak.floating(problem.reference_force):  # others press, and have a force to compare with
            more, reason, share = self._sprung(step, problem.reference_force, problem.trials)
            return iterations + more, reason, share
        more, reason, presses = self._unaided(step, short)
        if presses:
            self._trial_floating, share = (), 0.0
        else:
            self._carried = share * most
        return iterations + more, reason, share

    def _unaided(self, step: StepMode, short: Attempt | None) -> tuple[int, int, bool]:
        """Solve a step as it is from what springs found, and whether contacts press; collective.

        What springs found is put back if they do not. ``short``: what was tried of it before.
        """
        problem, newton = self.problem, self.newton
        found, held = self.trial.array_r.copy(), problem.evaluated
        iterations, reason = newton.solve(step)
        if reason <= 0 and short is not None:
            more, reason = self._run(short, solve_otherwise)
            iterations += more
        elif reason <= 0:
            more, reason = self._tried(step, self._pressed)
            iterations += more
        if reason > 0 and self._leaves_loose(step):
            self.trial.array[:] = found
            newton.evaluate(held)
            return iterations, reason, False
        return iterations, reason, True

    def _leaves_loose(self, step: StepMode) -> bool:
        """Whether nothing but rounding presses on a free body at the trial; collective."""
        self.newton.evaluate(step)
        return bool(self._weak.floating(self.problem.roundoff / SHARE))

    def _sprung(
        self,
        step: StepMode,
        largest: float,
        trials: Sequence[ContactTrial],
        forces: Floats | None = None,
        found: bool = False,
    ) -> tuple[int, int, float]:
        """Solve a step with weak springs, see :meth:`_solve`; ``trials`` show what floats.

        Args:
            step, largest, trials: see there.
            forces: (b,), N, that the springs of each body are a share of; None: of ``largest``.
            found: whether the trial is the solution without them, from which theirs is near.
        """
        problem, newton = self.problem, self.newton
        of_bodies = np.full(len(self._weak.bodies), largest) if forces is None else forces
        springs = self._weak.springs(self.x.array_r, of_bodies)
        idle = self._weak.idle_pairs(largest, trials)
        if trials is not problem.committed:  # where an attempt has failed it may have lost some
            idle &= self._weak.idle_pairs(largest, problem.committed)
        iterations, reason = newton.solve(step.held(springs)) if found else (0, 0)
        if reason <= 0 or problem.held_weakly() > SHARE * largest:
            more, reason = self._tried(step.held(springs), True, idle)
            iterations += more
        if reason > 0:
            newton.evaluate(step.held(springs))
        self._trial_floating = tuple(self._weak.floating(largest))
        if reason <= 0:  # where an iteration that leads nowhere ends is no equilibrium to judge by
            before = self._weak.floating(largest, problem.committed)
            self._trial_floating = tuple(b for b in self._trial_floating if b in before)
        return iterations, reason, problem.held_weakly() / largest

    def _may_float(self, largest: float) -> bool:
        """Whether a body may, and there is a force to compare with, N; collective."""
        return bool(self._weak.bodies) and largest > self.problem.roundoff

    def _tried(
        self,
        step: StepMode,
        pressed: bool,
        idle: frozenset[int] = frozenset(),
        anew: bool = False,
    ) -> tuple[int, int]:
        return self._run(self._attempt(step, pressed, idle, anew))

    def _attempt(
        self,
        step: StepMode,
        pressed: bool,
        idle: frozenset[int] = frozenset(),
        anew: bool = False,
    ) -> Attempt:
        parts = self.newton, self.predictor, self.x, step, pressed, self._bodies
        attempt = Attempt(*parts, self.failures, idle)
        largest, may_turn = self.newton.largest_force, step.holding is None and not anew
        may_turn &= self._may_float(largest)
        attempt.inside_first = anew or (may_turn and self._weak.is_pulled_off(largest))
        return attempt

    def _run(
        self, attempt: Attempt, way: Callable[[Attempt], tuple[int, int]] | None = None
    ) -> tuple[int, int]:
        found = (way or solve)(attempt)
        self._relaxed, self._adrift = attempt.relaxed, attempt.adrift
        return found

    def advance(self, dt: float) -> StepResult:
        """Make a step of ``dt`` (s) under the loads that are set, and commit it; collective.

        Raises:
            NotConvergedError: there is no solution; nothing was committed.
        """
        result = self.attempt(dt)
        if not result.converged:
            raise NotConvergedError(
                f"the step of {dt:g} s did not converge in {result.iterations} iterations; move "
                "less in one step"
            )
        self.commit()
        return result

    def commit(self) -> None:
        """Accept the last attempt: unknowns, contact history and predictor."""
        self.predictor.commit(self.x, self.trial)
        pressed = any(bool(trial.pressure.any()) for trial in self.problem.trials)
        self._pressed = self.problem.comm.allreduce(pressed, op=MPI.LOR)
        self._floating = self._trial_floating
        self._mode = self.problem.evaluated
        self._from = [term.state for term in self.problem.contacts]
        self.trial.copy(self.x)
        self.problem.commit()
        if not self._carried:  # by springs that are no measure of the forces to come
            self.newton.accept()

    def snapshot(self) -> Snapshot:
        """All that the next step depends on, beside the loads."""
        contacts = self.problem.contacts
        return {
            "x": Nodal(self.x.array_r.copy()),
            "mode": of_step(contacts, self._mode),
            "from": of_contacts(contacts, self._from),
            "bodies": of_bodies(self.problem.solids),
            "pressed": self._pressed,
            "floating": list(self._floating),
            "predictor": self.predictor.snapshot(),
            "newton": self.newton.snapshot(),
            "solver": self.solver.snapshot(),
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen, under the loads of that time; collective.

        Bodies and contacts are evaluated and committed again, so that all that follows from them is
        there.
        """
        problem = self.problem
        to_bodies(problem.solids, kept["bodies"])
        for term, state in zip(
            problem.contacts, to_contacts(problem.contacts, kept["from"]), strict=True
        ):
            term.adopt(state)
        self.x.array[:] = kept["x"]
        self._mode = to_step(problem.contacts, kept["mode"])
        self._from = [term.state for term in problem.contacts]
        # Before the step is committed: afterwards points that flowed in it are elastic.
        self.solver.restore(kept["solver"], self.x, self._mode)
        residual = problem.new_vector()
        problem.residual(None, self.x, residual, self._mode)
        residual.destroy()
        problem.commit()
        self._pressed, self._floating = kept["pressed"], tuple(kept["floating"])
        self.predictor.restore(kept["predictor"])
        self.newton.restore(kept["newton"])

    def seconds(self) -> dict[str, float]:
        """Seconds of this rank so far in each part of the solution, from assembly to solve."""
        return dict(self.problem.timer.seconds)
