"""What ``tribox fit`` does, from data and options to files."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tribox.app.errors import tell
from tribox.app.fit.calibration import Calibration
from tribox.app.fit.data import TribometerData
from tribox.app.fit.model import coordinates
from tribox.app.fit.result import FitResult
from tribox.app.fit.section import estimate_line, friction_section
from tribox.app.fit.setup import FitSetup, fit_setup
from tribox.app.fit.slopes import CONFIDENCE
from tribox.app.friction_map.run import keep_input, suffixed_directory
from tribox.app.results.claim import claimed
from tribox.app.results.directory import write_json, write_table, write_text

BAD_SCATTER = 0.3
FIT_COLUMNS = (
    "thickness [m]",
    "velocity [m/s]",
    "pressure [Pa]",
    "slip [m]",
    "traction [Pa]",
    "fitted_traction [Pa]",
    "weight [-]",
    "log_residual [-]",
)


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
    """Fit, and write numbers, figure and a section for case files.

    Args:
        data_file: CSV file.
        parameters: Names with commas; None: those that the columns suggest.
        fixed: "key=value" texts of the law, or of columns that the file does not have.
        start: "key=value" texts.
        out: Results directory; None: ``results/DATA-fit``.
        force: Whether to replace results.
        law: That is fitted: friction-map, stribeck or coulomb.
        ignored: Columns that are not read.

    Raises:
        InputError: Data, options or directory are not usable; nothing is changed then.
    """
    setup = fit_setup(data_file, parameters, fixed, start, law, ignored)
    directory = out or suffixed_directory(data_file, "fit")
    keep_input(directory, data_file)
    with claimed(directory, force) as claim:
        chosen = coordinates(setup.names, setup.data, setup.base)
        result = Calibration(setup.data, setup.base, chosen, setup.starts).run()
        claim.clear()
        write_json(directory / "fit.json", numbers(setup, result, data_file))
        write_table(directory / "fit.csv", _columns(setup.data), _rows(setup.data, result))
        write_text(directory / "friction.toml", friction_section(setup, result, data_file))
        from tribox.app.fit.figures import draw_fit

        (directory / "figures").mkdir(exist_ok=True)
        draw_fit(setup.data, result, directory / "figures", data_file.name)
    for line in report(setup, result):
        tell(line)
    print(f"results in {directory}")
    return result


def numbers(setup: FitSetup, result: FitResult, data_file: Path) -> dict[str, Any]:
    """What ``fit.json`` holds."""
    return {
        "data": data_file.name,
        "law": setup.law,
        "rows": len(setup.data),
        "observed": setup.data.observed,
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
        "degrees_of_freedom": result.degrees,
        "fixed": setup.fixed,
        "assumed": setup.assumed,
        "warnings": list(result.warnings),
        "singular_values": list(result.singular_values),
        "correlation": {
            "names": list(result.correlated),
            "matrix": result.correlation.tolist(),
        },
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
    for line in result.warnings:
        yield f"warning: {line}"
    if result.warnings:
        loose = ", ".join(e.coordinate.name for e in result.estimates if e.warning)
        yield (
            f"note: only comments in friction.toml, as the data do not determine them: {loose}; "
            "add the rows named, or give values with --fix NAME=VALUE"
        )
    if result.scatter > BAD_SCATTER:
        other = ""
        if setup.law == "friction-map" and len(np.unique(setup.data.thickness)) == 1:
            other = "; of one film thickness, or of none that you know, try --law stribeck"
        elif setup.law == "coulomb":
            other = "; where it depends on the velocity, try --law stribeck"
        reason = f"scatter of {result.scatter:.0%}: the law does not describe these data"
        yield f"warning: {reason}{other}"
    if setup.assumed:
        shown = ", ".join(setup.assumed)
        yield f"note: assumed, neither fitted nor fixed (values in friction.toml): {shown}"


def _columns(data: TribometerData) -> list[str]:
    """Names of the columns of ``fit.csv``: without a pressure, T/p is all that is known."""
    if data.knows_pressure:
        return list(FIT_COLUMNS)
    ratio = "friction_coefficient [-]"
    return [name.replace("traction [Pa]", ratio) for name in FIT_COLUMNS]


def _rows(data: TribometerData, result: FitResult) -> Iterator[list[Any]]:
    for i in range(len(data)):
        slip = float(data.slip[i])
        yield [
            float(data.thickness[i]) if data.knows_film else "",
            float(data.velocity[i]),
            float(data.pressure[i]) if data.knows_pressure else "",
            "" if math.isnan(slip) else slip,
            float(data.traction[i]),
            float(result.traction[i]),
            float(data.weight[i]),
            math.log(float(data.traction[i] / result.traction[i])),
        ]
