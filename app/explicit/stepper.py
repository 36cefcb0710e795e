"""Explicit dynamics: central differences in the leap-frog form, with lumped masses.

Positions and forces live at whole steps, velocities v at half steps:

    v⁺ = [(1 − c Δt/2) v⁻ + Δt a]/(1 + c Δt/2),   u ← u + Δt v⁺,   a = M⁻¹ (f_ext − f_int − f_c),

c the mass-proportional damping. Every step counts as converged: the contact's history is committed
at its end. Prescribed unknowns follow their programs; a platen's unknowns share their forces.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import dolfinx
import numpy as np
from mpi4py import MPI

from app.equilibrium.equilibrium import Equilibrium
from app.equilibrium.places import place_text
from app.explicit.instability import EnergyWatch, ExplicitError, folded
from app.explicit.lumped_dynamics import LumpedDynamics
from app.explicit.mass_scaling import scaled_mass
from app.explicit.options import ExplicitOptions, MassScaling
from app.explicit.stable_step import StableStep, StableSteps, Stiffness
from forms.bodies.internal_force import InternalForce
from forms.contact.explicit import ExplicitContact
from forms.contact.explicit_compiled import explicit_contact
from forms.contact.stiffness import PairStiffness
from forms.native.libraries import library
from geometry.surfaces.exchange import NodalVector
from geometry.surfaces.facets import Floats

__all__ = ["ExplicitError", "ExplicitOptions", "ExplicitStepper", "MassScaling", "StableStep"]

LEAPFROG: list[Any] = [ctypes.c_int64, ctypes.c_double, ctypes.c_double]
LEAPFROG += [ctypes.c_void_p] * 3
REFRESH = 25  # steps between two looks at which masses the film moves


class ExplicitStepper:
    """Makes explicit steps and keeps their energies.

    Attributes:
        problem: what is solved; options: how.
        x: displacements as a global vector, in the memory of ``problem.u``.
        v: (n,), m/s, velocities of the owned unknowns at the last half step.
        a: (n,), m/s², accelerations at the last whole step.
        mass: (n,), kg per unit thickness, lumped, scaled, with the platens' own.
        time: s, since the start; steps: so far.
        work: J/m, of supports, platens and pressures, this rank's part.
        damped: J/m, taken by mass-proportional damping, this rank's part.
        added_mass, original_mass: kg per unit thickness, by mass scaling and without, of all ranks;
            scaled_share: share of the elements whose mass was raised.
    """

    def __init__(
        self,
        problem: Equilibrium,
        options: ExplicitOptions | None = None,
        displacement: Floats | None = None,
        velocity: Floats | None = None,
    ) -> None:
        """Lump the masses and take over a state; collective.

        Args:
            problem: what is solved; its contacts hold the history of the state.
            options: settings.
            displacement: (n,), m, of the owned unknowns; None: what ``problem.u`` holds.
            velocity: (n,), m/s, of the owned unknowns; None: rest.

        Raises:
            ValueError: a body has no density.
        """
        self.problem, self.options = problem, options or ExplicitOptions()
        self._u = NodalVector(problem.space, problem.u.x)
        self._residual, self._velocity = NodalVector(problem.space), NodalVector(problem.space)
        self._acceleration, self._pressed = NodalVector(problem.space), NodalVector(problem.space)
        self._scratch = NodalVector(problem.space)
        self.x, self.v = self._u.vec, self._velocity.owned
        self.a, self._change = self._acceleration.owned, np.zeros(problem.owned)
        if displacement is not None:
            self._u.owned[:] = displacement
        if velocity is not None:
            self.v[:] = velocity
        self.internal = InternalForce(problem.u, problem.solids, self.options.compiled)
        self.contacts = [explicit_contact(term, self.options.compiled) for term in problem.contacts]
        self.time, self.steps = 0.0, 0
        self.work = self.damped = 0.0
        self._last_dt = 0.0
        for part in problem.prescribed:
            self._u.owned[part.dofs] = part.value
        self._u.update_ghosts()
        for contact in self.contacts:
            contact.evaluate(self._u, 1.0)
        self._pairs = [PairStiffness(contact) for contact in self.contacts]
        masses = scaled_mass(problem, self.options.mass_scaling, self._pairs)
        self.added_mass, self.original_mass = masses.added, masses.original
        self.scaled_share = masses.scaled
        self.dynamics = LumpedDynamics(
            masses.mass,
            problem.constrained_dofs(),
            problem.platens,
            problem.first,
            problem.dim,
            problem.comm,
        )
        self.mass = self.dynamics.mass
        self._start()

    def _start(self) -> None:
        """Forces and accelerations of the state taken over; collective."""
        problem, dynamics = self.problem, self.dynamics
        self._constrained = problem.constrained_dofs()
        self._constrained_mass = self.mass[self._constrained]
        self._platen_speed = dynamics.sums(self.mass * self.v) / dynamics.platen_mass
        self._platen_place = dynamics.sums(self.mass * self._u.owned) / dynamics.platen_mass
        self._pull = self._pulls()
        self._before = self._u.array.copy() if problem.pressures else self._u.array
        implicit = self.options.viscous == "semi-implicit"
        self._films = [
            contact
            for contact, pair in zip(self.contacts, self._pairs, strict=True)
            if implicit and pair.viscosity > 0.0
        ]
        self._touched = dynamics.touched([c.exchange for c in self._films], self._scratch)
        valid = self._forces(1.0)
        if not valid:
            raise folded(problem, self.time)
        self._constrained_force = self._residual.owned[self._constrained]
        self._constrained_energy = 0.5 * float(
            self._constrained_mass @ self.v[self._constrained] ** 2
        )
        self._thrust = self._pressed.array.copy() if problem.pressures else self._pressed.array
        stiffness = Stiffness(dynamics, self.internal, self._u, problem.space, self._pairs)
        self._stable_steps = StableSteps(stiffness, problem.space, film=not implicit)
        self._estimated = -1
        self._estimate: StableStep | None = None
        self._watch = EnergyWatch(problem, self.options.energy_limit, self._stored())
        self._code = library("leapfrog.c") if self.options.compiled else None
        if self._code is not None:
            self._code.tribox_leapfrog.argtypes = LEAPFROG
        moved = (self.a, self.v, self._u.owned)
        self._pointers = tuple(array.ctypes.data for array in moved)

    # -- one step -----------------------------------------------------------------------------

    def advance(self, dt: float) -> None:
        """Make a step of ``dt`` (s) under today's loads, and commit it; collective.

        Raises:
            ExplicitError: an element is turned inside out, and the displacements are again those
                before this step; or the energy runs away.
        """
        timer = self.problem.timer
        with timer("motion"):
            self._move(dt)
        valid = self._forces(dt)
        with timer("motion"):
            if not valid:
                error = folded(self.problem, self.time + dt)
                self._take_back(dt)
                raise error
            self._last_dt = dt
            self.time += dt
            self.steps += 1
            for contact in self.contacts:
                contact.commit()
            self.problem.committed = self.problem.trials
            self._enter_work()
            if self.steps % self.options.check_every == 0:
                self._check_energy()

    def _move(self, dt: float) -> None:
        """Velocities of the next half step and displacements of the next whole one."""
        mean, place = 0.5 * (self._last_dt + dt), self._u.owned
        before = place[self._constrained]
        platens = mean * self._platen_acceleration
        if self.options.damping > 0.0:
            platens = self._damp(mean, platens)
            self.v += self._change
            np.multiply(self.v, dt, out=self._change)
            place += self._change
        else:
            self._leapfrog(mean, dt)
        self._platen_speed = self._platen_speed + platens
        self._platen_place = self._platen_place + dt * self._platen_speed
        for part in self.problem.prescribed:
            place[part.dofs] = part.value
        self._travel = place[self._constrained] - before
        self.v[self._constrained] = self._travel / dt
        self._u.update_ghosts()

    def _take_back(self, dt: float) -> None:
        """Return to the displacements before the last step, those of the committed contacts."""
        self._u.owned -= dt * self.v
        self._u.update_ghosts()

    def _leapfrog(self, mean: float, dt: float) -> None:
        """The kick v += mean a and the drift u += dt v, in one pass where that is compiled."""
        if self._code is not None:
            self._code.tribox_leapfrog(len(self.v), mean, dt, *self._pointers)
            return
        np.multiply(self.a, mean, out=self._change)
        self.v += self._change
        np.multiply(self.v, dt, out=self._change)
        self._u.owned += self._change

    def _damp(self, dt: float, platens: Floats) -> Floats:
        """Changes of the nodes' and the platens' velocities (returned) with damping.

        Its force is at the mean of both velocities: with b = c Δt/2 the change is
        (Δt a − 2 b v⁻)/(1 + b).
        """
        b, mean = 0.5 * self.options.damping * dt, self._scratch.owned
        np.multiply(self.v, -2.0 * b / dt, out=self._change)
        self._change += self.a
        self._change *= dt / (1.0 + b)
        np.multiply(self._change, 0.5, out=mean)
        mean += self.v
        mean[self._constrained] = 0.0
        np.multiply(mean, mean, out=mean)
        self.damped += self.options.damping * dt * float(np.dot(self.mass, mean))
        damped: Floats = np.asarray((platens - 2.0 * b * self._platen_speed) / (1.0 + b))
        return damped

    def _forces(self, dt: float) -> bool:
        """Forces and accelerations at today's displacements; whether no cell is folded."""
        problem, timer, residual = self.problem, self.problem.timer, self._residual
        with timer("assembly"):
            valid = self.internal.evaluate(self._u.array, residual.array)
            self._press()
            residual.collect_ghosts()
        with timer("contact"):
            films = [contact for contact in self._films if contact.term.rate_dependent]
            problem.trials = [contact.evaluate(self._u, dt) for contact in self.contacts]
            for contact in films:
                contact.hold_film()
            for contact in self.contacts:
                contact.add_forces(residual)
        pull = self._pulls()
        valid = self.dynamics.accelerate(residual.owned, pull, self.a, valid)
        if films:
            with timer("contact"):
                self._correct_films(films, dt)
                self.dynamics.accelerate_again(residual.owned, pull, self._touched, self.a)
        # Kept here: estimates of the stable step go through the motion too.
        self._platen_acceleration = self.dynamics.platen_acceleration
        problem.unbalanced = residual.owned
        return valid

    def _press(self) -> None:
        """Add the pressures' forces."""
        if not self.problem.pressures:
            return
        self._pressed.array[:] = 0.0
        for load in self.problem.pressures:
            dolfinx.fem.assemble_vector(self._pressed.array, load.residual)
        self._residual.array += self._pressed.array

    def _correct_films(self, films: Sequence[ExplicitContact], dt: float) -> None:
        """Let the films feel the velocities of the next half step."""
        if self.steps % REFRESH == 0:
            for contact in films:
                contact.refresh_compliance(self.dynamics.inverse, self._scratch)
        b = 0.5 * self.options.damping * dt
        keep, gain = (1.0 - b) / (1.0 + b), dt / (1.0 + b)
        for contact in films:
            contact.correct_film(self._velocity, keep, self._acceleration, gain, self._residual)

    def _pulls(self) -> Floats:
        places = zip(self.problem.platens, self._platen_place, strict=True)
        return np.array([platen.pull(float(place)) for platen, place in places])

    # -- energy -------------------------------------------------------------------------------

    def _enter_work(self) -> None:
        """Work of supports, pressures and platens over the step, by the trapezoidal rule.

        Supports also move the mass of the unknowns they hold.
        """
        constrained = self._constrained
        if len(constrained):
            force, speed = self._residual.owned[constrained], self.v[constrained]
            energy = 0.5 * float(self._constrained_mass @ (speed * speed))
            self.work += 0.5 * float((self._constrained_force + force) @ self._travel)
            self.work += energy - self._constrained_energy
            self._constrained_force, self._constrained_energy = force, energy
        if self.problem.pressures:
            moved = self._u.array - self._before
            self.work -= 0.5 * float((self._thrust + self._pressed.array) @ moved)
            self._before[:] = self._u.array
            self._thrust[:] = self._pressed.array
        pull = self._pulls()
        if self.problem.comm.rank == 0:
            travel = self._last_dt * self._platen_speed
            self.work += 0.5 * float((self._pull + pull) @ travel)
        self._pull = pull

    def _check_energy(self) -> None:
        """Compare the stored energy with what was supplied; collective."""
        work = float(self.problem.comm.allreduce(self.work, op=MPI.SUM))
        self._watch.check(self._stored(), work, self.time, self.mass * self.v**2)

    def _stored(self) -> float:
        """Strain, interface and kinetic energy, J/m; collective."""
        problem = self.problem
        local = self.internal.energy(problem.u.x.array)
        pairs = zip(problem.contacts, problem.trials, strict=True)
        local += sum(term.interface_energy(trial) for term, trial in pairs)
        return float(problem.comm.allreduce(local, op=MPI.SUM)) + self.kinetic_energy()

    def kinetic_energy(self) -> float:
        """½ v⁻·M v⁺ with v⁺ the velocities that follow, J/m; collective.

        This is the energy that central differences conserve; with a start it is ½ v·M v.
        """
        ahead = self.v + self._last_dt * self.a
        local = 0.5 * float(np.dot(self.v * self.mass, ahead))
        return float(self.problem.comm.allreduce(local, op=MPI.SUM))

    def rest(self) -> None:
        """Stop all motion but that of the prescribed unknowns."""
        constrained = self.v[self._constrained]
        self.v[:] = 0.0
        self.v[self._constrained] = constrained
        self._platen_speed = np.zeros_like(self._platen_speed)
        self._last_dt = 0.0

    # -- step length --------------------------------------------------------------------------

    def stable_step(self) -> float:
        """The stable step of today, s, without safety; estimated anew when due; collective."""
        return self.estimate().limit

    def time_step(self) -> float:
        """The step to take, s: the stable one times ``options.dt_safety``; collective."""
        return self.options.dt_safety * self.stable_step()

    def estimate(self) -> StableStep:
        """What the stable step is made of; estimated anew when due; collective."""
        due = self.steps - self._estimated >= self.options.reestimate_every
        if self._estimate is None or due:
            self._estimate = self._stable_steps.estimate()
            self._estimated = self.steps
        return self._estimate

    @property
    def limit(self) -> str:
        """What limits the step, and where, by the last estimate; collective if there is none."""
        found = self._estimate or self.estimate()
        return f"{found.reason} at {place_text(found.place)}"

    def seconds(self) -> dict[str, float]:
        """Seconds of this rank so far in each part of the steps."""
        return dict(self.problem.timer.seconds)
