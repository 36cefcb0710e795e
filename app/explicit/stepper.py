"""Explicit dynamics: central differences in the leap-frog form, with lumped masses.

Positions and forces live at whole steps, velocities v at half steps:

    v⁺ = [(1 − c Δt/2) v⁻ + Δt a]/(1 + c Δt/2),   u ← u + Δt v⁺,   a = M⁻¹ (f_ext − f_int − f_c),

c the mass-proportional damping. Every step counts as converged: the contact's history is committed
at its end. Prescribed unknowns follow their programs; a platen's unknowns share their forces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import dolfinx
import numpy as np
from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium, load_residuals
from tribox.app.equilibrium.snapshot import AtPoints, Nodal, Snapshot, of_bodies, of_contacts
from tribox.app.equilibrium.supports import bodies_of
from tribox.app.equilibrium.unknowns import place_text
from tribox.app.explicit.energies import Energies, EnergyWatch, ExplicitError, LoadForces, folded
from tribox.app.explicit.leap_frog import ExplicitState, LeapFrog, LumpedDynamics
from tribox.app.explicit.stable_step import (
    ExplicitOptions,
    MassScaling,
    ScaledMass,
    StableStep,
    StableSteps,
    StepEstimate,
    Stiffness,
    foundation_springs,
    scaled_mass,
    with_tools,
)
from tribox.forms.bodies.materials import oedometric_modulus
from tribox.forms.contact.explicit import ExplicitContact
from tribox.forms.contact.explicit_compiled import explicit_contact
from tribox.forms.contact.law_faults import has_fault, law_fault, law_not_finite
from tribox.forms.contact.state import ContactTrial
from tribox.forms.contact.stiffness import PairStiffness
from tribox.forms.friction.guarded_law import LawError
from tribox.geometry.surfaces.facets import Floats
from tribox.geometry.surfaces.surface import NodalVector

__all__ = ["ExplicitError", "ExplicitOptions", "ExplicitStepper", "MassScaling", "StableStep"]


class ExplicitStepper:
    """Makes explicit steps and keeps their energies.

    Attributes:
        problem: what is solved; its contacts are those of the last committed step; options: how.
        rate_dependent: whether rates count in the contacts' laws.
        state: displacements, velocities, accelerations and the time.
        bodies: their forces; contacts: the pairs; dynamics: lumped masses and platens.
        masses: what mass scaling made of them, without the platens' own.
        energies: work and damping; loads: forces from outside at the last whole step.
        load_residuals: of each load (n,), those at nodes last, N per unit thickness, at local
            unknowns.
    """

    def __init__(
        self,
        problem: Equilibrium,
        options: ExplicitOptions | None = None,
        displacement: Floats | None = None,
        velocity: Floats | None = None,
        rate_dependent: bool = True,
        masses: ScaledMass | None = None,
    ) -> None:
        """Lump the masses and take over a state; collective.

        Args:
            displacement: (n,), m, of the owned unknowns; None: what ``problem.u`` holds.
            velocity: (n,), m/s, of the owned unknowns; None: rest.
            masses: of a run that is resumed; None: scaled for the state taken over.

        Raises:
            ValueError: a body has no density, or there are fields, which have no mass.
        """
        for field in problem.fields:
            raise ValueError(f"{field.name}: fields do not go with explicit steps")
        self.problem, self.options = problem, options or ExplicitOptions()
        self.rate_dependent = rate_dependent
        self.state = ExplicitState(problem.u, displacement, velocity)
        self._residual = NodalVector(problem.space)
        self.load_residuals = load_residuals(problem)
        compiled = self.options.compiled
        self.bodies = problem.bodies
        self.contacts = [explicit_contact(term, compiled) for term in problem.contacts]
        for part in problem.prescribed:
            if part.acts:
                self.state.u.owned[part.dofs] = part.value
        self.state.u.update_ghosts()
        self._evaluate_contacts(1.0)
        pairs = [PairStiffness(contact) for contact in self.contacts]
        self.masses = masses or scaled_mass(problem, self.options.mass_scaling, pairs)
        self.dynamics = LumpedDynamics(
            with_tools(self.masses.mass, problem.tools),
            problem.constrained_dofs(),
            problem.platens,
            problem.first,
            problem.dim,
            problem.comm,
        )
        self.dynamics.springs[:] = foundation_springs(problem)
        self._controls = problem.constraints.controls
        self._start(pairs)

    def _start(self, pairs: list[PairStiffness]) -> None:
        """Forces and accelerations of the state taken over; collective."""
        problem, options, dynamics = self.problem, self.options, self.dynamics
        self._pairs = pairs
        self._motion = LeapFrog(problem, self.state, dynamics, options.damping)
        films = [pair.contact for pair in pairs if pair.viscosity > 0.0]
        self._films = FilmCorrection(films, dynamics, problem.space, options.damping)
        trials, valid = self._forces(1.0)
        if not valid:
            raise self._invalid(0.0)
        problem.trials = trials
        self.loads = self._loads()
        self.energies = Energies(problem, self.state, dynamics.mass, self.bodies, self.loads)
        stiffness = Stiffness(dynamics, self.bodies, self.state.u, problem.space, pairs)
        stable_steps = StableSteps(stiffness, problem.space)
        self._estimate = StepEstimate(stable_steps, options.reestimate_every)
        softer = [bodies_of(problem, term).softer.material for term in problem.contacts]
        self._moduli = [oedometric_modulus(material) for material in softer]
        self._set_dashpots()
        stored = self.energies.stored(trials)
        self._watch = EnergyWatch(problem, options.energy_limit, stored)

    # -- state --------------------------------------------------------------------------------

    @property
    def x(self) -> PETSc.Vec:
        """Displacements as a global vector, m, in the memory of ``problem.u``."""
        return self.state.u.vec

    @property
    def v(self) -> Floats:
        """Velocities (n,) of the owned unknowns at the last half step, m/s."""
        return self.state.v.owned

    @property
    def whole_step_velocity(self) -> Floats:
        """Velocities (n,) of the owned unknowns at the last whole step, m/s."""
        return self.v + 0.5 * self.state.last_dt * self.a

    @property
    def a(self) -> Floats:
        """Accelerations (n,) of the owned unknowns at the last whole step, m/s²."""
        return self.state.a.owned

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self.state.time

    @property
    def steps(self) -> int:
        """Steps so far."""
        return self.state.steps

    @property
    def residual(self) -> Floats:
        """Forces (n,) of bodies, contacts and loads on the owned unknowns, the last, N/m."""
        return self._residual.owned

    # -- one step -----------------------------------------------------------------------------

    def advance(self, dt: float) -> None:
        """Make a step of ``dt`` (s) under the present loads, and commit it; collective.

        ExplicitError if a cell turns over or the energy runs away, LawError; displacements stay.
        """
        timer = self.problem.timer
        if self.problem.constraints.controls != self._controls:
            self._constrain()
        with timer("time integration"):
            damped = self._motion.move(dt)
        trials, valid = self._forces(dt)
        with timer("time integration"):
            if not valid:
                error = self._invalid(dt)
                self._motion.take_back(dt)
                raise error
            self._commit(dt, damped + sum(contact.lost for contact in self.contacts), trials)

    def _constrain(self) -> None:
        """Take supports in that act from now on, and let go of those that do no longer; collective.

        What is let go begins to move with the force that the support has carried.
        """
        dofs = self.problem.constrained_dofs()
        self._controls = self.problem.constraints.controls
        self.dynamics.constrain(dofs)
        self._motion.constrain(dofs)
        self.loads = self._loads()
        self.energies.constrain(dofs, self.loads)
        pull = self._pulls()
        platens, _ = self.dynamics.accelerate(self._residual.owned, pull, self.state.a.owned)
        self._motion.platen_acceleration = platens

    def _invalid(self, dt: float) -> Exception:
        """Why the forces after a step of ``dt`` (s) are not valid; collective."""
        contacts = self.problem.contacts
        if fault := law_fault(contacts) or law_not_finite(contacts):
            return LawError(fault)
        return folded(self.problem, self.time + dt)

    def _commit(self, dt: float, damped: float, trials: list[ContactTrial]) -> None:
        """Make the state evaluated last the one that the next step starts from."""
        state, problem = self.state, self.problem
        state.last_dt = dt
        state.time += dt
        state.steps += 1
        for solid in problem.solids:
            solid.commit()
        for contact in self.contacts:
            contact.commit()
        problem.trials = problem.committed = trials
        self.loads = self._loads()
        self.energies.add_step(self.loads, self._motion, damped)
        if state.steps % self.options.reestimate_every == 0:
            self._set_dashpots()
        if state.steps % self.options.check_every == 0:
            stored = self.energies.stored(trials)
            work = float(problem.comm.allreduce(self.energies.work))
            self._watch.check(stored, work, state.time, self.dynamics.mass * state.v.owned**2)

    def _set_dashpots(self) -> None:
        """Fit the contacts' dashpots to the masses they now lie between; collective."""
        scratch = NodalVector(self.problem.space)
        for contact, modulus in zip(self.contacts, self._moduli, strict=True):
            contact.set_dashpots(modulus, self.dynamics.inverse, scratch)

    def _forces(self, dt: float) -> tuple[list[ContactTrial], bool]:
        """Forces and accelerations at the present displacements; collective.

        Returns the contacts; whether no element is turned inside out, and no law has failed.
        """
        state, timer, residual = self.state, self.problem.timer, self._residual
        with_film = bool(self._films.contacts) and self.rate_dependent
        with timer("assembly"):
            # Without rates a step is infinitely long: branches relax, and hardening is that at
            # rest.
            felt = dt if self.rate_dependent else math.inf
            valid = self.bodies.evaluate(state.u.array, residual.array, felt)
            self.load_residuals = load_residuals(self.problem, self.load_residuals)
            for values in self.load_residuals:
                residual.array += values
            residual.collect_ghosts()
        with timer("contact"):
            trials = self._evaluate_contacts(dt)
            valid = valid and not has_fault(self.problem.contacts)
            if with_film:
                self._films.hold()
            for contact in self.contacts:
                contact.add_forces(residual)
        pull = self._pulls()
        platens, valid = self.dynamics.accelerate(residual.owned, pull, state.a.owned, valid)
        if with_film:
            with timer("contact"):
                self._films.correct(state, residual, dt)
                platens = self._films.accelerate(residual.owned, pull, platens, state.a.owned)
        self._motion.platen_acceleration = platens
        return trials, valid

    def _evaluate_contacts(self, dt: float) -> list[ContactTrial]:
        u, rated = self.state.u, self.rate_dependent
        return [contact.evaluate(u, dt, rated) for contact in self.contacts]

    def _pulls(self) -> Floats:
        """Forces (p,) on the platens, N per unit thickness."""
        places = zip(self.problem.platens, self._motion.platen_displacement, strict=True)
        return np.array([platen.pull(float(place)) for platen, place in places])

    def _loads(self) -> LoadForces:
        """Forces from outside at the state evaluated last."""
        return LoadForces(
            supports=self._residual.owned[self.problem.constrained_dofs()],
            loads=np.sum(self.load_residuals, axis=0) if self.load_residuals else None,
            platens=self._pulls(),
        )

    # -- restart ------------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """All that the next step depends on, beside the loads; views, not copies."""
        state, masses, terms = self.state, self.masses, self.problem.contacts
        vectors = {name: Nodal(getattr(state, name).owned) for name in ("u", "v", "a")}
        films = [c.film_arrays() for c in self.contacts]
        dashpots = [(c.by_points, c.dashpot_arrays()) for c in self.contacts]
        return {
            **vectors,
            "residual": Nodal(self._residual.owned),
            "clock": {"time": state.time, "steps": state.steps, "last_dt": state.last_dt},
            "mass": Nodal(masses.mass),
            "masses": [masses.added, masses.original, masses.scaled],
            "pairs": [[pair.tangential, pair.viscosity] for pair in self._pairs],
            "bodies": of_bodies(self.problem.solids),
            "contacts": of_contacts(terms, [term.state for term in terms]),
            "films": [
                {name: AtPoints(pair, a) for name, a in film.items()}
                for pair, film in enumerate(films)
            ],
            "dashpots": [
                {name: AtPoints(pair, a) if by_points else a for name, a in arrays.items()}
                for pair, (by_points, arrays) in enumerate(dashpots)
            ],
            "motion": self._motion.snapshot(),
            "energies": self.energies.snapshot(),
            "watch": self._watch.snapshot(),
            "estimate": self._estimate.snapshot(),
        }

    @staticmethod
    def masses_in(kept: Snapshot) -> ScaledMass:
        """The masses of a :meth:`snapshot`, to make the stepper with."""
        return ScaledMass(kept["mass"], *kept["masses"])

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen; collective.

        The stepper must have been made with its displacements and masses, contacts and loads.
        """
        state = self.state
        for name in ("v", "a"):
            getattr(state, name).owned[:] = kept[name]
        for name, value in kept["clock"].items():
            setattr(state, name, value)
        for pair, (tangential, viscosity) in zip(self._pairs, kept["pairs"], strict=True):
            pair.tangential, pair.viscosity = tangential, viscosity
        for number, contact in enumerate(self.contacts):
            for name, values in contact.film_arrays().items():
                values[:] = kept["films"][number][name]
        self._motion.restore(kept["motion"])
        self.loads = self.energies.restore(kept["energies"])
        self._evaluate_contacts(1.0)
        self._residual.owned[:] = kept["residual"]
        self._watch.restore(kept["watch"])
        self._estimate.restore(kept["estimate"])
        for contact, arrays in zip(self.contacts, kept["dashpots"], strict=True):
            contact.restore_dashpots(**arrays)

    # -- energy -------------------------------------------------------------------------------

    def kinetic_energy(self) -> float:
        """Kinetic energy as central differences conserve it, J/m; collective."""
        return self.energies.kinetic()

    def rest(self) -> None:
        """Stop all motion but that of the prescribed unknowns."""
        self._motion.rest()

    # -- step length --------------------------------------------------------------------------

    def stable_step(self) -> float:
        """The present stable step, s, without safety; estimated again when due; collective."""
        return self.estimate().limit

    def estimate(self) -> StableStep:
        """What the stable step is made of; estimated again when due; collective."""
        return self._estimate.at(self.steps)

    @property
    def limit(self) -> str:
        """What limits the step, and where, by the last estimate; collective if there is none."""
        found = self._estimate.last(self.steps)
        return f"{found.reason} at {place_text(found.place)}"

    def seconds(self) -> dict[str, float]:
        """Seconds of this rank so far in each part of the steps."""
        return dict(self.problem.timer.seconds)


# -- The semi-implicit treatment of the films' viscous stress, over all contacts -------------------
#
# Each point's formula is in `explicit`: the film's traction of the step
# before is held while accelerations are found, then corrected by what an implicit dashpot would
# add.

REFRESH = 25  # steps between two evaluations of the masses that the film moves


class FilmCorrection:
    """Corrects the viscous tractions of the contacts that have a film."""

    def __init__(
        self,
        contacts: Sequence[ExplicitContact],
        dynamics: LumpedDynamics,
        space: dolfinx.fem.FunctionSpace,
        damping: float,
    ) -> None:
        """Find the unknowns that films' forces reach, damped by ``damping``, 1/s; collective."""
        self.contacts = list(contacts)
        self._dynamics, self._damping = dynamics, damping
        self._scratch = NodalVector(space)
        self._touch()

    def _touch(self) -> None:
        """Find the unknowns that the films' forces can reach; collective."""
        self._exchanges = [contact.exchange for contact in self.contacts]
        self._touched = self._dynamics.touched(self._exchanges, self._scratch)

    def hold(self) -> None:
        """Put the films' tractions of the step before in place of those just evaluated."""
        for contact in self.contacts:
            contact.hold_film()

    def correct(self, state: ExplicitState, residual: NodalVector, dt: float) -> None:
        """Correct the films' tractions for the next half step of ``dt``, s; collective."""
        if any(c.exchange is not e for c, e in zip(self.contacts, self._exchanges, strict=True)):
            self._touch()  # contacts know more of their masters now
        if state.steps % REFRESH == 0:
            for contact in self.contacts:
                contact.refresh_compliance(self._dynamics.inverse, self._scratch)
        b = 0.5 * self._damping * dt
        keep, gain = (1.0 - b) / (1.0 + b), dt / (1.0 + b)
        for contact in self.contacts:
            contact.correct_film(state.v, keep, state.a, gain, residual)

    def accelerate(self, residual: Floats, pull: Floats, platens: Floats, out: Floats) -> Floats:
        """Renew the accelerations ``out`` (n,), m/s², where films' forces may have changed them.

        Collective where a film touches a platen. Returns the accelerations of ``platens`` (p,),
        m/s², from ``residual`` (n,), N, with the corrected tractions, and ``pull`` (p,), N.
        """
        if self._touched is None:
            return self._dynamics.accelerate(residual, pull, out)[0]
        self._dynamics.accelerate_at(self._touched, residual, out)
        return platens
