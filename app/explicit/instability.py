"""Looks for what no explicit run recovers from: cells inside out, and energy from nowhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from app.equilibrium.equilibrium import Equilibrium
from app.simulation.failure_diagnosis import place_text
from forms.bodies.materials import oedometric_modulus
from geometry.surfaces.facets import Floats

if TYPE_CHECKING:
    from app.explicit.stepper import ExplicitStepper


class ExplicitError(Exception):
    """The motion cannot be followed any further.

    Attributes:
        reason: what happened; place: where, m, undeformed; time: when, s since the start.
    """

    def __init__(self, reason: str, place: tuple[float, ...], time: float) -> None:
        """Say what happened, where and when."""
        super().__init__(f"{reason} at {place_text(place)}, undeformed")
        self.reason, self.place, self.time = reason, place, time


def folded(problem: Equilibrium, time: float) -> ExplicitError:
    """The error for an element that is inside out; collective."""
    mesh, u = problem.space.mesh, problem.u.x.array
    cells = np.asarray(problem.space.dofmap.list)[
        : mesh.topology.index_map(mesh.topology.dim).size_local
    ]
    reference = problem.space.tabulate_dof_coordinates()[:, : problem.dim]
    current = reference + u.reshape(-1, problem.dim)
    with np.errstate(invalid="ignore", over="ignore"):
        ratio = (_corner_jacobians(current[cells]) / _corner_jacobians(reference[cells])).min(0)
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


class EnergyWatch:
    """Holds the stored energy against all that was ever supplied.

    Supports, loads and the start supply energy; dissipation only takes. So the strain, kinetic and
    interface energy together can never exceed the supply, but for errors of the integration.
    """

    def __init__(self, stepper: ExplicitStepper) -> None:
        """Begin with what is stored now; collective."""
        self._stepper = stepper
        self._supplied = self._stored()
        self._work = 0.0

    def look(self) -> None:
        """Compare; collective.

        Raises:
            ExplicitError: there is more energy than was supplied.
        """
        stepper = self._stepper
        work = float(stepper.problem.comm.allreduce(stepper.work, op=MPI.SUM))
        self._supplied += max(work - self._work, 0.0)
        self._work = work
        stored = self._stored()
        if not np.isfinite(stored):
            raise folded(stepper.problem, stepper.time)
        if not stored <= stepper.options.energy_limit * self._supplied + self._roundoff():
            raise ExplicitError(
                f"the energy runs away ({stored:.3g} J/m stored, {self._supplied:.3g} J/m ever "
                "supplied), fastest",
                self._fastest(),
                stepper.time,
            )

    def _stored(self) -> float:
        stepper, problem = self._stepper, self._stepper.problem
        local = stepper.internal.energy(problem.u.x.array)
        pairs = zip(problem.contacts, problem.trials, strict=True)
        local += sum(term.interface_energy(trial) for term, trial in pairs)
        return float(problem.comm.allreduce(local, op=MPI.SUM)) + stepper.kinetic_energy()

    def _roundoff(self) -> float:
        """Energy that rounding errors may hold, J/m: far below any of interest."""
        problem = self._stepper.problem
        stiffest = max(oedometric_modulus(solid.material) for solid in problem.solids)
        return 1e6 * problem.roundoff**2 / stiffest

    def _fastest(self) -> tuple[float, ...]:
        stepper, problem = self._stepper, self._stepper.problem
        moving = np.nan_to_num(stepper.mass * stepper.v**2, nan=np.inf)
        mine: tuple[float, tuple[float, ...]] = (-1.0, ())
        if len(moving):
            at = int(np.argmax(moving)) // problem.dim
            where = problem.space.tabulate_dof_coordinates()[at, : problem.dim]
            mine = (float(moving.max()), tuple(map(float, where)))
        place: tuple[float, ...] = max(problem.comm.allgather(mine))[1]
        return place
