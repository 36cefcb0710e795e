"""What ``tribox fit --material`` writes: a `[bodies.NAME]` section, numbers, a table and a figure.

As in the section of a friction law a key is live only if it was fitted and determined, fixed or
assumed; what the data do not determine is a comment.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tribox.app.figures.style import COLOURS, MARKERS, RED, STYLE, Floats, save, thin_log_ticks
from tribox.app.fit.material import (
    ASSUMED_METAL,
    ASSUMED_RUBBER,
    RUBBER,
    WORDS,
    MaterialOptions,
    MaterialResult,
    fitted,
    read_test,
    seen_times,
    shift_factors,
)
from tribox.app.fit.metal import LAWS, MetalFit, paths, response
from tribox.app.fit.model import stated
from tribox.app.fit.prony import LONG_TERM, PronyFit, PronyProblem
from tribox.app.fit.run import (
    DIGITS,
    described,
    judged,
    judged_rows,
    not_determined,
    rounded,
    section,
    value_and_ends,
    write_fit,
)
from tribox.app.results.claim import claimed
from tribox.app.results.directory import keep_inputs_apart, suffixed_directory

# -- Figure of a material's test and what was fitted to it -----------------------------------------

BLUE = COLOURS[0]
FINE = 400  # points of a line


def draw_material(result: MaterialResult, path: Path) -> None:
    """Draw data and fit with their differences below, and beside them what was found."""
    with rc_context(STYLE):
        figure = Figure(figsize=(10.4, 5.6), layout="constrained")
        grid: dict[str, Axes] = figure.subplot_mosaic(
            [["top", "side"], ["bottom", "side"]], height_ratios=[2.6, 1.0], width_ratios=[1.5, 1.0]
        )
        top, bottom, side = grid["top"], grid["bottom"], grid["side"]
        if isinstance(result.fit, MetalFit):
            _draw_metal(top, bottom, result)
            _hardening(side, result.fit)
        else:
            kind = result.data.kind
            draw = {"relaxation": _relaxation, "vibration": _vibration, "cycles": _cycles}[kind]
            draw(top, bottom, result)
            bottom.set_ylabel("(data − fit)/rms" if kind == "cycles" else "ln(data/fit)")
            _spectrum(side, result)
        bottom.axhline(0.0, color="k", lw=0.8)
        largest = float(np.max(np.abs(bottom.get_ylim())))
        bottom.set_ylim(-largest, largest)
        top.legend(fontsize=8, frameon=True, framealpha=0.9, edgecolor="none")
        for axes in (top, bottom, side):
            thin_log_ticks(axes)
        text = f"{len(result.data)} rows of {WORDS[result.data.kind]}; lines: fit; "
        text += f"scatter {result.scatter:.2%}"
        if result.loose:
            text += "\nnot determined: " + ", ".join(sorted(result.loose))
        figure.suptitle(text, fontsize=9)
        save(figure, path)


# -- rubbers ---------------------------------------------------------------------------------------


def _relaxation(top: Axes, bottom: Axes, result: MaterialResult) -> None:
    data, fit = result.data, result.fit
    assert data.time is not None and data.modulus is not None and isinstance(fit, PronyFit)
    shown = data.time > 0.0
    t = data.time[shown]
    fine = np.geomspace(t.min() / 1.3, t.max() * 1.3, FINE)
    series = fit.series
    one, _ = _at_times(result, fine).branch(series.times)
    curve = series.long_term + (series.G * series.shares) @ one
    top.plot(t, data.modulus[shown] / 1e6, "o", ms=4, mfc="none", color=BLUE, label="measured")
    top.plot(fine, curve / 1e6, color=RED, lw=1.2, label="fitted series")
    top.axhline(series.long_term / 1e6, color="0.4", lw=0.8, ls="--", label="long-term modulus")
    bottom.plot(t, result.residual[shown], "o", ms=3.5, mfc="none", color=BLUE)
    top.set_ylim(bottom=0.0)
    top.set_ylabel("shear modulus G (MPa)")
    bottom.set_xlabel("time since the step t (s)")
    for axes in (top, bottom):
        axes.set_xscale("log")


def _at_times(result: MaterialResult, times: Floats) -> PronyProblem:
    """The same step seen at other times."""
    data = result.data
    strain = None if data.strain is None else np.full(len(times), float(data.strain.mean()))
    ones = np.ones(len(times))
    other = type(data)("relaxation", ones, times, strain, modulus=ones, in_shear=data.in_shear)
    return PronyProblem(other)


def _vibration(top: Axes, bottom: Axes, result: MaterialResult) -> None:
    data, fit = result.data, result.fit
    assert isinstance(fit, PronyFit)
    assert data.frequency is not None and data.modulus is not None and data.loss is not None
    series, shift, n = fit.series, fit.problem.shift, len(data)
    reduced = data.frequency * shift_factors(fit)
    groups: list[NDArray[np.intp]] = [np.arange(n)]
    if shift is not None:
        groups = [np.flatnonzero(shift.temperature == T) for T in np.unique(shift.temperature)]
    for number, rows in enumerate(groups):
        colour, marker = COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]
        word = "" if shift is None else f" {shift.temperature[rows[0]] - 273.15:g} °C"
        for values, part, face, offset in (
            (data.modulus, "storage", colour, 0),
            (data.loss, "loss", "none", n),
        ):
            label = f"{part}{word}" if shift is None or part == "storage" else None
            style: dict[str, Any] = {"color": colour, "mfc": face, "ms": 4.5, "ls": "none"}
            top.plot(reduced[rows], values[rows] / 1e6, marker, label=label, **style)
            bottom.plot(reduced[rows], result.residual[rows + offset], marker, **style)
    fine = np.geomspace(reduced.min() / 1.3, reduced.max() * 1.3, FINE)
    x = fine[:, None] * series.times
    moduli = series.G * series.shares
    storage = series.long_term + (x**2 / (1.0 + x**2)) @ moduli
    top.plot(fine, storage / 1e6, color="k", lw=1, label="G′ of the series")
    top.plot(fine, (x / (1.0 + x**2)) @ moduli / 1e6, color="k", lw=1, ls="--", label="G″")
    for axes in (top, bottom):
        axes.set_xscale("log")
    top.set_yscale("log")
    top.set_ylabel("shear moduli G′ (filled), G″ (MPa)")
    reference = "" if shift is None else f" at {shift.reference - 273.15:g} °C"
    bottom.set_xlabel(f"{'' if shift is None else 'reduced '}angular frequency{reference} (rad/s)")


def _cycles(top: Axes, bottom: Axes, result: MaterialResult) -> None:
    data = result.data
    assert data.strain is not None and data.stress is not None and data.time is not None
    top.plot(data.strain, data.stress / 1e6, "o", ms=3.5, mfc="none", color=BLUE, label="measured")
    top.plot(data.strain, result.fit.computed() / 1e6, color=RED, lw=1.1, label="fitted series")
    top.set_xlabel("logarithmic strain")
    top.set_ylabel(f"{'engineering' if data.engineering else 'true'} stress (MPa)")
    bottom.plot(data.time, result.residual, "o", ms=3, mfc="none", color=BLUE)
    bottom.set_xlabel("time t (s)")


def _spectrum(axes: Axes, result: MaterialResult) -> None:
    """Shares over relaxation times with their intervals; what is not determined in grey."""
    fit = result.fit
    assert isinstance(fit, PronyFit)
    found = {e.coordinate.name: e for e in result.estimates}
    for k in range(1, fit.branches + 1):
        share, time = found[f"share {k}"], found[f"tau {k}"]
        open_row = share.warning is not None or time.warning is not None
        colour = "0.6" if open_row else BLUE
        axes.plot([time.value] * 2, [0.0, share.value], color=colour, lw=1)
        axes.plot(time.value, share.value, "o", ms=5, color=colour)
        if time.low is not None and time.high is not None and not open_row:
            axes.plot([time.low, time.high], [share.value] * 2, color=colour, lw=2.5, alpha=0.5)
        if share.low is not None and share.high is not None and not open_row:
            axes.plot([time.value] * 2, [share.low, share.high], color=colour, lw=2.5, alpha=0.5)
    axes.axvspan(*seen_times(result), color="0.5", alpha=0.1, lw=0, label="times of the data")
    left = fit.series.long_term / fit.series.G
    axes.axhline(left, color="0.4", lw=0.8, ls="--", label="long-term share")
    axes.set_xscale("log")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("relaxation time τ (s)")
    axes.set_ylabel("share of the instantaneous modulus")
    axes.legend(fontsize=8)


# -- metals ----------------------------------------------------------------------------------------


def _draw_metal(top: Axes, bottom: Axes, result: MaterialResult) -> None:
    fit = result.fit
    assert isinstance(fit, MetalFit)
    strain, rows = fit.problem.strain, fit.problem.rows
    edges = np.concatenate([[0.0], strain])
    parts = [np.linspace(a, b, 11)[1:] for a, b in itertools.pairwise(edges) if a != b]
    fine = np.concatenate(parts)
    curve, _ = response(fit.metal, fine, paths(fine))
    stress = fit.problem.measured / 1e6
    top.plot(strain[rows], stress, "o", ms=3.5, mfc="none", color=BLUE, label="measured")
    n = fit.problem.branches
    back = {0: "", 1: " with a back stress"}.get(n, f" with {n} back stresses")
    top.plot(np.append(0.0, fine), np.append(0.0, curve) / 1e6, color=RED, lw=1.1,
             label=f"fitted law ({fit.problem.law}){back}")  # fmt: skip
    top.axhline(0.0, color="k", lw=0.6)
    top.set_xlabel("logarithmic strain")
    top.set_ylabel("true stress σ (MPa)")
    path = np.cumsum(np.abs(np.diff(strain, prepend=0.0)))
    bottom.plot(path[rows], result.residual, "o", ms=3, mfc="none", color=BLUE)
    bottom.set_xlabel("strain covered Σ|Δε|")
    bottom.set_ylabel("(data − fit)/rms")


def _hardening(axes: Axes, fit: MetalFit) -> None:
    """Yield stress and back stress of a pull over the plastic strain of the test."""
    metal = fit.metal
    _, alphas = response(metal, fit.problem.strain, fit.problem.along)
    end = max(float(alphas[-1]), 1e-4)
    alpha = np.asarray(np.linspace(0.0, end, FINE), dtype=np.float64)
    axes.plot(alpha, metal.hardening.stress(alpha) / 1e6, color=BLUE, label="yield stress σ_Y")
    total: Floats = np.zeros(FINE)
    for c, b in metal.kinematic:
        total -= c / b * np.expm1(-b * alpha)
    if metal.kinematic:
        axes.plot(alpha, total / 1e6, color=RED, ls="--", label="back stress X of one pull")
        both = metal.hardening.stress(alpha) + total
        axes.plot(alpha, both / 1e6, color="0.4", lw=0.9, ls=":", label="their sum")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("equivalent plastic strain α")
    axes.set_ylabel("stress (MPa)")
    axes.legend(fontsize=8)


BAD_SCATTER = 0.1
_PREFIXES = {"Pa": (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3)), "s": (("ms", 1e-3), ("us", 1e-6))}
_DIGITS_OF_SHARE = 9  # the long-term modulus is what all shares leave


def run_material(
    data_file: Path, options: MaterialOptions, out: Path | None, force: bool
) -> MaterialResult:
    """Fit, and write numbers, figure and a section for case files to ``out`` or results/DATA-fit.

    InputError, with nothing changed, if data, options or directory are not usable.
    """
    data, given = read_test(data_file, options)
    directory = out or suffixed_directory(data_file, "fit")
    keep_inputs_apart(directory, [data_file])
    with claimed(directory, force) as claim:
        result = fitted(data, options, given)
        written = body_section(result, data_file)
        write_fit(claim, numbers(result, data_file), _columns(result), "body.toml", written)
        draw_material(result, directory / "figures" / "fit.png")
    for line in report(result):
        print(line)
    print(f"results in {directory}")
    return result


def body_section(result: MaterialResult, data_file: Path) -> str:
    """A `[bodies.NAME]` section of a case file with the fitted material."""
    rows = f"{data_file.name}: {len(result.data)} rows of {WORDS[result.data.kind]}"
    rows += f", scatter {result.scatter:.2%}"
    estimates = map(value_and_ends, result.estimates)
    notes = [f"note: {line}" for line in result.notes]
    notes += [f"assumed: {', '.join(result.assumed)}"] if result.assumed else []
    keys = _rubber(result) if isinstance(result.fit, PronyFit) else _metal(result)
    return section(rows, estimates, result.warnings, notes, [f"[bodies.{result.body}]", *keys])


def _rubber(result: MaterialResult) -> Iterator[str]:
    fit, loose = result.fit, result.loose
    assert isinstance(fit, PronyFit)
    series = fit.series
    moduli, never = series.G * series.shares, _never_seen(result)
    G = series.G - float(moduli[never].sum())
    yield judged("material", "neo-hookean")
    yield judged("G", _quantity(G, "Pa"), "G" in loose and not never.any())
    yield judged("K", _quantity(result.given.get("K", ASSUMED_RUBBER["K"]), "Pa"))
    yield judged("moduli", "instantaneous")
    rows: list[tuple[list[object], bool]] = []
    for k, (modulus, time) in enumerate(zip(moduli, series.times, strict=True), start=1):
        if never[k - 1]:
            branch = f"{_quantity(modulus, 'Pa')} at {_quantity(time, 's')}"
            yield f"# not determined: a branch of {branch}; without it, it is always relaxed"
            continue
        row: list[object] = [f"{modulus / G:.{_DIGITS_OF_SHARE}g}", _quantity(time, "s")]
        last = k == fit.branches and LONG_TERM.name in loose
        rows.append((row, last or bool({f"share {k}", f"tau {k}"} & loose)))
    if rows:
        yield from judged_rows("prony", rows, "without it its share never relaxes")
    if fit.problem.shift is not None:
        reference = fit.problem.shift.reference
        at = result.given.get("temperature", reference)
        inner = {
            "law": "wlf",
            "C1": rounded(fit.values["C1"]),
            "C2": _quantity(fit.values["C2"], "K"),
            "reference": _celsius(reference),
            "temperature": _celsius(at),
        }
        line = f"shift = {{ {', '.join(judged(*one) for one in inner.items())} }}"
        if {"C1", "C2"} & loose:
            line = f"# {line}  # not determined: without it the times are those at the reference"
        yield line


def _never_seen(result: MaterialResult) -> NDArray[np.bool_]:
    """(k,), branches that are not determined and faster than most of the data: left out of G."""
    fit = result.fit
    assert isinstance(fit, PronyFit)
    times, names = fit.series.times, range(1, fit.branches + 1)
    low, high = seen_times(result)
    loose = [bool({f"share {k}", f"tau {k}"} & result.loose) for k in names]
    return np.asarray(np.array(loose) & (times < np.sqrt(low * high)))


def _metal(result: MaterialResult) -> Iterator[str]:
    fit, loose = result.fit, result.loose
    assert isinstance(fit, MetalFit)
    values, law = fit.values, fit.problem.law
    yield judged("material", "elastoplastic")
    yield judged("E", _quantity(values["E"], "Pa"), "E" in loose)
    yield judged("nu", result.given.get("nu", ASSUMED_METAL["nu"]))
    rows: list[tuple[list[object], bool]] = []
    for k, (c, b) in enumerate(fit.metal.kinematic, start=1):
        open_row = bool({f"c {k}", f"b {k}"} & loose)
        rows.append(([_quantity(c, "Pa"), f"{b:.{DIGITS}g}"], open_row))
    if rows:
        yield from judged_rows("kinematic", rows, "without it there is a back stress less")
    yield ""
    yield f"[bodies.{result.body}.hardening]"
    yield judged("law", law)
    for key, unit in LAWS[law].items():
        yield judged(key, _quantity(values[key], unit), key in loose)
    if law == "voce" and "modulus" in values:
        yield judged("modulus", _quantity(values["modulus"], "Pa"))


def _quantity(value: float, unit: str) -> object:
    """A quantity as people write it: "2 MPa"; a number without unit."""
    if not unit:
        return rounded(value)
    for shown, factor in _PREFIXES.get(unit, ()):
        if (value >= factor) if factor > 1.0 else (factor <= value < 1.0):
            return f"{value / factor:.{DIGITS}g} {shown}"
    return f"{value:.{DIGITS}g} {unit}"


def _celsius(kelvin: float) -> str:
    return f"{round(kelvin - 273.15, 6):.10g} degC"


def numbers(result: MaterialResult, data_file: Path) -> dict[str, Any]:
    """What ``fit.json`` holds."""
    return {
        "data": data_file.name,
        "test": result.data.kind,
        "law": result.law,
        "rows": len(result.data),
        "information_criterion": dict(result.criterion),
        "fixed": dict(result.given),
        "assumed": dict(result.assumed),
        "notes": list(result.notes),
        **stated(result.estimates, result.slopes, result.scatter, result.fit.degrees),
    }


def report(result: MaterialResult) -> Iterator[str]:
    """Lines for the terminal."""
    of = "" if result.data.kind in ("relaxation", "vibration") else " of the stress"
    yield (
        f"{len(result.data)} rows of {WORDS[result.data.kind]}, {result.fit.degrees} degrees of "
        f"freedom, scatter {result.scatter:.2%}{of}; 95 % intervals:"
    )
    for estimate in result.estimates:
        yield f"  {value_and_ends(estimate)}"
    if len(result.criterion) > 1:
        chosen = min(result.criterion, key=lambda key: result.criterion[key])
        what = f"branches: {chosen}" if result.law == RUBBER else f"law and back stresses: {chosen}"
        tried = f"{len(result.criterion)} series or laws tried"
        yield f"note: {what}, by the information criterion ({tried}, see fit.json)"
    yield from not_determined(result.estimates, "body.toml")
    for line in result.notes:
        grave = "Durbin" in line or "turn is unknown" in line
        yield f"{'warning' if grave else 'note'}: {line}"
    yield from described(result.scatter, BAD_SCATTER, result.assumed, "body.toml")


def _columns(result: MaterialResult) -> dict[str, Floats | None]:
    """Columns (n,) of ``fit.csv``: what the test has."""
    data, computed = result.data, result.fit.computed()
    n = len(data)
    columns = (
        ("time [s]", data.time),
        ("angular_frequency [rad/s]", data.frequency),
        ("temperature [K]", data.temperature),
        ("shear_strain [-]" if data.in_shear else "true_strain [-]", data.strain),
        ("engineering_stress [Pa]" if data.engineering else "true_stress [Pa]", data.stress),
        ("fitted_stress [Pa]", None if data.stress is None else computed),
        ("shear_storage_modulus [Pa]", data.modulus if data.loss is not None else None),
        ("shear_loss_modulus [Pa]", data.loss),
        ("shear_modulus [Pa]", data.modulus if data.loss is None else None),
        ("fitted_storage_modulus [Pa]", computed[:n] if data.loss is not None else None),
        ("fitted_loss_modulus [Pa]", computed[n:] if data.loss is not None else None),
        ("fitted_modulus [Pa]", computed if data.stress is None and data.loss is None else None),
        ("weight [-]", data.weight),
    )
    return {name: column for name, column in columns if column is not None}
