r"""Newton steps along which contacts open and close.

The tangent knows the vertices that are closed at its state. Those that a whole step would close
push back a thousand times too hard, or those that it opens pull, so that the residual falls only up
to the first of them: a line search goes from one to the next, an assembly and a factorisation for
each. Here the step follows the path on which the residual of the linear bodies with unilateral
contacts falls from F to nothing,

.. math:: R(x - p(t)) = (1 - t)\, F, \qquad \frac{dp}{dt} = T_t^{-1} F, \qquad 0 \le t \le 1,

to its end (D. Ralph, Global convergence of damped Newton's method for nonsmooth equations via the
path search, Math. Oper. Res. 19, 1994; S. Dirkse, M. Ferris, The PATH solver, 1995). T is that of
the state but for the vertices A that have opened or closed on the way,

.. math:: T_t = T + \sum_A \pm L_A R_A^T / m_A,

with the force :math:`L_A/m_A` per gap, friction under it included, and the change
:math:`R_A/m_A` of the mean gap. Each of them costs one substitution with the factors at hand
(Sherman, Morrison, Woodbury), no factorisation. The gaps of all vertices change linearly between
two of these events, so that the next one is known.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.step_mode import StepMode
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import AveragedPressure
from tribox.forms.contact.state import ContactMode, ContactTrial
from tribox.geometry.surfaces.facets import Bools, Floats, Ints

Solve = Callable[[PETSc.Vec, PETSc.Vec], bool]

NEAR = 1.0  # gap, in lengths of a slave facet, up to which a vertex may close in an iteration
MOST = 40  # substitutions for one step
STABLE = 1e-8  # least pivot, over that of the vertex alone, of bodies that resist
CUTS = 10  # halvings within which the residual falls on the way to the end
EVENTS = 3 * MOST  # vertices that open or close along it, those that do so again included


@dataclass(frozen=True, slots=True)
class VertexRows:
    """The vertices (v,) of one pair: gaps, and what each would add to the tangent."""

    term: ContactTerm
    gap: Floats  # (v,), m
    closed: Bools  # (v,) in the tangent
    area: Floats  # (v,), m_A
    # this rank's parts (v, n·i) of L/m and R
    left: scipy.sparse.csr_matrix
    right: scipy.sparse.csr_matrix

    @classmethod
    def of(cls, term: ContactTerm, trial: ContactTrial, mode: ContactMode) -> VertexRows:
        """Those of a pair as it was evaluated last; collective."""
        normal, vertices = trial.normal_contact, term.surface.vertices
        assert normal.gap is not None and normal.active is not None
        near = normal.active | (normal.gap < NEAR * vertices.length)
        points = trial.projection.on_surface & near[vertices.of_point].any(axis=1)
        all_closed = replace(
            trial,
            normal_contact=replace(
                normal,
                closed=points,
                active=near,
                rim=None,
                stiffness=mode.penalty_scale * term.penalty,
            ),
            kinematics=replace(trial.kinematics, closed=points),
        )
        left, right = term.linearised.vertex_sides(term.state, all_closed)
        area = term.linearised.area_of(all_closed)
        return cls(term, normal.gap, normal.active, area, left.tocsr(), right)

    def rates(self, change: PETSc.Vec) -> Floats:
        """Change (v,), m, of the gaps with that of the unknowns; collective."""
        surface = self.term.surface
        sums = self.right @ surface.at_nodes(change).reshape(-1)
        return surface.vertices.total(sums) / self.area

    def force_of(self, vertex: int, problem: Equilibrium) -> PETSc.Vec:
        """L_A/m_A as a residual, to be destroyed; collective."""
        force = problem.new_vector()
        rows = problem.unknowns.of_nodes(self.term.surface.nodes).reshape(-1)
        row = self.left[[vertex]]
        force.setValues(rows[row.indices], row.data, addv=PETSc.InsertMode.ADD_VALUES)
        force.assemble()
        problem.constraints.constrain_change(force.array)
        return force


@dataclass(slots=True)
class Changed:
    """The vertices (k,) that are not as in the tangent, with what they add to it."""

    numbers: list[int] = field(default_factory=list)
    signs: list[float] = field(default_factory=list)  # 1: closed on the way, −1: opened
    # T⁻¹ L_A/m_A, and the changes (v,), m, of all gaps with it
    answers: list[PETSc.Vec] = field(default_factory=list)
    rates: list[Floats] = field(default_factory=list)

    def add(self, number: int, sign: float, answer: PETSc.Vec, rates: Floats) -> None:
        """Take one more vertex."""
        self.numbers.append(number)
        self.signs.append(sign)
        self.answers.append(answer)
        self.rates.append(rates)

    def remove(self, number: int) -> None:
        """Leave a vertex as it is in the tangent again."""
        at = self.numbers.index(number)
        for entries in (self.numbers, self.signs, self.answers, self.rates):
            entries.pop(at)

    def matrix(self, area: Floats) -> Floats:
        """±1 + R_Aᵀ T⁻¹ L_B/m_B (k, k), with the areas (v,) of all vertices."""
        products = np.array(self.rates)[:, self.numbers].T * area[self.numbers][:, None]
        return np.diag(self.signs) + products

    def is_stable(self, area: Floats) -> bool:
        """Whether the bodies resist with the last one too: its pivot has its sign."""
        matrix = self.matrix(area)
        pivot = matrix[-1, -1]
        if len(matrix) > 1:
            pivot -= matrix[-1, :-1] @ np.linalg.solve(matrix[:-1, :-1], matrix[:-1, -1])
        return bool(pivot * self.signs[-1] > STABLE)


def follow(
    problem: Equilibrium,
    step: StepMode,
    x: PETSc.Vec,
    y: PETSc.Vec,
    solve: Solve,
    residual: Callable[[PETSc.Vec], float],
    most: float,
) -> bool:
    """Make a Newton step ``y``, that is to be taken off ``x``, one along the path; collective.

    Pairs whose pressure is not averaged, that are tied, or have a film as an unknown, stay as they
    are in the tangent; so do vertices whose change would leave bodies that do not resist. The step
    remains what it was where the residual does not fall on the way to the end of the path.

    Args:
        problem: evaluated last at ``x`` in this ``step``, with the tangent there.
        solve: with the tangent's factors, from a residual into a vector.
        residual: its norm at a state; most: that at ``x``.

    Returns:
        Whether ``y`` was changed.
    """
    pairs = [
        VertexRows.of(term, trial, mode)
        for (term, mode), trial in zip(step.pairs(problem.contacts), problem.trials, strict=True)
        if term.active and not term.tied and isinstance(term.rule, AveragedPressure)
        if trial.normal_contact.lubrication is None
    ]
    if not pairs:
        return False
    end = _Path(problem, pairs, solve).to_its_end(y)
    if end is None:
        return False
    there, falls = x.copy(), False
    for cut in range(CUTS):
        there.waxpy(-(0.5**cut), end, x)
        falls = residual(there) < most
        if falls:
            end.copy(y)
            break
    there.destroy()
    end.destroy()
    return falls


class _Path:
    """Follows one path."""

    def __init__(self, problem: Equilibrium, pairs: Sequence[VertexRows], solve: Solve) -> None:
        self.problem, self.pairs, self.solve = problem, pairs, solve
        self.first: Ints = np.cumsum([0, *(len(pair.gap) for pair in pairs)])
        self.area = np.concatenate([pair.area for pair in pairs])
        self.gap = np.concatenate([pair.gap for pair in pairs])
        self.closed = np.concatenate([pair.closed for pair in pairs])
        self.in_tangent = self.closed.copy()
        self.bound = np.zeros(len(self.gap), dtype=bool)  # those that stay as they are
        self.changed = Changed()
        self.known: dict[int, tuple[PETSc.Vec, Floats]] = {}

    def to_its_end(self, y: PETSc.Vec) -> PETSc.Vec | None:
        """Where it ends, to be destroyed; None if nothing changes, or none is found; collective."""
        at_start = self._rates(y)
        place, direction, rates = y.duplicate(), y.copy(), at_start
        gone, events = 0.0, 0
        while True:
            number, way = self._next(rates)
            ends = way >= 1.0 - gone or len(self.known) == MOST or events == EVENTS
            way = 1.0 - gone if ends else way
            place.axpy(way, direction)
            if ends:
                break
            self.gap = self.gap - way * rates
            gone, events = gone + way, events + 1
            try:
                self._flip(number)
                rates = self._turn(y, direction, at_start)
            except np.linalg.LinAlgError:  # the bodies do not resist
                place.set(np.nan)
                break
        for vector in (direction, *(answer for answer, _ in self.known.values())):
            vector.destroy()
        if events and np.isfinite(place.norm()):
            return place
        place.destroy()
        return None

    def _rates(self, change: PETSc.Vec) -> Floats:
        """Changes (v,), m, of all gaps with that of the unknowns; collective."""
        return np.concatenate([pair.rates(change) for pair in self.pairs])

    def _next(self, rates: Floats) -> tuple[int, float]:
        """The vertex that opens or closes next, and the part of the step up to there."""
        moves = np.where(self.closed, rates < 0.0, rates > 0.0) & ~self.bound
        ways = np.full(len(rates), np.inf)
        ways[moves] = np.maximum(self.gap[moves] / rates[moves], 0.0)
        number = int(np.argmin(ways))
        return number, float(ways[number])

    def _flip(self, number: int) -> None:
        """Open or close a vertex, or leave it as it is for good; collective."""
        changed = self.changed
        if self.closed[number] != self.in_tangent[number]:
            changed.remove(number)
        else:
            if number not in self.known:
                self.known[number] = self._answer(number)
            changed.add(number, -1.0 if self.closed[number] else 1.0, *self.known[number])
            if not changed.is_stable(self.area):
                changed.remove(number)
                self.bound[number] = True
                return
        self.closed[number] = not self.closed[number]

    def _answer(self, number: int) -> tuple[PETSc.Vec, Floats]:
        """T⁻¹ L_A/m_A, and the changes (v,) of all gaps with it; collective."""
        pair = int(np.searchsorted(self.first, number, side="right")) - 1
        force = self.pairs[pair].force_of(number - int(self.first[pair]), self.problem)
        answer = force.duplicate()
        if not self.solve(force, answer):
            answer.set(np.nan)
        force.destroy()
        return answer, self._rates(answer)

    def _turn(self, y: PETSc.Vec, direction: PETSc.Vec, at_start: Floats) -> Floats:
        """Put T_t⁻¹ F into ``direction``; the changes (v,) of all gaps with it."""
        changed, rates = self.changed, at_start.copy()
        y.copy(direction)
        if changed.numbers:
            weighed = at_start[changed.numbers] * self.area[changed.numbers]
            shares = np.linalg.solve(changed.matrix(self.area), weighed)
            for share, answer, one in zip(shares, changed.answers, changed.rates, strict=True):
                direction.axpy(-share, answer)
                rates -= share * one
        return rates
