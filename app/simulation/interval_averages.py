"""What the contacts and loads do over many explicit steps, added up without communication."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.snapshot import Partial, Snapshot
from tribox.app.explicit.stepper import ExplicitStepper
from tribox.app.simulation.contact_resultants import (
    ContactResultants,
    fading_loss,
    resultants,
    vector_integrals,
)
from tribox.app.simulation.energy_balance import EnergyFlow
from tribox.app.simulation.outside_forces import OutsideForces, OutsideMean
from tribox.forms.contact.penalty import ContactTerm
from tribox.forms.contact.state import ContactTrial
from tribox.geometry.surfaces.facets import Floats


@dataclass(slots=True)
class _Tally:
    """Sums over the steps of an interval for one pair, this rank's part.

    Attributes:
        time: s, length of the interval so far.
        vectors: ∫ dt of the pair's vector integrals (i), by name.
        dissipated, numerical: J/m, energies dissipated and by the time integration.
        least: J/m², least dissipation met; worst: where, m.
    """

    time: float = 0.0
    vectors: dict[str, Floats] = field(default_factory=dict)
    dissipated: float = 0.0
    numerical: float = 0.0
    least: float = np.inf
    worst: tuple[float, ...] = ()


class IntervalAverages:
    """Adds up forces, work and dissipation step by step.

    Attributes:
        removed: J/m, kinetic energy taken by relaxation, the same on all ranks.
    """

    def __init__(self, stepper: ExplicitStepper) -> None:
        self.stepper = stepper
        self.problem = stepper.problem
        self.removed = 0.0
        self._tractions = [t.state.friction_traction for t in self.problem.contacts]
        self._taken = (stepper.work, stepper.damped)
        self.open()

    def open(self) -> None:
        """Begin an interval."""
        self._tallies = [_Tally() for _ in self.problem.contacts]
        self._outside = OutsideMean(self.stepper)

    def snapshot(self) -> Snapshot:
        """The sums of the interval at hand; collective."""
        comm = self.problem.comm
        tallies = []
        for tally in self._tallies:
            sums = {name: Partial(vector) for name, vector in tally.vectors.items()}
            least, worst = min(comm.allgather((tally.least, tally.worst)))
            tallies.append(
                {
                    "time": tally.time,
                    "vectors": sums,
                    "work": Partial(np.array([tally.dissipated, tally.numerical])),
                    "least": [least, list(worst)],
                }
            )
        return {
            "tallies": tallies,
            "outside": self._outside.snapshot(),
            "removed": self.removed,
            "taken": Partial(np.array(self._taken)),
        }

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._tallies = []
        for one in kept["tallies"]:
            dissipated, numerical = map(float, one["work"])
            least, worst = one["least"]
            self._tallies.append(
                _Tally(one["time"], one["vectors"], dissipated, numerical, least, tuple(worst))
            )
        self._outside.restore(kept["outside"])
        self.removed = kept["removed"]
        self._taken = (float(kept["taken"][0]), float(kept["taken"][1]))

    def enter(self, dt: float) -> None:
        """Enter the step of ``dt`` (s) just made; local to the rank."""
        pairs = zip(self.problem.contacts, self.problem.committed, self._tallies, strict=True)
        for number, (term, trial, tally) in enumerate(pairs):
            _tally_step(term, trial, self._tractions[number], tally, dt)
            self._tractions[number] = trial.response.traction
        self._outside.enter(dt)

    def close(
        self, ends: Sequence[ContactResultants], driven: Sequence[float] | None = None
    ) -> tuple[list[ContactResultants], EnergyFlow, OutsideForces]:
        """End the interval; collective.

        Args:
            ends: the contacts as they are at its end.
            driven: in space, direction in which boundaries are driven.

        Returns:
            The contacts with mean forces and with what they dissipated; what else happened to the
            energy; mean forces of the surroundings.
        """
        comm = self.problem.comm
        parts = zip(self.problem.contacts, ends, self._tallies, strict=True)
        resultants = [_over_interval(term, m, tally, driven, comm) for term, m, tally in parts]
        taken = (self.stepper.work, self.stepper.damped)
        local = np.subtract(taken, self._taken)
        self._taken = taken
        total = np.empty_like(local)
        comm.Allreduce(local, total, op=MPI.SUM)
        flow = EnergyFlow(
            work=float(total[0]),
            damping=float(total[1]) + self.removed,
            kinetic=self.stepper.kinetic_energy(),
        )
        self.removed = 0.0
        return resultants, flow, self._outside.close()


def _tally_step(
    term: ContactTerm, trial: ContactTrial, before: Floats, tally: _Tally, dt: float
) -> None:
    """Add one step of one pair.

    Args:
        term: the pair; trial: the step, committed.
        trial: see term.
        before: (q, i), Pa, friction traction at the start of the step.
        tally: what it is added to.
        dt: s, length of the step.
    """
    weight, parts = term.surface.slave.weight, trial.response.dissipation
    lost = parts.total
    tally.time += dt
    for name, vector in vector_integrals(term, trial).items():
        tally.vectors[name] = dt * vector + tally.vectors.get(name, 0.0)
    change = trial.response.traction - before
    tally.dissipated += float(weight @ lost) + fading_loss(term, trial)
    tally.numerical += 0.5 * float(weight @ np.einsum("qi,qi->q", change, trial.kinematics.slip))
    lost -= parts.numerical
    at = int(np.argmin(lost)) if len(lost) else -1
    if at >= 0 and lost[at] < tally.least:
        tally.least, tally.worst = float(lost[at]), tuple(map(float, trial.position[at]))


def _over_interval(
    term: ContactTerm,
    end: ContactResultants,
    tally: _Tally,
    driven: Sequence[float] | None,
    comm: MPI.Comm,
) -> ContactResultants:
    """Resultants at the end, with mean forces and the interval's dissipation; collective."""
    mine = np.array([*tally.vectors.values(), np.zeros(term.surface.dim)])
    mine[-1, :2] = tally.dissipated, tally.numerical
    total = np.empty_like(mine)
    comm.Allreduce(mine, total, op=MPI.SUM)
    means: dict[str, Floats] = dict(zip(tally.vectors, total[:-1] / tally.time, strict=True))
    least, worst = min(comm.allgather((tally.least, tally.worst)))
    return replace(
        end,
        **resultants(means, driven, term.surface.axisymmetric),
        dissipated=float(total[-1, 0]),
        numerical=float(total[-1, 1]),
        least_dissipation=least,
        worst=worst,
    )
