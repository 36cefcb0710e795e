"""Tests of materials: what a CSV file holds of relaxation, vibration, cycles or a metal, in SI.

A column's name says how it was measured: "shear_stress", "true_stress", "tensile_modulus". Of plain
names ("stress") the user says it. What a file is of follows from its columns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from tribox.app.case.quantities import Quantity, QuantityError, split_quantity
from tribox.app.errors import InputError
from tribox.app.fit.data import Floats, Table, read_table, refuse

Kind = Literal["relaxation", "vibration", "cycles", "metal"]


HOTTEST = 2000.0  # K, of a temperature that is no mistake
LARGEST_STRAIN = 20.0


class _Frequency(Quantity):
    """Cycles, or radians, per second: 1 Hz is 2 pi rad/s, which no library of units knows."""

    def parse(self, value: object) -> float:
        """In the unit of this column."""
        _, written = split_quantity(value)
        angular = "rad" in written
        if angular != ("rad" in self.unit):
            other = "angular_frequency [rad/s]" if angular else "frequency [Hz]"
            raise QuantityError(f'"{written}" is the unit of another column, "{other}"')
        return Quantity.parse(self, value)


MEASURES = {
    "shear": ("stress", "strain", "modulus", "storage_modulus", "loss_modulus"),
    "tensile": ("modulus", "storage_modulus", "loss_modulus"),
    "engineering": ("stress", "strain"),
    "true": ("stress", "strain"),
}
"""How a column was measured, and the columns of which that is said."""
_PLAIN: dict[str, Quantity] = {
    "stress": Quantity("Pa"),
    "strain": Quantity("", gt=-1.0, lt=LARGEST_STRAIN),
    "modulus": Quantity("Pa", gt=0.0),
    "storage_modulus": Quantity("Pa", gt=0.0),
    "loss_modulus": Quantity("Pa", gt=0.0),
}
TEMPERATURE = Quantity("K", gt=0.0, le=HOTTEST)
COLUMNS: dict[str, Quantity] = {
    "time": Quantity("s", ge=0.0),
    "frequency": _Frequency("Hz", gt=0.0),
    "angular_frequency": _Frequency("rad/s", gt=0.0),
    "temperature": TEMPERATURE,
    **_PLAIN,
    **{f"{how}_{name}": _PLAIN[name] for how, names in MEASURES.items() for name in names},
    "weight": Quantity("", gt=0.0),
}
CONSTANTS = tuple(name for name in COLUMNS if name.endswith("strain"))
"""Columns that one value may stand for: the strain of a relaxation test."""
HELD = 1e-3  # share by which the strain of a relaxation test may vary


@dataclass(frozen=True, slots=True)
class MaterialData:
    """A test of a material; every array is (n,)."""

    kind: Kind  # what was done
    weight: Floats  # of the squared residual
    time: Floats | None = None  # s, since the step, or of the cycles; None of vibration and metals
    # shear strain of a relaxation test in shear, else logarithmic; None of moduli
    strain: Floats | None = None
    # Pa; true, but of cycles of a rubber as ``engineering`` says; None of moduli
    stress: Floats | None = None
    modulus: Floats | None = None  # Pa, shear modulus over time, or storage modulus
    loss: Floats | None = None  # Pa, loss modulus (in shear); None but of vibration
    frequency: Floats | None = None  # rad/s
    temperature: Floats | None = None  # K; None if not measured
    in_shear: bool = False  # whether strain and stress, or moduli, are of shear
    engineering: bool = False  # whether the stress is per undeformed area

    def __len__(self) -> int:
        return len(self.weight)


def read_material(
    path: Path,
    constants: Mapping[str, float],
    ignored: Sequence[str],
    measure: str | None,
    is_metal: bool | None,
) -> MaterialData:
    """Read a data file; InputError if columns, units or values are wrong, or of no test.

    See :func:`tribox.app.fit.data.read_table`. ``constants``: of ``CONSTANTS``, SI; ``measure``: of
    ``MEASURES``, what plain columns are, None: there may be none; ``is_metal``: whether the law is
    a metal's, None: unless there is a time.
    """
    if measure is not None and measure not in MEASURES:
        raise InputError(f"--measure {measure}: must be one of {', '.join(MEASURES)}")
    table = read_table(path, COLUMNS, constants, ignored)
    values, how = _named(path, table.values, measure)
    weight = values.get("weight", np.ones(len(table.lines)))
    if "frequency" in values or "angular_frequency" in values:
        return _vibration(path, values, how, weight)
    if is_metal or (is_metal is None and "time" not in values):
        return _metal(path, values, how, weight)
    if "time" not in values:
        raise _missing(path, "time", "s", "a rubber is fitted over time or frequency")
    # See that time goes on from row to row.
    time = table.values["time"]
    wrong = np.flatnonzero(np.diff(time) <= 0.0)
    if wrong.size:
        row = int(wrong[0]) + 1
        raise InputError(
            f"{table.path}:{table.lines[row]}: time = {time[row]:g} s: must be later than the row "
            f"before, {time[row - 1]:g} s"
        )
    if "modulus" in values:
        # E = 3 G of a rubber, whose volume does not change.
        shear = np.asarray(values["modulus"] / (1.0 if how["modulus"] == "shear" else 3.0))
        in_shear = how["modulus"] == "shear"
        return MaterialData("relaxation", weight, values["time"], modulus=shear, in_shear=in_shear)
    _need(path, values, "strain", "stress")
    # A strain that is held is a relaxation, one that goes on is cycles.
    spread = np.ptp(values["strain"])
    if spread <= HELD * float(np.abs(values["strain"]).max()):
        return _relaxation(table, values, how, weight)
    return _cycles(path, values, how, weight)


def _named(
    path: Path, found: Mapping[str, Floats], measure: str | None
) -> tuple[dict[str, Floats], dict[str, str]]:
    """Columns by their plain names, and how each was measured."""
    values: dict[str, Floats] = {}
    how: dict[str, str] = {}
    wrong = []
    for name, column in found.items():
        prefix, _, rest = name.partition("_")
        plain = rest if prefix in MEASURES and rest in MEASURES[prefix] else name
        if plain in values:
            wrong.append(f"{path}: column {plain} is there in two forms; take one of them out")
        values[plain] = column
        if plain in _PLAIN:
            allowed = [one for one, names in MEASURES.items() if plain in names]
            how[plain] = prefix if plain != name else measure or ""
            if how[plain] not in allowed:
                forms = ", ".join(f'"{one}_{plain}"' for one in allowed)
                reason = f"does not say how it was measured; name it {forms}"
                options = " or ".join(f"--measure {one}" for one in allowed)
                wrong.append(f"{path}: column {plain} {reason}, or state it with {options}")
    refuse(wrong)
    return values, how


def _need(path: Path, values: Mapping[str, Floats], *names: str) -> None:
    for name in names:
        if name not in values:
            forms = [one for one, of in MEASURES.items() if name in of]
            unit = _PLAIN[name].unit
            shown = f"{forms[0]}_{name} [{unit}]" if unit else f"{forms[0]}_{name}"
            raise InputError(
                f'{path}: column {name} is missing; add "{shown}" (or '
                f"{', '.join(forms[1:])} in the place of {forms[0]})"
            )


def _missing(path: Path, name: str, unit: str, why: str) -> InputError:
    return InputError(f'{path}: column {name} is missing; add "{name} [{unit}]": {why}')


def _vibration(
    path: Path, values: Mapping[str, Floats], how: Mapping[str, str], weight: Floats
) -> MaterialData:
    if "frequency" in values and "angular_frequency" in values:
        raise InputError(f"{path}: has frequency and angular_frequency; take one of them out")
    _need(path, values, "storage_modulus", "loss_modulus")
    if how["storage_modulus"] != how["loss_modulus"]:
        raise InputError(f"{path}: storage_modulus and loss_modulus must both be shear or tensile")
    in_shear = how["storage_modulus"] == "shear"
    of_shear = 1.0 if in_shear else 3.0
    omega = (
        values["angular_frequency"]
        if "angular_frequency" in values
        else 2.0 * math.pi * values["frequency"]
    )
    return MaterialData(
        "vibration",
        weight,
        modulus=np.asarray(values["storage_modulus"] / of_shear),
        loss=np.asarray(values["loss_modulus"] / of_shear),
        frequency=omega,
        temperature=values.get("temperature"),
        in_shear=in_shear,
    )


def _relaxation(
    table: Table, values: Mapping[str, Floats], how: Mapping[str, str], weight: Floats
) -> MaterialData:
    """A step of shear or of stretch, with the stress as a shear modulus."""
    strain, stress = values["strain"], values["stress"]
    if not strain.all():
        raise InputError(f"{table.path}: the strain of a relaxation test is 0; it must be the step")
    if (how["strain"] == "shear") != (how["stress"] == "shear"):
        raise InputError(f"{table.path}: strain and stress must both be of shear, or none")
    in_shear = how["strain"] == "shear"
    strain = strain if in_shear or how["strain"] == "true" else np.log1p(strain)
    if in_shear:
        modulus = stress / strain
    else:
        # True stress of a neo-Hookean rubber without change of volume, per shear modulus.
        stretch = np.exp(strain)
        per_modulus = stretch**2 - 1.0 / stretch
        modulus = stress * (stretch if how["stress"] == "engineering" else 1.0) / per_modulus
    if (modulus <= 0.0).any():
        row = int(np.argmax(modulus <= 0.0))
        raise InputError(
            f"{table.path}:{table.lines[row]}: stress = {stress[row]:g} Pa: must have the sign of "
            f"the strain, {values['strain'][row]:g}"
        )
    return MaterialData(
        "relaxation", weight, values["time"], strain, modulus=modulus, in_shear=in_shear
    )


def _cycles(
    path: Path, values: Mapping[str, Floats], how: Mapping[str, str], weight: Floats
) -> MaterialData:
    if "shear" in (how["strain"], how["stress"]):
        raise InputError(
            f"{path}: cycles in shear cannot be fitted, only uniaxial ones (engineering or true "
            "strain and stress); of shear give the moduli over frequency"
        )
    strain = values["strain"] if how["strain"] == "true" else np.log1p(values["strain"])
    engineering = how["stress"] == "engineering"
    time, stress = values["time"], values["stress"]
    return MaterialData("cycles", weight, time, strain, stress, engineering=engineering)


def _metal(
    path: Path, values: Mapping[str, Floats], how: Mapping[str, str], weight: Floats
) -> MaterialData:
    _need(path, values, "strain", "stress")
    if "shear" in (how["strain"], how["stress"]):
        raise InputError(f"{path}: a metal is fitted to uniaxial strain and stress, not to shear")
    strain = values["strain"] if how["strain"] == "true" else np.log1p(values["strain"])
    stress = values["stress"]
    if how["stress"] == "engineering":  # No change of volume.
        stress = stress * np.exp(strain)
    if not strain.any() or not stress.any():
        raise InputError(f"{path}: strain or stress is 0 in all rows")
    return MaterialData("metal", weight, strain=strain, stress=stress)
