"""Fit of a rubber or metal to its test: what may be asked for, and what is found."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tribox.app.case.quantities import Quantity
from tribox.app.case.table import nearest
from tribox.app.errors import InputError
from tribox.app.fit import material_data, model
from tribox.app.fit.data import Floats
from tribox.app.fit.metal import LAWS, MOST_GIVEN, MetalFit, fit_metal
from tribox.app.fit.prony import LONG_TERM, MOST_BRANCHES, PronyFit, Shift, fit_prony
from tribox.app.fit.setup import parsed, settings

RUBBER = "prony"
MATERIAL_LAWS = (RUBBER, *LAWS)
ASSUMED_RUBBER = {"K": 2e9}
"""The order of rubbers (Wood & Martin, J. Res. NBS 68A (1964) 259)."""
ASSUMED_METAL = {"nu": 0.33}
SOFTEST_METAL = 1e9  # Pa, E below which rows without a time are those of an elastomer
_OF_RUBBER: dict[str, Quantity] = {
    "K": Quantity("Pa", gt=0.0),
    "reference": material_data.TEMPERATURE,
    "temperature": material_data.TEMPERATURE,
}
_OF_METAL: dict[str, Quantity] = {
    "E": Quantity("Pa", gt=0.0),
    "nu": Quantity("", gt=-1.0, lt=0.5),
    "yield_stress": Quantity("Pa", gt=0.0),
    "modulus": Quantity("Pa", ge=0.0),
    "saturation_stress": Quantity("Pa", gt=0.0),
    "exponent": Quantity("", gt=0.0),
    "K": Quantity("Pa", gt=0.0),
    "strain0": Quantity("", gt=0.0),
    "n": Quantity("", gt=0.0, le=1.0),
}
WORDS = {
    "relaxation": "relaxation at a step",
    "vibration": "vibration",
    "cycles": "cycles of a rubber",
    "metal": "uniaxial strain of a metal",
}
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")


@dataclass(frozen=True, slots=True)
class MaterialOptions:
    """What is asked for.

    Attributes:
        law: Of ``MATERIAL_LAWS``; None: a series where there is a time or a frequency, else the
            hardening law that fits best.
        branches: Of the series, or back stresses; None: the number that fits best.
        measure: How plain columns were measured.
        fixed: "key=value" texts.
        ignored: Columns that are not read.
        body: Name of the section; None: by the material.
    """

    law: str | None = None
    branches: int | None = None
    measure: str | None = None
    fixed: Sequence[str] = ()
    ignored: Sequence[str] = ()
    body: str | None = None


@dataclass(frozen=True, slots=True)
class MaterialResult:
    """What was found.

    Attributes:
        data: The test.
        fit: A series, or a metal.
        body: Name of the section.
        estimates: One for each parameter; of a series the long-term modulus last.
        scatter: Standard deviation of the differences: relative, or over the root mean square
            stress.
        criterion: Information criterion of all that were tried.
        given: Keys that were fixed, SI.
        assumed: Keys that were neither fitted nor fixed, SI.
        notes: What there is to say beside.
    """

    data: material_data.MaterialData
    fit: PronyFit | MetalFit
    body: str
    estimates: tuple[model.Estimate[model.MaterialParameter], ...]
    slopes: model.Slopes
    scatter: float
    criterion: Mapping[str, float]
    given: Mapping[str, float]
    assumed: Mapping[str, float]
    notes: tuple[str, ...] = field(default=())

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the data do not determine, a line each."""
        return tuple(e.warning for e in self.estimates if e.warning)

    @property
    def loose(self) -> set[str]:
        """Names of what the data do not determine."""
        return {e.coordinate.name for e in self.estimates if e.warning}

    @property
    def law(self) -> str:
        """Of ``MATERIAL_LAWS``."""
        return RUBBER if isinstance(self.fit, PronyFit) else self.fit.problem.law

    @property
    def residual(self) -> Floats:
        """(m,), without weights: of logarithms, or over the root mean square stress."""
        measured, computed = self.fit.problem.measured, self.fit.computed()
        if isinstance(self.fit, PronyFit) and self.fit.problem.relative:
            return np.asarray(np.log(measured / computed))
        return np.asarray((measured - computed) / self.fit.problem.scale)


def fit_material(data_file: Path, options: MaterialOptions | None = None) -> MaterialResult:
    """Fit a material to a test; InputError if data or options are not usable."""
    options = options or MaterialOptions()
    data, given = read_test(data_file, options)
    return fitted(data, options, given)


# -- what is asked for -----------------------------------------------------------------------------


def read_test(
    data_file: Path, options: MaterialOptions
) -> tuple[material_data.MaterialData, dict[str, float]]:
    """The data, and keys that are fixed, SI; InputError if data or options are not usable."""
    law = options.law
    if law is not None and law not in MATERIAL_LAWS:
        raise InputError(f"--law {law}: no such law of a material; {nearest(law, MATERIAL_LAWS)}")
    if options.body is not None and _NAME.fullmatch(options.body) is None:
        raise InputError(
            f"--body {options.body}: must begin with a letter, then letters, digits, - and _"
        )
    known = (*material_data.CONSTANTS, *dict.fromkeys((*_OF_RUBBER, *_OF_METAL)))
    texts = settings(options.fixed, "--fix", known)
    constants = {
        k: parsed("--fix", k, texts.pop(k), material_data.COLUMNS[k])
        for k in material_data.CONSTANTS
        if k in texts
    }
    is_metal = None if law is None else law != RUBBER
    data = material_data.read_material(
        data_file, constants, options.ignored, options.measure, is_metal
    )
    allowed = dict(_OF_RUBBER)
    if data.kind == "metal":
        keys = {key for one in ((law,) if law else LAWS) for key in LAWS[one]} | {"E", "nu"}
        keys |= {"modulus"} if law in (None, "voce") else set()
        allowed = {key: _OF_METAL[key] for key in _OF_METAL if key in keys}
    elif law is not None and law != RUBBER:
        raise InputError(f"--law {law}: is of a metal, but {data_file} holds {WORDS[data.kind]}")
    elif data.temperature is None:
        allowed = {"K": _OF_RUBBER["K"]}
    for key in texts:
        if key not in allowed:
            of = f"law {law}" if law else WORDS[data.kind]
            raise InputError(f"--fix {key}: is no key of {of}; {nearest(key, list(allowed))}")
    if law is None and texts.keys() - {"E", "nu"} and data.kind == "metal":
        raise InputError(f"--fix {next(iter(texts.keys() - {'E', 'nu'}))}: name its law with --law")
    least, most = (0, MOST_GIVEN) if data.kind == "metal" else (1, MOST_BRANCHES)
    if options.branches is not None and not least <= options.branches <= most:
        raise InputError(f"--branches {options.branches}: must be {least} to {most}")
    return data, {key: parsed("--fix", key, value, allowed[key]) for key, value in texts.items()}


def _shift(data: material_data.MaterialData, given: Mapping[str, float]) -> Shift | None:
    """Of data at several temperatures."""
    if data.temperature is None:
        return None
    there = np.unique(data.temperature)
    if len(there) == 1:
        return None
    return Shift(given.get("reference", float(there[len(there) // 2])), data.temperature)


# -- the fit ---------------------------------------------------------------------------------------


def fitted(
    data: material_data.MaterialData, options: MaterialOptions, given: Mapping[str, float]
) -> MaterialResult:
    """The material of a test that was read, with the keys that are fixed, SI."""
    fit: PronyFit | MetalFit
    if data.kind == "metal":
        fixed = {key: value for key, value in given.items() if key != "nu"}
        fit, tried = fit_metal(data, options.law, options.branches, fixed)
        assumed, body = ASSUMED_METAL, "metal"
    else:
        fit, series = fit_prony(data, options.branches, _shift(data, given))
        tried = {str(n): value for n, value in series.items()}
        assumed, body = dict(ASSUMED_RUBBER), "elastomer"
        if fit.problem.shift is not None:
            assumed["temperature"] = fit.problem.shift.reference
    slopes = fit.slopes()
    scatter = math.sqrt(fit.squares / fit.degrees)
    result = MaterialResult(
        data=data,
        fit=fit,
        body=options.body or body,
        estimates=tuple(_estimates(fit, slopes, scatter)),
        slopes=slopes,
        scatter=scatter,
        criterion=tried,
        given=given,
        assumed={key: value for key, value in assumed.items() if key not in given},
    )
    return _with_notes(result)


def _estimates(
    fit: PronyFit | MetalFit, slopes: model.Slopes, scatter: float
) -> Iterator[model.Estimate[model.MaterialParameter]]:
    """One for each parameter, and of a series the long-term modulus."""
    judged = fit.search_slopes() if isinstance(fit, PronyFit) else slopes
    at_bound = dict(zip(judged.names, map(bool, fit.at_bound), strict=True))
    back = isinstance(fit, MetalFit) and not fit.flows_back()
    for parameter in fit.parameters:
        name, value = parameter.name, fit.values[parameter.name]
        ends = model.interval(parameter, value, slopes.half_width(name, scatter, fit.degrees))
        if back and name.partition(" ")[0] in ("c", "b"):
            warning: str | None = model.undetermined(name, *_AT_ONE)
        elif name in judged.names:
            warning = _why_open(name, judged, at_bound[name], fit, scatter)
        else:
            warning = slopes.broad(name, scatter, fit.degrees)
        yield model.Estimate(parameter, value, *ends, warning)
    if isinstance(fit, PronyFit):
        name, value = LONG_TERM.name, fit.series.long_term
        ends = model.interval(LONG_TERM, value, judged.half_width(name, scatter, fit.degrees))
        warning = _why_open(name, judged, at_bound[name], fit, scatter)
        yield model.Estimate(LONG_TERM, value, *ends, warning)


_AT_ONE = (
    "the metal never flows after a turn of the strain, so back stress and yield stress are one",
    "add rows of flow after a turn, or take --branches 0",
)


def _why_open(
    name: str, judged: model.Slopes, at_bound: bool, fit: PronyFit | MetalFit, scatter: float
) -> str | None:
    """Why the data do not determine a parameter; None if they do."""
    if at_bound:
        return model.undetermined(name, model.AT_BOUND, fit.cure(name))
    return judged.warning(name, scatter, fit.degrees)


def _with_notes(result: MaterialResult) -> MaterialResult:
    notes = []
    if alike := durbin_watson(result):
        notes.append(
            f"neighbouring rows lie off the fit alike (Durbin-Watson {alike:.2f}, 2 if they were "
            "independent): the true intervals are wider; the material may differ from the law, or "
            "the rows were smoothed"
        )
    fit = result.fit
    if isinstance(fit, PronyFit):
        tried = result.criterion
        if len(tried) == MOST_BRANCHES and fit.branches == MOST_BRANCHES:
            notes.append(f"more than {MOST_BRANCHES} branches might fit still better; none tried")
        return dataclasses.replace(result, notes=tuple(notes))
    problem = fit.problem
    if fit.values["E"] < SOFTEST_METAL:
        notes.insert(
            0,
            f"E = {fit.values['E']:.3g} Pa is that of an elastomer: its rows need a time, from "
            "which neo-Hooke with branches is fitted; constants of other strain energies are not",
        )
    hidden = problem.strain[~problem.rows]
    if hidden.size:
        notes.append(
            f"the strain turns between rows, {hidden.size} times, first at {hidden[0]:.4g}: where "
            "is taken from the distances of the rows around; add the rows of the turns if you can"
        )
    if problem.unknown:
        notes.append(
            f"where between rows the strain has its turn is unknown, {len(problem.unknown)} times, "
            f"first near {problem.unknown[0]:.4g}, as rows around are unevenly apart: E and b may "
            "be far off; add the rows of the turns, or fix E"
        )
    if problem.branches == 0 and not fit.flows_back():
        notes.append(
            "no row flows after a turn of the strain, which alone tells back stress from yield "
            "stress: all hardening is taken as isotropic"
        )
    return dataclasses.replace(result, notes=tuple(notes))


def durbin_watson(result: MaterialResult) -> float | None:
    """Σ (r_i - r_{i-1})²/Σ r_i² of the residual where it is too low by chance; None elsewhere.

    It is 2 for independent rows, with a standard deviation of 2/√n (Durbin & Watson, Biometrika
    37 (1950) 409).
    """
    r = result.residual
    total = float(r @ r)
    if result.scatter < model.NOISE * 0.1 or total <= 0.0:
        return None
    found = float(np.sum(np.diff(r) ** 2)) / total
    return found if found < 2.0 - 6.0 / math.sqrt(len(r)) else None


def seen_times(result: MaterialResult) -> tuple[float, float]:
    """Shortest and longest time that data of a rubber tell of, s, at the reference temperature."""
    fit = result.fit
    assert isinstance(fit, PronyFit)
    if result.data.frequency is None:
        return fit.problem.span
    reduced = result.data.frequency * shift_factors(fit)
    return 1.0 / float(reduced.max()), 1.0 / float(reduced.min())


def shift_factors(fit: PronyFit) -> Floats:
    """Factors a_T of each row, (n,)."""
    series, shift = fit.series, fit.problem.shift
    if shift is None or series.C1 is None or series.C2 is None:
        return np.ones(len(fit.problem.data))
    return np.asarray(np.exp(shift.logarithm(series.C1, series.C2)))
