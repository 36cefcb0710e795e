"""The bodies that contact alone holds, and springs that hold what floats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import dolfinx
import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.step_mode import HoldingSprings
from tribox.app.equilibrium.supports import (
    FreeBody,
    Loose,
    bodies_of,
    body_nodes,
    bonded_groups,
    free_bodies,
    loose_directions,
    sprung_dofs,
)
from tribox.app.equilibrium.unknowns import box_of
from tribox.forms.contact.state import ContactTrial
from tribox.forms.friction.coulomb import FrictionlessLaw
from tribox.geometry.surfaces.facets import Bools, Floats


@dataclass(slots=True)
class LooseBodies:
    """The bodies that contact alone holds, each in one direction."""

    problem: Equilibrium  # the equilibrium
    directions: list[Loose] = field(init=False)  # in which bodies are loose
    shares: Floats = field(init=False)  # (m,) of the owned nodes in the volume of their bodies

    def __post_init__(self) -> None:
        """Find them; collective."""
        self.directions = loose_directions(self.problem, sprung_dofs(self.problem))
        self.shares = nodal_shares(self.problem) if self.directions else np.empty(0)

    def sums(self, values: Floats) -> Floats:
        """Sum of ``values`` (n,) of the owned unknowns in each direction (d,); collective."""
        dim = self.problem.dim
        local = [values[one.nodes * dim + one.component].sum() for one in self.directions]
        return self.problem.comm.allreduce(np.array(local, dtype=float), op=MPI.SUM)

    def moved(self, increment: Floats) -> Floats:
        """Mean displacement (d,), m, in each direction; collective."""
        dim = self.problem.dim
        return self.sums(np.repeat(self.shares, dim) * increment)

    def unpressed(
        self, among: Bools, trials: Sequence[ContactTrial] | None = None
    ) -> tuple[str, ...]:
        """Bodies loose in directions ``among`` (d,) that nothing pressed last; collective.

        ``trials``: of all contacts, in place of the last.
        """
        problem = self.problem
        pairs = list(zip(problem.contacts, trials or problem.trials, strict=True))
        local = np.array([bool(trial.pressure.any()) for _, trial in pairs], dtype=bool)
        pressed = np.zeros_like(local)
        problem.comm.Allreduce(local, pressed, op=MPI.LOR)  # numbers: objects have no array's or
        ends = [bodies_of(problem, term) for term, _ in pairs]
        touched = {
            name
            for one, presses in zip(ends, pressed, strict=True)
            for name in (one.slave.name, one.master.name)
            if presses and one.slave is not one.master
        }
        loose = [one for one, wanted in zip(self.directions, among, strict=True) if wanted]
        return tuple(sorted({one.body for one in loose if touched.isdisjoint(one.bodies)}))

    def size(self) -> float:
        """Largest extent of the mesh along an axis, m; collective."""
        at = self.problem.space.tabulate_dof_coordinates()[: self.problem.owned // self.problem.dim]
        return float(np.ptp(box_of(self.problem.comm, at), axis=0).max())


def nodal_shares(problem: Equilibrium) -> Floats:
    """Share (n,) of each owned node in the volume of its body, about: without units; collective.

    Bodies that are bonded count as one.

    The volume of a cell is taken as that of a cube on its longest edge, and every node of the cell
    has the same part of it.
    """
    mesh, space = problem.space.mesh, problem.space
    scalar = dolfinx.la.vector(space.dofmap.index_map, 1)
    totals = []
    groups = bonded_groups(problem)
    for group in groups:
        cells = np.concatenate([solid.cells for solid in group])
        size = mesh.h(mesh.topology.dim, cells) ** mesh.topology.dim
        table = space.dofmap.list[cells]
        volume = np.repeat(size / table.shape[1], table.shape[1])
        np.add.at(scalar.array, table.reshape(-1), volume)
        totals.append(problem.comm.allreduce(float(size.sum()), op=MPI.SUM))
    scalar.scatter_reverse(dolfinx.la.InsertMode.add)
    shares: Floats = scalar.array[: problem.owned // problem.dim].copy()
    for group, total in zip(groups, totals, strict=True):
        shares[body_nodes(problem, np.concatenate([solid.cells for solid in group]))] /= total
    for tool in problem.tools:
        shares[tool.node(0)] = shares[tool.node(tool.slots - 1)] = 1.0
    return shares


# -- Weak springs for bodies that nothing holds at present: those that float, or only rest somewhere
#
# A body that springs back when its tools leave has no support and no load: every place is as good
# as another, and the tangent is singular. It is held by springs from where it was at the last
# converged state. Their force vanishes as the body comes to rest, and is at most ``SHARE`` of the
# largest force of the run, or the step is refused: then a load drives the body away. A body that
# tools only carry along, before anything has pressed, is held likewise.


SHARE = 1e-6
"""Largest force of the springs of a body, and least contact force that holds one, over the largest
force of the run."""
SMALL = 1e-4  # rad, turn of which only the first terms count beside rounding
ALIKE = 0.9  # cosine of the angle between forces from which on they have one direction


@dataclass(slots=True)
class WeakHold:
    """Springs for the free bodies of a problem."""

    problem: Equilibrium  # the equilibrium
    bodies: list[FreeBody] = field(init=False)  # that its supports leave free
    pairs: list[list[int]] = field(init=False)  # of each body, the contacts on it
    shares: Floats = field(init=False)  # (m,) of the owned nodes in the volume of their bodies
    unsupported: list[FreeBody] = field(init=False)  # those that no support holds at all
    firm: Floats = field(init=False)  # (b,), N, to compare with before anything has pressed
    slick: Bools = field(init=False)  # (b,) those that nothing rubs on

    def __post_init__(self) -> None:
        """Find the bodies; collective."""
        self.bodies = free_bodies(self.problem)
        self.pairs = [self._pairs_on(body) for body in self.bodies]
        self.shares = nodal_shares(self.problem) if self.bodies else np.empty(0)
        self.firm = self._firm_forces()
        rubs = [not isinstance(term.law, FrictionlessLaw) for term in self.problem.contacts]
        self.slick = np.array([on != [] and not any(rubs[i] for i in on) for on in self.pairs])
        self.unsupported = [body for body in self.bodies if self._is_unsupported(body)]

    def _is_unsupported(self, body: FreeBody) -> bool:
        """Whether a free body may move and turn in all ways; collective."""
        held = self.problem.constrained_dofs() // self.problem.dim
        any_held = self.problem.comm.allreduce(bool(np.isin(body.nodes, held).any()), op=MPI.LOR)
        return not (any_held or body.joined.grips or body.joined.of_revolution)

    def _firm_forces(self) -> Floats:
        """E* times the area of the slave, of the pairs on each body the most, N; collective.

        What rounding leaves follows the stiffest.
        """
        contacts = self.problem.contacts
        forces = [(term.modulus or 0.0) * term.surface.slave.weight.sum() for term in contacts]
        total = self.problem.comm.allreduce(np.array(forces, dtype=float))
        return np.array([total[pairs].max(initial=0.0) for pairs in self.pairs])

    def _pairs_on(self, body: FreeBody) -> list[int]:
        """Contacts of a body with something that it is not joined to; collective."""
        names = body.joined.names
        ends = [bodies_of(self.problem, term) for term in self.problem.contacts]
        return [
            pair
            for pair, one in enumerate(ends)
            if (one.slave.name in names) != (one.master.name in names)
        ]

    def adrift(self, largest: float) -> bool:
        """Whether a body has no contact at all, and no load; collective.

        Args:
            largest: N, force of the run that loads are compared with.
        """
        return any(not pairs for pairs in self.pairs) and not self.is_loaded(largest)

    def floating(self, largest: float, trials: Sequence[ContactTrial] | None = None) -> list[str]:
        """The free bodies that no contact presses on; collective.

        Args:
            largest: N, force of the run that contact forces are compared with.
            trials: the contacts; None: at the last evaluation. Without any, all of the bodies.
        """
        problem = self.problem
        if not self.bodies:
            return []
        trials = problem.trials if trials is None else trials
        if not trials:  # nothing was committed yet
            return [body.name for body in self.bodies]
        pairs = zip(problem.contacts, trials, strict=True)
        local = [float(term.surface.slave.weight @ trial.pressure) for term, trial in pairs]
        force = problem.comm.allreduce(np.array(local, dtype=float))
        return [
            body.name
            for body, pairs_on in zip(self.bodies, self.pairs, strict=True)
            if not any(force[pair] > SHARE * largest for pair in pairs_on)
        ]

    def contact_force(self) -> float:
        """Sum of the normal forces on these bodies at the last evaluation, N; collective."""
        problem, on_bodies = self.problem, {pair for on in self.pairs for pair in on}
        ends = [(problem.contacts[pair], problem.trials[pair]) for pair in on_bodies]
        local = sum(float(term.surface.slave.weight @ trial.pressure) for term, trial in ends)
        return float(problem.comm.allreduce(local))

    def idle_pairs(self, largest: float, trials: Sequence[ContactTrial]) -> frozenset[int]:
        """Contacts of the bodies that :meth:`floating` finds; collective."""
        names = self.floating(largest, trials)
        pairs = zip(self.bodies, self.pairs, strict=True)
        return frozenset(pair for body, on in pairs if body.name in names for pair in on)

    def is_loaded(self, largest: float) -> bool:
        """Whether a load acts on a free body, which springs as weak could not hold; collective.

        Loads that are in balance leave rounding.

        Args:
            largest: N, force of the run that loads are compared with.
        """
        least = max(SHARE * largest, self.problem.roundoff)
        return bool(np.abs(self.loads()).max(initial=0.0) > least)

    def is_let_go(self, largest: float) -> bool:
        """Whether nothing loads a free body any more that contacts pressed on; collective."""
        loads, pressed = self.loads(), self.pressed()
        free, all_ = (np.linalg.norm(forces, axis=1) for forces in pressed)
        none = np.linalg.norm(loads, axis=1) <= SHARE * largest
        return bool(np.any(none & (free > SHARE * largest) & (free >= ALIKE * all_)))

    def is_pulled_off(self, largest: float) -> bool:
        """Whether a load acts on a free body the way contacts pressed on it; collective."""
        loads, (_, pressed) = self.loads(), self.pressed()
        sizes = [np.linalg.norm(forces, axis=1) for forces in (loads, pressed)]
        along = np.einsum("bi,bi->b", loads, pressed) >= ALIKE * sizes[0] * sizes[1]
        return bool(np.any(along & (np.minimum(*sizes) > SHARE * largest)))

    def loads(self) -> Floats:
        """Loads (b, i), N, on the free bodies, 0 along axes that supports hold; collective."""
        problem = self.problem
        forces = problem.load_forces()
        for platen in problem.platens:
            if platen.loaded and len(platen.all_dofs):
                at = platen.dofs
                forces[at] += platen.force / len(platen.all_dofs)
        return self._sums(forces)[0]

    def pressed(self) -> Floats:
        """Forces (2, b, i), N, of contacts on the free bodies at the last step; collective.

        First those along axes in which no support holds, then all.
        """
        pairs = sorted({pair for on in self.pairs for pair in on})
        forces = np.zeros(self.problem.owned)
        for pair in pairs:
            forces += self.problem.pair_forces(pair)
        return self._sums(forces)

    def _sums(self, forces: Floats) -> Floats:
        """Sums (2, b, i) of forces (n,) on each body, none radial: unsupported axes, and all."""
        problem, dim = self.problem, self.problem.dim
        held, axes = problem.constrained_dofs(), np.arange(dim)
        local = [
            [forces.reshape(-1, dim)[body.nodes].sum(axis=0) for body in self.bodies],
            [np.isin(body.nodes[:, None] * dim + axes, held).sum(axis=0) for body in self.bodies],
        ]
        total, supports = problem.comm.allreduce(np.array(local, dtype=float).reshape(2, -1, dim))
        total[[body.joined.of_revolution for body in self.bodies], 0] = 0.0
        return np.stack([np.where(supports == 0.0, total, 0.0), total])

    def springs(self, place: Floats, largest: Floats) -> HoldingSprings:
        """Springs of all free bodies, without force at ``place`` (n,), m.

        A body that moves by its own extent stretches them to ``SHARE`` of its ``largest`` (b,), N.
        """
        stiffness, dim = np.zeros_like(place), self.problem.dim
        for body, force in zip(self.bodies, largest, strict=True):
            groups = len(body.joined.groups)  # each has shares that add up to one
            each = SHARE * force / (body.extent * groups) * self.shares[body.nodes]
            for component in range(dim):
                stiffness[body.nodes * dim + component] += each
        return HoldingSprings(stiffness, place.copy(), weak=True)

    def turn(self, x: PETSc.Vec, y: PETSc.Vec) -> bool:
        """Let unsupported bodies turn as rigid ones by a step −y (m) from x (m); collective.

        A turn W by a linear step stretches them by its square, which leaves millions of times the
        force of weak springs. With R = exp W, arms a from the middle and the rest s − W a of the
        step, R(a + rest) takes the place of a + s. Returns whether ``y`` was changed.
        """
        problem, dim = self.problem, self.problem.dim
        at = problem.space.tabulate_dof_coordinates()[:, :dim]
        for body in self.unsupported:
            dofs = body.nodes[:, None] * dim + np.arange(dim)
            share = self.shares[body.nodes][:, None] / len(body.joined.groups)
            arm, step = at[body.nodes] + x.array_r[dofs], -y.array_r[dofs]
            means = problem.comm.allreduce(np.stack([share * arm, share * step]).sum(axis=1))
            arm, step = arm - means[0], step - means[1]
            local = np.stack([(share * arm).T @ arm, (share * step).T @ arm])
            spin = nearest_spin(*problem.comm.allreduce(local))
            # R − 1 = sin(θ)/θ W + 2 sin²(θ/2)/θ² W², and less W without cancellation.
            angle = np.sqrt(0.5 * np.sum(spin**2))
            beyond = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * spin @ spin
            lag = angle**2 / 6.0 if angle < SMALL else 1.0 - np.sinc(angle / np.pi)
            y.array[dofs] -= arm @ (beyond - lag * spin).T
            y.array[dofs] -= (step - arm @ spin.T) @ (beyond + (1.0 - lag) * spin).T
        return bool(self.unsupported)


def nearest_spin(second: Floats, mixed: Floats) -> Floats:
    """The skew W (i, i) of least Σ w |W a − s|².

    Args:
        second: Σ w a⊗a, (i, i), m², of arms a.
        mixed: Σ w s⊗a, (i, i), m², of steps s.
    """
    dim = len(second)
    pairs = [(i, j) for i in range(dim) for j in range(i)]
    basis = np.zeros((len(pairs), dim, dim))
    for one, (i, j) in zip(basis, pairs, strict=True):
        one[i, j], one[j, i] = 1.0, -1.0
    matrix = np.einsum("aij,jk,bik->ab", basis, second, basis)
    moments = np.einsum("aij,ij->a", basis, mixed)
    return np.einsum("a,aij->ij", np.linalg.solve(matrix, moments), basis)
