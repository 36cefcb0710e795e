"""Builds a case without running it, to find what shows only then."""

from __future__ import annotations

from mpi4py import MPI

from app.build.model import build_model
from app.case.case import Case
from app.simulation.explicit_stage import notes_on_steps


def notes_on_building(case: Case) -> list[str]:
    """The notes on a case whose mesh, forms and contacts are made and dropped again.

    Raises:
        InputError: mesh and case do not go together.
    """
    model = build_model(case, MPI.COMM_SELF)
    return [*model.notes, *notes_on_steps(model)]
