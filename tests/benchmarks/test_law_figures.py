"""The figures of the law: what they show, and that they are drawn."""

import numpy as np

from benchmarks.law_figures import (
    FLOWS,
    draw_law,
    film_stress,
    traction_over_pressure,
    velocity_jumps,
)


def test_the_literal_rule_takes_energy_from_nowhere_and_the_consistent_one_does_not():
    literal, consistent = velocity_jumps("literal"), velocity_jumps("consistent")
    # At each return below V*: half (1 - alpha) K_T (mu p/K_T)^2, times 3 of the 4 cycles.
    gained = 0.5 * 0.5 * 1e12 * (0.1 * 3e6 / 1e12) ** 2
    assert consistent.least >= 0.0
    assert np.isclose(literal.least, -gained, rtol=0.1)
    assert (np.diff(consistent.dissipated) >= 0.0).all()
    assert (np.diff(literal.dissipated) < -0.9 * gained).sum() == 3


def test_the_film_flows_as_its_options_say():
    speed = np.geomspace(1e-4, 1.0, 50)
    plain, limit, thin, thick = (film_stress(speed, **flow) for flow in FLOWS.values())
    np.testing.assert_allclose(plain, 0.8 * speed / 250e-9)
    assert (limit < 8e4 * (1 + 1e-12)).all() and limit[-1] > 7.9e4
    assert (thin < plain).all() and np.allclose(thick, plain * np.exp(0.9))
    pressure = np.array([1e-9, 1e-3])
    assert traction_over_pressure(0.0, pressure).min() > 1e3
    assert traction_over_pressure(1e4, pressure).max() < 1.0


def test_every_figure_is_drawn(tmp_path):
    files = draw_law(tmp_path / "figures")
    assert len(files) == 3 and all(file.stat().st_size > 1e4 for file in files)
