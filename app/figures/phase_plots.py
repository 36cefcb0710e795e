"""Figures of explicit runs: phase plots of sprung surfaces, histories of several runs overlaid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from app.case.case import Case
from app.case.stage import solver_of
from app.figures.style import COLOURS, STYLE, columns, save
from app.results.directory import read_table


def draw_phases(case: Case, directory: Path) -> None:
    """A phase plot of each sprung surface, ``phase.png`` or, of several, ``phase-NAME.png``."""
    table = directory / "surfaces.csv"
    sprung = [(b.surface, b.spring.direction) for b in case.boundary if b.spring is not None]
    stages = {
        stage.name for stage in case.stage if solver_of(stage, case.solver.kind) == "explicit"
    }
    if sprung and stages and table.is_file():
        rows = [row for row in read_table(table) if row["stage"] in stages]
        for surface, axis in sprung:
            picture = "phase.png" if len(sprung) == 1 else f"phase-{surface}_{axis}.png"
            mine = [row for row in rows if row["surface"] == surface]
            draw_phase(mine, axis, directory / "figures" / picture)


def draw_phase(rows: list[dict[str, Any]], axis: str, path: Path) -> None:
    """Draw the phase plot of a sprung surface: its velocity against the force in the spring.

    Args:
        rows: of ``surfaces.csv``, of one surface.
        axis: direction of the spring.
        path: the picture.
    """
    time, force, speed = columns(rows, "time", f"force_{axis}", f"velocity_{axis}")
    with rc_context(STYLE):
        figure = Figure(figsize=(10, 4), layout="constrained")
        left, right = figure.subplots(1, 2)
        left.plot((time - time[0]) * 1e3, force, color=COLOURS[0], lw=1)
        left.set_xlabel("time since the first explicit row (ms)")
        left.set_ylabel("force in the spring (N)")
        right.plot(force, speed, color=COLOURS[1], lw=0.8)
        right.set_xlabel("force in the spring (N)")
        right.set_ylabel("velocity of the surface (m/s)")
        save(figure, path)


def draw_overlay(
    runs: dict[str, tuple[list[dict[str, Any]], list[dict[str, Any]]]], path: Path
) -> None:
    """Draw the tangential force of runs made by both solvers over the driven displacement.

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
                implicit, "driven_displacement", "tangential_force", "velocity"
            )
            driven = speed != 0.0
            axes.semilogy(at[driven] * 1e6, force[driven], "o", ms=4, mfc="none", color=colour)
            at, force, speed = columns(
                explicit, "driven_displacement", "tangential_force", "velocity"
            )
            middle, driven = 0.5 * (at[1:] + at[:-1]), speed[1:] != 0.0
            axes.semilogy(middle[driven] * 1e6, force[1:][driven], color=colour, label=label)
        axes.plot([], [], "o", color="0.4", mfc="none", label="implicit")
        axes.plot([], [], "-", color="0.4", label="explicit")
        axes.set_xlabel("driven displacement (µm)")
        axes.set_ylabel("tangential force (N)")
        axes.legend(fontsize=8)
        save(figure, path)
