"""What ``tribox fit --material`` writes: a `[bodies.NAME]` section, numbers, a table and a figure.

As in the section of a friction law a key is live only if it was fitted and determined, fixed or
assumed; what the data do not determine is a comment.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tribox.app.case.toml_writer import toml_text
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
)
from tribox.app.fit.metal import LAWS, MetalFit
from tribox.app.fit.prony import LONG_TERM, PronyFit
from tribox.app.fit.section import NEEDED, value_and_ends
from tribox.app.fit.slopes import CONFIDENCE
from tribox.app.friction_map.run import keep_input, suffixed_directory
from tribox.app.results.claim import claimed
from tribox.app.results.directory import write_json, write_table, write_text

Floats = NDArray[np.float64]

BAD_SCATTER = 0.1
_PREFIXES = {"Pa": (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3)), "s": (("ms", 1e-3), ("us", 1e-6))}
_DIGITS = 6
_DIGITS_OF_SHARE = 9  # the long-term modulus is what all shares leave


def run_material(
    data_file: Path, options: MaterialOptions, out: Path | None, force: bool
) -> MaterialResult:
    """Fit, and write numbers, figure and a section for case files.

    Args:
        data_file: CSV file.
        options: What is asked for.
        out: Results directory; None: ``results/DATA-fit``.
        force: Whether to replace results.

    Raises:
        InputError: Data, options or directory are not usable; nothing is changed then.
    """
    data, given = read_test(data_file, options)
    directory = out or suffixed_directory(data_file, "fit")
    keep_input(directory, data_file)
    with claimed(directory, force) as claim:
        result = fitted(data, options, given)
        claim.clear()
        write_json(directory / "fit.json", numbers(result, data_file))
        header, rows = _table(result)
        write_table(directory / "fit.csv", header, rows)
        write_text(directory / "body.toml", body_section(result, data_file))
        from tribox.app.fit.material_figures import draw_material

        (directory / "figures").mkdir(exist_ok=True)
        draw_material(result, directory / "figures" / "fit.png")
    for line in report(result):
        print(line)
    print(f"results in {directory}")
    return result


def body_section(result: MaterialResult, data_file: Path) -> str:
    """A `[bodies.NAME]` section of a case file with the fitted material."""
    measured = len(result.data)
    comments = [
        f"# fitted to {data_file.name}: {measured} rows of {WORDS[result.data.kind]}, "
        f"scatter {result.scatter:.2%}; in brackets 95 % intervals",
        *(f"# {value_and_ends(e)}" for e in result.estimates),
        *(f"# NOT DETERMINED: {line}" for line in result.warnings),
        *(f"# note: {line}" for line in result.notes),
        *([f"# assumed: {', '.join(result.assumed)}"] if result.assumed else []),
    ]
    lines = _rubber(result) if isinstance(result.fit, PronyFit) else _metal(result)
    return "\n".join([*comments, f"[bodies.{result.body}]", *lines]) + "\n"


def _rubber(result: MaterialResult) -> Iterator[str]:
    fit, loose = result.fit, result.loose
    assert isinstance(fit, PronyFit)
    series = fit.series
    moduli, never = series.G * series.shares, _never_seen(result)
    G = series.G - float(moduli[never].sum())
    yield _line("material", "neo-hookean")
    yield from _judged("G", _quantity(G, "Pa"), "G" in loose and not never.any())
    yield _line("K", _quantity(result.given.get("K", ASSUMED_RUBBER["K"]), "Pa"))
    yield _line("moduli", "instantaneous")
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
        yield from _rows("prony", rows, "without it its share never relaxes")
    if fit.problem.shift is not None:
        reference = fit.problem.shift.reference
        at = result.given.get("temperature", reference)
        inner = {
            "law": "wlf",
            "C1": _rounded(fit.values["C1"]),
            "C2": _quantity(fit.values["C2"], "K"),
            "reference": _celsius(reference),
            "temperature": _celsius(at),
        }
        line = _line("shift", inner)
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
    yield _line("material", "elastoplastic")
    yield from _judged("E", _quantity(values["E"], "Pa"), "E" in loose)
    yield _line("nu", result.given.get("nu", ASSUMED_METAL["nu"]))
    rows: list[tuple[list[object], bool]] = []
    for k, (c, b) in enumerate(fit.metal.kinematic, start=1):
        open_row = bool({f"c {k}", f"b {k}"} & loose)
        rows.append(([_quantity(c, "Pa"), f"{b:.{_DIGITS}g}"], open_row))
    if rows:
        yield from _rows("kinematic", rows, "without it there is a back stress less")
    yield ""
    yield f"[bodies.{result.body}.hardening]"
    yield _line("law", law)
    for key, unit in LAWS[law].items():
        yield from _judged(key, _quantity(values[key], unit), key in loose)
    if law == "voce" and "modulus" in values:
        yield _line("modulus", _quantity(values["modulus"], "Pa"))


def _line(key: str, value: object) -> str:
    return toml_text({key: value}).strip() if not isinstance(value, dict) else _inline(key, value)


def _inline(key: str, table: Mapping[str, object]) -> str:
    inner = ", ".join(toml_text({name: value}).strip() for name, value in table.items())
    return f"{key} = {{ {inner} }}"


def _judged(key: str, value: object, loose: bool) -> Iterator[str]:
    """A line, or a comment of what is not determined."""
    line = _line(key, value)
    yield f"# {line}  # not determined: {NEEDED}" if loose else line


def _rows(key: str, rows: Sequence[tuple[Sequence[object], bool]], without: str) -> Iterator[str]:
    """A list of which some rows are not determined."""
    if not any(loose for _, loose in rows):
        yield _line(key, [list(row) for row, _ in rows])
    elif all(loose for _, loose in rows):
        yield f"# {_line(key, [list(row) for row, _ in rows])}  # not determined: {without}"
    else:
        yield f"{key} = ["
        for row, loose in rows:
            text = "[" + ", ".join(f'"{cell}"' for cell in row) + "],"
            yield f"    # {text}  # not determined: {without}" if loose else f"    {text}"
        yield "]"


def _quantity(value: float, unit: str) -> object:
    """A quantity as people write it: "2 MPa"; a number without unit."""
    if not unit:
        return _rounded(value)
    for shown, factor in _PREFIXES.get(unit, ()):
        if (value >= factor) if factor > 1.0 else (factor <= value < 1.0):
            return f"{value / factor:.{_DIGITS}g} {shown}"
    return f"{value:.{_DIGITS}g} {unit}"


def _celsius(kelvin: float) -> str:
    return f"{round(kelvin - 273.15, 6):.10g} degC"


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def numbers(result: MaterialResult, data_file: Path) -> dict[str, Any]:
    """What ``fit.json`` holds."""
    return {
        "data": data_file.name,
        "test": result.data.kind,
        "law": result.law,
        "rows": len(result.data),
        "parameters": {
            e.coordinate.name: {
                "value": e.value,
                "low": e.low,
                "high": e.high,
                "unit": e.coordinate.unit,
                "determined": e.warning is None,
            }
            for e in result.estimates
        },
        "confidence": CONFIDENCE,
        "scatter": result.scatter,
        "degrees_of_freedom": result.fit.degrees,
        "information_criterion": dict(result.criterion),
        "fixed": dict(result.given),
        "assumed": dict(result.assumed),
        "warnings": list(result.warnings),
        "notes": list(result.notes),
        "singular_values": list(result.slopes.singular_values()),
        "correlation": {
            "names": list(result.slopes.names),
            "matrix": result.slopes.correlation().tolist(),
        },
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
    for line in result.warnings:
        yield f"warning: {line}"
    if result.warnings:
        loose = ", ".join(e.coordinate.name for e in result.estimates if e.warning)
        yield f"note: only comments in body.toml, as the data do not determine them: {loose}"
    for line in result.notes:
        yield f"{'warning' if 'Durbin' in line else 'note'}: {line}"
    if result.scatter > BAD_SCATTER:
        yield f"warning: scatter of {result.scatter:.0%}: the law does not describe these data"
    if result.assumed:
        shown = ", ".join(result.assumed)
        yield f"note: assumed, neither fitted nor fixed (values in body.toml): {shown}"


def _table(result: MaterialResult) -> tuple[list[str], Iterator[list[float]]]:
    """Header and rows of ``fit.csv``."""
    data, computed = result.data, result.fit.computed()
    n = len(data)
    columns: dict[str, Floats] = {}
    for name, column in (
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
    ):
        if column is not None:
            columns[name] = column
    rows = zip(*columns.values(), strict=True)
    return list(columns), ([float(cell) for cell in row] for row in rows)
