"""Pages are cut to what is drawn, and are the pictures that matplotlib makes."""

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from tribox.app.figures.steady_points import film_numbers
from tribox.app.figures.style import CASE_STYLE, MARGIN, save, write_png
from tribox.forms.friction.parameters import FrictionMapParameters, with_preset


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


def test_a_film_has_its_colour_alone_and_beside_others():
    """Of a map, of a sweep and of a run with one film only; films beside it get other ones."""
    law = FrictionMapParameters(
        **with_preset("friction-map", {"mu_s": 0.1, "K_T": 1e12, "V_star": 1.0, "V_star_at": 1e-8})
    )
    usual = [10e-9, 30e-9, 180e-9, 250e-9]
    assert list(film_numbers(usual, law).values()) == [0, 1, 2, 3]
    for film in (*usual, 50e-9, 100e-9, 300e-9):
        [alone] = film_numbers([film], law).values()
        for others in (usual, [10e-9, 30e-9, 50e-9, 100e-9], [180e-9]):
            beside = {one for one in others if max(one, film) <= 250e-9 or one < 250e-9}
            numbers = film_numbers({film, *beside}, law)
            assert numbers[film] == alone, film
            assert len(set(numbers.values())) == len(numbers)
    many = film_numbers([1e-9 * D for D in range(20, 240, 20)], law)
    assert len(many) == 11 and set(range(6)) < set(many.values())
