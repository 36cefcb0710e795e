"""Builds a case without running it, to find what shows only then."""

from __future__ import annotations

from mpi4py import MPI

from app.build.model import build_model
from app.case.case import Case
from app.simulation.explicit_stage import notes_on_steps
from app.simulation.simulation import Simulation


def notes_on_building(case: Case) -> list[str]:
    """The notes on a case whose mesh, forms and contacts are made and dropped again.

    Raises:
        InputError: mesh and case do not go together, or PETSc has no use for an option.
    """
    model = build_model(case, MPI.COMM_SELF)
    if case.solver.petsc:
        Simulation(model)
    return [*model.notes, *notes_on_steps(model)]
