"""How far a pressure alternates from vertex to vertex, and the penalty that smooths a comb."""

from __future__ import annotations

import numpy as np
import pytest

from tribox.app.simulation.combed_pressure import alternation, alternation_text, softer_factor

MEAN, SHARE = 5.0, 0.1


@pytest.fixture
def surface(pair):
    """Twenty facets in a row."""
    return pair(upper=(20, 2)).surface()


def share_of(surface, pressure, inside=None):
    everywhere = np.ones(len(surface.slave.weight), dtype=bool)
    return alternation(surface, pressure, everywhere if inside is None else inside)


def test_a_pressure_that_alternates_is_measured_by_its_amplitude(surface):
    sign = np.where(np.arange(surface.vertices.count) % 2, 1.0, -1.0)
    comb = MEAN * (1.0 + SHARE * sign)
    assert share_of(surface, comb) == pytest.approx(SHARE, rel=0.02)
    # On a slope too: a line is no roughness.
    slope = np.linspace(4.0, 6.0, surface.vertices.count) + MEAN * SHARE * sign
    assert share_of(surface, slope) == pytest.approx(SHARE, rel=0.02)


def test_smooth_pressures_and_singular_ends_do_not_alternate(surface):
    x = np.linspace(0.0, 1.0, surface.vertices.count)
    assert share_of(surface, np.sqrt(1.0 - 0.9 * (2.0 * x - 1.0) ** 2)) < 0.002
    punch = np.full_like(x, MEAN)
    punch[[0, -1]] = 3.0 * MEAN  # of the corner of a block
    assert share_of(surface, punch) < 0.002


def test_nothing_is_said_of_few_vertices(surface):
    comb = np.where(np.arange(surface.vertices.count) % 2, 1.0, 0.0)
    few = surface.slave.position[:, 0] < np.sort(surface.vertices.position[:, 0])[4]
    assert share_of(surface, comb, few) == 0.0


def test_the_warning_names_the_contact_and_a_cure():
    line = alternation_text(2, 0.078)
    assert line.startswith("contact.2: combed pressures: they alternate") and "7.8 %" in line
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
