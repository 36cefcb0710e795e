"""Weak springs for bodies that nothing holds at present: those that float, or only rest somewhere.

A body that springs back when its tools leave has no support and no load: every place is as good as
another, and the tangent is singular. It is held by springs from where it was at the last converged
state. Their force vanishes as the body comes to rest, and is at most ``SHARE`` of the largest force
of the run, or the step is refused: then a load drives the body away.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.step_mode import HoldingSprings
from tribox.app.equilibrium.supports import FreeBody, bodies_of, free_bodies
from tribox.app.implicit.loose_bodies import nodal_shares
from tribox.geometry.surfaces.facets import Floats

SHARE = 1e-6
"""Largest force of the springs of a body, and least contact force that holds one, over the largest
force of the run."""


@dataclass(slots=True)
class WeakHold:
    """Springs for the free bodies of a problem.

    Attributes:
        problem: the equilibrium; bodies: that its supports leave free.
        pairs: of each body, the contacts on it.
        shares: (m,) of the owned nodes in the volume of their bodies.
    """

    problem: Equilibrium
    bodies: list[FreeBody] = field(init=False)
    pairs: list[list[int]] = field(init=False)
    shares: Floats = field(init=False)

    def __post_init__(self) -> None:
        """Find the bodies; collective."""
        self.bodies = free_bodies(self.problem)
        self.pairs = [self._pairs_on(body) for body in self.bodies]
        self.shares = nodal_shares(self.problem) if self.bodies else np.empty(0)

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

    def floating(self, largest: float) -> list[str]:
        """The free bodies that no contact presses on, at the last evaluation; collective.

        Args:
            largest: N, force of the run that contact forces are compared with.
        """
        problem = self.problem
        if not self.bodies:
            return []
        pairs = zip(problem.contacts, problem.trials, strict=True)
        local = [float(term.surface.slave.weight @ trial.pressure) for term, trial in pairs]
        force = problem.comm.allreduce(np.array(local, dtype=float))
        return [
            body.name
            for body, pairs_on in zip(self.bodies, self.pairs, strict=True)
            if not any(force[pair] > SHARE * largest for pair in pairs_on)
        ]

    def is_loaded(self, largest: float) -> bool:
        """Whether a load acts on a free body, which springs as weak could not hold; collective.

        Loads along an axis in which a support holds the body are borne by that.

        Args:
            largest: N, force of the run that loads are compared with.
        """
        problem, dim = self.problem, self.problem.dim
        forces = problem.load_forces()
        for platen in problem.platens:
            if platen.displacement is None and len(platen.all_dofs):
                at = platen.dofs
                forces[at] += platen.force / len(platen.all_dofs)
        held, axes = problem.constrained_dofs(), np.arange(dim)
        local = [
            [forces.reshape(-1, dim)[body.nodes].sum(axis=0) for body in self.bodies],
            [np.isin(body.nodes[:, None] * dim + axes, held).sum(axis=0) for body in self.bodies],
        ]
        total, supports = problem.comm.allreduce(np.array(local, dtype=float).reshape(2, -1, dim))
        return bool(np.abs(total[supports == 0.0]).max(initial=0.0) > SHARE * largest)

    def springs(self, place: Floats, largest: float) -> HoldingSprings:
        """Springs of all free bodies, without force at ``place`` (n,), m.

        A body that moves by its own extent stretches them to ``SHARE`` of ``largest`` (N).
        """
        stiffness, dim = np.zeros_like(place), self.problem.dim
        for body in self.bodies:
            groups = len(body.joined.groups)  # each has shares that add up to one
            each = SHARE * largest / (body.extent * groups) * self.shares[body.nodes]
            for component in range(dim):
                stiffness[body.nodes * dim + component] += each
        return HoldingSprings(stiffness, place.copy(), weak=True)

    def strain(self, springs: HoldingSprings, at: Floats) -> float:
        """Sum of the magnitudes of all forces of springs at ``at`` (n,), m, in N; collective."""
        free = np.ones(len(at))
        free[self.problem.constrained_dofs()] = 0.0
        local = float(np.abs(free * springs.force(at)).sum())
        return float(self.problem.comm.allreduce(local))
