"""Watches how far bodies flow: past the data of their hardening, and in one step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mpi4py import MPI

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.simulation.history import Row
from tribox.app.simulation.time_text import time_text
from tribox.forms.bodies.plastic_solid import PlasticSolid

LONG = 0.1  # equivalent plastic strain of one step from which on it is warned of


class FlowWatch:
    """Largest equivalent plastic strains of each body that flows."""

    def __init__(self, problem: Equilibrium) -> None:
        """Find the bodies that flow."""
        self._comm = problem.comm
        self._bodies = [body for body in problem.solids if isinstance(body, PlasticSolid)]
        self._found: dict[str, str] = {}  # warnings, by a word for each and its body

    def step(self, row: Row) -> None:
        """Look at a converged step; collective."""
        if not self._bodies:
            return
        local = np.array([body.largest_flow() for body in self._bodies])
        largest = np.empty_like(local)
        self._comm.Allreduce(local, largest, op=MPI.MAX)
        when = f"first at time {time_text(row.time, row.dt)}, stage {row.stage}"
        for body, (strain, growth) in zip(self._bodies, largest, strict=True):
            end = body.material.hardening.largest_strain
            if strain > end:
                self._found.setdefault(
                    f"table {body.name}",
                    f"body {body.name}: equivalent plastic strain beyond {end:.3g}, where its "
                    f"hardening table ends and the yield stress stays level ({when}); add points",
                )
            if growth > LONG:
                self._found.setdefault(
                    f"step {body.name}",
                    f"body {body.name}: equivalent plastic strain grew by {growth:.3g} in one step "
                    f"({when}): where principal axes turn, stresses normal to the shear are of "
                    "first order in the step; take more steps",
                )

    def warnings(self) -> Iterator[str]:
        """One line for each body and reason."""
        yield from self._found.values()

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        return {"found": list(self._found.items())}

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._found = {word: said for word, said in kept["found"]}
