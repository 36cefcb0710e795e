"""What all figures share; those of a sweep are in test_sfa.py, with a sweep to draw."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imread

from app.figures import steady_points as figures


def test_saving_leaves_a_picture_and_nothing_else(tmp_path):
    figure = Figure()
    figure.subplots().plot([0, 1], [0, 1])
    figures.save(figure, tmp_path / "a.png")
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]
    assert imread(tmp_path / "a.png").std() > 0.0


def test_a_jump_is_not_joined():
    speed = np.array([1.0, 2.0, 4.0, 8.0])
    curve = np.array([9.0, 8.0, 2.0, 1.0])
    out = figures._broken(curve, speed, 3.0)
    assert np.isnan(out[1]) and np.array_equal(out[[0, 2, 3]], curve[[0, 2, 3]])
    assert np.array_equal(figures._broken(curve, speed, 10.0), curve)
    assert np.array_equal(figures._broken(curve, speed, np.inf), curve)
