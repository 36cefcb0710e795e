"""Contacts that a stage switches on or off."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from petsc4py import PETSc

from tribox.app.build.contacts import OVERLAP, overlap
from tribox.app.build.model import Model
from tribox.app.errors import SolutionError
from tribox.app.simulation.contact_resultants import ContactResultants
from tribox.geometry.surfaces.facets import Floats


def begin_stage(model: Model, stage: str, x: PETSc.Vec) -> Floats:
    """Let the loads and contacts be those of a stage; collective.

    Args:
        model: what is solved.
        stage: its name.
        x: displacement, m, at its beginning.

    Returns:
        (n,), N per unit thickness, forces on the owned unknowns of contacts that are released from
        now on: loads take their place.

    Raises:
        SolutionError: the surfaces of a contact that acts from now on overlap.
    """
    terms = model.problem.contacts
    before = [term.active for term in terms]
    model.begin_stage(stage)
    released = np.zeros(model.problem.owned)
    for index, (was, term) in enumerate(zip(before, terms, strict=True)):
        if term.active and not was:
            _require_apart(model, index, stage, x)
        if was and not term.active and model.case.is_released(model.case.contact[index], stage):
            released += model.problem.pair_forces(index)
    return released


def _require_apart(model: Model, index: int, stage: str, x: PETSc.Vec) -> None:
    """Refuse a contact whose surfaces would snap apart; collective."""
    table, surface = model.case.contact[index], model.problem.contacts[index].surface
    values = surface.gather(x)
    points = surface.slave_positions(values[surface.slave_rows])
    depth = overlap(surface, surface.project(points, surface.master_positions(values)))
    if depth > OVERLAP * surface.facet_length:
        raise SolutionError(
            f"stage {stage}: contact.{index} begins to act while {table.slave} is {depth:.3g} m "
            f"inside {table.master}; the bodies may touch then, not overlap (more than "
            f"{OVERLAP * surface.facet_length:.3g} m): let it act from an earlier stage on"
        )


def with_released_energy(
    resultants: Iterable[ContactResultants], before: Sequence[ContactResultants], model: Model
) -> list[ContactResultants]:
    """Resultants in which contacts that have been switched off have lost what they had stored.

    The friction of contacts that are released is that of loads, whose work is counted there.

    Args:
        resultants: of all contacts after a step.
        before: those of the step before; empty: there was none.
        model: what is solved.
    """
    out, stage = list(resultants), "" if model.loads is None else model.loads.stage
    tables, terms = model.case.contact, model.problem.contacts
    for index, (table, term, last) in enumerate(zip(tables, terms, before, strict=False)):
        if not term.active and last.energy > 0.0:
            out[index] = replace(out[index], dissipated=last.energy)
        if not term.active and model.case.is_released(table, stage):
            out[index] = replace(out[index], numerical=0.0)
    return out
