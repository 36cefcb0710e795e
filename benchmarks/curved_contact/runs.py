"""One run of a problem: the case is solved in this process, and every step is photographed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mpi4py import MPI

from app.build.model import Model, build_model
from app.case.reading import load_case
from app.errors import SolutionError
from app.implicit.stepper import StepResult
from app.simulation.contact_resultants import turned_right
from app.simulation.history import Row
from app.simulation.observer import Interval, Observer
from app.simulation.run_state import RunState
from app.simulation.simulation import Simulation
from geometry.surfaces.facets import Floats, Ints
from geometry.surfaces.surface import facet_nodes


@dataclass(frozen=True, slots=True)
class Frame:
    """A converged step as it can be seen from outside: nobody's word on who touches whom.

    Attributes:
        row: of the history.
        nodes: (n, i), m, current places of the nodes of each surface of the first pair.
        position: (q, i), m, current, of the contact points; weight: (q,), m or m², reference.
        pressure: (q,), Pa, at the points; nodal: (v,), Pa, at slave nodes, None where the contact
            has none; at: (v, i), m, current, those nodes.
        along: N, Σ w T·r with r the direction to the right of each point's own normal (in space:
            the length of Σ w T); load: N, Σ w p.
    """

    row: Row
    nodes: dict[str, Floats]
    position: Floats
    weight: Floats
    pressure: Floats
    nodal: Floats | None
    at: Floats | None
    along: float
    load: float


@dataclass(slots=True)
class Outcome:
    """A run, whole or as far as it came.

    Attributes:
        model: what was solved; reference: (n, i), m, undeformed places of each surface's nodes.
        frames: its steps; cuts: failed attempts; seconds: wall time of the steps.
        failure: why it stopped early; empty if it did not.
    """

    model: Model
    reference: dict[str, Floats]
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


class _Photographer(Observer):
    def __init__(self, surfaces: dict[str, Ints], outcome: Outcome) -> None:
        self.surfaces = surfaces
        self.outcome = outcome

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """Keep what can be seen of the step."""
        problem, thickness = state.model.problem, state.model.thickness
        dim = problem.dim
        moved = state.stepper.x.array_r.reshape(-1, dim)
        nodes = {
            name: self.outcome.reference[name] + moved[found]
            for name, found in self.surfaces.items()
        }
        term, trial = problem.contacts[0], problem.committed[0]
        weight = term.surface.slave.weight * thickness
        friction, normal = trial.response.traction, trial.kinematics.normal
        if dim == 2:
            along = float(weight @ np.einsum("qi,qi->q", friction, turned_right(normal)))
        else:
            along = float(np.linalg.norm(weight @ friction))
        nodal = getattr(trial, "nodal_pressure", None)
        at = None
        if nodal is not None:
            vertices = getattr(term.surface, "vertices").nodes
            at = problem.space.tabulate_dof_coordinates()[vertices, :dim] + moved[vertices]
        self.outcome.frames.append(
            Frame(
                row=row,
                nodes=nodes,
                position=trial.position.copy(),
                weight=weight,
                pressure=trial.pressure.copy(),
                nodal=None if nodal is None else nodal.copy(),
                at=at,
                along=along,
                load=float(weight @ trial.pressure),
            )
        )

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Count it."""
        self.outcome.cuts += 1


def run(text: str, scratch: Path, overrides: Sequence[str] = ()) -> Outcome:
    """Solve a case; a run that stops early is an outcome too.

    Args:
        text: the case file.
        scratch: directory for it, where meshes that it names lie.
        overrides: "key=value" texts.

    Raises:
        InputError: the case or an override is wrong.
    """
    path = scratch / "case.toml"
    path.write_text(text, encoding="utf-8")
    model = build_model(load_case(path, overrides), MPI.COMM_SELF)
    surfaces, reference = _surfaces(model)
    outcome = Outcome(model, reference)
    simulation = Simulation(model)
    began = time.perf_counter()
    try:
        simulation.run(_Photographer(surfaces, outcome))
    except SolutionError as error:
        outcome.failure = str(error)
    outcome.seconds = time.perf_counter() - began
    return outcome


def _surfaces(model: Model) -> tuple[dict[str, Ints], dict[str, Floats]]:
    """Nodes of both surfaces of the first pair, in the plane from left to right; their places."""
    space, dim = model.problem.space, model.problem.dim
    places = space.tabulate_dof_coordinates()[:, :dim]
    table = model.case.contact[0]
    nodes = {}
    for name in (table.slave, table.master):
        found = np.unique(facet_nodes(space, model.named.facets(name)))
        nodes[name] = found[np.argsort(places[found, 0], kind="stable")]
    return nodes, {name: places[found] for name, found in nodes.items()}
