r"""One slave surface against several masters: what each pair must know of the others.

Axis letters: q slave points, v vertices of the slave facets, i space.

A point belongs to the master that lies below it. Beside a junction of two masters each of them has
part of the support of a vertex, and each pair its own mean gap. With m_A of the whole support a
uniform overlap d would press with K d f on either side, f being its share of m_A: a dip, down to a
half. So the area that the others have, :math:`o_A` at the last converged step, is left out,

.. math:: g_A = \frac{1}{a_A} \sum_q w N_A g_q, \quad
   a_A = \max\Big(m_A - o_A, \sum_q w N_A\Big),

and both carry K d. Of the others, points count that are nearer than the length of a facet: a strip
between a pad and a die does not share the pad with the die. Ends of masters in the plane that meet
undeformed are no open ends: nothing fades there.

A point that was pressed by another master, and comes over this one, brings its friction along:
elastic slip, slip path, film fraction and speed, if both laws are of one kind and both contacts
have the same points. Its slip is measured as if this master had gone on below it; what comes from
nowhere begins with the elastic slip that takes the way up to this master away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from tribox.forms.contact.state import ContactState, ContactTrial
from tribox.forms.friction.law import FrictionState
from tribox.geometry.surfaces.facets import Bools, Floats, Longs
from tribox.geometry.surfaces.projection import FacetSurface
from tribox.geometry.surfaces.surface import ContactSurface

MEETING = 0.05  # distance over the length of a slave facet up to which ends of masters meet


class Pair(Protocol):
    """What contacts know of each other, see :class:`tribox.forms.contact.penalty.ContactTerm`."""

    surface: ContactSurface
    state: ContactState
    active: bool
    neighbours: list[Neighbour]

    @property
    def tied(self) -> bool:
        """Whether the surfaces are bonded."""
        ...


@dataclass(frozen=True, slots=True)
class Neighbour:
    """Another contact with the same slave."""

    term: Pair  # it
    rows: Longs  # (v,) its number of each vertex of this one, −1 where it has none
    same_points: bool  # whether both have the same points, on all ranks, and laws of one kind

    def covered(self) -> Floats:
        """Area o_A (v,) that it had at the last converged step; collective."""
        term = self.term
        near = term.active & (term.state.gap < term.surface.slave.facet_length)
        area = term.surface.vertices.sums(term.surface.slave.weight * near)
        return np.where(self.rows >= 0, area[self.rows], 0.0)


def introduce(terms: Sequence[Pair]) -> None:
    """Let contacts with the same slave know each other, and join masters that meet; collective.

    Args:
        terms: all contacts, undeformed.
    """
    loose = [term for term in terms if not term.tied]
    for term in loose:
        term.neighbours = [
            other for other in (_neighbour(term, o) for o in loose if o is not term) if other
        ]
        target = term.surface.target
        for other in term.neighbours:
            theirs = other.term.surface
            # Rigid shapes have fillets at their ends, or go on straight.
            if isinstance(target, FacetSurface) and isinstance(theirs.target, FacetSurface):
                target.ends.join(theirs.master.position, MEETING * term.surface.facet_length)


def _neighbour(term: Pair, other: Pair) -> Neighbour | None:
    """The other contact as a neighbour, if it has vertices of the same slave; collective."""
    mine, theirs = term.surface.vertices.nodes, other.surface.vertices.nodes
    order = np.argsort(theirs)
    at = order[np.minimum(np.searchsorted(theirs, mine, sorter=order), len(theirs) - 1)]
    rows = np.where(theirs[at] == mine, at, -1)
    if np.all(rows < 0):
        return None
    here = np.array_equal(term.surface.slave.position, other.surface.slave.position)
    here &= type(term.state.friction) is type(other.state.friction)
    return Neighbour(other, rows, term.surface.vertices.on_all_ranks(bool(here)))


def covered_by_others(neighbours: Sequence[Neighbour], count: int) -> Floats:
    """Area (v,) of ``count`` vertices that other masters had; collective."""
    out = np.zeros(count)
    for neighbour in neighbours:
        out += neighbour.covered()
    return out


def brought_along(term: Pair) -> tuple[FrictionState, Bools] | None:
    """The law's state with that of points which other masters pressed at the last step.

    Returns:
        The state, and the points (q,) whose history comes from another master; None without any.
    """
    state = term.state.friction
    taken: Bools = np.zeros(len(state.closed), dtype=bool)
    for neighbour in term.neighbours:
        theirs = neighbour.term.state.friction
        if not neighbour.same_points:
            continue
        take = theirs.closed & ~state.closed
        if take.any():
            mine, other = state.arrays(), theirs.arrays()
            state = type(state).from_arrays(
                {name: _chosen(take, other[name], mine[name]) for name in mine}
            )
            taken = taken | take
    return (state, taken) if taken.any() else None


@dataclass(frozen=True, slots=True)
class Left:
    """What the neighbours of a pair left at the last step."""

    seen: tuple[object, ...]  # what it was found from
    area: Floats  # (v,), see :func:`covered_by_others`
    brought: tuple[FrictionState, Bools] | None  # see :func:`brought_along`


def left_by_others(term: Pair, known: Left | None) -> Left | None:
    """What neighbours left; ``known``, if that was found in this step; collective.

    None without neighbours.
    """
    if not term.neighbours:
        return None
    others = [part for n in term.neighbours for part in (n.term.state, n.term.active)]
    seen = (term.state, *others)
    if known is not None and all(a is b for a, b in zip(known.seen, seen, strict=True)):
        return known
    area = covered_by_others(term.neighbours, term.surface.vertices.count)
    return Left(seen, area, brought_along(term))


def _chosen(take: Bools, some: Floats, other: Floats) -> Floats:
    shape = (len(take), *(1,) * (other.ndim - 1))
    return np.where(take.reshape(shape), some, other)


def keep_what_went_over(terms: Sequence[Pair], trials: Sequence[ContactTrial]) -> None:
    """Take the elastic energy that went over to another master out of what opening has lost.

    Args:
        terms: all contacts, before the trials are committed.
    """
    by_term = dict(zip(map(id, terms), trials, strict=True))
    for term, trial in zip(terms, trials, strict=True):
        left = term.state.friction.closed & (trial.pressure <= 0.0)
        went = np.zeros(len(left), dtype=bool)
        for neighbour in term.neighbours:
            if neighbour.same_points:
                theirs = by_term[id(neighbour.term)].pressure > 0.0
                went |= left & theirs & ~neighbour.term.state.friction.closed
        if went.any():
            parts = trial.response.dissipation
            lost = np.where(went, 0.0, parts.opening)
            trial.response = replace(trial.response, dissipation=replace(parts, opening=lost))
