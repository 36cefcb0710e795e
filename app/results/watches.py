"""What watches over a run and has its say at the end of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tribox.app.build.model import Model
from tribox.app.equilibrium.snapshot import Snapshot
from tribox.app.implicit.stepper import StepResult
from tribox.app.simulation.contact_warnings import ContactWarnings
from tribox.app.simulation.film_watch import FilmWatch
from tribox.app.simulation.history import Row
from tribox.app.simulation.run_state import Interval
from tribox.app.simulation.surface_ends import LateFilm, LeftMaster, PressedEnds
from tribox.app.simulation.watches import FloatingWatch, FlowWatch, RoundOffWatch


class Watches:
    """The watches of a run, told of every step.

    Attributes:
        roundoff: steps that ended at round-off; contacts: penetration, evenness, resolution.
        told: warnings that are given once only and have been, by a word for each.
    """

    def __init__(self, model: Model, kept: Snapshot | None = None) -> None:
        """Begin before the first step, or go on with what :meth:`snapshot` has seen; collective."""
        problem = model.problem
        self._thickness = model.thickness
        self.roundoff = RoundOffWatch(problem, model.case.solver.tolerance)
        self.contacts = ContactWarnings(problem, None if kept is None else kept["contacts"])
        # Points that run past the end of their master, films of points that come under pressure in
        # too long a step, bodies that nothing holds, how far bodies flow, films that are found.
        self._of_rows: dict[str, Any] = {
            "left": LeftMaster(model),
            "ends": PressedEnds(model),
            "flow": FlowWatch(problem),
            "films": FilmWatch(problem),
        }
        self._of_results: dict[str, Any] = {"late": LateFilm(model), "floating": FloatingWatch()}
        self._named = {**self._of_rows, **self._of_results, "roundoff": self.roundoff}
        self.told: set[str] = set() if kept is None else set(kept["told"])
        if kept is not None:
            for name, watch in self._named.items():
                watch.restore(kept[name])

    def step(self, row: Row, result: StepResult | Interval) -> None:
        """Look at a converged step; collective."""
        self.roundoff.step(row, result)
        self.contacts.step(row, self._thickness)
        for watch in self._of_rows.values():
            watch.step(row)
        for other in self._of_results.values():
            other.step(row, result)

    def first_time(self, what: str) -> bool:
        """Whether this has not been told yet; it counts as told from now on."""
        new = what not in self.told
        self.told.add(what)
        return new

    def warnings(self, stage: str) -> Iterator[str]:
        """What there is to say at the end, in stage ``stage``; collective."""
        for name in ("left", "ends", "late"):
            yield from self._named[name].warnings()
        yield from self.contacts.warnings()
        for name in ("floating", "flow", "films"):
            yield from self._named[name].warnings()
        self.roundoff.end(stage)

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        seen = {name: watch.snapshot() for name, watch in self._named.items()}
        return {"told": sorted(self.told), **seen, "contacts": self.contacts.snapshot()}
