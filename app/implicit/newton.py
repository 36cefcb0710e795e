"""Newton's method for one set of loads: SNES on the exact tangent, and its phases.

The residual has kinks where points change between stick and slip, open and closed, or one master
facet and the next. The phases of :data:`NEWTON_PHASES` are tried in turn until one converges; each
but the first only where the iteration before it came near enough.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass, field, replace

import numpy as np
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Kept, Remembers
from tribox.app.equilibrium.step_mode import DEFAULT_STEP, StepMode
from tribox.app.implicit.contact_path import follow
from tribox.app.implicit.linear_solver import (
    Linear,
    LinearSolver,
    errors_as_raised,
    linear_options,
    refusal,
    sets_solver,
)

PREFIX = "tribox_"
_numbers = itertools.count()
REUSE_SAFETY = 10.0  # margin in the estimate of what an iteration with the last tangent leaves
STALLED = 0.1  # relative residual below which a stalled line search is followed by whole steps
KINKED = 1e-5  # relative residual from which on an iteration gains far more than GAIN, or wavers
EDGED = 1e-3  # relative residual below which points on edges may be what an iteration stalls at
GAIN = 4.0
FURTHEST = 1e3  # of the tolerance, as share of the forces: no solve need come closer on its account
LEAST_FORCE = 1e-6  # of the largest force of the run, that residuals are compared with at least
HASTY = 7  # iterations from which on a hasty phase ends where it is slow
CARRIED = 0.05  # share of the load from which on a film's steps are tested
NATURAL = 4  # times that a step is halved that films bound
SHORTEST = 6  # times that a single step is halved
ENOUGH = 0.3  # share of the forces' work along a step that is left where it ends
LONGER, LENGTHS = 4.0, 10  # factor of a step that may go on, and lengths that are tried at most
STALL_WINDOW = 4  # iterations over which the residual must fall by a tenth not to count as stalled


@dataclass(frozen=True, slots=True)
class ImplicitOptions:
    """Settings of the Newton iteration."""

    tolerance: float = 1e-8  # residual norm allowed, relative to the contact or reaction force
    # Newton iterations before an attempt counts as failed; a step may make several
    max_iterations: int = 25
    linear: Linear = "auto"  # "auto": direct up to a number of unknowns, or if slow
    petsc: Mapping[str, str | float | bool] = field(default_factory=dict)  # without prefix


@dataclass(frozen=True, slots=True)
class NewtonPhase:
    """One way to iterate."""

    name: str  # of the phase
    # relative residual that the phase before must have ended with at most; None: any
    within: float | None = None
    line_search: str | None = None  # PETSc's kind; None: that of the options
    # whether points do not leave their master facets for a neighbour as soon as they pass an edge
    freezes_facets: bool = False
    only_pressed: bool = False  # whether contacts that only touch have no stiffness
    starts_over: bool = False  # whether the residuals of the phase before are forgotten
    ends_stalled: bool = False  # whether the phase ends where the residual has stopped to fall
    # whether it ends where it is near, and gains less than an iteration should
    ends_wavering: bool = False


NEWTON_PHASES = (
    NewtonPhase("line search", starts_over=True, ends_stalled=True, ends_wavering=True),
    # The normals of two facets differ, however little, and with them the forces: a point that
    # belongs on the edge between them is pushed from each onto the other, without end.
    NewtonPhase(
        "frozen facets", within=EDGED, freezes_facets=True, starts_over=True, ends_stalled=True
    ),
    # On the far side of a kink the line search may find no decrease however short the step, while
    # a few whole steps decide which side each point is on. The stiffness of contacts that only
    # touch is no derivative: with it they would come nearer by a few per cent in an iteration.
    NewtonPhase("whole steps", within=STALLED, line_search="basic", only_pressed=True),
)


# Where steps are bounded by what the films of contacts bear: the residual of a film goes with the
# third power of its thickness, and a line search that wants it to fall creeps.
BOUNDED_STEPS = NewtonPhase("bounded steps", line_search="basic", starts_over=True)

# Where weak springs hold bodies that float: a whole step may leave far more than they bear, which
# is gone with the next.
TURNED_STEPS = NewtonPhase("turned steps", line_search="basic", starts_over=True)

# Where whole steps are right from the start: while the points that touch are being found, the
# residual says nothing of the distance to the solution, and a line search cuts good steps short.
WHOLE_STEPS = NewtonPhase("whole steps", line_search="basic", starts_over=True)


@dataclass(slots=True)
class Inside:
    """Steps that were found from inside (:mod:`tribox.app.implicit.interior_point`)."""

    last: bool = False  # whether the last step was, as the next one may be
    opening: int | None = None  # the one that worked last; None before any
    softly: bool = False  # whether softer contacts have found a step since


@dataclass(frozen=True, slots=True)
class Patience:
    """How soon a phase that does badly ends, see :meth:`Newton.solve`."""

    patient: bool = False
    hasty: bool = False
    eager: bool = False


@dataclass(slots=True)
class Turns:
    """What turns as a whole."""

    # lets bodies that float turn by a step, the second, that is to be taken off the first
    turn: Callable[[PETSc.Vec, PETSc.Vec], bool] = lambda x, y: False
    # tools that have turned too far for their slip to be known
    spun: Callable[[PETSc.Vec], tuple[str, ...]] = lambda x: ()


class Newton(Remembers):
    """Solves for the unknowns at given loads, from the start that ``trial`` holds.

    Attributes:
        problem, solver, options: what is solved, with which tangent, how well.
        trial: the unknowns; the start before, the solution after :meth:`solve`.
        residuals: residual norms of the last phase, relative to the reference force.
        strayed: whether an iteration led too far away to be evaluated; reset by the caller.
        largest_force: N (N/m), largest reference force of a solution that was committed.
        on_path: whether the start continues the path of the last steps.
        inside: what is known of steps that were found from inside.
        turns: what floats and what turns freely.
        snes: PETSc's solver.
    """

    largest_force: Kept[float]
    inside: Kept[Inside]

    def __init__(
        self, problem: Equilibrium, solver: LinearSolver, trial: PETSc.Vec, options: ImplicitOptions
    ) -> None:
        """Set SNES up on the problem's residual and tangent; collective.

        Raises:
            ValueError: PETSc refuses one of the options, or has no use for it.
        """
        self.problem, self.solver, self.options = problem, solver, options
        self.trial = trial
        self.residuals: list[float] = []
        self._residual = problem.new_vector()
        self._before = problem.new_vector()  # where the tangent was taken last
        self.largest_force, self.strayed = 0.0, False
        self.on_path, self.inside = False, Inside()
        self.turns = Turns()
        self._step, self._phase = DEFAULT_STEP, NEWTON_PHASES[0]
        self._patience = Patience()
        self._tolerance, self._limit = options.tolerance, options.max_iterations
        prefix = f"{PREFIX}{next(_numbers)}_"  # of its own: options must not reach the next run
        self._petsc_options = PETSc.Options(prefix)
        self.snes = self._new_snes(prefix)
        as_it_is, may_turn = sets_solver(options.petsc), options.linear == "auto"
        solver.use(self.snes.getKSP(), as_it_is, may_turn)
        if options.petsc:
            solver.try_options(trial, prefix, options.petsc)

    def _new_snes(self, prefix: str) -> PETSc.SNES:
        snes = PETSc.SNES().create(self.problem.comm)
        snes.setOptionsPrefix(prefix)
        defaults: dict[str, str | float | bool] = {
            "snes_type": "newtonls",
            "snes_linesearch_type": "bt",
            "snes_linesearch_order": 1,
            **linear_options(self.problem, self.options.linear),
        }
        options = self._petsc_options
        for key, value in (defaults | dict(self.options.petsc)).items():
            options[key] = value
        self._usual_search = str(options.getString("snes_linesearch_type"))
        snes.setFunction(self._function, self._residual)
        snes.setJacobian(self._jacobian, self.solver.matrix)
        snes.setLineSearchPreCheck(self._lead)
        # A line search that fails on a tiny step must not pass for convergence.
        snes.setTolerances(stol=0.0, max_it=self.options.max_iterations)
        snes.setConvergenceTest(self._test)
        try:
            snes.setFromOptions()
            snes.getKSP().getPC().setFromOptions()
        except PETSc.Error as error:
            raise refusal(error) from None
        if snes.getKSP().getType() != PETSc.KSP.Type.PREONLY:
            self._leave_preconditioner(snes)
        return snes

    def _leave_preconditioner(self, snes: PETSc.SNES) -> None:
        """Let only the linear solver decide when its preconditioner is made anew.

        SNES sets that with each tangent. With a lag of −2 it asks for it with the next tangent,
        here one that nothing is put into, and never again.
        """
        self._petsc_options["snes_lag_preconditioner"] = -2
        snes.setFromOptions()
        del self._petsc_options["snes_lag_preconditioner"]  # read again, it would ask again
        snes.setJacobian(lambda *_: None, self.solver.matrix)
        snes.computeJacobian(self.trial, self.solver.matrix)
        snes.setJacobian(self._jacobian, self.solver.matrix)

    # -- solution -----------------------------------------------------------------------------

    def search(self, step: StepMode, tolerance: float, limit: int) -> tuple[int, int]:
        """Make whole Newton steps only; collective.

        Returns Newton iterations, and PETSc's converged reason.
        """
        self._patience = replace(self._patience, hasty=False, eager=False)
        self._tolerance, self._limit = tolerance, min(limit, self.options.max_iterations)
        try:
            return self._run(WHOLE_STEPS, step)
        finally:
            self._tolerance, self._limit = self.options.tolerance, self.options.max_iterations

    def solve(
        self,
        step: StepMode,
        patient: bool = False,
        hasty: bool = False,
        eager: bool = False,
        tolerance: float | None = None,
    ) -> tuple[int, int]:
        """Go through the phases until one converges; collective.

        Args:
            step: how the step is evaluated.
            patient, hasty, eager: see :class:`Patience`.
            tolerance: relative residual allowed; None: that of the options.

        Returns:
            Newton iterations, and PETSc's converged reason.
        """
        self._patience = Patience(patient, hasty, eager)
        self._tolerance = self.options.tolerance if tolerance is None else tolerance
        try:
            return self._in_phases(step)
        finally:
            self._tolerance = self.options.tolerance

    def _in_phases(self, step: StepMode) -> tuple[int, int]:
        """See :meth:`solve`."""
        patient, hasty, eager = astuple(self._patience)
        iterations, reason = 0, 0
        if self.is_bounded and not patient:
            self._patience = Patience(eager=eager)
            return self._run(BOUNDED_STEPS, step)
        for phase in NEWTON_PHASES:
            far = hasty and not self._is_let_go()
            within = KINKED if far and phase.within is not None else phase.within
            if within is not None and not self.is_near(within):
                continue
            more, reason = self._run(phase, step)
            iterations += more
            if reason > 0:
                break
        return iterations, reason

    def place(self, step: StepMode) -> tuple[int, int]:
        """Make whole steps in which bodies that weak springs hold turn as rigid ones; collective.

        Returns Newton iterations, and PETSc's converged reason.
        """
        self._patience = Patience(hasty=True)
        return self._run(TURNED_STEPS, step)

    def _is_let_go(self) -> bool:
        """Whether hardly any force is left of those of the run, at the last evaluation."""
        return self.problem.reference_force <= LEAST_FORCE * self.largest_force

    @property
    def is_bounded(self) -> bool:
        """Whether contacts bound the steps."""
        return any(term.bounds_steps for term in self.problem.contacts)

    def _bound(self, x: PETSc.Vec, y: PETSc.Vec) -> bool:
        """Shorten a step ``y`` that is to be taken off ``x`` to what contacts bear; collective."""
        share, problem = 1.0, self.problem
        there = x.copy()
        there.axpy(-1.0, y)
        for term, trial in zip(problem.contacts, problem.trials, strict=True):
            share = min(share, term.bearable(trial, there))
        there.destroy()
        y.scale(share)
        if self._carried_by_films() and self.residuals and self.residuals[-1] > EDGED:
            share *= self._natural(x, y)
        return share < 1.0

    def _lead(self, x: PETSc.Vec, y: PETSc.Vec) -> bool:
        """Change a step ``y`` that is to be taken off ``x`` as the phase wants it; collective."""
        if self._phase is BOUNDED_STEPS:
            return self._bound(x, y)
        if self._phase is TURNED_STEPS:  # bodies that float turn by it
            return self.turns.turn(x, y)
        interior = any(mode.interior is not None for mode in self._step.modes)
        if self._phase.line_search or interior or not self.solver.direct or self._reuse():
            return False
        solve, most = self.solver.solve, self._residual.norm()
        return follow(self.problem, self._step, x, y, solve, self._norm_at, most)

    def _norm_at(self, x: PETSc.Vec) -> float:
        """Norm of the residual; collective."""
        f = x.duplicate()
        self._function(self.snes, x, f)
        norm = float(f.norm())
        f.destroy()
        return norm

    def _carried_by_films(self) -> bool:
        """Whether films carry enough, now or at the last step, for their kinks to count most."""
        trials = [*self.problem.trials, *self.problem.committed]
        films = [trial.normal_contact.lubrication for trial in trials]
        return any(f is not None and f.share > CARRIED for f in films)

    def _natural(self, x: PETSc.Vec, y: PETSc.Vec) -> float:
        """Shorten a step ``y`` off ``x`` until the one that would follow it is smaller; collective.

        That is measured with the tangent at hand: the natural monotonicity test of P. Deuflhard,
        which no scaling of the residual enters. Returns the share that is left.
        """
        there, f, following = x.copy(), x.duplicate(), x.duplicate()
        length, share = y.norm(), 1.0
        for _ in range(NATURAL):
            there.waxpy(-1.0, y, x)
            self._function(self.snes, there, f)
            self.solver.solve(f, following)
            if following.norm() <= (2.0 - share) * length:
                break
            y.scale(0.5)
            share *= 0.5
        for vector in (there, f, following):
            vector.destroy()
        return share

    def residual_of(self, step: StepMode) -> float:
        """Residual at ``trial`` over the reference force; collective."""
        self._step = step
        self._function(self.snes, self.trial, self._residual)
        return self._relative_residual()

    def _relative_residual(self) -> float:
        """Of the last evaluation; collective."""
        norm, scale = self.problem.judged(self._residual, self.problem.reference_force)
        return norm / scale if scale > 0.0 else norm

    def step(self, step: StepMode, falling: bool) -> None:
        """Make one Newton step, shorter where it leads to no numbers; collective."""
        x, f = self.trial, self._residual
        start, increment = self._increment(step)
        most = f.norm() if falling else np.inf
        for cut in range(SHORTEST):
            x.waxpy(-(0.5**cut), increment, start)
            self.residual_of(step)
            if f.norm() <= most and np.isfinite(f.norm()):
                break
        start.destroy()
        increment.destroy()

    def step_to_least_energy(self, step: StepMode, first: float, near: float) -> float:
        """Make one Newton step, as long as the forces along it do work; collective.

        Where the tangent has lost its stiffness along the step, that leads uphill: the step is made
        the other way, and becomes longer until the forces turn round. Near a solution it is
        friction that makes the work negative, and the step is made as it is. Returns the relative
        residual before the step.

        Args:
            first: m, how far the unknowns go at most in the first trial the other way.
        """
        x, f = self.trial, self._residual
        start, increment = self._increment(step)
        before, whole = self._relative_residual(), increment.dot(f)

        def work(length: float) -> float:
            x.waxpy(-length, increment, start)
            self.residual_of(step)
            left: float = increment.dot(f) / whole if whole else 0.0
            return left if np.isfinite(left) else -np.inf

        if whole >= 0.0:
            length_to_least_energy(work, 1.0)
        elif before < near or not np.isfinite(whole):  # no numbers: the caller sees that
            work(1.0)
        else:
            furthest = increment.norm(PETSc.NormType.INFINITY)
            length_to_least_energy(work, -min(1.0, first / furthest))
        start.destroy()
        increment.destroy()
        return before

    def _increment(self, step: StepMode) -> tuple[PETSc.Vec, PETSc.Vec]:
        """The trial, and what a Newton step subtracts from it; both to be destroyed; collective."""
        x, f = self.trial, self._residual
        start, increment = x.copy(), f.duplicate()
        self.residual_of(step)
        self.solver.assemble(x, step, self._before)
        x.copy(self._before)
        self.solver.solve(f, increment)
        if step.holding is not None and step.holding.weak:
            self.turns.turn(start, increment)
        return start, increment

    def is_near(self, relative: float = STALLED) -> bool:
        """Whether the last phase came so near that the bodies touch where they will."""
        return bool(self.residuals and self.residuals[-1] <= relative)

    def begin(self, x: PETSc.Vec) -> None:
        """Begin again from the converged state ``x``: nothing of the last solution is known."""
        self.residuals, self.on_path = [], False
        x.copy(self._before)

    def evaluate(self, step: StepMode) -> None:
        """Evaluate the problem at ``trial``, unless that was done last; collective."""
        if not self.problem.is_evaluated(self.trial):
            self.problem.residual(None, self.trial, self._residual, step)

    def accept(self) -> None:
        """Take note of the forces of a solution that is committed."""
        self.largest_force = max(self.largest_force, self.problem.reference_force)

    def _run(self, phase: NewtonPhase, step: StepMode) -> tuple[int, int]:
        problem = self.problem
        if phase.starts_over:
            self.residuals = []
        self._phase, self._step = phase, step
        if phase.freezes_facets:
            self._step = step.frozen(problem.contacts, problem.trials)
        if phase.only_pressed:
            self._step = step.only_pressed(problem.contacts)
        if phase.line_search is None:
            return self._iterate()
        self._search(phase.line_search)
        result = self._iterate()
        self._search(self._usual_search)
        return result

    def _iterate(self) -> tuple[int, int]:
        """Let SNES solve from the present trial; (iterations, converged reason).

        After a linear solve that failed it continues once with a new preconditioner.
        """
        iterations = 0
        for _ in range(1 if self.solver.direct else 2):
            # The other parts take themselves out.
            with self.problem.timer("linear solve"), errors_as_raised():
                self.snes.solve(None, self.trial)
            iterations += self.snes.getIterationNumber()
            if self.solver.forget_failure():
                break
        return iterations, self.snes.getConvergedReason()

    def _search(self, kind: str) -> None:
        """Use a kind of line search."""
        self._petsc_options["snes_linesearch_type"] = kind
        self.snes.setFromOptions()

    # -- what SNES calls ----------------------------------------------------------------------

    def _function(self, snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
        # Numbers that are not finite, or far away, come from an inverted element or a singular
        # matrix. SNES sees a norm that is none: the line search cuts, or the step fails.
        strays = not self.problem.rounding.is_within_reach(x)
        self.strayed |= strays
        if strays or self.turns.spun(x):
            f.set(np.nan)
        else:
            self.problem.residual(snes, x, f, self._step)

    def _jacobian(self, snes: PETSc.SNES, x: PETSc.Vec, A: PETSc.Mat, P: PETSc.Mat) -> None:
        if not self._reuse():
            self.solver.assemble(x, self._step, self._before)
            x.copy(self._before)
        share = self._tolerance / max(self.residuals[-1], self._tolerance)
        first_on_path = self.on_path and len(self.residuals) == 1
        self.solver.aim(share, first_on_path, least=FURTHEST * self._tolerance)

    def _reuse(self) -> bool:
        """Whether the tangent factorised last will do for an iteration that ends the step.

        A Newton iteration that reduced the residual by c has moved the tangent by about as much,
        so the old one reduces it by about c once more.
        """
        if len(self.residuals) < 2 or self.residuals[-2] == 0.0:
            return False
        last = self.residuals[-1]
        return REUSE_SAFETY * last * last / self.residuals[-2] <= self._tolerance

    def _test(
        self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]
    ) -> PETSc.SNES.ConvergedReason | None:
        """Residual against the present contact or reaction force: no unit enters."""
        norm, reasons = norms[2], PETSc.SNES.ConvergedReason
        if not np.isfinite(norm):
            return reasons.DIVERGED_FNORM_NAN
        holding = self._step.holding
        least = 1.0 if holding is not None and holding.weak else LEAST_FORCE
        scale = max(self.problem.reference_force, least * self.largest_force)
        if self.problem.fields:
            norm, scale = self.problem.judged(self._residual, scale)
        self.residuals.append(norm / scale if scale > 0.0 else norm)
        idle = self._phase is WHOLE_STEPS and iteration == 0  # a change may hide in the tolerance
        small = norm <= self._tolerance * scale or norm <= self._noise()
        if small and not idle:
            return reasons.CONVERGED_FNORM_RELATIVE
        if iteration >= self._limit:
            return reasons.DIVERGED_MAX_IT
        if self._patience.hasty and iteration >= HASTY and self._is_slow():
            return reasons.DIVERGED_LINE_SEARCH
        if self._patience.eager and iteration and self._gains_little():
            return reasons.DIVERGED_LINE_SEARCH
        if self._phase.ends_wavering and self._wavers():
            return reasons.DIVERGED_LINE_SEARCH
        if self._phase.ends_stalled and self._is_stalled():
            return reasons.DIVERGED_LINE_SEARCH
        return None

    def _noise(self) -> float:
        """Residual norm that rounding leaves, also of bodies that have come to rest; collective."""
        return self.problem.roundoff_beside(self.largest_force)

    def _is_slow(self) -> bool:
        """Whether the residual is far from small, and has not lately fallen to a tenth."""
        last = self.residuals[-1]
        return last > KINKED and last > 0.1 * self.residuals[-STALL_WINDOW]

    def _gains_little(self) -> bool:
        """Whether the residual is far from small, and the last iteration has not halved it."""
        before, last = self.residuals[-2:]
        return last > KINKED and last > 0.5 * before

    def _wavers(self) -> bool:
        """Whether the iteration is so near that it should gain far more than it does."""
        if len(self.residuals) < 2:
            return False
        before, now = self.residuals[-2:]
        return now <= KINKED and now * GAIN > before

    def _is_stalled(self) -> bool:
        """Whether the residual has stopped to fall, and another phase or start is better."""
        recent = self.residuals[-STALL_WINDOW - 1 :]
        stalled = len(recent) > STALL_WINDOW and recent[-1] > 0.9 * recent[0]
        return stalled and (recent[-1] <= STALLED or not self._patience.patient)


def length_to_least_energy(work: Callable[[float], float], first: float) -> float:
    """Find the length of a step along which energy is nearly least; that tried last.

    A step that is too long shows forces that pull back: bodies that flow yield in directions in
    which they will not, and Newton's method then goes to and fro between lengths too long and too
    short (H. Matthies, G. Strang, The solution of nonlinear finite element equations, 1979).
    """
    near, at_near = 0.0, 1.0
    length, left = first, work(first)
    for _ in range(LENGTHS if first < 0.0 else 0):
        if left <= ENOUGH:
            break
        near, at_near = length, left
        length *= LONGER
        left = work(length)
    if left >= -ENOUGH:
        return length
    far, at_far = length, left
    for _ in range(LENGTHS):
        share = at_near / (at_near - at_far)
        length = near + min(max(share, 0.1), 0.9) * (far - near)
        left = work(length)
        if abs(left) <= ENOUGH:
            return length
        if left > 0.0:
            near, at_near = length, left
        else:
            far, at_far = length, left
    if left < 0.0 and near:
        work(near)
        return near
    return length
