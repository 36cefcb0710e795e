"""Figures of the history of a run: forces and energies over the steps."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from app.figures.style import COLOURS, columns


def _mark_stages(axes: Axes, rows: list[dict[str, Any]], named: bool) -> None:
    """A line where each stage or velocity begins, and its name above the axes."""
    keys = [(row["stage"], row["velocity"]) for row in rows]
    starts = [i for i, key in enumerate(keys) if i == 0 or key != keys[i - 1]]
    for start in starts:
        axes.axvline(rows[start]["step"] - 0.5, color="0.8", lw=0.8, zorder=0)
    apart = 0.03 * len(rows)
    last = -apart
    for start in starts:
        if not named or start - last < apart:
            continue
        last = start
        stage, velocity = keys[start]
        axes.annotate(
            f"{velocity:g} m/s" if velocity else stage,
            (rows[start]["step"] - 0.5, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            fontsize=7,
            color="0.35",
            rotation=60,
        )


def forces_figure(rows: list[dict[str, Any]]) -> Figure:
    """Forces and their ratio over the steps."""
    figure = Figure(figsize=(7, 5.4))
    top, bottom = figure.subplots(2, 1, sharex=True)
    step, normal, tangential, friction = columns(
        rows, "step", "normal_force", "tangential_force", "friction_coefficient"
    )
    top.plot(step, normal, color=COLOURS[0], label="normal force")
    top.plot(step, tangential, color=COLOURS[1], label="tangential force")
    top.set_ylabel("force (N)")
    top.legend()
    bottom.plot(step, friction, color=COLOURS[2])
    bottom.set_ylabel("T/N (-)")
    bottom.set_ylim(bottom=0.0)
    bottom.set_xlabel("step")
    _mark_stages(top, rows, named=True)
    _mark_stages(bottom, rows, named=False)
    return figure


def energies_figure(rows: list[dict[str, Any]]) -> Figure:
    """Where the work of the run went, over the steps."""
    figure = Figure(figsize=(7, 4))
    axes = figure.subplots()
    step, strain, interface, dissipated, numerical, kinetic, damping, error = columns(
        rows,
        "step",
        "strain_energy",
        "interface_energy",
        "dissipation",
        "numerical_dissipation",
        "kinetic_energy",
        "damping_dissipation",
        "energy_error",
    )
    parts = {"strain": strain, "interface": interface, "dissipated": dissipated - numerical}
    parts |= {"kinetic": kinetic} if kinetic.any() else {}
    parts |= {"damped": damping} if damping.any() else {}
    supplied = sum(parts.values()) + error
    moving_first = (
        abs(supplied - columns(rows, "external_work")[0]).max() > 1e-9 * abs(supplied).max()
    )
    name = "external work" + " and initial kinetic energy" * bool(moving_first)
    axes.plot(step, supplied, color="k", lw=2.5, alpha=0.35, label=name)
    axes.stackplot(step, *parts.values(), labels=list(parts), colors=COLOURS, alpha=0.6)
    largest = float(np.max(np.abs(supplied))) or 1.0
    axes.plot(step, error, color=COLOURS[1], lw=1, label="not accounted for")
    axes.set_title(
        f"largest gap between work and its uses: {np.max(np.abs(error)) / largest:.1e} of the work",
        fontsize=9,
    )
    axes.set_xlabel("step")
    axes.set_ylabel("energy (J)")
    # Below: areas and lines may fill all of the axes.
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=3, fontsize=8)
    return figure
