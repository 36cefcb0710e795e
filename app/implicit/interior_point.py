r"""A way into contact from inside: all pressures and slacks positive, and their products fall to 0.

With the slack s = g + p/K of each vertex (or point) the penalty's law p = K⟨−g⟩ reads p ≥ 0, s ≥ 0,
p s = 0. Newton's method on the law itself moves the border of a contact by about a facet in an
iteration where bodies resist by bending, and that of the sticking region likewise, so that
iterations grow with the mesh, and no shorter step helps. Here p and s are unknowns of their own,
p s = μ, and μ falls from iteration to iteration, as are the two sides of the onset of slip. For the
bodies an iteration is one of Newton's with laws that are linear
(:mod:`tribox.forms.contact.interior_point`): no kink in it, and a tangent that is never singular
where bodies are held by contact alone.

The pressures begin as those of the last state, and μ as a small part of the energy that the contact
may take up in the step: a pressure times the way of what moves. Where loads alone drive a body that
nothing touches yet, they begin as those that bear it, across the gap that there is: the body is in
balance from the start, and the gap closes as μ falls. What is found is a start for the exact laws,
by which the step is solved in the end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.implicit.predictor import Attempt, Phase
from tribox.forms.contact.interior_point import TINY, InteriorPoint, InteriorSlip
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.state import ContactTrial
from tribox.forms.friction.law import presliding_length
from tribox.geometry.surfaces.facets import Floats


@dataclass(frozen=True, slots=True)
class Opening:
    """How an iteration begins."""

    barrier: float  # μ over mean pressure and way: more finds contacts that change much
    # least share of pressures and slacks that an iteration leaves: more is slower, and keeps
    # vertices from opening and closing in turn
    kept: float = 0.0
    central: bool = False  # whether it stays on the central path
    # whether it begins at the linear step where the prediction continues the path
    linear: bool = False


# What solves the most steps in the fewest iterations comes first. A strip that its weight alone
# presses, and that is lifted off, needs the highest barrier.
OPENINGS = (Opening(1e-2, 0.005), Opening(1.0, 0.005), Opening(1e-4, 0.005))
# Metal flows where linear laws pull at what wants to open: laws that never pull come first, and of
# the linear ones those with the lowest barrier. A first contact may take a higher one.
OPENINGS_FLOWING = (
    Opening(1e-6, central=True),
    Opening(1e-6, central=True, linear=True),
    Opening(1e-4, 0.005, linear=True),
    Opening(1e-2, 0.005, linear=True),
)
SHRINKS = 0.03  # μ from an iteration to the next
SHRINKS_FLOWING = 0.1  # the same where bodies flow: they follow less quickly
UNPRESSED = 1e-4  # pressure over E*, of a pair that pressed nowhere
UNKNOWN = 1e-6  # the same over penalty times facet length, where E* is not known
PRESSED = 30.0  # mean pressure over that of a gap that is rounding, from which on a pair presses
MOST_WAY, LEAST_WAY, NO_WAY = 0.3, 1e-6, 0.01  # in facets: bounds of the way, and without any
REACH = 3.0  # gap in facets, and in least gaps less one, up to which vertices feel each other
SETTLED = 1.0  # relative residual above which the bodies move before pressures change
STRIDE = 1e-6  # of a step, over which the rates of gaps at its start are taken
SOLVED = 0.3  # relative residual below which μ falls
NEAR = 1e-3  # relative residual of the exact law that is near enough for Newton's method on it
NOWHERE = 1e6  # m; gap of points that have no master below them
MOST_SLIP = 30.0  # permanent slip to begin with at most, over the part of the way that μ is of
TURNED = 0.02  # first step away from a state of which the tangent lost its stiffness, in facets
# Friction that weakens with the slip has no interior point: the exact law stays some way off.
CLOSE, ENDED = 1e-2, 0.9  # its residual there at most, and over that before at least
PATIENCE = 12  # iterations after which the bodies should move no further
LIMIT = 20  # iterations for one opening
# On the central path μ falls where the residual is below EASED and the last step left at most
# GAINED of it, faster below EASY; to where the exact law, which may stall on its kinks, is solved
# but for NEARER.
PATIENCE_CENTRAL, LIMIT_CENTRAL = 24, 32
EASED, EASY, SHRINKS_FAST, GAINED = 0.1, 1e-2, 1e-2, 0.5
NEARER = 1e-6

Points = list[InteriorPoint | None]


@dataclass(frozen=True, slots=True)
class FromInside(Phase):
    """Interior points first, and from what they find Newton's method on the exact law."""

    # those that are tried: all, only the one that worked last, or the others
    openings: Literal["all", "last", "others"] = "all"

    def run(self, attempt: Attempt) -> tuple[int, int]:
        iterations, reason = 0, int(PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH)
        numbers, attempt.loads = order(attempt), applied_loads(attempt)
        tried = {"all": numbers, "last": numbers[:1], "others": numbers[1:]}
        openings = OPENINGS_FLOWING if attempt.newton.problem.flows else OPENINGS
        for number in tried[self.openings]:
            opening = openings[number]
            if number != numbers[0]:
                if opening.central and opening.linear and not attempt.continued:
                    continue  # the prediction was the linear step: this path was tried
                opening = replace(opening, linear=True)  # the prediction leads elsewhere
            attempt.newton.begin(attempt.x)
            attempt.trial.array[:] = attempt.x.array_r
            way = followed if opening.central else approached
            more, found = way(attempt, opening)
            iterations += more
            if attempt.adrift:
                break
            if found:
                more, reason = attempt.newton.solve(attempt.step)
                iterations += more
                if more == 0:  # the tangent that is kept belongs to the exact law
                    attempt.newton.solver.assemble(attempt.trial, attempt.step)
            if reason > 0:
                # A first contact that was found by linear laws says nothing of the paths.
                if attempt.pressed or not attempt.newton.problem.flows:
                    attempt.newton.inside.opening = number
                attempt.newton.inside.softly = False
                break
        return iterations, reason


def order(attempt: Attempt) -> list[int]:
    """Numbers of the openings, the best first: what worked last does again, unless bodies flow.

    Where metal is bent over tools, the changes of contact that the continued path repeats are the
    wrong ones: once a step was found otherwise, the central path begins at the linear step. Before
    anything presses none is followed: neither start knows of a first contact.
    """
    last = attempt.newton.inside.opening or 0
    if not attempt.newton.problem.flows:
        return sorted(range(len(OPENINGS)), key=lambda number: number != last)
    first = min(last, 1) if attempt.pressed else 2
    return list(range(first, len(OPENINGS_FLOWING)))


def approached(attempt: Attempt, opening: Opening) -> tuple[int, bool]:
    """Iterate on interior points; iterations, and whether the exact law should go on; collective.

    Bodies that flow would yield wherever points that want to open still hold them: there pressures
    change in each iteration, and the energy of bodies and contacts limits it.
    """
    newton, problem, trial = attempt.newton, attempt.newton.problem, attempt.trial
    least = SHRINKS_FLOWING if problem.flows else SHRINKS
    points = starting_points(attempt, opening.barrier)
    step, start = attempt.step.inside(points), attempt.x.copy()
    # The prediction has turned the bodies already, which the linear step does not; metal that flows
    # takes changes of contact from it that are the wrong ones (see `order`).
    goes_on, iterations = attempt.continued and not opening.linear, 0
    if goes_on:
        attempt.return_to_start()
        trial.copy(start)
    else:
        iterations = attempt.predictor.restart(attempt.x, trial, step)
    exact, limit = np.inf, min(LIMIT, newton.options.max_iterations)
    while iterations < limit:
        left = newton.residual_of(step)
        if not np.isfinite(left) or (left > SETTLED and iterations >= PATIENCE):
            return iterations, False
        settled = left < SETTLED
        stepped = iterations > 0  # nothing is expected of the prediction
        if stepped and (settled or problem.flows):
            gaps = linear_gaps(problem, step, start, trial)
            shrinks = least if left < SOLVED else 1.0
            points = _advanced(problem, points, shrinks, opening.kept, gaps)
            step = attempt.step.inside(points)
        if left < NEAR**0.5:
            last, exact = exact, newton.residual_of(attempt.step)
            if exact < NEAR or ENDED * last < exact < CLOSE:
                return iterations, True
        trial.copy(start)
        if problem.flows:
            newton.step_to_least_energy(step, TURNED * shortest_facet(problem), EASED)
        else:
            newton.step(step, falling=not settled and iterations > 1)
        iterations += 1
        if has_gone(attempt):
            return iterations, False
    return iterations, newton.residual_of(attempt.step) < NEAR


def unbalanced_loads(attempt: Attempt) -> Floats:
    """Loads (d,), N, that nothing carries at the last state, in each loose direction; collective.

    Rounding is none.
    """
    problem, trial = attempt.newton.problem, attempt.trial
    trial.array[:] = problem.constrained_values(attempt.x)
    residual = problem.new_vector()
    problem.residual(None, trial, residual, attempt.step)
    loads: Floats = -attempt.bodies.sums(residual.array_r)
    residual.destroy()
    loads[np.abs(loads) <= problem.roundoff] = 0.0
    return loads


def applied_loads(attempt: Attempt) -> Floats:
    """Loads (d,), N, of bodies that only contact can hold, and does not yet; collective."""
    if attempt.bodies.directions and (attempt.inside_first or not attempt.pressed):
        return unbalanced_loads(attempt)
    return np.zeros(len(attempt.bodies.directions))


def has_gone(attempt: Attempt) -> bool:
    """Whether a load has moved a body further than all bodies are long, off any other; collective.

    Which these are is noted in the attempt.
    """
    if not attempt.loads.any():
        return False
    bodies = attempt.bodies
    moved = bodies.moved(attempt.trial.array_r - attempt.x.array_r)
    far = moved * np.sign(attempt.loads) > bodies.size()
    if far.any():
        attempt.newton.residual_of(attempt.step)
        attempt.adrift = bodies.unpressed(far)
    return bool(attempt.adrift)


def linear_gaps(
    problem: Equilibrium, step: StepMode, start: PETSc.Vec, trial: PETSc.Vec
) -> list[Floats]:
    """Gaps (v,) or (q,), m, of each pair that a Newton step from ``start`` to ``trial`` expects.

    Those that it comes to over a curved tool differ by far more than the contact is deep: pressures
    from them are a hundred times too high, and turn with the tools in the next tangent. Those at
    ``trial`` are of the last evaluation. Collective.
    """
    near = trial.copy()
    near.axpy(-1.0, start)
    most = 2.0 * near.norm(PETSc.NormType.INFINITY)
    near.aypx(STRIDE, start)
    out = []
    for (term, mode), there in zip(step.pairs(problem.contacts), problem.trials, strict=True):
        before, ahead = (_gap(term.evaluate(x, step.dt, mode)) for x in (start, near))
        change = (ahead - before) / STRIDE
        # Where a point passes the end of a master there is no rate.
        out.append(np.where(np.abs(change) <= most, before + change, _gap(there)))
    near.destroy()
    return out


def followed(attempt: Attempt, opening: Opening) -> tuple[int, bool]:
    """Iterate on the central path; iterations, and whether the exact law should go on; collective.

    It begins with a barrier so low that the start is nearly on the path. The laws are smooth, and a
    step that gains little is the sign of a kink that has become too sharp: then the barrier waits.
    """
    newton, problem = attempt.newton, attempt.newton.problem
    found = starting_points(attempt, opening.barrier)
    points: Points = [None if at is None else at.central() for at in found]
    step = attempt.step.inside(points)
    attempt.return_to_start()
    started = 0
    if opening.linear and attempt.continued:
        started = attempt.predictor.restart(attempt.x, attempt.trial, attempt.step)
    exact, before, rubs_as_it_is = np.inf, np.inf, False
    limit = min(LIMIT_CENTRAL, newton.options.max_iterations)
    for iteration in range(started, limit):
        left = newton.residual_of(step)
        if not np.isfinite(left) or (left > EASED and iteration >= PATIENCE_CENTRAL):
            return iteration, False
        shrinks = 1.0
        if left < EASED and left <= GAINED * before:
            shrinks = SHRINKS_FAST if left < EASY else SHRINKS_FLOWING
        gaps = [_gap(trial) for trial in problem.trials]
        points = _advanced(problem, points, shrinks, opening.kept, gaps)
        step = attempt.step.inside(points)
        if left < NEARER**0.5:
            last, exact = exact, newton.residual_of(attempt.step)
            stays_off = ENDED * last < exact < CLOSE
            if exact < NEARER or (stays_off and rubs_as_it_is):
                return iteration, True
            if stays_off:  # the path's friction is another one: the law as it is takes its place
                rubs_as_it_is = True
                points = [at and replace(at, slip=None) for at in points]
                step = attempt.step.inside(points)
        before = newton.step_to_least_energy(step, TURNED * shortest_facet(problem), EASED)
    return limit, newton.residual_of(attempt.step) < NEAR


def shortest_facet(problem: Equilibrium) -> float:
    """Of the pairs' typical facets, m."""
    return min(term.surface.facet_length for term in problem.contacts)


def starting_points(attempt: Attempt, barrier: float) -> Points:
    """Pressures and slacks at the last converged state; None of ties and idle pairs; collective.

    Pressures from inside would push bodies away that float.
    """
    problem, step = attempt.newton.problem, attempt.step
    load = float(np.abs(attempt.loads).max(initial=0.0))
    way = problem.given_way(attempt.x)
    pairs = step.pairs(problem.contacts)
    trials = [(term, term.evaluate(attempt.x, step.dt, mode)) for term, mode in pairs]
    return [
        None
        if term.tied or not term.active or number in attempt.idle
        else _starting_point(term, trial, way, barrier, load)
        for number, (term, trial) in enumerate(trials)
    ]


def _starting_point(
    term: ContactTerm, trial: ContactTrial, way: float, barrier: float, load: float
) -> InteriorPoint:
    """Of one pair, with the way of what moves the bodies, m, or a load, N, on them; collective."""
    gap, penalty, facet = _gap(trial), term.penalty, term.surface.facet_length
    pressure = np.where(gap < 0.0, -penalty * gap, 0.0)
    stiffest = penalty.max(initial=0.0) * facet
    here = np.array([pressure @ pressure, pressure.sum()])
    least = float(np.min(gap, initial=NOWHERE))
    if trial.normal_contact.gap is None:  # each rank has points of its own
        comm = term.surface.vertices.comm
        here, stiffest = comm.allreduce(here), comm.allreduce(stiffest, op=MPI.MAX)
        least = comm.allreduce(least, op=MPI.MIN)
    modulus = UNKNOWN * stiffest if term.modulus is None else UNPRESSED * term.modulus
    mean = here[0] / here[1] if here[1] > 0.0 else 0.0
    ahead = float(np.clip(way, LEAST_WAY * facet, MOST_WAY * facet)) if way else NO_WAY * facet
    if mean <= PRESSED * term.rounded_gap * stiffest / facet:
        mean = modulus
    if load > 0.0 and least < NOWHERE and way <= LEAST_WAY * facet:  # forces alone drive
        ahead, barrier = max(least, 0.0) + max(barrier, NO_WAY) * facet, 1.0
        mean = load / _felt_area(term, np.maximum(gap, ahead) / ahead)
    mu = barrier * mean * ahead
    pressure = np.maximum(pressure, mu / np.maximum(gap, barrier * ahead))
    near = max(REACH * facet, 2.0 * least if least < NOWHERE else 0.0)
    found = InteriorPoint(pressure, mu / pressure, mu, near)
    return replace(found, slip=_starting_slip(term, trial, found, mean, barrier * ahead))


def _felt_area(term: ContactTerm, apart: Floats) -> float:
    """Area over the distances (v,) or (q,) of a pair, m² (m in the plane); collective."""
    near: Floats = np.divide(1.0, apart)
    if isinstance(term.rule, AveragedPressure):
        near = term.surface.vertices.at_points(near)
    return float(term.surface.vertices.comm.allreduce(float(term.surface.slave.weight @ near)))


def _starting_slip(
    term: ContactTerm, trial: ContactTrial, at: InteriorPoint, mean: float, way: float
) -> InteriorSlip | None:
    """Slips of one pair's points; None without friction."""
    typical = presliding_length(term.law, term.state.friction, np.full(len(trial.pressure), mean))
    if not typical.any():
        return None
    part = way / (MOST_WAY * term.surface.facet_length) * typical
    # Where a film carries all there is no threshold: any length will do, and nothing slips.
    threshold = np.maximum(_thresholds(term, at), np.where(typical > 0.0, part, way))
    elastic, barrier = trial.response.state.elastic_slip, way * typical
    length = np.linalg.norm(elastic, axis=1)
    shorter = np.minimum(length, threshold - np.minimum(part, 0.5 * threshold))
    slack = threshold * (1.0 - (shorter / threshold) ** 2)
    return InteriorSlip(
        elastic=(shorter / np.maximum(length, TINY))[:, None] * elastic,
        permanent=np.minimum(barrier / slack, MOST_SLIP * way),
        threshold=threshold,
        barrier=barrier,
    )


def _thresholds(term: ContactTerm, at: InteriorPoint) -> Floats:
    """Elastic slip (q,), m, at which points slip under the pressures of an interior point."""
    averaged = isinstance(term.rule, AveragedPressure)
    pressure = term.surface.vertices.at_points(at.pressure) if averaged else at.pressure
    return presliding_length(term.law, term.state.friction, pressure)


def _gap(trial: ContactTrial) -> Floats:
    """Gap (v,) or (q,), m, that the pressure follows from; large and finite without a master."""
    nodal = trial.normal_contact.gap
    if nodal is not None:
        return nodal
    return np.where(trial.projection.on_surface, trial.projection.gap, NOWHERE)


def _advanced(
    problem: Equilibrium,
    points: Points,
    shrinks: float,
    kept: float,
    gaps: Sequence[Floats],
) -> Points:
    """The points after the step evaluated last, with a barrier ``shrinks`` times as high.

    ``gaps``: m, of each pair after it, see :func:`linear_gaps`.
    """
    pairs = zip(problem.contacts, problem.trials, points, gaps, strict=True)
    return [
        None if at is None else _next(term, trial, at, shrinks, kept, gap, not problem.flows)
        for term, trial, at, gap in pairs
    ]


def _next(
    term: ContactTerm,
    trial: ContactTrial,
    at: InteriorPoint,
    shrinks: float,
    kept: float,
    gap: Floats,
    whole: bool,
) -> InteriorPoint:
    out = at.advanced(gap, term.penalty, shrinks * at.barrier, kept)
    if at.slip is None:
        return out
    moved = trial.kinematics.slip + trial.kinematics.elastic_slip
    threshold = presliding_length(term.law, term.state.friction, trial.pressure)
    slip = at.slip.advanced(moved, threshold, _thresholds(term, out), shrinks, whole)
    return replace(out, slip=slip)
