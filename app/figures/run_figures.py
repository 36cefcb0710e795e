"""All figures of a results directory, drawn from its files alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from tribox.app.errors import InputError
from tribox.app.figures.body_shapes import DEFAULT_FIELD, named_after
from tribox.app.figures.deformed import draw_deformed, draw_mesh
from tribox.app.figures.history import (
    draw_phases,
    energies_figure,
    force_displacement_figure,
    forces_figure,
)
from tribox.app.figures.steady_points import draw_steady, steady_series
from tribox.app.figures.stribeck import series_of, stribeck_figure
from tribox.app.figures.style import CASE_STYLE, save
from tribox.app.figures.sweep import comparison_figure, sweep_figure
from tribox.app.figures.tractions import film_figure
from tribox.app.results import read
from tribox.app.results.reading import files_of_one_run

if TYPE_CHECKING:
    from tribox.app.case.case import Case
    from tribox.app.results import Results
    from tribox.app.results.reading import Table


def draw_figures(results: Results, field: str = DEFAULT_FIELD) -> list[Path]:
    """Draw every figure that a results directory has the files for, bodies by ``field``.

    InputError if a file is cut off, there is no such array, or files are not of one run.
    """
    figures = results.directory / "figures"
    if figures.is_symlink():
        raise InputError(f"{figures}: is a link, and tribox writes through none; remove it")
    try:
        figures.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"{figures}: cannot be written ({error.strerror or error})") from None
    with rc_context(CASE_STYLE), files_of_one_run(results):
        if results.case.sweep is not None:
            return _draw_sweep(results, figures)
        files = _draw_run(results, figures) + draw_mesh(results, figures)
        return files + draw_deformed(results, figures, field)


def _draw_run(results: Results, figures: Path) -> list[Path]:
    """The figures of the tables of a run; none before its first step."""
    if not len(results.table("history")):
        return []
    drawn: dict[str, Figure | None] = {
        "history.png": forces_figure(results) if results.case.contact else None,
        "energy.png": energies_figure(results),
        "force_displacement.png": force_displacement_figure(results),
        "stribeck.png": stribeck_figure(series_of(results), results.case.title),
        "film.png": film_figure(results),
    }
    files = _saved(drawn, figures) + draw_phases(results, figures)
    steady = _steady_rows(results.table("load_steps"))
    if steady and _has_film(results.case):
        series = [steady_series(results.case, steady)]
        files += draw_steady(series, figures, results.case.title)
    return files


def _draw_sweep(results: Results, figures: Path) -> list[Path]:
    """The figures of all runs of a sweep together."""
    case = results.case
    found = [
        (_series_label(case, label), single, results.parts[label])
        for label, single in case.sweep_cases()
        if label in results.parts
    ]
    stribeck = [
        one
        for _, _, part in found
        for one in series_of(part, part.directory.name.replace("=", " = "))
    ]
    drawn = {
        "sweep.png": sweep_figure(results),
        "sweep_comparison.png": comparison_figure(results),
        "stribeck.png": stribeck_figure(stribeck, case.title),
    }
    files = _saved(drawn, figures)
    series = [
        steady_series(single, steady, label)
        for label, single, part in found
        if _has_film(single) and (steady := _steady_rows(part.table("load_steps")))
    ]
    return files + (draw_steady(series, figures, case.title) if series else [])


def _saved(drawn: dict[str, Figure | None], figures: Path) -> list[Path]:
    """Write the figures that there are."""
    made = {figures / name: figure for name, figure in drawn.items() if figure is not None}
    for path, figure in made.items():
        save(figure, path)
    return list(made)


def _has_film(case: Case) -> bool:
    """Whether the first pair follows the friction map."""
    return bool(case.contact) and case.contact[0].map is not None


def _steady_rows(load_steps: Table) -> list[dict[str, Any]]:
    """The ends of velocities that were held until steady, or were to be."""
    return [row for row in load_steps.records() if row["steady"] >= 0.0]


def _series_label(case: Case, label: str) -> str:
    """Name of a sweep's series: the swept value; "" where that is D, which the figures give."""
    assert case.sweep is not None
    return "" if case.sweep.key.endswith("film.thickness") else label


# -- What ``tribox plot`` does: the figures of a results directory again, and its animation --------


def redraw(directory: Path, field: str, animate: bool) -> None:
    """Draw the figures of a run, or of a sweep and its runs, again, and an animation if asked.

    InputError if the files cannot be used, or there is no such array.
    """
    results = read(directory)
    for one in [results, *results.parts.values()]:
        if one.unfinished:
            print(f"note: {one.directory}: the run {one.unfinished}")
        if one is not results and one.directory.is_symlink():
            raise InputError(f"{one.directory}: is a link, and tribox writes through none")
        draw_figures(one, field)
        if animate and one.case.sweep is None:
            from tribox.app.figures.animation import animate as write_animation

            path = one.directory / "figures" / f"{named_after('animation', field)}.gif"
            frames = write_animation(one, path, field)
            print(f"{path}: {frames} frames")
    print(f"figures in {directory / 'figures'}")
