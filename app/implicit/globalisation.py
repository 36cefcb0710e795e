"""What is tried to solve a step, one phase after the other until one converges.

The first phase starts from the prediction. Those after it start elsewhere, or approach the solution
through softer contacts: where many points open or close at once, a stiff penalty makes Newton's
method try one set of them after another, while a soft one lets it find the region. What snaps
is relaxed last (:mod:`tribox.app.implicit.relaxation`).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit.interior_point import FromInside, unbalanced_loads
from tribox.app.implicit.predictor import Attempt, Phase
from tribox.app.implicit.relaxation import Relaxation
from tribox.forms.contact.interior_point import InteriorPoint, SoftenedPoint
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.facets import Floats


@dataclass(frozen=True, slots=True)
class PredictedStart(Phase):
    """Newton's method from the predicted start."""

    # whether it is tried only where the prediction leaves little, or, where contacts rub, not too
    # much, as long as each iteration gains
    if_near: bool = False

    def run(self, attempt: Attempt) -> tuple[int, int]:
        if is_adrift(attempt):
            attempt.start = attempt.trial.array_r.copy()
            return 0, PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH
        started = attempt.predictor.predict(
            attempt.x, attempt.trial, attempt.step, only_near=self.if_near
        )
        attempt.newton.on_path = attempt.continued = started == 0
        attempt.start = attempt.trial.array_r.copy()
        failed = PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH
        if strays(attempt):
            return started, failed
        newton, eager = attempt.newton, False
        started += hold_closed(attempt) if started <= 1 else 0
        if self.if_near:
            left = newton.residual_of(attempt.step)
            eager = left > FAR
            if left > (NEARLY if attempt.predictor.rubbing() else FAR):
                return started, failed
        if attempt.step.holding is not None:
            more, reason = newton.place(attempt.step)
            return started + more, reason
        more, reason = newton.solve(
            attempt.step,
            patient=not attempt.has_contacts,
            hasty=attempt.has_contacts and not attempt.predictor.rubbing(),
            eager=eager,
        )
        return started + more, reason


def hold_closed(attempt: Attempt) -> int:
    """Hold together what only a near prediction has opened, for some iterations; collective.

    The prediction of a contact that begins to slide opens vertices at its rim. Open ones have
    no stiffness, so that Newton's method closes but a few in each iteration; where the contacts
    pull as well, all close at once that are to. What is pulled in the end opens afterwards.

    Returns:
        The number of iterations.
    """
    newton, problem = attempt.newton, attempt.newton.problem
    if problem.flows or newton.is_bounded or not attempt.predictor.rubbing():
        return 0
    if not SOLVED <= newton.residual_of(attempt.step) <= RIM:
        return 0
    opened, last = _opened(problem), np.inf
    for number in range(HOLDS):
        if not 0 < opened <= FEWER * last:
            return number
        pulling = attempt.step.with_penalty_scale(problem.contacts, 1.0, HELD)
        newton.step(pulling, falling=False)
        newton.residual_of(attempt.step)
        opened, last = _opened(problem), opened
    return HOLDS


def _opened(problem: Equilibrium) -> int:
    """Vertices or points that were closed at the last step and are not now; collective."""
    count = 0
    for now, before in zip(problem.trials, problem.committed, strict=False):
        found = [one.normal_contact for one in (now, before)]
        closed = [one.closed if one.active is None else one.active for one in found]
        count += int(np.count_nonzero(closed[1] & ~closed[0]))
    return int(problem.comm.allreduce(count))


@dataclass(frozen=True, slots=True)
class LinearStart(Phase):
    """Newton's method from the linear step, whatever the path was."""

    def run(self, attempt: Attempt) -> tuple[int, int]:
        started = attempt.predictor.restart(attempt.x, attempt.trial, attempt.step)
        more, reason = attempt.newton.solve(attempt.step, patient=True)
        return started + more, reason


@dataclass(frozen=True, slots=True)
class ThinnedOil(Phase):
    """Newton's method with thin oil first, that carries next to nothing, then with thicker one.

    That follows the Stribeck curve up to the film of the step's speed. A film begins between
    asperities, where at a speed of the mixed regime it would push many times as hard as what
    presses: Newton's method goes to and fro. After a film at a lower speed the same film is left by
    oil that is as much thinner as this is faster, and is followed from there first. Where the film
    of the last state, or one that is drawn, nearly carries its load at the step's speed, that is
    the start: the prediction knows the state before the step, where nothing moves and no film of
    its own carries. Between smooth surfaces it is the only one, as thin oil leaves them no load.
    """

    def run(self, attempt: Attempt) -> tuple[int, int]:
        iterations, (slower, left) = 0, self._slower(attempt)
        faster, smooth = THIN < slower < 1.0 / LEAST_THICKER, self._is_smooth(attempt)
        if faster or smooth or left < CARRIES:
            factor = slower if faster else 1.0
            iterations, reason = self._followed(attempt, factor, factor**-0.5)
            if reason > 0 or smooth:
                return iterations, reason
        more, reason = self._followed(attempt, THIN, THICKER)
        return iterations + more, reason

    @staticmethod
    def _is_smooth(attempt: Attempt) -> bool:
        """Whether no film has asperities beside it."""
        terms = attempt.newton.problem.contacts
        films = [term.model for term in terms if isinstance(term, LubricatedTerm)]
        return all(film.rough.sigma == 0.0 for film in films)

    @staticmethod
    def _slower(attempt: Attempt) -> tuple[float, float]:
        """The last state's speed over that of the step, least of all films; its residual then."""
        problem = attempt.newton.problem
        attempt.trial.array[:] = problem.constrained_values(attempt.x)
        left = attempt.newton.residual_of(attempt.step)
        ratios = [1.0]
        for pair in zip(problem.committed, problem.trials, strict=False):
            films = [trial.normal_contact.lubrication for trial in pair]
            speeds = [
                np.abs(film.step.speed).max(initial=0.0) for film in films if film and film.step
            ]
            if len(speeds) == 2 and speeds[1] > 0.0:
                ratios.append(float(speeds[0] / speeds[1]))
        return min(ratios), left

    def _followed(self, attempt: Attempt, factor: float, times: float) -> tuple[int, int]:
        """From a ``factor`` of the viscosity to all of it, by ``times`` and its roots."""
        contacts, trial = attempt.newton.problem.contacts, attempt.trial
        last, iterations = 0.0, 0
        thinned = attempt.step.with_thinned_oil(contacts, factor)
        found = self._start(attempt, thinned)
        while True:
            trial.array[:] = found
            thinned = attempt.step.with_thinned_oil(contacts, factor)
            more, reason = attempt.newton.solve(thinned)
            iterations += more
            if reason > 0 and factor == 1.0:
                return iterations, reason
            if reason > 0:
                found, last = trial.array_r.copy(), factor
            elif last == 0.0 or times < LEAST_THICKER:
                return iterations, reason
            else:
                times **= 0.5
            factor = min(1.0, times * last)

    @staticmethod
    def _start(attempt: Attempt, step: StepMode) -> Floats:
        """The prediction, or the last state where that leaves less: all slides there at once."""
        ends = []
        for start in (attempt.start, attempt.newton.problem.constrained_values(attempt.x)):
            attempt.trial.array[:] = start
            left = attempt.newton.residual_of(step)
            ends.append(left if np.isfinite(left) else np.inf)
        return attempt.trial.array_r.copy() if ends[1] < ends[0] else attempt.start


@dataclass(frozen=True, slots=True)
class SoftContact(Phase):
    """Newton's method with soft contacts that begin from the last step's pressures.

    On the way round a corner of a tool a stiff penalty turns the least error into a pressure of
    many times that which is there, and contacts open and close in turn. With a soft one the bodies
    find the place; what it lacks is made up for by pressures that are found with it, and the
    contacts as they are have little left to do (:class:`SoftenedPoint`).
    """

    def run(self, attempt: Attempt) -> tuple[int, int]:
        newton, problem = attempt.newton, attempt.newton.problem
        attempt.return_to_start()
        iterations, trials = 0, problem.committed
        for _ in range(ROUNDS):
            soft = attempt.step.inside(softened(problem, trials))
            more, reason = newton.solve(soft, patient=True, tolerance=ROUND)
            iterations += more
            if reason <= 0:
                return iterations, reason
            trials = list(problem.trials)
            if newton.residual_of(attempt.step) < FAR:
                break
        more, reason = newton.solve(attempt.step, patient=True)
        if reason > 0:
            newton.inside.softly = attempt.pressed
        return iterations + more, reason


def softened(
    problem: Equilibrium, trials: Sequence[ContactTrial]
) -> list[InteriorPoint | SoftenedPoint | None]:
    """Soft contacts that begin from the pressures of ``trials``, none of which is from nothing."""
    points: list[InteriorPoint | SoftenedPoint | None] = []
    for term, trial in itertools.zip_longest(problem.contacts, trials):
        if term.tied or not term.active:
            points.append(None)
            continue
        pressure: Floats = np.zeros(len(term.penalty))
        if trial is not None:
            normal = trial.normal_contact
            pressure = normal.pressure if normal.nodal_pressure is None else normal.nodal_pressure
        points.append(SoftenedPoint((1.0 - SOFT) * pressure, term.penalty, SOFT))
    return points


@dataclass(frozen=True, slots=True)
class FirmSprings(Phase):
    """Newton's method with far stiffer springs on bodies that float first, then with weaker ones.

    A body that a tool moves aside turns, and the turn is found by a linear step: the stress that
    this leaves is some millions of times the pressure that weak springs answer, so that the body
    bounces off the tool, and by the next iteration back. Springs not much weaker than the body let
    it be placed; from there it moves hardly any more.
    """

    def run(self, attempt: Attempt) -> tuple[int, int]:
        newton, trial, springs = attempt.newton, attempt.trial, attempt.step.holding
        assert springs is not None
        attempt.return_to_start()
        found, firm, softer, iterations = trial.array_r.copy(), FIRMEST, SOFTER, 0
        while True:
            held = replace(springs, stiffness=firm * springs.stiffness)
            more, reason = newton.solve(attempt.step.held(held), patient=True)
            iterations += more
            if reason > 0 and firm == 1.0:
                return iterations, reason
            if reason > 0:
                found = trial.array_r.copy()
            elif firm == FIRMEST or softer < LEAST_SOFTER:
                return iterations, reason
            else:
                trial.array[:] = found
                firm, softer = firm * softer, softer**0.5
            firm = max(1.0, firm / softer)


# Of the springs of bodies that float: how much stiffer they are at first, the factor by which they
# become softer, and the least of that.
FIRMEST, SOFTER, LEAST_SOFTER = 1e5, 10.0, 1.5

# Of the oil's viscosity: where it begins, what it grows by, and the least of that.
THIN, THICKER, LEAST_THICKER = 1e-4, 10.0, 1.2
CARRIES = 0.5  # residual over the force, up to which a film nearly carries it

ROUNDS, ROUND = 8, 1e-3  # solutions with soft contacts at most, and their relative residual

HELD = 0.05  # gap, in lengths of a slave facet, up to which what was closed is held together
HOLDS, FEWER = 3, 0.95  # such iterations at most, and open ones left over those before
RIM = 0.05  # relative residual of a prediction up to which it errs only at the rim of a contact
SOLVED = 1e-3  # the same from which on so much is opened that holding saves iterations
FAR = 1e-2  # relative residual of a prediction from which on contacts change much
NEARLY = 2.0  # the same of contacts that rub, where a few iterations show whether it is
STANDS = 1e-9  # way of a support, in lengths of a slave facet, that is rounding
FIRST_CUTS = (1, 2)  # failures from a state after which shorter steps may fail alike


def phases_after(attempt: Attempt, inside: FromInside) -> tuple[Phase, ...]:
    """What is tried after the predicted start has failed, among it a way from ``inside``.

    Where pressed elastic bodies rub, a shorter step is better if the iteration came near, and
    softer contacts are tried first; so they are where they found the last such step. Where a
    shorter step of metal, or of what presses, has failed as the longer one did, it is relaxed.
    """
    if attempt.newton.is_bounded:
        flows = any(mode.rate_dependent for mode in attempt.step.modes)
        return (ThinnedOil(), LinearStart()) if flows else (LinearStart(),)
    if not attempt.has_contacts:
        return (LinearStart(),)
    near, flows = attempt.newton.is_near(FAR), attempt.newton.problem.flows
    if attempt.step.holding is not None:
        return (FromInside("last"), FirmSprings())
    rubs = attempt.pressed and not flows and attempt.predictor.rubbing()
    may_snap = flows or attempt.pressed
    relaxed = (Relaxation(),) if may_snap and attempt.failures in FIRST_CUTS else ()
    if near:
        return relaxed if rubs else (inside, *relaxed)
    if rubs and is_moved(attempt):
        return (SoftContact(), inside, *relaxed)
    if attempt.pressed and attempt.newton.inside.softly and not flows:
        return (SoftContact(), inside, *relaxed)
    return (inside, SoftContact(), *relaxed)


def is_moved(attempt: Attempt) -> bool:
    """Whether a displacement, or a spring's end, drives the step: not forces alone; collective."""
    problem = attempt.newton.problem
    return problem.given_way(attempt.x) > STANDS * facet_length(problem)


def solve(attempt: Attempt) -> tuple[int, int]:
    """Solve a step by the phases in turn; iterations and PETSc's converged reason; collective.

    After a step that was found from inside the next one begins there, unless its prediction is
    near.
    """
    first: tuple[Phase, ...] = (PredictedStart(),)
    floats = attempt.step.holding is not None
    began_inside = attempt.newton.inside.last and attempt.has_contacts and not floats
    if began_inside:
        first = (PredictedStart(if_near=True), FromInside("last"), *first)
    if attempt.inside_first and attempt.bodies.directions:
        first = (FromInside(), *first)
    iterations, reason = _in_turn(attempt, first)
    if reason <= 0 and not attempt.adrift:
        inside = FromInside("others" if began_inside else "all")
        after = phases_after(attempt, inside)
        rest = [p for p in after if p not in first and (p is inside or not attempt.shortly)]
        attempt.return_to_start()
        more, reason = _in_turn(attempt, rest)
        iterations += more
    return iterations, reason


def solve_otherwise(attempt: Attempt) -> tuple[int, int]:
    """Go on with an attempt that was tried shortly, by what it left out; see :func:`solve`."""
    attempt.newton.begin(attempt.x)
    after = phases_after(attempt, FromInside())
    return _in_turn(attempt, [p for p in after if not isinstance(p, FromInside)])


def _in_turn(attempt: Attempt, phases: Iterable[Phase]) -> tuple[int, int]:
    iterations, reason = 0, int(PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH)
    for phase in phases:
        attempt.newton.begin(attempt.x)
        more, reason = phase.run(attempt)
        iterations += more
        if reason > 0 and isinstance(phase, FromInside) and has_escaped(attempt):
            reason = int(PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH)
        attempt.newton.inside.last = reason > 0 and isinstance(phase, FromInside)
        if reason > 0 or attempt.adrift:
            break
    return iterations, reason


# -- Bodies that a load presses on each other before they touch ------------------------------------

ESCAPES = 2  # failed attempts, after which a body that has lost all contact is believed to
STRAYS = 1.0  # way of a body, in lengths of a slave facet, that a linear step is not believed
SOFT = 0.03  # penalty scale of soft contacts


def is_adrift(attempt: Attempt) -> bool:
    """Whether a load acts on a loose body and no contact point is closed to carry it; collective.

    The tangent is singular then.
    """
    problem, bodies = attempt.newton.problem, attempt.bodies
    if attempt.pressed or not bodies.directions:
        return False
    if not unbalanced_loads(attempt).any():
        return False
    touching = any(bool(t.kinematics.closed.any()) for t in problem.trials)
    return not problem.comm.allreduce(touching, op=MPI.LOR)


def strays(attempt: Attempt) -> bool:
    """Whether the start moves a loose body too far to be believed, at first touch; collective."""
    problem, bodies = attempt.newton.problem, attempt.bodies
    if attempt.pressed or not bodies.directions:
        return False
    way = float(np.max(np.abs(bodies.moved(attempt.start - attempt.x.array_r))))
    return not way <= STRAYS * facet_length(problem)


def has_escaped(attempt: Attempt) -> bool:
    """Whether a body that contact alone holds, and that was pressed, touches nothing; collective.

    It is in balance wherever it has no contact, also where a shorter step would not have taken it:
    out of the gap of rolls that draw it in. Only what shorter steps find as well is believed.
    """
    bodies, committed = attempt.bodies, attempt.newton.problem.committed
    meshed = np.array([one.kind == "body" for one in bodies.directions], dtype=bool)
    if not attempt.pressed or not meshed.any() or attempt.failures >= ESCAPES:
        return False
    return bool(set(bodies.unpressed(meshed)) - set(bodies.unpressed(meshed, committed)))


def facet_length(problem: Equilibrium) -> float:
    """Largest mean length of the slave facets of a pair, m."""
    return max((term.surface.facet_length for term in problem.contacts), default=0.0)
