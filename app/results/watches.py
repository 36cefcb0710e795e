"""What watches over a run and has its say at the end of it."""

from __future__ import annotations

from collections.abc import Iterator

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
        roundoff: steps that ended at round-off; contacts: penetration, evenness, resolution;
            left: points that run past the end of their master; late: films of points that come
            under pressure in too long a step; floating: bodies that nothing holds;
            flow: how far bodies flow; films: those that are found.
        told: warnings that are given once only and have been, by a word for each.
    """

    def __init__(self, model: Model, kept: Snapshot | None = None) -> None:
        """Begin before the first step, or go on; collective."""
        self.roundoff = RoundOffWatch(model.problem, model.case.solver.tolerance)
        self.contacts = ContactWarnings(model.problem, None if kept is None else kept["contacts"])
        self.left, self.ends = LeftMaster(model), PressedEnds(model)
        self.late = LateFilm(model)
        self.floating = FloatingWatch()
        self.flow = FlowWatch(model.problem)
        self.films = FilmWatch(model.problem)
        self.told: set[str] = set()
        self._thickness = model.thickness
        if kept is not None:
            self.told = set(kept["told"])
            self.left.restore(kept["left"])
            self.ends.restore(kept["ends"])
            self.late.restore(kept["late"])
            self.floating.restore(kept["floating"])
            self.flow.restore(kept["flow"])
            self.films.restore(kept["films"])
            self.roundoff.restore(kept["roundoff"])

    def step(self, row: Row, result: StepResult | Interval) -> None:
        """Look at a converged step; collective."""
        self.roundoff.step(row, result)
        self.contacts.step(row, self._thickness)
        self.left.step(row)
        self.ends.step(row)
        self.late.step(row, result)
        self.floating.step(row, result)
        self.flow.step(row)
        self.films.step(row)

    def first_time(self, what: str) -> bool:
        """Whether this has not been told yet; it counts as told from now on."""
        new = what not in self.told
        self.told.add(what)
        return new

    def warnings(self, stage: str) -> Iterator[str]:
        """What there is to say at the end, in stage ``stage``; collective."""
        yield from self.left.warnings()
        yield from self.ends.warnings()
        yield from self.late.warnings()
        yield from self.contacts.warnings()
        yield from self.floating.warnings()
        yield from self.flow.warnings()
        yield from self.films.warnings()
        self.roundoff.end(stage)

    def snapshot(self) -> Snapshot:
        """What has been seen so far."""
        return {
            "told": sorted(self.told),
            "left": self.left.snapshot(),
            "ends": self.ends.snapshot(),
            "late": self.late.snapshot(),
            "floating": self.floating.snapshot(),
            "flow": self.flow.snapshot(),
            "films": self.films.snapshot(),
            "roundoff": self.roundoff.snapshot(),
            "contacts": self.contacts.snapshot(),
        }
