"""What may surprise in a case that is correct: lines for the person who runs it."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np

from app.case import Case
from app.case_bodies import BlocksGeometry
from app.case_contact import Contact, FrictionMap
from forms.friction_checks import threshold_speed_warning, uniqueness_warning


def notes_on(case: Case) -> list[str]:
    """Notes on a case before it runs, one line each."""
    return [
        f"contact.{index}: {note}"
        for index, contact in enumerate(case.contact)
        for note in _notes_on_contact(case, contact)
    ]


def _notes_on_contact(case: Case, contact: Contact) -> Iterator[str]:
    if not isinstance(contact.friction, FrictionMap) or contact.film is None:
        return
    parameters, film = contact.friction.parameters(), np.array(contact.film.thicknesses)
    pressure = highest_pressure(case)
    if pressure > 0.0:
        note = uniqueness_warning(parameters, pressure, film)
        if note:
            yield note
    steps = list(_driven_steps(case))
    if steps:
        note = threshold_speed_warning(
            parameters,
            film,
            position_error=sys.float_info.epsilon * _size(case),
            dt=min(dt for _, dt in steps),
            slowest=min(speed for speed, _ in steps),
        )
        if note:
            yield note


def highest_pressure(case: Case) -> float:
    """The highest pressure that a boundary prescribes, Pa; 0 if none does."""
    tables = [b.pressure for b in case.boundary] + [
        b.platen.pressure for b in case.boundary if b.platen is not None
    ]
    return max((max(table.values) for table in tables if table is not None), default=0.0)


def _driven_steps(case: Case) -> Iterator[tuple[float, float]]:
    """(speed in m/s, step in s) of every driven leg that feels its rate."""
    for stage in case.stage:
        if not stage.rate_dependent:
            continue
        for velocity in stage.velocities_within(case.film_conductance):
            assert stage.slip_step is not None
            yield abs(velocity), stage.slip_step / abs(velocity)
        if stage.velocity and stage.duration is not None:
            yield abs(stage.velocity), stage.duration / stage.steps


def _size(case: Case) -> float:
    """A length of the model, m, that coordinates are rounded to."""
    geometry = case.geometry
    if isinstance(geometry, BlocksGeometry):
        return max(geometry.lower.width, geometry.upper.width)
    return 1.0
