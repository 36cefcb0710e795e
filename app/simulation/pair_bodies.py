"""What loads the bodies of a contact, and what its friction can hold at most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from tribox.app.build.contacts import penalty_modulus
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.supports import Loose, bodies_of, loose_directions
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.pressure import PointwisePressure, PressureKind
from tribox.forms.contact.state import ContactTrial
from tribox.forms.friction.factored_law import FactoredLaw
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.law import FrictionState
from tribox.geometry.surfaces.facets import Floats, Ints


def pressure_kind(term: ContactTerm) -> PressureKind:
    """Whether a contact's pressure is averaged over vertices or found point by point."""
    return "pointwise" if isinstance(term.rule, PointwisePressure) else "averaged"


def penalty_factor(problem: Equilibrium, term: ContactTerm) -> float:
    """Penalty of a contact as `penalty_factor` of a case, by the pair's softer body; collective.

    K h over :func:`tribox.app.build.contacts.penalty_modulus`, K and h being those of each slave
    vertex, or point; their mean by area.
    """
    surface, kind = term.surface, pressure_kind(term)
    length = surface.slave.facet_length
    if kind == "averaged":
        # At the points, so that each rank has its own and none is counted twice.
        vertices = surface.vertices
        stiffness = vertices.at_points(term.penalty * vertices.length)
    else:
        stiffness = term.penalty * length
    weight = surface.slave.weight
    total, area = problem.comm.allreduce(np.array([weight @ stiffness, weight.sum()]))
    return float(total / area / penalty_modulus(bodies_of(problem, term).softer.material, kind))


# -- loads ----------------------------------------------------------------------------------------


def load_on(problem: Equilibrium, one: Loose) -> float:
    """Force of platens and pressures on a body along a loose direction, N (N/m); collective."""
    dofs: Ints = one.nodes * problem.dim + one.component
    local = float(problem.load_forces()[dofs].sum())
    total = float(problem.comm.allreduce(local, op=MPI.SUM))
    moving = [p.force for p in problem.platens if _share(problem, p.dofs, dofs)]
    return total + sum(moving)


def has_spring(problem: Equilibrium, one: Loose) -> bool:
    """Whether a spring holds a body along a direction that no boundary supports; collective."""
    dofs: Ints = one.nodes * problem.dim + one.component
    springs = [p for p in problem.platens if p.stiffness > 0.0]
    return any([_share(problem, p.dofs, dofs) for p in springs])


def _share(problem: Equilibrium, some: Ints, dofs: Ints) -> bool:
    """Whether any rank has unknowns of both; collective."""
    here = bool(np.isin(some, dofs).any())
    return bool(problem.comm.allreduce(here, op=MPI.LOR))


def _way_out(problem: Equilibrium, one: Loose, index: int) -> Floats | None:
    """How contact number ``index`` lies to a body that has reached it; collective.

    It has where the surfaces were no further than a facet's length apart when the last step was
    solved, or at the start. Returns (i,), m^(i-1), the normal out of the other body times the area
    within reach; None where the body has not reached it, or has no part in it.
    """
    term = problem.contacts[index]
    surface, bodies = term.surface, bodies_of(problem, term)
    if (bodies.slave.name in one.bodies) == (bodies.master.name in one.bodies):
        return None
    at = surface.project(surface.slave.position, surface.master.position)
    if problem.committed:
        at = problem.committed[index].projection
    near = at.on_surface & (at.gap < surface.facet_length)
    normal: Floats = problem.comm.allreduce((surface.slave.weight * near) @ at.normal)
    if not normal.any():
        return None
    # The normal points out of the master.
    return normal if bodies.slave.name in one.bodies else -normal


def presses(problem: Equilibrium, one: Loose, index: int) -> bool:
    """Whether the load on a body drives it into contact number ``index``, which it has reached.

    Collective.
    """
    return not one.turns and _drive(problem, one, index) < 0.0


def may_hold(problem: Equilibrium, one: Loose, index: int) -> bool:
    """Whether a body has reached contact number ``index``, and no load pulls it off; collective."""
    return bool(_drive(problem, one, index) <= 0.0)


def _drive(problem: Equilibrium, one: Loose, index: int) -> float:
    """Whether loads drive a body off a contact (1), into it (−1), or neither (0); collective.

    NaN where it has not reached the contact, or has no part in it.
    """
    if (out := _way_out(problem, one, index)) is None:
        return np.nan
    load = 0.0 if one.turns else load_on(problem, one)
    across = abs(out[one.component]) > 0.5 * float(np.linalg.norm(out))
    return float(np.sign(load * out[one.component])) if across else 0.0


def pressed_by_force(problem: Equilibrium) -> list[bool]:
    """Whether the normal force of each contact is given, and not what a soft contact costs.

    Collective. It is where nothing prescribes the displacement of one of the bodies across the
    contact, unless that body, or a stack of such bodies, lies between two that are held or moved.
    """
    loose = [one for one in loose_directions(problem) if not one.turns]
    pairs = [_Across.of(problem, term) for term in problem.contacts]
    return [
        any(
            axis in pair.axes
            and not _lies_between(problem, [o for o in loose if o.component == axis], pairs, pair)
            for axis in {one.component for one in loose if pair.names & set(one.bodies)}
        )
        for pair in pairs
    ]


@dataclass(frozen=True, slots=True)
class _Across:
    """A contact by the names of its bodies, and its mean normal as drawn."""

    slave: str
    master: str
    normal: Floats  # (i,), out of the master
    axes: frozenset[int]  # along which that points more than not

    @classmethod
    def of(cls, problem: Equilibrium, term: ContactTerm) -> _Across:
        """Of a contact; collective."""
        surface, bodies = term.surface, bodies_of(problem, term)
        at = surface.project(surface.slave.position, surface.master.position)
        local = (surface.slave.weight * at.on_surface) @ at.normal
        normal: Floats = problem.comm.allreduce(local)
        long = np.abs(normal) > 0.5 * np.linalg.norm(normal)
        return cls(bodies.slave.name, bodies.master.name, normal, frozenset(np.flatnonzero(long)))

    @property
    def names(self) -> set[str]:
        """Of both bodies."""
        return {self.slave, self.master}


def _lies_between(
    problem: Equilibrium, loose: Sequence[Loose], pairs: Sequence[_Across], pair: _Across
) -> bool:
    """Whether bodies that nothing holds along an axis lie between two that are held; collective.

    No platen may press them. ``loose`` are all bodies without support along the axis; those looked
    at are these of ``pair``, and what they touch.
    """
    axis = loose[0].component
    along = [other for other in pairs if axis in other.axes]
    stack = [one for one in loose if pair.names & set(one.bodies)]
    for member in stack:  # and those that are found on the way
        touched = set().union(*(o.names for o in along if o.names & set(member.bodies)))
        beside = [one for one in loose if touched & set(one.bodies)]
        stack += [one for one in beside if all(one is not known for known in stack)]
    names = {name for member in stack for name in member.bodies}
    sides = {
        np.sign(other.normal[axis]) * (1.0 if other.slave in names else -1.0)
        for other in along
        if (other.slave in names) != (other.master in names)
    }
    pushed = [
        _share(problem, platen.dofs, member.nodes * problem.dim + axis)
        for platen in problem.platens
        if platen.displacement is None
        for member in stack
    ]
    return len(sides) == 2 and not any(pushed)


# -- friction -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Hold:
    """What the contacts of a body hold it with, at one state."""

    contacts: tuple[int, ...]  # their numbers
    friction: Floats  # (i,), N (N/m), resultants of both on the body
    pressure: Floats  # likewise
    # N (N/m), what the asperities can hold at most: the integral of mu(d) times the pressure, less
    # what a film takes off them
    limit: float
    wet: bool = False  # whether a film carries a part


def hold_of(problem: Equilibrium, held: Sequence[str], trials: Sequence[ContactTrial]) -> Hold:
    """What all contacts together hold a body with, at the states ``trials``; collective."""
    contacts = []
    parts = np.zeros(2 * problem.dim + 2)
    for index, (term, trial) in enumerate(zip(problem.contacts, trials, strict=False)):
        bodies = bodies_of(problem, term)
        if (bodies.slave.name in held) == (bodies.master.name in held):
            continue
        contacts.append(index)
        weight, response = term.surface.slave.weight, trial.response
        sign = 1.0 if bodies.slave.name in held else -1.0
        load = weight * trial.pressure
        friction = -sign * (weight @ response.traction)
        dry = _dry_share(term, response.state)
        limits = [load @ (dry * term.law.coefficient(response.state)), load @ (1.0 - dry)]
        parts += np.concatenate([friction, sign * (load @ trial.kinematics.normal), limits])
    total: Floats = problem.comm.allreduce(parts)
    friction, pressure = total[:-2].reshape(2, -1)
    return Hold(tuple(contacts), friction, pressure, float(total[-2]), bool(total[-1] > 0.0))


def _dry_share(term: ContactTerm, state: FrictionState) -> Floats:
    """How much of mu p the asperities of each point carry, (q,): 1 - alpha beside a film."""
    law = term.law.law if isinstance(term.law, FactoredLaw) else term.law
    if isinstance(law, FrictionMap) and law.parameters.flow_rule == "weighted":
        return 1.0 - state.alpha
    return np.ones(len(term.surface.slave.weight))
