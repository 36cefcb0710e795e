"""What a fit is asked for: data, parameters, and the law before it, from options."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tribox.app.case.friction import TABLES, LawTable
from tribox.app.case.quantities import Quantity, QuantityError
from tribox.app.case.table import nearest
from tribox.app.case.toml_files import apply_override
from tribox.app.errors import InputError
from tribox.app.fit.data import COLUMNS, CONSTANTS, TribometerData, read_data
from tribox.app.fit.model import LAWS, RANGES, RIGID, Parameters
from tribox.app.friction_map.setup import validated_contact
from tribox.forms.friction.parameters import FrictionMapParameters

ASSUMED: dict[str, Any] = {
    "preset": "friction-map",
    "mu_s": 0.1,
    "K_T": "1e12 Pa/m",
    "V_star": "1 mm/s",
    "V_star_at": "10 nm",
}
"""What is neither fitted nor fixed."""
WEAKENING = ("mu_d", "A_d", "B")
EXCLUSIVE = (("alpha", "beta"), ("V_star", "gamma"))
NOT_FIXABLE = ("law", "switch", "reentry")
TOLD = (
    *("mu_s", "A_d", "B", "K_T", "eta_b", "D_min", "D_max", "alpha", "beta", "V_star"),
    *("V_star_at", "gamma", "transition_width", "flow_rule", "delta", "viscous"),
)
"""Keys whose assumed values are told."""


@dataclass(frozen=True, slots=True)
class FitSetup:
    """A fit as asked for."""

    law: str  # of ``LAWS``
    data: TribometerData  # measured friction
    names: tuple[str, ...]  # parameters to fit
    fixed: dict[str, Any]  # keys of the law given by the user, as written
    base: Parameters  # the law with everything that is not fitted
    friction: LawTable  # the same as a table of a case file
    starts: dict[str, float]  # by key, SI

    @property
    def assumed(self) -> dict[str, Any]:
        """What was neither fitted nor fixed, as in a case file."""
        dump = self.friction.model_dump(mode="json", exclude_none=True)
        hidden = {"law", "preset", *self.names, *self.fixed}
        if "gamma" in self.names:
            hidden |= {"V_star", "V_star_at"}
        if self.law == "friction-map" and "mu_d" not in (*self.names, *self.fixed):
            hidden |= {*WEAKENING}  # mu_d follows mu_s.
        if "V_star" in self.names:
            hidden.add("V_star_at")
        return {key: dump[key] for key in TOLD if key in dump and key not in hidden}


def fit_setup(
    data_file: Path,
    parameters: str | None,
    fixed: Sequence[str],
    start: Sequence[str],
    law: str = "friction-map",
    ignored: Sequence[str] = (),
) -> FitSetup:
    """Read data and options; see :func:`tribox.app.fit.run.run_fit` for them, and for errors."""
    if law not in LAWS:
        raise InputError(f"--law {law}: no such law; {nearest(law, list(LAWS))}")
    keys = tuple(key for key in TABLES[law].model_fields if key not in NOT_FIXABLE)
    given = settings(fixed, "--fix", (*keys, *CONSTANTS))
    constants = {
        key: parsed("--fix", key, given.pop(key), COLUMNS[key]) for key in CONSTANTS if key in given
    }
    names = _names(parameters, law) if parameters else None
    needs_pressure = law == "friction-map" or (law == "stribeck" and _drags(names, given))
    data = read_data(data_file, constants, ignored, law == "friction-map", needs_pressure)
    if names is None:
        suggested = _suggested(data, given) if law == "friction-map" else _usual(law, data)
        names = tuple(name for name in suggested if name not in given)
    for name in names:
        if name in given:
            raise InputError(f"{name}: is fitted, so --fix {name} cannot be")
    for first, second in EXCLUSIVE:
        both = {*names, *given} & {first, second}
        if len(both) == 2:
            raise InputError(f"{first}, {second}: only one of the two can be fitted or fixed")
    if not names:
        raise InputError("--fix: holds every parameter, so nothing is left to fit")
    if {"A_d", "B"} & {*names} and "mu_d" not in (*names, *given):
        raise InputError("A_d, B: have no effect without mu_d; fit it too, or give --fix mu_d=...")
    friction: LawTable
    base: Parameters
    if law == "friction-map":
        friction, base = _base(names, given, data)
    else:
        friction, base = _base_without_film(law, names, given)
    starts = {
        key: _start(key, value, names)
        for key, value in settings(start, "--start", LAWS[law]).items()
    }
    return FitSetup(law, data, names, given, base, friction, starts)


def settings(items: Sequence[str], option: str, known: Sequence[str]) -> dict[str, Any]:
    """Values of "key=value" texts, as TOML if they are that."""
    found: dict[str, Any] = {}
    for item in items:
        key = item.partition("=")[0].strip()
        if "=" in item and key not in known:
            raise InputError(f"{option} {item}: no such key; {nearest(key, known)}")
        apply_override(found, item)
    return found


def parsed(option: str, key: str, value: object, quantity: Quantity) -> float:
    """The value of "key=value", SI; InputError if it is none."""
    try:
        return quantity.parse(value)
    except QuantityError as error:
        raise InputError(f"{option} {key} = {value}: {error}") from None


def _start(key: str, value: object, names: Sequence[str]) -> float:
    if key not in names:
        raise InputError(f"--start {key}: is not fitted; fitted are {', '.join(names)}")
    if key in ("V_star", "gamma"):
        raise InputError(f"--start {key}: needs no start, every gap between velocities is tried")
    limits = RANGES[key]
    number = parsed("--start", key, value, Quantity(limits.unit))
    if not limits.lowest < number < limits.highest:
        raise InputError(
            f"--start {key} = {value}: must lie between {limits.lowest:g} and "
            f"{limits.highest:g} {limits.unit}".rstrip()
        )
    return number


def _names(parameters: str, law: str) -> tuple[str, ...]:
    known = LAWS[law]
    names = tuple(name.strip() for name in parameters.split(",") if name.strip())
    if not names:
        raise InputError(f'--parameters "{parameters}": names none; there are {", ".join(known)}')
    for name in names:
        if name not in known:
            reason = f'--parameters: no such parameter "{name}" of law {law}'
            raise InputError(f"{reason}; {nearest(name, known)}")
        if names.count(name) > 1:
            raise InputError(f"--parameters: {name} is there twice")
    return names


def _suggested(data: TribometerData, given: Mapping[str, Any]) -> Iterator[str]:
    """What data of this kind can tell at best."""
    lowest = parsed("--fix", "D_min", given.get("D_min", 0.0), Quantity("m"))
    highest = parsed("--fix", "D_max", given.get("D_max", 250e-9), Quantity("m"))
    yield "mu_s"
    if not data.steady.all():
        yield from WEAKENING
    D = data.thickness[data.steady]
    if ((D > lowest) & (D < highest)).any():
        if "beta" not in given:
            yield "alpha"
        if "gamma" not in given:
            yield "V_star"
    if (D > lowest).any():
        yield "eta_b"


def _usual(law: str, data: TribometerData) -> Iterator[str]:
    """What is fitted of a law that asks for no film."""
    yield from ("mu",) if law == "coulomb" else ("mu_s", "mu_d", "V_s", "viscous")
    if not data.steady.all():
        yield "K_T"


def _drags(names: Sequence[str] | None, given: Mapping[str, Any]) -> bool:
    """Whether Stribeck's law is to have its viscous part, for which T/p depends on p."""
    if names is not None and "viscous" in names:
        return True
    if "viscous" not in given:
        return names is None  # It is fitted as long as nothing is said, and 0 where it is not.
    return parsed("--fix", "viscous", given["viscous"], Quantity("Pa*s/m")) != 0.0


def _base(
    names: Sequence[str], given: Mapping[str, Any], data: TribometerData
) -> tuple[LawTable, FrictionMapParameters]:
    """The law before the fit: what is given over what is assumed, and a value for the rest."""
    table: dict[str, Any] = {"law": "friction-map", **ASSUMED}
    if "gamma" in given or "gamma" in names:
        del table["V_star"], table["V_star_at"]
    # mu_d alone says nothing: what it weakens over is assumed where neither is asked for.
    if {"mu_d", *WEAKENING} & {*names, *given}:
        table |= {"A_d": "1 um", "B": "1e6 1/m"}
    table |= given
    for name in names:
        table[name] = RANGES[name].start
    _set_apart(table, names, given)
    film = float(max(data.thickness.max(), 1e-9))
    # V* is searched, and stated, at a film that was measured.
    if "V_star" in names and "V_star_at" not in given and (data.thickness > 0.0).any():
        table["V_star_at"] = float(data.thickness[data.thickness > 0.0].min())
    friction = _validated(table, film)
    base: FrictionMapParameters = friction.parameters()
    if "mu_d" not in (*names, *given):
        base = dataclasses.replace(base, mu_d=None)
    return friction, base


def _set_apart(table: dict[str, Any], names: Sequence[str], given: Mapping[str, Any]) -> None:
    """Begin with a kinetic coefficient below the static one, where the other one is given."""
    if "mu_s" in names and "mu_d" in given:
        table["mu_s"] = 1.2 * parsed("--fix", "mu_d", given["mu_d"], Quantity("")) + 1e-3
    if "mu_d" in names and "mu_s" not in names:
        table["mu_d"] = 0.8 * parsed("--fix", "mu_s", table["mu_s"], Quantity(""))


def _base_without_film(
    law: str, names: Sequence[str], given: Mapping[str, Any]
) -> tuple[LawTable, Parameters]:
    """The law before the fit, of one that asks for no film."""
    table: dict[str, Any] = {"law": law, **given}
    table |= {name: RANGES[name].start for name in names}
    needed = ("mu",) if law == "coulomb" else ("mu_s", "mu_d", "V_s")
    for key in needed:
        if key not in table:
            raise InputError(f"{key}: neither fitted nor fixed; name it, or give --fix {key}=...")
    _set_apart(table, names, given)
    friction = _validated(table, None)
    if friction.changes:
        raise InputError("--fix mu: must be a number, not a program of time")
    K_T = RIGID if friction.K_T is None else friction.K_T
    return friction, friction.model_copy(update={"K_T": K_T}).parameters()


def _validated(table: dict[str, Any], film: float | None) -> LawTable:
    """A table of friction as a case has it; its faults are told as those of --fix."""
    contact: dict[str, Any] = {"slave": "a", "master": "b", "friction": table}
    if film is not None:
        contact["film"] = {"thickness": film}
    try:
        friction = validated_contact(contact).friction
    except InputError as error:
        raise InputError(str(error).replace("contact.0.friction.", "--fix ")) from None
    assert isinstance(friction, LawTable)
    return friction
