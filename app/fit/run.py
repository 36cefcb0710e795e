"""What ``tribox fit`` does, from data and options to files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tribox.app.case.friction import MAP, TABLES
from tribox.app.case.toml_files import toml_text
from tribox.app.errors import tell
from tribox.app.figures import style
from tribox.app.figures.steady_points import film_numbers
from tribox.app.figures.style import Floats
from tribox.app.fit.calibration import Calibration
from tribox.app.fit.data import TribometerData
from tribox.app.fit.model import (
    RANGES,
    Coordinate,
    Estimate,
    FitResult,
    Parameters,
    Which,
    coordinates,
    friction,
    stated,
)
from tribox.app.fit.setup import FitSetup, fit_setup
from tribox.app.results.claim import Claim, claimed
from tribox.app.results.directory import (
    keep_inputs_apart,
    suffixed_directory,
    write_json,
    write_table,
    write_text,
)
from tribox.forms.closed_forms import threshold_speed
from tribox.forms.friction.coulomb import CoulombParameters
from tribox.forms.friction.parameters import FrictionMapParameters
from tribox.forms.friction.stribeck import StribeckParameters

# -- What a fit writes for a case file: a `[contact.friction]` section that can be pasted ----------
#
# A key stands there as a live line only if it was fitted and determined, fixed, or assumed. What
# the data do not determine is written as a comment, so that no case runs on it unnoticed.

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
DIGITS = 6
_DIGITS_OF_ALPHA = 10  # what counts is 1 - alpha


def friction_section(setup: FitSetup, result: FitResult, data_file: Path) -> str:
    """A `[contact.friction]` section of a case file with the calibrated law."""
    rows = f"{data_file.name}: {len(setup.data)} rows, scatter {result.scatter:.2%}"
    estimates = [estimate_line(e, result.parameters) for e in result.estimates]
    notes = [f"assumed: {', '.join(setup.assumed)}"] if setup.assumed else []
    if setup.law == "friction-map":
        films = ", ".join(f'"{D * 1e9:g} nm"' for D in np.unique(setup.data.thickness))
        notes.append(f"the case needs contact.film.thickness too; the data's: {films}")
    lines = ["[contact.friction]", *_lines(_table(setup, result), result)]
    return section(rows, estimates, result.warnings, notes, lines)


def section(
    rows: str, estimates: Iterable[str], warnings: Iterable[str], notes: Iterable[str],
    lines: Iterable[str],
) -> str:  # fmt: skip
    """A section of a case file, with what was found of it in comments before."""
    comments = [
        f"fitted to {rows}; in brackets 95 % intervals",
        *estimates,
        *(f"NOT DETERMINED: {line}" for line in warnings),
        *notes,
    ]
    return "\n".join([*(f"# {line}" for line in comments), *lines]) + "\n"


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
            rows = [[f"{film:.12g} m", rounded(entry, _DIGITS_OF_ALPHA)] for film, entry in value]
            table[key] = rows
        else:
            number = rounded(value, _DIGITS_OF_ALPHA if key == "alpha" else DIGITS)
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
    default = TABLES[MAP].model_fields[key].default
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
    # Of some films alone, rows of alpha are comments; of all, the key is.
    alpha = table.get("alpha")
    if films and (not isinstance(alpha, list) or len(films) == len(alpha)):
        keys.add("alpha")
    some = {f"{film:.12g} m" for film in films}
    for key, value in table.items():
        if key == "alpha" and films and key not in keys:
            rows = [(row, row[0] in some) for row in value]
            yield from judged_rows(key, rows, "without it the case takes what the others say")
        else:
            yield judged(key, value, key in keys, absent.get(key, NEEDED))


def judged(key: str, value: object, loose: bool = False, without: str = NEEDED) -> str:
    """A line, or a comment of what is not determined."""
    line = toml_text({key: value}).strip()
    return f"# {line}  # not determined: {without}" if loose else line


def judged_rows(
    key: str, rows: Sequence[tuple[Sequence[object], bool]], without: str
) -> Iterator[str]:
    """A list of which some rows are not determined."""
    if len({loose for _, loose in rows}) < 2:
        yield judged(key, [list(row) for row, _ in rows], rows[0][1], without)
        return
    yield f"{key} = ["
    for row, loose in rows:
        cells = ", ".join(f'"{cell}"' if isinstance(cell, str) else repr(cell) for cell in row)
        yield f"    # [{cells}],  # not determined: {without}" if loose else f"    [{cells}],"
    yield "]"


def _plain(value: Any) -> Any:
    """A quantity as people write it: "1e+12 Pa/m" and not "1000000000000.0 Pa/m"."""
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if not isinstance(value, str) or " " not in value:
        return value
    number, unit = value.split(" ", 1)
    return f"{float(number):.12g} {unit}"


def rounded(value: float, digits: int = DIGITS) -> float:
    """Of so many digits."""
    return float(f"{value:.{digits}g}")


# -- What ``tribox fit`` does, from data and options to files --------------------------------------

BAD_SCATTER = 0.3  # from which on a law does not describe its data


def run_fit(
    data_file: Path,
    parameters: str | None,
    fixed: Sequence[str],
    start: Sequence[str],
    out: Path | None,
    force: bool,
    law: str = "friction-map",
    ignored: Sequence[str] = (),
) -> FitResult:
    """Fit, and write numbers, figure and a section for case files to ``out`` or results/DATA-fit.

    ``parameters``: names with commas, None: those that the columns suggest; ``fixed``, ``start``:
    "key=value" texts of the law, or of columns that the file lacks; ``law``: friction-map, stribeck
    or coulomb; ``ignored``: columns not read. InputError, with nothing changed.
    """
    setup = fit_setup(data_file, parameters, fixed, start, law, ignored)
    directory = out or suffixed_directory(data_file, "fit")
    keep_inputs_apart(directory, [data_file])
    with claimed(directory, force) as claim:
        chosen = coordinates(setup.names, setup.data, setup.base)
        result = Calibration(setup.data, setup.base, chosen, setup.starts).run()
        written = friction_section(setup, result, data_file)
        found, table = numbers(setup, result, data_file), _columns(setup.data, result)
        write_fit(claim, found, table, "friction.toml", written)
        draw_fit(setup.data, result, directory / "figures", data_file.name)
    for line in report(setup, result):
        tell(line)
    print(f"results in {directory}")
    return result


def write_fit(
    claim: Claim, found: Mapping[str, Any], table: Mapping[str, Floats | None],
    name: str, written: str,
) -> None:  # fmt: skip
    """Put numbers, a table of columns (n,), and a section of a case in place of older results."""
    claim.clear()
    write_json(claim.directory / "fit.json", found)
    count = max(len(column) for column in table.values() if column is not None)
    columns = (np.full(count, np.nan) if one is None else one for one in table.values())
    rows = (["" if math.isnan(x) else float(x) for x in row] for row in zip(*columns, strict=True))
    write_table(claim.directory / "fit.csv", list(table), rows)
    write_text(claim.directory / name, written)
    (claim.directory / "figures").mkdir(exist_ok=True)


def numbers(setup: FitSetup, result: FitResult, data_file: Path) -> dict[str, Any]:
    """What ``fit.json`` holds."""
    return {
        "data": data_file.name,
        "law": setup.law,
        "rows": len(setup.data),
        "observed": setup.data.observed,
        "fixed": setup.fixed,
        "assumed": setup.assumed,
        **stated(result.estimates, result.slopes, result.scatter, result.degrees),
    }


def report(setup: FitSetup, result: FitResult) -> Iterator[str]:
    """Lines for the terminal."""
    if setup.data.renamed:
        read = ", ".join(f'"{heading}" as {name}' for heading, name in setup.data.renamed)
        yield f"note: read {read}"
    yield (
        f"{len(setup.data)} rows, {result.degrees} degrees of freedom, scatter "
        f"{result.scatter:.2%}; 95 % intervals:"
    )
    for estimate in result.estimates:
        yield f"  {estimate_line(estimate, result.parameters)}"
    cure = "; add the rows named, or give values with --fix NAME=VALUE"
    yield from not_determined(result.estimates, "friction.toml", cure)
    other = ""
    if setup.law == "friction-map" and len(np.unique(setup.data.thickness)) == 1:
        other = "; of one film thickness, or of none that you know, try --law stribeck"
    elif setup.law == "coulomb":
        other = "; where it depends on the velocity, try --law stribeck"
    yield from described(result.scatter, BAD_SCATTER, setup.assumed, "friction.toml", other)


def not_determined(estimates: Iterable[Estimate[Any]], file: str, cure: str = "") -> Iterator[str]:
    """What the data leave open, for the terminal."""
    loose = {e.coordinate.name: e.warning for e in estimates if e.warning}
    yield from (f"warning: {line}" for line in loose.values())
    if loose:
        names = ", ".join(loose)
        yield f"note: only comments in {file}, as the data do not determine them: {names}{cure}"


def described(
    scatter: float, most: float, assumed: Iterable[str], file: str, other: str = ""
) -> Iterator[str]:
    """Lines where a law is not that of the data, and of what was assumed."""
    if scatter > most:
        yield f"warning: scatter of {scatter:.0%}: the law does not describe these data{other}"
    if shown := ", ".join(assumed):
        yield f"note: assumed, neither fitted nor fixed (values in {file}): {shown}"


def _columns(data: TribometerData, result: FitResult) -> dict[str, Floats | None]:
    """Columns (n,) of ``fit.csv``: without a pressure, T/p is all that is known."""
    traction = "traction [Pa]" if data.knows_pressure else "friction_coefficient [-]"
    return {
        "thickness [m]": data.thickness if data.knows_film else None,
        "velocity [m/s]": data.velocity,
        "pressure [Pa]": data.pressure if data.knows_pressure else None,
        "slip [m]": data.slip,
        traction: data.traction,
        f"fitted_{traction}": result.traction,
        "weight [-]": data.weight,
        "log_residual [-]": np.asarray(np.log(data.traction / result.traction)),
    }


# -- Figure of tribometer data and the law fitted to them ------------------------------------------


AXES = {
    "traction": style.TRACTION.label("kPa"),
    "force": style.TRACTION.label("kPa"),
    "friction_coefficient": style.LOCAL_RATIO.label(),
    "effective_viscosity": f"{style.VISCOSITY.words} = T D/V ({style.VISCOSITY.unit})",
}
ONE_LEVEL = 1.1
"""Measured loads, or velocities, no further apart than by this factor are one in the figure."""
MOST_INSIDE = 6  # entries of a legend that still leave room for points and lines beside it
_NAMES: dict[type[Parameters], str] = {
    FrictionMapParameters: "friction map",
    StribeckParameters: "Stribeck law",
    CoulombParameters: "Coulomb law",
}


@dataclass(frozen=True, slots=True)
class _Group:
    """Rows that one line of the law goes through."""

    rows: NDArray[np.intp]
    thickness: float
    pressure: float
    velocity: float | None  # m/s, for rows over slip
    label: str


def draw_fit(data: TribometerData, result: FitResult, figures: Path, name: str) -> None:
    """Draw ``fit.png``: data and law over velocity, or over slip, and the residuals."""
    kinds = [over for over in (True, False) if (data.steady == over).any()]
    with rc_context(style.CASE_STYLE):
        figure = Figure(figsize=(7.2 * len(kinds), 6.4))
        panels = figure.subplots(
            2, len(kinds), sharex="col", squeeze=False, height_ratios=[2.6, 1.0]
        )
        for column, steady in enumerate(kinds):
            _panel(panels[0, column], panels[1, column], data, result, steady)
        text = f"{name}\n{len(data)} rows; lines: fitted {_NAMES[type(result.parameters)]}; "
        text += f"scatter {result.scatter:.2%}"
        if result.warnings:
            names = ", ".join(e.coordinate.name for e in result.estimates if e.warning)
            text += f"\nnot determined: {names}"
        figure.suptitle(text, fontsize=9, y=0.89, va="bottom")
        style.save(figure, figures / "fit.png")


def _panel(top: Axes, bottom: Axes, data: TribometerData, result: FitResult, steady: bool) -> None:
    residual = np.log(data.traction / result.traction)
    groups = list(_groups(data, steady))
    for (colour, marker), group in zip(_marks(groups, result.parameters), groups, strict=True):
        x = data.velocity[group.rows] if steady else data.slip[group.rows] * 1e6
        y = _shown(data, data.traction[group.rows], group.rows)
        top.plot(x, y, marker, ms=4.5, mfc="none", color=colour, label=group.label)
        bottom.plot(x, residual[group.rows], marker, ms=4, mfc="none", color=colour)
        _line(top, data, result.parameters, group, colour)
        if steady:
            _open_speeds(top, data, result, group, colour)
    shown = _shown(data, data.traction, np.arange(len(data)))[data.steady]
    spans = bool(steady and shown.max() > 10.0 * shown.min())
    top.set_yscale("log" if spans else "linear")
    top.set_xscale("log" if steady else "linear")
    if not spans:
        top.set_ylim(bottom=0.0)
    top.set_ylabel(AXES[data.observed])
    aside = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
    place = aside if len(top.get_legend_handles_labels()[0]) > MOST_INSIDE else {}
    top.legend(fontsize=8, frameon=True, framealpha=0.9, edgecolor="none", **place)
    bottom.axhline(0.0, color="k", lw=0.8)
    bottom.set_ylabel("ln(data/law)")
    bottom.set_xlabel(style.VELOCITY.label() if steady else style.SLIP.label("µm"))
    largest = float(np.max(np.abs(bottom.get_ylim())))
    bottom.set_ylim(-largest, largest)
    style.thin_log_ticks(top)


def _marks(groups: Sequence[_Group], law: Parameters) -> list[tuple[str, str]]:
    """Colour and marker of each group: those of its film in other figures, where films differ."""
    films = [group.thickness for group in groups]
    if not isinstance(law, FrictionMapParameters) or len(set(films)) < len(films):
        return [(style.colour_of(k), style.marker_of(k)) for k in range(len(groups))]
    numbers = film_numbers([film for film in films if film > law.D_min], law)
    dry = ("0.45", "x")
    return [
        (style.colour_of(numbers[film]), style.marker_of(numbers[film])) if film in numbers else dry
        for film in films
    ]


def _groups(data: TribometerData, steady: bool) -> Iterator[_Group]:
    """Rows of one film and load, which scatters; over slip, of one velocity too."""
    chosen = np.flatnonzero(data.steady == steady)
    loads = _levels(data.pressure[chosen])
    speeds = np.zeros(len(chosen)) if steady else _levels(data.velocity[chosen])
    several_loads, several_speeds = (len(np.unique(one)) > 1 for one in (loads, speeds))
    keys = list(zip(data.thickness[chosen], loads, speeds, strict=True))
    for D, p, V in sorted(set(keys)):
        rows = chosen[[key == (D, p, V) for key in keys]]
        words = ["dry (D = 0)" if D <= 0.0 else f"D = {D * 1e9:g} nm"] * data.knows_film
        words += [f"p = {p / 1e6:.4g} MPa"] * several_loads
        words += [f"V = {V:.4g} m/s"] * several_speeds
        label = ", ".join(words) or "measured"
        yield _Group(rows, float(D), float(p), None if steady else float(V), label)


def _levels(values: Floats) -> Floats:
    """The mean of the measured values that were meant to be the same as each, (n,)."""
    known, which = np.unique(values, return_inverse=True)
    # Each level is measured from its lowest value: by neighbours alone, values that scatter over
    # decades in small steps would all be one.
    level = np.zeros(len(known), dtype=np.intp)
    first = known[0]
    for k, value in enumerate(known[1:], start=1):
        apart = value > ONE_LEVEL * first
        first = value if apart else first
        level[k] = level[k - 1] + apart
    member = level[which]
    means = [values[member == k].mean() for k in range(level[-1] + 1)]
    return np.asarray(means)[member]


def _line(
    axes: Axes, data: TribometerData, parameters: Parameters, group: _Group, colour: str
) -> None:
    """The fitted law through a group."""
    if group.velocity is None:
        V = data.velocity[group.rows]
        velocity = np.asarray(np.geomspace(V.min() / 1.3, V.max() * 1.3, 600), dtype=np.float64)
        slip: Floats = np.full(600, np.nan)
    else:
        slip = np.asarray(np.linspace(0.0, data.slip[group.rows].max() * 1.03, 601)[1:], np.float64)
        velocity = np.full(600, group.velocity)
    ones = np.ones(600)
    curve = TribometerData(
        thickness=group.thickness * ones, velocity=velocity, pressure=group.pressure * ones,
        traction=ones, slip=slip, weight=ones, observed=data.observed,
    )  # fmt: skip
    shown = _shown(curve, friction(parameters, curve), np.arange(600))
    if group.velocity is not None:
        axes.plot(slip * 1e6, shown, color=colour, lw=1)
        return
    if isinstance(parameters, FrictionMapParameters) and group.thickness < parameters.D_max:
        star = float(threshold_speed(group.thickness, parameters))  # No line across the fall there.
        shown[np.abs(velocity / star - 1.0) <= max(parameters.transition_width, 0.01)] = np.nan
    axes.plot(velocity, shown, color=colour, lw=1)


def _open_speeds(
    axes: Axes, data: TribometerData, result: FitResult, group: _Group, colour: str
) -> None:
    """The speeds at which a group's film may take over, where the data do not determine V*."""
    law = result.parameters
    star = next((e for e in result.estimates if e.coordinate.key in ("V_star", "gamma")), None)
    if not isinstance(law, FrictionMapParameters) or star is None or not star.warning:
        return
    if not law.D_min < group.thickness < law.D_max:
        return
    at = float(threshold_speed(group.thickness, law))
    # The interval is that of what was searched, and gamma = eta_b V*².
    power = 0.5 if star.coordinate.key == "gamma" else 1.0
    V = data.velocity[group.rows]
    low = V.min() / 1.3 if star.low is None else at * (star.low / star.value) ** power
    high = V.max() * 1.3 if star.high is None else at * (star.high / star.value) ** power
    film = f"{group.thickness * 1e9:g} nm"
    label = f"V* at {film}, not determined: 95 % interval"
    axes.axvspan(low, high, color=colour, alpha=0.12, lw=0, label=label)


def _shown(data: TribometerData, traction: Floats, rows: NDArray[np.intp]) -> Floats:
    """Traction in terms of what was observed."""
    if data.observed == "friction_coefficient":
        return np.asarray(traction / data.pressure[rows])
    if data.observed == "effective_viscosity":
        return np.asarray(traction * data.thickness[rows] / data.velocity[rows])
    return np.asarray(traction / 1e3)
