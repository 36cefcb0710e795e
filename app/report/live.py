"""``tribox report --watch``: a page of a run that goes on, which the browser loads again and again.

The page is written as a whole and renamed, and what it tells is read from files that the run
replaces or appends to in whole lines, so that neither waits for the other.
"""

from __future__ import annotations

import base64
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tribox.app.errors import InputError
from tribox.app.figures.body_shapes import DEFAULT_FIELD
from tribox.app.figures.deformed import draw_deformed
from tribox.app.figures.history import energies_figure, forces_figure
from tribox.app.figures.style import CASE_STYLE, COLOURS, save, thin_log_ticks
from tribox.app.report.page import NAME, environment
from tribox.app.report.tables import status_verdict
from tribox.app.results import Results, read
from tribox.app.results.directory import write_text
from tribox.app.results.table import Table

TEMPLATE = "live.html"
ATTEMPTS = 12  # that the page lists
ALIVE = "goes on"  # how `Results.unfinished` begins of a run that does


def watch_run(
    directory: Path, out: Path | None, every: float, sleep: Callable[[float], None] = time.sleep
) -> int:
    """Keep the page of a run up to date until the run has ended.

    Args:
        directory: of the results of a run.
        out: the page; None: ``report.html`` in the directory.
        every: s, between two pages.
        sleep: waits so many seconds.

    Returns:
        How often a page was written.

    Raises:
        InputError: there is no such run, it is a sweep, or the page cannot be written.
    """
    path, written, told = out or directory / NAME, 0, ""
    while (results := read(directory)).unfinished and ALIVE in str(results.unfinished):
        if results.case.sweep is not None:
            raise InputError(f"{directory}: is a sweep; name the directory of one of its runs")
        try:
            text = live_page(results, every)
        except InputError:  # a file is just being replaced: the next page has it
            text = ""
        if text:
            try:
                write_text(path, text)
            except OSError as error:
                raise InputError(f"{path}: cannot be written ({error.strerror})") from None
            written += 1
        if written == 1 and not told:
            told = f"{path}: open it in a browser; it is brought up to date every {every:g} s"
            print(told, flush=True)
        sleep(every)
    return written


def live_page(results: Results, every: float) -> str:
    """The HTML of a run as it is now.

    Args:
        results: of the run; read anew for each page.
        every: s, after which the browser loads it again.

    Raises:
        InputError: a file cannot be read at the moment.
    """
    summary, history, progress = results.summary, results.table("history"), _progress(results)
    return (
        environment()
        .get_template(TEMPLATE)
        .render(
            title=results.case.title or results.directory.resolve().name,
            directory=results.directory.resolve().name,
            every=every,
            now=time.strftime("%H:%M:%S"),
            status=status_verdict(summary, results.unfinished),
            facts=_facts(history, progress),
            explicit=_is_explicit(progress),
            attempts=progress.rows(slice(-ATTEMPTS, None)).records()[::-1],
            warnings=summary.get("warnings", []),
            pictures=_pictures(results, history, progress),
        )
    )


def _progress(results: Results) -> Table:
    return results.table("progress")


def _is_explicit(progress: Table) -> bool:
    """Whether the last attempt is an interval of an explicit stage."""
    return len(progress) > 0 and bool(progress["time_steps"][-1] > 0.0)


def _facts(history: Table, progress: Table) -> list[tuple[str, str]]:
    """Where the run stands, in a few numbers."""
    out: list[tuple[str, str]] = []
    if len(history):
        last = history.records()[-1]
        out = [
            ("step", f"{last['step']:.0f}"),
            ("stage", str(last["stage"])),
            ("time", f"{last['time']:.4g} s"),
            ("normal force", f"{last['normal_force']:.4g} N"),
            ("friction force", f"{last['friction_force']:.4g} N"),
            ("Newton iterations", f"{history['newton_iterations'].sum():.0f}"),
        ]
        if _is_explicit(progress):
            out[-1] = ("time steps", f"{progress['time_steps'].sum():.0f}")
    if len(progress):
        out.append(("failed attempts", f"{(progress['converged'] == 0.0).sum():.0f}"))
    return out


def _pictures(results: Results, history: Table, progress: Table) -> list[dict[str, Any]]:
    """Title and address of the figures; those for which there is nothing yet are left out."""
    found: list[tuple[str, bytes]] = []
    with rc_context(CASE_STYLE), TemporaryDirectory() as place:
        if len(history):
            figure = forces_figure(results) if results.case.contact else energies_figure(results)
            title = "Forces and friction" if results.case.contact else "Energies"
            found.append((title, _png(figure, Path(place))))
        if len(progress):
            found.append(("Attempts", _png(attempts_figure(progress), Path(place))))
        drawn = draw_deformed(results, Path(place), DEFAULT_FIELD, only_last=True)
        found += [("The last state that was written", path.read_bytes()) for path in drawn]
    return [
        {"title": title, "source": f"data:image/png;base64,{base64.b64encode(data).decode()}"}
        for title, data in found
    ]


def attempts_figure(progress: Table) -> Figure:
    """Residual or energy ratio, iterations or time steps, and length of each attempt.

    Failed ones are marked.
    """
    figure = Figure(figsize=(7.5, 5.2), layout="constrained")
    panels = figure.subplots(3, 1, sharex=True)
    number = np.arange(1, len(progress) + 1)
    failed = progress["converged"] == 0.0
    kinds: tuple[str, ...] = ("residual", "iterations", "fraction")
    labels: tuple[str, ...] = ("residual", "iterations", "length / step asked for")
    if _is_explicit(progress):
        kinds = ("kinetic_ratio", "time_steps", "fraction")
        labels = ("E_kin/E_strain", "time steps", "length / interval")
    for axes, name, label in zip(panels, kinds, labels, strict=True):
        values = progress[name]
        shown = np.isfinite(values) & ((values > 0.0) | (name == kinds[1]))
        axes.plot(number[shown], values[shown], ".-", color=COLOURS[0], lw=0.8, ms=4)
        marked = shown & failed
        axes.plot(number[marked], values[marked], "x", color="#b3202f", label="failed")
        axes.set_ylabel(label)
        if name != kinds[1] and shown.any():
            axes.set_yscale("log")
            axes.set_ylim(values[shown].min() / 2.0, 2.0 * values[shown].max())
            thin_log_ticks(axes)
    if failed.any():
        panels[0].legend(loc="best", fontsize=8)
    panels[-1].set_xlabel("attempt")
    panels[-1].xaxis.set_major_locator(MaxNLocator(8, integer=True))
    return figure


def _png(figure: Figure, place: Path) -> bytes:
    path = place / "figure.png"
    save(figure, path)
    return path.read_bytes()
