"""Pages are cut to what is drawn, and are the pictures that matplotlib makes."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import rgb_to_hsv, to_rgb
from matplotlib.figure import Figure
from PIL import Image

from tribox.app.figures import steady_points
from tribox.app.figures.steady_points import film_numbers
from tribox.app.figures.stribeck import StribeckSeries, stribeck_figure
from tribox.app.figures.style import (
    CASE_STYLE,
    COLOURS,
    DASHES,
    MARGIN,
    MARKERS,
    RED,
    save,
)
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


# From linear RGB to what is seen without the long, or the medium, cones (Machado et al. 2009).
SIGHTS = {
    "usual": np.eye(3),
    "protan": np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]]),
    "deutan": np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]]),
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
WHITE = np.array([0.9505, 1.0, 1.089])


def seen(colour: str, sight: str) -> np.ndarray:
    """A colour in CIE Lab, as one kind of eyes sees it."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    x = TO_XYZ @ np.clip(SIGHTS[sight] @ linear, 0.0, 1.0) / WHITE
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", list(SIGHTS))
def test_any_two_colours_differ_for_all_eyes(sight):
    found = {
        pair: np.linalg.norm(seen(pair[0], sight) - seen(pair[1], sight))
        for pair in combinations(COLOURS, 2)
    }
    # A difference of 2.3 is just seen; blue and purple were 0.3 apart for protan eyes.
    assert min(found.values()) > 15.0, min(found, key=found.get)
    assert len(COLOURS) == len(MARKERS) == len(DASHES) == len(set(map(str, DASHES)))


def test_there_is_one_red():
    reds = {RED}
    root = Path(__file__).resolve().parents[3]
    for file in (*root.glob("app/**/*.py"), *root.glob("app/**/*.html")):
        text = file.read_text(encoding="utf-8")
        assert not re.search(r'"(?:C3|red|crimson|firebrick|darkred|tab:red)"', text), file
        for found in re.findall(r"#[0-9a-fA-F]{6}\b", text.split("prefers-color-scheme")[0]):
            hue, share, light = rgb_to_hsv(to_rgb(found))
            if (hue < 0.045 or hue > 0.955) and share > 0.5 and light > 0.5:
                reds.add(found)
    assert reds == {RED}


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


def test_figures_of_a_run_with_one_film_take_its_number_and_without_films_count():
    own = {"mu_s": 0.1, "K_T": 1e12, "V_star": 1e-3, "V_star_at": 1e-8}
    law = FrictionMapParameters(**with_preset("friction-map", own))
    film = steady_points.Series("", 180e-9, law, *[np.ones(2)] * 3, 1.0, 0.1, np.ones(2, bool))
    figure = steady_points._map_figure([film], "")
    assert {line.get_color() for line in figure.axes[0].lines[:3]} == {COLOURS[2]}
    curve = StribeckSeries("", *[np.ones(2)] * 3, np.ones(2, bool))
    drawn = stribeck_figure([replace(curve, film=(180e-9, law))])
    assert drawn is not None and drawn.axes[0].lines[0].get_color() == COLOURS[2]
    several = stribeck_figure([curve, curve])  # of pairs, say
    assert several is not None
    assert [line.get_color() for line in several.axes[0].lines[::2]] == list(COLOURS[:2])
