"""Tribometer data: a CSV file with units in its header, in SI."""

from __future__ import annotations

import csv
import dataclasses
import difflib
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.app.case.quantities import Quantity, QuantityError
from tribox.app.case.toml_files import read_text
from tribox.app.errors import InputError

Floats = NDArray[np.float64]

# -- A CSV file with units in its header, in SI: what all fits read their measurements from --------

Aliases = Mapping[str, Sequence[str]]
NO_ALIASES: Aliases = {}
MOST_ROWS = 5000
MOST_TOLD = 20  # faults of a file that are told; of more only the number
_LONGEST_HEADING = 200
_SHOWN = 60  # letters of a cell in a message
_POINT, _COMMA = (
    re.compile(rf"\s*[+-]?(?:\d+{mark}\d*|{mark}\d+)(?:[eE][+-]?\d+)?\s*") for mark in (r"\.", ",")
)
_QUOTED = re.compile(r'"[^"]*"')
_HEADER = re.compile(r"\s*([^\[\]()]+?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))?\s*")


@dataclass(frozen=True, slots=True)
class Table:
    """The columns of a file."""

    path: Path  # of the file
    values: dict[str, Floats]  # (n,) each, SI, by name; NaN where a cell that may be is empty
    lines: list[int]  # number of each row's line in the file
    # headings of the file that are no column's name, with that they stand for
    renamed: tuple[tuple[str, str], ...] = ()


TESTS = {
    "tribox fit --material, as a test of a rubber or metal": re.compile(
        "strain|stress|modulus|frequency"
    ),
    "tribox fit without --material, as friction": re.compile("traction|friction|velocity|speed"),
}
"""Which command reads columns with such words in their names."""


def read_table(
    path: Path,
    known: Mapping[str, Quantity],
    constants: Mapping[str, float] | None = None,
    ignored: Sequence[str] = (),
    may_be_empty: Sequence[str] = (),
    aliases: Aliases = NO_ALIASES,
) -> Table:
    """Read a file; InputError has a line on each wrong column, unit and value.

    Lines that begin with "#" are comments. The header names columns with their unit, as in
    "velocity [mm/s]". Where semicolons or tabs stand between columns, decimals may stand behind
    commas. Columns are those ``known``, or ``constants`` (SI) where the file has none; ``ignored``:
    not read; ``may_be_empty``: in some cells; ``aliases``: other names, in lower case with "_".
    """
    separator, lines = _records(path)
    if not lines:
        raise InputError(f"{path}: is empty; the first line names the columns")
    (number, header), rows = lines[0], lines[1:]
    columns = _columns(path, number, header, known, ignored, aliases)
    if not rows:
        raise InputError(f"{path}: has no data below the header")
    if len(rows) > MOST_ROWS:
        reason = f"has {len(rows)} rows of data; at most {MOST_ROWS} can be fitted at a time"
        raise InputError(f"{path}: {reason}: average those that repeat a measurement")
    if separator != ",":  # where commas part columns, none parts decimals
        rows = _with_points(path, columns, rows)
    table = _values(path, columns, rows, len(header), known, may_be_empty)
    for name, value in (constants or {}).items():
        if name in table:
            raise InputError(f"{path}: column {name} is in the file, so --fix {name} cannot be")
        table[name] = np.full(len(rows), value)
    renamed = ((header[k].strip(), n) for k, (n, _) in columns.items() if _name(header[k]) != n)
    return Table(path, table, [line for line, _ in rows], tuple(renamed))


def _columns(
    path: Path,
    number: int,
    header: list[str],
    known: Mapping[str, Quantity],
    ignored: Sequence[str],
    aliases: Aliases,
) -> dict[int, tuple[str, str]]:
    """Name and unit as written of each column that is read, by its place."""
    unread = {k for k, text in enumerate(header) if not text.strip() or _is_named(text, ignored)}
    for name in ignored:
        if not any(_is_named(text, [name]) for text in header):
            there = ", ".join(text.strip()[:_SHOWN] for text in header)
            raise InputError(f'--ignore-columns: no column "{name}" in {path}; there are {there}')
    found: dict[int, tuple[str, str]] = {}
    wrong = []
    standard = [_standard(_name(text), known, aliases) for text in header]
    strange = {
        place: _name(text)
        for place, text in enumerate(header)
        if place not in unread
        and not difflib.get_close_matches(standard[place][:_SHOWN].lower(), known, n=1)
    }
    if strange:
        words = ", ".join(f'"{header[place].strip()[:_SHOWN]}"' for place in strange)
        cure = f'leave them unread with --ignore-columns "{",".join(strange.values())}"'
        # Where no heading is known, the line is hardly that of the names.
        if len(strange) + len(unread) == len(header):
            cure = 'begin lines before that of the names with "#"'
        wrong.append(
            f"{path}:{number}: no such column{'s' * (len(strange) > 1)} {words}; there are "
            f"{', '.join(known)}; take other columns out, or {cure}"
        )
    for place, text in enumerate(header):
        if place not in unread and place not in strange:
            try:
                found[place] = _column(path, number, text, standard[place], known)
            except InputError as error:
                wrong.append(str(error))
    names = [name for name, _ in found.values()]
    twice = dict.fromkeys(name for name in names if names.count(name) > 1)
    for name in twice:
        places = [place for place, (other, _) in found.items() if other == name]
        words = ", ".join(f'"{header[place].strip()[:_SHOWN]}"' for place in places)
        wrong.append(f"{path}:{number}: column {name} is there twice: {words}")
    if wrong:
        read = [name for place, name in enumerate(standard) if place not in unread]
        wrong = _of_other_test(path, read, known) or wrong
    refuse(wrong)
    return found


def _of_other_test(path: Path, names: Sequence[str], known: Mapping[str, Quantity]) -> list[str]:
    """A line on a file that the other kind of ``tribox fit`` reads; none where it is not one."""
    for command, pattern in TESTS.items():
        there = [name for name in names if pattern.search(name.lower())]
        if there and not any(pattern.search(name) for name in known):
            shown = ", ".join(name.strip()[:_SHOWN] for name in there)
            return [f"{path}: {shown}: read by {command}"]
    return []


def _name(text: str) -> str:
    """The name in a heading, without its unit."""
    match = _HEADER.fullmatch(text) if len(text) <= _LONGEST_HEADING else None
    return match[1] if match else text.strip()[:_SHOWN]


def _is_named(text: str, names: Sequence[str]) -> bool:
    """Whether a heading is one of some names, in capitals or not, its unit written or not."""
    lower = {name.lower() for name in names}
    return text.strip().lower() in lower or _name(text).lower() in lower


def _standard(name: str, known: Mapping[str, Quantity], aliases: Aliases) -> str:
    """The column that a name stands for; the name itself, if it is no other's."""
    plain = re.sub(r"[\s_-]+", "_", name.strip().lower())
    if plain in known:
        return plain
    return next((column for column, names in aliases.items() if plain in names), name)


def _with_points(
    path: Path, columns: Collection[int], rows: list[tuple[int, list[str]]]
) -> list[tuple[int, list[str]]]:
    """Rows with decimals behind points in columns that are read; InputError if both are there."""
    points = commas = 0
    for number, row in rows:
        cells = [row[place] for place in columns if place < len(row)]
        # The first line with such a cell; 0 as long as there is none.
        points = points or number * any(map(_POINT.fullmatch, cells))
        commas = commas or number * any(map(_COMMA.fullmatch, cells))
        if points and commas:
            reason = f"decimals behind a point in line {points}, and behind a comma in line"
            raise InputError(f"{path}:{number}: {reason} {commas}; write all behind points")
    if not commas:
        return rows

    def pointed(place: int, cell: str) -> str:
        return cell.replace(",", ".") if place in columns and _COMMA.fullmatch(cell) else cell

    return [(number, [pointed(k, cell) for k, cell in enumerate(row)]) for number, row in rows]


def _values(
    path: Path,
    columns: Mapping[int, tuple[str, str]],
    rows: Sequence[tuple[int, list[str]]],
    width: int,
    known: Mapping[str, Quantity],
    may_be_empty: Sequence[str],
) -> dict[str, Floats]:
    """The columns, each (n,), SI."""
    table: dict[str, Floats] = {name: np.zeros(len(rows)) for name, _ in columns.values()}
    wrong = []
    for k, (line, row) in enumerate(rows):
        if len(row) != width:
            reason = f"has {len(row)} values for {width} columns of the header"
            wrong.append(f"{path}:{line}: {reason}")
            continue
        for place, (name, unit) in columns.items():
            cell = row[place].strip()
            try:
                empty = not cell and name in may_be_empty
                table[name][k] = math.nan if empty else _value(cell, unit, known[name])
            except QuantityError as error:
                wrong.append(f"{path}:{line}: {name} = {error}")
    refuse(wrong)
    return table


def refuse(wrong: Sequence[str]) -> None:
    """Raise what is wrong, if anything is, a line each."""
    if wrong:
        more = list(wrong[1:MOST_TOLD])
        if len(wrong) > MOST_TOLD:
            more.append(f"... and {len(wrong) - MOST_TOLD} more")
        raise InputError(wrong[0], more, told=True)


def _records(path: Path) -> tuple[str, list[tuple[int, list[str]]]]:
    """What parts columns; number and cells of each line that is neither empty nor a comment."""
    separator, found = "", list[tuple[int, list[str]]]()
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        # By the line of the names, in which quoted ones may hold other separators.
        separator = separator or max(",;\t", key=_QUOTED.sub("", line).count)
        try:
            cells = next(csv.reader([line], delimiter=separator))
        except csv.Error as error:  # a cell of more than 131072 letters
            raise InputError(f"{path}:{number}: no line of a table ({error})") from None
        if any(cell.strip() for cell in cells):
            found.append((number, cells))
    return separator, found


def _column(
    path: Path, line: int, text: str, name: str, known: Mapping[str, Quantity]
) -> tuple[str, str]:
    """Name of a column and its unit as written, from a heading that stands for it."""
    match = _HEADER.fullmatch(text) if len(text) <= _LONGEST_HEADING else None
    if match is None or name not in known:
        near = difflib.get_close_matches(name[:_SHOWN].lower(), known, n=1)[0]
        unit = known[near].unit
        in_brackets = f', with its unit in brackets as in "{near} [{unit}]"' if unit else ""
        hint = f'did you mean "{near}"{in_brackets}?'
        raise InputError(f'{path}:{line}: no such column "{text.strip()[:_SHOWN]}"; {hint}')
    unit, written = known[name].unit, match[2] or match[3]
    if not unit:
        if written in (None, "", "-", "1"):
            return name, ""
    elif not written:
        raise InputError(f'{path}:{line}: column {name} needs its unit, as in "{name} [{unit}]"')
    try:
        known[name].parse(f"1 {written}")
    except QuantityError as error:
        raise InputError(f"{path}:{line}: column {name}: {error}") from None
    return name, written or ""


def _value(text: str, unit: str, quantity: Quantity) -> float:
    """A cell's value in SI."""
    # A quantity would also take "2 m", and multiply by the unit of the heading once more.
    try:
        float(text)
    except ValueError:
        shown = f"{text[:_SHOWN]}..." if len(text) > _SHOWN else text
        cure = ", with a point before decimals" if "," in text else ""
        raise QuantityError(f'"{shown}": must be a number{cure}') from None
    try:
        return quantity.parse(f"{text} {unit}")
    except QuantityError as error:
        raise QuantityError(f"{text}: {error}") from None


# -- Tribometer data: a CSV file with units in its header, in SI -----------------------------------

COLUMNS: dict[str, Quantity] = {
    "thickness": Quantity("m", ge=0.0),
    "velocity": Quantity("m/s", gt=0.0),
    "pressure": Quantity("Pa", gt=0.0),
    "load": Quantity("N", gt=0.0),
    "area": Quantity("m^2", gt=0.0),
    "traction": Quantity("Pa", gt=0.0),
    "force": Quantity("N", gt=0.0),
    "friction_coefficient": Quantity("", gt=0.0),
    "effective_viscosity": Quantity("Pa*s", gt=0.0),
    "slip": Quantity("m", gt=0.0),
    "weight": Quantity("", gt=0.0),
}
ALIASES = {
    "velocity": ("speed", "sliding_speed", "sliding_velocity"),
    "load": ("normal_force", "normal_load"),
    "force": ("friction_force", "tangential_force"),
    "friction_coefficient": ("cof", "mu", "coefficient_of_friction"),
    "pressure": ("contact_pressure",),
    "area": ("contact_area",),
    "thickness": ("film_thickness",),
    "traction": ("friction_stress", "shear_stress"),
}
"""What tribometers call columns of ``COLUMNS``, in lower case and with "_" between words."""
OBSERVED = ("traction", "force", "friction_coefficient", "effective_viscosity")
CONSTANTS = ("thickness", "velocity", "pressure", "load", "area")
"""Columns that one value may stand for."""


@dataclass(frozen=True, slots=True)
class TribometerData:
    """Measured friction; every array is (n,)."""

    thickness: Floats  # m, film thickness D; 0 is dry
    velocity: Floats  # m/s
    pressure: Floats  # Pa, load per area
    traction: Floats  # Pa, friction force per area
    slip: Floats  # m, distance slid since rest; NaN where sliding was steady
    weight: Floats  # of the squared residual
    observed: str  # name of the column that the traction was found from
    # whether there is a film thickness; without it the thickness stands at 0
    knows_film: bool = True
    # whether there is a pressure; without it, pressure and traction are those of 1 Pa, and only
    # their ratio means something
    knows_pressure: bool = True
    # headings of the file that are not names of ``COLUMNS``, with those they stand for
    renamed: tuple[tuple[str, str], ...] = ()

    def __len__(self) -> int:
        return len(self.traction)

    @property
    def steady(self) -> NDArray[np.bool_]:
        """(n,), rows without a slip."""
        return np.isnan(self.slip)


def read_data(
    path: Path,
    constants: Mapping[str, float] | None = None,
    ignored: Sequence[str] = (),
    needs_film: bool = True,
    needs_pressure: bool = True,
) -> TribometerData:
    """Read a data file; InputError has a line on each wrong column, unit and value.

    Of ``COLUMNS``, as :func:`read_table` says; the slip may be left empty in a row of steady
    sliding. ``constants``: of ``CONSTANTS`` that the file does not have, SI; ``ignored``: columns
    not read; whether the law needs a film, and the pressure in steady sliding.
    """
    table = read_table(path, COLUMNS, constants, ignored, may_be_empty=("slip",), aliases=ALIASES)
    data = _assembled(path, table.values, table.lines, needs_film, needs_pressure)
    return dataclasses.replace(data, renamed=table.renamed)


def _assembled(
    path: Path, table: dict[str, Floats], lines: list[int], needs_film: bool, needs_pressure: bool
) -> TribometerData:
    """Pressure and traction from what there is."""
    seen = [name for name in OBSERVED if name in table]
    if len(seen) != 1:
        found = " and ".join(seen) if seen else "none"
        raise InputError(f"{path}: needs one column of {', '.join(OBSERVED)}; found {found}")
    knows_film = "thickness" in table
    if not knows_film and (needs_film or seen[0] == "effective_viscosity"):
        raise _missing(path, "thickness", _OTHER_LAWS if needs_film else "")
    if "velocity" not in table:
        raise _missing(path, "velocity")
    ones = np.ones(len(lines))
    given = "pressure" in table or {"load", "area"} <= table.keys()
    sliding = bool(np.isnan(table.get("slip", math.nan * ones)).all())
    ratio = seen[0] == "friction_coefficient" and sliding
    spare = _NO_DRAG if ratio and not needs_film else ""
    _see_pressure(path, table, seen[0], needs_pressure or not ratio, spare)
    area = table.get("area", ones)
    pressure: Floats = ones
    if given:
        pressure = table["pressure"] if "pressure" in table else table["load"] / area
    D, V, observed = table.get("thickness", 0.0 * ones), table["velocity"], table[seen[0]]
    if seen[0] == "effective_viscosity" and (D == 0.0).any():
        line = lines[int(np.argmax(D == 0.0))]
        raise InputError(f"{path}:{line}: thickness = 0: a dry contact has no effective viscosity")
    to_traction: dict[str, NDArray[Any]] = {
        "traction": ones,
        "force": 1.0 / area,
        "friction_coefficient": pressure,
        "effective_viscosity": V / np.where(D > 0.0, D, 1.0),
    }
    return TribometerData(
        thickness=D,
        velocity=V,
        pressure=pressure,
        traction=observed * to_traction[seen[0]],
        slip=table.get("slip", math.nan * ones),
        weight=table.get("weight", ones),
        observed=seen[0],
        knows_film=knows_film,
        knows_pressure=given,
    )


def _see_pressure(
    path: Path, table: Mapping[str, Floats], observed: str, needed: bool, otherwise: str
) -> None:
    """See that there is a pressure, once, and an area where forces are to be divided by one."""
    both = {"pressure", "load"} <= table.keys()
    if both or (needed and not {"pressure", "load"} & table.keys()):
        found = "both" if both else "neither"
        constant = "" if both else '; one value for all rows: --fix "pressure=VALUE Pa"'
        reason = f"needs either pressure, or load with area; found {found}{constant}"
        raise InputError(f"{path}: {reason}{'' if both else otherwise}")
    if "area" not in table and (observed == "force" or (needed and "load" in table)):
        raise _missing(path, "area", otherwise)


_NO_DRAG = "; without the viscous part of the law, --fix viscous=0, none is needed"
_OTHER_LAWS = "; --law stribeck and --law coulomb ask for none"


def _missing(path: Path, name: str, otherwise: str = "") -> InputError:
    unit = COLUMNS[name].unit
    return InputError(
        f'{path}: column {name} is missing; add "{name} [{unit}]", or one value for all rows with '
        f'--fix "{name}=VALUE {unit}"{otherwise}'
    )
