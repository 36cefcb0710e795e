"""What may surprise in a case that is correct: lines for the person who runs it."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from tribox.app.build.settling_notes import notes_on_settling
from tribox.app.case.boundary import Boundary
from tribox.app.case.case import Case
from tribox.app.case.contact import Contact
from tribox.app.case.friction import FrictionMap
from tribox.app.case.generators import BlocksGeometry
from tribox.app.case.geometry import GeneratedGeometry
from tribox.app.case.time_tables import TimeTable
from tribox.forms.friction.checks import (
    fixed_threshold_note,
    tabulation_note,
    threshold_speed_warning,
    uniqueness_warning,
)
from tribox.forms.friction.parameters import PRESETS

Floats = NDArray[np.float64]

LOOSE = 1e-3  # of the residual over the contact force, from which on results show it
THICK = 1e-5  # m, film thickness that is surely a slip of units
SOFT = 100.0  # Pa, shear modulus, below that of gels, that is surely a slip of units


def notes_on(case: Case) -> list[str]:
    """Notes on a case before it runs, one line each."""
    notes = [
        f"boundary.{index}.{key}: falls to {min(table.values):g} Pa: below zero it pulls"
        for index, boundary in enumerate(case.boundary)
        for key, table in _pressures(boundary)
        if min(table.values) < 0.0
    ]
    if case.solver.tolerance > LOOSE:
        notes.append(
            f"solver.tolerance = {case.solver.tolerance:g}: forces may be wrong by about as much; "
            f"the default is 1e-8, and above {LOOSE:g} results are not to be trusted"
        )
    notes += [
        f"bodies.{name}: a shear modulus of {body.shear_modulus:.3g} Pa is below that of gels; "
        'a number without a unit is in SI: write "3 MPa"'
        for name, body in case.bodies.items()
        if body.shear_modulus < SOFT
    ]
    return notes + [
        f"contact.{index}: {note}"
        for index, contact in enumerate(case.contact)
        for note in _notes_on_contact(case, contact)
    ]


def _pressures(boundary: Boundary) -> Iterator[tuple[str, TimeTable]]:
    if boundary.pressure is not None:
        yield "pressure", boundary.pressure
    if boundary.platen is not None and boundary.platen.pressure is not None:
        yield "platen.pressure", boundary.platen.pressure


def _notes_on_contact(case: Case, contact: Contact) -> Iterator[str]:
    if not isinstance(contact.friction, FrictionMap) or contact.given_film is None:
        return
    yield from _notes_on_weakening(case, contact.friction)
    thickest = max(contact.given_film.thicknesses)
    if thickest > THICK:
        yield (
            f"film thickness D = {thickest:.3g} m: the law is one of thin "
            "films (nanometres to about a micrometre)"
        )
    parameters, film = contact.friction.parameters(), np.array(contact.given_film.thicknesses)
    # Between the rows of a table over the pressure the film takes every thickness.
    taken = np.concatenate([film, 0.5 * (film[1:] + film[:-1])])
    yield from notes_on_choices(contact.friction, taken)
    pressure = highest_pressure(case)
    if pressure > 0.0:
        note = uniqueness_warning(parameters, pressure, film)
        if note:
            yield note
    yield from notes_on_settling(case, contact, pressure)
    steps = list(_driven_steps(case))
    if steps:
        note = threshold_speed_warning(
            parameters,
            film,
            position_error=sys.float_info.epsilon * _size(case),
            dt=min(dt for _, dt in steps),
            slowest=None if _comes_to_rest(case) else min(speed for speed, _ in steps),
        )
        if note:
            yield note
    if parameters.switch == "lagged" and _comes_to_rest(case):
        longest = parameters.eta_b / (float(film.max()) * parameters.K_T)
        yield (
            'friction.switch = "lagged": a stage without motion follows a driven one, and with the '
            "film fraction of the step before a body that comes to rest keeps the right traction "
            f"only in steps shorter than eta_b/(D K_T) = {longest:.2g} s; "
            'switch = "implicit" takes any'
        )


def notes_on_choices(friction: FrictionMap, film: Floats) -> Iterator[str]:
    """Lines on what the law takes by itself where the case does not say it.

    Args:
        friction: the law.
        film: (q,), m, film thicknesses that it is used for.
    """
    parameters = friction.parameters()
    note = tabulation_note(parameters, film)
    if note:
        yield note
    if friction.preset is not None:
        note = fixed_threshold_note(parameters, PRESETS[friction.preset]["eta_b"])
        if note:
            yield note


def _notes_on_weakening(case: Case, friction: FrictionMap) -> Iterator[str]:
    """Weakening that does nothing, and weakening that lets patches of the contact snap."""
    fall = friction.mu_s - friction.mu_d
    if fall > 0.0 and friction.B == 0.0:
        yield f"mu_d = {friction.mu_d:g} has no effect while B = 0: friction stays at mu_s"
    if not isinstance(case.geometry, BlocksGeometry):
        return
    upper = case.bodies[case.geometry.bodies[0]].shear_modulus / case.geometry.upper.height
    slope = highest_pressure(case) * fall * friction.B
    if slope > upper:
        yield (
            f"slip weakening p (mu_s - mu_d) B = {slope:.3g} Pa/m is steeper than the upper "
            f"block's shear stiffness G/height = {upper:.3g} Pa/m: the onset of slip can snap, "
            "and a quasi-static step through it may have no solution (lower B)"
        )


def highest_pressure(case: Case) -> float:
    """The highest pressure that a boundary prescribes, Pa; 0 if none does."""
    tables = [table for boundary in case.boundary for _, table in _pressures(boundary)]
    return max((max(table.values) for table in tables), default=0.0)


def _driven_steps(case: Case) -> Iterator[tuple[float, float]]:
    """(speed in m/s, step in s) of every driven load step that feels its rate."""
    for stage in case.stage:
        if not stage.rate_dependent:
            continue
        for velocity in stage.velocities_within(case.film_conductance):
            assert stage.slip_step is not None
            yield abs(velocity), stage.slip_step / abs(velocity)
        if stage.velocity and stage.duration is not None:
            yield abs(stage.velocity), stage.duration / stage.steps


def _comes_to_rest(case: Case) -> bool:
    """Whether a stage without motion follows a driven one, which slows through V* then."""
    felt = [stage for stage in case.stage if stage.rate_dependent]
    moves = [bool(stage.velocities or stage.velocity) for stage in felt]
    return any(before and not now for before, now in itertools.pairwise(moves))


def _size(case: Case) -> float:
    """A length of the model, m, that coordinates are rounded to."""
    geometry = case.geometry
    return geometry.extent if isinstance(geometry, GeneratedGeometry) else 1.0
