"""The figure of a sweep: values as numbers with their unit, or as words."""

import json

import numpy as np
import pytest

from tests.app.figures.made_results import write_rows
from tests.app.figures.test_history import FORCES, SPEEDS, write_film
from tribox.app.figures.run_figures import draw_figures
from tribox.app.figures.sweep import MOST_LINES, sweep_figure, swept_values
from tribox.app.results import read

KEY = "contact.0.film.thickness"


@pytest.mark.parametrize(
    ("values", "places", "label", "log"),
    [
        (["10 nm", "0.03 um", "180 nm"], [10.0, 30.0, 180.0], f"{KEY} (nm)", True),
        ([1, 2.5, 4], [1.0, 2.5, 4.0], KEY, False),
        (["q1", "q1-sri"], [0.0, 1.0], KEY, False),
        ([True, False], [0.0, 1.0], KEY, False),
        (["10 nm", 3e-8], [0.0, 1.0], KEY, False),
        (["10 nm", "5 s"], [0.0, 1.0], KEY, False),
    ],
)
def test_values_are_numbers_where_they_can_be(values, places, label, log):
    labels = [f"thickness={value}" for value in values]
    found = swept_values(KEY, labels, values)
    assert list(found.places.values()) == pytest.approx(places)
    assert found.label == label and found.is_log == log
    assert bool(found.texts) == (places == [0.0, 1.0])


def write_sweep(directory, film):
    """A sweep over two thicknesses, with its parts."""
    directory.mkdir()
    sweep = f'\n[sweep]\nkey = "{KEY}"\nvalues = ["30 nm", "10 nm"]\n'
    rows, parts = [], {}
    for thickness in ("30 nm", "10 nm"):
        label = f"thickness={thickness.replace(' ', '')}"
        ends = write_film(directory / label, film, thickness=thickness).load_steps
        rows += [r | {"label": label} for r in ends.to_dict("records")]
        parts[label] = {"status": "done"}
    text = (directory / "thickness=30nm" / "case.toml").read_text()
    (directory / "case.toml").write_text(text + sweep)
    write_rows(directory / "sweep.csv", rows)
    (directory / "summary.json").write_text(json.dumps({"parts": parts}))
    return read(directory)


def test_a_line_for_each_stage_and_velocity(film, tmp_path):
    figure = sweep_figure(write_sweep(tmp_path / "out", film))
    normal, friction, ratio = figure.axes
    joined = [line for line in friction.lines if line.get_marker() != "x"]
    assert [line.get_label() for line in joined] == [
        "press", "slide, 10⁻⁵ m/s", "slide, 0.001 m/s", "slide, 0.1 m/s", "slide, 10 m/s",
    ]  # fmt: skip
    for line, force in zip(joined[1:], FORCES, strict=True):
        assert line.get_xdata().tolist() == [10.0, 30.0]
        assert line.get_ydata() == pytest.approx([force, force])
    [crossed] = [x for x in friction.lines if x.get_marker() == "x" and len(x.get_xdata())]
    assert crossed.get_ydata() == pytest.approx([FORCES[2]] * 2)
    assert ratio.get_xlabel() == f"{KEY} (nm)" and friction.get_yscale() == "log"
    assert len(SPEEDS) + 1 <= MOST_LINES
    # The legend lies outside of the axes, off the data.
    figure.draw_without_rendering()
    legend, box = figure.legends[0].get_window_extent(), normal.get_window_extent()
    assert legend.x0 >= box.x1 - 1.0


def test_all_figures_of_a_sweep_and_of_its_parts(film, tmp_path):
    results = write_sweep(tmp_path / "out", film)
    assert {path.name for path in draw_figures(results)} == {
        "sweep.png", "stribeck.png", "effective_viscosity.png", "friction_map.png",
    }  # fmt: skip
    assert np.all([path.stat().st_size > 10_000 for path in (tmp_path / "out/figures").iterdir()])
