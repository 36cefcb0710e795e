"""How far a pressure alternates from vertex to vertex, and the penalty that smooths a comb."""

from __future__ import annotations

import numpy as np
import pytest

from tribox.app.simulation.surface_faults import (
    WAVES,
    off_curve,
    softer_factor,
    waves,
    waves_text,
)

MEAN, SHARE = 5.0, 0.1


COUNT = 40


@pytest.fixture
def surface(pair):
    """Forty facets in a row."""
    return pair(upper=(COUNT, 2)).surface()


def share_of(surface, pressure, period=2, inside=None):
    everywhere = np.ones(len(surface.slave.weight), dtype=bool)
    return waves(surface, pressure, everywhere if inside is None else inside, period / COUNT)


@pytest.mark.parametrize("period", [2, 2.8, 4, 7])
def test_a_pressure_that_waves_from_corner_to_corner_is_measured(surface, period):
    """Peaks above a mean, on a slope and on Hertz's ellipse: a curve goes through the waves."""
    x = np.arange(surface.vertices.count)
    wave = MEAN * SHARE * np.cos(2.0 * np.pi * x / period)
    hertz = 1.27 * MEAN * np.sqrt(1.0 - (x / x[-1] - 0.5) ** 2)
    for smooth in (MEAN, np.linspace(4.0, 6.0, len(x)), hertz):
        assert 0.6 * SHARE < share_of(surface, smooth + wave, period) < 1.4 * SHARE


@pytest.mark.parametrize("period", [0.5, 2, 7])
def test_smooth_pressures_and_singular_ends_make_no_waves(surface, period):
    x = np.linspace(0.0, 1.0, surface.vertices.count)
    assert share_of(surface, np.sqrt(1.0 - 0.9 * (2.0 * x - 1.0) ** 2), period) < 0.01
    punch = np.full_like(x, MEAN)
    punch[[0, -1]] = 3.0 * MEAN  # of the corner of a block
    assert share_of(surface, punch, 2) < 0.002
    flat = MEAN / np.sqrt(1.0 - (0.98 * (2.0 * x - 1.0)) ** 2)
    assert share_of(surface, flat, period) < WAVES


def test_nothing_is_said_of_few_vertices(surface):
    comb = np.where(np.arange(surface.vertices.count) % 2, 1.0, 0.0)
    few = surface.slave.position[:, 0] < np.sort(surface.vertices.position[:, 0])[4]
    assert share_of(surface, comb, inside=few) == 0.0


def test_waves_in_space_are_measured_over_a_surface():
    """Corners every three vertices one way, on a smooth hill."""
    x = np.linspace(0.0, 1.0, 16)
    place = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((16, 16))], axis=2).reshape(-1, 3)
    hill = 1.0 - (place[:, 0] - 0.4) ** 2 - (place[:, 1] - 0.5) ** 2
    wave = SHARE * np.cos(2.0 * np.pi * 5.0 * place[:, 0])
    off, fitted = off_curve(place, hill + wave, 0.2)
    assert np.allclose(off_curve(place, hill, 0.2)[0], 0.0, atol=1e-12)
    assert 100 < fitted.sum() < 256 and not fitted[0]
    assert np.abs(off[fitted]).max() == pytest.approx(SHARE, rel=0.4)


def test_the_warning_names_the_contact_and_a_cure():
    line = waves_text(2, 0.078, 1e-4)
    assert line.startswith("contact.2: combed pressures: from vertex to vertex they are off")
    assert "a smooth curve by 7.8 % of their mean" in line and "0.0001 m apart" in line
    assert 'smooth the master (smoothing_angle = "30 deg")' in line


@pytest.mark.parametrize(
    ("factor", "mean", "sagitta", "cost", "wanted"),
    [
        (30.0, 1.7e-8, 5.2e-8, 0.03, 1.0),  # an eighth of 30 * 1.7/5.2, one digit
        (300.0, 3.4e-8, 3.4e-8, 0.0, 30.0),  # at least ten times softer
        (30.0, 1.7e-8, 5.2e-8, 0.1, None),  # the force would be too small
        (30.0, 1.7e-8, 0.0, 0.0, None),
    ],
)
def test_a_softer_penalty_is_offered_where_it_costs_little(factor, mean, sagitta, cost, wanted):
    assert softer_factor(factor, mean, sagitta, cost) == wanted
