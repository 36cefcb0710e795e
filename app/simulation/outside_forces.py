"""Forces of supports, platens and loads on the bodies, unknown by unknown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.load_residuals import load_residuals
from tribox.app.equilibrium.snapshot import Nodal, Snapshot, scattered
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.geometry.surfaces.exchange import NodalVector
from tribox.geometry.surfaces.facets import Floats, Ints


@dataclass(frozen=True, slots=True)
class OutsideForces:
    """What the surroundings do to the bodies, at a state or in the mean over an interval.

    Attributes:
        held: (c,), N per unit thickness, on the unknowns of :func:`held_dofs`.
        loads: of each load, those at nodes last, N likewise, on all local unknowns (n,): what this
            rank gives, so that sums over ranks are whole.
    """

    held: Floats
    loads: list[Floats]

    @classmethod
    def at(cls, problem: Equilibrium, held: Ints) -> OutsideForces:
        """The forces of the state that was evaluated last."""
        return cls(problem.unbalanced[held], [-load for load in load_residuals(problem)])


def held_dofs(problem: Equilibrium) -> Ints:
    """Owned unknowns that supports or platens act on, sorted."""
    parts = [part.dofs for part in problem.prescribed]
    parts += [platen.dofs for platen in problem.platens]
    out: Ints = np.unique(np.concatenate([*parts, np.empty(0, dtype=np.int32)]))
    return out


class OutsideMean:
    """Mean of the outside forces over an interval of explicit steps.

    What holds an unknown balances the other forces on it and moves its mass.
    """

    def __init__(self, stepper: ExplicitStepper) -> None:
        """Begin an interval at the stepper's state."""
        self._stepper, problem = stepper, stepper.problem
        self._held = held_dofs(problem)
        self._mass = stepper.mass[self._held]
        self._residual = np.zeros(len(self._held))
        self._pulls = np.zeros(len(problem.platens))
        self._loads = [np.zeros(len(problem.u.x.array)) for _ in stepper.load_residuals]
        self._time = 0.0
        self._speed, self._place = self._motion()

    def snapshot(self) -> Snapshot:
        """The sums so far; collective."""
        owned = len(self._stepper.mass)
        sums = {"residual": self._residual, "speed": self._speed, "place": self._place}
        return {
            **{name: scattered(self._held, values, owned) for name, values in sums.items()},
            "pulls": self._pulls,
            "loads": [Nodal(self._collected(values)) for values in self._loads],
            "time": self._time,
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._residual, self._speed, self._place = (
            kept[name][self._held] for name in ("residual", "speed", "place")
        )
        self._pulls, self._time = kept["pulls"], kept["time"]
        for total, values in zip(self._loads, kept["loads"], strict=True):
            total[:] = 0.0
            total[: len(values)] = values

    def _collected(self, local: Floats) -> Floats:
        """Values (n,) of the owned unknowns, with what the ranks have for one another's."""
        vector = NodalVector(self._stepper.problem.space)
        vector.array[:] = local
        vector.collect_ghosts()
        return vector.owned.copy()

    def enter(self, dt: float) -> None:
        """Enter the step of ``dt`` (s) just made; local to the rank."""
        stepper = self._stepper
        self._time += dt
        self._residual += dt * stepper.residual[self._held]
        self._pulls += dt * stepper.loads.platens
        for total, load in zip(self._loads, stepper.load_residuals, strict=True):
            total -= dt * load

    def close(self) -> OutsideForces:
        """The means since the beginning; collective."""
        stepper, residual = self._stepper, self._residual / self._time
        speed, place = self._motion()
        change = (speed - self._speed) + stepper.options.damping * (place - self._place)
        force = residual + self._mass * change / self._time
        whole = np.zeros(len(stepper.mass))
        whole[self._held] = residual
        platens = stepper.problem.platens
        accelerations = self._pulls / self._time - stepper.dynamics.sums(whole)
        accelerations /= stepper.dynamics.platen_mass
        for platen, acceleration in zip(platens, accelerations, strict=True):
            at = np.searchsorted(self._held, platen.dofs)
            force[at] = residual[at] + self._mass[at] * acceleration
        return OutsideForces(force, [np.asarray(load / self._time) for load in self._loads])

    def _motion(self) -> tuple[Floats, Floats]:
        """Velocities, m/s, and displacements, m, of the unknowns that are held."""
        stepper = self._stepper
        return stepper.v[self._held].copy(), stepper.x.array_r[self._held].copy()
