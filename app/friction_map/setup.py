"""What ``tribox map`` looks at: a law, film thicknesses, loads and speeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from tribox.app.build.case_notes import notes_on_choices
from tribox.app.case.contact import Contact
from tribox.app.case.film import Film
from tribox.app.case.friction import LawTable
from tribox.app.case.toml_files import apply_override
from tribox.app.case.validation import format_problem, problems_of
from tribox.app.errors import InputError
from tribox.forms.closed_forms import crossover_speed, threshold_speed
from tribox.forms.friction.parameters import FrictionMapParameters

if TYPE_CHECKING:
    from tribox.app.case.case import Case

Floats = NDArray[np.float64]

PRESSURE = 3.0e6  # Pa, the paper's pressure, where a case does not say one
LOAD_FACTORS = (0.1, 0.3, 1.0, 3.0)
FILM_SHARES = (0.04, 0.12, 0.72, 1.0)  # of D_max: 10, 30, 180 and 250 nm for the paper's 250 nm
SPEEDS = (1e-8, 1e-1)
SPEEDS_PER_DECADE = 8

ASSUMED: dict[str, Any] = {
    "law": "friction-map",
    "preset": "friction-map",
    "mu_s": 0.11,
    "mu_d": 0.10,
    "A_d": "1 um",
    "B": "5e5 1/m",
    "K_T": "1e12 Pa/m",
    "V_star": "1 mm/s",
    "V_star_at": "10 nm",
}
"""Friction without a case: a preset, and values the paper does not print as in cases/sfa.toml."""


@dataclass(frozen=True, slots=True)
class MapSetup:
    """What is mapped."""

    title: str  # for the figures
    friction: LawTable  # as the case file says it
    parameters: FrictionMapParameters  # of the law
    films: tuple[float, ...]  # m, film thicknesses D of T(V; D), rising
    film: float  # m, film thickness of T(V; L)
    pressure: float  # Pa, load per area of T(V; D)
    loads: tuple[float, ...]  # Pa, loads per area of T(V; L), rising
    speeds: Floats  # (v,), m/s, rising
    notes: tuple[str, ...]  # what was assumed, a line each

    @property
    def between(self) -> tuple[float, ...]:
        """The film thicknesses with asperities and film side by side, D_min < D < D_max."""
        p = self.parameters
        return tuple(D for D in self.films if p.D_min < D < p.D_max)


def map_setup(case_file: Path | None, overrides: Sequence[str] = ()) -> MapSetup:
    """The setup of a case with its overrides, or the built-in one, of contact.0 only.

    InputError if the case is wrong, or has no friction-map law.
    """
    if case_file is None:
        contact = _built_in(overrides)
        assert isinstance(contact.friction, LawTable) and contact.given_film is not None
        note = (
            "no case: preset friction-map with assumed mu_s, mu_d, A_d, B, K_T, V_star; "
            f"{PRESSURE / 1e6:g} MPa as in the paper"
        )
        changed = ", ".join(text.removeprefix("contact.0.").split(".", 1)[-1] for text in overrides)
        title = "built-in parameters" + (f" with {changed}" if changed else "")
        return _setup(title, contact.friction, contact.given_film, (), None, note)
    # All tables of a case take longer to import than the law without a case takes to map.
    from tribox.app.case.reading import load_case

    case = load_case(case_file, overrides)
    index = mapped(case)
    if index is None:
        laws = ", ".join(f'contact.{k} "{one.friction.law}"' for k, one in enumerate(case.contact))
        raise InputError(
            f'{case_file}: tribox map draws the law "friction-map" and films that are found; '
            f"here is {laws or 'no contact'}"
        )
    contact = case.contact[index]
    assert isinstance(contact.friction, LawTable) and contact.given_film is not None
    tables = [boundary.pressure for boundary in case.boundary]
    tables += [boundary.platen.pressure for boundary in case.boundary if boundary.platen]
    values = [value for table in tables if table is not None for value in table.values]
    pressure = max(values, default=0.0) or None
    note = "" if pressure else f"the case gives no pressure: {PRESSURE / 1e6:g} MPa assumed"
    swept = _swept_films(case, index, pressure or PRESSURE)
    title = case.title or case_file.stem
    return _setup(title, contact.friction, contact.given_film, swept, pressure, note)


def mapped(case: Case) -> int | None:
    """Number of the first contact that can be mapped: by the law, or by a film that is found."""
    return next(
        (
            index
            for index, one in enumerate(case.contact)
            if (one.film is not None and one.film.is_unknown)
            or (one.map is not None and one.given_film is not None)
        ),
        None,
    )


def _setup(
    title: str,
    friction: LawTable,
    lubricant: Film,
    swept: tuple[float, ...],
    pressure: float | None,
    note: str,
) -> MapSetup:
    parameters = friction.parameters()
    load = pressure or PRESSURE
    film = _thickness(lubricant, load)
    films = swept or _films(parameters, film)
    inside = [D for D in films if parameters.D_min < D < parameters.D_max]
    # Over loads a film is shown through which asperities rub as well, if there is one.
    if not parameters.D_min < film < parameters.D_max and inside:
        film = inside[0]
    # The usual range, further up where film and friction drag alike only there
    wet = [D for D in films if parameters.D_min < D]
    crossover = crossover_speed(np.array(wet), load, parameters.mu_dynamic, parameters.eta_b)
    low, high = SPEEDS[0], max(SPEEDS[1], float(np.max(crossover, initial=0.0)))
    count = int(np.ceil(np.log10(high / low))) * SPEEDS_PER_DECADE + 1
    return MapSetup(
        title=title,
        friction=friction,
        parameters=parameters,
        films=tuple(sorted({*films, parameters.D_min})),
        film=film,
        pressure=load,
        loads=tuple(factor * load for factor in LOAD_FACTORS),
        speeds=np.asarray(np.geomspace(low, high, count), dtype=np.float64),
        notes=(note,) if note else (),
    )


def _thickness(film: Film, pressure: float) -> float:
    """Of a film that may depend on the pressure, m."""
    thickness = film.thickness
    return thickness if isinstance(thickness, float) else film.at(pressure)


def _films(parameters: FrictionMapParameters, own: float) -> tuple[float, ...]:
    """The film of the contact, and shares of D_max that are not close to it."""
    lowest, highest = parameters.D_min, parameters.D_max
    shares = [float(f"{lowest + share * (highest - lowest):.6g}") for share in FILM_SHARES]
    apart = [D for D in shares if abs(D - own) > 1e-3 * highest]
    return tuple(sorted({*apart, own}))


def _swept_films(case: Case, index: int, pressure: float) -> tuple[float, ...]:
    if case.sweep is None or case.sweep.key != f"contact.{index}.film.thickness":
        return ()
    films = [part.contact[index].film for _, part in case.sweep_cases()]
    return tuple(sorted(_thickness(film, pressure) for film in films if film is not None))


def _built_in(overrides: Sequence[str]) -> Contact:
    data: dict[str, Any] = {
        "contact": [
            {
                "slave": "elastomer",
                "master": "aluminium",
                "film": {"thickness": "10 nm"},
                "friction": dict(ASSUMED),
            }
        ]
    }
    for override in overrides:
        if not override.strip().startswith(("contact.0.film.", "contact.0.friction.")):
            raise InputError(
                f'"{override}": without a case, --set changes keys of contact.0.film and '
                "contact.0.friction"
            )
        apply_override(data, override)
    friction = data["contact"][0]["friction"]
    if "gamma" in friction and not any(".V_star" in override for override in overrides):
        del friction["V_star"], friction["V_star_at"]  # A given one replaces what is assumed.
    return validated_contact(data["contact"][0])


def validated_contact(data: dict[str, Any]) -> Contact:
    """A `[[contact]]` table on its own; InputError is the first problem."""
    try:
        contact = Contact.model_validate(data)
    except ValidationError as error:
        first = problems_of(error, Contact, data)[0]
        placed = replace(first, place=("contact", 0, *first.place))
        raise InputError(format_problem(placed)) from None
    for problem in contact.problems(("contact", 0)):
        raise InputError(format_problem(problem))
    return contact


def law_notes(setup: MapSetup) -> list[str]:
    """The setup's notes, and what the law takes by itself or is odd about its threshold speed."""
    notes = [*setup.notes, *notes_on_choices(setup.friction, np.array(setup.films))]
    if setup.between:
        highest = float(np.max(threshold_speed(np.array(setup.between), setup.parameters)))
        if highest < setup.speeds[0]:
            notes.append(
                f"V* is {highest:.2g} m/s at most, below every speed of the map: the film carries "
                "all (alpha = 1) throughout"
            )
    return notes
