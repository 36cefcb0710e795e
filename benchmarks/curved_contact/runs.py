"""One run of a problem: the case is solved in this process, and every step is photographed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mpi4py import MPI

from tribox.app.build.model import Model, build_model
from tribox.app.case.reading import load_case
from tribox.app.errors import SolutionError
from tribox.app.simulation.simulation import Simulation
from tribox.app.verify.curved import Frame, Photographer
from tribox.geometry.surfaces.facets import Floats


@dataclass(slots=True)
class Outcome:
    """A run, whole or as far as it came.

    Attributes:
        model: what was solved; reference: (n, i), m, undeformed places of each surface's nodes.
        frames: its steps; cuts: failed attempts; seconds: wall time of the steps.
        failure: why it stopped early; empty if it did not.
    """

    model: Model
    reference: dict[str, Floats] = field(default_factory=dict)
    frames: list[Frame] = field(default_factory=list)
    cuts: int = 0
    seconds: float = 0.0
    failure: str = ""

    def stage(self, name: str) -> list[Frame]:
        """The steps of one stage."""
        return [frame for frame in self.frames if frame.row.stage == name]

    def iterations(self, stage: str = "") -> int:
        """Newton iterations of a stage, or of all."""
        return sum(f.row.newton_iterations for f in self.frames if stage in ("", f.row.stage))

    @property
    def most(self) -> int:
        """Newton iterations of the step that took most."""
        return max((f.row.newton_iterations for f in self.frames), default=0)


def run(text: str, scratch: Path, overrides: Sequence[str] = ()) -> Outcome:
    """Solve a case; a run that stops early is an outcome too.

    Raises:
        InputError: the case or an override is wrong.
    """
    path = scratch / "case.toml"
    path.write_text(text, encoding="utf-8")
    model = build_model(load_case(path, overrides), MPI.COMM_SELF)
    outcome = Outcome(model)
    simulation, observer = Simulation(model), Photographer()
    began = time.perf_counter()
    try:
        simulation.run(observer)
    except SolutionError as error:
        outcome.failure = str(error)
    outcome.seconds = time.perf_counter() - began
    outcome.frames, outcome.reference = observer.frames, observer.reference
    outcome.cuts = observer.cuts
    return outcome
