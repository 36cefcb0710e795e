"""Why a step has no solution: what is wrong where, and what to try."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.build.contacts import notes_on_penalty
from tribox.app.case.boundary import COMPONENTS
from tribox.app.case.contact import DEFAULT_PENALTY_FACTOR, Contact
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.step_mode import StepMode
from tribox.app.equilibrium.supports import Loose
from tribox.app.equilibrium.unknowns import place_text
from tribox.app.implicit.linear_solver import LinearSolver
from tribox.app.implicit.newton import KINKED
from tribox.app.implicit.stepper import ROUND, StepResult
from tribox.app.simulation import pair_bodies
from tribox.app.simulation.contact_resultants import ContactResultants
from tribox.app.simulation.surface_ends import reaches_end, slid_off
from tribox.app.simulation.surface_faults import SOFTER, Findings, catches, rests_on_edges
from tribox.forms.bodies.deformation import volume_ratios
from tribox.forms.bodies.materials import contact_shear_modulus, oedometric_modulus
from tribox.forms.bodies.solid import Solid
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.stribeck import StribeckLaw
from tribox.geometry.surfaces.facets import Floats

GAUSS_DEGREE = 2  # of the points at which the volume ratio is looked at
SQUEEZED = 0.2  # volume ratio J below which an element is said to be nearly collapsed
FAR_MORE = 0.5  # and below which share of that around it
FOAM = 3.0  # K + 4G/3 over G of nu = 1/4, below which a body is a foam
SUPPORT = "a support there (displacement), or a load that keeps it in contact"
ADRIFT = 1e-6  # share of the largest displacement by which a body moves that nothing holds
AT_LIMIT = 0.9  # friction or load over mu N from which on a body slides away
AT_NOISE = 2.0  # residual over what rounding leaves up to which nothing else need be sought
FIRM = 10.0  # penalty over the default from which on a lower one is worth a try
DEFAULT_PENALTY = f"the default penalty (penalty_factor = {DEFAULT_PENALTY_FACTOR:g})"
GLIDES = 10.0  # of all normal forces over those in a direction, from which on it is along contacts
ALONG = 0.5  # component of the friction over all of it that a body's loose direction must have

INVERSE = 16  # iterations for the eigenvalues next to zero
CLEAR = 0.1  # what their inverses may be off by, as a share
NONE_LEFT = 1e-12  # share of a vector that rounding leaves
DYNAMICS = (
    'a stage of dynamics from a little before on ([solver] kind = "explicit" with solver = '
    '"implicit" in the stages before; bodies need a density)'
)
SNAP = (
    "the tangent has a negative eigenvalue: the bodies have passed a limit, as a shell does that "
    "snaps through, and the next equilibrium may be far away",
    f"to let them snap in {DYNAMICS}, or to prescribe a displacement where a force drives",
)

LONGER = (
    "longer steps (slip_step), or a first velocity at which asperities carry nearly all, a tenth "
    "of this one or less"
)
SLOWER = "longer steps (slip_step), or a first velocity far below V_s"
ALL_OF_IT = 0.95  # share of the load beyond which a film's friction rises with the speed

# PETSc's numbers for why Newton's method ended without a solution.
REASONS = {
    -3: "singular tangent",
    -4: "an element is inverted, or the numbers overflow",
    -5: "iterations used up",
    -6: "no decrease along the search direction",
}


def reason_of(result: StepResult) -> str:
    """Why an attempt failed, in words."""
    if result.floating:
        bodies = " and ".join(result.floating)
        return f"no support and no contact holds body {bodies} any more, and something moves it"
    if result.too_long:
        return "points slow down through V* and are driven on in it"
    if result.spun:
        tools = " and ".join(result.spun)
        return f"tool {tools} turns by more than {ROUND:g} rad, up to which slip is known"
    if result.unbalanced:
        pairs = " and ".join(f"contact.{index}" for index in result.unbalanced)
        return f"the mass balance of the film of {pairs} has no solution that is found"
    if result.reason > 0:  # solved, but by a state without a strain energy
        return "an element is turned inside out"
    return REASONS.get(result.reason, f"reason {result.reason}")


# -- stability -------------------------------------------------------------------------------------


def is_unstable(solver: LinearSolver, x: PETSc.Vec, step: StepMode) -> bool:
    """Whether the tangent has a negative eigenvalue at ``x`` (m), so far as is seen; collective.

    By Arnoldi's iteration with the inverse, from the residual, which finds those next to zero:
    below it the bodies have passed a limit and snap.
    """
    problem = solver.problem
    if not np.isfinite(x.norm()):
        return False
    basis, held = [problem.new_vector()], problem.constrained_dofs()
    problem.residual(None, x, basis[0], step)
    size = basis[0].norm()
    if not np.isfinite(size) or size == 0.0:
        return False
    solver.assemble(x, step)
    basis[0].scale(1.0 / size)
    table: Floats = np.zeros((INVERSE + 1, INVERSE))
    for column in range(INVERSE):
        w = problem.new_vector()
        if not solver.solve(basis[-1], w):
            return False
        w.array[held] = 0.0  # rows of their own: noise would grow there
        for row, v in enumerate(basis):
            table[row, column] = w.dot(v)
            w.axpy(-table[row, column], v)
        table[column + 1, column] = size = w.norm()
        if size <= NONE_LEFT * np.abs(table[:, column]).max():
            table = table[: column + 2, : column + 1]
            break
        w.scale(1.0 / size)
        basis.append(w)
    inverse, vectors = np.linalg.eig(table[:-1])
    unsure = table[-1, -1] * np.abs(vectors[-1])
    below = (inverse.real < 0.0) & (np.abs(inverse.imag) <= unsure)
    return bool(np.any(below & (unsure < CLEAR * np.abs(inverse))))


# -- what holds the bodies ------------------------------------------------------------------------


def body_adrift(
    problem: Equilibrium, loose: Iterable[Loose], before: Floats, now: Floats
) -> str | None:
    """The message about a body that moved, from ``before``, with nothing to hold it; or None.

    In a direction in which no contact presses, it moves to wherever the linear solver found a
    place; collective.
    """
    largest = problem.comm.allreduce(float(np.max(np.abs(now), initial=0.0)), op=MPI.MAX)
    for one in loose:
        dofs = one.nodes * problem.dim + one.component
        local = np.array([float(np.sum(now[dofs] - before[dofs])), float(len(dofs))])
        moved, count = problem.comm.allreduce(local)
        if abs(moved) > ADRIFT * largest * count:
            return (
                f"{one.text} and no contact presses on it: it moved by {moved / count:.3g} m, to a "
                f"place that is as good as any other; try {SUPPORT}"
            )
    return None


# -- numbers that are not finite -------------------------------------------------------------------


def not_finite(resultants: Iterable[ContactResultants]) -> str | None:
    """The first number of a step's contacts that is not finite, by its name; None if all are."""
    for index, pair in enumerate(resultants):
        for field in fields(pair):
            value = getattr(pair, field.name)
            # Without any contact point there is no least dissipation, and no place for it.
            empty = field.name in ("least_dissipation", "worst") and not pair.worst
            if not empty and not np.all(np.isfinite(value)):
                return f"contact.{index}: {field.name} = {value}"
    return None


# -- places ---------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Squeezed:
    """The element with the least volume ratio, of those that have collapsed if there are any."""

    ratio: float  # least J = det F at its points
    body: str  # the body's name
    place: tuple[float, ...]  # (i,), m, middle of the element, undeformed
    collapsed: bool  # squeezed to next to nothing, and far more than what is around it
    foam: bool = False  # whether the body bears that, as it gives way in volume

    @property
    def text(self) -> str:
        """The element, in words."""
        return f"an element of body {self.body} at {place_text(self.place)}, undeformed,"


def most_squeezed(problem: Equilibrium) -> Squeezed:
    """Least J = det F at any Gauss point, at the displacement evaluated last; collective.

    An element has collapsed where J is below a fifth, and below half of its mean over the elements
    around: a foam that is pressed flat has not. Elements of foams come last.
    """
    ratios = [volume_ratios(problem.u, s.section, s.cells, GAUSS_DEGREE) for s in problem.solids]
    ratios = [np.where(np.isfinite(ratio), ratio, -np.inf) for ratio in ratios]
    least = min((float(ratio.min(initial=np.inf)) for ratio in ratios), default=np.inf)
    low = problem.comm.allreduce(least, op=MPI.MIN) < SQUEEZED
    around = _around(problem, ratios) if low else ratios
    mesh, found = problem.space.mesh, []
    for solid, ratio, beside in zip(problem.solids, ratios, around, strict=True):
        if not len(solid.cells):
            continue
        inner = ratio.min(axis=1)
        gone = low & (inner < SQUEEZED) & (inner < FAR_MORE * beside.mean(axis=1))
        at = int(np.argmin(np.where(gone, inner, inner.max() + 1.0) if gone.any() else inner))
        middle = dolfinx.mesh.compute_midpoints(mesh, problem.dim, solid.cells[at : at + 1])[0]
        place = tuple(map(float, middle[: problem.dim]))
        found.append((not gone[at], _is_foam(solid), float(inner[at]), solid.name, place))
    every = [one for ranks in problem.comm.allgather(found) for one in ranks]
    sound, foam, ratio_there, body, place = min(every)
    return Squeezed(ratio_there, body, place, not sound, foam)


def _is_foam(solid: Solid) -> bool:
    """Whether a body gives way in volume like a foam: nu below 1/4."""
    stiff = oedometric_modulus(solid.material)
    return bool(stiff < FOAM * contact_shear_modulus(solid.material))


def _around(problem: Equilibrium, ratios: Sequence[Floats]) -> list[Floats]:
    """Means (c, 1) of J over the elements around each, of all bodies; collective."""
    index, nodes = problem.space.dofmap.index_map, problem.space.dofmap.list
    sums = dolfinx.la.vector(index, 2)
    for solid, ratio in zip(problem.solids, ratios, strict=True):
        mean = np.maximum(ratio.mean(axis=1), 0.0)
        pair = np.stack([mean, np.ones_like(mean)], axis=1)
        np.add.at(sums.array.reshape(-1, 2), nodes[solid.cells], pair[:, None])
    sums.scatter_reverse(dolfinx.la.InsertMode.add)
    sums.scatter_forward()
    total = sums.array.reshape(-1, 2)
    nodal = total[:, 0] / np.maximum(total[:, 1], 1.0)
    return [nodal[nodes[solid.cells]].mean(axis=1, keepdims=True) for solid in problem.solids]


def has_collapsed(problem: Equilibrium, x: PETSc.Vec) -> bool:
    """Whether an element is squeezed to next to nothing at ``x`` (m); collective.

    Those of a foam may be, at folds beside its contacts, and shorter steps go on from there. Its
    displacements are those spread last afterwards.
    """
    problem.spread(x)
    worst = most_squeezed(problem)
    return worst.collapsed and not worst.foam


# -- all together ---------------------------------------------------------------------------------


def explain(
    problem: Equilibrium,
    result: StepResult,
    converged: PETSc.Vec,
    loose: Iterable[Loose],
    thickness: float = 1.0,
    contacts: Sequence[Contact] = (),
    unstable: Callable[[], bool] = lambda: False,
    spent: Callable[[], bool] = lambda: False,
    look_ahead: Callable[[], None] = lambda: None,
) -> str:
    """Why a step failed, what is wrong at the state evaluated last, and what to try; collective.

    What explains the most stands first: where a body slides away for good, or a penalty is far
    off, the state evaluated last says nothing of supports and ends.

    Args:
        thickness: m, of a plane-strain slab, that forces are for; 1 otherwise.
        spent: whether forces drive the step beyond the largest that the bodies bear.
        look_ahead: evaluates where what is prescribed leads. Where the state evaluated last shows
            nothing, the iteration has turned back from it.
    """
    left = [f"residual {size:.1e} of the contact force " for size in result.residuals[-1:]]
    text = (
        f"{reason_of(result)}, {''.join(left)}after {result.iterations} iterations, largest at "
        f"{place_text(problem.worst_place())}, undeformed"
    )
    loose = list(loose)
    adrift = any(_of_supports(problem, loose, result.strayed))  # its rounding explains nothing
    gross = list(_of_pull(problem, loose, result, thickness))
    gross = gross or ([] if adrift else list(_of_rounding(problem, result)))
    gross = gross or list(_of_gross_slip(problem, loose, thickness))
    gross = gross or list(_of_limit_load(problem, thickness) if spent() else ())
    findings = gross or list(_of_state(problem, result, converged, loose, contacts))
    if not findings:
        look_ahead()
        findings = list(slid_off(problem, contacts)) or list(_of_gliding(problem, loose))
    if not any(found for found, _ in findings) and unstable():
        findings = [SNAP]
    most = result.effort.most
    if most and not result.effort.turned:
        direct = 'solver.linear = "direct", if memory allows'
        findings = [(f"linear solves took up to {most} iterations", direct), *findings]
    trials = list(dict.fromkeys(what for _, what in findings))
    if not gross and not {LONGER, SLOWER}.intersection(trials):
        trials.append("smaller steps (steps, slip_step) or a finer mesh")
        if problem.contacts and not findings:
            trials += [SOFTER, *_far_slides(problem), f"where bodies may have snapped, {DYNAMICS}"]
    problem.spread(converged)
    return "; ".join([text, *(found for found, _ in findings), "try " + ", or ".join(trials)])


def _of_state(
    problem: Equilibrium,
    result: StepResult,
    converged: PETSc.Vec,
    loose: Sequence[Loose],
    contacts: Sequence[Contact],
) -> Findings:
    """What is wrong at the state evaluated last, the surest cure first."""
    penalties = [
        (note, DEFAULT_PENALTY)
        for index, term in enumerate(problem.contacts)
        if not isinstance(term, LubricatedTerm)  # whose asperities take its place
        for note in notes_on_penalty(
            index, pair_bodies.penalty_factor(problem, term), pair_bodies.pressure_kind(term)
        )
    ]
    nearly = bool(result.residuals) and result.residuals[-1] <= KINKED
    edges = list(rests_on_edges(problem, contacts)) if nearly else []
    caught = [] if edges else list(catches(problem, contacts))
    supports = [] if penalties else list(_of_supports(problem, loose, result.strayed))
    ends = list(slid_off(problem, contacts))
    reached = [] if ends else list(reaches_end(problem, contacts))
    found = [*penalties, *supports, *ends, *_of_elements(problem, converged), *edges]
    found = found or list(_of_firm_penalties(problem)) or caught or list(_of_films(problem))
    yield from found or _of_weakening(problem)
    yield from reached


def _of_pull(
    problem: Equilibrium, loose: Iterable[Loose], result: StepResult, thickness: float
) -> Findings:
    """Loads that move bodies away from all that they could touch, or along it."""
    adrift = [one for one in loose if result.adrift and one.body in result.floating]
    loads = [(one, pair_bodies.load_on(problem, one)) for one in adrift if not one.turns]
    pressing = [
        load * pair_bodies.facing(problem, one.bodies)[one.component] < 0.0 for one, load in loads
    ]
    held = {one.body for (one, _), pressed in zip(loads, pressing, strict=True) if pressed}
    for (one, load), pressed in zip(loads, pressing, strict=True):
        force = f"{load * thickness:.4g} N in {one.direction}"
        if pressed or abs(load) <= problem.roundoff:
            continue
        if one.body in held:
            yield (
                f"{one.text}, and a load of {force} drives it along what it is pressed on, where "
                "friction bears no more than mu N",
                f"a prescribed displacement in {one.direction} instead of the force, or a smaller "
                "force, or more normal force or friction",
            )
        else:
            yield (
                f"{one.text}, no contact presses on it, and a load of {force} moves it away",
                SUPPORT,
            )


def _of_gross_slip(problem: Equilibrium, loose: Iterable[Loose], thickness: float) -> Findings:
    """Friction at its limit under a force along the surface: nothing balances a larger one."""
    for one in loose:
        hold, load = (
            pair_bodies.hold_of(problem, one.bodies, problem.committed),
            pair_bodies.load_on(problem, one),
        )
        arm, rim = _arms(problem, one)
        pushes = abs(load) * arm / rim if one.turns else load
        if not _slides_away(one, hold, pushes) or pair_bodies.has_spring(problem, one):
            continue
        if hold.wet and any(mode.rate_dependent for mode in problem.evaluated.modes):
            continue  # a film holds any force, at some speed
        size, force = abs(load) * thickness, float(np.linalg.norm(hold.friction))
        if one.turns:
            drives, instead = (
                f"moment of {arm * size:.4g} N m turns",
                "an angle instead of the moment",
            )
        else:
            axis = COMPONENTS[one.component]
            drives = f"force of {size:.4g} N in {axis} drives"
            instead = (
                f"a prescribed displacement in {axis} instead of the force, or a spring that holds "
                f'it ([[boundary]] spring with direction = "{axis}")'
            )
        rates = ", or rate_dependent = true: a film holds any force, at some speed"
        yield (
            " and ".join(f"contact.{index}" for index in hold.contacts)
            + f": no equilibrium: T has reached mu N everywhere: a {drives} {one.name} now, and "
            f"friction, which alone holds it there, was {force * thickness:.4g} N of mu N = "
            f"{hold.limit * thickness:.4g} N at the last solved step",
            f"{instead}, or less of it, or more normal force or friction"
            + (rates if hold.wet else ""),
        )


def _of_gliding(problem: Equilibrium, loose: Iterable[Loose]) -> Findings:
    """Bodies along which nothing acts: pressed off the middle they slide away and turn."""
    for one in (one for one in loose if not (one.turns or pair_bodies.has_spring(problem, one))):
        hold = pair_bodies.hold_of(problem, one.bodies, problem.committed)
        if hold.limit or hold.wet:
            continue
        if hold.across.sum() > GLIDES * hold.across[one.component]:
            yield (
                f"{one.text}, and contacts without friction press on it: off their middle, or "
                "where it tilts, it slides away, and no state is at rest",
                f"{SUPPORT}, or friction, or symmetry",
            )


def _far_slides(problem: Equilibrium) -> Iterator[str]:
    """What to try for bodies that a little more load moves far, as a ring in its groove."""
    for solid in problem.solids:
        hold = pair_bodies.hold_of(problem, [solid.name], problem.committed)
        if float(np.linalg.norm(hold.friction)) > AT_LIMIT * hold.limit > 0.0:
            yield f"longer steps where a load slides {solid.name} along, up to what stops it"


def _of_limit_load(problem: Equilibrium, thickness: float) -> Findings:
    """The largest load that the bodies bear, which has been reached."""
    forces = [f"{abs(p.force) * thickness:.4g} N on a platen" for p in problem.platens if p.force]
    for tool in problem.tools:
        pushed = np.zeros(problem.owned)
        for load in problem.nodal_loads:
            load.add_to(pushed)
        force = float(np.linalg.norm(tool.at(pushed, problem.comm)[:-1]))
        forces += [f"{force * thickness:.4g} N on tool {tool.name}"] if force else []
    yield (
        "no equilibrium beyond the load reached"
        + (f" ({', '.join(forces)})" if forces else "")
        + ": it is the largest that the bodies bear, to within the last step, as their "
        "displacements grow without end before it",
        "a displacement in the place of the force (displacement of the tool or boundary, "
        f"displacement_stages of a platen), past which the force falls, or {DYNAMICS}",
    )


def _of_rounding(problem: Equilibrium, result: StepResult) -> Findings:
    """A residual that rounding may have left, by itself."""
    force, rounding = problem.reference_force, problem.rounding
    squares = np.sum(rounding.squares(), axis=0)
    noise = float(np.sqrt(squares.sum()))
    near = bool(result.residuals) and result.residuals[-1] <= KINKED and result.reason < 0
    if near and result.residuals[-1] * force <= AT_NOISE * noise:
        yield (
            f"rounding in body {rounding.names[int(squares.argmax())]} alone leaves a residual of "
            f"up to {noise / force:.1e} here",
            "a larger solver.tolerance, or a lower modulus beside the stresses of the body",
        )


def _slides_away(one: Loose, hold: pair_bodies.Hold, load: float) -> bool:
    """Whether a load drives a body along its contacts, and all of their friction is used up."""
    friction = np.linalg.norm(hold.friction)
    along = abs(float(hold.friction[one.component]))
    across = abs(float(hold.pressure[one.component]))
    pushed = one.turns or (along > across and along > ALONG * friction)
    used = max(float(friction), abs(load))
    return bool(pushed and load != 0.0 and hold.limit > 0.0 and used > AT_LIMIT * hold.limit)


def _arms(problem: Equilibrium, one: Loose) -> tuple[float, float]:
    """Arm, m, of the force on a tool's angle that stands for a moment, and reach of its surface."""
    tools = [tool for tool in problem.tools if one.turns and tool.name == one.body]
    return next(((tool.motion.length, tool.reach) for tool in tools), (1.0, 1.0))


def _of_supports(problem: Equilibrium, loose: Iterable[Loose], strayed: bool) -> Findings:
    """Bodies that nothing holds; or that a load drives into a contact which does not take it up."""
    tried, before = (
        problem.comm.allreduce(any(np.any(t.pressure > 0.0) for t in trials), op=MPI.LOR)
        for trials in (problem.trials, problem.committed)
    )
    if tried and before and not strayed:
        return
    pairs = range(len(problem.contacts))
    for one in loose:
        driven = [i for i in pairs if pair_bodies.presses(problem, one, i)]
        if driven:
            yield (
                f"the load on {one.name} presses it on contact.{driven[0]}, and no state was "
                "found in which the contact takes it up",
                "to bring the bodies together by displacement first, or a smaller first load, or a "
                "softer penalty (penalty_factor)",
            )
        # Asked on all ranks alike, of each contact that it has reached and no load pulls it off.
        elif problem.committed or not any([pair_bodies.may_hold(problem, one, i) for i in pairs]):
            yield f"{one.text} and no contact presses on it", SUPPORT
        elif strayed or not tried:
            yield (
                f"{one.text}, and no step has been solved yet in which a contact holds it there",
                SUPPORT,
            )


def _of_elements(problem: Equilibrium, converged: PETSc.Vec) -> Findings:
    tried = most_squeezed(problem)
    problem.spread(converged)
    before = most_squeezed(problem)
    cure = "less load, a rounder corner or another mesh there"
    if before.collapsed:
        yield f"{before.text} has nearly collapsed (volume ratio {before.ratio:.2g})", cure
    elif tried.ratio <= 0.0:
        yield f"{tried.text} is turned inside out by the last iteration", cure


def _of_firm_penalties(problem: Equilibrium) -> Findings:
    """Penalties that are not far off, but worth lowering where nothing else is found."""
    for index, term in enumerate(problem.contacts):
        times = pair_bodies.penalty_factor(problem, term) / DEFAULT_PENALTY_FACTOR
        if times > FIRM and not isinstance(term, LubricatedTerm):
            yield (
                f"contact.{index}: the penalty is {times:.2g} times the default, and Newton's "
                "method needs more iterations the larger it is",
                DEFAULT_PENALTY,
            )


def _of_films(problem: Equilibrium) -> Findings:
    """Films that are found and take the load over: friction falls as surfaces slip faster."""
    pairs = zip(problem.committed, problem.trials, strict=False)  # none before the first step
    for index, (last, now) in enumerate(pairs):
        film, tried = last.normal_contact.lubrication, now.normal_contact.lubrication
        moves = tried is not None and tried.step is not None and bool(np.any(tried.step.speed))
        if film is not None and moves and film.share < ALL_OF_IT:
            yield (
                f"contact.{index}: the film, which carried {100.0 * film.share:.2g} % of the load "
                "at the last solved step, takes more of it over as the surfaces slip faster: what "
                "sticks is torn loose, and a shorter step makes that worse",
                LONGER,
            )


def _of_weakening(problem: Equilibrium) -> Findings:
    """Friction that falls with the speed, or with the way that was slipped."""
    for index, (term, trial) in enumerate(zip(problem.contacts, problem.trials, strict=False)):
        if isinstance(term.law, StribeckLaw) and np.any(trial.response.state.speed):
            values = term.law.parameters
            if values.mu_d < values.mu_s:
                yield (
                    f"contact.{index}: friction falls from mu_s to mu_d as the surfaces slip "
                    "faster: what sticks is torn loose, and a shorter step makes that worse",
                    SLOWER,
                )
        if isinstance(term.law, FrictionMap) and not term.law.parameters.friction.constant:
            yield f"contact.{index}: friction falls with the slip and may snap", "a lower B"
