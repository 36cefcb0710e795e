"""Figures of explicit runs: phase plots of sprung surfaces, histories of several runs overlaid."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from tribox.app.case.stage import solver_of
from tribox.app.figures.style import COLOURS, STYLE, columns, save
from tribox.app.figures.symbols import DISPLACEMENT, FRICTION_FORCE, REACTION, TIME
from tribox.app.figures.units import fitting

if TYPE_CHECKING:
    from tribox.app.results import Results
    from tribox.app.results.table import Table


def draw_phases(results: Results, figures: Path) -> list[Path]:
    """A phase plot of each sprung surface, ``phase.png`` or, of several, ``phase-NAME.png``.

    Only explicit stages are shown: in the others nothing swings.

    Returns:
        The files.
    """
    case, table = results.case, results.table("surfaces")
    sprung = [(b.surface, b.spring.direction) for b in case.boundary if b.spring is not None]
    stages = [
        stage.name for stage in case.stage if solver_of(stage, case.solver.kind) == "explicit"
    ]
    if not sprung or not len(table):
        return []
    files = []
    for surface, axis in sprung:
        rows = table.where("surface", surface).where("stage", *stages)
        if len(rows):
            picture = "phase.png" if len(sprung) == 1 else f"phase-{surface}_{axis}.png"
            files.append(figures / picture)
            figure = phase_figure(rows, surface, axis)
            figure.suptitle(case.title, fontsize=9)
            save(figure, files[-1])
    return files


def phase_figure(rows: Table, surface: str, axis: str) -> Figure:
    """The force on a sprung surface over time, and its velocity against that force.

    Args:
        rows: of ``surfaces.csv``, of one surface.
        surface: its name.
        axis: direction of the spring.
    """
    time, force, speed = (rows[name] for name in ("time", f"force_{axis}", f"velocity_{axis}"))
    times, forces, speeds = fitting(np.ptp(time), "s"), fitting(force, "N"), fitting(speed, "m/s")
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(times.of(time - time[0]), forces.of(force), color=COLOURS[0], lw=1)
    named = f"{REACTION.name} of the spring on {surface}, {REACTION.symbol}_{axis} ({forces.name})"
    left.set_xlabel(f"{TIME.name} since the first explicit row ({times.name})")
    left.set_ylabel(named)
    right.plot(forces.of(force), speeds.of(speed), color=COLOURS[1], lw=0.8)
    right.set_xlabel(named)
    right.set_ylabel(f"velocity of {surface} in {axis} ({speeds.name})")
    return figure


def draw_overlay(
    runs: dict[str, tuple[list[dict[str, Any]], list[dict[str, Any]]]], path: Path
) -> None:
    """Draw the friction force of runs made by both solvers over the driven displacement.

    An explicit row is a mean over its interval and is drawn at the middle of it.

    Args:
        runs: by what to call them, rows of the implicit history (dots) and the explicit (a line).
        path: the picture.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(7, 4.4))
        axes = figure.subplots()
        for number, (label, (implicit, explicit)) in enumerate(runs.items()):
            colour = COLOURS[number % len(COLOURS)]
            at, force, speed = columns(
                implicit, "driven_displacement", "friction_force", "velocity"
            )
            driven = np.abs(speed) > 0.0
            axes.semilogy(at[driven] * 1e6, force[driven], "o", ms=4, mfc="none", color=colour)
            at, force, speed = columns(
                explicit, "driven_displacement", "friction_force", "velocity"
            )
            middle, driven = 0.5 * (at[1:] + at[:-1]), np.abs(speed[1:]) > 0.0
            axes.semilogy(middle[driven] * 1e6, force[1:][driven], color=colour, label=label)
        axes.plot([], [], "o", color="0.4", mfc="none", label="implicit")
        axes.plot([], [], "-", color="0.4", label="explicit")
        axes.set_xlabel(f"driven {DISPLACEMENT.name} (µm)")
        axes.set_ylabel(FRICTION_FORCE.label())
        axes.legend(fontsize=8)
        save(figure, path)
