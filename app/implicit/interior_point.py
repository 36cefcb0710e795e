r"""A way into contact from inside: all pressures and slacks positive, and their products fall to 0.

With the slack s = g + p/K of each vertex (or point) the penalty's law p = K⟨−g⟩ reads p ≥ 0, s ≥ 0,
p s = 0. Newton's method on the law itself moves the border of a contact by about a facet in an
iteration where bodies resist by bending, so that iterations grow with the mesh, and no shorter step
helps. Here p and s are unknowns of their own, p s = μ, and μ falls from iteration to iteration
(primal-dual interior points: J. Nocedal, S. Wright, Numerical Optimization, 2006, chapters 14
and 19). For the bodies an iteration is one of Newton's with a linear law at each vertex
(:class:`tribox.forms.contact.state.InteriorPoint`): no kink in it, and a tangent that is never
singular where bodies are held by contact alone.

The pressures begin as those of the last state, and μ as a small part of the energy that the contact
may take up in the step: a pressure times the way of what moves. What is found is a start for the
exact law, by which the step is solved in the end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.implicit.attempt import Attempt
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial, InteriorPoint
from tribox.geometry.surfaces.facets import Floats

# μ over mean pressure and way, one after the other: more finds contacts that change much, less
# leaves alone what friction holds.
BARRIERS = (1e-2, 1e-4)
SHRINKS = 0.03  # μ from an iteration to the next
UNPRESSED = 1e-4  # pressure over E*, of a pair that pressed nowhere
UNKNOWN = 1e-6  # the same over penalty times facet length, where E* is not known
MOST_WAY, LEAST_WAY, NO_WAY = 0.3, 1e-6, 0.01  # in facets: bounds of the way, and without any
REACH = 3.0  # gap in facets, and in least gaps less one, up to which vertices feel each other
SETTLED = 1.0  # relative residual above which the bodies move before pressures change
SOLVED = 0.3  # relative residual below which μ falls
NEAR = 1e-3  # relative residual of the exact law that is near enough for Newton's method on it
NOWHERE = 1e6  # m; gap of points that have no master below them
LIMIT = 16  # iterations for one start of μ

Points = list[InteriorPoint | None]


@dataclass(frozen=True, slots=True)
class FromInside:
    """Interior points first, and from what they find Newton's method on the exact law."""

    def run(self, attempt: Attempt) -> tuple[int, int]:
        """See :class:`tribox.app.implicit.attempt.Phase`."""
        iterations, reason = 0, int(PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH)
        for barrier in BARRIERS:
            attempt.trial.array[:] = attempt.x.array_r
            attempt.newton.begin(attempt.x)
            more, found = approached(attempt, barrier)
            iterations += more
            if found:
                more, reason = attempt.newton.solve(attempt.step)
                iterations += more
                if more == 0:  # the tangent that is kept belongs to the exact law
                    attempt.newton.solver.assemble(attempt.trial, attempt.step)
            if reason > 0:
                break
        return iterations, reason


def approached(attempt: Attempt, barrier: float) -> tuple[int, bool]:
    """Iterate on interior points; iterations, and whether the exact law is near; collective.

    Args:
        attempt: its trial holds the last converged state, and in the end what was found.
        barrier: μ over mean pressure and way.
    """
    newton, problem, trial = attempt.newton, attempt.newton.problem, attempt.trial
    points = starting_points(attempt, barrier)
    step = attempt.step.inside(points)
    iterations = attempt.predictor.restart(attempt.x, trial, step)
    while iterations < LIMIT:
        left = newton.residual_of(step)
        if not np.isfinite(left):
            return iterations, False
        settled = left < SETTLED
        if settled:
            points = _advanced(problem, points, SHRINKS if left < SOLVED else 1.0)
            if left < NEAR**0.5 and newton.residual_of(attempt.step) < NEAR:
                return iterations, True
            step = attempt.step.inside(points)
        newton.step(step, falling=not settled and iterations > 1)
        iterations += 1
    return iterations, newton.residual_of(attempt.step) < NEAR


def starting_points(attempt: Attempt, barrier: float) -> Points:
    """Pressures and slacks at the last converged state; None of ties and idle pairs; collective."""
    problem, step = attempt.newton.problem, attempt.step
    given = np.abs(problem.constrained_values(attempt.x) - attempt.x.array_r)
    way = problem.comm.allreduce(float(given.max(initial=0.0)), op=MPI.MAX)
    pairs = step.pairs(problem.contacts)
    trials = [(term, term.evaluate(attempt.x, step.dt, mode)) for term, mode in pairs]
    return [
        None if term.tied or not term.active else _starting_point(term, trial, way, barrier)
        for term, trial in trials
    ]


def _starting_point(
    term: ContactTerm, trial: ContactTrial, way: float, barrier: float
) -> InteriorPoint:
    """Of one pair, with the way of what moves the bodies, m; collective."""
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
    mean = max(here[0] / here[1] if here[1] > 0.0 else 0.0, modulus)
    ahead = float(np.clip(way, LEAST_WAY * facet, MOST_WAY * facet)) if way else NO_WAY * facet
    mu = barrier * mean * ahead
    open_ = mu / np.maximum(gap, np.finfo(float).tiny)
    pressure = np.maximum(pressure, np.minimum(open_, mean))
    near = max(REACH * facet, 2.0 * least if least < NOWHERE else 0.0)
    return InteriorPoint(pressure, mu / pressure, mu, near)


def _gap(trial: ContactTrial) -> Floats:
    """Gap (v,) or (q,), m, that the pressure follows from; large and finite without a master."""
    nodal = trial.normal_contact.gap
    if nodal is not None:
        return nodal
    return np.where(trial.projection.on_surface, trial.projection.gap, NOWHERE)


def _advanced(problem: Equilibrium, points: Points, shrinks: float) -> Points:
    """The points after the step evaluated last, with a barrier ``shrinks`` times as high."""
    pairs = zip(problem.contacts, problem.trials, points, strict=True)
    return [
        at if at is None else at.advanced(_gap(trial), term.penalty, shrinks * at.barrier)
        for term, trial, at in pairs
    ]
