"""Figures show the computed numbers: points on the closed form, marks where V* is."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from app import figures
from app.case import load_case
from app.results import read_table
from forms.closed_forms import threshold_speed


@pytest.fixture(autouse=True)
def _close_all():
    yield
    plt.close("all")


@pytest.fixture
def drawn(monkeypatch) -> dict[str, Figure]:
    """Figures by file name, kept instead of written."""
    kept: dict[str, Figure] = {}
    monkeypatch.setattr(figures, "save", lambda figure, path: kept.update({path.name: figure}))
    return kept


def test_saving_leaves_a_picture_and_no_open_figure(tmp_path):
    figure, axes = plt.subplots()
    axes.plot([0, 1], [0, 1])
    figures.save(figure, tmp_path / "a.png")
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    assert plt.imread(tmp_path / "a.png").std() > 0.0
    assert not plt.get_fignums()


def test_a_jump_is_not_joined():
    speed = np.array([1.0, 2.0, 4.0, 8.0])
    curve = np.array([9.0, 8.0, 2.0, 1.0])
    out = figures._broken(curve, speed, 3.0)
    assert np.isnan(out[1]) and np.array_equal(out[[0, 2, 3]], curve[[0, 2, 3]])
    assert np.array_equal(figures._broken(curve, speed, 10.0), curve)
    assert np.array_equal(figures._broken(curve, speed, np.inf), curve)


@pytest.mark.slow
def test_sweep_figures_show_the_steady_points(sfa, drawn):
    case = load_case(sfa / "case.toml")
    figures.draw_sweep(case, sfa)
    assert {"effective_viscosity.png", "friction_map.png"} <= set(drawn)
    rows = [row for row in read_table(sfa / "sweep.csv") if row["steady"] >= 0]
    parts = case.sweep_cases()

    left, right = drawn["effective_viscosity.png"].axes[:2]
    assert {left.get_xscale(), left.get_yscale(), right.get_xscale()} == {"log"}
    for axes, scaled in ((left, False), (right, True)):
        points = [line for line in axes.lines if line.get_label().startswith("D = ")]
        assert len(points) == len(parts)
        for line, (label, single) in zip(points, parts, strict=True):
            mine = [row for row in rows if row["label"] == label]
            scale = 1.0 / single.contact[0].film.thickness if scaled else 1.0
            x, y = line.get_data()
            assert x == pytest.approx([row["velocity"] * scale for row in mine])
            assert y == pytest.approx([row["effective_viscosity"] for row in mine])
    laws = [single.contact[0] for _, single in parts]
    stars = {
        round(float(threshold_speed(c.film.thickness, c.friction.parameters())), 9)
        for c in laws
        if c.film.thickness < c.friction.D_max
    }
    marks = {round(x[0], 9) for line in left.lines if len(set(x := line.get_xdata())) == 1}
    assert stars <= marks

    [plane] = drawn["friction_map.png"].axes
    shown = [line.get_ydata() for line in plane.lines if line.get_marker() in ("o", "s")]
    shown = np.sort(np.concatenate(shown)) * 1e6
    tractions = [abs(row["tangential_force"]) / row["contact_area"] for row in rows]
    assert shown == pytest.approx(sorted(tractions))


@pytest.mark.slow
def test_history_figures_show_the_history(sfa, drawn):
    part = sfa / "thickness=30nm"
    figures.draw_history(part)
    rows = read_table(part / "history.csv")
    top, bottom = drawn["history.png"].axes
    curves = {line.get_label(): line.get_ydata() for line in top.lines}
    assert curves["normal force"] == pytest.approx([row["normal_force"] for row in rows])
    assert curves["tangential force"] == pytest.approx([row["tangential_force"] for row in rows])
    assert bottom.get_ylabel() == "T/N (-)"
    [axes] = drawn["energy.png"].axes
    curves = {line.get_label(): line.get_ydata() for line in axes.lines}
    assert curves["external work"] == pytest.approx([row["external_work"] for row in rows])
