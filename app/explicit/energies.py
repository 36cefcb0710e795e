"""What supports, platens and loads do to the energy of an explicit run, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.bodies import Bodies
from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Kept, Partial, Remembers, Snapshot, scattered
from tribox.app.equilibrium.unknowns import box_of, place_of_largest, place_text
from tribox.app.explicit.leap_frog import ExplicitState, LeapFrog
from tribox.forms.bodies.materials import oedometric_modulus
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.facets import Floats, Ints

# -- What ends an explicit run: an inverted element, or more energy than was ever supplied ---------


class ExplicitError(Exception):
    """The motion cannot be followed any further.

    Attributes:
        reason: what happened; place: where, m, undeformed; time: when, s since the start.
    """

    def __init__(self, reason: str, place: tuple[float, ...], time: float) -> None:
        super().__init__(f"{reason} at {place_text(place)}, undeformed")
        self.reason, self.place, self.time = reason, place, time


def folded(problem: Equilibrium, time: float) -> ExplicitError:
    """The error for an element that is inside out; collective."""
    u = problem.u.x.array
    cells = np.asarray(problem.space.dofmap.list)[
        np.concatenate([solid.cells for solid in problem.solids])
    ]
    reference = problem.space.tabulate_dof_coordinates()[:, : problem.dim]
    current = reference + u.reshape(-1, problem.dim)
    with np.errstate(invalid="ignore", over="ignore"):
        ratio = (_corner_jacobians(current[cells]) / _corner_jacobians(reference[cells])).min(0)
    # What has overflowed is worse than what is turned inside out.
    ratio = np.where(np.isfinite(ratio), ratio, -np.inf)
    mine: tuple[float, tuple[float, ...]] = (np.inf, ())
    if len(cells):
        at = int(np.argmin(ratio))
        mine = (float(ratio[at]), tuple(map(float, reference[cells[at]].mean(axis=0))))
    place = min(problem.comm.allgather(mine))[1]
    return ExplicitError("an element has been turned inside out", place, time)


def _corner_jacobians(x: Floats) -> Floats:
    """Determinants (b, c) of the edges at each corner b of cells with corners (c, a, i)."""
    dim = x.shape[2]
    if x.shape[1] == dim + 1:
        corners = [(0, list(range(1, dim + 1)))]
    else:  # tensor order: neighbours differ in one bit
        corners = [(a, [a ^ (1 << k) for k in range(dim)]) for a in range(1 << dim)]
    return np.stack([np.linalg.det(x[:, others] - x[:, a : a + 1]) for a, others in corners])


def energy_roundoff(problem: Equilibrium) -> float:
    """Energy that rounding errors may hold, J/m, far below any of interest; collective.

    It is what noise in the forces excites, and that of an energy which is a difference of numbers
    as large as the modulus, as Ogden's is: by strains of 1e-7 of all that a box round the bodies
    holds.
    """
    box = box_of(problem.comm, problem.space.tabulate_dof_coordinates()[:, : problem.dim])
    volume = float(np.prod(np.ptp(box, axis=0)))
    if problem.solids[0].section == "axisymmetric":
        volume *= 2.0 * np.pi * float(box[1, 0])
    stiffest = max(oedometric_modulus(solid.material) for solid in problem.solids)
    return 1e6 * problem.roundoff**2 / stiffest + 1e-14 * stiffest * volume


class EnergyWatch(Remembers):
    """Holds the stored energy against all that was ever supplied.

    Supports, loads and the start supply energy; dissipation only takes. So the strain, kinetic and
    interface energy together can never exceed the supply, but for errors of the integration.
    """

    _supplied: Kept[float]
    _work: Kept[float]
    _roundoff: Kept[float]

    def __init__(self, problem: Equilibrium, limit: float, stored: float) -> None:
        """Begin with the energy that is stored at the start; ``stored``: J/m, of all ranks."""
        self._problem, self._limit = problem, limit
        self._supplied = stored
        self._work = 0.0
        self._roundoff = energy_roundoff(problem)

    def check(self, stored: float, work: float, time: float, moving: Floats) -> None:
        """ExplicitError if more energy, J/m of all ranks, is stored than was supplied; collective.

        ``time``: s; ``moving``: (n,), J/m, m v² of the owned unknowns.
        """
        # Only what comes in: where loads take work back the bound stays one, if a looser one.
        self._supplied += max(work - self._work, 0.0)
        self._work = work
        if not np.isfinite(stored):
            raise folded(self._problem, time)
        if not stored <= self._limit * self._supplied + self._roundoff:
            times = stored / self._supplied if self._supplied > 0.0 else np.inf
            raise ExplicitError(
                f"the energy runs away ({times:.3g} times all that was ever supplied), fastest",
                place_of_largest(np.nan_to_num(moving, nan=np.inf), self._problem.space),
                time,
            )


# -- What supports, platens and loads do to the energy of an explicit run, step by step ------------


@dataclass(frozen=True, slots=True)
class LoadForces:
    """Forces from outside at a whole step, N per unit thickness."""

    supports: Floats  # (c,) on the constrained unknowns
    loads: Floats | None  # residual of all loads, local unknowns; None where there are none
    platens: Floats  # (p,) on the platens, the same on all ranks


class Energies:
    """Work done on the bodies, and the energy that they and the contacts hold.

    This rank's ``work`` of supports, platens and loads, and what was ``damped``, J/m.
    """

    def __init__(
        self,
        problem: Equilibrium,
        state: ExplicitState,
        mass: Floats,
        bodies: Bodies,
        forces: LoadForces,
    ) -> None:
        """Begin at a state; ``mass``: (n,), kg per unit thickness, lumped."""
        self.work = self.damped = 0.0
        self._problem, self._state, self._mass, self._bodies = problem, state, mass, bodies
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
        """Add the work over the step just made, by the trapezoidal rule, and what was damped, J/m.

        Supports also move the mass of the unknowns they constrain.
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
        """Go on from :meth:`snapshot`, at its state; the forces from outside, loads as they are."""
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
        """Strain, interface and kinetic energy, J/m; collective."""
        problem = self._problem
        local = self._bodies.strain_energy()
        pairs = zip(problem.contacts, trials, strict=True)
        local += sum(term.interface_energy(trial) for term, trial in pairs)
        return float(problem.comm.allreduce(local, op=MPI.SUM)) + self.kinetic()
