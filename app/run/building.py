"""Builds a case without running it, to find what shows only then."""

from __future__ import annotations

from mpi4py import MPI

from tribox.app.build.mesh import of_case
from tribox.app.build.model import build_model
from tribox.app.case.bodies import OwnBody
from tribox.app.case.case import Case
from tribox.app.case.friction import OwnLaw
from tribox.app.errors import InputError
from tribox.app.implicit.petsc_options import silence
from tribox.app.simulation.explicit_stage import notes_on_steps
from tribox.app.simulation.simulation import Simulation

MOST_BUILT = 20
"""Values of a sweep that are put together to see what shows only then."""


def notes_on_sweep(case: Case, runs_code: bool = False) -> tuple[list[str], list[str]]:
    """Notes on a case, or on the values of its sweep, and what is wrong with them.

    Args:
        case: with or without a sweep.
        runs_code: as of :func:`notes_on_building`.

    Returns:
        The notes and the problems, a line each, in their order and without repeats.
    """
    parts = [part for _, part in case.sweep_cases()] or [case]
    every = -(-len(parts) // MOST_BUILT)
    notes: dict[str, None] = {}
    problems: dict[str, None] = {}
    for part in parts[::every]:
        try:
            notes |= dict.fromkeys(notes_on_building(part, runs_code))
        except InputError as error:
            problems |= dict.fromkeys(error.lines)
    if every > 1:
        built = len(parts[::every])
        notes[f"{built} of {len(parts)} values were put together, the others only read"] = None
    return list(notes), list(problems)


def notes_on_building(case: Case, runs_code: bool = False) -> list[str]:
    """The notes on a case whose mesh, forms and contacts are made and dropped again.

    Args:
        case: without a sweep.
        runs_code: whether laws and materials written in Python are run; if not, a note says so.

    Raises:
        InputError: mesh and case do not go together, a law that is run cannot be used, or PETSc has
            no use for an option.
    """
    silence()  # a case that is only put together leaves options of PETSc without use
    model = build_model(case, MPI.COMM_SELF, runs_code)
    own = _own_code(case)
    try:
        if case.solver.petsc and (runs_code or not own):
            Simulation(model)
        notes = [*model.notes, *notes_on_steps(model)]
    except InputError as error:
        raise of_case(case, error) from None
    if not runs_code:
        notes += [
            f"{place}: the code of {what} was not run; tribox check --law tries it"
            for place, what in own
        ]
    return notes


def _own_code(case: Case) -> list[tuple[str, str]]:
    """(place, what) of all in a case that is code."""
    laws = [(f"contact.{index}", contact.friction) for index, contact in enumerate(case.contact)]
    return [
        *(
            (place, f"the friction law {law.reference}")
            for place, law in laws
            if isinstance(law, OwnLaw)
        ),
        *(
            (f"bodies.{name}", f"the material {body.reference}")
            for name, body in case.bodies.items()
            if isinstance(body, OwnBody)
        ),
    ]
