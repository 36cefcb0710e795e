"""The look all figures share, and what they need to read and write files."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Tick
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator
from numpy.typing import NDArray
from PIL import Image

from tribox.app.results.directory import create

Floats = NDArray[np.float64]
Longs = NDArray[np.int64]
Pixels = NDArray[np.uint8]

RED = "#b3202f"  # of lines that are second, and of what is wrong: the only one in figures
# Any two differ for readers without one kind of cones too; markers and dashes say the same.
COLOURS = ("#1b6ca8", RED, "#009e73", "#cc79a7", "#e69f00", "#2b2b2b")
FILLS = (*COLOURS[:1], *COLOURS[2:])  # of areas, with lines in red above them
DECADES, MANY_DECADES = 2.5, 5.0  # from which on an axis has ticks at 1, 2, 5; at 1 only
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
PLAIN = (1e-3, 1e5)  # numbers between these have no power of ten
MARGIN = 0.1  # inches of white round what is drawn
LEVEL = 1  # of zlib; 6, the default, takes much longer for a few per cent less
MARKERS = ("o", "s", "^", "D", "v", "P")
DASHES: tuple[Any, ...] = (
    *("-", (0, (6, 2)), (0, (6, 1.5, 1, 1.5)), (0, (3, 1.2)), (0, (9, 2))),
    (0, (6, 1.5, 1, 1.5, 1, 1.5)),
)
STYLE = {
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.dpi": 150,
}
# Of figures that hold names and titles of a case: a $ in them begins no formula. Logarithmic axes
# then need :func:`thin_log_ticks`, matplotlib's own powers of ten being formulae.
CASE_STYLE = STYLE | {"text.parse_math": False}


def save(figure: Figure, path: Path, *, tight: bool = True) -> None:
    """Write a PNG under a temporary name and rename it.

    ``tight``: the page is cut or widened to what is drawn and a margin.
    """
    part = path.with_suffix(".part.png")
    create(part)
    try:
        with _ticks_once(figure):
            _write(figure, part, tight)
        part.replace(path)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def _write(figure: Figure, part: Path, tight: bool) -> None:
    canvas = FigureCanvasAgg(figure)
    # Constrained layout puts everything on the page; otherwise matplotlib finds where it ends.
    within = isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine)
    page = None
    if within or not tight:
        canvas.draw()
        page = np.asarray(canvas.buffer_rgba())
        page = _cut(page, round(MARGIN * figure.dpi)) if tight else page
    if page is None:
        figure.savefig(part, bbox_inches="tight", pil_kwargs={"compress_level": LEVEL})
        return
    # Without the channel of transparency, which is the same everywhere.
    picture = Image.fromarray(np.ascontiguousarray(page[..., :3]))
    picture.save(part, "png", dpi=(figure.dpi, figure.dpi), compress_level=LEVEL)


def _cut(page: Pixels, margin: int) -> Pixels | None:
    """The part (h', w', 4) of a page (h, w, 4) that is not white, with a white margin in pixels.

    Matplotlib finds it by drawing everything twice more.

    Returns:
        None where what is drawn reaches an edge of the page.
    """
    marked = page.view(np.uint32)[..., 0] != np.uint32(0xFFFFFFFF)
    down, across = np.flatnonzero(marked.any(axis=1)), np.flatnonzero(marked.any(axis=0))
    if not len(down):
        return page
    low, high = (down[0], across[0]), (down[-1], across[-1])
    if min(low) == 0 or high[0] == len(page) - 1 or high[1] == page.shape[1] - 1:
        return None
    inner = page[low[0] : high[0] + 1, low[1] : high[1] + 1]
    out = np.full((*(n + 2 * margin for n in inner.shape[:2]), 4), 0xFF, dtype=np.uint8)
    out[margin:-margin, margin:-margin] = inner
    return out


@contextmanager
def _ticks_once(figure: Figure) -> Iterator[None]:
    """Draw inside; axes of the plane are spared what needs their ticks again and changes no pixel.

    That is the search for minor ticks that coincide with major ones where there are none, and the
    extent of the line along an axis whose labels lie further out. And the ticks of an axis of the
    same limits and size are made once: layout and drawing ask for them a dozen times.
    """
    kept: list[Any] = []
    for axes in figure.axes:
        for axis, sides in ((axes.xaxis, ("bottom", "top")), (axes.yaxis, ("left", "right"))):
            if isinstance(axis.get_minor_locator(), NullLocator):
                axis.remove_overlapping_locs = False
            labelled = axis.get_tick_params("major")
            for side in sides:
                if side in axes.spines and labelled.get(f"label{side}", False):
                    axes.spines[side].set_in_layout(False)
            if axes.name == "rectilinear" and hasattr(axis, "_update_ticks"):
                kept.append(axis)
    for one in kept:
        one._update_ticks = _kept_ticks(one)
    try:
        yield
    finally:
        for one in kept:
            del one._update_ticks


def _kept_ticks(axis: Any) -> Callable[[], list[Tick]]:
    """What makes the ticks of an axis, kept until its limits or the size of its axes change."""
    make, box = axis._update_ticks, axis.axes.bbox
    last: tuple[float, ...] = ()
    ticks: list[Tick] = []

    def made() -> list[Tick]:
        nonlocal last, ticks
        now = (*axis.get_view_interval(), box.width, box.height)
        if now != last:
            last, ticks = now, make()
        return ticks

    return made


def panels_in(room: FigureBase, rows: int, columns: int, count: int) -> list[Axes]:
    """All panels of a grid, row by row; those from ``count`` on are not shown."""
    panels: list[Axes] = list(room.subplots(rows, columns, squeeze=False).flat)
    for idle in panels[count:]:
        idle.set_visible(False)
    return panels


def thin_log_ticks(axes: Axes) -> None:
    """On logarithmic axes few ticks, plain numbers or, over several decades, powers as plain text.

    Matplotlib's own eight ticks between two decades and its powers set as formulae take most of
    the time of a figure. To be called when the limits of the axes are what they will be.
    """
    for axis in (axes.xaxis, axes.yaxis):
        low, high = axis.get_view_interval()
        if axis.get_scale() != "log":
            continue
        if high < 10.0**DECADES * low:
            between = (1.0, 2.0, 5.0) if PLAIN[0] <= low and high < PLAIN[1] else (1.0, 3.0)
            axis.set_major_locator(MaxNLocator(5) if high < 4.0 * low else LogLocator(subs=between))
            axis.set_minor_locator(NullLocator())
            axis.set_major_formatter(FuncFormatter(lambda value, _: plain_number(value)))
            continue
        many = high > 10.0**MANY_DECADES * low
        axis.set_minor_locator(NullLocator() if many else LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter(NullFormatter())
        axis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(value)))


def colour_of(number: int) -> str:
    """The colour of a line, an own one for each of the first."""
    return COLOURS[number % len(COLOURS)]


def marker_of(number: int) -> str:
    """The marker of a line's points."""
    return MARKERS[number % len(MARKERS)]


def dashes_of(number: int) -> Any:
    """The dashes of a line, as matplotlib's ``linestyle``."""
    return DASHES[number % len(DASHES)]


def plain_number(value: float) -> str:
    """A number such as 0.2 or 3·10⁵ in plain text."""
    if PLAIN[0] <= abs(value) < PLAIN[1] or value == 0.0:
        return f"{value:.4g}"
    digits, _, power = f"{value:.3e}".partition("e")
    mantissa = "" if float(digits) == 1.0 else f"{float(digits):g}·"
    return f"{mantissa}10" + f"{int(power)}".translate(RAISED)


def power_of_ten(value: float) -> str:
    """A decade such as 10⁻³ in plain text."""
    return "10" + f"{round(math.log10(value))}".translate(RAISED)


def columns(rows: list[dict[str, Any]], *names: str) -> list[Floats]:
    """Columns of a table's rows, each (n,)."""
    return [np.array([row[name] for row in rows]) for name in names]
