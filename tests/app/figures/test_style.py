"""Pages are cut to what is drawn, and are the pictures that matplotlib makes."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from tribox.app.figures.png import write_png
from tribox.app.figures.style import CASE_STYLE, MARGIN, save


def page(path) -> np.ndarray:
    with Image.open(path) as picture:
        assert picture.mode in ("RGB", "RGBA") and picture.info["dpi"] == pytest.approx(
            (150, 150), 1e-3
        )
        return np.asarray(picture.convert("RGB"))


def drawn(**how) -> Figure:
    figure = Figure(figsize=(3, 2), **how)
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [0.0, 3.0])
    axes.set_xlabel("x (mm)")
    return figure


def test_png_holds_the_pixels(tmp_path):
    pixels = np.random.default_rng(1).integers(0, 256, (7, 5, 3)).astype(np.uint8)
    write_png(tmp_path / "one.png", pixels, 150.0)
    np.testing.assert_array_equal(page(tmp_path / "one.png"), pixels)


def test_page_is_cut_as_matplotlib_cuts_it(tmp_path):
    with rc_context(CASE_STYLE):
        save(drawn(layout="constrained"), tmp_path / "ours.png")
        drawn(layout="constrained").savefig(tmp_path / "theirs.png", bbox_inches="tight")
    ours, theirs = page(tmp_path / "ours.png"), page(tmp_path / "theirs.png")
    # Matplotlib measures text by its box, which has some room above and below the letters.
    assert np.abs(np.subtract(ours.shape, theirs.shape)).max() <= 8
    inked = (ours != 255).any(axis=2)
    rows, columns = np.flatnonzero(inked.any(axis=1)), np.flatnonzero(inked.any(axis=0))
    room = round(150 * MARGIN)
    assert (rows[0], columns[0]) == (room, room)
    assert (len(ours) - 1 - rows[-1], ours.shape[1] - 1 - columns[-1]) == (room, room)
    assert abs(int(inked.sum()) / int((theirs != 255).any(axis=2).sum()) - 1.0) < 0.02


def test_what_is_drawn_beyond_the_page_is_kept(tmp_path):
    with rc_context(CASE_STYLE):
        figure = drawn()
        figure.axes[0].annotate("far out", (1.3, 0.5), xycoords="axes fraction")
        save(figure, tmp_path / "wide.png")
    assert page(tmp_path / "wide.png").shape[1] > 3 * 150


def test_shared_axes_keep_the_room_of_their_ticks(tmp_path):
    """Ticks without labels are told from the layout of matplotlib's own."""
    shown = []
    for write in (save, lambda figure, path: figure.savefig(path)):
        with rc_context(CASE_STYLE):
            figure = Figure(figsize=(3, 3), layout="constrained")
            upper, lower = figure.subplots(2, 1, sharex=True)
            upper.plot([0.0, 1.0], [0.0, 3.0])
            lower.plot([0.0, 1.0], [0.0, 3e3])
            write(figure, tmp_path / "shared.png")
        shown.append([axes.get_position().bounds for axes in figure.axes])
    np.testing.assert_allclose(shown[0], shown[1], atol=1e-12)


def test_ticks_that_are_made_once_are_those_of_matplotlib(tmp_path):
    """Axes whose size the layout changes, one of them logarithmic, and a colour bar."""
    pages = []
    with rc_context(CASE_STYLE):
        for _ in range(2):
            figure = Figure(figsize=(8, 4), layout="constrained")
            left, right = figure.subplots(1, 2)
            left.loglog([1.0, 2e4], [3e-5, 1.0])
            right.set_ylabel("a label that\ntakes room")
            figure.colorbar(right.scatter([0.0, 1.0], [0.0, 3e3], c=[1.0, 2e6]), ax=right)
            canvas = FigureCanvasAgg(figure)
            if not pages:
                canvas.draw()
                pages.append(np.asarray(canvas.buffer_rgba())[..., :3])
                continue
            save(figure, tmp_path / "once.png", tight=False)
            pages.append(page(tmp_path / "once.png"))
            right.set_xlim(0.0, 50.0)
            save(figure, tmp_path / "again.png", tight=False)
            assert "40" in [text.get_text() for text in right.get_xticklabels()]
    np.testing.assert_array_equal(*pages)
