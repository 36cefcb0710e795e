"""One step of central differences: velocities to the next half step, displacements to the whole.

Prescribed unknowns follow their programs. A platen is a rigid edge: its velocity and displacement
are followed beside those of its unknowns, the same numbers on all ranks.
"""

from __future__ import annotations

import numpy as np

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.explicit.lumped_dynamics import LumpedDynamics
from tribox.app.explicit.state import ExplicitState
from tribox.geometry.surfaces.facets import Floats, Ints


class LeapFrog:
    """Moves a state from one whole step to the next.

    Attributes:
        travel: (c,), m, what the constrained unknowns moved by in the last step.
        platen_acceleration: (p,), m/s², at the last whole step; to be set before a step.
        platen_velocity: (p,), m/s, at the last half step; platen_displacement: (p,), m.
    """

    def __init__(
        self,
        problem: Equilibrium,
        state: ExplicitState,
        dynamics: LumpedDynamics,
        damping: float,
    ) -> None:
        """Find the platens' motion; collective.

        Args:
            problem: its prescribed displacements and platens.
            state: what is moved.
            dynamics: lumped masses.
            damping: 1/s, c of the damping force c m v.
        """
        self._state, self._damping, self._mass = state, damping, dynamics.mass
        self._prescribed = problem.prescribed
        self._change = np.zeros_like(state.v.owned)
        self._mean = np.zeros_like(state.v.owned)
        self.constrain(problem.constrained_dofs())
        self.platen_acceleration = dynamics.no_pull
        masses = dynamics.platen_mass
        self.platen_velocity: Floats = dynamics.sums(self._mass * state.v.owned) / masses
        self.platen_displacement: Floats = dynamics.sums(self._mass * state.u.owned) / masses

    def constrain(self, dofs: Ints) -> None:
        """From now on these owned unknowns follow their programs."""
        self._constrained = dofs
        self.travel: Floats = np.zeros(len(dofs))

    def move(self, dt: float) -> float:
        """Velocities of the next half step, displacements of the next whole one; collective.

        Args:
            dt: s, length of the step.

        Returns:
            What the damping took, J/m, this rank's part.
        """
        state, damped = self._state, 0.0
        mean, u = 0.5 * (state.last_dt + dt), state.u.owned
        before = u[self._constrained]
        change: Floats = mean * self.platen_acceleration
        if self._damping > 0.0:
            damped = self._damp(mean)
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
        mean[self._constrained] = 0.0
        np.multiply(mean, mean, out=mean)
        v += self._change
        return self._damping * dt * float(np.dot(self._mass, mean))

    def snapshot(self) -> Snapshot:
        """The platens' motion, the same on all ranks."""
        return {
            "acceleration": self.platen_acceleration,
            "velocity": self.platen_velocity,
            "displacement": self.platen_displacement,
        }

    def restore(self, kept: Snapshot) -> None:
        """The platens' motion that :meth:`snapshot` has seen."""
        self.platen_acceleration = kept["acceleration"]
        self.platen_velocity, self.platen_displacement = kept["velocity"], kept["displacement"]

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
