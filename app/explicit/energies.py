"""What supports, platens and loads do to the energy of an explicit run, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Partial, Snapshot, scattered
from tribox.app.explicit.leap_frog import LeapFrog
from tribox.app.explicit.state import ExplicitState
from tribox.forms.bodies.internal_force import InternalForce
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.facets import Floats, Ints


@dataclass(frozen=True, slots=True)
class LoadForces:
    """Forces from outside at a whole step, N per unit thickness.

    Attributes:
        supports: (c,) on the constrained unknowns.
        loads: residual of all loads, local unknowns; None where there are none.
        platens: (p,) on the platens, the same on all ranks.
    """

    supports: Floats
    loads: Floats | None
    platens: Floats


class Energies:
    """Work done on the bodies, and the energy that they and the contacts hold.

    Attributes:
        work: J/m, of supports, platens and loads, this rank's part.
        damped: J/m, taken by mass-proportional damping and the contacts' dashpots, this rank's
            part.
    """

    def __init__(
        self,
        problem: Equilibrium,
        state: ExplicitState,
        mass: Floats,
        internal: InternalForce,
        forces: LoadForces,
    ) -> None:
        """Begin at a state.

        Args:
            problem: bodies, contacts and loads.
            state: where the bodies are.
            mass: (n,), kg per unit thickness, lumped.
            internal: the bodies' strain energy.
            forces: from outside, at the state.
        """
        self.work = self.damped = 0.0
        self._problem, self._state, self._mass, self._internal = problem, state, mass, internal
        self.constrain(problem.constrained_dofs(), forces)
        self._before = state.u.array.copy() if forces.loads is not None else None

    def constrain(self, dofs: Ints, forces: LoadForces) -> None:
        """From now on supports act on these owned unknowns; ``forces`` are those at the state."""
        self._constrained, self._forces = dofs, forces
        self._constrained_mass = self._mass[dofs]
        self._constrained_energy = self._of_constrained()

    def _of_constrained(self) -> float:
        """Kinetic energy of the constrained unknowns, J/m, this rank's part."""
        speed = self._state.v.owned[self._constrained]
        return 0.5 * float(self._constrained_mass @ (speed * speed))

    def add_step(self, forces: LoadForces, motion: LeapFrog, damped: float) -> None:
        """Add the work over the step just made, by the trapezoidal rule.

        Supports also move the mass of the unknowns they constrain.

        Args:
            forces: from outside, at the end of the step.
            motion: what made the step.
            damped: J/m, what damping and dashpots took in it.
        """
        state, last = self._state, self._forces
        self.damped += damped
        if len(self._constrained):
            energy = self._of_constrained()
            self.work += 0.5 * float((last.supports + forces.supports) @ motion.travel)
            self.work += energy - self._constrained_energy
            self._constrained_energy = energy
        if self._before is not None:
            assert last.loads is not None and forces.loads is not None
            moved = state.u.array - self._before
            self.work -= 0.5 * float((last.loads + forces.loads) @ moved)
            self._before[:] = state.u.array
        if self._problem.comm.rank == 0:
            travel = state.last_dt * motion.platen_velocity
            self.work += 0.5 * float((last.platens + forces.platens) @ travel)
        self._forces = forces

    def snapshot(self) -> Snapshot:
        """Work so far, and the forces from outside at the last step."""
        supports = scattered(self._constrained, self._forces.supports, len(self._mass))
        return {
            "sums": Partial(np.array([self.work, self.damped])),
            "supports": supports,
            "platens": self._forces.platens,
        }

    def restore(self, kept: Snapshot) -> LoadForces:
        """Go on from what :meth:`snapshot` has seen, at the state that there was.

        Returns:
            The forces from outside; those of loads are the present ones.
        """
        self.work, self.damped = map(float, kept["sums"])
        self._constrained_energy = self._of_constrained()
        self._forces = LoadForces(
            kept["supports"][self._constrained], self._forces.loads, kept["platens"]
        )
        return self._forces

    def kinetic(self) -> float:
        """½ v⁻·M v⁺ with v⁺ the velocities that follow, J/m; collective.

        This is the energy that central differences conserve; with a start it is ½ v·M v.
        """
        state = self._state
        ahead = state.v.owned + state.last_dt * state.a.owned
        local = 0.5 * float(np.dot(state.v.owned * self._mass, ahead))
        return float(self._problem.comm.allreduce(local, op=MPI.SUM))

    def stored(self, trials: Sequence[ContactTrial]) -> float:
        """Strain, interface and kinetic energy, J/m; collective.

        Args:
            trials: the contacts at the state.
        """
        problem = self._problem
        local = self._internal.energy(self._state.u.array)
        pairs = zip(problem.contacts, trials, strict=True)
        local += sum(term.interface_energy(trial) for term, trial in pairs)
        return float(problem.comm.allreduce(local, op=MPI.SUM)) + self.kinetic()

    def work_of_all_ranks(self) -> float:
        """Work since the start, J/m; collective."""
        return float(self._problem.comm.allreduce(self.work, op=MPI.SUM))

    def twice_kinetic(self) -> Floats:
        """Twice the kinetic energy m v² of each owned unknown (n,), J/m, by its last velocity."""
        moving: Floats = self._mass * self._state.v.owned**2
        return moving
