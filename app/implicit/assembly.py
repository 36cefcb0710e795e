"""What a tangent was assembled from, so that a run that goes on can make the same one again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from petsc4py import PETSc

from tribox.app.equilibrium.equilibrium import Equilibrium
from tribox.app.equilibrium.snapshot import (
    Local,
    Nodal,
    Snapshot,
    of_contacts,
    of_origin,
    of_searches,
    of_step,
    repeat_searches,
    to_contacts,
    to_origin,
    to_step,
)
from tribox.app.equilibrium.step_mode import StepMode
from tribox.forms.bodies.point_state import Origin
from tribox.forms.contact.state import ContactState
from tribox.geometry.surfaces.facets import Floats


@dataclass(frozen=True, slots=True)
class Assembly:
    """All that a tangent depends on.

    Attributes:
        x: (n,), m, displacements; before: those that pressures were carried from, or None.
        step: duration and contact modes.
        origins: of each body, from where its material points were evaluated.
        states: of the contacts at the start of the step; searches: where their candidate facets
            were searched for.
        loads: what loads with forms were set to; platens: m, their displacements where prescribed.
        acts: whether each prescribed part, and then each platen, was there.
    """

    x: Floats
    before: Floats | None
    step: StepMode
    origins: tuple[Origin | None, ...]
    states: tuple[ContactState, ...]
    searches: Local
    loads: tuple[Floats, ...]
    platens: tuple[float | None, ...]
    acts: tuple[bool, ...]

    @classmethod
    def of(
        cls, problem: Equilibrium, x: PETSc.Vec, step: StepMode, before: PETSc.Vec | None
    ) -> Assembly:
        """What the tangent at ``x`` has just been assembled from."""
        return cls(
            x.array_r.copy(),
            None if before is None else before.array_r.copy(),
            step,
            tuple(solid.tangent_origin for solid in problem.solids),
            tuple(term.state for term in problem.contacts),
            of_searches(problem.contacts),
            tuple(load.amount for load in problem.loads),
            tuple(platen.displacement for platen in problem.platens),
            tuple(part.acts for part in problem.constraints.parts),
        )

    def snapshot(self, problem: Equilibrium) -> Snapshot:
        """All of it."""
        bodies = enumerate(zip(problem.solids, self.origins, strict=True))
        return {
            "origins": [of_origin(body, solid, origin) for body, (solid, origin) in bodies],
            "x": Nodal(self.x),
            "before": None if self.before is None else Nodal(self.before),
            "step": of_step(self.step),
            "states": of_contacts(self.states),
            "searches": self.searches,
            "loads": list(self.loads),
            "platens": list(self.platens),
            "acts": list(self.acts),
        }

    @classmethod
    def restored(cls, problem: Equilibrium, kept: Snapshot) -> Assembly:
        """What :meth:`snapshot` has seen."""
        return cls(
            kept["x"],
            kept["before"],
            to_step(kept["step"]),
            tuple(map(to_origin, problem.solids, kept["origins"])),
            tuple(to_contacts(problem.contacts, kept["states"])),
            Local(kept["searches"] or {}),
            tuple(kept["loads"]),
            tuple(kept["platens"]),
            tuple(kept["acts"]),
        )

    @contextmanager
    def in_place(self, problem: Equilibrium) -> Iterator[tuple[PETSc.Vec, PETSc.Vec | None]]:
        """Context in which all but the displacements is as in the assembly; x and before, m."""
        now = Assembly.of(problem, problem.new_vector(), self.step, None)
        repeat_searches(problem.contacts, self.searches.arrays)
        self._put(problem)
        for solid, origin in zip(problem.solids, self.origins, strict=True):
            solid.remake_tangent(origin)
        try:
            yield _vector(problem, self.x), _vector(problem, self.before)
        finally:
            now._put(problem)
            for solid in problem.solids:
                solid.remake_tangent(None)

    def _put(self, problem: Equilibrium) -> None:
        """Put in the contacts' histories, and the loads and supports of the tangent."""
        for term, state in zip(problem.contacts, self.states, strict=True):
            term.adopt(state)
        for load, amount in zip(problem.loads, self.loads, strict=True):
            load.amount = amount
        for platen, displacement in zip(problem.platens, self.platens, strict=True):
            platen.displacement = displacement
        for part, acts in zip(problem.constraints.parts, self.acts, strict=True):
            part.acts = acts


def _vector(problem: Equilibrium, values: Floats | None) -> PETSc.Vec | None:
    if values is None:
        return None
    out = problem.new_vector()
    out.array[:] = values
    return out
