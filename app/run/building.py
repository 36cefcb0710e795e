"""Builds a case without running it, to find what shows only then."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mpi4py import MPI

from tribox.app.build.case_notes import highest_pressure
from tribox.app.build.mesh import of_case
from tribox.app.build.model import build_model
from tribox.app.case.bodies import OwnBody
from tribox.app.case.case import Case
from tribox.app.case.contact import Contact
from tribox.app.case.friction import OwnLaw
from tribox.app.case.stage import load_steps_of
from tribox.app.errors import InputError
from tribox.app.implicit.linear_solver import silence
from tribox.app.simulation.explicit_stage import notes_on_steps
from tribox.app.simulation.simulation import Simulation
from tribox.forms.contact.law_faults import law_fault
from tribox.forms.friction.law_check import Conditions, Finding, check_law

MOST_BUILT = 20  # values of a sweep that are put together to see what shows only then


def notes_on_sweep(case: Case, runs_code: bool = False) -> tuple[list[str], list[str]]:
    """Notes and problems of a case, or of its sweep's values: a line each, none twice."""
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
    """Notes on a case whose mesh, forms and contacts are made and dropped again; InputError."""
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
    found = [
        (f"contact.{index}", f"the friction law {contact.friction.reference}")
        for index, contact in enumerate(case.contact)
        if isinstance(contact.friction, OwnLaw)
    ]
    return found + [
        (f"bodies.{name}", f"the material {body.reference}")
        for name, body in case.bodies.items()
        if isinstance(body, OwnBody)
    ]


# -- ``tribox check --law``: the friction laws of a case put to the test, and what came of it ------

PRESSURE = 0.1  # of the softest body's shear modulus, where the case prescribes no pressure


def check_laws(cases: Sequence[Case]) -> None:
    """Print a table for each friction law, Python's run; InputError if one fails, or is wrong."""
    wrong: list[str] = []
    known: list[Contact] = []
    for case in cases:
        new = [i for i, contact in enumerate(case.contact) if contact not in known]
        known += [case.contact[i] for i in new]
        terms = build_model(case, MPI.COMM_SELF).problem.contacts if new else []
        for index in new:
            name = law_name(case.contact[index])
            print(f"contact.{index}: friction law {name}")
            findings = check_law(terms[index].law, conditions(case, case.contact[index]))
            if fault := law_fault([terms[index]]):
                raise InputError(f"contact.{index}.friction: {fault}")
            print("\n".join(f"  {line}" for line in table(findings)))
            if not all(finding.good for finding in findings):
                wrong.append(f"contact.{index}: {name}")
    if wrong:
        raise InputError(f"friction laws that are not what they should be: {'; '.join(wrong)}")


def law_name(contact: Contact) -> str:
    """A law in words."""
    friction = contact.friction
    if isinstance(friction, OwnLaw):
        return f"{friction.file.name}:{friction.reference.rpartition(':')[2]}"
    return friction.law


def table(findings: Sequence[Finding]) -> Iterator[str]:
    """Lines of a table: what was compared, at how many points, the largest error and where."""
    yield f"{'':28}{'points':>8}{'error':>11}{'allowed':>9}  at"
    for one in findings:
        if one.worst > one.allowed:
            verdict = f"WRONG {one.where}"
        elif not one.good:
            verdict = f"WRONG: of {one.asked} points the others are at kinks"
        else:
            verdict = one.where
        line = f"{one.quantity:28}{one.compared:8}{one.worst:11.1e}{one.allowed:9.0e}  {verdict}"
        yield line.rstrip()


def conditions(case: Case, contact: Contact) -> Conditions:
    """Pressure, film and steps that a case asks its law at."""
    softest = min(body.shear_modulus for body in case.bodies.values())
    pressure = highest_pressure(case) or PRESSURE * softest
    film = contact.given_film.thicknesses[0] if contact.given_film is not None else 0.0
    steps = sorted(
        load_step.dt
        for stage in case.stage
        for load_step in load_steps_of(stage, case.film_conductance)
        if stage.rate_dependent
    )
    chosen = {steps[0], steps[len(steps) // 2], steps[-1]} if steps else {1.0}
    return Conditions(pressure, film, sorted(chosen))
