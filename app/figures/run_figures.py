"""The figures of a results directory, drawn from its files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from app.case.case import Case
from app.case.friction import FrictionMap
from app.case.reading import load_case
from app.figures.history import energies_figure, forces_figure
from app.figures.phase_plots import draw_phases
from app.figures.steady_points import draw_steady, steady_series
from app.figures.style import COLOURS, STYLE, columns, save
from app.results.directory import read_table


def draw_history(directory: Path) -> None:
    """Draw ``history.png`` and ``energy.png``; the steady points too, where there are some.

    Raises:
        InputError: the directory holds no history.
    """
    rows = read_table(directory / "history.csv")
    figures = directory / "figures"
    if not rows:
        return
    with rc_context(STYLE):
        save(forces_figure(rows), figures / "history.png")
        save(energies_figure(rows), figures / "energy.png")
        case = load_case(directory / "case.toml")
        draw_phases(case, directory)
        steady = [last for last in _load_steps(directory) if last["steady"] is not None]
        if steady and isinstance(case.contact[0].friction, FrictionMap):
            draw_steady([steady_series(case, steady)], figures)


def _load_steps(directory: Path) -> list[dict[str, Any]]:
    """The load steps of a run, from its summary; none if it was killed before it wrote one."""
    summary = directory / "summary.json"
    if not summary.is_file():
        return []
    found = json.loads(summary.read_text(encoding="utf-8"))
    return list(found.get("load_steps") or found.get("legs", []))  # legs: their earlier name


def draw_sweep(case: Case, directory: Path) -> None:
    """Draw the figures of a collated sweep.

    Raises:
        InputError: the directory holds no ``sweep.csv``.
    """
    rows = read_table(directory / "sweep.csv")
    figures = directory / "figures"
    parts = case.sweep_cases()
    with rc_context(STYLE):
        laws = [single.contact[0] for _, single in parts]
        film = all(isinstance(c.friction, FrictionMap) for c in laws)
        series = [
            steady_series(single, steady, _series_label(case, label))
            for label, single in parts
            if film
            and (steady := [row for row in rows if row["label"] == label and row["steady"] >= 0])
        ]
        if series:
            draw_steady(series, figures)
        save(_sweep_ends(case, rows), figures / "sweep.png")


def _series_label(case: Case, label: str) -> str:
    """Name of a sweep's series: the swept value, or D where that is what is swept."""
    assert case.sweep is not None
    return "" if case.sweep.key.endswith("film.thickness") else label


def _sweep_ends(case: Case, rows: list[dict[str, Any]]) -> Figure:
    """Forces at the end of each run of the sweep."""
    assert case.sweep is not None
    last = {row["label"]: row for row in rows}
    figure = Figure(figsize=(6, 3.6))
    axes = figure.subplots()
    at = np.arange(len(last))
    normal, tangential = columns(list(last.values()), "normal_force", "tangential_force")
    axes.bar(at - 0.2, normal, 0.4, color=COLOURS[0], label="normal")
    axes.bar(at + 0.2, tangential, 0.4, color=COLOURS[1], label="tangential")
    axes.set_xticks(at, [label.split("=", 1)[-1] for label in last])
    axes.set_xlabel(case.sweep.key)
    axes.set_ylabel("force at the end of the run (N)")
    axes.legend()
    return figure
