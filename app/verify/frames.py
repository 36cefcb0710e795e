"""Photographs of a run: after each step the places of both surfaces, and what the contact says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tribox.app.build.model import Model
from tribox.app.implicit.stepper import StepResult
from tribox.app.simulation.contact_resultants import turned_right
from tribox.app.simulation.history import Row
from tribox.app.simulation.observer import Interval, Observer
from tribox.app.simulation.run_state import RunState
from tribox.forms.contact.pressure import nodal_pressure
from tribox.geometry.surfaces.body_facets import facet_nodes
from tribox.geometry.surfaces.facets import Floats, Ints


@dataclass(frozen=True, slots=True)
class Frame:
    """A converged step as it can be seen from outside: nobody's word on who touches whom.

    Attributes:
        row: of the history.
        nodes: (n, i), m, current places of the nodes of each surface of the first pair.
        position: (q, i), m, current, of the contact points; weight: (q,), m or m², reference.
        pressure: (q,), Pa, at the points; nodal: (v,), Pa, at slave nodes, force over area, None
            point by point; at: (v, i), m, current, those nodes.
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


class Photographer(Observer):
    """Keeps a frame of each step of a run on one rank.

    Attributes:
        frames: of the steps so far.
        reference: (n, i), m, undeformed places of the nodes of each surface of the first pair, in
            the plane from left to right; empty before the first step.
        cuts: failed attempts.
    """

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.reference: dict[str, Floats] = {}
        self.cuts = 0
        self._nodes: dict[str, Ints] = {}

    def step(self, state: RunState, row: Row, result: StepResult | Interval) -> None:
        """Keep what can be seen of the step."""
        if not self.reference:
            self._nodes, self.reference = surfaces_of(state.model)
        self.frames.append(self._frame(state, row))

    def cut(self, state: RunState, dt: float, result: StepResult) -> None:
        """Count it."""
        self.cuts += 1

    def _frame(self, state: RunState, row: Row) -> Frame:
        problem, thickness = state.model.problem, state.model.thickness
        dim = problem.dim
        moved = state.stepper.x.array_r.reshape(-1, dim)
        surface, trial = problem.contacts[0].surface, problem.committed[0]
        weight = surface.slave.weight * thickness
        friction, normal = trial.response.traction, trial.kinematics.normal
        if dim == 2:
            along = float(weight @ np.einsum("qi,qi->q", friction, turned_right(normal)))
        else:
            along = float(np.linalg.norm(weight @ friction))
        nodal, at = None, None
        if trial.nodal_pressure is not None:
            nodal = nodal_pressure(surface, trial.pressure)
            vertices = surface.vertices.nodes
            at = problem.space.tabulate_dof_coordinates()[vertices, :dim] + moved[vertices]
        return Frame(
            row=row,
            nodes={name: self.reference[name] + moved[of] for name, of in self._nodes.items()},
            position=trial.position.copy(),
            weight=weight,
            pressure=trial.pressure.copy(),
            nodal=nodal,
            at=at,
            along=along,
            load=float(weight @ trial.pressure),
        )


def surfaces_of(model: Model) -> tuple[dict[str, Ints], dict[str, Floats]]:
    """Nodes of both surfaces of the first pair, in the plane from left to right; their places."""
    space, dim = model.problem.space, model.problem.dim
    places = space.tabulate_dof_coordinates()[:, :dim]
    table = model.case.contact[0]
    nodes = {}
    for name in (table.slave, table.master):
        found = np.unique(facet_nodes(space, model.named.facets(name)))
        nodes[name] = found[np.argsort(places[found, 0], kind="stable")]
    return nodes, {name: places[found] for name, found in nodes.items()}
