"""What ``tribox plot`` does: the figures of a results directory again, and its animation."""

from __future__ import annotations

from pathlib import Path

from tribox.app.errors import InputError
from tribox.app.figures.field_values import named_after
from tribox.app.figures.run_figures import draw_figures
from tribox.app.results import read


def redraw(directory: Path, field: str, animate: str | None) -> None:
    """Draw the figures of a run from its files, or those of a sweep and of its runs.

    Args:
        directory: of the results.
        field: array of the field files that bodies are coloured by.
        animate: kind of the animation that is written too, gif or mp4; None: none.

    Raises:
        InputError: the files cannot be used, or there is no such array.
    """
    results = read(directory)
    for one in [results, *results.parts.values()]:
        if one.unfinished:
            print(f"note: {one.directory}: the run {one.unfinished}")
        if one is not results and one.directory.is_symlink():
            raise InputError(f"{one.directory}: is a link, and tribox writes through none")
        draw_figures(one, field)
        if animate is not None and one.case.sweep is None:
            from tribox.app.figures.animation import animate as write_animation

            path = one.directory / "figures" / f"{named_after('animation', field)}.{animate}"
            frames = write_animation(one, path, field)
            print(f"{path}: {frames} frames")
    print(f"figures in {directory / 'figures'}")
