"""Tribometer data: a CSV file with units in its header, in SI."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.app.case.quantities import Quantity
from tribox.app.errors import InputError
from tribox.app.fit.table import read_table

Floats = NDArray[np.float64]

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
    """Measured friction; every array is (n,).

    Attributes:
        thickness: m, film thickness D; 0 is dry.
        velocity: m/s.
        pressure: Pa, load per area.
        traction: Pa, friction force per area.
        slip: m, distance slid since rest; NaN where sliding was steady.
        weight: Of the squared residual.
        observed: Name of the column that the traction was found from.
        knows_film: Whether there is a film thickness; without it the thickness stands at 0.
        knows_pressure: Whether there is a pressure; without it, pressure and traction are those of
            1 Pa, and only their ratio means something.
        renamed: Headings of the file that are not names of ``COLUMNS``, with those they stand for.
    """

    thickness: Floats
    velocity: Floats
    pressure: Floats
    traction: Floats
    slip: Floats
    weight: Floats
    observed: str
    knows_film: bool = True
    knows_pressure: bool = True
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
    """Read a data file.

    Lines that begin with "#" are comments. The header names columns of ``COLUMNS`` with their unit,
    as in "velocity [mm/s]". The slip may be left empty in a row of steady sliding.

    Args:
        path: The file.
        constants: Columns of ``CONSTANTS`` that the file does not have, SI.
        ignored: Columns of any name, with or without their unit, that are not read.
        needs_film: Whether the law to fit asks for a film thickness.
        needs_pressure: Whether its coefficient of friction depends on the pressure in steady
            sliding.

    Raises:
        InputError: Columns, units or values are wrong; its lines name all of them.
    """
    table = read_table(path, COLUMNS, constants, ignored, may_be_empty=("slip",), aliases=ALIASES)
    data = _assembled(path, table.values, table.lines, needs_film, needs_pressure)
    return dataclasses.replace(data, renamed=table.renamed)


def _assembled(
    path: Path,
    table: dict[str, Floats],
    lines: list[int],
    needs_film: bool,
    needs_pressure: bool,
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
    """See that there is a pressure, once, and an area where forces are to be divided by one.

    Raises:
        InputError: otherwise.
    """
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
