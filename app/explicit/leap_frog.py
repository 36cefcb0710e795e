"""One step of central differences: velocities to the next half step, displacements to the whole.

Prescribed unknowns follow their programs. A platen is a rigid edge: its velocity and displacement
are followed beside those of its unknowns, the same numbers on all ranks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import dolfinx
import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.constraints import Platen
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Kept, Remembers
from tribox.geometry.surfaces.facets import Floats, Ints
from tribox.geometry.surfaces.surface import NodalVector, SurfaceExchange

# -- The state of an explicit run: displacements at whole steps, velocities at half steps ----------


class ExplicitState:
    """Nodal vectors and the time that they belong to.

    Attributes:
        u: m, displacements at the last whole step, in the memory of the problem's function.
        v: m/s, velocities at the last half step; a: m/s², accelerations at the last whole step.
        time: s, since the start; steps: so far; last_dt: s, length of the last step, 0 where the
            velocities are those of the last whole step (at the start and after a rest).
    """

    def __init__(
        self,
        u: dolfinx.fem.Function,
        displacement: Floats | None = None,
        velocity: Floats | None = None,
    ) -> None:
        """Take over displacements (m) and velocities (m/s) (n,) of owned unknowns; collective."""
        space = u.function_space
        self.u = NodalVector(space, u.x)
        self.v, self.a = NodalVector(space), NodalVector(space)
        if displacement is not None:
            self.u.owned[:] = displacement
        if velocity is not None:
            self.v.owned[:] = velocity
        self.time, self.steps, self.last_dt = 0.0, 0, 0.0


# -- Accelerations from forces: lumped masses, constrained unknowns, rigid platens -----------------


class LumpedDynamics:
    """From forces to accelerations.

    A platen is a rigid edge: its unknowns share the sum of the forces and of the masses, to which
    it adds a mass of its own.

    Attributes:
        mass: (n,), kg per unit thickness, owned unknowns; a platen's own mass is on its leader.
        inverse: (n,), 1/mass, 0 at constrained unknowns.
        platens: the platens; platen_mass: (p,), kg, their summed masses.
        springs: (n,), N/m per unit thickness, of foundations at the owned unknowns, from above.
        no_pull: (p,) zeros, for platens without a force.
    """

    def __init__(
        self,
        mass: Floats,
        constrained: Ints,
        platens: Sequence[Platen],
        first: int,
        dim: int,
        comm: MPI.Comm,
    ) -> None:
        """Sum the platens' masses; collective; ``mass``: (n,) lumped mass of the owned unknowns."""
        self.mass, self.dim = mass.copy(), dim
        self.platens, self.comm = list(platens), comm
        # Platens whose first unknown is this rank's, and its number.
        own = [(int(p.all_dofs[0]) - first, p) for p in self.platens if len(p.all_dofs)]
        self._leaders = [(at, platen) for at, platen in own if 0 <= at < len(mass)]
        for leader, platen in self._leaders:
            self.mass[leader] += platen.mass
        self.platen_mass = self.sums(self.mass)
        self.springs: Floats = np.zeros(len(mass))
        self.constrain(constrained)
        self.no_pull: Floats = np.zeros(len(self.platens))

    def constrain(self, constrained: Ints) -> None:
        """From now on these owned unknowns follow a program."""
        self.inverse: Floats = np.zeros_like(self.mass)  # what carries no body has no mass
        np.divide(1.0, self.mass, out=self.inverse, where=self.mass > 0.0)
        self.inverse[constrained] = 0.0
        # As accelerations are −r/m: one pass over the unknowns in each step.
        self._negative = -self.inverse

    def sums(self, values: Floats) -> Floats:
        """Sum of ``values`` (n,) over each platen's unknowns (p,); collective."""
        return self._summed(np.array([values[p.dofs].sum() for p in self.platens]))

    def _summed(self, local: Floats) -> Floats:
        if self.comm.size == 1:
            return local
        total = np.empty_like(local)
        self.comm.Allreduce(local, total, op=MPI.SUM)
        return total

    def accelerate(
        self, residual: Floats, pull: Floats, out: Floats, valid: bool = True
    ) -> tuple[Floats, bool]:
        """Accelerations −r/m (n,) into ``out``, and of platens (p,), m/s²; whether all are valid.

        Of forces (n,), N, less the loads', and ``pull`` (p,), N, on each platen; collective.
        """
        np.multiply(residual, self._negative, out=out)
        if not self.platens and self.comm.size == 1:
            return self.no_pull, valid
        # Whether forces are valid travels with the sums: one message, and all ranks judge alike.
        local = np.array([residual[p.dofs].sum() for p in self.platens] + [float(not valid)])
        total = self._summed(local)
        platens: Floats = (pull - total[:-1]) / self.platen_mass
        for platen, value in zip(self.platens, platens, strict=True):
            out[platen.dofs] = value
        return platens, bool(total[-1] == 0.0)

    def accelerate_at(self, dofs: Ints, residual: Floats, out: Floats) -> None:
        """Renew the accelerations of owned unknowns ``dofs`` that belong to no platen."""
        out[dofs] = residual[dofs] * self._negative[dofs]

    def touched(self, pairs: Iterable[SurfaceExchange], scratch: NodalVector) -> Ints | None:
        """Owned unknowns that the pairs' loads can reach; None if one is a platen's; collective."""
        scratch.owned[:] = 0.0
        for pair in pairs:
            pair.add(np.ones((len(pair.nodes), self.dim)), scratch)
        found = np.nonzero(scratch.owned)[0].astype(np.int32)
        meets = any(np.intersect1d(found, platen.dofs).size for platen in self.platens)
        return None if self.comm.allreduce(meets, op=MPI.LOR) else found

    def dot(self, a: Floats, b: Floats) -> float:
        """Inner product aᵀM b over all ranks; collective."""
        return float(self.comm.allreduce(float(np.dot(a * self.mass, b)), op=MPI.SUM))

    def project(self, w: Floats) -> Floats:
        """The part of ``w`` (n,) that supports and platens allow, M-orthogonal; collective."""
        out: Floats = np.where(self.inverse > 0.0, w, 0.0)
        # M-orthogonal: the platen takes the mean of its nodes weighted by their masses.
        means = self.sums(self.mass * out) / self.platen_mass
        for platen, mean in zip(self.platens, means, strict=True):
            out[platen.dofs] = mean
        return out

    def add_springs(self, w: Floats, out: Floats) -> None:
        """Add the forces of springs stretched by ``w`` (n,) to ``out``: platens', foundations'."""
        out += self.springs * w
        for leader, platen in self._leaders:
            out[leader] += platen.stiffness * w[leader]


# -- One step of central differences: velocities to the next half step, displacements to the whole -


class LeapFrog(Remembers):
    """Moves a state from one whole step to the next; c are constrained unknowns, p platens.

    ``travel`` (c,), m, in the last step; platen_acceleration (p,), m/s², to be set before a step;
    platen_velocity, m/s, and platen_displacement, m, (p,).
    """

    platen_acceleration: Kept[Floats]  # the same on all ranks
    platen_velocity: Kept[Floats]
    platen_displacement: Kept[Floats]

    def __init__(
        self, problem: Equilibrium, state: ExplicitState, dynamics: LumpedDynamics, damping: float
    ) -> None:
        """Find the platens' motion; collective; ``damping``: 1/s, c of the damping force c m v."""
        self._state, self._damping, self._mass = state, damping, dynamics.mass
        self._prescribed = problem.prescribed
        self._change = np.zeros_like(state.v.owned)
        self._mean = np.zeros_like(state.v.owned)
        self.constrain(problem.constrained_dofs())
        self.platen_acceleration = dynamics.no_pull
        # Means weighted by mass keep the momentum of nodes that come with unlike velocities.
        masses = dynamics.platen_mass
        self.platen_velocity: Floats = dynamics.sums(self._mass * state.v.owned) / masses
        self.platen_displacement: Floats = dynamics.sums(self._mass * state.u.owned) / masses

    def constrain(self, dofs: Ints) -> None:
        """From now on these owned unknowns follow their programs."""
        self._constrained = dofs
        self.travel: Floats = np.zeros(len(dofs))

    def move(self, dt: float) -> float:
        """Velocities of the next half step, displacements of the next whole one; collective.

        Returns what the damping took, J/m, this rank's part.

        Args:
            dt: s, length of the step.
        """
        state, damped = self._state, 0.0
        # Velocities go from the middle of the last step to that of this one; after a rest, where
        # they are those of the whole step, last_dt is 0.
        mean, u = 0.5 * (state.last_dt + dt), state.u.owned
        before = u[self._constrained]
        change: Floats = mean * self.platen_acceleration
        if self._damping > 0.0:
            damped = self._damp(mean)
            # The damping force at the mean of both half-step velocities is solved for, so that it
            # does not bound the step.
            b = 0.5 * self._damping * mean
            change = np.asarray((change - 2.0 * b * self.platen_velocity) / (1.0 + b))
            np.multiply(state.v.owned, dt, out=self._change)
            u += self._change
        else:  # by PETSc, as one pass each
            state.v.vec.axpy(mean, state.a.vec)
            state.u.vec.axpy(dt, state.v.vec)
        self.platen_velocity = self.platen_velocity + change
        self.platen_displacement = self.platen_displacement + dt * self.platen_velocity
        for part in self._prescribed:
            if part.acts:
                u[part.dofs] = part.value
        self.travel = u[self._constrained] - before
        # So that taking a step back, u − v Δt, is right for what follows a program too.
        state.v.owned[self._constrained] = self.travel / dt
        state.u.update_ghosts()
        return damped

    def _damp(self, dt: float) -> float:
        """Change the velocities with the damping's force at the mean of both; what it took, J/m.

        With b = c Δt/2 the change is (Δt a − 2 b v⁻)/(1 + b).
        """
        v, b = self._state.v.owned, 0.5 * self._damping * dt
        np.multiply(v, -2.0 * b / dt, out=self._change)
        self._change += self._state.a.owned
        self._change *= dt / (1.0 + b)
        mean = self._mean
        np.multiply(self._change, 0.5, out=mean)
        mean += v
        # What follows a program is not slowed: damping takes nothing there.
        mean[self._constrained] = 0.0
        np.multiply(mean, mean, out=mean)
        v += self._change
        return self._damping * dt * float(np.dot(self._mass, mean))

    def take_back(self, dt: float) -> None:
        """Return to the displacements before the last step, of ``dt`` (s); collective."""
        self._state.u.owned -= dt * self._state.v.owned
        self._state.u.update_ghosts()

    def rest(self) -> None:
        """Stop all motion but that of the prescribed unknowns."""
        v = self._state.v.owned
        constrained = v[self._constrained]
        v[:] = 0.0
        v[self._constrained] = constrained
        self.platen_velocity = np.zeros_like(self.platen_velocity)
        self._state.last_dt = 0.0
