"""What a fit writes for a case file: a `[contact.friction]` section that can be pasted.

A key stands there as a live line only if it was fitted and determined, fixed, or assumed. What the
data do not determine is written as a comment, so that no case runs on it unnoticed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tribox.app.case.friction import FrictionMap
from tribox.app.case.toml_writer import toml_text
from tribox.app.fit.model import RANGES, Coordinate, Parameters
from tribox.app.fit.result import Estimate, FitResult, Which
from tribox.app.fit.setup import FitSetup
from tribox.forms.friction.parameters import FrictionMapParameters

_STIFF = "without it the case takes 10 times the softer body's shear modulus per facet length"
ABSENT_WITHOUT_FILM = {
    "delta": "without it the case takes delta = 1",
    "viscous": "without it the case takes viscous = 0 Pa*s/m",
    "K_T": _STIFF,
}
"""The same as ``ABSENT`` for Stribeck and Coulomb friction."""
ABSENT = {
    "mu_d": "without it the case takes mu_d = mu_s",
    "A_d": "without it the case takes A_d = 0 m",
    "B": "without it the case takes B = 0 1/m: no weakening with slip",
}
"""What a case does without a key; without any other it says that the key is missing."""
NEEDED = "the case needs a value of yours"
_DIGITS = 6
_DIGITS_OF_ALPHA = 10  # what counts is 1 - alpha


def friction_section(setup: FitSetup, result: FitResult, data_file: Path) -> str:
    """A `[contact.friction]` section of a case file with the calibrated law."""
    comments = [
        f"# fitted to {data_file.name}: {len(setup.data)} rows, scatter {result.scatter:.2%}; in "
        "brackets 95 % intervals",
        *(f"# {estimate_line(e, result.parameters)}" for e in result.estimates),
        *(f"# NOT DETERMINED: {line}" for line in result.warnings),
        *([f"# assumed: {', '.join(setup.assumed)}"] if setup.assumed else []),
    ]
    if setup.law == "friction-map":
        films = ", ".join(f'"{D * 1e9:g} nm"' for D in np.unique(setup.data.thickness))
        comments.append(f"# the case needs contact.film.thickness too; the data's: {films}")
    lines = _lines(_table(setup, result), result)
    return "\n".join([*comments, "[contact.friction]", *lines]) + "\n"


def estimate_line(estimate: Estimate[Coordinate], law: Parameters) -> str:
    """Such as "eta_b = 0.503 Pa*s (0.489 to 0.517)"; an open end is a question mark."""
    key = estimate.coordinate.key
    film = None
    if key == "V_star" and isinstance(law, FrictionMapParameters):
        film = law.V_star_at
    where = f" at {film * 1e9:g} nm" if film is not None else ""
    return value_and_ends(estimate, where, digits=6 if key == "alpha" else 4)


def value_and_ends(estimate: Estimate[Which], where: str = "", digits: int = 4) -> str:
    """Name, value, unit and interval."""
    ends = ["?" if end is None else f"{end:.{digits}g}" for end in (estimate.low, estimate.high)]
    shown = f"{estimate.value:.{digits}g} {estimate.coordinate.unit}".strip()
    return f"{estimate.coordinate.name}{where} = {shown} ({ends[0]} to {ends[1]})"


def _table(setup: FitSetup, result: FitResult) -> dict[str, Any]:
    """Every key of the law with its value as a case file has it, fitted or not."""
    dump = setup.friction.model_dump(mode="json", exclude_none=True)
    # A preset would put its own value in the place of a key that is only a comment.
    table = {k: _plain(v) for k, v in dump.items() if k != "preset" and not _is_default(k, v)}
    for key in setup.names:
        value = getattr(result.parameters, key)
        if isinstance(value, tuple):
            rows = [[f"{film:.12g} m", _rounded(entry, _DIGITS_OF_ALPHA)] for film, entry in value]
            table[key] = rows
        else:
            number = _rounded(value, _DIGITS_OF_ALPHA if key == "alpha" else _DIGITS)
            unit = RANGES[key].unit
            table[key] = f"{number:.10g} {unit}" if unit else number
    if "mu_d" not in (*setup.names, *setup.fixed):
        table.pop("mu_d", None)
    return table


IDLE = ("switch", "reentry", "reset_slip_on_opening", "zeta", "eta_inf", "barus")
"""Keys that are not written out where they have their default."""


def _is_default(key: str, value: Any) -> bool:
    if key not in IDLE:
        return False
    default = FrictionMap.model_fields[key].default
    return bool(_number(value) == default) if isinstance(default, float) else value == default


def _number(value: Any) -> float:
    """Of a quantity in SI, with or without its unit."""
    return float(str(value).split(" ", 1)[0])


def _lines(table: dict[str, Any], result: FitResult) -> Iterator[str]:
    """The lines of the section, one for each key."""
    loose = [e.coordinate for e in result.estimates if e.warning]
    films = {c.film for c in loose if c.key == "alpha"}
    keys = {c.key for c in loose if c.key != "alpha"}
    if "V_star" in keys:
        keys.add("V_star_at")
    absent = ABSENT if table["law"] == "friction-map" else ABSENT_WITHOUT_FILM
    alpha = table.get("alpha")
    if films and (not isinstance(alpha, list) or len(films) == len(alpha)):
        keys.add("alpha")
    for key, value in table.items():
        line = toml_text({key: value}).strip()
        if key in keys:
            yield f"# {line}  # not determined: {absent.get(key, NEEDED)}"
        elif key == "alpha" and films:
            yield from _alpha_lines(value, films)
        else:
            yield line


def _alpha_lines(rows: list[list[Any]], films: set[float | None]) -> Iterator[str]:
    """A table over the film thickness, of which some rows are not determined."""
    loose = {f"{film:.12g} m" for film in films}
    yield "alpha = ["
    for film, value in rows:
        row = f'["{film}", {value!r}],'
        if film in loose:
            yield f"    # {row}  # not determined: without it the case takes what the others say"
        else:
            yield f"    {row}"
    yield "]"


def _plain(value: Any) -> Any:
    """A quantity as people write it: "1e+12 Pa/m" and not "1000000000000.0 Pa/m"."""
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if not isinstance(value, str) or " " not in value:
        return value
    number, unit = value.split(" ", 1)
    return f"{float(number):.12g} {unit}"


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
