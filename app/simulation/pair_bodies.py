"""What loads the bodies of a contact, and what its friction can hold at most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from mpi4py import MPI

from tribox.app.build.contacts import penalty_modulus
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.supports import Loose, bodies_of, body_nodes, bonded_groups
from tribox.app.equilibrium.unknowns import Platen
from tribox.forms.bodies.loads import Foundation, owned_values
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
    return bool(problem.comm.allreduce(bool(np.isin(some, dofs).any()), op=MPI.LOR))


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
    """Whether a body's load drives it into contact ``index``, which it has reached; collective."""
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


MOST = 12  # groups of bodies and tools up to which all sets of them are looked at
ACROSS = 0.5  # component over the resultant of pressures from which on it is across the contact


class GivenForces:
    """Which share of each contact's force nothing gives, so that what is soft costs some of it.

    Of a set S of bodies and tools with one side of the contact in it, and not the other, the force
    F on S is balanced by what is given (loads, weight, inertia) and by what answers to
    displacements: reactions of supports and moved tools, and other contacts between S and the rest.
    F can change by no more than these do. The share is their resultant over F, across the contact,
    for the set in which it is the least: none under a platen's force or for a strip on a floor, all
    of it for a block whose two sides are moved, or for loose blocks between two that are.
    """

    def __init__(self, problem: Equilibrium) -> None:
        """Sort bodies and tools into those that ties or nodes join; collective."""
        self._problem = problem
        number: dict[str, int] = {}
        for at, group in enumerate(bonded_groups(problem)):
            number |= {solid.name: at for solid in group}
        number |= {tool.name: len(number) + at for at, tool in enumerate(problem.tools)}
        pairs = [bodies_of(problem, term) for term in problem.contacts]
        sides = [(pair.slave.name, pair.master.name) for pair in pairs]
        for term, (one, other) in zip(problem.contacts, sides, strict=True):
            if term.tied and term.active:
                kept, gone = number[one], number[other]
                number = {name: kept if at == gone else at for name, at in number.items()}
        names = list(dict.fromkeys(number.values()))
        self._pairs = [tuple(names.index(number[name]) for name in side) for side in sides]
        self._nodes: list[list[Ints]] = [[] for _ in names]
        for solid in problem.solids:
            mine = self._nodes[names.index(number[solid.name])]
            mine.append(body_nodes(problem, solid.cells))
        self._tools = [(tool, names.index(number[tool.name])) for tool in problem.tools]
        most = 2 if len(names) > MOST else len(names)
        sets = [c for n in range(1, most + 1) for c in combinations(range(len(names)), n)]
        self._sets = np.zeros((len(sets), len(names)), dtype=bool)
        for row, members in zip(self._sets, sets, strict=True):
            row[list(members)] = True

    def answering(
        self, trials: Sequence[ContactTrial], approach: float, balanced: bool
    ) -> list[float]:
        """Share of each contact's force that is not given, at most 1; collective.

        ``approach``: m, of bodies beside springs; not ``balanced``: explicit, inertia answers too.
        """
        problem = self._problem
        terms, dim = problem.contacts, problem.dim
        local = [term.surface.slave.weight @ trial.traction for term, trial in zip(terms, trials)]
        load = [term.surface.slave.weight * trial.pressure for term, trial in zip(terms, trials)]
        pressed = [one @ trial.kinematics.normal for one, trial in zip(load, trials)]
        size = [[one.sum()] for one in load]
        parts = [np.reshape(part, (-1, dim)) for part in (local, pressed)]
        total = problem.comm.allreduce(np.column_stack([*parts, size]))
        forces, across, normal = total[:, :dim], np.abs(total[:, dim:-1]), total[:, -1]
        inside = np.array([self._sets[:, pair] for pair in self._pairs])  # (k, s, 2)
        # +1 where the slave is in the set, -1 where the master is, 0 of both or none.
        sign = inside[..., 0].astype(float) - inside[..., 1]
        held = self._by_group(_support_forces(problem, approach))
        onto = self._sets @ held + np.einsum("ks,ki->si", sign, forces)
        # Rings answer to radial forces too: all but what loads.
        loaded = slice(None if not balanced else int(terms[0].surface.axisymmetric))
        if loaded.stop != 0:
            given = self._by_group(_given_forces(problem, approach))
            onto[:, loaded] = -(self._sets @ given[:, loaded])
        out = []
        for index, force in enumerate(forces):
            of_set = sign[index] != 0.0
            rest = onto[of_set] - sign[index, of_set, None] * force
            # Friction across these axes may be given without what presses being so.
            least = ACROSS * max(float(np.linalg.norm(across[index])), ACROSS * normal[index])
            shares = [
                float(np.abs(rest[:, axis]).min()) / max(abs(force[axis]), ACROSS * least)
                for axis in range(dim)
                if of_set.any() and across[index, axis] > least
            ]
            out.append(float(min([1.0, *shares])))
        return out

    def _by_group(self, held: Floats) -> Floats:
        """Sums (g, i), N (N/m), over each group of forces (n,) on owned unknowns; collective."""
        dim = self._problem.dim
        local = np.zeros((len(self._nodes), dim))
        for row, nodes in zip(local, self._nodes, strict=True):
            for mine in nodes:
                row += held.reshape(-1, dim)[mine].sum(axis=0)
        for tool, at in self._tools:
            local[at] += held[tool.dofs[:dim]] * tool.here[:dim]
        return self._problem.comm.allreduce(local)


def _support_forces(problem: Equilibrium, approach: float) -> Floats:
    """Forces (n,), N, of all that answers to displacements, on the owned unknowns; collective.

    Of a spring beside bodies that give way by ``approach`` (m) its part: they are in series.
    """
    held, dofs = np.zeros(problem.owned), problem.constrained_dofs()
    slanted = problem.constraints.slanted
    for platen in (p for p in slanted if p.acts and p.displacement is not None):
        held[platen.dofs] += np.outer(platen.along(problem.unbalanced), platen.normal).reshape(-1)
    held[dofs] = problem.unbalanced[dofs]
    for aligned in (p for p in problem.constraints.aligned if p.loaded):
        held[aligned.dofs] += _of_spring(problem, aligned, approach)
    for rest in problem.rests():
        held -= rest.force(problem.u.x.array[: problem.owned])
    return held + _foundations(problem)


def _given_forces(problem: Equilibrium, approach: float) -> Floats:
    """Forces (n,), N, of loads and platens that answer to nothing, as above; collective."""
    given = problem.load_forces() - _foundations(problem)
    for platen in (p for p in problem.constraints.aligned if p.loaded):
        pull = platen.force + platen.stiffness * (platen.end - problem.u.x.array[platen.dofs])
        given[platen.dofs] += pull / len(platen.all_dofs) - _of_spring(problem, platen, approach)
    return given


def _of_spring(problem: Equilibrium, platen: Platen, approach: float) -> Floats:
    """The part (d,), N, of a platen's spring that answers, on its owned unknowns."""
    drawn = platen.end - problem.u.x.array[platen.dofs]
    part = approach / (approach + np.abs(drawn) + np.finfo(float).tiny)
    return platen.stiffness * drawn * part / len(platen.all_dofs)


def _foundations(problem: Equilibrium) -> Floats:
    """Forces (n,), N, of elastic foundations on the owned unknowns; collective."""
    forces = np.zeros(problem.owned)
    for load in problem.loads:
        if isinstance(load, Foundation) and load.acts:
            values = owned_values(problem.space, load.residual)
            forces[: len(values)] -= values
    return forces


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
    # (i,), N (N/m), normal forces of all points, by the squares of their normals' components
    across: Floats = field(default_factory=lambda: np.zeros(0))


def hold_of(problem: Equilibrium, held: Sequence[str], trials: Sequence[ContactTrial]) -> Hold:
    """What all contacts together hold a body with, at the states ``trials``; collective."""
    contacts = []
    parts = np.zeros(3 * problem.dim + 2)
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
        normal = trial.kinematics.normal
        pressed: Floats = sign * (load @ normal)
        parts += np.concatenate([friction, pressed, load @ normal**2, limits])
    total: Floats = problem.comm.allreduce(parts)
    friction, pressure, across = total[:-2].reshape(3, -1)
    wet = bool(total[-1] > 0.0)
    return Hold(tuple(contacts), friction, pressure, float(total[-2]), wet, across)


def facing(problem: Equilibrium, held: Sequence[str]) -> Floats:
    """Mean direction (i,) of what could press on a body; parts below a half are 0; collective."""
    parts = np.zeros(problem.dim + 1)
    for term, trial in zip(problem.contacts, problem.trials, strict=False):
        bodies = bodies_of(problem, term)
        if (bodies.slave.name in held) == (bodies.master.name in held):
            continue
        weight = term.surface.slave.weight * trial.projection.on_surface
        sign = 1.0 if bodies.slave.name in held else -1.0
        parts[:-1] += sign * (weight @ trial.kinematics.normal)
        parts[-1] += weight.sum()
    *total, area = problem.comm.allreduce(parts)
    mean = np.array(total) / area if area > 0.0 else np.zeros(problem.dim)
    return np.where(np.abs(mean) < 0.5, 0.0, mean)


def _dry_share(term: ContactTerm, state: FrictionState) -> Floats:
    """How much of mu p the asperities of each point carry, (q,): 1 - alpha beside a film."""
    law = term.law.law if isinstance(term.law, FactoredLaw) else term.law
    if isinstance(law, FrictionMap) and law.parameters.flow_rule == "weighted":
        return 1.0 - state.alpha
    return np.ones(len(term.surface.slave.weight))
