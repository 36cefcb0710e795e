"""Figures of the verification report: computed points over closed forms."""

from __future__ import annotations

from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tribox.app.figures.style import COLOURS, MARKERS, STYLE, save
from tribox.app.verify.result import Panel, Verification


def draw(result: Verification, path: Path) -> None:
    """Write the figure of one verification case as PNG.

    Args:
        result: with at least one panel.
        path: the file.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(6.5 * len(result.panels), 4.0))
        axes = figure.subplots(1, len(result.panels), squeeze=False)
        for panel, ax in zip(result.panels, axes[0], strict=True):
            _draw_panel(panel, ax)
        figure.suptitle(result.title, fontsize=10)
        save(figure, path)


def _draw_panel(panel: Panel, axes: Axes) -> None:
    """Closed forms as lines, computed values as points, in order of their colours."""
    seen = {True: 0, False: 0}
    for line in panel.lines:
        number = seen[line.exact]
        seen[line.exact] += 1
        if line.exact:
            axes.plot(line.x, line.y, color=COLOURS[number % 6], lw=1.2, label=line.label)
        else:
            axes.plot(
                line.x,
                line.y,
                MARKERS[number % 6],
                color=COLOURS[number % 6],
                ms=3,
                mfc="none",
                mew=0.8,
                label=line.label,
            )
    if panel.log:
        axes.set_xscale("log")
        axes.set_yscale("log")
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.legend(fontsize=7)
