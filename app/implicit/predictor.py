"""Where the Newton iteration of a step starts.

Where the loads continue in proportion, the path of the last converged states is continued by the
polynomial that leaves the least residual, and corrected once with the tangent factorised last
(a substitution, no factorisation). Where they do not, or where the path leads nowhere, one solve
with the tangent at the last state carries the new prescribed displacements into the bodies; where
that leaves much, a second one, without contacts that it opened altogether, lets bodies part, or
without the stiffness of friction slide, and one without plastic flow lets those that flowed spring
back. Metal that rubs on tools at rest is also
tried where its steady flow takes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Protocol

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Nodal, Snapshot, scattered
from tribox.app.equilibrium.step_mode import DEFAULT_STEP, StepMode
from tribox.app.implicit.linear_solver import LinearSolver
from tribox.app.implicit.loose_bodies import LooseBodies
from tribox.app.implicit.newton import Newton
from tribox.app.implicit.steady_flow import steady_flows
from tribox.forms.contact.state import ContactTrial
from tribox.forms.friction.law import Regime
from tribox.geometry.surfaces.facets import Bools, Floats, Ints

HIGHEST_ORDER = 3  # of the polynomial through the last states
CORRECTIONS = 3  # with the tangent factorised last, from the last state itself
FAR_OFF = 0.5  # residual, relative to the contact or reaction force, of a start that is no good
FAR_AT_NODES = 2.0  # likewise, over the norm of the contacts' forces at nodes, under a platen
ASTRAY = 2.0  # the same over the force of the last state, of a path that contacts may rub on
NO_WAY = 1e-9  # of two increments' product, over the larger one's square, that is none
STATES = 4  # of a path to a limit: past a kink two slopes in a row are equal, or were before it
FALLS = 0.9  # most that is left of a slope from one of the states to the next
FURTHER = 2.0  # of the last attempt's length: the one before it was as long, and failed too
PULLING = 0.2  # gap, in facets, up to which contacts pull where a start on a smooth path is judged
SMOOTH = 0.7  # residual there that a curved path may leave, over that of a straight one
WORTHWHILE = 0.5  # share of the residual that a correction must leave at most to be kept


@dataclass(frozen=True, slots=True)
class Drive:
    """What pushes a step forward."""

    dofs: Ints  # owned unknowns with a prescribed displacement
    constrained: Floats  # their increments, m
    loads: Floats  # increments of the platens' forces and the loads
    total: Floats  # their values


def falls(slope: Floats) -> bool:
    """Whether slopes (k,) of a path fall from state to state, as on the way to a limit."""
    return bool(np.all(slope > 0.0) and np.all(slope[1:] <= FALLS * slope[:-1]))


class Predictor:
    """Remembers the converged states of a path and continues it."""

    def __init__(self, problem: Equilibrium, solver: LinearSolver) -> None:
        """Begin without a path; collective."""
        self.problem = problem
        self.solver = solver
        self._drive: Drive | None = None
        self._loads: Floats = np.empty(0)
        self._force = 0.0  # N (N/m), that residuals were compared with at the last state
        # Converged states along the path: (parameter, owned unknowns), the latest last.
        self._path: list[tuple[float, Floats]] = []
        self._residual = problem.new_vector()
        self._kept = problem.new_vector()
        self._increment = problem.new_vector()
        self._flows = steady_flows(problem)

    def predict(
        self, x: PETSc.Vec, trial: PETSc.Vec, step: StepMode = DEFAULT_STEP, only_near: bool = False
    ) -> int:
        """Put a start into ``trial`` for the step from ``x``; collective.

        The path is not continued where contacts forget it, or where it leads far from a solution;
        by less where only a near start is of use. Returns the number of factorisations it took.
        """
        x.copy(trial)
        drive = self._driving(x)
        ratio = self._proportion(drive)
        if ratio is None:
            self._carry(x, drive.constrained, trial, step)
            rubs, pushed = self.rubbing(), (x, drive.constrained, trial, step)
            solved = 1 + (self._lift(*pushed) or (self._slide(*pushed) if rubs else 0))
            if self._goes_on(drive):
                return solved
            return solved + self._unload(x, drive.constrained, trial, step)
        if any(term.forgets for term in self.problem.contacts):
            trial.array[:] = self.problem.constrained_values(trial)
        elif ratio > 0.0 and len(self._path) > 1:
            self._continue(x, trial, ratio, step)
            if self._is_torn_off(trial, step, only_near):
                if self._slides_on(trial, ratio, step):
                    return 0
                x.copy(trial)
                self._carry(x, drive.constrained, trial, step)
                return 1
        return 0

    def _is_torn_off(self, trial: PETSc.Vec, step: StepMode, only_near: bool) -> bool:
        """Whether the path leads far from a solution; collective.

        Contacts that grow under load are closed by far less than the path moves them, so that its
        continuation opens many of them, or presses others by many times the force of the solution:
        what is left is therefore compared with the force of the last one too. The linear step holds
        them together; that its residual is as large says little, for it is the volume's, not the
        contact's. Where contacts slide, the path is the better guide unless it is so far off, and
        where metal flows even then.
        """
        left = self._residual_norm(trial, step)
        rubs, force = self.rubbing(), max(self._force, self.problem.roundoff)
        astray = not (left <= ASTRAY * force or self.problem.flows or only_near)
        return astray or not (rubs or left <= FAR_OFF * self.problem.reference_force)

    def _slides_on(self, trial: PETSc.Vec, ratio: float, step: StepMode) -> bool:
        """Put a smooth path of bodies that slide into ``trial``; whether it is one; collective.

        Along a curved master a straight path opens all contacts, and all but their pressures is
        balanced: such a start leaves less than one that follows the curve but for a little. Which
        of them is near is seen where the contacts pull as well.
        """
        if not self._is_lifted():
            return False
        pulling = step.with_penalty_scale(self.problem.contacts, 1.0, PULLING)
        straight = self._extrapolate(trial, ratio, pulling, highest=1)
        return self._extrapolate(trial, ratio, pulling) <= SMOOTH * straight

    def _continue(self, x: PETSc.Vec, trial: PETSc.Vec, ratio: float, step: StepMode) -> None:
        """Put the better of two starts into ``trial``, which holds the last converged state ``x``.

        Past a kink of the path (the last points stop sticking, say) the extrapolation is no help,
        while the tangent factorised last, of the new branch, knows where to go from ``x`` itself.
        But metal that rolls draw along would be left behind there, with little force: all slips,
        and nothing tells how far it is to go.
        """
        extrapolated = self._flow_on(trial, ratio, step, self._extrapolate(trial, ratio, step))
        norm = self._correct(trial, extrapolated, 1, step)
        if norm <= WORTHWHILE * extrapolated:
            return
        best, drawn = trial.array_r.copy(), self.problem.flows and self.rubbing()
        x.copy(trial)
        trial.array[:] = self.problem.constrained_values(trial)
        untouched = self._residual_norm(trial, step)
        if drawn and self._all_slip(self.problem.trials):
            trial.array[:] = best
            return
        self._keep_residual()
        if not self._correct(trial, untouched, CORRECTIONS, step) < norm:
            trial.array[:] = best

    def _lift(self, x: PETSc.Vec, constrained: Floats, trial: PETSc.Vec, step: StepMode) -> int:
        """Put the step without the pairs that it opens altogether into ``trial``, see :meth:`_try`.

        The tangent at ``x`` holds together what touches there: a body that is lifted off would be
        stretched by all of the way.
        """
        held, left = self._closed_pairs(), self._residual_norm(trial, step)
        gone = held & ~self._closed_pairs()
        if not gone.any() or left <= FAR_OFF * self.problem.reference_force:
            return 0
        without = step.without(self.problem.contacts, gone)
        return self._try(x, constrained, trial, step, without, left)

    def _try(
        self,
        x: PETSc.Vec,
        constrained: Floats,
        trial: PETSc.Vec,
        step: StepMode,
        linear: StepMode,
        left: float,
    ) -> int:
        """Put the step by the tangent of ``linear`` into ``trial`` if less than ``left``, N, stays.

        Returns the number of factorisations it took.
        """
        before = trial.array_r.copy()
        x.copy(trial)
        self._carry(x, constrained, trial, linear)
        if np.isfinite(left) and not self._residual_norm(trial, step) < left:
            trial.array[:] = before
        return 1

    def _closed_pairs(self) -> Bools:
        """Which pairs (p,) touch somewhere at the last evaluation; collective."""
        closed = [np.count_nonzero(t.kinematics.closed) for t in self.problem.trials]
        return np.asarray(self._sum(np.array(closed, dtype=float)) > 0.0)

    def _slide(self, x: PETSc.Vec, constrained: Floats, trial: PETSc.Vec, step: StepMode) -> int:
        """Put the step without friction's stiffness into ``trial``, see :meth:`_try`.

        The tangent at ``x`` knows nothing of the slip to come: a body that is moved on by much more
        than its contact holds is sheared by all of it, down to elements that turn inside out, and
        Newton's method takes many damped iterations to undo that, the more the finer the mesh. With
        the friction of ``x`` as a load the body slides along as a whole, and only the change of
        that friction is left.
        """
        left = self._residual_norm(trial, step)
        if left <= self._far_off():
            return 0
        gliding = step.with_friction_as_load(self.problem.contacts)
        return self._try(x, constrained, trial, step, gliding, left)

    def _far_off(self) -> float:
        """Residual, N, from which on a linear step is far off; collective.

        A platen's force is that of all nodes: the finer the mesh, the less is a residual beside it.
        """
        problem, share = self.problem, FAR_OFF * self.problem.reference_force
        if not problem.committed or not any(platen.acts for platen in problem.platens):
            return share
        pairs = zip(problem.contacts, problem.committed, strict=True)
        squared = sum(term.forces_at_nodes(trial)[2] for term, trial in pairs)
        contacts = float(np.sqrt(self._sum(np.array([squared]))[0]))
        return min(share, FAR_AT_NODES * contacts)

    def _unload(self, x: PETSc.Vec, constrained: Floats, trial: PETSc.Vec, step: StepMode) -> int:
        """Put the step of bodies that do not flow on into ``trial``, see :meth:`_try`.

        The tangent at ``x`` is that of flow. Where a load is taken back the bodies answer
        elastically, a hundred times as stiffly.
        """
        solids = [solid for solid in self.problem.solids if solid.flows]
        if not solids:
            return 0
        left = self._residual_norm(trial, step)
        if left <= FAR_OFF * self.problem.reference_force:
            return 0
        for solid in solids:
            solid.unloading = True
        try:
            return self._try(x, constrained, trial, step, step, left)
        finally:
            for solid in solids:
                solid.unloading = False

    def rubbing(self) -> bool:
        """Whether friction resists at any point of the contacts evaluated last; collective."""
        mine = any(bool(t.response.d_traction_d_slip.any()) for t in self.problem.trials)
        return bool(self.problem.comm.allreduce(mine, op=MPI.LOR))

    def _is_lifted(self) -> bool:
        """Whether nothing touches at the last evaluation, of what slid as a whole; collective.

        While some stick, or the path presses as where rubber is squeezed, it follows no curve.
        """
        touch = any(bool(trial.kinematics.closed.any()) for trial in self.problem.trials)
        touches = bool(self.problem.comm.allreduce(touch, op=MPI.LOR))
        return self._all_slip(self.problem.committed) and not touches

    def _all_slip(self, trials: Sequence[ContactTrial]) -> bool:
        """Whether all points of contacts that have friction slip; collective."""
        regimes = [trial.response.regime for trial in trials]
        slip = sum(int(np.count_nonzero(of > Regime.STICK)) for of in regimes)
        stick = sum(int(np.count_nonzero(of == Regime.STICK)) for of in regimes)
        slip, stick = self.problem.comm.allreduce(np.array([slip, stick]), op=MPI.SUM)
        return bool(slip and not stick)

    def is_driven(self, x: PETSc.Vec) -> bool:
        """Whether displacements or loads change in the step from ``x``; collective."""
        drive = self._driving(x)
        moves = bool(drive.constrained.any() or drive.loads.any())
        return bool(self.problem.comm.allreduce(moves, op=MPI.LOR))

    def meets_limit(self, x: PETSc.Vec, trial: PETSc.Vec, step: StepMode) -> bool:
        """Whether forces drive the step from ``x`` beyond the largest on the path; collective.

        The problem is evaluated at ``trial`` again afterwards, if that was changed.
        """
        drive = self._driving(x)
        ratio = self._proportion(drive)
        if not ratio or self._sum(np.array([np.abs(drive.constrained).sum()]))[0]:
            return False
        if len(self._path) < STATES:
            return False
        # Growth of the load over the way (k,) between the last states of the path.
        loads, states = zip(*self._path[-STATES:], strict=True)
        squares = np.array([np.sum((b - a) ** 2) for a, b in pairwise(states)])
        way = np.sqrt(self._sum(squares))
        slope = np.diff(loads) / np.where(way > 0.0, way, np.inf)
        if not falls(slope):
            return False
        failed = trial.array_r.copy()
        x.copy(trial)
        solved = self._carry(x, drive.constrained, trial, step)
        moved, (before, _), (last, was) = trial.array_r - x.array_r, *self._path[-2:]
        reach = ratio * (last - before)
        squared, onwards = self._sum(np.array([moved @ moved, moved @ (was - self._path[-2][1])]))
        now = reach / np.sqrt(squared) if onwards > 0.0 else 0.0
        trial.array[:] = failed
        self._residual_norm(trial, step)
        # A system that could not be solved says nothing of the slope.
        now = max(float(now), np.finfo(float).tiny)
        if not (solved and squared > 0.0 and falls(np.append(slope, now))):
            return False
        # Before a smooth maximum the square of the slope is in proportion to what is missing of the
        # load.
        missing = 0.5 * (last - before) * now**2 / (slope[-1] ** 2 - now**2)
        return bool(missing <= FURTHER * reach)

    def restart(self, x: PETSc.Vec, trial: PETSc.Vec, step: StepMode = DEFAULT_STEP) -> int:
        """Put the linear step from ``x`` into ``trial``, whatever the path was; collective."""
        x.copy(trial)
        self._carry(x, self._driving(x).constrained, trial, step)
        return 1

    def look_ahead(self, x: PETSc.Vec, trial: PETSc.Vec, step: StepMode) -> None:
        """Evaluate the problem at the start predicted from ``x``; ``trial`` stays; collective."""
        failed = trial.array_r.copy()
        self.predict(x, trial, step)
        self._residual_norm(trial, step)
        trial.array[:] = failed

    def commit(self, x: PETSc.Vec, trial: PETSc.Vec) -> None:
        """Take the step from ``x`` to the converged ``trial`` into the path."""
        drive = self._driving(x)
        ratio = self._proportion(drive) if self._drive is not None else None
        if ratio is None or ratio == 0.0 or len(self._path) < 2:
            self._path = [(0.0, x.array_r.copy()), (1.0, trial.array_r.copy())]
        else:
            states = self._path[-HIGHEST_ORDER:]
            self._path = [*states, (self._ahead(ratio), trial.array_r.copy())]
        self._drive, self._loads = drive, drive.total
        self._force = self.problem.reference_force

    def snapshot(self) -> Snapshot:
        """The path so far."""
        drive, owned, kept = self._drive, self.problem.owned, None
        if drive is not None:
            kept = {
                "prescribed": scattered(drive.dofs, 1.0, owned),
                "constrained": scattered(drive.dofs, drive.constrained, owned),
                "loads": drive.loads,
                "total": drive.total,
            }
        return {
            "at": [at for at, _ in self._path],
            "path": [Nodal(values) for _, values in self._path],
            "loads": self._loads,
            "force": self._force,
            "drive": kept,
        }

    def restore(self, kept: Snapshot) -> None:
        """Continue the path that :meth:`snapshot` has seen."""
        problem, drive = self.problem, kept["drive"]
        loads = [len(load.drive) for load in problem.loads]
        count = (len(problem.platens) + sum(loads) + len(problem.nodal_loads),)
        driven = () if drive is None else (drive["loads"], drive["total"])
        if kept["loads"].shape not in ((0,), count) or any(one.shape != count for one in driven):
            raise ValueError("another number of loads")
        self._path = list(zip(kept["at"], kept["path"], strict=True))
        self._loads, self._force, self._drive = kept["loads"], kept["force"], None
        if drive is not None:
            held = drive["prescribed"].copy()
            held[problem.unknowns.padding] = 1.0  # no rank keeps those
            dofs = np.nonzero(held)[0].astype(np.int32)
            self._drive = Drive(dofs, drive["constrained"][dofs], drive["loads"], drive["total"])

    def _ahead(self, ratio: float) -> float:
        """Parameter of the path after a step ``ratio`` times as long as the last."""
        (before, _), (last, _) = self._path[-2:]
        return last + ratio * (last - before)

    def _extrapolate(
        self, trial: PETSc.Vec, ratio: float, step: StepMode, highest: int = HIGHEST_ORDER
    ) -> float:
        """Continue the path by the polynomial of least residual; returns its norm.

        A low order comes first: where it leaves less than the next, the path has a kink.
        """
        at = self._ahead(ratio)
        best, norm = trial.array_r.copy(), np.inf
        for order in range(1, min(len(self._path), highest + 1)):
            states = self._path[-order - 1 :]
            weights = lagrange_weights(np.array([s for s, _ in states]), at)
            trial.array[:] = sum(w * values for w, (_, values) in zip(weights, states, strict=True))
            trial.array[:] = self.problem.constrained_values(trial)
            now = self._residual_norm(trial, step)
            if not now < norm:
                break
            best, norm = trial.array_r.copy(), now
            self._keep_residual()
        trial.array[:] = best
        return norm

    def _flow_on(self, trial: PETSc.Vec, ratio: float, step: StepMode, norm: float) -> float:
        """Put metal that rubs where a steady flow takes it, if that leaves less than ``norm``.

        Returns the norm of the residual that is left.
        """
        if not self._flows or not self.rubbing():
            return norm
        best, dim = trial.array_r.copy(), self.problem.dim
        path = [(at, values.reshape(-1, dim)) for at, values in reversed(self._path)]
        start = best.copy()
        for flow in self._flows:
            start.reshape(-1, dim)[flow.nodes] = flow.onwards(path, self._ahead(ratio))
        trial.array[:] = start
        trial.array[:] = self.problem.constrained_values(trial)
        now = self._residual_norm(trial, step)
        if now < norm:
            self._keep_residual()
            return now
        trial.array[:] = best
        return norm

    def _correct(self, trial: PETSc.Vec, norm: float, times: int, step: StepMode) -> float:
        """Correct with the tangent factorised last while it pays; returns the residual's norm."""
        for _ in range(times):
            if not np.isfinite(norm) or norm == 0.0:
                break
            before = trial.array_r.copy()
            solved = self.solver.solve(self._kept, self._increment, on_path=True)
            trial.axpy(-1.0, self._increment)
            now = self._residual_norm(trial, step)
            if not solved or not now < WORTHWHILE * norm:
                trial.array[:] = before
                break
            norm = now
            self._keep_residual()
        return norm

    def _keep_residual(self) -> None:
        """Keep the residual evaluated last, that of the best start so far."""
        self._kept, self._residual = self._residual, self._kept

    def _residual_norm(self, trial: PETSc.Vec, step: StepMode) -> float:
        # What a singular factor leaves: nothing to evaluate.
        if not self.problem.rounding.is_within_reach(trial):
            return np.inf
        self.problem.residual(None, trial, self._residual, step)
        return self._residual.norm()

    def _driving(self, x: PETSc.Vec) -> Drive:
        """Increments from the converged state to the current prescribed values and loads."""
        problem = self.problem
        pulls = [platen.pull(0.0) for platen in problem.platens]
        drives = [load.drive for load in problem.loads]
        factors = [load.factor for load in problem.nodal_loads]
        loads = np.concatenate([pulls, *drives, factors])
        dofs = problem.constrained_dofs()
        constrained = (problem.constrained_values(x) - x.array_r)[dofs]
        return Drive(dofs, constrained, loads - self._loads if len(self._loads) else loads, loads)

    def _proportion(self, drive: Drive) -> float | None:
        """Factor by which ``drive`` continues the last one; None where it does not."""
        last = self._drive or replace(
            drive, constrained=0.0 * drive.constrained, loads=0.0 * drive.loads
        )
        # Another support, or a platen's displacement is given.
        changed = not np.array_equal(last.dofs, drive.dofs)
        if self._sum(np.array([float(changed)]))[0]:
            return None
        to, by = drive.constrained, last.constrained
        cross, before, now = self._sum(np.array([to @ by, by @ by, to @ to]))
        weights = self._weights(drive)
        loads, last_loads = weights * drive.loads, weights * last.loads
        if before == 0.0 and now == 0.0:
            cross, before, now = loads @ last_loads, last_loads @ last_loads, loads @ loads
            if now == 0.0:
                return 0.0
        ratio = cross / before if before > 0.0 else 0.0
        missed = drive.constrained - ratio * last.constrained
        lag = loads - ratio * last_loads
        same = bool(self._sum(np.array([missed @ missed]))[0] <= 1e-18 * max(now, before))
        same = same and bool(lag @ lag <= 1e-18)
        return ratio if same and ratio > 0.0 else None

    def _goes_on(self, drive: Drive) -> bool:
        """Whether ``drive`` leads on more than back, on the same supports; collective."""
        last = self._drive
        changed = last is None or not np.array_equal(last.dofs, drive.dofs)
        if self._sum(np.array([float(changed)]))[0] or last is None:
            return False
        now, before = drive.constrained, last.constrained
        cross, *sizes = self._sum(np.array([now @ before, now @ now, before @ before]))
        if abs(cross) <= NO_WAY * max(sizes):  # supports that stand still move by rounding
            weights = self._weights(drive)
            cross = float((weights * drive.loads) @ (weights * last.loads))
        return bool(cross > 0.0)

    def _weights(self, drive: Drive) -> Floats:
        """One over the size of each load's vector, and of the platens' forces: they have units."""
        problem = self.problem
        sizes = [len(problem.platens), *(len(load.drive) for load in problem.loads)]
        group = np.repeat(np.arange(len(sizes)), sizes)
        single = len(group) + np.arange(len(problem.nodal_loads))
        group = np.concatenate([group, single]).astype(np.intp)
        squares = np.bincount(group, drive.total**2 + drive.loads**2)[group]
        return np.where(squares > 0.0, 1.0 / np.sqrt(np.where(squares, squares, 1.0)), 0.0)

    def _carry(self, x: PETSc.Vec, constrained: Floats, trial: PETSc.Vec, step: StepMode) -> bool:
        """Linear step from the converged state that meets the prescribed displacements.

        Returns whether it is to be trusted.
        """
        problem, increment = self.problem, self._increment
        problem.residual(None, x, self._residual, step)
        self._residual.scale(-1.0)
        increment.set(0.0)
        increment.array[problem.constrained_dofs()] = constrained
        solved = self.solver.solve_from(x, self._residual, increment, step)
        trial.axpy(1.0, increment)
        trial.array[:] = problem.constrained_values(trial)
        return solved

    def _sum(self, local: Floats) -> Floats:
        return self.problem.comm.allreduce(local)


def lagrange_weights(nodes: Floats, at: float) -> Floats:
    """Weights (n,) of the values at distinct ``nodes`` (n,) in their polynomial's value ``at``."""
    own = np.eye(len(nodes), dtype=bool)
    apart: Floats = nodes[:, None] - nodes[None, :]
    factors: Floats = (at - nodes[None, :]) / np.where(own, 1.0, apart)
    return np.prod(np.where(own, 1.0, factors), axis=1)


# -- A step that is being tried, and what a way to solve it is -------------------------------------


@dataclass(slots=True)
class Attempt:
    """A step that is being tried."""

    newton: Newton  # whose ``trial`` becomes the solution
    predictor: Predictor  # finds starts
    x: PETSc.Vec  # the last converged unknowns
    step: StepMode  # duration and contact modes, as they are committed
    pressed: bool  # whether anything pressed at the last converged state
    bodies: LooseBodies  # those that contact alone holds
    failures: int = 0  # attempts that have failed from the same state
    idle: frozenset[int] = frozenset()  # contacts of bodies that float, and stay where they are
    # (n,), m, the predicted start of the owned unknowns
    start: Floats = field(default_factory=lambda: np.empty(0))
    # (d,), N, of bodies that only contact can hold, and does not yet, in each loose direction
    loads: Floats = field(default_factory=lambda: np.empty(0))
    continued: bool = False  # whether that continues the path of the last steps
    relaxed: bool = False  # whether the solution was found by springs that give way
    adrift: tuple[str, ...] = ()  # bodies that the load moves away from all that they could touch
    # whether the way from inside comes first: a load pulls a body off what pressed on it, or acts
    # on one that nothing presses on
    inside_first: bool = False
    # whether only the predicted start and a way from inside are tried: springs may do better
    shortly: bool = False

    @property
    def trial(self) -> PETSc.Vec:
        """The unknowns that are iterated."""
        return self.newton.trial

    @property
    def has_contacts(self) -> bool:
        """Whether there is a contact that could be made softer, and not let go."""
        return any(term.active for term in self.newton.problem.contacts)

    def return_to_start(self) -> None:
        """Put the predicted start back."""
        self.trial.array[:] = self.start


class Phase(Protocol):
    """One way to solve a step."""

    def run(self, attempt: Attempt) -> tuple[int, int]:
        """Solve from a start of its own; iterations and PETSc's converged reason; collective."""
        ...
