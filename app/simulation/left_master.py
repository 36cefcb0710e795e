"""Points of a slave that have run past the end of its master."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tribox.app.build.model import Model
from tribox.app.equilibrium.snapshot import AtPoints, Snapshot
from tribox.app.simulation.history import Row
from tribox.app.simulation.surface_faults import ends_text
from tribox.app.simulation.time_text import time_text
from tribox.forms.contact.shared_slave import covered_by_others
from tribox.geometry.surfaces.facets import Bools

FEW = 0.05  # share of the area above the master that may leave it without a word


class LeftMaster:
    """Watches the points that were above the master at some row of the history.

    Those that were beside it from the start, as where a slave is simply the longer one, do not
    count, nor do points that lie above the plane of the master's end; nor a few that leave it as a
    pressed slave spreads.
    """

    def __init__(self, model: Model) -> None:
        """Find what is above the masters at the start."""
        self._problem, self._contacts = model.problem, model.case.contact
        self._above = [np.isfinite(term.state.gap) for term in self._problem.contacts]
        self._found: dict[int, str] = {}

    def step(self, row: Row) -> None:
        """Look at a converged step; collective."""
        lost, whole = np.zeros(len(self._above)), np.zeros(len(self._above))
        gone: dict[int, Bools] = {}
        for index, trial in enumerate(self._problem.committed):
            term = self._problem.contacts[index]
            if term.tied or not term.active:
                continue
            here = trial.projection.on_surface
            left = self._above[index] & ~here & (trial.kinematics.gap < 0.0)
            self._above[index] |= here
            gone[index] = left
            weight, sums = term.surface.slave.weight, term.surface.vertices.sums
            whole[index] = sums(weight * self._above[index]).sum()
            # What another master has below it now has not run off.
            others = covered_by_others(term.neighbours, term.surface.vertices.count)
            lost[index] = np.maximum(sums(weight * left) - others, 0.0).sum()
        when = f"first at time {time_text(row.time, row.dt)}, stage {row.stage}"
        for index in map(int, np.nonzero(lost > FEW * whole)[0]):
            if index not in self._found:
                surface, at = self._problem.contacts[index].surface, self._problem.committed[index]
                where = ends_text(surface, at.projection, gone[index])
                self._found[index] = f"at {where}, undeformed: no contact there ({when})"

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        above = [AtPoints(pair, points) for pair, points in enumerate(self._above)]
        return {"above": above, "found": list(self._found.items())}

    def restore(self, kept: Snapshot) -> None:
        """Go on from what :meth:`snapshot` has seen."""
        self._above = list(kept["above"])
        self._found = {int(pair): where for pair, where in kept["found"]}

    def warnings(self) -> Iterator[str]:
        """One line for each pair that has lost points."""
        for index, where in self._found.items():
            pair = self._contacts[index]
            yield f"{pair.slave} runs past the end of {pair.master} {where}"
